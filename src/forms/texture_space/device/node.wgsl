// A node of the hierarchy over the texels, in the order of a walk, see forms/texture_space/light.rs.
struct Node {
    // Mean place of its light.
    at: vec3<f32>,
    moment: f32,
    rgb: vec3<f32>,
    weight: f32,
    // The node after all that is below.
    next: u32,
    // Patches of a texel.
    first: u32,
    end: u32,
    // Number of patches below that are lit.
    lit: u32,
}
