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
    n_gaussian_groups: u32,
    by_opacity: f32,     // factors of the sums of opacities and scales
    by_scale: f32,
    by_ray: f32,         // factor of the sum over the pixels of the disagreement along rays
    detached: u32,       // whether that changes no transmittance
    with_given: u32,     // whether `given` is a gradient
    unused_0: u32,
    unused_1: u32,
}
