// What a first picture counted: kept while a second one is computed, and then joined with what that counted.
struct Keep {
    unused: u32,
    adds: u32,
}
@group(0) @binding(0) var<uniform> keep: Keep;
@group(0) @binding(1) var<storage, read_write> counts: array<u32>;
@group(0) @binding(2) var<storage, read_write> kept: array<u32>;

@compute @workgroup_size(1)
fn main() {
    if (keep.adds != 0u) {
        counts[N_WANTED] = max(counts[N_WANTED], kept[N_WANTED]);
        counts[NOT_FINITE] |= kept[NOT_FINITE];
        return;
    }
    for (var i = 1u; i < 4u; i++) {
        kept[i] = counts[i];
        counts[i] = 0u;
    }
}
