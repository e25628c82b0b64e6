//needs ellipse tiles
// Projection of every Gaussian to an ellipse on the screen (projection.py), one invocation each.
@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> means: array<f32>;
@group(0) @binding(2) var<storage, read> quats: array<f32>;
@group(0) @binding(3) var<storage, read> scales: array<f32>;
@group(0) @binding(4) var<storage, read> opacities: array<f32>;
@group(0) @binding(5) var<storage, read_write> geometry: array<vec4<f32>>;  // 2 rows: u, v, a, b; c, opacity, anchor, 0
@group(0) @binding(6) var<storage, read_write> depth_keys: array<u32>;
@group(0) @binding(7) var<storage, read_write> info: array<vec4<u32>>;      // state + 8 tiles, radius, centre x, y
@group(0) @binding(8) var<storage, read_write> counts: array<atomic<u32>>;

fn cull(g: u32, state: u32) {
    depth_keys[g] = 0xffffffffu;
    info[g] = vec4<u32>(state, 0u, 0u, 0u);
}

@compute @workgroup_size(128)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let g = group_number(group, groups) * 128u + lane;
    if (g >= view.n) {
        return;
    }
    let mean = vec3<f32>(means[3u * g], means[3u * g + 1u], means[3u * g + 2u]);
    let quat = vec4<f32>(quats[4u * g], quats[4u * g + 1u], quats[4u * g + 2u], quats[4u * g + 3u]);
    let scale = vec3<f32>(scales[3u * g], scales[3u * g + 1u], scales[3u * g + 2u]);
    let raw_opacity = opacities[g];
    var finite = is_finite(raw_opacity);
    for (var k = 0u; k < 3u; k++) {
        finite = finite && is_finite(mean[k]) && is_finite(scale[k]);
    }
    for (var k = 0u; k < 4u; k++) {
        finite = finite && is_finite(quat[k]);
    }
    if (!finite) {
        atomicOr(&counts[NOT_FINITE], 1u);
        cull(g, CULLED_NEAR);
        return;
    }
    let point = camera_point(view, vec3<real>(real(mean.x), real(mean.y), real(mean.z)));
    if (!(point.z > view_value(view, 20u))) {
        cull(g, CULLED_NEAR);
        return;
    }
    let q = vec4<real>(real(quat.x), real(quat.y), real(quat.z), real(quat.w));
    let norm2 = q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w;
    if (norm2 < real(QUAT_NORM2_MIN)) {
        cull(g, CULLED_DEGENERATE);
        return;
    }
    let e = project_axes(view, point, q, vec3<real>(real(scale.x), real(scale.y), real(scale.z)));
    if (!(e.det >= real(DET_MIN) && max(e.xx, e.yy) <= real(COV_MAX))) {
        cull(g, CULLED_DEGENERATE);
        return;
    }
    var opacity = real(raw_opacity);
    if (view_value(view, 22u) > real(0.0)) {
        opacity *= sqrt(dot3(e.cross, e.cross) / e.det);
    }
    if (opacity < real(ALPHA_MIN)) {
        cull(g, CULLED_TRANSPARENT);
        return;
    }
    let px = view_value(view, 12u) / point.z * point.x + view_value(view, 14u);
    let py = view_value(view, 13u) / point.z * point.y + view_value(view, 15u);
    let reach = real(2.0 * LN2 * max(log2(INVERSE_ALPHA_MIN * f32(opacity)), 0.0));
    let extent_x = sqrt(reach * e.xx);
    let extent_y = sqrt(reach * e.yy);
    let half = real(0.5);
    if (px + extent_x < half || px - extent_x > real(f32(view.width)) - half
        || py + extent_y < half || py - extent_y > real(f32(view.height)) - half) {
        cull(g, CULLED_OUTSIDE);
        return;
    }
    let a = real(ROOT_SCALE) * sqrt(e.yy / e.det);
    let b = -a * e.xy / e.yy;
    let c = real(ROOT_SCALE) / sqrt(e.yy);
    let center = vec2<f32>(f32(px), f32(py));
    // (u, v) at the pixel of the image nearest to the centre: relative to a distant centre float32 would lose digits.
    let anchor = vec2<u32>(
        u32(clamp(floor(center.x), 0.0, f32(view.width - 1u))), u32(clamp(floor(center.y), 0.0, f32(view.height - 1u))));
    let dx = real(f32(anchor.x)) + half - px;
    let dy = real(f32(anchor.y)) + half - py;
    let root = vec3<f32>(f32(a), f32(b), f32(c));
    geometry[2u * g] = vec4<f32>(f32(a * dx + b * dy), f32(c * dy), root.x, root.y);
    geometry[2u * g + 1u] = vec4<f32>(root.z, f32(opacity), bitcast<f32>(anchor.x | (anchor.y << 16u)), 0.0);
    let spans = tile_rows(view.height, center, root.x, root.y, root.z, f32(opacity));
    var n = 0u;
    for (var row = spans.first; row < spans.end; row++) {
        let span = tile_span(spans, row, view.height, view.columns);
        n += u32(span.y - span.x);
    }
    let spread = half * (e.xx - e.yy);
    let radius = f32(sqrt(half * (e.xx + e.yy) + sqrt(spread * spread + e.xy * e.xy)));
    depth_keys[g] = bitcast<u32>(f32(point.z));
    info[g] = vec4<u32>(n << 3u, bitcast<u32>(RADIUS_SIGMAS * radius), bitcast<u32>(center.x), bitcast<u32>(center.y));
}
