// Length that the channels of a Gaussian are divided by.
fn feature_length(g: u32) -> f32 {
    var squared = 0.0;
    for (var k = 0u; k < neighbours.n_features; k++) {
        let value = channels[g * neighbours.n_features + k];
        squared = fma(value, value, squared);
    }
    return max(sqrt(squared), NORM_MIN);
}
