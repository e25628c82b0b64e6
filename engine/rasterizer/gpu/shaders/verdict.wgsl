// Decides whether this step changes the Gaussians. After one that does not, no later one does, until the status is cleared.
@group(0) @binding(0) var<uniform> optimiser: Optimiser;
@group(0) @binding(1) var<storage, read> counts: array<u32>;
@group(0) @binding(2) var<storage, read> loss_values: array<f32>;
@group(0) @binding(3) var<storage, read_write> status: array<u32>;

@compute @workgroup_size(1)
fn main() {
    if (status[HALTED] != 0u) {
        return;
    }
    let found = counts[NOT_FINITE];
    if ((found & 1u) == 0u && counts[N_WANTED] > optimiser.capacity) {
        status[HALTED] = TOO_MANY_PAIRS;
        status[WANTED] = counts[N_WANTED];
    } else if (found != 0u) {
        status[HALTED] = found;
    } else {
        status[MADE] += 1u;
        status[LOSSES + optimiser.index] = bitcast<u32>(loss_values[0]);
    }
}
