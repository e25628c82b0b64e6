//needs radix
@group(0) @binding(3) var<storage, read_write> digits: array<u32>;  // [256 digits][blocks]

var<workgroup> histogram: array<atomic<u32>, 256>;

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let block = group_number(group, groups);
    let n = counts[settings.length];
    let blocks = (n + SORT_BLOCK - 1u) / SORT_BLOCK;
    atomicStore(&histogram[lane], 0u);
    workgroupBarrier();
    for (var i = 0u; i < SORT_BLOCK; i += 256u) {
        let at = block * SORT_BLOCK + i + lane;
        if (at < n) {
            atomicAdd(&histogram[(keys[at] >> settings.shift) & 255u], 1u);
        }
    }
    workgroupBarrier();
    if (block < blocks) {
        digits[lane * blocks + block] = atomicLoad(&histogram[lane]);
    }
}
