//needs optimiser
// Adam on spherical harmonics in blocks of 64 Gaussians; the first band has a step size of its own.
@group(0) @binding(0) var<uniform> optimiser: Optimiser;
@group(0) @binding(1) var<storage, read> gradients: array<f32>;
@group(0) @binding(2) var<storage, read_write> sh: array<f32>;
@group(0) @binding(3) var<storage, read_write> mean: array<f32>;
@group(0) @binding(4) var<storage, read_write> square: array<f32>;
@group(0) @binding(5) var<storage, read> skipped: array<u32>;

@compute @workgroup_size(128)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let i = group_number(group, groups) * 128u + lane;
    let row = 3u * optimiser.n_sh;
    let g = optimiser.first + i / (64u * row) * 64u + i % 64u;
    let part = select(SH_REST, SH_DC, i / 64u % row < 3u);
    if (g >= optimiser.n || i >= arrayLength(&sh) || !is_trained(part) || skipped[0] >= REFUSED
        || skipped[g + 1u] != 0u) {
        return;
    }
    let moved = adam(select(0.0, gradients[i], g >= optimiser.n_background), mean[i], square[i], part);
    mean[i] = moved.x;
    square[i] = moved.y;
    sh[i] -= moved.z;
}
