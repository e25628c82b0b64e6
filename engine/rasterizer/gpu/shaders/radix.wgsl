// Declarations of the three steps of a radix pass over 8 bits: count, scan (scan.wgsl) and scatter. Reduce then scan:
// no workgroup waits for another one.
struct Pass {
    shift: u32,
    length: u32,  // index in `counts` of the number of keys
    numbers: u32,  // whether the values are the numbers of the keys, and `values` is not read
}
@group(0) @binding(0) var<uniform> settings: Pass;
@group(0) @binding(1) var<storage, read> counts: array<u32>;
@group(0) @binding(2) var<storage, read> keys: array<u32>;
