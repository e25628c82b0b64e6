//needs optimiser
// As find_overflow, for harmonics in blocks of 64 Gaussians; also sets a flag where one is not finite.
@group(0) @binding(0) var<uniform> optimiser: Optimiser;
@group(0) @binding(1) var<storage, read> gradients: array<f32>;
@group(0) @binding(2) var<storage, read_write> skipped: array<atomic<u32>>;
@group(0) @binding(3) var<storage, read_write> counts: array<atomic<u32>>;

@compute @workgroup_size(128)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let i = group_number(group, groups) * 128u + lane;
    let g = optimiser.first + i / (192u * optimiser.n_sh) * 64u + i % 64u;
    if (g >= optimiser.n || i >= arrayLength(&gradients) || !square_overflows(gradients[i])) {
        return;
    }
    if (!is_finite(gradients[i])) {
        atomicOr(&counts[NOT_FINITE], 8u);
    }
    if (atomicOr(&skipped[g + 1u], 1u) == 0u) {
        atomicAdd(&skipped[0], 1u);
    }
}
