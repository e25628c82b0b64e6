//needs optimiser
// Decides whether this step changes the Gaussians. After one that does not, no later one does, until the status is cleared.
// A step that is refused for its gradient alone has a loss, random walk and limits.
@group(0) @binding(0) var<uniform> optimiser: Optimiser;
@group(0) @binding(1) var<storage, read> counts: array<u32>;
@group(0) @binding(2) var<storage, read> loss_values: array<f32>;
@group(0) @binding(3) var<storage, read_write> status: array<u32>;
@group(0) @binding(4) var<storage, read_write> skipped: array<u32>;

@compute @workgroup_size(1)
fn main() {
    let found = counts[NOT_FINITE];
    if (status[HALTED] == 0u) {
        if ((found & 1u) == 0u && counts[N_WANTED] > optimiser.capacity) {
            status[HALTED] = TOO_MANY_PAIRS;
            status[WANTED] = counts[N_WANTED];
        } else if (found != 0u) {
            status[HALTED] = found;
        } else if (skipped[0] == optimiser.n) {
            status[HALTED] = ALL_LEFT_OUT;
        } else {
            status[MADE] += 1u;
            status[LEFT_OUT] += skipped[0];
        }
        status[LOSSES + optimiser.index] = bitcast<u32>(loss_values[0]);
        if (status[HALTED] != 0u && status[HALTED] != TOO_MANY_PAIRS && (status[HALTED] & 5u) == 0u) {
            skipped[0] = REFUSED;
            return;
        }
    }
    if (status[HALTED] != 0u) {
        skipped[0] = NO_STEP;
    }
}
