// Picture and settings of a loss.
struct Loss {
    width: u32,
    height: u32,
    n_groups: u32,
    weight: f32,         // of a valid pixel
    by_similarity: f32,  // factors of the loss
    by_difference: f32,
    view: u32,           // row of `exposure` [views][3], the logarithms of the photos' brightness factors
    by_exposure: f32,    // factor of the sum of its squares
}
