//needs optimiser philox dropout row_gradient channel_gradient
// Finds the Gaussians with a gradient whose square, which Adam accumulates, is not finite: they are left out of the step.
// `feature_scales`: the length that the features are divided by, and the part of their gradient that changes it alone.
// 8 invocations for each Gaussian: they read neighbouring values.
@group(0) @binding(0) var<uniform> optimiser: Optimiser;
@group(0) @binding(1) var<storage, read> gradients: array<f32>;
@group(0) @binding(2) var<storage, read> log_scales: array<f32>;
@group(0) @binding(3) var<storage, read> opacity_logits: array<f32>;
@group(0) @binding(4) var<storage, read> totals: array<f32>;
@group(0) @binding(5) var<storage, read> channels: array<f32>;
@group(0) @binding(6) var<storage, read> features: array<f32>;
@group(0) @binding(7) var<storage, read_write> skipped: array<atomic<u32>>;
@group(0) @binding(8) var<storage, read_write> feature_scales: array<vec2<f32>>;

var<workgroup> parts: array<vec2<f32>, 128>;

@compute @workgroup_size(128)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let g = group_number(group, groups) * 16u + (lane >> 3u);
    let first = lane & 7u;
    let n = optimiser.n_channels;
    var part = vec2<f32>(0.0);
    for (var k = first; k < n && g < optimiser.n && optimiser.unit_channels != 0u; k += 8u) {
        let feature = features[g * n + k];
        part += vec2<f32>(feature * feature, totals[channel_total(g, k)] * channels[g * n + k]);
    }
    parts[lane] = part;
    workgroupBarrier();
    if (g >= optimiser.n) {
        return;
    }
    var overflows = false;
    for (var k = first; k < 11u; k += 8u) {
        overflows = overflows || square_overflows(row_gradient(g, k));
    }
    if (n > 0u) {
        var scale = vec2<f32>(1.0, 0.0);
        if (optimiser.unit_channels != 0u) {
            var total = vec2<f32>(0.0);
            for (var other = 0u; other < 8u; other++) {
                total += parts[(lane & 0xfffffff8u) + other];
            }
            let length = sqrt(total.x);
            scale = vec2<f32>(max(length, NORM_MIN), select(0.0, total.y, length > NORM_MIN));
        }
        if (first == 0u) {
            feature_scales[g] = scale;
        }
        for (var k = first; k < n; k += 8u) {
            overflows = overflows || square_overflows(feature_gradient(g, k, scale));
        }
    }
    if (overflows && atomicOr(&skipped[g + 1u], 1u) == 0u) {
        atomicAdd(&skipped[0], 1u);
    }
}
