// Number of tiles of each Gaussian in the order of depth, for the scan; the last entry is 0.
@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> info: array<vec4<u32>>;
@group(0) @binding(2) var<storage, read> order: array<u32>;
@group(0) @binding(3) var<storage, read_write> offsets: array<u32>;

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let rank = group_number(group, groups) * 256u + lane;
    if (rank < view.n) {
        offsets[rank] = info[order[rank]].x >> 3u;
    } else if (rank == view.n) {
        offsets[rank] = 0u;
    }
}
