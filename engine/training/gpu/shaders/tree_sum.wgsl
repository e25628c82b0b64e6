var<workgroup> sums: array<vec2<f32>, 256>;

// Sum over the 256 invocations of a workgroup in a fixed order; invocation 0 gets it.
fn tree_sum(lane: u32, value: vec2<f32>) -> vec2<f32> {
    sums[lane] = value;
    workgroupBarrier();
    for (var step = 128u; step > 0u; step >>= 1u) {
        if (lane < step) {
            sums[lane] += sums[lane + step];
        }
        workgroupBarrier();
    }
    return sums[0];
}
