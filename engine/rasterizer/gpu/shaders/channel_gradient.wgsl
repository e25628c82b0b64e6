// Length that the features of a Gaussian are divided by, and the part of their gradient that changes the length alone.
fn feature_scale(g: u32) -> vec2<f32> {
    let n = optimiser.n_channels;
    if (optimiser.unit_channels == 0u) {
        return vec2<f32>(1.0, 0.0);
    }
    var squared = 0.0;
    var along = 0.0;
    for (var k = 0u; k < n; k++) {
        squared = fma(features[g * n + k], features[g * n + k], squared);
        along = fma(totals[channel_total(g, k)], channels[g * n + k], along);
    }
    let length = sqrt(squared);
    return vec2<f32>(max(length, NORM_MIN), select(0.0, along, length > NORM_MIN));
}

// Place of the gradient of a channel in `totals`, whose rows have 4 (CHUNKS + 2) values, the channels' last.
fn channel_total(g: u32, k: u32) -> u32 {
    return 4u * (CHUNKS + 2u) * g + 8u + CHANNELS - optimiser.n_channels + k;
}

// Derivative of the loss by feature `k`.
fn feature_gradient(g: u32, k: u32, scale: vec2<f32>) -> f32 {
    return (totals[channel_total(g, k)] - scale.y * channels[g * optimiser.n_channels + k]) / scale.x;
}
