//needs neighbours tree_sum_4
// L_reg from the sums of its cosines, in a fixed order, and its derivatives by them.
@group(0) @binding(0) var<uniform> neighbours: Neighbours;
@group(0) @binding(1) var<storage, read> cosine_sums: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> slopes: array<f32>;  // of the loss by each near and each distant cosine
@group(0) @binding(3) var<storage, read_write> loss_values: array<f32>;

fn logistic(x: f32) -> f32 {
    return 1.0 / (1.0 + exp(-x));
}

@compute @workgroup_size(256)
fn main(@builtin(local_invocation_index) lane: u32) {
    var part = vec4<f32>(0.0);
    for (var i = lane; 8u * i < neighbours.n_anchors; i += 256u) {
        part += cosine_sums[i];
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
