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
    by_opacity: f32,     // derivative of the loss by each opacity and by each scale that terms of their own have
    by_scale: f32,
    center_x: f32,       // centre of the cube that means stay in, half of its side
    center_y: f32,
    center_z: f32,
    max_distance: f32,
    log_max_scale: f32,
    log_min_scale: f32,
    log_max_aspect: f32,
    max_logit: f32,
    dropout: f32,        // share of the Gaussians that are left out of the picture
    max_raised: f32,     // largest opacity of the others
    seed: u32,           // keys of the draws
    step: u32,
    with_limits: u32,    // whether limits.wgsl does anything in this step
    unused_1: u32,
    unused_0: u32,
    groups: array<vec4<f32>, 8>,  // step size, root of the correction of v, 1 if it is trained, largest change
}

const MEANS: u32 = 0u;
const QUATS: u32 = 1u;
const LOG_SCALES: u32 = 2u;
const OPACITY_LOGITS: u32 = 3u;
const SH_DC: u32 = 4u;
const SH_REST: u32 = 5u;
const FEATURES: u32 = 6u;
const EXPOSURE: u32 = 7u;

// Status: why no step is made any more (0: steps are made), steps made, pairs wanted, Gaussians at each limit, Gaussians
// left out by an overflow, then the loss of each step.
const HALTED: u32 = 0u;
const MADE: u32 = 1u;
const WANTED: u32 = 2u;
const AT_LIMIT: u32 = 3u;  // 4 values: scales, opacities, means, quats
const LEFT_OUT: u32 = 7u;
const LOSSES: u32 = 8u;
const TOO_MANY_PAIRS: u32 = 16u;
const ALL_LEFT_OUT: u32 = 32u;

// `skipped`: the number of Gaussians with a gradient whose square overflows, then 1 for each of them. Instead of the number
// REFUSED: a step without Adam; NO_STEP: nothing changes.
const REFUSED: u32 = 0xfffffffeu;
const NO_STEP: u32 = 0xffffffffu;

// Whether the square of `x` is not finite: from 2^64 on. A compiler may assume that a product is finite, so bits are read.
fn square_overflows(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7fffffffu) >= 0x5f800000u;
}

// New mean and square of the gradient, and what is subtracted from the value.
fn adam(gradient: f32, mean: f32, square: f32, group: u32) -> vec3<f32> {
    let m = optimiser.beta1 * mean + optimiser.one_minus_beta1 * gradient;
    let v = optimiser.beta2 * square + optimiser.one_minus_beta2 * gradient * gradient;
    let factors = optimiser.groups[group];
    let change = factors.x * m / (sqrt(v) * factors.y + optimiser.eps);
    return vec3<f32>(m, v, clamp(change, -factors.w, factors.w));
}

fn is_trained(group: u32) -> bool {
    return optimiser.groups[group].z > 0.0;
}
