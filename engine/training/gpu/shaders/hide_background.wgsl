//needs optimiser
// Makes the first n_background Gaussians transparent in the lists of a picture, for a second one of the others alone.
@group(0) @binding(0) var<uniform> optimiser: Optimiser;
@group(0) @binding(1) var<storage, read_write> geometry: array<vec4<f32>>;  // of project.wgsl: opacity is the 6th value

@compute @workgroup_size(128)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let g = group_number(group, groups) * 128u + lane;
    if (g < min(optimiser.n, optimiser.n_background)) {
        geometry[2u * g + 1u].y = 0.0;
    }
}
