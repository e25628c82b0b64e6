//needs ellipse
// From the moments of a Gaussian to the gradients of its parameters; formulas as in projection_backward.py.
@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> means: array<f32>;
@group(0) @binding(2) var<storage, read> quats: array<f32>;
@group(0) @binding(3) var<storage, read> scales: array<f32>;
@group(0) @binding(4) var<storage, read> opacities: array<f32>;
@group(0) @binding(5) var<storage, read> info: array<vec4<u32>>;
@group(0) @binding(6) var<storage, read> totals: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> gradients: array<f32>;  // [N][12]: mean, quat, scale, opacity, 0
@group(0) @binding(8) var<storage, read_write> pose: array<f32>;       // [N][12], [1] without pose

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let g = group_number(group, groups) * 64u + lane;
    if (g >= view.n) {
        return;
    }
    let out = 12u * g;
    if ((info[g].x & 7u) != 0u || info[g].x == 0u) {
        for (var k = 0u; k < 12u; k++) {
            gradients[out + k] = 0.0;
        }
        return;
    }
    let t0 = totals[g * (CHUNKS + 2u)];
    let t1 = totals[g * (CHUNKS + 2u) + 1u];
    let scale = vec3<real>(real(scales[3u * g]), real(scales[3u * g + 1u]), real(scales[3u * g + 2u]));
    let mean = vec3<real>(real(means[3u * g]), real(means[3u * g + 1u]), real(means[3u * g + 2u]));
    let e = project_axes(view, camera_point(view, mean), vec4<real>(
        real(quats[4u * g]), real(quats[4u * g + 1u]), real(quats[4u * g + 2u]), real(quats[4u * g + 3u])), scale);
    let low_pass = view_value(view, 21u);
    let a = sqrt(e.yy / e.det);
    let b = -a * e.xy / e.yy;
    let c = real(1.0) / sqrt(e.yy);
    let unit = real(1.0) / real(ROOT_SCALE);
    let s_u = real(t0.y) * unit;
    let s_v = real(t0.z) * unit;
    let s_uu = real(t0.w) * unit * unit;
    let s_uv = real(t1.x) * unit * unit;
    let s_vv = real(t1.y) * unit * unit;
    let d_px = a * s_u;
    let d_py = b * s_u + c * s_v;
    // dL/dM = L^T S (L M); the first row of L M without cancellation.
    let lean = a / e.yy;
    let lm0 = vec3<real>(
        lean * (low_pass * e.m0.x + e.m1.y * e.cross.z - e.m1.z * e.cross.y),
        lean * (low_pass * e.m0.y + e.m1.z * e.cross.x - e.m1.x * e.cross.z),
        lean * (low_pass * e.m0.z + e.m1.x * e.cross.y - e.m1.y * e.cross.x));
    let lm1 = e.m1 * c;
    let d_u = lm0 * s_uu + lm1 * s_uv;
    let d_v = lm0 * s_uv + lm1 * s_vv;
    let d_m0 = d_u * a;
    let d_m1 = d_u * b + d_v * c;
    // Columns of dL/d(R S), then scales and rotation.
    let d0 = e.q0 * d_m0.x + e.q1 * d_m1.x;
    let d1 = e.q0 * d_m0.y + e.q1 * d_m1.y;
    let d2 = e.q0 * d_m0.z + e.q1 * d_m1.z;
    let d_scale = vec3<real>(dot3(d0, e.r[0]), dot3(d1, e.r[1]), dot3(d2, e.r[2]));
    let c0 = d0 * scale.x;
    let c1 = d1 * scale.y;
    let c2 = d2 * scale.z;
    let w = e.quat.x; let x = e.quat.y; let y = e.quat.z; let z = e.quat.w;
    let two = real(2.0);
    var gq = vec4<real>(
        two * (x * (c1.z - c2.y) + y * (c2.x - c0.z) + z * (c0.y - c1.x)),
        two * (-two * x * (c1.y + c2.z) + y * (c1.x + c0.y) + z * (c2.x + c0.z) + w * (c1.z - c2.y)),
        two * (x * (c1.x + c0.y) - two * y * (c0.x + c2.z) + z * (c2.y + c1.z) + w * (c2.x - c0.z)),
        two * (x * (c2.x + c0.z) + y * (c2.y + c1.z) - two * z * (c0.x + c1.y) + w * (c0.y - c1.x)));
    let along = gq.x * w + gq.y * x + gq.z * y + gq.w * z;
    gq = (gq - e.quat * along) / e.norm;
    // Q = J W.
    let d_q0 = e.r[0] * (d_m0.x * scale.x) + e.r[1] * (d_m0.y * scale.y) + e.r[2] * (d_m0.z * scale.z);
    let d_q1 = e.r[0] * (d_m1.x * scale.x) + e.r[1] * (d_m1.y * scale.y) + e.r[2] * (d_m1.z * scale.z);
    let j00 = dot3(d_q0, view_row(view, 0u));
    let j02 = dot3(d_q0, view_row(view, 2u));
    let j11 = dot3(d_q1, view_row(view, 1u));
    let j12 = dot3(d_q1, view_row(view, 2u));
    let p = e.point;
    let fx_z = view_value(view, 12u) / p.z;
    let fy_z = view_value(view, 13u) / p.z;
    var d = vec3<real>(d_px * fx_z, d_py * fy_z, real(0.0));
    d.z = -(d.x * p.x + d.y * p.y) / p.z
        - (fx_z * (j00 - e.tangent.x * j02) + fy_z * (j11 - e.tangent.y * j12)) / p.z;
    let tan_x = p.x / p.z;
    let tan_y = p.y / p.z;
    if (tan_x >= view_value(view, 16u) && tan_x <= view_value(view, 17u)) {
        d.x -= fx_z * j02 / p.z;
        d.z += fx_z * j02 * p.x / (p.z * p.z);
    }
    if (tan_y >= view_value(view, 18u) && tan_y <= view_value(view, 19u)) {
        d.y -= fy_z * j12 / p.z;
        d.z += fy_z * j12 * p.y / (p.z * p.z);
    }
    if (view.with_pose != 0u) {
        let r0 = mean * d.x + d_q0 * fx_z;
        let r1 = mean * d.y + d_q1 * fy_z;
        let r2 = mean * d.z - d_q0 * (e.tangent.x * fx_z) - d_q1 * (e.tangent.y * fy_z);
        for (var k = 0u; k < 3u; k++) {
            pose[out + k] = f32(r0[k]);
            pose[out + 3u + k] = f32(r1[k]);
            pose[out + 6u + k] = f32(r2[k]);
            pose[out + 9u + k] = f32(d[k]);
        }
    }
    let d_mean = view_row(view, 0u) * d.x + view_row(view, 1u) * d.y + view_row(view, 2u) * d.z;
    for (var k = 0u; k < 3u; k++) {
        gradients[out + k] = f32(d_mean[k]);
        gradients[out + 7u + k] = f32(d_scale[k]);
    }
    for (var k = 0u; k < 4u; k++) {
        gradients[out + 3u + k] = f32(gq[k]);
    }
    gradients[out + 10u] = t0.x / opacities[g];
    gradients[out + 11u] = 0.0;
}
