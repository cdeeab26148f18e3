// The surface as a light sees it, and the local part of R_d from it, as in forms/texture_space/hybrid.rs; after rays.wgsl.

struct View {
    // Axes across the view, and the direction from the object to the light.
    u: vec3<f32>,
    half: f32,
    v: vec3<f32>,
    start: f32,
    towards: vec3<f32>,
    // 1: a point or a spot light.
    is_point: u32,
    // Its place; or for parallel light the same as `towards`.
    place: vec3<f32>,
    pixels: u32,
    // Irradiance or intensity over the unit.
    colour: vec3<f32>,
    receivers: u32,
    middle: vec2<f32>,
    rings: u32,
    of_ring: u32,
    // Axis of a point light's cone; one less the cosines of its edge and of its full light.
    axis: vec3<f32>,
    edge: f32,
    full: f32,
    padding0: u32,
    padding1: u32,
    padding2: u32,
}

struct Triangle {
    // Unit normal, and distance of the plane from the origin along it.
    plane: vec4<f32>,
    part: u32,
    // No medium: the largest number.
    medium: u32,
    padding0: u32,
    padding1: u32,
}

// Of each medium: eta, eta^2 - 1, step of the table, number of its steps.
@group(0) @binding(2) var<storage, read> media: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> triangles: array<Triangle>;
// Of each pixel: triangle, part, bits of the parameter of the ray, bits of the transmittance.
@group(0) @binding(4) var<storage, read_write> seen: array<vec4<u32>>;
@group(0) @binding(5) var<storage, read> receivers: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> radiosity: array<vec4<f32>>;
// R_d W_l of each medium at equal steps of the distance.
@group(0) @binding(7) var<storage, read> tables: array<vec4<f32>>;
// Radius of each circle, mm, and the density of samples there, 1/mm^2.
@group(0) @binding(8) var<storage, read> circles: array<vec2<f32>>;
// Part and medium of each receiver.
@group(0) @binding(9) var<storage, read> owners: array<vec2<u32>>;

@group(1) @binding(0) var<uniform> view: View;

const TAU: f32 = 6.2831855;
const NOTHING: u32 = 0xffffffffu;

// F_t of unpolarised light from outside, as in medium/fresnel.rs.
fn transmittance(medium: u32, cosine: f32) -> f32 {
    if cosine <= 0.0 {
        return 0.0;
    }
    let eta = media[medium].x;
    let outside = min(cosine, 1.0);
    let square = outside * outside + media[medium].y;
    if eta == 1.0 {
        return 1.0;
    }
    if square <= 0.0 {
        return 0.0;
    }
    let inside = min(sqrt(square) / eta, 1.0);
    let product = 4.0 * eta * outside * inside;
    let perpendicular = outside + eta * inside;
    let parallel = eta * outside + inside;
    return min(0.5 * (product / (perpendicular * perpendicular) + product / (parallel * parallel)), 1.0);
}

// Share of a cone's light in a direction away from it, as in light/cone.rs.
fn of_cone(direction: vec3<f32>) -> f32 {
    let off = direction - view.axis;
    let t = clamp((view.edge - 0.5 * dot(off, off)) / max(view.edge - view.full, 1e-30), 0.0, 1.0);
    return t * t * (3.0 - 2.0 * t);
}

@compute @workgroup_size(64)
fn look(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let index = 64u * (group.x + 65535u * group.y) + thread;
    if index >= view.pixels * view.pixels {
        return;
    }
    let pixel = vec2(f32(index % view.pixels), f32(index / view.pixels)) + vec2(0.5);
    let at = view.middle + view.half * (2.0 * pixel / f32(view.pixels) - vec2(1.0));
    var from_origin = at.x * view.u + at.y * view.v + view.start * view.towards;
    var direction = -view.towards;
    var stretch = 1.0;
    if view.is_point == 1u {
        from_origin = view.place;
        let step = at.x * view.u + at.y * view.v - view.towards;
        stretch = sqrt(dot(step, step));
        direction = step / stretch;
    }
    seen[index] = vec4(NOTHING);
    let hit = trace(ray(from_origin, direction, vec2(0.0, 3e38)), NO_TRIANGLE, false);
    if hit.triangle == NO_TRIANGLE || triangles[hit.triangle].medium == NOTHING {
        return;
    }
    let cosine = -dot(triangles[hit.triangle].plane.xyz, direction);
    let entering = transmittance(triangles[hit.triangle].medium, cosine) * of_cone(direction);
    let depth = select(view.start - hit.t, hit.t / stretch, view.is_point == 1u);
    seen[index] = vec4(hit.triangle, triangles[hit.triangle].part, bitcast<u32>(depth), bitcast<u32>(entering));
}

// Where the ray of light through a place meets the surface that a pixel sees.
fn meets(pixel: vec4<u32>, place: vec3<f32>) -> vec3<f32> {
    var from_origin = place - dot(place, view.towards) * view.towards;
    var step = view.towards;
    if view.is_point == 1u {
        from_origin = view.place;
        step = place - view.place;
        step /= -dot(step, view.towards);
    }
    let plane = triangles[pixel.x].plane;
    let across = dot(plane.xyz, step);
    var depth = bitcast<f32>(pixel.z);
    if abs(across) >= LEAST_COSINE * sqrt(dot(step, step)) {
        depth = (plane.w - dot(plane.xyz, from_origin)) / across;
    }
    return from_origin + depth * step;
}

fn look_up(medium: u32, distance: f32) -> vec3<f32> {
    let step = media[medium].z;
    let place = distance / step;
    let index = u32(place);
    if index >= u32(media[medium].w) {
        return vec3(0.0);
    }
    let at = medium * TABLE + index;
    return mix(tables[at].xyz, tables[at + 1u].xyz, place - f32(index));
}

fn of_place(medium: u32, part: u32, place: vec3<f32>, at: vec3<f32>) -> vec3<f32> {
    var across = vec2(dot(place, view.u), dot(place, view.v));
    var gain = 1.0;
    if view.is_point == 1u {
        let d = place - view.place;
        let depth = -dot(d, view.towards);
        if depth <= 0.0 {
            return vec3(0.0);
        }
        let to_receiver = view.place - at;
        let square = dot(d, d);
        gain = sqrt(dot(to_receiver, to_receiver)) / (square * sqrt(square));
        across = vec2(dot(d, view.u), dot(d, view.v)) / depth;
    }
    let pixel = 0.5 * f32(view.pixels) * ((across - view.middle) / view.half + vec2(1.0));
    if any(pixel < vec2(0.0)) || any(pixel >= vec2(f32(view.pixels))) {
        return vec3(0.0);
    }
    let found = seen[u32(pixel.y) * view.pixels + u32(pixel.x)];
    if found.y != part {
        return vec3(0.0);
    }
    let offset = meets(found, place) - at;
    return (gain * bitcast<f32>(found.w)) * view.colour * look_up(medium, sqrt(dot(offset, offset)));
}

// Adds the local part at a receiver: samples on circles in the plane that faces the light.
@compute @workgroup_size(64)
fn nearby(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let receiver = 64u * (group.x + 65535u * group.y) + thread;
    if receiver >= view.receivers {
        return;
    }
    let at = receivers[receiver].xyz;
    let part = owners[receiver].x;
    let medium = owners[receiver].y;
    var to_light = view.towards;
    if view.is_point == 1u {
        to_light = normalize(view.place - at);
    }
    let sign = select(1.0, -1.0, to_light.z < 0.0);
    let a = -1.0 / (sign + to_light.z);
    let b = to_light.x * to_light.y * a;
    let u = vec3(1.0 + sign * to_light.x * to_light.x * a, sign * b, -sign * to_light.x);
    let v = vec3(b, sign + to_light.y * to_light.y * a, -to_light.y);
    var sum = vec3(0.0);
    for (var ring = 0u; ring <= view.rings; ring += 1u) {
        let circle = circles[medium * (view.rings + 1u) + ring];
        let samples = select(view.of_ring, 1u, ring == 0u);
        let turn = select(0.5, 0.0, ring % 2u == 0u);
        var partial = vec3(0.0);
        for (var k = 0u; k < samples; k += 1u) {
            let angle = TAU * ((f32(k) + turn) / f32(samples));
            let place = at + circle.x * (cos(angle) * u + sin(angle) * v);
            partial += of_place(medium, part, place, at);
        }
        sum += partial / max(circle.y, 1e-30);
    }
    sum /= f32(view.rings * view.of_ring + 1u);
    radiosity[receiver] += vec4(sum, 0.0);
}
