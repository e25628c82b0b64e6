// Blending of one Gaussian at one pixel (blend_forward.py), for all passes. Sums of products are explicit fma, so that
// the passes decide every threshold alike. A finished pixel has a negative transmittance.
struct Cover {
    weight: f32,
    next: f32,
}

// (u, v) at pixel `x`, `y`, relative to the pixel of the image nearest to the centre.
fn whitened(first: vec4<f32>, second: vec4<f32>, x: f32, y: f32) -> vec2<f32> {
    let anchor = bitcast<u32>(second.z);
    let dx = x - f32(anchor & 0xffffu);
    let dy = y - f32(anchor >> 16u);
    return vec2<f32>(fma(first.z, dx, fma(first.w, dy, first.x)), fma(second.x, dy, first.y));
}

// Alpha before its clamp.
fn raw_alpha(w: vec2<f32>, opacity: f32) -> f32 {
    return exp2(-fma(w.x, w.x, w.y * w.y)) * opacity;
}

// Alpha that is blended, 0 for none.
fn blended_alpha(raw: f32) -> f32 {
    let alpha = min(raw, ALPHA_MAX);
    return select(alpha, 0.0, alpha < ALPHA_MIN);
}

fn cover(w: vec2<f32>, opacity: f32, now: f32) -> Cover {
    var c: Cover;
    let alpha = blended_alpha(raw_alpha(w, opacity));
    c.next = fma(-alpha, now, now);
    let stop = c.next < T_MIN;
    c.weight = select(alpha * now, 0.0, stop);
    if (stop) {
        c.next = -abs(now);
    }
    return c;
}

// Whether the ellipse touches the block of 8x4 pixels at (x, y); the nearest point is on a side that faces the centre.
fn touches(first: vec4<f32>, second: vec4<f32>, x: f32, y: f32) -> bool {
    let limit = max(log2(INVERSE_ALPHA_MIN * second.y), 0.0) + 0.01;
    let anchor = bitcast<u32>(second.z);
    let left = x - f32(anchor & 0xffffu);
    let top = y - f32(anchor >> 16u);
    let a = first.z; let b = first.w; let c = second.x; let u0 = first.x; let v0 = first.y;
    // The centre is where u = v = 0.
    let center_y = -v0 / c;
    let center_x = -fma(b, center_y, u0) / a;
    let right = left + 7.0;
    let bottom = top + 3.0;
    let side_x = clamp(center_x, left, right);
    let side_y = clamp(center_y, top, bottom);
    let free_y = clamp(-(b * fma(a, side_x, u0) + c * v0) / fma(b, b, c * c), top, bottom);
    let on_column = vec2<f32>(fma(a, side_x, fma(b, free_y, u0)), fma(c, free_y, v0));
    let free_x = clamp(-fma(b, side_y, u0) / a, left, right);
    let on_row = vec2<f32>(fma(a, free_x, fma(b, side_y, u0)), fma(c, side_y, v0));
    return min(dot(on_column, on_column), dot(on_row, on_row)) <= limit * 1.0001;
}
