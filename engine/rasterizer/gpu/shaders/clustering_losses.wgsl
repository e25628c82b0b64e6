// Loss of each sample, and its gradient by the sample's unit features with the centres held.
@group(0) @binding(0) var<uniform> clustering: Clustering;
@group(0) @binding(1) var<storage, read> samples: array<vec4<u32>>;
@group(0) @binding(2) var<storage, read> segments: array<vec4<u32>>;
@group(0) @binding(3) var<storage, read> units: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> centers: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> unit_gradients: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> normalisers: array<f32>;  // logarithm of the sum of exp(logit)
@group(0) @binding(7) var<storage, read_write> clustering_sums: array<vec4<f32>>;

fn of_sample(j: u32) -> f32 {
    let sample = samples[j];
    var largest = logit(j, sample.y);
    var total = 1.0;
    for (var s = 0u; s < clustering.n_segments; s++) {
        // A segment without a sample has no mean.
        if (s == sample.y || segments[s].z == 0u) {
            continue;
        }
        let value = logit(j, s);
        let larger = max(largest, value);
        total = total * exp(largest - larger) + exp(value - larger);
        largest = larger;
    }
    let normaliser = largest + log(total);
    normalisers[j] = normaliser;
    var gradient: array<vec4<f32>, FEATURES_4>;
    for (var s = 0u; s < clustering.n_segments; s++) {
        if (segments[s].z == 0u) {
            continue;
        }
        let row = s * (FEATURES_4 + 1u);
        let slope = (exp(logit(j, s) - normaliser) - select(0.0, 1.0, s == sample.y)) * centers[row + FEATURES_4].x;
        for (var q = 0u; q < FEATURES_4; q++) {
            gradient[q] += slope * centers[row + q];
        }
    }
    let times = f32(sample.z);
    for (var q = 0u; q < FEATURES_4; q++) {
        unit_gradients[j * FEATURES_4 + q] = clustering.weight * times * gradient[q];
    }
    return times * (normaliser - logit(j, sample.y));
}

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let block = group_number(group, groups);
    let j = block * 256u + lane;
    var own = vec4<f32>(0.0);
    if (j < clustering.n_samples) {
        own.x = of_sample(j);
    }
    let total = tree_sum_4(lane, own);
    if (lane == 0u && block < clustering.n_groups) {
        clustering_sums[block] = total;
    }
}
