// Sum of the rows of each Gaussian's pairs, which are neighbours, in their order.
@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> ranges: array<vec2<u32>>;
@group(0) @binding(2) var<storage, read> rows: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> totals: array<vec4<f32>>;

@compute @workgroup_size(128)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let at = group_number(group, groups) * 128u + lane;
    let g = at / (CHUNKS + 2u);
    let k = at % (CHUNKS + 2u);
    if (g >= view.n) {
        return;
    }
    let range = ranges[g];
    var total = vec4<f32>(0.0);
    for (var i = range.x; i < range.y; i++) {
        total += rows[i * (CHUNKS + 2u) + k];
    }
    totals[at] = total;
}
