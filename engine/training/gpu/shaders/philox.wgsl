// Counter-based random numbers: Philox-4x32 with 10 rounds (Salmon et al. 2011, "Parallel random numbers: as easy as 1, 2, 3").

// High 32 bits of a product, from halves of 16 bits.
fn high_product(a: u32, b: u32) -> u32 {
    let a_low = a & 0xffffu;
    let b_low = b & 0xffffu;
    let a_high = a >> 16u;
    let b_high = b >> 16u;
    let middle = a_high * b_low + (a_low * b_low >> 16u);
    let other = a_low * b_high + (middle & 0xffffu);
    return a_high * b_high + (middle >> 16u) + (other >> 16u);
}

fn philox(start: vec4<u32>, first_key: vec2<u32>) -> vec4<u32> {
    var counter = start;
    var key = first_key;
    for (var i = 0u; i < 10u; i++) {
        counter = vec4<u32>(
            high_product(0xcd9e8d57u, counter.z) ^ counter.y ^ key.x, 0xcd9e8d57u * counter.z,
            high_product(0xd2511f53u, counter.x) ^ counter.w ^ key.y, 0xd2511f53u * counter.x);
        key += vec2<u32>(0x9e3779b9u, 0xbb67ae85u);
    }
    return counter;
}

// Number in (0, 1) from the highest 23 bits.
fn open_unit(bits: u32) -> f32 {
    return (f32(bits >> 9u) + 0.5) * 1.1920928955078125e-7;
}

// Three normally distributed numbers (Box and Muller 1958).
fn three_normals(bits: vec4<u32>) -> vec3<f32> {
    let first = sqrt(-2.0 * log(open_unit(bits.x)));
    let second = sqrt(-2.0 * log(open_unit(bits.z)));
    let turn = 6.283185307179586;
    let angle = turn * open_unit(bits.y);
    return vec3<f32>(first * cos(angle), first * sin(angle), second * cos(turn * open_unit(bits.w)));
}
