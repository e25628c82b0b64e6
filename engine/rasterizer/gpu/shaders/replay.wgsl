// First part of the backward pass of blending. With g = dL/dC of a pixel and e_i = w_i (color_i . g), it writes for each
// bucket of 32 Gaussians of a tile and each pixel the transmittance in front of it, and R behind it:
// R = dL/dT_final T_final + sum of e over all later buckets. Summed from the back, R keeps its digits behind Gaussians
// that are nearly opaque. Channels whose bit in MOVES is 0 do not move Gaussians.
@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> geometry: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> gaussians: array<u32>;
@group(0) @binding(3) var<storage, read> tile_ranges: array<vec2<u32>>;
@group(0) @binding(4) var<storage, read> colors: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> gradient: array<f32>;  // [H W][CHANNELS + 1], the last is dL/dT_final
@group(0) @binding(6) var<storage, read_write> checkpoints: array<vec2<f32>>;  // [buckets][256]: T, R
@group(0) @binding(7) var<storage, read_write> buckets: array<vec4<u32>>;      // tile + 1, first pair, end
@group(0) @binding(8) var<storage, read_write> counts: array<atomic<u32>>;

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let tile = min(group_number(group, groups), view.n_tiles - 1u);
    let pixel = pixel_of(tile, lane, view.columns);
    let x = f32(pixel.x);
    let y = f32(pixel.y);
    let inside = pixel.x < view.width && pixel.y < view.height;
    let range = tile_ranges[tile];
    let word_base = (lane >> 5u) * 8u;
    let bucket_base = range.x / 32u + tile;
    let n_buckets = (range.y - range.x + 31u) / 32u;
    var by_transmittance = 0.0;
    var g_Q = vec4<f32>(0.0);  // each Q
    if (inside) {
        let p = (pixel.y * view.width + pixel.x) * (CHANNELS + 1u);
        g_QC = gradient[p + C_];  // each C
        by_transmittance = gradient[p + CHANNELS];
        var finite = is_finite(by_transmittance);
        finite = finite && is_finite(g_QC);  // each C
        if (!finite) {
            atomicOr(&counts[NOT_FINITE], 2u);
        }
        g_Q = g_Q * MOVES_Q;  // each Q
    }
    var now = select(-1.0, 1.0, inside);
    for (var at = range.x; at < range.y; at += 256u) {
        load_batch(tile, view.columns, lane, at, range.y);
        for (var word = 0u; word < 8u; word++) {
            if (at + word * 32u >= range.y) {
                break;
            }
            let bucket = bucket_base + (at - range.x) / 32u + word;
            if (lane == 0u) {
                let first = at + word * 32u;
                buckets[bucket] = vec4<u32>(tile + 1u, first, min(first + 32u, range.y), 0u);
            }
            let before = now;
            var total = 0.0;
            var bits = atomicLoad(&batch_bits[word_base + word]);
            while (bits != 0u && now > 0.0) {
                let j = word * 32u + countTrailingZeros(bits);
                bits &= bits - 1u;
                let second = batch_second[j];
                let c = cover(whitened(batch_first[j], second, x, y), second.y, now);
                now = c.next;
                if (c.weight > 0.0) {
                    let row = batch_gaussian[j] * CHUNKS;
                    var d = 0.0;
                    d += dot(g_Q, colors[row + Q_]);  // each Q
                    total = fma(c.weight, d, total);
                }
            }
            checkpoints[bucket * 256u + lane] = vec2<f32>(before, total);
        }
        workgroupBarrier();
    }
    var rest = by_transmittance * abs(now);
    for (var k = n_buckets; k > 0u; k--) {
        let at = (bucket_base + k - 1u) * 256u + lane;
        let own = checkpoints[at];
        checkpoints[at] = vec2<f32>(own.x, rest);
        rest += own.y;
    }
}
