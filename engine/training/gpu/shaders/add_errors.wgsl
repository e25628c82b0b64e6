//needs optimiser
// Adds the gradient by the first colour of each Gaussian to `errors`. The status tells what was wrong with any picture.
@group(0) @binding(0) var<uniform> optimiser: Optimiser;
@group(0) @binding(1) var<storage, read> totals: array<f32>;
@group(0) @binding(2) var<storage, read> counts: array<u32>;
@group(0) @binding(3) var<storage, read_write> errors: array<f32>;
@group(0) @binding(4) var<storage, read_write> status: array<u32>;

@compute @workgroup_size(128)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let g = group_number(group, groups) * 128u + lane;
    if (g >= optimiser.n) {
        return;
    }
    errors[g] += totals[4u * (CHUNKS + 2u) * g + 8u];
    if (g > 0u) {
        return;
    }
    let found = counts[NOT_FINITE];
    if ((found & 1u) == 0u && counts[N_WANTED] > optimiser.capacity) {
        status[WANTED] = max(status[WANTED], counts[N_WANTED]);
        status[HALTED] = select(status[HALTED], TOO_MANY_PAIRS, status[HALTED] == 0u);
    } else if (found != 0u) {
        status[HALTED] = select(status[HALTED], found, status[HALTED] == 0u);
    }
}
