var<workgroup> fours: array<vec4<f32>, 256>;

// As `tree_sum`, of four values; every invocation gets it.
fn tree_sum_4(lane: u32, value: vec4<f32>) -> vec4<f32> {
    workgroupBarrier();  // the result of an earlier sum has been read
    fours[lane] = value;
    workgroupBarrier();
    for (var step = 128u; step > 0u; step >>= 1u) {
        if (lane < step) {
            fours[lane] += fours[lane + step];
        }
        workgroupBarrier();
    }
    return fours[0];
}
