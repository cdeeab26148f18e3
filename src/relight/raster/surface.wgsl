// The object, its wires and what is seen beside it. Lengths in mm, in the mesh's local coordinates.

struct Environment {
    // Cosine and sine of its turn.
    turn: vec4f,
    // Factor on the texture, RGB.
    scale: vec4f,
}

struct View {
    clip_from_local: mat4x4f,
    eye: vec3f,
    exposure: f32,
    // Half the picture's width and height at distance 1.
    right: vec3f,
    alpha: f32,
    upward: vec3f,
    // Level of the environments that are blurred as wide as highlights, from 0 to LAST_LEVEL.
    level: f32,
    forward: vec3f,
    mode: u32,
    constant: vec3f,
    light_count: u32,
    backdrop: vec3f,
    environment_count: u32,
    diffuse: f32,
    specular: f32,
    encode: u32,
    backdrop_alpha: f32,
    error_scale: f32,
    error_known: u32,
    textured: u32,
    // Of Blinn-Phong highlights; 0 for those of GGX.
    exponent: f32,
    colours: array<vec4f, ERROR_COLOURS>,
    environments: array<Environment, ENVIRONMENTS>,
}

struct Light {
    // Direction towards it, or its place where w is 1.
    to: vec4f,
    // Irradiance or intensity; w: which byte of the visibility shadows it, -1 for none.
    power: vec4f,
    // Where it shines to; w is 1 if it shines to one side only, by the cosine, 2 if it shines into a cone.
    normal: vec4f,
    // One less the cosines of the cone's edge and of its full light.
    cone: vec4f,
}

@group(0) @binding(0) var<uniform> view: View;
// The first is the scale of the others.
@group(0) @binding(1) var<storage, read> radiosity: array<vec4f>;
@group(0) @binding(2) var<storage, read> visibility: array<u32>;
@group(0) @binding(3) var<storage, read> errors: array<f32>;
// eta, 1 / (pi C) of each medium.
@group(0) @binding(4) var<storage, read> media: array<vec4f>;
@group(0) @binding(5) var<storage, read> albedo: array<f32>;
@group(0) @binding(6) var<storage, read> lights: array<Light>;
@group(0) @binding(7) var glossy: texture_2d_array<f32>;
@group(0) @binding(8) var backdrop: texture_2d_array<f32>;
@group(0) @binding(9) var wrap: sampler;

struct Corner {
    @location(0) local: vec3f,
    @location(1) normal: vec3f,
    // Receiver, vertex, medium, material.
    @location(2) ids: vec4u,
    @location(3) uv: vec2f,
}

struct Surface {
    @builtin(position) clip: vec4f,
    @location(0) local: vec3f,
    @location(1) normal: vec3f,
    @location(2) radiosity: vec3f,
    @location(3) visible: vec4f,
    @location(4) error: f32,
    @location(5) @interpolate(flat) medium: u32,
    @location(6) uv: vec2f,
    @location(7) @interpolate(flat) material: u32,
}

@vertex
fn surface_corner(corner: Corner) -> Surface {
    var out: Surface;
    out.clip = view.clip_from_local * vec4f(corner.local, 1.0);
    out.local = corner.local;
    out.normal = corner.normal;
    out.medium = corner.ids.z;
    out.uv = corner.uv;
    out.material = corner.ids.w;
    out.radiosity = vec3f(0.0);
    if corner.ids.x != NONE {
        out.radiosity = radiosity[corner.ids.x + 1u].xyz * radiosity[0].x;
    }
    out.visible = unpack4x8unorm(visibility[corner.ids.y]);
    out.error = 0.0;
    if view.error_known != 0u {
        out.error = errors[corner.ids.y];
    }
    return out;
}

@vertex
fn wire_corner(corner: Corner) -> @builtin(position) vec4f {
    var clip = view.clip_from_local * vec4f(corner.local, 1.0);
    // A little nearer than the triangles that it belongs to.
    clip.z *= 1.0005;
    return clip;
}

// The normal turned towards the eye until its cosine is at least this, as in render/eye.rs.
fn facing(normal: vec3f, to_eye: vec3f, least: f32) -> vec3f {
    let cosine = dot(normal, to_eye);
    let across = normal - to_eye * cosine;
    let square = dot(across, across);
    if cosine >= least || square <= 0.0 {
        return normal;
    }
    return to_eye * least + across * (sqrt(max(1.0 - least * least, 0.0)) * inverseSqrt(square));
}

// Fraction of unpolarised light from outside that enters.
fn transmittance(eta: f32, cosine: f32) -> f32 {
    if cosine <= 0.0 {
        return 0.0;
    }
    if eta == 1.0 {
        return 1.0;
    }
    let outside = min(cosine, 1.0);
    let square = outside * outside + (eta - 1.0) * (eta + 1.0);
    if square <= 0.0 {
        return 0.0;
    }
    let inside = min(sqrt(square) / eta, 1.0);
    let product = 4.0 * eta * outside * inside;
    let perpendicular = outside + eta * inside;
    let parallel = eta * outside + inside;
    return min(0.5 * (product / (perpendicular * perpendicular) + product / (parallel * parallel)), 1.0);
}

fn slope_root(alpha: f32, cosine: f32) -> f32 {
    let a2 = alpha * alpha;
    return sqrt(a2 + (1.0 - a2) * cosine * cosine);
}

// Radiance over the irradiance of a facing surface: GGX (Walter et al. 2007) with height-correlated masking (Heitz 2014),
// or a power of the half vector's cosine (render/blinn_phong.rs).
fn highlight(eta: f32, normal: vec3f, to_light: vec3f, to_eye: vec3f) -> f32 {
    let cos_i = dot(normal, to_light);
    let cos_o = dot(normal, to_eye);
    if cos_i <= 0.0 || cos_o <= 0.0 {
        return 0.0;
    }
    let half = normalize(to_light + to_eye);
    let cos_half = min(dot(normal, half), 1.0);
    let sine = cross(normal, half);
    if view.exponent > 0.0 {
        // The sine is exact where the power falls fastest.
        let power = pow(max(1.0 - dot(sine, sine), 0.0), 0.5 * view.exponent);
        return (1.0 - transmittance(eta, dot(half, to_eye))) * (view.exponent + 2.0) / (8.0 * PI) * power * cos_i;
    }
    let a2 = view.alpha * view.alpha;
    let t = dot(sine, sine) + a2 * cos_half * cos_half;
    let distribution = a2 / (PI * t * t);
    let shadowing = 0.5 / (cos_o * slope_root(view.alpha, cos_i) + cos_i * slope_root(view.alpha, cos_o));
    return (1.0 - transmittance(eta, dot(half, to_eye))) * distribution * shadowing * cos_i;
}

fn place_in_map(direction: vec3f, environment: u32) -> vec2f {
    let turn = view.environments[environment].turn;
    let d = vec3f(turn.x * direction.x - turn.y * direction.z, direction.y, turn.x * direction.z + turn.y * direction.x);
    let v = atan2(length(d.xz), d.y) / PI;
    if d.x == 0.0 && d.z == 0.0 {
        return vec2f(0.5, v);
    }
    return vec2f(0.5 - atan2(d.x, d.z) / (2.0 * PI), v);
}

fn specular(in: Surface, medium: vec4f, normal: vec3f, to_eye: vec3f) -> vec3f {
    let cos_o = dot(normal, to_eye);
    if cos_o <= 0.0 {
        return vec3f(0.0);
    }
    var sum = vec3f(0.0);
    for (var i = 0u; i < view.light_count; i++) {
        let light = lights[i];
        var to_light = light.to.xyz;
        var irradiance = light.power.xyz;
        if light.to.w == 1.0 {
            let offset = light.to.xyz - in.local;
            let square = max(dot(offset, offset), 1e-20);
            to_light = offset * inverseSqrt(square);
            irradiance /= square;
            if light.normal.w == 1.0 {
                irradiance *= max(-dot(light.normal.xyz, to_light), 0.0);
            } else if light.normal.w == 2.0 {
                let off = to_light + light.normal.xyz;
                let t = clamp((light.cone.x - 0.5 * dot(off, off)) / max(light.cone.x - light.cone.y, 1e-30), 0.0, 1.0);
                irradiance *= t * t * (3.0 - 2.0 * t);
            }
        }
        if light.power.w >= 0.0 {
            irradiance *= in.visible[u32(light.power.w)];
        }
        sum += irradiance * highlight(medium.x, normal, to_light, to_eye);
    }
    var around = view.constant;
    let reflected = reflect(-to_eye, normal);
    for (var i = 0u; i < view.environment_count; i++) {
        let seen = textureSampleLevel(glossy, wrap, place_in_map(reflected, i), i, view.level * LAST_LEVEL);
        around += seen.xyz * view.environments[i].scale.xyz;
    }
    let at = clamp(cos_o, 0.0, 1.0) * f32(ALBEDO_STEPS - 1u);
    let first = u32(medium.z) + min(u32(at), ALBEDO_STEPS - 2u);
    return sum + around * mix(albedo[first], albedo[first + 1u], at - floor(min(at, f32(ALBEDO_STEPS) - 1.5)));
}

fn encoded(linear: vec3f) -> vec3f {
    let c = clamp(linear, vec3f(0.0), vec3f(1.0));
    return select(1.055 * pow(c, vec3f(1.0 / 2.4)) - 0.055, 12.92 * c, c <= vec3f(0.0031308));
}

// Half floats end at 65504.
fn finished(radiance: vec3f, alpha: f32) -> vec4f {
    let exposed = clamp(radiance * view.exposure, vec3f(0.0), vec3f(60000.0));
    if view.encode != 0u {
        return vec4f(encoded(exposed), alpha);
    }
    return vec4f(exposed, alpha);
}

fn false_colour(value: f32) -> vec3f {
    let at = clamp(value, 0.0, 1.0) * 5.0;
    let first = min(u32(at), 4u);
    return mix(view.colours[first].xyz, view.colours[first + 1u].xyz, at - f32(first));
}

@fragment
fn surface_colour(in: Surface, @builtin(front_facing) front: bool) -> @location(0) vec4f {
    let to_eye = normalize(view.eye - in.local);
    // The triangle's normal: what is drawn of its front faces the eye.
    let right_mm = dpdx(in.local);
    let down_mm = dpdy(in.local);
    let right_uv = dpdx(in.uv);
    let down_uv = dpdy(in.uv);
    let across = cross(right_mm, down_mm);
    let square = dot(across, across);
    var face = to_eye;
    if square > 0.0 {
        face = across * inverseSqrt(square);
        face *= select(1.0, -1.0, dot(face, to_eye) < 0.0);
    }
    let cos_face = dot(face, to_eye);
    if !front || in.medium == NONE {
        return finished(vec3f(0.0), 1.0);
    }
    if view.mode == 2u {
        if view.error_known == 0u {
            return vec4f(encoded(vec3f(0.05 + 0.2 * cos_face)), 1.0);
        }
        return vec4f(false_colour(in.error * view.error_scale) * (0.6 + 0.4 * cos_face), 1.0);
    }
    if view.mode == 1u {
        return finished(in.radiosity / PI, 1.0);
    }
    let medium = media[in.medium];
    var normal = face;
    if dot(in.normal, in.normal) > 0.0 {
        normal = normalize(in.normal);
    }
    normal = facing(normal, to_eye, LEAST_COSINE_SHARE * cos_face);
    var radiance = view.diffuse * in.radiosity * (transmittance(medium.x, dot(normal, to_eye)) * medium.y);
    if view.textured != 0u {
        let pixel = max(length(right_mm), length(down_mm));
        radiance *= texture_albedo(in.local, pixel, in.material, in.uv, right_uv, down_uv);
    }
    if view.specular > 0.0 {
        radiance += view.specular * specular(in, medium, normal, to_eye);
    }
    return finished(radiance, 1.0);
}

@fragment
fn wire_colour() -> @location(0) vec4f {
    return vec4f(0.02, 0.35, 0.45, 1.0);
}

struct Beside {
    @builtin(position) clip: vec4f,
    @location(0) direction: vec3f,
}

@vertex
fn beside_corner(@builtin(vertex_index) index: u32) -> Beside {
    let at = vec2f(f32(index & 1u) * 4.0 - 1.0, f32(index >> 1u) * 4.0 - 1.0);
    var out: Beside;
    out.clip = vec4f(at, 0.0, 1.0);
    out.direction = view.forward + view.right * at.x + view.upward * at.y;
    return out;
}

@fragment
fn beside_colour(in: Beside) -> @location(0) vec4f {
    if view.mode == 2u {
        return vec4f(encoded(vec3f(0.01)), 1.0);
    }
    var radiance = view.backdrop;
    if view.backdrop_alpha == 2.0 {
        let direction = normalize(in.direction);
        for (var i = 0u; i < view.environment_count; i++) {
            let seen = textureSampleLevel(backdrop, wrap, place_in_map(direction, i), i, 0.0);
            radiance += seen.xyz * view.environments[i].scale.xyz;
        }
    }
    return finished(radiance, min(view.backdrop_alpha, 1.0));
}
