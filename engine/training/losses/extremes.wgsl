// The NEAR nearest and the FAR farthest Gaussians of a subset for each anchor, a workgroup each. Of equal ones any is taken.
struct Extremes {
    n_subset: u32,
    first: u32,    // anchor of the first workgroup
    n_anchors: u32,
}
@group(0) @binding(0) var<uniform> extremes: Extremes;
@group(0) @binding(1) var<storage, read> means: array<f32>;
@group(0) @binding(2) var<storage, read> subset: array<u32>;
@group(0) @binding(3) var<storage, read> anchors: array<u32>;
@group(0) @binding(4) var<storage, read_write> found: array<u32>;  // [anchors][NEAR + FAR], nearest and farthest first

const NEAR: u32 = 2u;
const FAR: u32 = 5u;
const LENGTH: u32 = 5u;
const LAST: f32 = 3.4e38;

// Ascending squares of distances, and for the farthest their negatives.
struct List {
    values: array<f32, LENGTH>,
    gaussians: array<u32, LENGTH>,
}
var<workgroup> heads: array<f32, 256>;
var<workgroup> lanes: array<u32, 256>;

fn insert(list: ptr<function, List>, value: f32, gaussian: u32, n: u32) {
    var moved = value;
    var moved_gaussian = gaussian;
    for (var k = 0u; k < n; k++) {
        if (moved < (*list).values[k]) {
            let other = (*list).values[k];
            let other_gaussian = (*list).gaussians[k];
            (*list).values[k] = moved;
            (*list).gaussians[k] = moved_gaussian;
            moved = other;
            moved_gaussian = other_gaussian;
        }
    }
}

// Takes the least value of all invocations from its list and returns whether it was that of this one.
fn takes(lane: u32, value: f32) -> bool {
    heads[lane] = value;
    lanes[lane] = lane;
    workgroupBarrier();
    for (var step = 128u; step > 0u; step >>= 1u) {
        if (lane < step && heads[lane + step] < heads[lane]) {
            heads[lane] = heads[lane + step];
            lanes[lane] = lanes[lane + step];
        }
        workgroupBarrier();
    }
    let winner = lanes[0];
    workgroupBarrier();
    return winner == lane;
}

fn pop(list: ptr<function, List>) -> u32 {
    let gaussian = (*list).gaussians[0];
    for (var k = 1u; k < LENGTH; k++) {
        (*list).values[k - 1u] = (*list).values[k];
        (*list).gaussians[k - 1u] = (*list).gaussians[k];
    }
    (*list).values[LENGTH - 1u] = LAST;
    return gaussian;
}

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let anchor = min(extremes.first + group_number(group, groups), extremes.n_anchors - 1u);
    let a = anchors[anchor];
    let place = vec3<f32>(means[3u * a], means[3u * a + 1u], means[3u * a + 2u]);
    var near: List;
    var far: List;
    for (var k = 0u; k < LENGTH; k++) {
        near.values[k] = LAST;
        far.values[k] = LAST;
        near.gaussians[k] = a;
        far.gaussians[k] = a;
    }
    for (var i = lane; i < extremes.n_subset; i += 256u) {
        let g = subset[i];
        let d = vec3<f32>(means[3u * g], means[3u * g + 1u], means[3u * g + 2u]) - place;
        let squared = dot(d, d);
        if (squared < near.values[NEAR - 1u]) {
            insert(&near, squared, g, NEAR);
        }
        if (-squared < far.values[FAR - 1u]) {
            insert(&far, -squared, g, FAR);
        }
    }
    for (var k = 0u; k < NEAR + FAR; k++) {
        let is_near = k < NEAR;
        if (takes(lane, select(far.values[0], near.values[0], is_near))) {
            if (is_near) {
                found[anchor * (NEAR + FAR) + k] = pop(&near);
            } else {
                found[anchor * (NEAR + FAR) + k] = pop(&far);
            }
        }
    }
}
