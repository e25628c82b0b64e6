// Gradient, by the transmittance T, of the coverage's distance from that which an object alone is to have: the mean of
// |1 - T - alpha| over the pixels where alpha is known, and of what is missing where the object keeps its own.
struct Coverage {
    n_pixels: u32,
    by_known: f32,  // weights of a pixel
    by_kept: f32,
}
@group(0) @binding(0) var<uniform> coverage: Coverage;
@group(0) @binding(1) var<storage, read> transmittance: array<f32>;  // as in blend.wgsl
@group(0) @binding(2) var<storage, read> cover: array<u32>;  // alpha in 16 bits, then 1 where known, 2 where kept
@group(0) @binding(3) var<storage, read_write> gradient: array<f32>;  // [H W][CHANNELS + 1]

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let p = group_number(group, groups) * 256u + lane;
    if (p >= coverage.n_pixels) {
        return;
    }
    let difference = 1.0 - transmittance[p] - f32(cover[p] & 0xffffu) / 65535.0;
    var slope = 0.0;
    if ((cover[p] & 0x10000u) != 0u) {
        slope -= sign(difference) * coverage.by_known;
    }
    if ((cover[p] & 0x20000u) != 0u && difference < 0.0) {
        slope += coverage.by_kept;
    }
    gradient[p * (CHANNELS + 1u) + CHANNELS] = slope;
}
