// Sum of dL/dcolor over the pairs of each Gaussian, in their order: the votes [N][CHANNELS] of the weights in `gradient`.
@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> ranges: array<vec2<u32>>;
@group(0) @binding(2) var<storage, read> rows: array<vec4<f32>>;  // as in blend_backward.wgsl
@group(0) @binding(3) var<storage, read_write> votes: array<f32>;

@compute @workgroup_size(128)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let at = group_number(group, groups) * 128u + lane;
    let g = at / CHUNKS;
    let q = at % CHUNKS;
    if (g >= view.n) {
        return;
    }
    let range = ranges[g];
    var total = vec4<f32>(0.0);
    for (var i = range.x; i < range.y; i++) {
        total += rows[i * (CHUNKS + 2u) + 2u + q];
    }
    for (var k = 0u; k < min(4u, CHANNELS - 4u * q); k++) {
        votes[g * CHANNELS + 4u * q + k] = total[k];
    }
}
