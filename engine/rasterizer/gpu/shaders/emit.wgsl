//needs tiles
// Lists the tiles of each Gaussian, nearest Gaussian first: pair i has a tile and a Gaussian.
@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> geometry: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> info: array<vec4<u32>>;
@group(0) @binding(3) var<storage, read> order: array<u32>;
@group(0) @binding(4) var<storage, read> offsets: array<u32>;
@group(0) @binding(5) var<storage, read_write> pair_tiles: array<u32>;
@group(0) @binding(6) var<storage, read_write> pair_gaussians: array<u32>;
@group(0) @binding(7) var<storage, read_write> ranges: array<vec2<u32>>;  // of each Gaussian: first pair, end
@group(0) @binding(8) var<storage, read> counts: array<u32>;

@compute @workgroup_size(128)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let rank = group_number(group, groups) * 128u + lane;
    if (rank >= view.n) {
        return;
    }
    let g = order[rank];
    // Never beyond the buffers, even if the sum of the counts overflowed.
    let end = min(offsets[rank + 1u], counts[N_PAIRS]);
    var at = min(offsets[rank], end);
    ranges[g] = vec2<u32>(at, end);
    if (at == end) {
        return;
    }
    let first = geometry[2u * g];
    let second = geometry[2u * g + 1u];
    let center = vec2<f32>(bitcast<f32>(info[g].z), bitcast<f32>(info[g].w));
    let spans = tile_rows(view.height, center, first.z, first.w, second.x, second.y);
    for (var row = spans.first; row < spans.end; row++) {
        let span = tile_span(spans, row, view.height, view.columns);
        for (var column = span.x; column < span.y && at < end; column++) {
            pair_tiles[at] = u32(row) * view.columns + u32(column);
            pair_gaussians[at] = g;
            at += 1u;
        }
    }
    for (; at < end; at++) {  // a slot without a tile would hold what was there before
        pair_tiles[at] = view.n_tiles;
        pair_gaussians[at] = g;
    }
}
