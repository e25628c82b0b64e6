// The backward pass of blending takes the list of a tile in `view.segments` parts at a time. What lies behind a part is summed
// by blend_rest.wgsl, and is kept behind the batches in `transmittance`: [segments - 1][tiles][256] sums of w (color . g), of
// all parts but the first.

// First batch of 32 Gaussians of a part, and its end.
fn segment_batches(n_batches: u32, segments: u32, segment: u32) -> vec2<u32> {
    let size = (n_batches + segments - 1u) / segments;
    let first = min(segment * size, n_batches);
    return vec2<u32>(first, min(first + size, n_batches));
}

// Place of the sums of a part of a tile in `transmittance`.
fn segment_sums(n_pixels: u32, capacity: u32, n_tiles: u32, segment: u32, tile: u32) -> u32 {
    return 2u * n_pixels + 256u * (capacity / 32u + n_tiles + (segment - 1u) * n_tiles + tile);
}
