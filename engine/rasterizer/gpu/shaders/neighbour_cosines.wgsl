// Mean cosines of L_reg and its loss, by one workgroup in a fixed order; which candidates are distant.
@group(0) @binding(0) var<uniform> neighbours: Neighbours;
@group(0) @binding(1) var<storage, read> anchors: array<u32>;
@group(0) @binding(2) var<storage, read> means: array<f32>;
@group(0) @binding(3) var<storage, read> channels: array<f32>;
@group(0) @binding(4) var<storage, read_write> distant: array<u32>;  // bits of the candidates of each anchor
@group(0) @binding(5) var<storage, read_write> slopes: array<f32>;   // of the loss by each near and each distant cosine
@group(0) @binding(6) var<storage, read_write> loss_values: array<f32>;

fn cosine(a: u32, b: u32) -> f32 {
    var total = 0.0;
    for (var k = 0u; k < neighbours.n_features; k++) {
        total = fma(channels[a * neighbours.n_features + k], channels[b * neighbours.n_features + k], total);
    }
    return total / (feature_length(a) * feature_length(b));
}

fn logistic(x: f32) -> f32 {
    return 1.0 / (1.0 + exp(-x));
}

@compute @workgroup_size(256)
fn main(@builtin(local_invocation_index) lane: u32) {
    let width = 1u + neighbours.n_near + neighbours.n_tries;
    var part = vec4<f32>(0.0);  // sums of near and of distant cosines, number of distant ones
    for (var i = lane; i < neighbours.n_anchors; i += 256u) {
        let a = anchors[i * width];
        for (var k = 1u; k <= neighbours.n_near; k++) {
            part.x += cosine(a, anchors[i * width + k]);
        }
        let place = vec3<f32>(means[3u * a], means[3u * a + 1u], means[3u * a + 2u]);
        var bits = 0u;
        for (var k = 0u; k < neighbours.n_tries && countOneBits(bits) < neighbours.max_far; k++) {
            let b = anchors[i * width + 1u + neighbours.n_near + k];
            let other = vec3<f32>(means[3u * b], means[3u * b + 1u], means[3u * b + 2u]);
            if (distance(place, other) > neighbours.far) {
                bits |= 1u << k;
                part.y += cosine(a, b);
                part.z += 1.0;
            }
        }
        distant[i] = bits;
    }
    let total = tree_sum_4(lane, part);
    if (lane == 0u) {
        let n_near = f32(neighbours.n_anchors * neighbours.n_near);
        let pull = logistic(1.0 - total.x / n_near);
        slopes[0] = -neighbours.by_pull * pull * (1.0 - pull) / n_near;
        slopes[1] = 0.0;
        var loss = neighbours.by_pull * pull;
        if (total.z > 0.0) {
            let push = logistic(total.y / total.z);
            slopes[1] = neighbours.by_push * push * (1.0 - push) / total.z;
            loss += neighbours.by_push * push;
        }
        loss_values[0] += loss;
    }
}
