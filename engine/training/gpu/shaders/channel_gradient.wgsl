// Place of the gradient of a channel in `totals`, whose rows have 4 (CHUNKS + 2) values, the channels' last.
fn channel_total(g: u32, k: u32) -> u32 {
    return 4u * (CHUNKS + 2u) * g + 8u + CHANNELS - optimiser.n_channels + k;
}

// Derivative of the loss by feature `k`; `scale` is that of find_overflow.wgsl.
fn feature_gradient(g: u32, k: u32, scale: vec2<f32>) -> f32 {
    return (totals[channel_total(g, k)] - scale.y * channels[g * optimiser.n_channels + k]) / scale.x;
}
