# ruff: noqa: E501
"""Blending forward and backward as CUDA C through NVRTC (CuPy), on the lists of the WGSL kernels, to choose between them.

Blending and replay are those of engine/rasterizer/gpu line by line; the pair gradients are their first version.
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

SOURCE = r"""
#define CHUNKS ((CHANNELS + 3) / 4)
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
__device__ __forceinline__ float4 fma4(float w, float4 c, float4 s) {
  return make_float4(fmaf(w, c.x, s.x), fmaf(w, c.y, s.y), fmaf(w, c.z, s.z), fmaf(w, c.w, s.w)); }
__device__ __forceinline__ float dot4(float4 a, float4 b) { return a.x * b.x + a.y * b.y + a.z * b.z + a.w * b.w; }
#define SHARED __shared__ float4 bf[256]; __shared__ float4 bs[256]; __shared__ u32 bg[256]; __shared__ u32 bb[64];
#define LOAD(at, end) if (lane < 64) bb[lane] = 0; __syncthreads(); \
  if (at + lane < end) { u32 g = gaussians[at + lane]; float4 f = geometry[2 * g], s = geometry[2 * g + 1]; \
    bf[lane] = f; bs[lane] = s; bg[lane] = g; float x_ = (tile % columns) * 16.f, y_ = (tile / columns) * 16.f; \
    for (u32 k = 0; k < 8; k++) if (touches(f, s, x_ + (k & 1) * 8.f, y_ + (k >> 1) * 4.f)) \
      atomicOr(&bb[k * 8 + (lane >> 5)], 1u << (lane & 31)); } __syncthreads();
extern "C" __global__ void __launch_bounds__(256) blend(u32 W, u32 H, const float4* __restrict__ geometry,
  const u32* __restrict__ gaussians, const uint2* __restrict__ ranges, const float4* __restrict__ colors,
  float* __restrict__ image, float* __restrict__ trans) {
  SHARED u32 lane = threadIdx.x, tile = blockIdx.x, columns = (W + 15) / 16, block = lane >> 5;
  u32 ix = (tile % columns) * 16 + (block & 1) * 8 + (lane & 7), iy = (tile / columns) * 16 + (block >> 1) * 4 + ((lane >> 3) & 3);
  float x = ix, y = iy; bool inside = ix < W && iy < H; uint2 r = ranges[tile]; float now = inside ? 1.f : -1.f;
  float4 sum[CHUNKS];
  #pragma unroll
  for (int q = 0; q < CHUNKS; q++) sum[q] = make_float4(0, 0, 0, 0);
  for (u32 at = r.x; at < r.y; at += 256) {
    if (!__syncthreads_or(now > 0.f)) break;
    LOAD(at, r.y)
    for (u32 word = 0; word < 8; word++) { u32 bits = bb[block * 8 + word];
      while (bits && now > 0.f) { u32 j = word * 32 + __ffs(bits) - 1; bits &= bits - 1; float4 s = bs[j];
        Cover c = cover(whitened(bf[j], s, x, y), s.y, now); now = c.next;
        if (c.weight > 0.f) { const float4* row = colors + (size_t)bg[j] * CHUNKS;
          #pragma unroll
          for (int q = 0; q < CHUNKS; q++) sum[q] = fma4(c.weight, row[q], sum[q]); } } }
    __syncthreads(); }
  if (inside) { size_t p = (size_t)iy * W + ix; trans[p] = fabsf(now);
    #pragma unroll
    for (int c = 0; c < CHANNELS; c++) image[p * CHANNELS + c] = (&sum[c / 4].x)[c % 4]; } }
#define GRADIENT(px, py, in) float4 g[CHUNKS]; \
  _Pragma("unroll") for (int q = 0; q < CHUNKS; q++) g[q] = make_float4(0, 0, 0, 0); \
  if (in) { size_t p_ = ((size_t)(py) * W + (px)) * (CHANNELS + 1); \
    _Pragma("unroll") for (int c = 0; c < CHANNELS; c++) (&g[c / 4].x)[c % 4] = gradient[p_ + c]; }
extern "C" __global__ void __launch_bounds__(256) replay(u32 W, u32 H, const float4* __restrict__ geometry,
  const u32* __restrict__ gaussians, const uint2* __restrict__ ranges, const float4* __restrict__ colors,
  const float* __restrict__ gradient, float2* __restrict__ checkpoints, uint4* __restrict__ buckets) {
  SHARED u32 lane = threadIdx.x, tile = blockIdx.x, columns = (W + 15) / 16, block = lane >> 5;
  u32 ix = (tile % columns) * 16 + (block & 1) * 8 + (lane & 7), iy = (tile / columns) * 16 + (block >> 1) * 4 + ((lane >> 3) & 3);
  float x = ix, y = iy; bool inside = ix < W && iy < H; uint2 r = ranges[tile]; float now = inside ? 1.f : -1.f;
  u32 base = r.x / 32 + tile, nb = (r.y - r.x + 31) / 32;
  GRADIENT(ix, iy, inside)
  float byt = inside ? gradient[((size_t)iy * W + ix) * (CHANNELS + 1) + CHANNELS] : 0.f;
  for (u32 at = r.x; at < r.y; at += 256) {
    LOAD(at, r.y)
    for (u32 word = 0; word < 8; word++) { if (at + word * 32 >= r.y) break;
      u32 bucket = base + (at - r.x) / 32 + word;
      if (lane == 0) { u32 f = at + word * 32; buckets[bucket] = make_uint4(tile + 1, f, min(f + 32, r.y), 0); }
      float before = now, total = 0.f; u32 bits = bb[block * 8 + word];
      while (bits && now > 0.f) { u32 j = word * 32 + __ffs(bits) - 1; bits &= bits - 1; float4 s = bs[j];
        Cover c = cover(whitened(bf[j], s, x, y), s.y, now); now = c.next;
        if (c.weight > 0.f) { const float4* row = colors + (size_t)bg[j] * CHUNKS; float d = 0.f;
          #pragma unroll
          for (int q = 0; q < CHUNKS; q++) d += dot4(g[q], row[q]);
          total = fmaf(c.weight, d, total); } }
      checkpoints[(size_t)bucket * 256 + lane] = make_float2(before, total); }
    __syncthreads(); }
  float rest = byt * fabsf(now);
  for (u32 k = nb; k > 0; k--) { size_t at = (size_t)(base + k - 1) * 256 + lane; float2 own = checkpoints[at];
    checkpoints[at] = make_float2(own.x, rest); rest += own.y; } }
extern "C" __global__ void __launch_bounds__(32) bucket(u32 W, u32 H, const float4* __restrict__ geometry,
  const u32* __restrict__ gaussians, const u32* __restrict__ pairs, const float4* __restrict__ colors,
  const float* __restrict__ gradient, const float2* __restrict__ checkpoints, const uint4* __restrict__ buckets,
  float4* __restrict__ rows) {
  __shared__ float4 first[32], second[32], color[32 * CHUNKS], pg[32 * CHUNKS];
  __shared__ float ws[1056], es[1056], rs[1056];
  u32 lane = threadIdx.x, b = blockIdx.x, columns = (W + 15) / 16; uint4 h = buckets[b]; if (!h.x) return;
  u32 tile = h.x - 1, n = h.z - h.y, cx = (tile % columns) * 16, cy = (tile / columns) * 16;
  float4 mf = make_float4(0, 0, 0, 0), ms = mf; bool own = lane < n;
  if (own) { u32 gi = gaussians[h.y + lane]; mf = geometry[2 * gi]; ms = geometry[2 * gi + 1]; first[lane] = mf; second[lane] = ms;
    #pragma unroll
    for (int q = 0; q < CHUNKS; q++) color[lane * CHUNKS + q] = colors[(size_t)gi * CHUNKS + q]; }
  float4 s0 = make_float4(0, 0, 0, 0), dc[CHUNKS]; float suv = 0.f, svv = 0.f;
  #pragma unroll
  for (int q = 0; q < CHUNKS; q++) dc[q] = make_float4(0, 0, 0, 0);
  __syncwarp();
  for (u32 k = 0; k < 8; k++) {
    u32 x0 = cx + (k & 1) * 8, y0 = cy + (k >> 1) * 4;
    u32 queue = __ballot_sync(~0u, own && touches(mf, ms, (float)x0, (float)y0));
    float2 cp = checkpoints[(size_t)b * 256 + k * 32 + lane];
    if (!__any_sync(~0u, cp.x > 0.f)) queue = 0; if (!queue) continue;
    u32 px = x0 + (lane & 7), py = y0 + (lane >> 3);
    GRADIENT(px, py, px < W && py < H)
    #pragma unroll
    for (int q = 0; q < CHUNKS; q++) pg[lane * CHUNKS + q] = g[q];
    float now = cp.x, rest = cp.y, x = px, y = py; u32 bits = queue;
    while (bits) { u32 j = __ffs(bits) - 1; bits &= bits - 1;
      Cover c = cover(whitened(first[j], second[j], x, y), second[j].y, now); now = c.next; float d = 0.f;
      #pragma unroll
      for (int q = 0; q < CHUNKS; q++) d += dot4(g[q], color[j * CHUNKS + q]);
      ws[j * 33 + lane] = c.weight; es[j * 33 + lane] = c.weight > 0.f ? c.weight * d : 0.f;
      rs[j * 33 + lane] = c.stop || c.raw > 0.99f ? 0.f : c.alpha / (1.f - c.alpha); }
    bits = queue;
    while (bits) { u32 j = 31 - __clz(bits); bits ^= 1u << j; u32 at = j * 33 + lane; float e = es[at], ratio = rs[at];
      es[at] = ratio > 0.f ? fmaf(-rest, ratio, e) : 0.f; rest += e; }
    __syncwarp();
    if ((queue >> lane) & 1) for (u32 p = 0; p < 32; p++) { float w = ws[lane * 33 + p], s = es[lane * 33 + p];
      float2 uv = whitened(mf, ms, (float)(x0 + (p & 7)), (float)(y0 + (p >> 3))); float su = s * uv.x, sv = s * uv.y;
      s0.x += s; s0.y += su; s0.z += sv; s0.w = fmaf(su, uv.x, s0.w); suv = fmaf(su, uv.y, suv); svv = fmaf(sv, uv.y, svv);
      #pragma unroll
      for (int q = 0; q < CHUNKS; q++) dc[q] = fma4(w, pg[p * CHUNKS + q], dc[q]); }
    __syncwarp(); }
  if (own) { size_t row = (size_t)pairs[h.y + lane] * (CHUNKS + 2); rows[row] = s0; rows[row + 1] = make_float4(suv, svv, 0, 0);
    #pragma unroll
    for (int q = 0; q < CHUNKS; q++) rows[row + 2 + q] = dc[q]; } }
"""


def compare(gpu: Any, arrays: dict[str, np.ndarray], case: str) -> dict[str, float]:
    """Return medians in milliseconds of the three kernels both ways, and the largest difference of the results."""
    import cupy

    frame = new_frame(gpu, arrays, case, 4 * len(arrays["means"]))
    watch = Stopwatch(gpu)
    wgsl = []
    for _ in range(REPEATS + 5):
        frame.forward(watch)
        frame.backward(watch)
        wgsl.append(watch.read())
    counts = frame.counts()
    s = frame.size
    chunks = -(-s.n_out // 4)
    n_buckets = counts.n_pairs // 32 + s.n_tiles

    def copied(name: str, n: int, dtype: Any) -> Any:
        return cupy.asarray(frame.read(name, (n,), dtype))

    geometry = copied("geometry", 8 * s.n, np.float32)
    gaussians = copied("gaussians", counts.n_pairs, np.uint32)
    pairs = copied(frame._pairs, counts.n_pairs, np.uint32)
    ranges = copied("tile_ranges", 2 * s.n_tiles, np.uint32)
    colors = copied("colors", 4 * chunks * s.n, np.float32)
    gradient = copied("gradient", WIDTH * HEIGHT * (s.n_out + 1), np.float32)
    image = cupy.zeros(WIDTH * HEIGHT * s.n_out, np.float32)
    trans = cupy.zeros(WIDTH * HEIGHT, np.float32)
    checkpoints = cupy.zeros(512 * n_buckets, np.float32)
    buckets = cupy.zeros(4 * n_buckets, np.uint32)
    rows = cupy.zeros(4 * (chunks + 2) * counts.n_pairs, np.float32)
    module = cupy.RawModule(code=SOURCE, options=("--use_fast_math", f"-DCHANNELS={s.n_out}"), backend="nvrtc")
    size = (np.uint32(WIDTH), np.uint32(HEIGHT))
    calls = {
        "blending": (s.n_tiles, 256, "blend", (geometry, gaussians, ranges, colors, image, trans)),
        "replay": (s.n_tiles, 256, "replay", (geometry, gaussians, ranges, colors, gradient, checkpoints, buckets)),
        "pair gradients": (
            n_buckets, 32, "bucket", (geometry, gaussians, pairs, colors, gradient, checkpoints, buckets, rows),
        ),
    }  # fmt: skip
    result = {}
    for stage, (groups, threads, name, arguments) in calls.items():
        kernel = module.get_function(name)
        times = []
        for i in range(REPEATS + 5):
            start, end = cupy.cuda.Event(), cupy.cuda.Event()
            start.record()
            kernel((groups,), (threads,), (*size, *arguments))
            end.record()
            end.synchronize()
            if i >= 5:
                times.append(cupy.cuda.get_elapsed_time(start, end))
        result[f"cuda {stage}"] = statistics.median(times)
        result[f"wgsl {stage}"] = statistics.median(row[stage] for row in wgsl[5:])
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
