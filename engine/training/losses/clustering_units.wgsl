//needs clustering
// Unit features of the samples, and the lengths that they were divided by.
@group(0) @binding(0) var<uniform> clustering: Clustering;
@group(0) @binding(1) var<storage, read> samples: array<vec4<u32>>;
@group(0) @binding(2) var<storage, read> image: array<f32>;
@group(0) @binding(3) var<storage, read_write> units: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> lengths: array<f32>;

@compute @workgroup_size(128)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let j = group_number(group, groups) * 128u + lane;
    if (j >= clustering.n_samples) {
        return;
    }
    let at = samples[j].x * CHANNELS + 3u;
    var squared = 0.0;
    for (var k = 0u; k < CHANNELS - 3u; k++) {
        squared = fma(image[at + k], image[at + k], squared);
    }
    let length = sqrt(squared);
    lengths[j] = length;
    for (var q = 0u; q < FEATURES_4; q++) {
        var four = vec4<f32>(0.0);
        for (var k = 0u; k < 4u && 4u * q + k < CHANNELS - 3u; k++) {
            four[k] = image[at + 4u * q + k] / (length + NORM_MIN);
        }
        units[j * FEATURES_4 + q] = four;
    }
}
