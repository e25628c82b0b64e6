// Search for the nearest Gaussians. Points are sorted by a Morton code, and the boxes around 8 neighbours each, around 8 such
// boxes and so on are a tree: an exact search leaves out the boxes that are farther than what it has found.
struct Search {
    n: u32,
    first: u32,     // point or box that the dispatch begins with
    end: u32,
    level: u32,     // of the boxes that are made; the highest one of the search
    stride: u32,    // of the sample
    unused: u32,
    scale: f32,     // of the scene, and its middle
    center_x: f32,
    center_y: f32,
    center_z: f32,
    levels: array<vec4<u32>, 12>,  // first box, number of boxes
}
@group(0) @binding(0) var<uniform> search: Search;

const BRANCHES: u32 = 8u;
