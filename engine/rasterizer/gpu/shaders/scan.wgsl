// Exclusive prefix sum in place, in blocks of 1024 values: `reduce` sums each block, `main` adds the sums before it.
struct Scan {
    length: u32,       // index in `counts`
    per_block: u32,    // 0: that many values; else the digits of a radix pass: 256 ceil(counts / per_block)
}
@group(0) @binding(0) var<uniform> settings: Scan;
@group(0) @binding(1) var<storage, read> counts: array<u32>;
@group(0) @binding(2) var<storage, read_write> values: array<u32>;
@group(0) @binding(3) var<storage, read_write> sums: array<u32>;

var<workgroup> shared_sums: array<u32, 256>;

fn scan_length() -> u32 {
    let n = counts[settings.length];
    if (settings.per_block == 0u) {
        return n + 1u;
    }
    return 256u * ((n + settings.per_block - 1u) / settings.per_block);
}

fn sum_of_group(lane: u32, value: u32) -> u32 {
    shared_sums[lane] = value;
    workgroupBarrier();
    for (var step = 128u; step > 0u; step >>= 1u) {
        if (lane < step) {
            shared_sums[lane] += shared_sums[lane + step];
        }
        workgroupBarrier();
    }
    let total = shared_sums[0];
    workgroupBarrier();
    return total;
}

@compute @workgroup_size(256)
fn reduce(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
          @builtin(local_invocation_index) lane: u32) {
    let block = group_number(group, groups);
    let n = scan_length();
    var total = 0u;
    for (var i = 0u; i < SCAN_BLOCK; i += 256u) {
        let at = block * SCAN_BLOCK + i + lane;
        if (at < n) {
            total += values[at];
        }
    }
    total = sum_of_group(lane, total);
    if (lane == 0u && block * SCAN_BLOCK < n) {
        sums[block] = total;
    }
}

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let block = group_number(group, groups);
    let n = scan_length();
    var before = 0u;
    for (var i = lane; i < block && i * SCAN_BLOCK < n; i += 256u) {
        before += sums[i];
    }
    before = sum_of_group(lane, before);
    var own: array<u32, 4>;
    var total = 0u;
    let first = block * SCAN_BLOCK + 4u * lane;
    for (var k = 0u; k < 4u; k++) {
        own[k] = 0u;
        if (first + k < n) {
            own[k] = values[first + k];
        }
        total += own[k];
    }
    // Hillis and Steele: inclusive sums of the 256 invocations.
    shared_sums[lane] = total;
    workgroupBarrier();
    for (var step = 1u; step < 256u; step <<= 1u) {
        var other = 0u;
        if (lane >= step) {
            other = shared_sums[lane - step];
        }
        workgroupBarrier();
        shared_sums[lane] += other;
        workgroupBarrier();
    }
    var at = before + shared_sums[lane] - total;
    for (var k = 0u; k < 4u; k++) {
        if (first + k < n) {
            values[first + k] = at;
        }
        at += own[k];
    }
}
