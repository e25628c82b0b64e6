//needs clustering tree_sum_4 clustering_logit
// Loss of each sample, and its gradient by the sample's unit features with the centres held. 4 invocations for each sample,
// which share the segments between them.
@group(0) @binding(0) var<uniform> clustering: Clustering;
@group(0) @binding(1) var<storage, read> samples: array<vec4<u32>>;
@group(0) @binding(2) var<storage, read> segments: array<vec4<u32>>;
@group(0) @binding(3) var<storage, read> units: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> centers: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> unit_gradients: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> normalisers: array<f32>;  // logarithm of the sum of exp(logit)
@group(0) @binding(7) var<storage, read_write> clustering_sums: array<vec4<f32>>;

// Sum over the 4 invocations of a sample, in a fixed order; each of them gets it.
fn sum_of_sample(lane: u32, value: vec4<f32>) -> vec4<f32> {
    workgroupBarrier();  // the result of an earlier sum has been read
    fours[lane] = value;
    workgroupBarrier();
    let first = lane & 0xfffffffcu;
    return (fours[first] + fours[first + 1u]) + (fours[first + 2u] + fours[first + 3u]);
}

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let block = group_number(group, groups);
    let j = min(block * 64u + (lane >> 2u), clustering.n_samples - 1u);
    let part = lane & 3u;
    let exists = part == 0u && block * 64u + (lane >> 2u) < clustering.n_samples;
    let sample = samples[j];
    let own = logit(j, sample.y);
    var largest = own;
    var total = select(0.0, 1.0, part == 0u);
    for (var s = part; s < clustering.n_segments; s += 4u) {
        // A segment without a sample has no mean.
        if (s == sample.y || segments[s].z == 0u) {
            continue;
        }
        let value = logit(j, s);
        let larger = max(largest, value);
        total = total * exp(largest - larger) + exp(value - larger);
        largest = larger;
    }
    fours[lane] = vec4<f32>(largest, 0.0, 0.0, 0.0);
    workgroupBarrier();
    let first = lane & 0xfffffffcu;
    let top = max(max(fours[first].x, fours[first + 1u].x), max(fours[first + 2u].x, fours[first + 3u].x));
    let normaliser = top + log(sum_of_sample(lane, vec4<f32>(total * exp(largest - top))).x);
    var gradient: array<vec4<f32>, FEATURES_4>;
    for (var s = part; s < clustering.n_segments; s += 4u) {
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
        let sum = sum_of_sample(lane, gradient[q]);
        if (exists) {
            unit_gradients[j * FEATURES_4 + q] = clustering.weight * times * sum;
        }
    }
    if (exists) {
        normalisers[j] = normaliser;
    }
    let loss = tree_sum_4(lane, vec4<f32>(select(0.0, times * (normaliser - own), exists), 0.0, 0.0, 0.0));
    if (lane == 0u && block < clustering.n_groups) {
        clustering_sums[block] = loss;
    }
}
