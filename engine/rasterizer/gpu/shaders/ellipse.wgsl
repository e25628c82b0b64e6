// The projection of one Gaussian in `real`, for the forward and the backward pass; formulas as in projection.py.
struct Axes {
    point: vec3<real>,      // centre in camera space
    tangent: vec2<real>,    // x/z and y/z where the projection is linearised
    q0: vec3<real>,         // rows of Q = J W
    q1: vec3<real>,
    r: mat3x3<real>,        // columns of the rotation of the Gaussian
    quat: vec4<real>,       // unit quaternion wxyz
    norm: real,
    m0: vec3<real>,         // rows of M = Q R S
    m1: vec3<real>,
    xx: real,               // screen covariance with the low pass
    xy: real,
    yy: real,
    cross: vec3<real>,      // rows of M, crossed: its squared length is the determinant of M M^T
    det: real,
}

fn camera_point(view: View, mean: vec3<real>) -> vec3<real> {
    return vec3<real>(
        view_value(view, 0u) * mean.x + view_value(view, 1u) * mean.y + view_value(view, 2u) * mean.z + view_value(view, 9u),
        view_value(view, 3u) * mean.x + view_value(view, 4u) * mean.y + view_value(view, 5u) * mean.z + view_value(view, 10u),
        view_value(view, 6u) * mean.x + view_value(view, 7u) * mean.y + view_value(view, 8u) * mean.z + view_value(view, 11u));
}

fn view_row(view: View, row: u32) -> vec3<real> {
    return vec3<real>(view_value(view, 3u * row), view_value(view, 3u * row + 1u), view_value(view, 3u * row + 2u));
}

fn project_axes(view: View, point: vec3<real>, quat: vec4<real>, scale: vec3<real>) -> Axes {
    var e: Axes;
    e.point = point;
    e.norm = sqrt(quat.x * quat.x + quat.y * quat.y + quat.z * quat.z + quat.w * quat.w);
    e.quat = quat / e.norm;
    let w = e.quat.x; let x = e.quat.y; let y = e.quat.z; let z = e.quat.w;
    let one = real(1.0); let two = real(2.0);
    e.r = mat3x3<real>(
        vec3<real>(one - two * (y * y + z * z), two * (x * y + w * z), two * (x * z - w * y)),
        vec3<real>(two * (x * y - w * z), one - two * (x * x + z * z), two * (y * z + w * x)),
        vec3<real>(two * (x * z + w * y), two * (y * z - w * x), one - two * (x * x + y * y)));
    e.tangent = vec2<real>(
        min(max(point.x / point.z, view_value(view, 16u)), view_value(view, 17u)),
        min(max(point.y / point.z, view_value(view, 18u)), view_value(view, 19u)));
    let back = view_row(view, 2u);
    e.q0 = (view_row(view, 0u) - back * e.tangent.x) * (view_value(view, 12u) / point.z);
    e.q1 = (view_row(view, 1u) - back * e.tangent.y) * (view_value(view, 13u) / point.z);
    e.m0 = vec3<real>(dot3(e.q0, e.r[0]) * scale.x, dot3(e.q0, e.r[1]) * scale.y, dot3(e.q0, e.r[2]) * scale.z);
    e.m1 = vec3<real>(dot3(e.q1, e.r[0]) * scale.x, dot3(e.q1, e.r[1]) * scale.y, dot3(e.q1, e.r[2]) * scale.z);
    let low_pass = view_value(view, 21u);
    let xx = dot3(e.m0, e.m0);
    let yy = dot3(e.m1, e.m1);
    e.xy = dot3(e.m0, e.m1);
    e.cross = vec3<real>(
        e.m0.y * e.m1.z - e.m0.z * e.m1.y, e.m0.z * e.m1.x - e.m0.x * e.m1.z, e.m0.x * e.m1.y - e.m0.y * e.m1.x);
    e.det = dot3(e.cross, e.cross) + low_pass * (xx + yy + low_pass);
    e.xx = xx + low_pass;
    e.yy = yy + low_pass;
    return e;
}

fn dot3(a: vec3<real>, b: vec3<real>) -> real {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}
