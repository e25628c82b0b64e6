// Range of each tile in the sorted pairs, and of each sorted pair the Gaussian and the number of the pair.
@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> tiles: array<u32>;
@group(0) @binding(2) var<storage, read> pairs: array<u32>;
@group(0) @binding(3) var<storage, read> pair_gaussians: array<u32>;
@group(0) @binding(4) var<storage, read> counts: array<u32>;
@group(0) @binding(5) var<storage, read_write> tile_ranges: array<u32>;
@group(0) @binding(6) var<storage, read_write> entries: array<vec2<u32>>;

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let i = group_number(group, groups) * 256u + lane;
    let n = counts[N_PAIRS];
    if (i >= n) {
        return;
    }
    entries[i] = vec2<u32>(pair_gaussians[pairs[i]], pairs[i]);
    let tile = tiles[i];
    if (tile >= view.n_tiles) {
        return;
    }
    if (i == 0u || tiles[i - 1u] != tile) {
        tile_ranges[2u * tile] = i;
    }
    if (i + 1u == n || tiles[i + 1u] != tile) {
        tile_ranges[2u * tile + 1u] = i + 1u;
    }
}
