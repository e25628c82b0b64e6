//needs radix
@group(0) @binding(3) var<storage, read> values: array<u32>;
@group(0) @binding(4) var<storage, read> digits: array<u32>;  // first position of [256 digits][blocks]
@group(0) @binding(5) var<storage, read_write> sorted_keys: array<u32>;
@group(0) @binding(6) var<storage, read_write> sorted_values: array<u32>;

var<workgroup> next_position: array<u32, 256>;
var<workgroup> team_counts: array<u32, 2048>;           // [8 teams of 32 invocations][256 digits]
var<workgroup> team_bits: array<atomic<u32>, 72>;       // [8 teams][8 bits and validity]

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let block = group_number(group, groups);
    let n = counts[settings.length];
    let blocks = (n + SORT_BLOCK - 1u) / SORT_BLOCK;
    let team = lane >> 5u;
    let bit = 1u << (lane & 31u);
    next_position[lane] = select(0u, digits[lane * blocks + min(block, blocks - 1u)], blocks > 0u);
    for (var i = 0u; i < SORT_BLOCK; i += 256u) {
        for (var k = 0u; k < 8u; k++) {
            team_counts[k * 256u + lane] = 0u;
        }
        let at = block * SORT_BLOCK + i + lane;
        let valid = at < n;
        let key = keys[min(at, max(n, 1u) - 1u)];
        let digit = (key >> settings.shift) & 255u;
        // `peers`: the invocations of the team with the same digit.
        var peers = 0xffffffffu;
        if (lane < 72u) {
            atomicStore(&team_bits[lane], 0u);
        }
        workgroupBarrier();
        for (var k = 0u; k < 8u; k++) {
            if (((digit >> k) & 1u) == 1u) {
                atomicOr(&team_bits[team * 9u + k], bit);
            }
        }
        if (valid) {
            atomicOr(&team_bits[team * 9u + 8u], bit);
        }
        workgroupBarrier();
        for (var k = 0u; k < 8u; k++) {
            let ones = atomicLoad(&team_bits[team * 9u + k]);
            peers &= select(~ones, ones, ((digit >> k) & 1u) == 1u);
        }
        peers &= atomicLoad(&team_bits[team * 9u + 8u]);
        let rank = countOneBits(peers & (bit - 1u));
        if (valid && rank == 0u) {
            team_counts[team * 256u + digit] = countOneBits(peers);
        }
        workgroupBarrier();
        if (valid) {
            var position = next_position[digit] + rank;
            for (var k = 0u; k < team; k++) {
                position += team_counts[k * 256u + digit];
            }
            sorted_keys[position] = key;
            sorted_values[position] = select(values[at], at, settings.numbers != 0u);
        }
        workgroupBarrier();
        for (var k = 0u; k < 8u; k++) {
            next_position[lane] += team_counts[k * 256u + lane];
        }
    }
}
