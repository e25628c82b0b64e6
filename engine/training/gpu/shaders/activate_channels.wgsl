//needs optimiser
// Channels after the colours: features, divided by their length or not. 8 invocations for each Gaussian, as in
// find_overflow.wgsl.
@group(0) @binding(0) var<uniform> optimiser: Optimiser;
@group(0) @binding(1) var<storage, read> features: array<f32>;
@group(0) @binding(2) var<storage, read_write> channels: array<f32>;
@group(0) @binding(3) var<storage, read_write> status: array<atomic<u32>>;

var<workgroup> parts: array<f32, 128>;

@compute @workgroup_size(128)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let g = group_number(group, groups) * 16u + (lane >> 3u);
    let first = lane & 7u;
    let n = optimiser.n_channels;
    var part = 0.0;
    var finite = true;
    for (var k = first; k < n && g < optimiser.n; k += 8u) {
        let feature = features[g * n + k];
        finite = finite && is_finite(feature);
        part = fma(feature, feature, part);
    }
    parts[lane] = part;
    workgroupBarrier();
    if (g >= optimiser.n) {
        return;
    }
    var length = 1.0;
    if (optimiser.unit_channels != 0u) {
        var squared = 0.0;
        for (var other = 0u; other < 8u; other++) {
            squared += parts[(lane & 0xfffffff8u) + other];
        }
        length = max(sqrt(squared), NORM_MIN);
    }
    for (var k = first; k < n; k += 8u) {
        channels[g * n + k] = features[g * n + k] / length;
    }
    // Tested here, because a quotient of such a value may look finite.
    if (!finite) {
        atomicOr(&status[HALTED], 1u);
    }
}
