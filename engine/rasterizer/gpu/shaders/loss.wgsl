// Picture and settings of a loss.
struct Loss {
    width: u32,
    height: u32,
    n_groups: u32,
    weight: f32,         // of a valid pixel
    by_similarity: f32,  // factors of the loss
    by_difference: f32,
}
