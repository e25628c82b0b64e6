// Sizes of the steps after counting. More pairs than the buffers hold: no pairs, and the flag says how many are needed.
@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> offsets: array<u32>;
@group(0) @binding(2) var<storage, read_write> counts: array<u32>;
@group(0) @binding(3) var<storage, read_write> dispatches: array<u32>;

fn write_dispatch(at: u32, n: u32) {
    let x = min(n, 65535u);
    dispatches[at] = x;
    dispatches[at + 1u] = select(0u, (n + x - 1u) / x, x > 0u);
    dispatches[at + 2u] = 1u;
}

@compute @workgroup_size(1)
fn main() {
    let wanted = offsets[view.n];
    let n = select(wanted, 0u, wanted > view.capacity);
    counts[N_WANTED] = wanted;
    counts[N_PAIRS] = n;
    let blocks = (n + SORT_BLOCK - 1u) / SORT_BLOCK;
    write_dispatch(0u, blocks);
    write_dispatch(3u, (256u * blocks + SCAN_BLOCK - 1u) / SCAN_BLOCK);
    write_dispatch(6u, (n + 255u) / 256u);
}
