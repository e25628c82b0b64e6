// Constants of one training step, and Adam (adam.py) for one value. A group of values has its own step size.
struct Optimiser {
    n: u32,
    n_background: u32,   // the first so many Gaussians train their channels alone
    n_sh: u32,
    n_channels: u32,
    unit_channels: u32,  // whether channels are features divided by their length
    capacity: u32,       // pairs of a tile and a Gaussian
    index: u32,          // of the step since the status was cleared
    first: u32,          // Gaussian of a part of the harmonics
    beta1: f32,
    beta2: f32,
    one_minus_beta1: f32,
    one_minus_beta2: f32,
    eps: f32,
    view: u32,           // row of `exposure` that this step has a gradient of
    n_views: u32,        // rows of `exposure`
    unused: u32,
    groups: array<vec4<f32>, 8>,  // step size, root of the correction of v, 1 if the group is trained
}

const MEANS: u32 = 0u;
const QUATS: u32 = 1u;
const LOG_SCALES: u32 = 2u;
const OPACITY_LOGITS: u32 = 3u;
const SH_DC: u32 = 4u;
const SH_REST: u32 = 5u;
const FEATURES: u32 = 6u;
const EXPOSURE: u32 = 7u;

// Status: why no step is made any more (0: steps are made), steps made, pairs wanted, then the loss of each step.
const HALTED: u32 = 0u;
const MADE: u32 = 1u;
const WANTED: u32 = 2u;
const LOSSES: u32 = 3u;
const TOO_MANY_PAIRS: u32 = 16u;

// New mean and square of the gradient, and what is subtracted from the value.
fn adam(gradient: f32, mean: f32, square: f32, group: u32) -> vec3<f32> {
    let m = optimiser.beta1 * mean + optimiser.one_minus_beta1 * gradient;
    let v = optimiser.beta2 * square + optimiser.one_minus_beta2 * gradient * gradient;
    let factors = optimiser.groups[group];
    return vec3<f32>(m, v, factors.x * m / (sqrt(v) * factors.y + optimiser.eps));
}

fn is_trained(group: u32) -> bool {
    return optimiser.groups[group].z > 0.0;
}
