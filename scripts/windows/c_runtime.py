"""The functions of complex numbers that Wine's C runtime lacks.

Wine 10 has stubs for them, which end the process; SciPy, torch and OpenBLAS call some. A library made with mingw takes
the place of Wine's ``ucrtbase.dll``: it has these functions and forwards all others to Wine's own file under another
name. So no file of a wheel is changed.
"""

from __future__ import annotations

import re
import tempfile
from pathlib import Path

from .problem import Problem, run

COMPILER, DUMP = "x86_64-w64-mingw32-gcc", "x86_64-w64-mingw32-objdump"
LIBRARIES = Path("usr/lib/x86_64-linux-gnu/wine/x86_64-windows")
REPLACED, OWN = "ucrtbase.dll", "ucrtreal.dll"

_MARK, _MARK_OFFSET = b"Wine builtin DLL\0", 0x40
"""With it, Wine takes the file for one of its own."""

_GIVE_COMPLEX = (
    *("acos", "acosh", "asin", "asinh", "atan", "atanh", "cos", "cosh", "exp", "log", "proj", "sin", "sinh", "sqrt"),
    *("tan", "tanh"),
)
_GIVE_REAL = ("abs", "arg", "imag", "real")
_KINDS = {"": ("D", "double", ""), "f": ("F", "float", "f"), "l": ("D", "double", "")}
"""Suffix to the structure that Microsoft's functions take, its number, and mingw's suffix. `long double` is double."""


def add_complex_functions(root: Path) -> None:
    """Put the library into a root with Wine; nothing is done where it is."""
    folder = root / LIBRARIES
    replaced, own = folder / REPLACED, folder / OWN
    if own.exists():
        return
    if not replaced.exists():
        raise Problem(f"{replaced} is missing: the root has no 64-bit Wine. Delete {root} and run this again.")
    functions = _source()
    with tempfile.TemporaryDirectory() as name:
        source, exports, made = (Path(name) / file for file in ("complex.c", "complex.def", REPLACED))
        source.write_text("\n".join([*_HEAD, *functions.values()]))
        lines = [
            f'"{one}"=own_{one}' if one in functions else f'"{one}"="{OWN.removesuffix(".dll")}.{one}"'
            for one in _exports(replaced)
        ]
        exports.write_text("\n".join([f"LIBRARY {REPLACED}", "EXPORTS", *lines]) + "\n")
        run(COMPILER, "-O1", "-shared", "-static-libgcc", "-w", "-o", made, source, exports)
        content = bytearray(made.read_bytes())
        content[_MARK_OFFSET : _MARK_OFFSET + len(_MARK)] = _MARK
        replaced.rename(own)
        replaced.write_bytes(content)


def _exports(library: Path) -> list[str]:
    """Return the names that a library exports."""
    table = run(DUMP, "-p", library).partition("[Ordinal/Name Pointer] Table")[2]
    names = re.findall(r"^\s*\[ *\d+\] (?:\+base\[ *\d+\] +\w+ )?(\S+)$", table, re.MULTILINE)
    if "creal" not in names:
        raise Problem(f"{library} does not export creal: this Wine is another one than expected.")
    return names


_HEAD = (
    "#include <complex.h>",
    "#include <math.h>",
    "typedef struct { double r, i; } D;",
    "typedef struct { float r, i; } F;",
    "static double _Complex read_D(D a) { double _Complex z; __real__ z = a.r; __imag__ z = a.i; return z; }",
    "static float _Complex read_F(F a) { float _Complex z; __real__ z = a.r; __imag__ z = a.i; return z; }",
    "static D give_D(double _Complex z) { D o = { __real__ z, __imag__ z }; return o; }",
    "static F give_F(float _Complex z) { F o = { __real__ z, __imag__ z }; return o; }",
)


def _source() -> dict[str, str]:
    """Return the functions in C, by the name that they are exported under."""
    functions = {}
    for suffix, (kind, number, ours) in _KINDS.items():
        for base in _GIVE_COMPLEX:
            functions[f"c{base}{suffix}"] = (
                f"{kind} %s({kind} a) {{ return give_{kind}(c{base}{ours}(read_{kind}(a))); }}"
            )
        for base in _GIVE_REAL:
            functions[f"c{base}{suffix}"] = f"{number} %s({kind} a) {{ return c{base}{ours}(read_{kind}(a)); }}"
        functions[f"conj{suffix}"] = f"{kind} %s({kind} a) {{ a.i = -a.i; return a; }}"
        functions[f"norm{suffix}"] = f"{number} %s({kind} a) {{ return a.r * a.r + a.i * a.i; }}"
        functions[f"clog10{suffix}"] = (
            f"{kind} %s({kind} a) {{ return give_{kind}(clog{ours}(read_{kind}(a)) / ({number})2.302585092994046); }}"
        )
        functions[f"cpow{suffix}"] = (
            f"{kind} %s({kind} a, {kind} b) {{ return give_{kind}(cpow{ours}(read_{kind}(a), read_{kind}(b))); }}"
        )
        upper = suffix.upper()
        functions[f"_{upper}Cbuild"] = f"{kind} %s({number} r, {number} i) {{ {kind} o = {{ r, i }}; return o; }}"
        functions[f"_{upper}Cmulcc"] = (
            f"{kind} %s({kind} a, {kind} b) {{ return give_{kind}(read_{kind}(a) * read_{kind}(b)); }}"
        )
        functions[f"_{upper}Cmulcr"] = f"{kind} %s({kind} a, {number} b) {{ a.r *= b; a.i *= b; return a; }}"
    return {name: text % f"own_{name}" for name, text in functions.items()}
