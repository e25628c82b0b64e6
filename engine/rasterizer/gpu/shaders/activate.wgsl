// Scales, opacities and unit channels from the values that are trained.
@group(0) @binding(0) var<uniform> optimiser: Optimiser;
@group(0) @binding(1) var<storage, read> log_scales: array<f32>;
@group(0) @binding(2) var<storage, read> opacity_logits: array<f32>;
@group(0) @binding(3) var<storage, read> features: array<f32>;
@group(0) @binding(4) var<storage, read_write> scales: array<f32>;
@group(0) @binding(5) var<storage, read_write> opacities: array<f32>;
@group(0) @binding(6) var<storage, read_write> channels: array<f32>;
@group(0) @binding(7) var<storage, read_write> status: array<atomic<u32>>;

@compute @workgroup_size(128)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let g = group_number(group, groups) * 128u + lane;
    if (g >= optimiser.n) {
        return;
    }
    var finite = is_finite(opacity_logits[g]);
    for (var k = 0u; k < 3u; k++) {
        finite = finite && is_finite(log_scales[3u * g + k]);
        scales[3u * g + k] = exp(log_scales[3u * g + k]);
    }
    opacities[g] = 1.0 / (1.0 + exp(-opacity_logits[g]));
    let row = g * optimiser.n_channels;
    var squared = 0.0;
    for (var k = 0u; k < optimiser.n_channels; k++) {
        finite = finite && is_finite(features[row + k]);
        squared = fma(features[row + k], features[row + k], squared);
    }
    let length = select(1.0, max(sqrt(squared), NORM_MIN), optimiser.unit_channels != 0u);
    for (var k = 0u; k < optimiser.n_channels; k++) {
        channels[row + k] = features[row + k] / length;
    }
    // Tested here, because a quotient or an exponential of such a value may look finite.
    if (!finite) {
        atomicOr(&status[HALTED], 1u);
    }
}
