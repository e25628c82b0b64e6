//needs search
// Boxes of one level: around points for level 0, else around boxes of the level below.
@group(0) @binding(1) var<storage, read> points: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> boxes: array<vec4<f32>>;  // lowest and highest corner of each

@compute @workgroup_size(128)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let i = group_number(group, groups) * 128u + lane;
    if (i >= search.end) {
        return;
    }
    let first = i * BRANCHES;
    var low: vec4<f32>;
    var high: vec4<f32>;
    if (search.level == 0u) {
        low = points[first];
        high = low;
        for (var j = first + 1u; j < min(first + BRANCHES, search.n); j++) {
            low = min(low, points[j]);
            high = max(high, points[j]);
        }
    } else {
        let below = search.levels[search.level - 1u];
        low = boxes[2u * (below.x + first)];
        high = boxes[2u * (below.x + first) + 1u];
        for (var j = first + 1u; j < min(first + BRANCHES, below.y); j++) {
            low = min(low, boxes[2u * (below.x + j)]);
            high = max(high, boxes[2u * (below.x + j) + 1u]);
        }
    }
    let at = 2u * (search.levels[search.level].x + i);
    boxes[at] = low;
    boxes[at + 1u] = high;
}
