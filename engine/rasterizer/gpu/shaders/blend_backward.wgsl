//needs cover
// Backward pass of blending, a tile a workgroup: 256 invocations, 8 blocks of 8x4 pixels. The list is taken in batches of
// 32 Gaussians from the back. With g = dL/dC of a pixel and e_i = w_i (color_i . g):
//   R_i = dL/dT_final T_final + sum of e behind i,   s_i = alpha_i dL/dalpha_i = e_i - R_i alpha_i / (1 - alpha_i).
// Summed from the back, R keeps its digits behind Gaussians that are nearly opaque. T is multiplied from the front again, from
// what the forward pass kept at each batch, so it has the same bits.
// Each block takes the Gaussians of the batch that touch it in groups of GROUP. First an invocation is a pixel: it writes w
// and s to workgroup memory. Then an invocation is a column: the sums over the pixels of w times g, and of s times 1, x, y,
// x^2, x y, y^2 from the centre of the block (of its pixels in the image), are a matrix product, whose right side each invocation keeps in registers.
// SUBS Gaussians are summed at a time. The sums are then shifted to the Gaussian's centre and added over the blocks, in order.
// Row of a pair: s, s u, s v, s u^2; s u v, s v^2, 0, 0; dL/dcolor. Channels whose bit in MOVES is 0 do not move Gaussians.
@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> geometry: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> entries: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read> tile_ranges: array<vec2<u32>>;
@group(0) @binding(4) var<storage, read> colors: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> gradient: array<f32>;  // [H W][CHANNELS + 1], the last is dL/dT_final
@group(0) @binding(6) var<storage, read> transmittance: array<u32>;  // as in blend.wgsl
@group(0) @binding(7) var<storage, read_write> rows: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read_write> counts: array<atomic<u32>>;

const PITCH: u32 = 9u;  // vec4 of 32 pixels, and one more: rows that are read together start in different banks
var<workgroup> batch_first: array<vec4<f32>, 32>;
var<workgroup> batch_second: array<vec4<f32>, 32>;
var<workgroup> batch_entries: array<vec2<u32>, 64>;  // two batches in turn
var<workgroup> batch_colors: array<vec4<f32>, BATCH_COLORS>;
var<workgroup> touched: array<atomic<u32>, 16>;  // two batches in turn, 8 blocks: bits of Gaussians
var<workgroup> block_ends: array<atomic<u32>, 8>;
var<workgroup> effects: array<vec4<f32>, EFFECTS>;  // [8 blocks][GROUP][w, s][PITCH]
var<workgroup> sums: array<f32, SUMS>;  // [SLOTS][COLUMNS], for each block the Gaussians that touch it, from the back

// Centre of the pixels of the block at `corner` that are in the image, relative to `corner`.
fn block_center(corner: vec2<u32>) -> vec2<f32> {
    let size = vec2<u32>(view.width, view.height);
    return 0.5 * vec2<f32>(min(max(size, corner + 1u) - corner, vec2<u32>(8u, 4u)) - 1u);
}

// Values of column `c` at 4 neighbouring pixels, the first at (x, y) of the block at `corner`.
fn column_values(c: u32, corner: vec2<u32>, x: u32, y: u32) -> vec4<f32> {
    if (c >= CHANNELS) {
        let center = block_center(corner);
        let dy = f32(y) - center.y;
        let dx = vec4<f32>(f32(x) - center.x) + vec4<f32>(0.0, 1.0, 2.0, 3.0);
        switch (c - CHANNELS) {
            case 0u: { return vec4<f32>(1.0); }
            case 1u: { return dx; }
            case 2u: { return vec4<f32>(dy); }
            case 3u: { return dx * dx; }
            case 4u: { return dx * dy; }
            case 5u: { return vec4<f32>(dy * dy); }
            default: { return vec4<f32>(0.0); }
        }
    }
    var values = vec4<f32>(0.0);
    let py = corner.y + y;
    for (var i = 0u; i < 4u; i++) {
        let px = corner.x + x + i;
        if (px < view.width && py < view.height) {
            values[i] = gradient[(py * view.width + px) * (CHANNELS + 1u) + c];
        }
    }
    return values;
}

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let tile = min(view.first + group_number(group, groups), view.n_tiles - 1u);  // as in blend.wgsl
    let range = tile_ranges[tile];
    let tile_corner = vec2<u32>((tile % view.columns) * 16u, (tile / view.columns) * 16u);
    let block = lane >> 5u;
    let member = lane & 31u;
    let corner = tile_corner + vec2<u32>((block & 1u) * 8u, (block >> 1u) * 4u);
    let pixel = corner + vec2<u32>(member & 7u, member >> 3u);
    let x = f32(pixel.x);
    let y = f32(pixel.y);
    // As a pixel.
    let n_pixels = view.width * view.height;
    let first_batch = range.x / 32u + tile;
    var end = 0u;
    var rest = 0.0;
    var g_Q = vec4<f32>(0.0);  // each Q
    if (pixel.x < view.width && pixel.y < view.height) {
        let p = pixel.y * view.width + pixel.x;
        end = transmittance[n_pixels + p];
        g_QC = gradient[p * (CHANNELS + 1u) + C_];  // each C
        let by_transmittance = gradient[p * (CHANNELS + 1u) + CHANNELS];
        rest = by_transmittance * bitcast<f32>(transmittance[p]);
        var finite = is_finite(by_transmittance);
        finite = finite && is_finite(g_QC);  // each C
        if (!finite) {
            atomicOr(&counts[NOT_FINITE], 2u);
        }
        g_Q = g_Q * MOVES_Q;  // each Q
    }
    // As a column: part P is column 32 P + member, or for SUBS > 1 the remainder.
    let sub = min(member / COLUMNS, SUBS - 1u);
    let first_column = member - sub * COLUMNS;
    let kind_P = select(0u, PITCH, first_column + 32u * P_ >= CHANNELS);  // each P
    let c_P_0 = column_values(first_column + 32u * P_, corner, 0u, 0u);  // each P
    let c_P_1 = column_values(first_column + 32u * P_, corner, 4u, 0u);  // each P
    let c_P_2 = column_values(first_column + 32u * P_, corner, 0u, 1u);  // each P
    let c_P_3 = column_values(first_column + 32u * P_, corner, 4u, 1u);  // each P
    let c_P_4 = column_values(first_column + 32u * P_, corner, 0u, 2u);  // each P
    let c_P_5 = column_values(first_column + 32u * P_, corner, 4u, 2u);  // each P
    let c_P_6 = column_values(first_column + 32u * P_, corner, 0u, 3u);  // each P
    let c_P_7 = column_values(first_column + 32u * P_, corner, 4u, 3u);  // each P

    if (lane < 8u) {
        atomicStore(&block_ends[lane], range.x);
    }
    if (lane < 16u) {
        atomicStore(&touched[lane], 0u);
    }
    workgroupBarrier();
    atomicMax(&block_ends[block], end);
    workgroupBarrier();
    var last = range.x;
    for (var k = 0u; k < 8u; k++) {
        last = max(last, atomicLoad(&block_ends[k]));
    }
    let n_batches = (last - range.x + 32u - 1u) / 32u;
    // Rows behind the last Gaussian that any pixel blends.
    for (var i = range.x + n_batches * 32u + lane; i < range.y; i += 256u) {
        let row = entries[i].y * (CHUNKS + 2u);
        for (var q = 0u; q < CHUNKS + 2u; q++) {
            rows[row + q] = vec4<f32>(0.0);
        }
    }
    // As a Gaussian and block of the batch.
    let own_j = lane >> 3u;
    let own_block = lane & 7u;
    let own_corner = tile_corner + vec2<u32>((own_block & 1u) * 8u, (own_block >> 1u) * 4u);
    var next = vec2<u32>(0u);  // read one batch ahead
    if (n_batches > 0u) {
        next = entries[min(range.x + (n_batches - 1u) * 32u + own_j, range.y - 1u)];
    }
    for (var batch = n_batches; batch > 0u; batch--) {
        let at = range.x + (batch - 1u) * 32u;
        let n = min(32u, range.y - at);
        let turn = (batch & 1u) * 8u;
        let entry_turn = (batch & 1u) * 32u;
        if (own_j < n) {
            let first = geometry[2u * next.x];
            let second = geometry[2u * next.x + 1u];
            if (own_block == 0u) {
                batch_first[own_j] = first;
                batch_second[own_j] = second;
                batch_entries[entry_turn + own_j] = next;
                batch_colors[own_j * CHUNKS + Q_] = colors[next.x * CHUNKS + Q_];  // each Q
            }
            if (at + own_j < atomicLoad(&block_ends[own_block])
                && touches(first, second, f32(own_corner.x), f32(own_corner.y))) {
                atomicOr(&touched[turn + own_block], 1u << own_j);
            }
        }
        let start = bitcast<f32>(transmittance[2u * n_pixels + (first_batch + batch - 1u) * 256u + lane]);
        workgroupBarrier();
        if (lane < 8u) {
            atomicStore(&touched[(8u - turn) + lane], 0u);
        }
        if (batch > 1u) {
            next = entries[at - 32u + own_j];
        }
        // As many Gaussians as `sums` has room for, from the back; half as many always touch fewer blocks.
        for (var n_left = n; n_left > 0u;) {
            var n_taken = n_left;
            var taken = 0u;
            var longest = 0u;
            var slot_0 = 0u;
            var own_slot_0 = 0u;
            loop {
                taken = (0xffffffffu >> (32u - n_left)) & ~((1u << (n_left - n_taken)) - 1u);
                longest = 0u;
                var total = 0u;
                for (var k = 0u; k < 8u; k++) {
                    slot_0 = select(slot_0, total, k == block);
                    own_slot_0 = select(own_slot_0, total, k == own_block);
                    let count = countOneBits(atomicLoad(&touched[turn + k]) & taken);
                    longest = max(longest, count);
                    total += count;
                }
                if (total <= SLOTS) {
                    break;
                }
                n_taken = (n_taken + 1u) / 2u;
            }
            n_left -= n_taken;
            var bits = atomicLoad(&touched[turn + block]) & taken;
            let n_touched = countOneBits(bits);
            for (var done = 0u; done < longest; done += GROUP) {
                let count = min(max(n_touched, done) - done, GROUP);
                if (count > 0u) {
                    var own = bits;  // the last `count` of them
                    for (var k = 0u; k < count; k++) {
                        bits ^= 1u << firstLeadingBit(bits);
                    }
                    own ^= bits;
                    var now = start;
                    var before = atomicLoad(&touched[turn + block]) & ((own & (~own + 1u)) - 1u);
                    while (before != 0u) {
                        let j = countTrailingZeros(before);
                        before &= before - 1u;
                        let second = batch_second[j];
                        let raw = raw_alpha(whitened(batch_first[j], second, x, y), second.y);
                        let alpha = select(0.0, blended_alpha(raw), at + j < end);
                        now = fma(-alpha, now, now);
                    }
                    // Unrolled over the group, from the front and then from the back. Behind the last member alpha is 0.
                    var j = 0u;
//for G up
                    let is_own_G = own != 0u;
                    j = select(j, countTrailingZeros(own), is_own_G);
                    let j_G = j;
                    own &= ~(1u << j);
                    let second_G = batch_second[j];
                    let raw_G = raw_alpha(whitened(batch_first[j], second_G, x, y), second_G.y);
                    let alpha_G = select(0.0, blended_alpha(raw_G), is_own_G && at + j < end);
                    let now_G = now;
                    now = fma(-alpha_G, now, now);
//done
                    let to = block * GROUP * 2u * PITCH + (member >> 2u);
//for G down
                    var d_G = 0.0;
                    d_G += dot(g_Q, batch_colors[j_G * CHUNKS + Q_]);  // each Q
                    let w_G = alpha_G * now_G;
                    let e_G = w_G * d_G;
                    effects[to + G_ * 2u * PITCH][member & 3u] = w_G;
                    effects[to + (G_ * 2u + 1u) * PITCH][member & 3u] =
                        select(0.0, fma(-rest, alpha_G / (1.0 - alpha_G), e_G), raw_G <= ALPHA_MAX);
                    rest += e_G;
//done
                }
                workgroupBarrier();
                for (var k = sub; k < count; k += SUBS) {
                    let row = (block * GROUP + k) * 2u * PITCH;
                    let to = (slot_0 + done + count - 1u - k) * COLUMNS + first_column;
                    var sum_P = effects[row + kind_P] * c_P_0;  // each P
                    sum_P = fma(effects[row + kind_P + 1u], c_P_1, sum_P);  // each P
                    sum_P = fma(effects[row + kind_P + 2u], c_P_2, sum_P);  // each P
                    sum_P = fma(effects[row + kind_P + 3u], c_P_3, sum_P);  // each P
                    sum_P = fma(effects[row + kind_P + 4u], c_P_4, sum_P);  // each P
                    sum_P = fma(effects[row + kind_P + 5u], c_P_5, sum_P);  // each P
                    sum_P = fma(effects[row + kind_P + 6u], c_P_6, sum_P);  // each P
                    sum_P = fma(effects[row + kind_P + 7u], c_P_7, sum_P);  // each P
                    if (first_column + 32u * P_ < COLUMNS) { sums[to + 32u * P_] = (sum_P.x + sum_P.y) + (sum_P.z + sum_P.w); }  // each P
                }
                workgroupBarrier();
            }
            // Moments around the centre of a block become those of u and v.
            let own_bits = (atomicLoad(&touched[turn + own_block]) & taken) >> own_j;
            if ((own_bits & 1u) == 1u) {
                let m = (own_slot_0 + countOneBits(own_bits >> 1u)) * COLUMNS + CHANNELS;
                let first = batch_first[own_j];
                let second = batch_second[own_j];
                let origin = vec2<f32>(own_corner) + block_center(own_corner);
                let center = whitened(first, second, origin.x, origin.y);
                let a = first.z;
                let b = first.w;
                let c = second.x;
                let s = sums[m];
                let s_x = sums[m + 1u];
                let s_y = sums[m + 2u];
                let s_xx = sums[m + 3u];
                let s_xy = sums[m + 4u];
                let s_yy = sums[m + 5u];
                let s_v = center.y * s + c * s_y;
                let ax_by = a * s_x + b * s_y;
                let axy_byy = a * s_xy + b * s_yy;
                let axx_bxy = a * s_xx + b * s_xy;
                sums[m + 1u] = center.x * s + ax_by;
                sums[m + 2u] = s_v;
                sums[m + 3u] = center.x * (center.x * s + 2.0 * ax_by) + (a * axx_bxy + b * axy_byy);
                sums[m + 4u] = center.y * (center.x * s + ax_by) + c * (center.x * s_y + axy_byy);
                sums[m + 5u] = center.y * (s_v + c * s_y) + c * c * s_yy;
            }
            workgroupBarrier();
            for (var i = lane; i < n_taken * (CHUNKS + 2u); i += 256u) {
                let j = n_left + i / (CHUNKS + 2u);
                let q = i % (CHUNKS + 2u);
                let column = select(4u * q - 8u, CHANNELS + 4u * q, q < 2u);
                let stop = select(CHANNELS, COLUMNS, q < 2u);
                var total = vec4<f32>(0.0);
                var slot = 0u;
                for (var k = 0u; k < 8u; k++) {
                    let mask = atomicLoad(&touched[turn + k]) & taken;
                    if (((mask >> j) & 1u) == 1u) {
                        let m = (slot + countOneBits((mask >> j) >> 1u)) * COLUMNS;
                        total += vec4<f32>(sums[m + column],
                            select(0.0, sums[m + min(column + 1u, stop - 1u)], column + 1u < stop),
                            select(0.0, sums[m + min(column + 2u, stop - 1u)], column + 2u < stop),
                            select(0.0, sums[m + min(column + 3u, stop - 1u)], column + 3u < stop));
                    }
                    slot += countOneBits(mask);
                }
                rows[batch_entries[entry_turn + j].y * (CHUNKS + 2u) + q] = total;
            }
        }
    }
}
