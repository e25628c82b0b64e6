//needs loss window
// Gradient of the loss in the first three channels of `gradient` [H W][CHANNELS + 1], from the maps of `similarity`, and
// for each tile its part of the gradient of the photo's row of `exposure`.
@group(0) @binding(0) var<uniform> loss: Loss;
@group(0) @binding(1) var<storage, read> image: array<f32>;
@group(0) @binding(2) var<storage, read> photo: array<u32>;
@group(0) @binding(3) var<storage, read> maps: array<f32>;
@group(0) @binding(4) var<storage, read_write> gradient: array<f32>;
@group(0) @binding(5) var<storage, read> exposure: array<f32>;
@group(0) @binding(6) var<storage, read_write> exposure_sums: array<vec4<f32>>;

var<workgroup> pixels: array<vec4<f32>, 676>;

fn map_at(p: vec2<i32>, c: u32) -> vec4<f32> {
    if (!is_inside(p)) {
        return vec4<f32>(0.0);
    }
    let plane = loss.width * loss.height;
    let at = 3u * c * plane + index_of(p);
    return vec4<f32>(maps[at], maps[at + plane], maps[at + 2u * plane], 0.0);
}

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let tile = min(group_number(group, groups), loss.n_groups - 1u);
    let corner = corner_of(tile);
    let own = corner + vec2<i32>(vec2<u32>(lane & 15u, lane >> 4u));
    let factors = brightness();
    var by_exposure = vec4<f32>(0.0);
    var slopes = vec3<f32>(0.0);
    for (var c = 0u; c < 3u; c++) {
        for (var i = lane; i < SIDE * SIDE; i += 256u) {
            pixels[i] = map_at(with_margin(corner, i), c);
        }
        workgroupBarrier();
        for (var i = lane; i < SIDE * 16u; i += 256u) {
            let m = (i >> 4u) * SIDE + (i & 15u) + 5u;
            rows[i] = blur(pixels[m - 5u] + pixels[m + 5u], pixels[m - 4u] + pixels[m + 4u],
                           pixels[m - 3u] + pixels[m + 3u], pixels[m - 2u] + pixels[m + 2u],
                           pixels[m - 1u] + pixels[m + 1u], pixels[m]);
        }
        workgroupBarrier();
        if (is_inside(own)) {
            let blurred = blur_column(lane + 80u);
            let at = index_of(own);
            var slope = 0.0;
            if (photo[at] >> 24u != 0u) {
                let values = values_at(own, c, factors[c]);
                let x = values.x;
                let y = values.y;
                slope = fma(y, blurred.z, fma(x + x, blurred.y, blurred.x));
                let side = select(select(0.0, -loss.by_difference, x < y), loss.by_difference, x > y);
                slope = fma(slope, -loss.by_similarity, side * loss.weight);
                by_exposure[c] = slope * x;
            }
            slopes[c] = slope * factors[c];
        }
        workgroupBarrier();
    }
    if (is_inside(own)) {
        let at = index_of(own) * (CHANNELS + 1u);
        gradient[at] = slopes.x;  // one after the other, so that memory is written once
        gradient[at + 1u] = slopes.y;
        gradient[at + 2u] = slopes.z;
        if (CHANNELS == 3u) {  // ray_gradient writes the others where there are channels
            gradient[at + 3u] = 0.0;
        }
    }
    rows[lane] = by_exposure;  // no longer read as rows
    workgroupBarrier();
    for (var step = 128u; step > 0u; step >>= 1u) {
        if (lane < step) {
            rows[lane] += rows[lane + step];
        }
        workgroupBarrier();
    }
    if (lane == 0u) {
        exposure_sums[tile] = rows[0];
    }
}
