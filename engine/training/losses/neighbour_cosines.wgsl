//needs neighbours feature_length tree_sum_4
// Sums of the cosines of L_reg, and which candidates are distant. 32 invocations for each anchor, 8 anchors a workgroup.
@group(0) @binding(0) var<uniform> neighbours: Neighbours;
@group(0) @binding(1) var<storage, read> anchors: array<u32>;
@group(0) @binding(2) var<storage, read> means: array<f32>;
@group(0) @binding(3) var<storage, read> channels: array<f32>;
@group(0) @binding(4) var<storage, read_write> distant: array<u32>;  // bits of the candidates of each anchor
@group(0) @binding(5) var<storage, read_write> cosine_sums: array<vec4<f32>>;  // near, distant, number of distant ones

var<workgroup> found: array<atomic<u32>, 8>;

fn cosine(a: u32, b: u32) -> f32 {
    var total = 0.0;
    for (var k = 0u; k < neighbours.n_features; k++) {
        total = fma(channels[a * neighbours.n_features + k], channels[b * neighbours.n_features + k], total);
    }
    return total / (feature_length(a) * feature_length(b));
}

fn place_of(g: u32) -> vec3<f32> {
    return vec3<f32>(means[3u * g], means[3u * g + 1u], means[3u * g + 2u]);
}

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let block = group_number(group, groups);
    let own = lane >> 5u;
    let i = block * 8u + own;
    let first = lane & 31u;
    let row = i * (1u + neighbours.n_near + neighbours.n_tries);
    let candidates = row + 1u + neighbours.n_near;
    let exists = i < neighbours.n_anchors;
    if (first == 0u) {
        atomicStore(&found[own], 0u);
    }
    workgroupBarrier();
    // There are at most 32 candidates.
    if (exists && first < neighbours.n_tries
        && distance(place_of(anchors[row]), place_of(anchors[candidates + first])) > neighbours.far) {
        atomicOr(&found[own], 1u << first);
    }
    workgroupBarrier();
    var part = vec4<f32>(0.0);
    if (exists) {
        let a = anchors[row];
        for (var k = first; k < neighbours.n_near; k += 32u) {
            part.x += cosine(a, anchors[row + 1u + k]);
        }
        var bits = atomicLoad(&found[own]);
        while (countOneBits(bits) > neighbours.max_far) {
            bits &= ~(1u << firstLeadingBit(bits));
        }
        if ((bits >> first & 1u) != 0u) {
            part.y = cosine(a, anchors[candidates + first]);
            part.z = 1.0;
        }
        if (first == 0u) {
            distant[i] = bits;
        }
    }
    let total = tree_sum_4(lane, part);
    if (lane == 0u && block * 8u < neighbours.n_anchors) {
        cosine_sums[block] = total;
    }
}
