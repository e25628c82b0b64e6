//needs optimiser channel_gradient
// Adam on features, whose values, divided by their length or not, are the channels after the colours.
@group(0) @binding(0) var<uniform> optimiser: Optimiser;
@group(0) @binding(1) var<storage, read> totals: array<f32>;
@group(0) @binding(2) var<storage, read> channels: array<f32>;
@group(0) @binding(3) var<storage, read> feature_scales: array<vec2<f32>>;  // as in find_overflow.wgsl
@group(0) @binding(4) var<storage, read_write> features: array<f32>;
@group(0) @binding(5) var<storage, read_write> mean: array<f32>;
@group(0) @binding(6) var<storage, read_write> square: array<f32>;
@group(0) @binding(7) var<storage, read> skipped: array<u32>;

@compute @workgroup_size(128)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let i = group_number(group, groups) * 128u + lane;
    let g = i / optimiser.n_channels;
    let k = i % optimiser.n_channels;
    if (g >= optimiser.n || !is_trained(FEATURES) || skipped[0] >= REFUSED || skipped[g + 1u] != 0u) {
        return;
    }
    let moved = adam(feature_gradient(g, k, feature_scales[g]), mean[i], square[i], FEATURES);
    mean[i] = moved.x;
    square[i] = moved.y;
    features[i] -= moved.z;
}
