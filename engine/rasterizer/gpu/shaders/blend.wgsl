//needs cover tile
@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> geometry: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> entries: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read> tile_ranges: array<vec2<u32>>;
@group(0) @binding(4) var<storage, read> colors: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> image: array<f32>;
@group(0) @binding(6) var<storage, read_write> transmittance: array<u32>;  // [H W] T; [H W] end of what is blended; [batches of 32][256] T in front

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let tile = min(view.first + group_number(group, groups), view.n_tiles - 1u);  // a dispatch may be a part of the tiles
    let pixel = pixel_of(tile, lane, view.columns);
    let x = f32(pixel.x);
    let y = f32(pixel.y);
    let inside = pixel.x < view.width && pixel.y < view.height;
    let range = tile_ranges[tile];
    let word_base = (lane >> 5u) * 8u;
    let n_pixels = view.width * view.height;
    let keeps = arrayLength(&transmittance) > 2u * n_pixels;
    let first_batch = range.x / 32u + tile;
    var now = select(-1.0, 1.0, inside);
    var end = 0u;
    var sum_Q = vec4<f32>(0.0);  // each Q
    for (var at = range.x; at < range.y; at += 256u) {
        if (lane == 0u) {
            atomicStore(&n_alive, 0u);
        }
        workgroupBarrier();
        if (now > 0.0) {
            atomicOr(&n_alive, 1u);
        }
        workgroupBarrier();
        let alive = atomicLoad(&n_alive);
        if (alive == 0u) {
            break;
        }
        load_batch(tile, view.columns, lane, at, range.y);
        for (var word = 0u; word < 8u && at + word * 32u < range.y; word++) {
            if (keeps) {
                let batch = first_batch + (at - range.x) / 32u + word;
                transmittance[2u * n_pixels + batch * 256u + lane] = bitcast<u32>(now);
            }
            var bits = atomicLoad(&batch_bits[word_base + word]);
            while (bits != 0u && now > 0.0) {
                let j = word * 32u + countTrailingZeros(bits);
                bits &= bits - 1u;
                let second = batch_second[j];
                let c = cover(whitened(batch_first[j], second, x, y), second.y, now);
                now = c.next;
                if (c.weight > 0.0) {
                    end = at + j + 1u;
                    let row = batch_gaussian[j] * CHUNKS;
                    sum_Q = fma(vec4<f32>(c.weight), colors[row + Q_], sum_Q);  // each Q
                }
            }
        }
        workgroupBarrier();
    }
    if (inside) {
        let p = pixel.y * view.width + pixel.x;
        transmittance[p] = bitcast<u32>(abs(now));
        transmittance[n_pixels + p] = end;
        image[p * CHANNELS + C_] = sum_QC;  // each C
    }
}
