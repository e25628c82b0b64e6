//needs sh
// Gradients of spherical harmonics, and their part of the gradients of means and pose, for Gaussians view.first to
// view.last; runs after project_backward.
@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> means: array<f32>;
@group(0) @binding(2) var<storage, read> sh: array<f32>;
@group(0) @binding(3) var<storage, read> info: array<vec4<u32>>;
@group(0) @binding(4) var<storage, read> colors: array<f32>;
@group(0) @binding(5) var<storage, read> totals: array<f32>;
@group(0) @binding(6) var<storage, read_write> sh_gradient: array<f32>;
@group(0) @binding(7) var<storage, read_write> gradients: array<f32>;
@group(0) @binding(8) var<storage, read_write> pose: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let block = group_number(group, groups);
    let g = view.first + block * 64u + lane;
    if (g >= view.last) {
        return;
    }
    let base = block * view.n_sh * 192u + lane;
    let visible = (info[g].x & 7u) == 0u && info[g].x != 0u;
    let n_basis = select(0u, (view.sh_degree + 1u) * (view.sh_degree + 1u), visible);
    for (var k = 3u * n_basis; k < 3u * view.n_sh; k++) {
        sh_gradient[base + 64u * k] = 0.0;
    }
    if (!visible) {
        return;
    }
    let d = viewing_direction(view, vec3<f32>(means[3u * g], means[3u * g + 1u], means[3u * g + 2u]));
    let at = (g * (CHUNKS + 2u) + 2u) * 4u;
    var by_color = vec3<f32>(totals[at], totals[at + 1u], totals[at + 2u]);
    for (var k = 0u; k < 3u; k++) {
        if (colors[g * CHUNKS * 4u + k] <= 0.0) {
            by_color[k] = 0.0;
        }
    }
    var by_direction = vec3<f32>(0.0);
    for (var k = 0u; k < n_basis; k++) {
        let row = base + 192u * k;
        let basis = sh_basis(d.xyz, k);
        sh_gradient[row] = basis * by_color.x;
        sh_gradient[row + 64u] = basis * by_color.y;
        sh_gradient[row + 128u] = basis * by_color.z;
        by_direction += dot(by_color, vec3<f32>(sh[row], sh[row + 64u], sh[row + 128u])) * sh_basis_gradient(d.xyz, k);
    }
    let by_mean = (by_direction - dot(by_direction, d.xyz) * d.xyz) * d.w;
    for (var k = 0u; k < 3u; k++) {
        gradients[12u * g + k] += by_mean[k];
    }
    if (view.with_pose != 0u) {
        for (var i = 0u; i < 3u; i++) {  // the direction starts at the camera's centre -W^T t
            let t = f32(view_value(view, 9u + i));
            for (var k = 0u; k < 3u; k++) {
                pose[12u * g + 3u * i + k] += t * by_mean[k];
                pose[12u * g + 9u + i] += f32(view_value(view, 3u * i + k)) * by_mean[k];
            }
        }
    }
}
