// A workgroup renders a tile of 16x16 pixels: 8 blocks of 8x4 pixels, 32 invocations each. A batch of 256 Gaussians is
// loaded together; for each block, one bit a Gaussian says whether it touches the block.
var<workgroup> batch_first: array<vec4<f32>, 256>;
var<workgroup> batch_second: array<vec4<f32>, 256>;
var<workgroup> batch_gaussian: array<u32, 256>;
var<workgroup> batch_bits: array<atomic<u32>, 64>;  // [8 blocks][8 words]
var<workgroup> n_alive: atomic<u32>;

fn pixel_of(tile: u32, lane: u32, columns: u32) -> vec2<u32> {
    let block = lane >> 5u;
    return vec2<u32>((tile % columns) * 16u + (block & 1u) * 8u + (lane & 7u),
                     (tile / columns) * 16u + (block >> 1u) * 4u + ((lane >> 3u) & 3u));
}

fn load_batch(tile: u32, columns: u32, lane: u32, at: u32, end: u32) {
    if (lane < 64u) {
        atomicStore(&batch_bits[lane], 0u);
    }
    workgroupBarrier();
    if (at + lane < end) {
        let g = entries[at + lane].x;
        let first = geometry[2u * g];
        let second = geometry[2u * g + 1u];
        batch_first[lane] = first;
        batch_second[lane] = second;
        batch_gaussian[lane] = g;
        let x = f32((tile % columns) * 16u);
        let y = f32((tile / columns) * 16u);
        for (var block = 0u; block < 8u; block++) {
            if (touches(first, second, x + f32((block & 1u) * 8u), y + f32((block >> 1u) * 4u))) {
                atomicOr(&batch_bits[block * 8u + (lane >> 5u)], 1u << (lane & 31u));
            }
        }
    }
    workgroupBarrier();
}
