//needs loss tree_sum
// Gradient of the channels after the colours and of the transmittance, and sums of the disagreement along rays: A^2 - |F|^2
// with A = 1 - T and blended unit features F.
@group(0) @binding(0) var<uniform> loss: Loss;
@group(0) @binding(1) var<storage, read> image: array<f32>;
@group(0) @binding(2) var<storage, read> transmittance: array<f32>;  // as in blend.wgsl
@group(0) @binding(3) var<storage, read> given: array<f32>;          // [H W][CHANNELS - 3], gradient of a further loss
@group(0) @binding(4) var<storage, read_write> gradient: array<f32>;
@group(0) @binding(5) var<storage, read_write> ray_sums: array<vec2<f32>>;

// Of `k` from 0 to CHANNELS - 4 a channel, and then the transmittance: neighbouring invocations have neighbouring values.
// Returns its part of the disagreement.
fn of_value(p: u32, k: u32) -> f32 {
    let n = CHANNELS - 3u;
    let at = p * (CHANNELS + 1u) + 3u + k;
    if (k == n) {
        let cover = 1.0 - transmittance[p];
        gradient[at] = select(-2.0 * loss.by_ray * cover, 0.0, loss.detached != 0u);
        return cover * cover;
    }
    let value = image[p * CHANNELS + 3u + k];
    var slope = select(0.0, -2.0 * loss.by_ray * value, loss.by_ray > 0.0);
    if (loss.with_given != 0u) {
        slope += given[p * n + k];
    }
    gradient[at] = slope;
    return -value * value;
}

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let block = min(group_number(group, groups), loss.n_groups - 1u);
    var own = 0.0;
    // As many workgroups as tiles have all pixels of the picture between them.
    for (var turn = 0u; turn < CHANNELS - 2u; turn++) {
        let i = turn * 256u + lane;
        let p = block * 256u + i / (CHANNELS - 2u);
        if (p < loss.width * loss.height) {
            own += of_value(p, i % (CHANNELS - 2u));
        }
    }
    let total = tree_sum(lane, vec2<f32>(own, 0.0));
    if (lane == 0u) {
        ray_sums[block] = total;
    }
}
