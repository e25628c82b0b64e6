// Sums of w (color . g) over one part of a tile's list, for each pixel, all parts but the first; see segments.wgsl.
@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> geometry: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> entries: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read> tile_ranges: array<vec2<u32>>;
@group(0) @binding(4) var<storage, read> colors: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> gradient: array<f32>;  // as in blend_backward.wgsl
@group(0) @binding(6) var<storage, read_write> transmittance: array<u32>;  // as in blend.wgsl

var<workgroup> tile_end: atomic<u32>;

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let parts = view.segments - 1u;
    let unit = min(view.first + group_number(group, groups), view.n_tiles * parts - 1u);  // as in blend.wgsl
    let tile = unit / parts;
    let segment = 1u + unit % parts;
    let pixel = pixel_of(tile, lane, view.columns);
    let x = f32(pixel.x);
    let y = f32(pixel.y);
    let range = tile_ranges[tile];
    let word_base = (lane >> 5u) * 8u;
    let n_pixels = view.width * view.height;
    var end = 0u;
    var g_Q = vec4<f32>(0.0);  // each Q
    if (pixel.x < view.width && pixel.y < view.height) {
        let p = pixel.y * view.width + pixel.x;
        end = transmittance[n_pixels + p];
        g_QC = gradient[p * (CHANNELS + 1u) + C_];  // each C
        g_Q = g_Q * MOVES_Q;  // each Q
    }
    if (lane == 0u) {
        atomicStore(&tile_end, range.x);
    }
    workgroupBarrier();
    atomicMax(&tile_end, end);
    workgroupBarrier();
    let last = atomicLoad(&tile_end);
    let batches = segment_batches((last - range.x + 32u - 1u) / 32u, view.segments, segment);
    let stop = min(range.x + batches.y * 32u, range.y);
    var sum = 0.0;
    if (batches.x < batches.y) {
        var now = bitcast<f32>(transmittance[2u * n_pixels + (range.x / 32u + tile + batches.x) * 256u + lane]);
        for (var at = range.x + batches.x * 32u; at < stop; at += 256u) {
            load_batch(tile, view.columns, lane, at, stop);
            for (var word = 0u; word < 8u && at + word * 32u < end; word++) {
                var bits = atomicLoad(&batch_bits[word_base + word]);
                while (bits != 0u) {
                    let j = word * 32u + countTrailingZeros(bits);
                    bits &= bits - 1u;
                    let second = batch_second[j];
                    let raw = raw_alpha(whitened(batch_first[j], second, x, y), second.y);
                    let alpha = select(0.0, blended_alpha(raw), at + j < end);
                    if (alpha > 0.0) {
                        let row = batch_gaussian[j] * CHUNKS;
                        var d = 0.0;
                        d += dot(g_Q, colors[row + Q_]);  // each Q
                        sum = fma(alpha * now, d, sum);
                        now = fma(-alpha, now, now);
                    }
                }
            }
            workgroupBarrier();
        }
    }
    transmittance[segment_sums(n_pixels, view.capacity, view.n_tiles, segment, tile) + lane] = bitcast<u32>(sum);
}
