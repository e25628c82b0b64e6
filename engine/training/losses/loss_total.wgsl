//needs loss tree_sum
// Sum of the parts of a loss, in a fixed order: the loss, the mean SSIM and the mean |x - y|. The loss has the terms of
// opacities, scales and rays.
@group(0) @binding(0) var<uniform> loss: Loss;
@group(0) @binding(1) var<storage, read> partial_sums: array<vec2<f32>>;
@group(0) @binding(2) var<storage, read_write> loss_values: array<f32>;
@group(0) @binding(3) var<storage, read_write> counts: array<u32>;
@group(0) @binding(4) var<storage, read> exposure: array<f32>;
@group(0) @binding(5) var<storage, read> gaussian_sums: array<vec2<f32>>;  // opacities, scales
@group(0) @binding(6) var<storage, read> ray_sums: array<vec2<f32>>;

@compute @workgroup_size(256)
fn main(@builtin(local_invocation_index) lane: u32) {
    var total = vec2<f32>(0.0);
    for (var i = lane; i < loss.n_groups; i += 256u) {
        total += partial_sums[i];
    }
    let found = tree_sum(lane, total);
    workgroupBarrier();
    var terms = vec2<f32>(0.0);
    for (var i = lane; i < loss.n_gaussian_groups; i += 256u) {
        terms += gaussian_sums[i];
    }
    terms = tree_sum(lane, terms);
    workgroupBarrier();
    var rays = vec2<f32>(0.0);
    for (var i = lane; i < loss.n_groups && loss.by_ray > 0.0; i += 256u) {
        rays += ray_sums[i];
    }
    rays = tree_sum(lane, rays);
    if (lane == 0u) {
        var squares = 0.0;
        for (var c = 0u; c < 3u; c++) {
            squares = fma(exposure[3u * loss.view + c], exposure[3u * loss.view + c], squares);
        }
        loss_values[0] = loss.by_difference * found.y + loss.by_similarity * (1.0 - found.x)
            + loss.by_exposure * squares + loss.by_opacity * terms.x + loss.by_scale * terms.y + loss.by_ray * rays.x;
        loss_values[1] = found.x;
        loss_values[2] = found.y;
        if (!is_finite(loss_values[0]) || !is_finite(found.x) || !is_finite(found.y)) {
            counts[NOT_FINITE] |= 4u;
        }
    }
}
