// Real spherical harmonics up to band 3 in float32, with the constants and signs of spherical_harmonics.py.
fn sh_basis(d: vec3<f32>, k: u32) -> f32 {
    let x = d.x; let y = d.y; let z = d.z;
    let xx = x * x; let yy = y * y; let zz = z * z;
    switch k {
        case 0u: { return SH0; }
        case 1u: { return -SH1 * y; }
        case 2u: { return SH1 * z; }
        case 3u: { return -SH1 * x; }
        case 4u: { return SH2 * x * y; }
        case 5u: { return -SH2 * y * z; }
        case 6u: { return SH20 * (2.0 * zz - xx - yy); }
        case 7u: { return -SH2 * x * z; }
        case 8u: { return 0.5 * SH2 * (xx - yy); }
        case 9u: { return -SH33 * y * (3.0 * xx - yy); }
        case 10u: { return SH32 * x * y * z; }
        case 11u: { return -SH31 * y * (4.0 * zz - xx - yy); }
        case 12u: { return SH30 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy); }
        case 13u: { return -SH31 * x * (4.0 * zz - xx - yy); }
        case 14u: { return 0.5 * SH32 * z * (xx - yy); }
        default: { return -SH33 * x * (xx - 3.0 * yy); }
    }
}

// Gradient of Y_k without the constraint of unit length.
fn sh_basis_gradient(d: vec3<f32>, k: u32) -> vec3<f32> {
    let x = d.x; let y = d.y; let z = d.z;
    let xx = x * x; let yy = y * y; let zz = z * z;
    switch k {
        case 0u: { return vec3<f32>(0.0); }
        case 1u: { return vec3<f32>(0.0, -SH1, 0.0); }
        case 2u: { return vec3<f32>(0.0, 0.0, SH1); }
        case 3u: { return vec3<f32>(-SH1, 0.0, 0.0); }
        case 4u: { return SH2 * vec3<f32>(y, x, 0.0); }
        case 5u: { return -SH2 * vec3<f32>(0.0, z, y); }
        case 6u: { return SH20 * vec3<f32>(-2.0 * x, -2.0 * y, 4.0 * z); }
        case 7u: { return -SH2 * vec3<f32>(z, 0.0, x); }
        case 8u: { return SH2 * vec3<f32>(x, -y, 0.0); }
        case 9u: { return -SH33 * vec3<f32>(6.0 * x * y, 3.0 * (xx - yy), 0.0); }
        case 10u: { return SH32 * vec3<f32>(y * z, x * z, x * y); }
        case 11u: { return -SH31 * vec3<f32>(-2.0 * x * y, 4.0 * zz - xx - 3.0 * yy, 8.0 * y * z); }
        case 12u: { return SH30 * vec3<f32>(-6.0 * x * z, -6.0 * y * z, 3.0 * (2.0 * zz - xx - yy)); }
        case 13u: { return -SH31 * vec3<f32>(4.0 * zz - 3.0 * xx - yy, -2.0 * x * y, 8.0 * x * z); }
        case 14u: { return SH32 * vec3<f32>(x * z, -y * z, 0.5 * (xx - yy)); }
        default: { return -SH33 * vec3<f32>(3.0 * (xx - yy), -6.0 * x * y, 0.0); }
    }
}

// Direction from the camera's centre, whose float32 parts are subtracted one after the other, and the inverse distance.
fn viewing_direction(view: View, mean: vec3<f32>) -> vec4<f32> {
    let d = vec3<real>(real(mean.x), real(mean.y), real(mean.z))
        - vec3<real>(view_value(view, 23u), view_value(view, 24u), view_value(view, 25u));
    let inverse = real(1.0) / max(sqrt(dot3(d, d)), real(DIRECTION_NORM_MIN));
    return vec4<f32>(vec3<f32>(d * inverse), f32(inverse));
}

fn dot3(a: vec3<real>, b: vec3<real>) -> real {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}
