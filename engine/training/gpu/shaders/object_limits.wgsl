//needs optimiser
// Keeps the Gaussians of an object in its box, and from being needles or large (`ObjectLimits` of the processor's steps).
struct Limits {
    low_x: f32,
    low_y: f32,
    low_z: f32,
    log_scale: f32,   // largest
    high_x: f32,
    high_y: f32,
    high_z: f32,
    max_logit: f32,
    log_needle: f32,  // largest difference of the longest and the middle scale, and of the middle and the shortest
    log_flat: f32,
    unused_0: u32,
    unused_1: u32,
}
@group(0) @binding(0) var<uniform> optimiser: Optimiser;
@group(0) @binding(1) var<uniform> limits: Limits;
@group(0) @binding(2) var<storage, read_write> means: array<f32>;
@group(0) @binding(3) var<storage, read_write> quats: array<f32>;
@group(0) @binding(4) var<storage, read_write> log_scales: array<f32>;
@group(0) @binding(5) var<storage, read_write> opacity_logits: array<f32>;
@group(0) @binding(6) var<storage, read> skipped: array<u32>;

@compute @workgroup_size(128)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let g = group_number(group, groups) * 128u + lane;
    if (g >= optimiser.n || g < optimiser.n_background || skipped[0] == NO_STEP) {
        return;
    }
    let low = vec3<f32>(limits.low_x, limits.low_y, limits.low_z);
    let high = vec3<f32>(limits.high_x, limits.high_y, limits.high_z);
    let place = clamp(vec3<f32>(means[3u * g], means[3u * g + 1u], means[3u * g + 2u]), low, high);
    let s = vec3<f32>(log_scales[3u * g], log_scales[3u * g + 1u], log_scales[3u * g + 2u]);
    let largest = max(max(s.x, s.y), s.z);
    let smallest = min(min(s.x, s.y), s.z);
    let between = max(min(s.x, s.y), min(max(s.x, s.y), s.z));
    let middle = min(between, limits.log_scale);
    let longest = min(min(largest, middle + limits.log_needle), limits.log_scale);
    let shortest = min(max(smallest, middle - limits.log_flat), middle);
    // The axes keep their order: the first of the largest and the last of the smallest where two are equal.
    var longest_axis = 2u;
    var shortest_axis = 0u;
    if (s.x >= s.y && s.x >= s.z) {
        longest_axis = 0u;
    } else if (s.y >= s.z) {
        longest_axis = 1u;
    }
    if (s.z <= s.x && s.z <= s.y) {
        shortest_axis = 2u;
    } else if (s.y <= s.x) {
        shortest_axis = 1u;
    }
    if (shortest_axis == longest_axis) {  // all are equal
        shortest_axis = (longest_axis + 1u) % 3u;
    }
    let quat = vec4<f32>(quats[4u * g], quats[4u * g + 1u], quats[4u * g + 2u], quats[4u * g + 3u]);
    let norm = max(length(quat), 1e-6);
    for (var k = 0u; k < 3u; k++) {
        means[3u * g + k] = place[k];
        log_scales[3u * g + k] = select(select(middle, shortest, k == shortest_axis), longest, k == longest_axis);
    }
    for (var k = 0u; k < 4u; k++) {
        quats[4u * g + k] = quat[k] / norm;
    }
    opacity_logits[g] = clamp(opacity_logits[g], -limits.max_logit, limits.max_logit);
}
