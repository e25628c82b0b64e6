// The error of each pixel, mean |image - photo| over the colours, as the gradient of the first channel, and 0 for the others:
// the sum over a Gaussian's pixels of weight times error is then the gradient by its first colour.
struct Errors {
    n_pixels: u32,
}
@group(0) @binding(0) var<uniform> errors: Errors;
@group(0) @binding(1) var<storage, read> image: array<f32>;
@group(0) @binding(2) var<storage, read> photo: array<u32>;  // as in similarity.wgsl
@group(0) @binding(3) var<storage, read_write> gradient: array<f32>;  // [H W][CHANNELS + 1]
@group(0) @binding(4) var<storage, read_write> counts: array<atomic<u32>>;

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let p = group_number(group, groups) * 256u + lane;
    if (p >= errors.n_pixels) {
        return;
    }
    let word = photo[p];
    var error = 0.0;
    for (var c = 0u; c < 3u && word >> 24u != 0u; c++) {
        error += abs(image[p * CHANNELS + c] - f32((word >> (8u * c)) & 0xffu) * BYTE);
    }
    if (!is_finite(error)) {
        atomicOr(&counts[NOT_FINITE], 4u);
    }
    gradient[p * (CHANNELS + 1u)] = error / 3.0;
    for (var k = 1u; k <= CHANNELS; k++) {
        gradient[p * (CHANNELS + 1u) + k] = 0.0;
    }
}
