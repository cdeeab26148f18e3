// What scattered light is multiplied by: solid marble, or pictures over the texture coordinates. `render::texture` has the
// same in 64 bits. Beyond what a pixel can show, both become their mean.

struct Pattern {
    base: vec3f,
    // 1 / mm.
    veins_per_mm: f32,
    veins: vec3f,
    turbulence: f32,
    sharpness: f32,
    // Share of the veins over all space.
    mean_vein: f32,
    // 0: none, 1: marble, 2: coats.
    kind: u32,
    octaves: u32,
    seed: u32,
    unused_a: u32,
    unused_b: u32,
    unused_c: u32,
}

// The albedo of a material.
struct Coat {
    // RGB; w: the layer of its picture, -1 for none.
    factor: vec4f,
    // Scale and offset of the texture coordinates, v up.
    place: vec4f,
}

@group(0) @binding(10) var<uniform> pattern: Pattern;
@group(0) @binding(11) var pictures: texture_2d_array<f32>;
@group(0) @binding(12) var repeat: sampler;
@group(0) @binding(13) var<storage, read> coats: array<Coat>;

fn mixed(bits: u32, part: u32) -> u32 {
    let product = (bits ^ part) * 0x9e3779b1u;
    return product ^ (product >> 15u);
}

fn lattice_bits(cell: vec3u, key: u32) -> u32 {
    var bits = mixed(mixed(mixed(mixed(0u, cell.x), cell.y), cell.z), key);
    bits = (bits ^ (bits >> 16u)) * 0x85ebca6bu;
    bits = (bits ^ (bits >> 13u)) * 0xc2b2ae35u;
    return bits ^ (bits >> 16u);
}

// Product of an offset with the gradient that bits choose: one of the directions to the twelve edges of a cube.
fn slope(bits: u32, offset: vec3f) -> f32 {
    let edge = bits % 12u;
    var pair = offset.xy;
    if edge < 4u {
        pair = offset.yz;
    } else if edge < 8u {
        pair = offset.xz;
    }
    return select(pair.x, -pair.x, (edge & 1u) != 0u) + select(pair.y, -pair.y, (edge & 2u) != 0u);
}

fn noise(at: vec3f, key: u32) -> f32 {
    let whole = floor(at);
    let inside = at - whole;
    let fade = inside * inside * inside * (inside * (inside * 6.0 - 15.0) + 10.0);
    let cell = vec3u(vec3i(whole));
    var corners: array<f32, 8>;
    for (var i = 0u; i < 8u; i++) {
        let corner = vec3u(i & 1u, (i >> 1u) & 1u, i >> 2u);
        corners[i] = slope(lattice_bits(cell + corner, key), inside - vec3f(corner));
    }
    let near = mix(mix(corners[0], corners[1], fade.x), mix(corners[2], corners[3], fade.x), fade.y);
    let far = mix(mix(corners[4], corners[5], fade.x), mix(corners[6], corners[7], fade.x), fade.y);
    return mix(near, far, fade.z);
}

// The share of what is wide enough to be seen where a pixel is this wide, both in the same unit.
fn visible_share(pixel: f32) -> f32 {
    return 1.0 - smoothstep(0.5, 1.0, pixel);
}

// At a place in mm where a pixel is so wide.
fn marble(local: vec3f, pixel: f32) -> vec3f {
    let at = local * pattern.veins_per_mm;
    let width = pixel * pattern.veins_per_mm;
    var turbulence = 0.0;
    if pattern.turbulence > 0.0 {
        for (var i = 0u; i < pattern.octaves; i++) {
            let frequency = f32(1u << i);
            let share = visible_share(width * frequency);
            var value = MEAN_ABSOLUTE_NOISE;
            if share > 0.0 {
                let sharp = abs(noise(at * frequency + SHIFT * f32(i), pattern.seed + i));
                value = mix(value, sharp, share);
            }
            turbulence += value / frequency;
        }
    }
    let across = dot(ACROSS, at) + pattern.turbulence * turbulence;
    let wave = 0.5 + 0.5 * cos(6.28318530717959 * fract(across));
    let vein = mix(pattern.mean_vein, pow(max(wave, 1e-12), pattern.sharpness), visible_share(width));
    return mix(pattern.base, pattern.veins, vein);
}

// `right` and `down` are how the texture coordinates change from pixel to pixel.
fn texture_albedo(local: vec3f, pixel: f32, material: u32, uv: vec2f, right: vec2f, down: vec2f) -> vec3f {
    if pattern.kind == 1u {
        return marble(local, pixel);
    }
    if pattern.kind == 2u {
        let coat = coats[min(material, arrayLength(&coats) - 1u)];
        if coat.factor.w < 0.0 {
            return coat.factor.xyz;
        }
        // Rows count from the top, v from the bottom.
        let scale = coat.place.xy * vec2f(1.0, -1.0);
        let at = uv * scale + vec2f(coat.place.z, 1.0 - coat.place.w);
        let layer = i32(coat.factor.w);
        return coat.factor.xyz * textureSampleGrad(pictures, repeat, at, layer, right * scale, down * scale).xyz;
    }
    return vec3f(1.0);
}
