//needs clustering
// Adds the gradient by the blended features of the samples' pixels to `gradient` [H W][CHANNELS + 1].
@group(0) @binding(0) var<uniform> clustering: Clustering;
@group(0) @binding(1) var<storage, read> samples: array<vec4<u32>>;
@group(0) @binding(2) var<storage, read> units: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> lengths: array<f32>;
@group(0) @binding(4) var<storage, read> unit_gradients: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> center_gradients: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> gradient: array<f32>;

@compute @workgroup_size(128)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let j = group_number(group, groups) * 128u + lane;
    if (j >= clustering.n_samples) {
        return;
    }
    let sample = samples[j];
    let length = lengths[j];
    var by_unit: array<vec4<f32>, FEATURES_4>;
    var along = 0.0;  // the part that changes the length alone
    for (var q = 0u; q < FEATURES_4; q++) {
        let i = j * FEATURES_4 + q;
        by_unit[q] = unit_gradients[i] + f32(sample.z) * center_gradients[sample.y * FEATURES_4 + q];
        along += dot(by_unit[q], units[i]);
    }
    // Of f = F / (|F| + e). Where F is 0, its length has no slope.
    let by_length = select(0.0, along / length, length > 0.0);
    let at = sample.x * (CHANNELS + 1u) + 3u;
    for (var q = 0u; q < FEATURES_4; q++) {
        let four = by_unit[q] / (length + NORM_MIN) - by_length * units[j * FEATURES_4 + q];
        for (var k = 0u; k < 4u && 4u * q + k < CHANNELS - 3u; k++) {
            gradient[at + 4u * q + k] += four[k];
        }
    }
}
