// L_reg (`neighbour_regulariser` of the processor's trainer): features of neighbours are pulled together, of distant Gaussians
// pushed apart. `anchors`: rows of 1 + NEAR + TRIES Gaussians: the anchor, its neighbours, and candidates for distant ones.
struct Neighbours {
    n_anchors: u32,
    n_rows: u32,        // distinct Gaussians in `anchors`
    n_near: u32,
    n_tries: u32,
    max_far: u32,       // so many distant candidates count, from the first on
    n_features: u32,
    far: f32,           // distance of distant Gaussians
    by_pull: f32,
    by_push: f32,
    unused_0: u32,
    unused_1: u32,
    unused_2: u32,
}
