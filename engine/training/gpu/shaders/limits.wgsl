//needs optimiser
// Keeps scales, aspect, opacities, means and quats where float32 is precise, after a step, and counts the Gaussians at each
// limit. The same as `clamp_parameters` of the processor's trainer.
@group(0) @binding(0) var<uniform> optimiser: Optimiser;
@group(0) @binding(1) var<storage, read_write> means: array<f32>;
@group(0) @binding(2) var<storage, read_write> quats: array<f32>;
@group(0) @binding(3) var<storage, read_write> log_scales: array<f32>;
@group(0) @binding(4) var<storage, read_write> opacity_logits: array<f32>;
@group(0) @binding(5) var<storage, read> skipped: array<u32>;
@group(0) @binding(6) var<storage, read_write> status: array<atomic<u32>>;

var<workgroup> found: array<atomic<u32>, 4>;

fn limit(g: u32) {
    let log_scale = vec3<f32>(log_scales[3u * g], log_scales[3u * g + 1u], log_scales[3u * g + 2u]);
    let longest = min(max(max(log_scale.x, log_scale.y), log_scale.z), optimiser.log_max_scale);
    let shortest = max(longest - optimiser.log_max_aspect, optimiser.log_min_scale);
    let kept = min(max(log_scale, vec3<f32>(shortest)), vec3<f32>(max(longest, shortest)));
    if (g >= optimiser.n_background && any(kept != log_scale)) {
        for (var k = 0u; k < 3u; k++) {
            log_scales[3u * g + k] = kept[k];
        }
        atomicAdd(&found[0], 1u);
    }
    let logit = opacity_logits[g];
    if (abs(logit) > optimiser.max_logit) {
        opacity_logits[g] = clamp(logit, -optimiser.max_logit, optimiser.max_logit);
        atomicAdd(&found[1], 1u);
    }
    let center = vec3<f32>(optimiser.center_x, optimiser.center_y, optimiser.center_z);
    let from_center = vec3<f32>(means[3u * g], means[3u * g + 1u], means[3u * g + 2u]) - center;
    let far = vec3<f32>(optimiser.max_distance);
    if (any(abs(from_center) > far)) {
        let near = center + clamp(from_center, -far, far);
        for (var k = 0u; k < 3u; k++) {
            means[3u * g + k] = near[k];
        }
        atomicAdd(&found[2], 1u);
    }
    var quat = vec4<f32>(quats[4u * g], quats[4u * g + 1u], quats[4u * g + 2u], quats[4u * g + 3u]);
    var norm = length(quat);
    if (norm < 1e-6) {
        quat = vec4<f32>(1.0, 0.0, 0.0, 0.0);
        norm = 1.0;
        atomicAdd(&found[3], 1u);
    }
    for (var k = 0u; k < 4u; k++) {
        quats[4u * g + k] = quat[k] / norm;
    }
}

@compute @workgroup_size(128)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let g = group_number(group, groups) * 128u + lane;
    if (lane < 4u) {
        atomicStore(&found[lane], 0u);
    }
    workgroupBarrier();
    if (g < optimiser.n && optimiser.with_limits != 0u && skipped[0] != NO_STEP) {
        limit(g);
    }
    workgroupBarrier();
    if (lane < 4u) {
        let n = atomicLoad(&found[lane]);
        if (n > 0u) {
            atomicAdd(&status[AT_LIMIT + lane], n);
        }
    }
}
