// Sets a flag if any of `values` is not finite.
struct Range {
    length: u32,  // in vec4
    flag: u32,
}
@group(0) @binding(0) var<uniform> range: Range;
@group(0) @binding(1) var<storage, read> values: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> counts: array<atomic<u32>>;

@compute @workgroup_size(128)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let i = group_number(group, groups) * 128u + lane;
    if (i >= range.length) {
        return;
    }
    let four = values[i];
    if (!(is_finite(four.x) && is_finite(four.y) && is_finite(four.z) && is_finite(four.w))) {
        atomicOr(&counts[NOT_FINITE], range.flag);
    }
}
