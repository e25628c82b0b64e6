// What the kernels of the loss share (photometric_kernels.py): the 11 taps of the window, from its end to its middle, and pixels
// of image and photo, which are black outside of the image and where the photo is not valid.
const SIDE: u32 = 26u;  // a tile of 16x16 pixels and 5 on each side

fn blur(a: vec4<f32>, b: vec4<f32>, c: vec4<f32>, d: vec4<f32>, e: vec4<f32>, middle: vec4<f32>) -> vec4<f32> {
    var total = middle * WINDOW_5;
    total = fma(e, vec4<f32>(WINDOW_4), total);
    total = fma(d, vec4<f32>(WINDOW_3), total);
    total = fma(c, vec4<f32>(WINDOW_2), total);
    total = fma(b, vec4<f32>(WINDOW_1), total);
    return fma(a, vec4<f32>(WINDOW_0), total);
}

// The same for a column of values that are blurred along their rows, 16 to a row.
var<workgroup> rows: array<vec4<f32>, 416>;

fn blur_column(m: u32) -> vec4<f32> {
    return blur(rows[m - 80u] + rows[m + 80u], rows[m - 64u] + rows[m + 64u], rows[m - 48u] + rows[m + 48u],
                rows[m - 32u] + rows[m + 32u], rows[m - 16u] + rows[m + 16u], rows[m]);
}

// Corner of a tile, and of pixel `i` of the tile with its margin.
fn corner_of(tile: u32) -> vec2<i32> {
    let columns = (loss.width + 15u) / 16u;
    return vec2<i32>(vec2<u32>((tile % columns) * 16u, (tile / columns) * 16u));
}

fn with_margin(corner: vec2<i32>, i: u32) -> vec2<i32> {
    return corner + vec2<i32>(vec2<u32>(i % SIDE, i / SIDE)) - 5;
}

fn is_inside(p: vec2<i32>) -> bool {
    return p.x >= 0 && p.y >= 0 && p.x < i32(loss.width) && p.y < i32(loss.height);
}

fn index_of(p: vec2<i32>) -> u32 {
    return u32(p.y) * loss.width + u32(p.x);
}

// Factors of the image's colours.
fn brightness() -> vec3<f32> {
    let at = 3u * loss.view;
    return exp(vec3<f32>(exposure[at], exposure[at + 1u], exposure[at + 2u]));
}

// Image times `factor`, and photo, at pixel `p`, channel `c`.
fn values_at(p: vec2<i32>, c: u32, factor: f32) -> vec2<f32> {
    if (!is_inside(p)) {
        return vec2<f32>(0.0);
    }
    let word = photo[index_of(p)];
    if (word >> 24u == 0u) {
        return vec2<f32>(0.0);
    }
    return vec2<f32>(image[index_of(p) * CHANNELS + c] * factor, f32((word >> (8u * c)) & 0xffu) * BYTE);
}
