// Second part of the backward pass of blending: the gradients of 32 pairs of a tile and a Gaussian. For each block of 8x4
// pixels, the Gaussians that touch it are taken in groups of 8, from the back. The invocations are pixels first: they write
// alpha and transmittance of each Gaussian of the group to workgroup memory, then, from the back, w and
// s = alpha dL/dalpha in their place. Then 4 invocations sum over the pixels of one Gaussian, 8 pixels each, and the
// invocation of the Gaussian adds the 4 sums to its registers, in a fixed order. Workgroup memory is kept small: it decides
// how many workgroups run at a time.
// Row of a pair: s, s u, s v, s u^2; s u v, s v^2, 0, 0; dL/dcolor.
@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> geometry: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> gaussians: array<u32>;
@group(0) @binding(3) var<storage, read> pairs: array<u32>;
@group(0) @binding(4) var<storage, read> colors: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> gradient: array<f32>;
@group(0) @binding(6) var<storage, read> checkpoints: array<vec2<f32>>;
@group(0) @binding(7) var<storage, read> buckets: array<vec4<u32>>;
@group(0) @binding(8) var<storage, read_write> rows: array<vec4<f32>>;

const GROUP: u32 = 8u;
const PITCH: u32 = 36u;  // no two invocations in one bank
var<workgroup> ids: array<u32, 32>;
var<workgroup> weights: array<vec4<f32>, 72>;  // [GROUP][PITCH / 4]: transmittance in front, then w, then the sums
var<workgroup> effects: array<f32, 288>;  // alpha before the clamp, then s
var<workgroup> members: array<u32, 8>;
var<workgroup> touched: array<atomic<u32>, 8>;
var<workgroup> lit: array<atomic<u32>, 8>;

@compute @workgroup_size(32)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let bucket = group_number(group, groups);
    if (bucket >= arrayLength(&buckets)) {
        return;
    }
    let header = buckets[bucket];
    if (header.x == 0u) {
        return;
    }
    let tile = header.x - 1u;
    let n = header.z - header.y;
    let corner = vec2<u32>((tile % view.columns) * 16u, (tile / view.columns) * 16u);
    if (lane < 8u) {
        atomicStore(&touched[lane], 0u);
        atomicStore(&lit[lane], 0u);
    }
    workgroupBarrier();
    var mine_first = vec4<f32>(0.0);
    var mine_second = vec4<f32>(0.0);
    if (lane < n) {
        let g = gaussians[header.y + lane];
        mine_first = geometry[2u * g];
        mine_second = geometry[2u * g + 1u];
        ids[lane] = g;
    }
    for (var block = 0u; block < 8u; block++) {
        let x = corner.x + (block & 1u) * 8u;
        let y = corner.y + (block >> 1u) * 4u;
        if (lane < n && touches(mine_first, mine_second, f32(x), f32(y))) {
            atomicOr(&touched[block], 1u << lane);
        }
        if (checkpoints[bucket * 256u + block * 32u + lane].x > 0.0) {
            atomicOr(&lit[block], 1u);
        }
    }
    workgroupBarrier();
    var s_0 = vec4<f32>(0.0);
    var s_1 = vec4<f32>(0.0);
    var dc_Q = vec4<f32>(0.0);  // each Q
    for (var block = 0u; block < 8u; block++) {
        let queue = select(0u, atomicLoad(&touched[block]), atomicLoad(&lit[block]) != 0u);
        if (queue == 0u) {
            continue;
        }
        let x0 = corner.x + (block & 1u) * 8u;
        let y0 = corner.y + (block >> 1u) * 4u;
        // Pixels.
        let px = x0 + (lane & 7u);
        let py = y0 + (lane >> 3u);
        var g_Q = vec4<f32>(0.0);  // each Q
        if (px < view.width && py < view.height) {
            let p = (py * view.width + px) * (CHANNELS + 1u);
            g_QC = gradient[p + C_];  // each C
        }
        g_Q = g_Q * MOVES_Q;  // each Q
        let checkpoint = checkpoints[bucket * 256u + block * 32u + lane];
        var rest = checkpoint.y;
        let x = f32(px);
        let y = f32(py);
        for (var group_index = (countOneBits(queue) + GROUP - 1u) / GROUP; group_index > 0u; group_index--) {
            var now = checkpoint.x;
            var bits = queue;
            for (var before = (group_index - 1u) * GROUP; before > 0u; before--) {
                let j = countTrailingZeros(bits);
                bits &= bits - 1u;
                let g = 2u * ids[j];
                now = cover(whitened(geometry[g], geometry[g + 1u], x, y), geometry[g + 1u].y, now).next;
            }
            var own = bits;
            var count = 0u;
            while (bits != 0u && count < GROUP) {
                let j = countTrailingZeros(bits);
                bits &= bits - 1u;
                let g = 2u * ids[j];
                let c = cover(whitened(geometry[g], geometry[g + 1u], x, y), geometry[g + 1u].y, now);
                let slot = count * PITCH + lane;
                weights[slot >> 2u][slot & 3u] = now;
                effects[count * PITCH + lane] = c.raw;
                if (lane == 0u) {
                    members[count] = j;
                }
                now = c.next;
                count++;
            }
            own &= ~bits;
            bits = own;
            for (var k = count; k > 0u; k--) {
                let j = firstLeadingBit(bits);
                bits ^= 1u << j;
                let at = (k - 1u) * PITCH + lane;
                let c = cover_by(effects[at], weights[at >> 2u][at & 3u]);
                var d = 0.0;
                let row = ids[j] * CHUNKS;
                d += dot(g_Q, colors[row + Q_]);  // each Q
                let e = select(0.0, c.weight * d, c.weight > 0.0);
                let moves = !c.stop && c.raw <= ALPHA_MAX && c.alpha > 0.0;
                weights[at >> 2u][at & 3u] = c.weight;
                effects[at] = select(0.0, fma(-rest, c.alpha / (1.0 - c.alpha), e), moves);
                rest += e;
            }
            workgroupBarrier();
            let member = lane >> 2u;
            var p_0 = vec4<f32>(0.0);
            var p_1 = vec4<f32>(0.0);
            var p_dc_Q = vec4<f32>(0.0);  // each Q
            if (member < count) {
                let j = members[member];
                let own_first = geometry[2u * ids[j]];
                let own_second = geometry[2u * ids[j] + 1u];
                for (var p = lane & 3u; p < 32u; p += 4u) {
                    let w = weights[(member * PITCH + p) >> 2u][p & 3u];
                    let s = effects[member * PITCH + p];
                    let uv = whitened(own_first, own_second, f32(x0 + (p & 7u)), f32(y0 + (p >> 3u)));
                    let su = s * uv.x;
                    let sv = s * uv.y;
                    p_0 += vec4<f32>(s, su, sv, su * uv.x);
                    p_1 += vec4<f32>(su * uv.y, sv * uv.y, 0.0, 0.0);
                    let source = (min(y0 + (p >> 3u), view.height - 1u) * view.width + min(x0 + (p & 7u), view.width - 1u)) * (CHANNELS + 1u);
                    p_dc_QC = fma(w, gradient[source + C_], p_dc_QC);  // each C
                }
            }
            let mine = (own & (1u << lane)) != 0u;
            let at = 4u * countOneBits(own & ((1u << lane) - 1u));
            workgroupBarrier();
            weights[lane] = p_0;
            workgroupBarrier();
            if (mine) {
                s_0 += (weights[at] + weights[at + 1u]) + (weights[at + 2u] + weights[at + 3u]);
            }
            workgroupBarrier();
            weights[lane] = p_1;
            workgroupBarrier();
            if (mine) {
                s_1 += (weights[at] + weights[at + 1u]) + (weights[at + 2u] + weights[at + 3u]);
            }
            workgroupBarrier();
            weights[lane] = p_dc_Q; workgroupBarrier(); if (mine) { dc_Q += (weights[at] + weights[at + 1u]) + (weights[at + 2u] + weights[at + 3u]); } workgroupBarrier();  // each Q
        }
    }
    if (lane < n) {
        let row = pairs[header.y + lane] * (CHUNKS + 2u);
        rows[row] = s_0;
        rows[row + 1u] = s_1;
        rows[row + 2u + Q_] = dc_Q;  // each Q
    }
}
