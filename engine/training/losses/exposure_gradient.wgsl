//needs loss tree_sum_4
// Gradient of the photo's row of `exposure`: the parts of all tiles, in a fixed order, and that of the squares.
@group(0) @binding(0) var<uniform> loss: Loss;
@group(0) @binding(1) var<storage, read> exposure: array<f32>;
@group(0) @binding(2) var<storage, read> exposure_sums: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> exposure_gradient: array<f32>;
@group(0) @binding(4) var<storage, read_write> counts: array<u32>;

@compute @workgroup_size(256)
fn main(@builtin(local_invocation_index) lane: u32) {
    var part = vec4<f32>(0.0);
    for (var i = lane; i < loss.n_groups; i += 256u) {
        part += exposure_sums[i];
    }
    let total = tree_sum_4(lane, part);
    if (lane == 0u) {
        for (var c = 0u; c < 3u; c++) {
            exposure_gradient[c] = fma(2.0 * loss.by_exposure, exposure[3u * loss.view + c], total[c]);
            if (!is_finite(exposure_gradient[c])) {
                counts[NOT_FINITE] |= 8u;
            }
        }
    }
}
