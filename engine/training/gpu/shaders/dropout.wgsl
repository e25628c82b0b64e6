// Dropout of Gaussians in one picture (`drop` of the processor's trainer).
const DROPOUT: u32 = 6u;  // purpose of the draws

// The opacity that Gaussian `g` of this `opacity` is rendered with, and its derivative.
fn dropped(g: u32, opacity: f32) -> vec2<f32> {
    if (optimiser.dropout == 0.0) {
        return vec2<f32>(opacity, 1.0);
    }
    var factor = 1.0;
    if (g >= optimiser.n_background) {
        let bits = philox(vec4<u32>(g, optimiser.step, DROPOUT, 0u), vec2<u32>(optimiser.seed, 0u)).x;
        let draw = f32(bits >> 8u) * 5.9604644775390625e-8;
        factor = select(0.0, 1.0 / (1.0 - optimiser.dropout), draw >= optimiser.dropout);
    }
    let raised = opacity * factor;
    return vec2<f32>(min(raised, optimiser.max_raised), select(factor, 0.0, raised > optimiser.max_raised));
}
