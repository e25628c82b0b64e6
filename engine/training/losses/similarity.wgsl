//needs loss window tree_sum
// SSIM and L1 of an image and a photo in tiles of 16x16 pixels, and the maps p, q, r of the gradient (photometric_kernels.py).
@group(0) @binding(0) var<uniform> loss: Loss;
@group(0) @binding(1) var<storage, read> image: array<f32>;
@group(0) @binding(2) var<storage, read> photo: array<u32>;  // red, green, blue; the highest byte is 0 where not valid
@group(0) @binding(3) var<storage, read_write> maps: array<f32>;  // [3 channels][p, q, r][H W]
@group(0) @binding(4) var<storage, read_write> partial_sums: array<vec2<f32>>;
@group(0) @binding(5) var<storage, read> exposure: array<f32>;

var<workgroup> pixels: array<vec2<f32>, 676>;
var<workgroup> squares: array<f32, 416>;  // y^2 blurred along the row; `rows` has x, y, x^2 and x y

fn moments(i: u32) -> vec4<f32> {
    let p = pixels[i];
    return vec4<f32>(p.x, p.y, p.x * p.x, p.x * p.y);
}

fn square(i: u32) -> vec4<f32> {
    return vec4<f32>(pixels[i].y * pixels[i].y, 0.0, 0.0, 0.0);
}

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let tile = min(group_number(group, groups), loss.n_groups - 1u);
    let corner = corner_of(tile);
    let own = corner + vec2<i32>(vec2<u32>(lane & 15u, lane >> 4u));
    let inside = is_inside(own);
    let factors = brightness();
    var total = vec2<f32>(0.0);
    for (var c = 0u; c < 3u; c++) {
        for (var i = lane; i < SIDE * SIDE; i += 256u) {
            pixels[i] = values_at(with_margin(corner, i), c, factors[c]);
        }
        workgroupBarrier();
        for (var i = lane; i < SIDE * 16u; i += 256u) {
            let m = (i >> 4u) * SIDE + (i & 15u) + 5u;
            rows[i] = blur(moments(m - 5u) + moments(m + 5u), moments(m - 4u) + moments(m + 4u),
                           moments(m - 3u) + moments(m + 3u), moments(m - 2u) + moments(m + 2u),
                           moments(m - 1u) + moments(m + 1u), moments(m));
            squares[i] = blur(square(m - 5u) + square(m + 5u), square(m - 4u) + square(m + 4u),
                              square(m - 3u) + square(m + 3u), square(m - 2u) + square(m + 2u),
                              square(m - 1u) + square(m + 1u), square(m)).x;
        }
        workgroupBarrier();
        if (inside) {
            let m = lane + 80u;
            let blurred = blur_column(m);
            let y_squared = blur(vec4<f32>(squares[m - 80u] + squares[m + 80u]),
                                 vec4<f32>(squares[m - 64u] + squares[m + 64u]),
                                 vec4<f32>(squares[m - 48u] + squares[m + 48u]),
                                 vec4<f32>(squares[m - 32u] + squares[m + 32u]),
                                 vec4<f32>(squares[m - 16u] + squares[m + 16u]), vec4<f32>(squares[m])).x;
            let a = blurred.x;
            let b = blurred.y;
            let s_xx = blurred.z - a * a;
            let s_xy = blurred.w - a * b;
            let s_yy = y_squared - b * b;
            let numerator_1 = a * b * 2.0 + SSIM_C1;
            let numerator_2 = s_xy * 2.0 + SSIM_C2;
            let inverse_1 = 1.0 / (fma(a, a, b * b) + SSIM_C1);
            let inverse_2 = 1.0 / (s_xx + s_yy + SSIM_C2);
            let inverse = inverse_1 * inverse_2;
            let similarity = numerator_1 * numerator_2 * inverse;
            let q = -similarity * inverse_2;
            let r = numerator_1 * inverse * 2.0;
            let p = (b * numerator_2 * inverse - a * similarity * inverse_1 - a * q) * 2.0 - b * r;
            let at = index_of(own);
            let weight = select(0.0, loss.weight, photo[at] >> 24u != 0u);
            let plane = loss.width * loss.height;
            maps[3u * c * plane + at] = p * weight;
            maps[(3u * c + 1u) * plane + at] = q * weight;
            maps[(3u * c + 2u) * plane + at] = r * weight;
            let values = pixels[((lane >> 4u) + 5u) * SIDE + (lane & 15u) + 5u];
            total += vec2<f32>(similarity, abs(values.x - values.y)) * weight;
        }
        workgroupBarrier();
    }
    total = tree_sum(lane, total);
    if (lane == 0u) {
        partial_sums[tile] = total;
    }
}
