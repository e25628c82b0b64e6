// Group of column `k` of the 11 columns of a Gaussian's row of gradients.
fn group_of(k: u32) -> u32 {
    return select(select(select(MEANS, QUATS, k >= 3u), LOG_SCALES, k >= 7u), OPACITY_LOGITS, k >= 10u);
}

// Derivative of the loss by the trained value in column `k` of row `g`; `gradients` is by scales and opacities.
fn row_gradient(g: u32, k: u32) -> f32 {
    let gradient = gradients[12u * g + k];
    if (k >= 10u) {
        let opacity = 1.0 / (1.0 + exp(-opacity_logits[g]));
        return (gradient * dropped(g, opacity).y + optimiser.by_opacity) * (1.0 - opacity) * opacity;
    }
    if (k >= 7u) {
        return (gradient + optimiser.by_scale) * exp(log_scales[3u * g + k - 7u]);
    }
    return gradient;
}
