// Similarity of sample `j` and the centre of segment `s`, over the temperature.
fn logit(j: u32, s: u32) -> f32 {
    let row = s * (FEATURES_4 + 1u);
    var similarity = 0.0;
    for (var q = 0u; q < FEATURES_4; q++) {
        similarity += dot(units[j * FEATURES_4 + q], centers[row + q]);
    }
    return similarity * centers[row + FEATURES_4].x;
}
