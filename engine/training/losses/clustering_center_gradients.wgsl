//needs clustering tree_sum_4 clustering_logit
// Gradient of the loss by each unit feature of a segment through its centre, a workgroup each.
@group(0) @binding(0) var<uniform> clustering: Clustering;
@group(0) @binding(1) var<storage, read> samples: array<vec4<u32>>;
@group(0) @binding(2) var<storage, read> segments: array<vec4<u32>>;
@group(0) @binding(3) var<storage, read> units: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> centers: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> normalisers: array<f32>;
@group(0) @binding(6) var<storage, read_write> center_gradients: array<vec4<f32>>;

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let s = min(group_number(group, groups), clustering.n_segments - 1u);
    let n = segments[s].z;
    let slope = clustering.weight * centers[s * (FEATURES_4 + 1u) + FEATURES_4].x;
    var gradient: array<vec4<f32>, FEATURES_4>;
    for (var j = lane; j < clustering.n_samples && n > 0u; j += 256u) {
        let error = exp(logit(j, s) - normalisers[j]) - select(0.0, 1.0, s == samples[j].y);
        for (var q = 0u; q < FEATURES_4; q++) {
            gradient[q] += slope * f32(samples[j].z) * error * units[j * FEATURES_4 + q];
        }
    }
    for (var q = 0u; q < FEATURES_4; q++) {
        let total = tree_sum_4(lane, gradient[q]);
        if (lane == 0u) {
            center_gradients[s * FEATURES_4 + q] = total / max(f32(n), 1.0);
        }
    }
}
