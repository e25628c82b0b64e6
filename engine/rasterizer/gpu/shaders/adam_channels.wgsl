// Adam on features, whose values, divided by their length or not, are the channels after the colours.
@group(0) @binding(0) var<uniform> optimiser: Optimiser;
@group(0) @binding(1) var<storage, read> totals: array<f32>;    // rows of 4 (CHUNKS + 2), the channels from 8 + 3 on
@group(0) @binding(2) var<storage, read> channels: array<f32>;
@group(0) @binding(3) var<storage, read_write> features: array<f32>;
@group(0) @binding(4) var<storage, read_write> mean: array<f32>;
@group(0) @binding(5) var<storage, read_write> square: array<f32>;
@group(0) @binding(6) var<storage, read> status: array<u32>;

@compute @workgroup_size(128)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let g = group_number(group, groups) * 128u + lane;
    if (g >= optimiser.n || !is_trained(FEATURES) || status[HALTED] != 0u) {
        return;
    }
    let n = optimiser.n_channels;
    let from_row = 4u * (CHUNKS + 2u) * g + 8u + CHANNELS - n;
    var along = 0.0;  // the part of the gradient that changes the length alone
    var length = 1.0;
    if (optimiser.unit_channels != 0u) {
        var squared = 0.0;
        for (var k = 0u; k < n; k++) {
            squared = fma(features[g * n + k], features[g * n + k], squared);
        }
        length = max(sqrt(squared), NORM_MIN);
        if (sqrt(squared) > NORM_MIN) {
            for (var k = 0u; k < n; k++) {
                along = fma(totals[from_row + k], channels[g * n + k], along);
            }
        }
    }
    for (var k = 0u; k < n; k++) {
        let i = g * n + k;
        let moved = adam((totals[from_row + k] - along * channels[i]) / length, mean[i], square[i], FEATURES);
        mean[i] = moved.x;
        square[i] = moved.y;
        features[i] -= moved.z;
    }
}
