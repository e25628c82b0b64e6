//needs optimiser philox dropout row_gradient
// Adam on means, quats, log_scales and opacity_logits; gradients and moments are rows of 12 values for each Gaussian.
@group(0) @binding(0) var<uniform> optimiser: Optimiser;
@group(0) @binding(1) var<storage, read> gradients: array<f32>;
@group(0) @binding(2) var<storage, read_write> means: array<f32>;
@group(0) @binding(3) var<storage, read_write> quats: array<f32>;
@group(0) @binding(4) var<storage, read_write> log_scales: array<f32>;
@group(0) @binding(5) var<storage, read_write> opacity_logits: array<f32>;
@group(0) @binding(6) var<storage, read_write> mean: array<f32>;
@group(0) @binding(7) var<storage, read_write> square: array<f32>;
@group(0) @binding(8) var<storage, read> skipped: array<u32>;

@compute @workgroup_size(128)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let i = group_number(group, groups) * 128u + lane;
    let g = i / 12u;
    let k = i % 12u;
    if (g >= optimiser.n || k > 10u || skipped[0] >= REFUSED || skipped[g + 1u] != 0u) {
        return;
    }
    let part = group_of(k);
    if (!is_trained(part)) {
        return;
    }
    let gradient = select(0.0, row_gradient(g, k), g >= optimiser.n_background);
    let moved = adam(gradient, mean[i], square[i], part);
    mean[i] = moved.x;
    square[i] = moved.y;
    if (part == MEANS) {
        means[3u * g + k] -= moved.z;
    } else if (part == QUATS) {
        quats[4u * g + k - 3u] -= moved.z;
    } else if (part == LOG_SCALES) {
        log_scales[3u * g + k - 7u] -= moved.z;
    } else {
        opacity_logits[g] -= moved.z;
    }
}
