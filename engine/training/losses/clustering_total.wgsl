//needs clustering tree_sum_4
// Adds L_CC to the loss.
@group(0) @binding(0) var<uniform> clustering: Clustering;
@group(0) @binding(1) var<storage, read> clustering_sums: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> loss_values: array<f32>;

@compute @workgroup_size(256)
fn main(@builtin(local_invocation_index) lane: u32) {
    var part = vec4<f32>(0.0);
    for (var i = lane; i < clustering.n_groups; i += 256u) {
        part += clustering_sums[i];
    }
    let total = tree_sum_4(lane, part).x;
    if (lane == 0u) {
        loss_values[0] += clustering.weight * total;
    }
}
