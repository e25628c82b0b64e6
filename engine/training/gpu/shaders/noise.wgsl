//needs philox
// Random walk of nearly transparent Gaussians (`position_noise` of the processor's trainer):
// means += amount s(100 (0.005 - o)) Sigma eta, limited to max_walk scales along each axis. The draw of a Gaussian depends
// on seed, step and its index alone.
struct Noise {
    n: u32,
    step: u32,
    seed: u32,
    purpose: u32,
    amount: f32,
    max_walk: f32,
    unused_0: u32,
    unused_1: u32,
}
@group(0) @binding(0) var<uniform> noise: Noise;
@group(0) @binding(1) var<storage, read_write> means: array<f32>;
@group(0) @binding(2) var<storage, read> quats: array<f32>;
@group(0) @binding(3) var<storage, read> log_scales: array<f32>;
@group(0) @binding(4) var<storage, read> opacity_logits: array<f32>;
@group(0) @binding(5) var<storage, read> skipped: array<u32>;

const MAX_OPACITY: f32 = 0.2;  // the factor is below 4e-9 above it

@compute @workgroup_size(128)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let g = group_number(group, groups) * 128u + lane;
    if (g >= noise.n || noise.amount == 0.0 || skipped[0] == 0xffffffffu) {
        return;
    }
    let opacity = 1.0 / (1.0 + exp(-opacity_logits[g]));
    if (opacity >= MAX_OPACITY) {
        return;
    }
    let amount = noise.amount / (1.0 + exp(-100.0 * (0.005 - opacity)));
    let eta = three_normals(philox(vec4<u32>(g, noise.step, noise.purpose, 0u), vec2<u32>(noise.seed, 0u)));
    let raw = vec4<f32>(quats[4u * g], quats[4u * g + 1u], quats[4u * g + 2u], quats[4u * g + 3u]);
    let q = raw / max(length(raw), 1e-12);
    let rotation = mat3x3<f32>(  // columns: the Gaussian's axes
        vec3<f32>(1.0 - 2.0 * (q.z * q.z + q.w * q.w), 2.0 * (q.y * q.z + q.x * q.w), 2.0 * (q.y * q.w - q.x * q.z)),
        vec3<f32>(2.0 * (q.y * q.z - q.x * q.w), 1.0 - 2.0 * (q.y * q.y + q.w * q.w), 2.0 * (q.z * q.w + q.x * q.y)),
        vec3<f32>(2.0 * (q.y * q.w + q.x * q.z), 2.0 * (q.z * q.w - q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z)));
    let scale = exp(vec3<f32>(log_scales[3u * g], log_scales[3u * g + 1u], log_scales[3u * g + 2u]));
    let local = scale * min(amount * scale, vec3<f32>(noise.max_walk)) * (eta * rotation);
    let walk = rotation * local;
    for (var k = 0u; k < 3u; k++) {
        means[3u * g + k] += walk[k];
    }
}
