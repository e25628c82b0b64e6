// Camera, settings and sizes of one image, shared by all kernels. Entries of `high` and `low` sum to the float64 values
// of `frame.pack_view`: 0-8 rotation, 9-11 translation, 12 fx, 13 fy, 14 cx, 15 cy, 16-19 bounds of the linearisation,
// 20 near, 21 low pass, 22 antialiased, 23-25 centre of the camera.
struct View {
    high: array<vec4<f32>, 7>,
    low: array<vec4<f32>, 7>,
    n: u32,
    width: u32,
    height: u32,
    columns: u32,
    n_tiles: u32,
    sh_degree: u32,
    n_sh: u32,
    n_rgb: u32,
    first: u32,
    capacity: u32,
    with_pose: u32,
    last: u32,
}

fn view_value(view: View, i: u32) -> real {
    return real(view.high[i >> 2u][i & 3u]) + real(view.low[i >> 2u][i & 3u]);
}

fn is_finite(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7f800000u) != 0x7f800000u;
}

// Number of a workgroup in a dispatch of two dimensions.
fn group_number(id: vec3<u32>, count: vec3<u32>) -> u32 {
    return id.x + id.y * count.x;
}
