// Second part of the backward pass of blending: the gradients of 32 pairs of a tile and a Gaussian, an invocation each.
// For each block of 8x4 pixels the invocations are pixels first and write w and s = alpha dL/dalpha of each Gaussian to
// workgroup memory; then they are Gaussians and sum over the pixels, each in its own registers and in a fixed order.
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

const PITCH: u32 = 33u;  // no two invocations in one bank
var<workgroup> first: array<vec4<f32>, 32>;
var<workgroup> second: array<vec4<f32>, 32>;
var<workgroup> color: array<vec4<f32>, BUCKET_COLORS>;  // [32][CHUNKS]
var<workgroup> pixel_gradient: array<vec4<f32>, BUCKET_COLORS>;
var<workgroup> weights: array<f32, 1056>;  // [32 Gaussians][PITCH]
var<workgroup> effects: array<f32, 1056>;  // e, then s
var<workgroup> ratios: array<f32, 1056>;
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
        first[lane] = mine_first;
        second[lane] = mine_second;
        color[lane * CHUNKS + Q_] = colors[g * CHUNKS + Q_];  // each Q
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
    var s_uv = 0.0;
    var s_vv = 0.0;
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
        pixel_gradient[lane * CHUNKS + Q_] = g_Q;  // each Q
        g_Q = g_Q * MOVES_Q;  // each Q
        let checkpoint = checkpoints[bucket * 256u + block * 32u + lane];
        var now = checkpoint.x;
        var rest = checkpoint.y;
        let x = f32(px);
        let y = f32(py);
        var bits = queue;
        while (bits != 0u) {
            let j = countTrailingZeros(bits);
            bits &= bits - 1u;
            let opacity = second[j].y;
            let c = cover(whitened(first[j], second[j], x, y), opacity, now);
            now = c.next;
            var d = 0.0;
            d += dot(g_Q, color[j * CHUNKS + Q_]);  // each Q
            weights[j * PITCH + lane] = c.weight;
            effects[j * PITCH + lane] = select(0.0, c.weight * d, c.weight > 0.0);
            ratios[j * PITCH + lane] = select(c.alpha / (1.0 - c.alpha), 0.0, c.stop || c.raw > ALPHA_MAX);
        }
        bits = queue;
        while (bits != 0u) {
            let j = firstLeadingBit(bits);
            bits ^= 1u << j;
            let at = j * PITCH + lane;
            let e = effects[at];
            let ratio = ratios[at];
            effects[at] = select(0.0, fma(-rest, ratio, e), ratio > 0.0);
            rest += e;
        }
        workgroupBarrier();
        // Gaussians.
        if ((queue & (1u << lane)) != 0u) {
            for (var p = 0u; p < 32u; p++) {
                let w = weights[lane * PITCH + p];
                let s = effects[lane * PITCH + p];
                let uv = whitened(mine_first, mine_second, f32(x0 + (p & 7u)), f32(y0 + (p >> 3u)));
                let su = s * uv.x;
                let sv = s * uv.y;
                s_0 += vec4<f32>(s, su, sv, su * uv.x);
                s_uv = fma(su, uv.y, s_uv);
                s_vv = fma(sv, uv.y, s_vv);
                dc_Q = fma(vec4<f32>(w), pixel_gradient[p * CHUNKS + Q_], dc_Q);  // each Q
            }
        }
        workgroupBarrier();
    }
    if (lane < n) {
        let row = pairs[header.y + lane] * (CHUNKS + 2u);
        rows[row] = s_0;
        rows[row + 1u] = vec4<f32>(s_uv, s_vv, 0.0, 0.0);
        rows[row + 2u + Q_] = dc_Q;  // each Q
    }
}
