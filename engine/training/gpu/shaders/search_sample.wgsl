//needs search
// Every so manieth mean.
@group(0) @binding(1) var<storage, read> means: array<f32>;
@group(0) @binding(2) var<storage, read_write> sample: array<f32>;

@compute @workgroup_size(128)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let i = group_number(group, groups) * 128u + lane;
    if (i >= search.end) {
        return;
    }
    for (var k = 0u; k < 3u; k++) {
        sample[3u * i + k] = means[3u * search.stride * i + k];
    }
}
