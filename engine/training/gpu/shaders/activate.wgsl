//needs optimiser philox dropout tree_sum
// Scales and rendered opacities from the values that are trained, and sums of opacities and scales.
@group(0) @binding(0) var<uniform> optimiser: Optimiser;
@group(0) @binding(1) var<storage, read> log_scales: array<f32>;
@group(0) @binding(2) var<storage, read> opacity_logits: array<f32>;
@group(0) @binding(3) var<storage, read_write> scales: array<f32>;
@group(0) @binding(4) var<storage, read_write> opacities: array<f32>;
@group(0) @binding(5) var<storage, read_write> status: array<atomic<u32>>;
@group(0) @binding(6) var<storage, read_write> gaussian_sums: array<vec2<f32>>;

// Activates one Gaussian; returns its opacity and the sum of its scales.
fn activate(g: u32) -> vec2<f32> {
    var finite = is_finite(opacity_logits[g]);
    var total = vec2<f32>(1.0 / (1.0 + exp(-opacity_logits[g])), 0.0);
    opacities[g] = dropped(g, total.x).x;
    for (var k = 0u; k < 3u; k++) {
        finite = finite && is_finite(log_scales[3u * g + k]);
        let scale = exp(log_scales[3u * g + k]);
        scales[3u * g + k] = scale;
        total.y += scale;
    }
    // Tested here, because an exponential of such a value may look finite.
    if (!finite) {
        atomicOr(&status[HALTED], 1u);
    }
    return total;
}

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let block = group_number(group, groups);
    let g = block * 256u + lane;
    var own = vec2<f32>(0.0);
    if (g < optimiser.n) {
        own = activate(g);
    }
    let total = tree_sum(lane, own);
    if (lane == 0u && block * 256u < optimiser.n) {
        gaussian_sums[block] = total;
    }
}
