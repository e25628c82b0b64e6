//needs search
// The upper words of the codes in the order of the lower ones.
@group(0) @binding(1) var<storage, read> high_codes: array<u32>;
@group(0) @binding(2) var<storage, read> order: array<u32>;
@group(0) @binding(3) var<storage, read_write> codes: array<u32>;

@compute @workgroup_size(128)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let i = group_number(group, groups) * 128u + lane;
    if (i < search.n) {
        codes[i] = high_codes[order[i]];
    }
}
