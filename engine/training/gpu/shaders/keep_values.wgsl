// Gradients of a first picture: kept while those of a second one are computed, and then added to them.
struct Keep {
    length: u32,  // in vec4
    adds: u32,
}
@group(0) @binding(0) var<uniform> keep: Keep;
@group(0) @binding(1) var<storage, read_write> values: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> kept: array<vec4<f32>>;

@compute @workgroup_size(128)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let i = group_number(group, groups) * 128u + lane;
    if (i >= min(keep.length, arrayLength(&values))) {
        return;
    }
    if (keep.adds != 0u) {
        values[i] += kept[i];
    } else {
        kept[i] = values[i];
    }
}
