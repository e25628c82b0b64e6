# ruff: noqa: E501
"""Blending forward and backward as CUDA C through NVRTC (CuPy), on the lists of the WGSL kernels, to choose between them.

Both kernels are those of engine/rasterizer/gpu line by line, with the same sizes. Each is compiled for 1 to 4 workgroups
of a multiprocessor, and the quickest counts.
"""

from __future__ import annotations

import argparse
import json
import statistics
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.gpu import HEIGHT, REPEATS, WIDTH, Stopwatch, new_frame, scene
from engine.rasterizer.gpu import open_adapter
from engine.rasterizer.gpu.shaders import backward_sizes

SOURCE = r"""
#define CHUNKS ((CHANNELS + 3) / 4)
#define WORDS 8
#define BATCH 32
#define AMIN (1.0f / 255.0f)
typedef unsigned int u32;
struct Cover { float raw, alpha, weight, next; bool stop; };
__device__ __forceinline__ float2 whitened(float4 f, float4 s, float x, float y) {
  u32 an = __float_as_uint(s.z); float dx = x - (float)(an & 0xffff), dy = y - (float)(an >> 16);
  return make_float2(fmaf(f.z, dx, fmaf(f.w, dy, f.x)), fmaf(s.x, dy, f.y)); }
__device__ __forceinline__ Cover cover(float2 w, float o, float now) { Cover c;
  c.raw = exp2f(-fmaf(w.x, w.x, w.y * w.y)) * o; c.alpha = fminf(c.raw, 0.99f); if (c.alpha < AMIN) c.alpha = 0.f;
  c.next = fmaf(-c.alpha, now, now); c.stop = c.next < 1e-4f; c.weight = c.stop ? 0.f : c.alpha * now;
  if (c.stop) c.next = -fabsf(now); return c; }
__device__ __forceinline__ float clampf(float x, float a, float b) { return fminf(fmaxf(x, a), b); }
__device__ __forceinline__ bool touches(float4 f, float4 s, float x, float y) {
  float limit = fmaxf(log2f(255.f * s.y), 0.f) + 0.01f; u32 an = __float_as_uint(s.z);
  float left = x - (float)(an & 0xffff), top = y - (float)(an >> 16), a = f.z, b = f.w, c = s.x, u0 = f.x, v0 = f.y;
  float cy = -v0 / c, cx = -fmaf(b, cy, u0) / a, right = left + 7.f, bottom = top + 3.f;
  float sx = clampf(cx, left, right), sy = clampf(cy, top, bottom);
  float fy = clampf(-(b * fmaf(a, sx, u0) + c * v0) / fmaf(b, b, c * c), top, bottom);
  float p = fmaf(a, sx, fmaf(b, fy, u0)), q = fmaf(c, fy, v0);
  float fx = clampf(-fmaf(b, sy, u0) / a, left, right);
  float r = fmaf(a, fx, fmaf(b, sy, u0)), t = fmaf(c, sy, v0);
  return fminf(p * p + q * q, r * r + t * t) <= limit * 1.0001f; }
__device__ __forceinline__ float4 fma1(float w, float4 c, float4 s) {
  return make_float4(fmaf(w, c.x, s.x), fmaf(w, c.y, s.y), fmaf(w, c.z, s.z), fmaf(w, c.w, s.w)); }
__device__ __forceinline__ float dot4(float4 a, float4 b) { return a.x * b.x + a.y * b.y + a.z * b.z + a.w * b.w; }
#define SHARED __shared__ float4 bf[256]; __shared__ float4 bs[256]; __shared__ u32 bg[256]; __shared__ u32 bb[8 * WORDS];
#define LOAD(at, end) if (lane < 8 * WORDS) bb[lane] = 0; __syncthreads(); \
  if (lane < WORDS * BATCH && at + lane < end) { u32 g = entries[at + lane].x; float4 f = geometry[2 * g], s = geometry[2 * g + 1]; \
    bf[lane] = f; bs[lane] = s; bg[lane] = g; float x_ = (tile % columns) * 16.f, y_ = (tile / columns) * 16.f; \
    for (u32 k = 0; k < 8; k++) if (touches(f, s, x_ + (k & 1) * 8.f, y_ + (k >> 1) * 4.f)) \
      atomicOr(&bb[k * WORDS + lane / BATCH], 1u << (lane % BATCH)); } __syncthreads();
extern "C" __global__ void __launch_bounds__(256, BLOCKS) blend(u32 W, u32 H, const float4* __restrict__ geometry,
  const uint2* __restrict__ entries, const uint2* __restrict__ ranges, const float4* __restrict__ colors,
  float* __restrict__ image, u32* __restrict__ trans) {
  SHARED u32 lane = threadIdx.x, tile = blockIdx.x, columns = (W + 15) / 16, block = lane >> 5;
  u32 ix = (tile % columns) * 16 + (block & 1) * 8 + (lane & 7), iy = (tile / columns) * 16 + (block >> 1) * 4 + ((lane >> 3) & 3);
  float x = ix, y = iy; bool inside = ix < W && iy < H; uint2 r = ranges[tile]; float now = inside ? 1.f : -1.f; u32 end = 0;
  float4 sum[CHUNKS];
  #pragma unroll
  for (int q = 0; q < CHUNKS; q++) sum[q] = make_float4(0, 0, 0, 0);
  for (u32 at = r.x; at < r.y; at += WORDS * BATCH) {
    if (!__syncthreads_or(now > 0.f)) break;
    LOAD(at, r.y)
    for (u32 word = 0; word < WORDS && at + word * BATCH < r.y; word++) { u32 bits = bb[block * WORDS + word];
      trans[(size_t)2 * W * H + (r.x / BATCH + tile + (at - r.x) / BATCH + word) * 256 + lane] = __float_as_uint(now);
      while (bits && now > 0.f) { u32 j = word * BATCH + __ffs(bits) - 1; bits &= bits - 1; float4 s = bs[j];
        Cover c = cover(whitened(bf[j], s, x, y), s.y, now); now = c.next;
        if (c.weight > 0.f) { end = at + j + 1; const float4* row = colors + (size_t)bg[j] * CHUNKS;
          #pragma unroll
          for (int q = 0; q < CHUNKS; q++) sum[q] = fma1(c.weight, row[q], sum[q]); } } }
    __syncthreads(); }
  if (inside) { size_t p = (size_t)iy * W + ix; trans[p] = __float_as_uint(fabsf(now)); trans[(size_t)W * H + p] = end;
    #pragma unroll
    for (int c = 0; c < CHANNELS; c++) image[p * CHANNELS + c] = (&sum[c / 4].x)[c % 4]; } }
#define COLUMNS (CHANNELS + 6)
#define SUBS (32 / COLUMNS)
#define PITCH 9
__device__ __forceinline__ float4 mul4(float4 w, float4 c) { return make_float4(w.x * c.x, w.y * c.y, w.z * c.z, w.w * c.w); }
__device__ __forceinline__ float4 fma4(float4 w, float4 c, float4 s) {
  return make_float4(fmaf(w.x, c.x, s.x), fmaf(w.y, c.y, s.y), fmaf(w.z, c.z, s.z), fmaf(w.w, c.w, s.w)); }
__device__ __forceinline__ float2 block_center(u32 W, u32 H, u32 cx, u32 cy) {
  return make_float2(0.5f * (min(max(W, cx + 1) - cx, 8u) - 1), 0.5f * (min(max(H, cy + 1) - cy, 4u) - 1)); }
__device__ __forceinline__ float4 column_values(u32 W, u32 H, const float* __restrict__ gradient, u32 c, u32 cx, u32 cy, u32 x, u32 y) {
  if (c >= CHANNELS) { float2 m = block_center(W, H, cx, cy); float dy = y - m.y; float d0 = (float)x - m.x, d1 = d0 + 1.f, d2 = d0 + 2.f, d3 = d0 + 3.f;
    switch (c - CHANNELS) { case 0: return make_float4(1, 1, 1, 1); case 1: return make_float4(d0, d1, d2, d3);
      case 2: return make_float4(dy, dy, dy, dy); case 3: return make_float4(d0 * d0, d1 * d1, d2 * d2, d3 * d3);
      case 4: return make_float4(d0 * dy, d1 * dy, d2 * dy, d3 * dy); case 5: return make_float4(dy * dy, dy * dy, dy * dy, dy * dy);
      default: return make_float4(0, 0, 0, 0); } }
  float v[4];
  #pragma unroll
  for (int i = 0; i < 4; i++) { u32 px = cx + x + i, py = cy + y; v[i] = px < W && py < H ? gradient[((size_t)py * W + px) * (CHANNELS + 1) + c] : 0.f; }
  return make_float4(v[0], v[1], v[2], v[3]); }
extern "C" __global__ void __launch_bounds__(256, BLOCKS) blend_backward(u32 W, u32 H, const float4* __restrict__ geometry,
  const uint2* __restrict__ entries, const uint2* __restrict__ ranges, const float4* __restrict__ colors,
  const float* __restrict__ gradient, const u32* __restrict__ trans, float4* __restrict__ rows) {
  __shared__ float4 bf[BATCH], bs[BATCH], bc[BATCH * CHUNKS]; __shared__ uint2 be[2 * BATCH]; __shared__ u32 touched[16], ends[8];
  __shared__ float4 effects[8 * GROUP * 2 * PITCH]; __shared__ float sums[SLOTS * COLUMNS];
  u32 lane = threadIdx.x, columns = (W + 15) / 16, block = lane >> 5, member = lane & 31;
  u32 sub = min(member / COLUMNS, SUBS - 1), fc = member - sub * COLUMNS, kind = fc >= CHANNELS ? PITCH : 0;
  u32 tile = blockIdx.x;
  uint2 r = ranges[tile]; u32 tx = (tile % columns) * 16, ty = (tile / columns) * 16;
  u32 cx = tx + (block & 1) * 8, cy = ty + (block >> 1) * 4, ix = cx + (member & 7), iy = cy + (member >> 3);
  float x = ix, y = iy; u32 end = 0; float rest = 0; float4 g[CHUNKS];
  #pragma unroll
  for (int q = 0; q < CHUNKS; q++) g[q] = make_float4(0, 0, 0, 0);
  if (ix < W && iy < H) { size_t p = (size_t)iy * W + ix; end = trans[(size_t)W * H + p];
    #pragma unroll
    for (int c = 0; c < CHANNELS; c++) (&g[c / 4].x)[c % 4] = gradient[p * (CHANNELS + 1) + c];
    rest = gradient[p * (CHANNELS + 1) + CHANNELS] * __uint_as_float(trans[p]); }
  float4 c0 = column_values(W, H, gradient, fc, cx, cy, 0, 0), c1 = column_values(W, H, gradient, fc, cx, cy, 4, 0);
  float4 c2 = column_values(W, H, gradient, fc, cx, cy, 0, 1), c3 = column_values(W, H, gradient, fc, cx, cy, 4, 1);
  float4 c4 = column_values(W, H, gradient, fc, cx, cy, 0, 2), c5 = column_values(W, H, gradient, fc, cx, cy, 4, 2);
  float4 c6 = column_values(W, H, gradient, fc, cx, cy, 0, 3), c7 = column_values(W, H, gradient, fc, cx, cy, 4, 3);
  if (lane < 8) ends[lane] = r.x;
  if (lane < 16) touched[lane] = 0;
  __syncthreads(); atomicMax(&ends[block], end); __syncthreads();
  u32 last = r.x;
  #pragma unroll
  for (int k = 0; k < 8; k++) last = max(last, ends[k]);
  u32 nb = (last - r.x + BATCH - 1) / BATCH;
  for (u32 i = r.x + nb * BATCH + lane; i < r.y; i += 256) { size_t row = (size_t)entries[i].y * (CHUNKS + 2);
    for (int q = 0; q < CHUNKS + 2; q++) rows[row + q] = make_float4(0, 0, 0, 0); }
  u32 oj = lane >> 3, ob = lane & 7; float ox = tx + (ob & 1) * 8, oy = ty + (ob >> 1) * 4;
  uint2 e = make_uint2(0, 0); if (nb > 0) e = entries[min(r.x + (nb - 1) * BATCH + oj, r.y - 1)];
  for (u32 b = nb; b > 0; b--) { u32 at = r.x + (b - 1) * BATCH, n = min(BATCH, r.y - at), turn = (b & 1) * 8, et = (b & 1) * BATCH;
    if (oj < n) { float4 f = geometry[2 * e.x], s = geometry[2 * e.x + 1];
      if (ob == 0) { bf[oj] = f; bs[oj] = s; be[et + oj] = e;
        #pragma unroll
        for (int q = 0; q < CHUNKS; q++) bc[oj * CHUNKS + q] = colors[(size_t)e.x * CHUNKS + q]; }
      if (at + oj < ends[ob] && touches(f, s, ox, oy)) atomicOr(&touched[turn + ob], 1u << oj); }
    float start = __uint_as_float(trans[(size_t)2 * W * H + (r.x / BATCH + tile + b - 1) * 256 + lane]);
    __syncthreads();
    if (lane < 8) touched[8 - turn + lane] = 0;
    if (b > 1) e = entries[at - BATCH + min(oj, BATCH - 1)];
    for (u32 left = n; left > 0;) { u32 taking = left, taken, longest, slot0 = 0, oslot0 = 0;
      while (true) { taken = (~0u >> (32 - left)) & ~((1u << (left - taking)) - 1); longest = 0; u32 total = 0;
        #pragma unroll
        for (int k = 0; k < 8; k++) { if (k == block) slot0 = total; if (k == ob) oslot0 = total;
          u32 count = __popc(touched[turn + k] & taken); longest = max(longest, count); total += count; }
        if (SLOTS >= 8 * BATCH || total <= SLOTS) break;
        taking = (taking + 1) / 2; }
      u32 bits = touched[turn + block] & taken, nt = __popc(bits);
      for (u32 done = 0; done < longest; done += GROUP) { u32 count = min(max(nt, done) - done, GROUP);
        if (count > 0) { u32 own = bits; for (u32 k = 0; k < count; k++) bits ^= 1u << (31 - __clz(bits));
          own ^= bits; float now = start; u32 before = touched[turn + block] & ((own & (~own + 1)) - 1);
          while (before) { u32 j = __ffs(before) - 1; before &= before - 1; float4 s4 = bs[j];
            float2 uv = whitened(bf[j], s4, x, y); float raw = exp2f(-fmaf(uv.x, uv.x, uv.y * uv.y)) * s4.y;
            float alpha = fminf(raw, 0.99f); if (alpha < AMIN || at + j >= end) alpha = 0.f; now = fmaf(-alpha, now, now); }
          u32 j = 0, js[GROUP]; float raws[GROUP], alphas[GROUP], nows[GROUP];
          #pragma unroll
          for (int k = 0; k < GROUP; k++) { bool is_own = own != 0; j = is_own ? __ffs(own) - 1 : j; js[k] = j; own &= ~(1u << j);
            float4 s4 = bs[j]; float2 uv = whitened(bf[j], s4, x, y); raws[k] = exp2f(-fmaf(uv.x, uv.x, uv.y * uv.y)) * s4.y;
            float alpha = fminf(raws[k], 0.99f); alphas[k] = alpha < AMIN || at + j >= end || !is_own ? 0.f : alpha;
            nows[k] = now; now = fmaf(-alphas[k], now, now); }
          u32 to = block * GROUP * 2 * PITCH * 4 + member;
          #pragma unroll
          for (int k = GROUP - 1; k >= 0; k--) { float d = 0.f;
            #pragma unroll
            for (int q = 0; q < CHUNKS; q++) d += dot4(g[q], bc[js[k] * CHUNKS + q]);
            float w = alphas[k] * nows[k], ew = w * d; ((float*)effects)[to + k * 8 * PITCH] = w;
            ((float*)effects)[to + (k * 2 + 1) * 4 * PITCH] = raws[k] <= 0.99f ? fmaf(-rest, alphas[k] / (1.f - alphas[k]), ew) : 0.f; rest += ew; } }
        __syncthreads();
        for (u32 k = sub; k < count; k += SUBS) { const float4* row = effects + (block * GROUP + k) * 2 * PITCH + kind;
          float4 t = mul4(row[0], c0); t = fma4(row[1], c1, t); t = fma4(row[2], c2, t); t = fma4(row[3], c3, t);
          t = fma4(row[4], c4, t); t = fma4(row[5], c5, t); t = fma4(row[6], c6, t); t = fma4(row[7], c7, t);
          if (fc < COLUMNS) sums[(slot0 + done + count - 1 - k) * COLUMNS + fc] = (t.x + t.y) + (t.z + t.w); }
        __syncthreads(); }
      u32 obits = (touched[turn + ob] & taken) >> oj;
      if (obits & 1) { float* m = sums + (oslot0 + __popc(obits >> 1)) * COLUMNS + CHANNELS;
        float4 f = bf[oj], s4 = bs[oj]; float2 o = block_center(W, H, (u32)ox, (u32)oy), u = whitened(f, s4, ox + o.x, oy + o.y); float a = f.z, bb = f.w, c = s4.x;
        float s = m[0], sx = m[1], sy = m[2], sxx = m[3], sxy = m[4], syy = m[5], l = a * sx + bb * sy, h = a * sxy + bb * syy, sv = u.y * s + c * sy;
        m[1] = u.x * s + l; m[2] = sv; m[3] = u.x * (u.x * s + 2.f * l) + (a * (a * sxx + bb * sxy) + bb * h);
        m[4] = u.y * (u.x * s + l) + c * (u.x * sy + h); m[5] = u.y * (sv + c * sy) + c * c * syy; }
      __syncthreads(); left -= taking;
      for (u32 i = lane; i < taking * (CHUNKS + 2); i += 256) { u32 j = left + i / (CHUNKS + 2), q = i % (CHUNKS + 2), slot = 0;
        u32 column = q < 2 ? CHANNELS + 4 * q : 4 * q - 8, stop = q < 2 ? COLUMNS : CHANNELS; float4 t = make_float4(0, 0, 0, 0);
        for (u32 k = 0; k < 8; k++) { u32 mask = touched[turn + k] & taken;
          if ((mask >> j) & 1) { const float* m = sums + (slot + __popc((mask >> j) >> 1)) * COLUMNS;
            t.x += m[column]; if (column + 1 < stop) t.y += m[column + 1]; if (column + 2 < stop) t.z += m[column + 2]; if (column + 3 < stop) t.w += m[column + 3]; }
          slot += __popc(mask); }
        rows[(size_t)be[et + j].y * (CHUNKS + 2) + q] = t; } } } }
"""


def compare(gpu: Any, arrays: dict[str, np.ndarray], case: str) -> dict[str, Any]:
    """Return medians in milliseconds of both kernels both ways, and the largest difference of the results."""
    import cupy

    frame = new_frame(gpu, arrays, case, 4 * len(arrays["means"]))
    watch = Stopwatch(gpu)
    wgsl = []
    for _ in range(10 * REPEATS):
        frame.forward(watch)
        frame.backward(watch)
        wgsl.append(watch.read())
    counts = frame.counts()
    s = frame.size
    chunks = -(-s.n_out // 4)

    def copied(name: str, n: int, dtype: Any) -> Any:
        return cupy.asarray(frame.read(name, (n,), dtype))

    geometry = copied("geometry", 8 * s.n, np.float32)
    entries = copied("entries", 2 * counts.n_pairs, np.uint32)
    ranges = copied("tile_ranges", 2 * s.n_tiles, np.uint32)
    colors = copied("colors", 4 * chunks * s.n, np.float32)
    gradient = copied("gradient", WIDTH * HEIGHT * (s.n_out + 1), np.float32)
    transmittance = copied("transmittance", frame.buffers["transmittance"].size // 4, np.uint32)
    image = cupy.zeros(WIDTH * HEIGHT * s.n_out, np.float32)
    rows = cupy.zeros(4 * (chunks + 2) * counts.n_pairs, np.float32)
    size = (np.uint32(WIDTH), np.uint32(HEIGHT))
    calls = {
        "blending": ("blend", (geometry, entries, ranges, colors, image, transmittance.copy())),
        "blending backward": (
            "blend_backward", (geometry, entries, ranges, colors, gradient, transmittance, rows),
        ),
    }  # fmt: skip
    constants = backward_sizes(s.n_out)
    result: dict[str, Any] = {name: constants[name] for name in ("GROUP", "SLOTS")}
    for stage, (name, arguments) in calls.items():
        found = []
        for blocks in (1, 2, 3, 4):
            options = [f"-D{key}={constants[key]}" for key in ("GROUP", "SLOTS")]
            options += ["--use_fast_math", f"-DCHANNELS={s.n_out}", f"-DBLOCKS={blocks}"]
            kernel = cupy.RawModule(code=SOURCE, options=tuple(options), backend="nvrtc").get_function(name)
            times = []
            for i in range(3 * REPEATS):
                start, end = cupy.cuda.Event(), cupy.cuda.Event()
                start.record()
                kernel((s.n_tiles,), (256,), (*size, *arguments))
                end.record()
                end.synchronize()
                if i >= REPEATS:
                    times.append(cupy.cuda.get_elapsed_time(start, end))
            found.append((statistics.median(times), blocks, kernel.num_regs))
        result[f"cuda {stage}"], result[f"blocks {stage}"], result[f"registers {stage}"] = min(found)
        result[f"cuda {stage}, 1 to 4"] = [milliseconds for milliseconds, _, _ in found]
        result[f"wgsl {stage}"] = statistics.median(row[stage] for row in wgsl[-REPEATS:])
        result[f"ratio {stage}"] = result[f"wgsl {stage}"] / result[f"cuda {stage}"]
    difference = np.abs(frame.read("image", (WIDTH * HEIGHT * s.n_out,)) - cupy.asnumpy(image))
    result["image difference, 99.9 %"] = float(np.quantile(difference, 0.999))
    ours = frame.read("rows", (4 * (chunks + 2) * counts.n_pairs,))
    result["rows, relative"] = float(np.linalg.norm(ours - cupy.asnumpy(rows)) / np.linalg.norm(ours))
    return result


def main() -> None:
    """Compare at 1M Gaussians."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--n", type=int, default=1_000_000)
    parser.add_argument("--out", type=Path, default=Path("out/gpu_cuda.json"))
    options = parser.parse_args()
    gpu = open_adapter()
    arrays = scene(options.n)
    results = {case: compare(gpu, arrays, case) for case in ("RGB", "RGB+16")}
    options.out.parent.mkdir(parents=True, exist_ok=True)
    options.out.write_text(json.dumps({"card": gpu.name, **results}, indent=1))
    print(json.dumps(results, indent=1))


if __name__ == "__main__":
    main()
