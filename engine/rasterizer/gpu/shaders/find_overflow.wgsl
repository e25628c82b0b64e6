// Finds the Gaussians with a gradient whose square, which Adam accumulates, is not finite: they are left out of the step.
@group(0) @binding(0) var<uniform> optimiser: Optimiser;
@group(0) @binding(1) var<storage, read> gradients: array<f32>;
@group(0) @binding(2) var<storage, read> log_scales: array<f32>;
@group(0) @binding(3) var<storage, read> opacity_logits: array<f32>;
@group(0) @binding(4) var<storage, read> totals: array<f32>;
@group(0) @binding(5) var<storage, read> channels: array<f32>;
@group(0) @binding(6) var<storage, read> features: array<f32>;
@group(0) @binding(7) var<storage, read_write> skipped: array<atomic<u32>>;

@compute @workgroup_size(128)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let g = group_number(group, groups) * 128u + lane;
    if (g >= optimiser.n) {
        return;
    }
    var overflows = false;
    for (var k = 0u; k < 11u; k++) {
        overflows = overflows || square_overflows(row_gradient(g, k));
    }
    let scale = feature_scale(g);
    for (var k = 0u; k < optimiser.n_channels; k++) {
        overflows = overflows || square_overflows(feature_gradient(g, k, scale));
    }
    if (overflows && atomicOr(&skipped[g + 1u], 1u) == 0u) {
        atomicAdd(&skipped[0], 1u);
    }
}
