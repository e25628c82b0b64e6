//needs search
// The means in the order of the codes, each with its Gaussian.
@group(0) @binding(1) var<storage, read> means: array<f32>;
@group(0) @binding(2) var<storage, read> order: array<u32>;
@group(0) @binding(3) var<storage, read_write> points: array<vec4<f32>>;

@compute @workgroup_size(128)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let i = group_number(group, groups) * 128u + lane;
    if (i < search.n) {
        let g = order[i];
        points[i] = vec4<f32>(means[3u * g], means[3u * g + 1u], means[3u * g + 2u], bitcast<f32>(g));
    }
}
