//needs neighbours feature_length
// Adds the gradient of L_reg to that of the channels in `totals`, an invocation for each distinct Gaussian, its pairs in order.
@group(0) @binding(0) var<uniform> neighbours: Neighbours;
@group(0) @binding(1) var<storage, read> gaussians: array<vec4<u32>>;  // Gaussian, first pair, end
@group(0) @binding(2) var<storage, read> pairs: array<vec4<u32>>;      // other Gaussian, anchor, 0 or 1 + candidate
@group(0) @binding(3) var<storage, read> channels: array<f32>;
@group(0) @binding(4) var<storage, read> distant: array<u32>;
@group(0) @binding(5) var<storage, read> slopes: array<f32>;
@group(0) @binding(6) var<storage, read_write> totals: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let row = group_number(group, groups) * 64u + lane;
    if (row >= neighbours.n_rows) {
        return;
    }
    let own = gaussians[row];
    let n = neighbours.n_features;
    var by_unit: array<f32, CHANNELS>;
    for (var i = own.y; i < own.z; i++) {
        let pair = pairs[i];
        var slope = slopes[0];
        if (pair.z > 0u) {
            slope = select(0.0, slopes[1], (distant[pair.y] >> (pair.z - 1u) & 1u) != 0u);
        }
        if (slope != 0.0) {
            let factor = slope / feature_length(pair.x);
            for (var k = 0u; k < n; k++) {
                by_unit[k] = fma(factor, channels[pair.x * n + k], by_unit[k]);
            }
        }
    }
    let length = feature_length(own.x);
    var along = 0.0;  // the part that changes the length alone
    for (var k = 0u; k < n && length > NORM_MIN; k++) {
        along = fma(by_unit[k], channels[own.x * n + k] / length, along);
    }
    for (var k = 0u; k < n; k++) {
        let place = 4u * (CHUNKS + 2u) * own.x + 8u + CHANNELS - n + k;
        totals[place] += (by_unit[k] - along * channels[own.x * n + k] / length) / length;
    }
}
