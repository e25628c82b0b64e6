// L_CC of one picture (losses.py of the processor's trainer), on a sample of its labelled pixels without repetition. A pixel
// that was drawn m times counts m times. Samples are ordered by segment.
struct Clustering {
    n_samples: u32,
    n_segments: u32,
    weight: f32,  // of the loss of a sample
    n_groups: u32,  // workgroups of clustering_losses
}

const FEATURES_4: u32 = CHANNELS / 4u;  // vectors of 4 for CHANNELS - 3 features, padded with zeros

// `samples`: pixel, segment, times drawn, 0. `segments`: first sample, end, times drawn, bits of log(pixels + 100).
// `centers` has FEATURES_4 + 1 vectors for each segment: the mean of its unit features, then 1 / temperature.
