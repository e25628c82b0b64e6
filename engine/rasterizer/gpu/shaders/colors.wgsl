// Values to blend: max(0, 0.5 + SH(direction)), then the channels, padded with zeros to rows of CHUNKS vec4.
// `sh` is stored in blocks of 64 Gaussians, [n_sh * 3][64] each; the dispatch covers Gaussians view.first to view.last.
@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> means: array<f32>;
@group(0) @binding(2) var<storage, read> sh: array<f32>;
@group(0) @binding(3) var<storage, read> channels: array<f32>;
@group(0) @binding(4) var<storage, read> info: array<vec4<u32>>;
@group(0) @binding(5) var<storage, read_write> colors: array<f32>;
@group(0) @binding(6) var<storage, read_write> counts: array<atomic<u32>>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let block = group_number(group, groups);
    let g = view.first + block * 64u + lane;
    if (g >= view.last) {
        return;
    }
    var finite = true;
    let row = g * CHUNKS * 4u;
    if (view.n_rgb > 0u) {
        for (var k = 0u; k < 3u * view.n_sh; k++) {
            finite = finite && is_finite(sh[(block * view.n_sh * 3u + k) * 64u + lane]);
        }
    }
    let n_channels = CHANNELS - view.n_rgb;
    for (var k = 0u; k < n_channels; k++) {
        finite = finite && is_finite(channels[g * n_channels + k]);
    }
    if (!finite) {
        atomicOr(&counts[NOT_FINITE], 1u);
        return;
    }
    if ((info[g].x & 7u) != 0u) {
        return;
    }
    if (view.n_rgb > 0u) {
        let d = viewing_direction(view, vec3<f32>(means[3u * g], means[3u * g + 1u], means[3u * g + 2u]));
        var sum = vec3<f32>(0.5);
        let n_basis = (view.sh_degree + 1u) * (view.sh_degree + 1u);
        for (var k = 0u; k < n_basis; k++) {
            let at = (block * view.n_sh * 3u + 3u * k) * 64u + lane;
            sum += sh_basis(d.xyz, k) * vec3<f32>(sh[at], sh[at + 64u], sh[at + 128u]);
        }
        for (var k = 0u; k < 3u; k++) {
            colors[row + k] = max(sum[k], 0.0);
        }
    }
    for (var k = view.n_rgb; k < CHUNKS * 4u; k++) {
        var value = 0.0;
        if (k < CHANNELS) {
            value = channels[g * n_channels + k - view.n_rgb];
        }
        colors[row + k] = value;
    }
}
