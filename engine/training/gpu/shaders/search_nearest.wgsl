//needs search
// The CHANNELS nearest other Gaussians of each, the nearest first.
@group(0) @binding(1) var<storage, read> points: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> boxes: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> found: array<u32>;  // [N][CHANNELS]

var<private> distances: array<f32, CHANNELS>;  // squares, ascending
var<private> nearest: array<u32, CHANNELS>;

// Rounding is monotonous, so that no point in a box is nearer than the box.
fn squared(d: vec3<f32>) -> f32 {
    return fma(d.z, d.z, fma(d.y, d.y, d.x * d.x));
}

// Compares all points of a leaf but `own` with those found.
fn take(leaf: u32, own: u32, place: vec3<f32>) {
    for (var i = leaf * BRANCHES; i < min((leaf + 1u) * BRANCHES, search.n); i++) {
        let point = points[i];
        var distance = squared(point.xyz - place);
        if (i == own || distance >= distances[CHANNELS - 1u]) {
            continue;
        }
        var gaussian = bitcast<u32>(point.w);
        for (var k = 0u; k < CHANNELS; k++) {
            if (distance < distances[k]) {
                let other = distances[k];
                let other_gaussian = nearest[k];
                distances[k] = distance;
                nearest[k] = gaussian;
                distance = other;
                gaussian = other_gaussian;
            }
        }
    }
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let own = search.first + group_number(group, groups) * 64u + lane;
    if (own >= search.end) {
        return;
    }
    let place = points[own].xyz;
    let gaussian = bitcast<u32>(points[own].w);
    for (var k = 0u; k < CHANNELS; k++) {
        distances[k] = 3.4e38;
        nearest[k] = gaussian;
    }
    // The leaves beside its own give a first bound.
    let n_leaves = search.levels[0].y;
    let own_leaf = own / BRANCHES;
    let first_leaf = max(own_leaf, 1u) - 1u;
    let end_leaf = min(own_leaf + 2u, n_leaves);
    for (var leaf = first_leaf; leaf < end_leaf; leaf++) {
        take(leaf, own, place);
    }
    let top = search.level;
    var level = top;
    var node = 0u;
    while (node < search.levels[level].y) {
        let at = 2u * (search.levels[level].x + node);
        let gap = max(max(boxes[at].xyz - place, place - boxes[at + 1u].xyz), vec3<f32>(0.0));
        if (squared(gap) < distances[CHANNELS - 1u]) {
            if (level > 0u) {
                level -= 1u;
                node *= BRANCHES;
                continue;
            }
            if (node < first_leaf || node >= end_leaf) {
                take(node, own, place);
            }
        }
        node += 1u;
        while (level < top && (node % BRANCHES == 0u || node >= search.levels[level].y)) {
            node = (node + BRANCHES - 1u) / BRANCHES;
            level += 1u;
        }
    }
    for (var k = 0u; k < CHANNELS; k++) {
        found[gaussian * CHANNELS + k] = nearest[k];
    }
}
