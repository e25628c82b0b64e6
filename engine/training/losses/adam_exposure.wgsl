//needs optimiser tree_sum_4
// Adam on `exposure` [views][3]. Photos other than that of the step have gradient 0. Then the mean over the views that are
// in use is subtracted, because the brightness common to all photos is part of the Gaussians' colours.
@group(0) @binding(0) var<uniform> optimiser: Optimiser;
@group(0) @binding(1) var<storage, read> exposure_gradient: array<f32>;
@group(0) @binding(2) var<storage, read_write> exposure: array<f32>;
@group(0) @binding(3) var<storage, read_write> mean: array<f32>;
@group(0) @binding(4) var<storage, read_write> square: array<f32>;
@group(0) @binding(5) var<storage, read> in_use: array<u32>;  // 1 for each view in use
@group(0) @binding(6) var<storage, read> skipped: array<u32>;

@compute @workgroup_size(256)
fn main(@builtin(local_invocation_index) lane: u32) {
    let trained = is_trained(EXPOSURE) && skipped[0] < REFUSED;
    var part = vec4<f32>(0.0);  // sums, and number of views
    // Each invocation keeps its views, so that no other one writes them.
    for (var view = lane; view < optimiser.n_views && trained; view += 256u) {
        for (var c = 0u; c < 3u; c++) {
            let i = 3u * view + c;
            let gradient = select(0.0, exposure_gradient[c], view == optimiser.view);
            let moved = adam(gradient, mean[i], square[i], EXPOSURE);
            mean[i] = moved.x;
            square[i] = moved.y;
            exposure[i] -= moved.z;
            part[c] += f32(in_use[view]) * exposure[i];
        }
        part.w += f32(in_use[view]);
    }
    let total = tree_sum_4(lane, part);
    for (var view = lane; view < optimiser.n_views && trained; view += 256u) {
        for (var c = 0u; c < 3u && in_use[view] != 0u; c++) {
            exposure[3u * view + c] -= total[c] / total.w;
        }
    }
}
