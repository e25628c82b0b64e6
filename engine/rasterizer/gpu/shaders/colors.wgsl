//needs sh
// Values to blend: max(0, 0.5 + SH(direction)), then the channels, padded with zeros to rows of CHUNKS vec4.
// `sh` is stored in blocks of 64 Gaussians, [n_sh * 3][64] each; the dispatch covers Gaussians view.first to view.last.
@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> means: array<f32>;
@group(0) @binding(2) var<storage, read> sh: array<f32>;
@group(0) @binding(3) var<storage, read> channels: array<f32>;
@group(0) @binding(4) var<storage, read_write> colors: array<f32>;
@group(0) @binding(5) var<storage, read_write> counts: array<atomic<u32>>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let block = group_number(group, groups);
    let first = view.first + block * 64u;
    let g = first + lane;
    var finite = true;
    if (view.n_rgb > 0u && g < view.last) {
        let d = viewing_direction(view, vec3<f32>(means[3u * g], means[3u * g + 1u], means[3u * g + 2u]));
        var sum = vec3<f32>(0.5);
        let n_basis = (view.sh_degree + 1u) * (view.sh_degree + 1u);
        for (var k = 0u; k < view.n_sh; k++) {
            let at = (block * view.n_sh * 3u + 3u * k) * 64u + lane;
            let value = vec3<f32>(sh[at], sh[at + 64u], sh[at + 128u]);
            finite = finite && is_finite(value.x) && is_finite(value.y) && is_finite(value.z);
            if (k < n_basis) {
                sum += sh_basis(d.xyz, k) * value;
            }
        }
        for (var k = 0u; k < 3u; k++) {
            colors[g * CHUNKS * 4u + k] = max(sum[k], 0.0);
        }
    }
    // Neighbouring invocations copy neighbouring values.
    let n = min(64u, view.last - min(first, view.last));
    let n_channels = CHANNELS - view.n_rgb;
    for (var i = lane; i < n * n_channels; i += 64u) {
        let value = channels[first * n_channels + i];
        finite = finite && is_finite(value);
        colors[(first + i / n_channels) * CHUNKS * 4u + view.n_rgb + i % n_channels] = value;
    }
    for (var i = lane; i < n * (CHUNKS * 4u - CHANNELS); i += 64u) {
        colors[(first + i / (CHUNKS * 4u - CHANNELS)) * CHUNKS * 4u + CHANNELS + i % (CHUNKS * 4u - CHANNELS)] = 0.0;
    }
    if (!finite) {
        atomicOr(&counts[NOT_FINITE], 1u);
    }
}
