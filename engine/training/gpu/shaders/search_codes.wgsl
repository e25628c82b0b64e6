//needs search
// Morton codes of 3 times 20 bits, in two words. Coordinates are squeezed from all numbers to -1 to 1, so that distant points
// have cells of their own, and near the middle cells are small.
@group(0) @binding(1) var<storage, read> means: array<f32>;
@group(0) @binding(2) var<storage, read_write> low_codes: array<u32>;
@group(0) @binding(3) var<storage, read_write> high_codes: array<u32>;

// The lowest 10 bits of `x`, with two zeros between them.
fn spread(x: u32) -> u32 {
    var bits = x & 0x3ffu;
    bits = (bits | (bits << 16u)) & 0x030000ffu;
    bits = (bits | (bits << 8u)) & 0x0300f00fu;
    bits = (bits | (bits << 4u)) & 0x030c30c3u;
    return (bits | (bits << 2u)) & 0x09249249u;
}

@compute @workgroup_size(128)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let g = group_number(group, groups) * 128u + lane;
    if (g >= search.n) {
        return;
    }
    let center = vec3<f32>(search.center_x, search.center_y, search.center_z);
    let d = (vec3<f32>(means[3u * g], means[3u * g + 1u], means[3u * g + 2u]) - center) / search.scale;
    let squeezed = d / (1.0 + abs(d));
    let cell = vec3<u32>(clamp((squeezed + 1.0) * 524288.0, vec3<f32>(0.0), vec3<f32>(1048575.0)));
    low_codes[g] = spread(cell.x) | (spread(cell.y) << 1u) | (spread(cell.z) << 2u);
    high_codes[g] = spread(cell.x >> 10u) | (spread(cell.y >> 10u) << 1u) | (spread(cell.z >> 10u) << 2u);
}
