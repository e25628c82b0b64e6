// Rows of `width` values: row i becomes what row `sources[i]` was. The highest bit of a source marks a fresh Gaussian.
struct Gather {
    n: u32,
    width: u32,
    clears: u32,  // whether the rows of fresh Gaussians become zero
}
@group(0) @binding(0) var<uniform> gather: Gather;
@group(0) @binding(1) var<storage, read> sources: array<u32>;
@group(0) @binding(2) var<storage, read> values: array<f32>;
@group(0) @binding(3) var<storage, read_write> gathered: array<f32>;

@compute @workgroup_size(128)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let i = group_number(group, groups) * 128u + lane;
    let g = i / gather.width;
    if (g >= gather.n) {
        return;
    }
    let source = sources[g];
    let value = values[(source & 0x7fffffffu) * gather.width + i % gather.width];
    gathered[i] = select(value, 0.0, gather.clears != 0u && source >> 31u != 0u);
}
