//needs clustering tree_sum_4
// Mean unit features and temperature of each segment, a workgroup each; sums are in a fixed order.
@group(0) @binding(0) var<uniform> clustering: Clustering;
@group(0) @binding(1) var<storage, read> samples: array<vec4<u32>>;
@group(0) @binding(2) var<storage, read> segments: array<vec4<u32>>;
@group(0) @binding(3) var<storage, read> units: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> centers: array<vec4<f32>>;

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let s = min(group_number(group, groups), clustering.n_segments - 1u);
    let segment = segments[s];
    let n = max(f32(segment.z), 1.0);
    var center: array<vec4<f32>, FEATURES_4>;
    for (var q = 0u; q < FEATURES_4; q++) {
        var part = vec4<f32>(0.0);
        for (var j = segment.x + lane; j < segment.y; j += 256u) {
            part += f32(samples[j].z) * units[j * FEATURES_4 + q];
        }
        center[q] = tree_sum_4(lane, part) / n;
    }
    var distance = vec4<f32>(0.0);
    for (var j = segment.x + lane; j < segment.y; j += 256u) {
        var squared = 0.0;
        for (var q = 0u; q < FEATURES_4; q++) {
            let difference = units[j * FEATURES_4 + q] - center[q];
            squared += dot(difference, difference);
        }
        distance.x += f32(samples[j].z) * sqrt(squared);
    }
    let total = tree_sum_4(lane, distance).x;
    if (lane == 0u) {
        let temperature = clamp(10.0 * (total / n) / bitcast<f32>(segment.w), 0.1, 1.0) + 1e-6;
        for (var q = 0u; q < FEATURES_4; q++) {
            centers[s * (FEATURES_4 + 1u) + q] = center[q];
        }
        centers[s * (FEATURES_4 + 1u) + FEATURES_4] = vec4<f32>(1.0 / temperature, 0.0, 0.0, 0.0);
    }
}
