// As gather_rows, for harmonics in blocks of 64 Gaussians. `values` and `gathered` are parts of them; a Gaussian whose source
// is in another part is left as it is.
struct Gather {
    n: u32,
    n_sh: u32,
    clears: u32,
    first: u32,         // Gaussian of `gathered`
    source_first: u32,  // Gaussians of `values`
    source_end: u32,
}
@group(0) @binding(0) var<uniform> gather: Gather;
@group(0) @binding(1) var<storage, read> sources: array<u32>;
@group(0) @binding(2) var<storage, read> values: array<f32>;
@group(0) @binding(3) var<storage, read_write> gathered: array<f32>;

@compute @workgroup_size(128)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let i = group_number(group, groups) * 128u + lane;
    let row = 3u * gather.n_sh;
    let g = gather.first + i / (64u * row) * 64u + i % 64u;
    if (g >= gather.n || i >= arrayLength(&gathered)) {
        return;
    }
    let source = sources[g] & 0x7fffffffu;
    if (source < gather.source_first || source >= gather.source_end) {
        return;
    }
    let place = source - gather.source_first;
    let value = values[(place / 64u * row + i / 64u % row) * 64u + place % 64u];
    gathered[i] = select(value, 0.0, gather.clears != 0u && sources[g] >> 31u != 0u);
}
