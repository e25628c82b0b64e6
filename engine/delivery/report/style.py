"""How the page looks: quiet, readable on a phone and on paper."""

STYLE = """
:root{--ink:#2b2a27;--quiet:#6d6a63;--line:#d9d4c8;--paper:#f6f4ef;--card:#fffdf8;--accent:#8a4b2a}
*{box-sizing:border-box}
html{-webkit-text-size-adjust:100%}
body{margin:0;background:var(--paper);color:var(--ink)}
body{font:16px/1.55 system-ui,"Segoe UI",Roboto,"Helvetica Neue",sans-serif}
main{max-width:62rem;margin:0 auto;padding:2.5rem 1.25rem 4rem}
header p{margin:0;color:var(--accent);letter-spacing:.08em;text-transform:uppercase;font-size:.75rem}
h1,h2,h3{font:500 1rem/1.2 Georgia,"Iowan Old Style","Times New Roman",serif;overflow-wrap:anywhere}
h1{font-size:clamp(1.9rem,5vw,2.8rem);margin:.2rem 0 1.5rem}
h2{font-size:1.4rem;margin:3rem 0 .8rem;padding-top:1rem;border-top:1px solid var(--line)}
h3{font-size:1.1rem;margin:1.2rem 0 .5rem}
p{margin:.4rem 0 .8rem;max-width:44rem}
.note,.small{color:var(--quiet)}.small{font-size:.85rem}
.tiles{display:grid;grid-template-columns:repeat(auto-fit,minmax(8.5rem,1fr));gap:.75rem}
.tiles div{background:var(--card);border:1px solid var(--line);border-radius:.5rem;padding:.8rem 1rem}
.tiles b{display:block;font:500 1.5rem/1.2 Georgia,serif}
.tiles span{color:var(--quiet);font-size:.82rem}
article{background:var(--card);border:1px solid var(--line);border-radius:.5rem}
article{padding:.2rem 1rem .6rem;margin:0 0 1rem}
article p{color:var(--quiet);font-size:.88rem;max-width:none}
.sides{display:grid;grid-template-columns:repeat(auto-fit,minmax(9rem,1fr));gap:.5rem}
img{display:block;width:100%;height:auto;border-radius:.3rem}
.pairs{display:grid;gap:1.2rem}
figure{margin:0;display:grid;grid-template-columns:1fr 1fr 1fr;gap:.5rem}
figcaption{grid-column:1/-1;color:var(--quiet);font-size:.85rem;overflow-wrap:anywhere}
.plot{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,17rem),1fr));gap:.5rem}
.plot svg{width:100%;height:auto}
.wide{overflow-x:auto}
table{border-collapse:collapse;min-width:min(100%,28rem)}
th{color:var(--quiet);font-weight:500;font-size:.85rem}
th,td{text-align:right;padding:.35rem .9rem;border-bottom:1px solid var(--line);font-variant-numeric:tabular-nums}
th:first-child,td:first-child{text-align:left;padding-left:0}
tfoot td{font-weight:600;border-bottom:0}
dl{display:grid;grid-template-columns:repeat(auto-fit,minmax(11rem,1fr));gap:.6rem 1.5rem;margin:.8rem 0}
dt{color:var(--quiet);font-size:.85rem}dd{margin:0;font-variant-numeric:tabular-nums}
.low{color:#9b2c23}
code{font-size:.85em;overflow-wrap:anywhere}summary{cursor:pointer}
ul{padding-left:1.1rem;margin:.4rem 0}li{margin:.25rem 0;overflow-wrap:anywhere}
@media (max-width:34rem){figure{grid-template-columns:1fr}}
@media print{body{background:#fff}article,.tiles div{break-inside:avoid}}
"""
