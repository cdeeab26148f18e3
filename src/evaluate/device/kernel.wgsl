// R_d of three channels and its integral over triangles, as in transport/kernel.rs; distances in mm.

// A real and a virtual source: weight (1 + sigma d) exp(-sigma d) / d^3 with d^2 = r^2 + z^2, one channel a component.
struct Medium {
    real_weight: vec4<f32>,
    real_z2: vec4<f32>,
    real_sigma: vec4<f32>,
    image_weight: vec4<f32>,
    image_z2: vec4<f32>,
    image_sigma: vec4<f32>,
    // The far part inside the split radius: c0 + c1 u + c2 u^2, u = r^2 - split^2.
    c0: vec4<f32>,
    c1: vec4<f32>,
    c2: vec4<f32>,
    split2: f32,
    // Depth of the shallowest source, squared.
    smooth2: f32,
    padding0: f32,
    padding1: f32,
}

// Gauss-Legendre rules for an edge by its length over the distance of its nearest point.
struct Rules {
    limits: array<vec4<f32>, 2>,
    starts: array<vec4<u32>, 2>,
    // Two nodes each: position, weight, position, weight.
    nodes: array<vec4<f32>, EDGE_NODES / 2u>,
}

struct Patch {
    centre: vec3<f32>,
    area: f32,
    radius: f32,
    first_facet: u32,
    end_facet: u32,
    padding: u32,
    // Mean of the unit normals of its facets by area, no longer than 1.
    normal: vec3<f32>,
    more_padding: u32,
}

struct Settings {
    // In units of a sample's radius.
    exact_below: f32,
    three_points_below: f32,
    terms: u32,
    pieces: u32,
    // The number of receivers where their normals and then their factors follow the places, else 0.
    oriented: u32,
    // Radius of a group of receivers, mm, above which each has the rule of its own distance.
    narrow: f32,
    padding0: u32,
    padding1: u32,
}

@group(0) @binding(0) var<uniform> settings: Settings;
@group(0) @binding(1) var<uniform> rules: Rules;
@group(0) @binding(2) var<storage, read> media: array<Medium>;
@group(0) @binding(3) var<storage, read> patches: array<Patch>;
// Nine for each facet: its corners relative to the centroid of its sample.
@group(0) @binding(4) var<storage, read> corners: array<f32>;
@group(0) @binding(5) var<storage, read> receivers: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> radiosity: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> irradiance: array<vec4<f32>>;
// First piece of each sample; the largest number for samples that are lit evenly.
@group(0) @binding(8) var<storage, read> first_piece: array<u32>;
// Three for each piece: a corner relative to the centroid of its sample, and one channel of its deviation.
@group(0) @binding(9) var<storage, read> pieces: array<vec4<f32>>;

const EVEN: u32 = 0xffffffffu;
// Terms summed before the sum is added to a longer one: rounding grows with the number of terms.
const FLUSH: u32 = 31u;

// Unit normal of a receiver, of those that have one.
fn normal_of(receiver: u32) -> vec3<f32> {
    return receivers[settings.oriented + receiver].xyz;
}

// Factor on what a receiver gathers.
fn factor_of(receiver: u32) -> vec3<f32> {
    if settings.oriented == 0u {
        return vec3(1.0);
    }
    return receivers[2u * settings.oriented + receiver].xyz;
}

fn term(weight: vec3<f32>, z2: vec3<f32>, sigma: vec3<f32>, r2: f32) -> vec3<f32> {
    let d2 = z2 + r2;
    let inverse = inverseSqrt(d2);
    let x = sigma * (d2 * inverse);
    return (weight * inverse * inverse * inverse) * ((1.0 + x) * exp(-x));
}

fn reflectance(medium: u32, r2: f32) -> vec3<f32> {
    let real = term(media[medium].real_weight.xyz, media[medium].real_z2.xyz, media[medium].real_sigma.xyz, r2);
    let image = term(media[medium].image_weight.xyz, media[medium].image_z2.xyz, media[medium].image_sigma.xyz, r2);
    return real + image;
}

fn polynomial(medium: u32, u: f32) -> vec3<f32> {
    return media[medium].c0.xyz + u * (media[medium].c1.xyz + u * media[medium].c2.xyz);
}

// Int_t^inf R_d(s) s ds of one term, t^2 = t2.
fn tail(weight: vec3<f32>, z2: vec3<f32>, sigma: vec3<f32>, t2: f32) -> vec3<f32> {
    let d2 = z2 + t2;
    let inverse = inverseSqrt(d2);
    return (weight * inverse) * exp(-sigma * (d2 * inverse));
}

// (x + scale (1 - exp(-x))) / (x divisor) without the cancellation near 0.
fn rise_over(given: vec3<f32>, scale: vec3<f32>, divisor: vec3<f32>) -> vec3<f32> {
    let x = max(given, vec3(1e-12));
    let series = x * (1.0 - x * (0.5 - x * (1.0 / 6.0 - x * (1.0 / 24.0))));
    let decayed = select(1.0 - exp(-x), series, x < vec3(0.1));
    return (x + scale * decayed) / (x * divisor);
}

// The rule along an edge with a coordinate of its start, a length and the squared distance of its line from the receiver, no less than
// that inside which the kernel is smooth.
fn rule_of(start: f32, length: f32, span2: f32) -> vec2<u32> {
    let beside = max(max(start, -(start + length)), 0.0);
    let ratio = length * inverseSqrt(span2 + beside * beside);
    var rule = 0u;
    while rule + 1u < EDGE_RULES && ratio > rules.limits[rule >> 2u][rule & 3u] {
        rule += 1u;
    }
    let next = rule + 1u;
    return vec2(rules.starts[rule >> 2u][rule & 3u], rules.starts[next >> 2u][next & 3u]);
}

// Int R_d dA over a flat triangle with corners relative to the receiver: a sum over its edges, see transport/kernel.rs.
fn triangle(medium: u32, p: array<vec3<f32>, 3>) -> vec3<f32> {
    var corner = p;
    let across = cross(corner[1] - corner[0], corner[2] - corner[0]);
    let across2 = dot(across, across);
    if across2 <= 0.0 {
        return vec3(0.0);
    }
    let normal = across * inverseSqrt(across2);
    let height = dot(normal, corner[0]);
    let height2 = height * height;
    let real_z2 = media[medium].real_z2.xyz;
    let real_sigma = media[medium].real_sigma.xyz;
    let image_z2 = media[medium].image_z2.xyz;
    let image_sigma = media[medium].image_sigma.xyz;
    let real_d0 = sqrt(real_z2 + height2);
    let image_d0 = sqrt(image_z2 + height2);
    var real = vec3(0.0);
    var image = vec3(0.0);
    for (var k = 0u; k < 3u; k += 1u) {
        let from_corner = corner[k];
        let edge = corner[(k + 1u) % 3u] - from_corner;
        let length2 = dot(edge, edge);
        let inverse_length = select(0.0, inverseSqrt(length2), length2 > 0.0);
        let along = edge * inverse_length;
        let pedal = dot(from_corner, cross(along, normal));
        let s0 = dot(from_corner, along);
        let s1 = s0 + length2 * inverse_length;
        let rule = rule_of(s0, s1 - s0, media[medium].smooth2 + height2 + pedal * pedal);
        let span2 = real_z2 + height2 + pedal * pedal;
        let span = sqrt(span2);
        let v0 = s0 / (span + sqrt(span2 + s0 * s0));
        let v1 = s1 / (span + sqrt(span2 + s1 * s1));
        let middle = 0.5 * (v0 + v1);
        let half = 0.5 * (v1 - v0);
        for (var i = rule.x; i < rule.y; i += 1u) {
            let pair = rules.nodes[i >> 1u];
            let node = select(pair.xy, pair.zw, (i & 1u) == 1u);
            let v = middle + half * node.x;
            let v2 = v * v;
            let minus = max(1.0 - v2, vec3(1e-7));
            let inverse = 1.0 / minus;
            let near = span * (1.0 + v2);
            let far = sqrt(near * near + (image_z2 - real_z2) * (minus * minus));
            let weight = (2.0 * node.y * pedal) * half;
            let real_x = real_sigma * (near * inverse - real_d0);
            real += weight * rise_over(real_x, real_sigma * real_d0, near + real_d0 * minus);
            let image_x = image_sigma * (far * inverse - image_d0);
            image += (weight * near) * rise_over(image_x, image_sigma * image_d0, far * (far + image_d0 * minus));
        }
    }
    let sum = tail(media[medium].real_weight.xyz, real_z2, real_sigma, height2) * real
        + tail(media[medium].image_weight.xyz, image_z2, image_sigma, height2) * image;
    return max(sum, vec3(0.0));
}

// The midpoints between the centroid and the corners, a third of the flux each.
fn three_points(medium: u32, p: array<vec3<f32>, 3>) -> vec3<f32> {
    let centre = (p[0] + p[1] + p[2]) / 3.0;
    let area = 0.5 * length(cross(p[1] - p[0], p[2] - p[0]));
    var sum = vec3(0.0);
    for (var k = 0u; k < 3u; k += 1u) {
        let at = centre + THREE_POINTS.x * (p[k] - centre);
        sum += reflectance(medium, dot(at, at));
    }
    return area * THREE_POINTS.y * sum;
}

fn area_at_centroid(medium: u32, p: array<vec3<f32>, 3>) -> vec3<f32> {
    let centre = (p[0] + p[1] + p[2]) / 3.0;
    return (0.5 * length(cross(p[1] - p[0], p[2] - p[0]))) * reflectance(medium, dot(centre, centre));
}

// A facet of a sample that is at an offset from the receiver.
fn facet_at(facet: u32, offset: vec3<f32>) -> array<vec3<f32>, 3> {
    let k = 9u * facet;
    return array<vec3<f32>, 3>(
        offset + vec3(corners[k], corners[k + 1u], corners[k + 2u]),
        offset + vec3(corners[k + 3u], corners[k + 4u], corners[k + 5u]),
        offset + vec3(corners[k + 6u], corners[k + 7u], corners[k + 8u]),
    );
}

// A sample that is close: its facets exactly or at three points each, and the pieces of an uneven one.
fn close_patch(medium: u32, index: u32, offset: vec3<f32>, exact: bool) -> vec3<f32> {
    var sum = vec3(0.0);
    let e = irradiance[index].xyz;
    for (var facet = patches[index].first_facet; facet < patches[index].end_facet; facet += 1u) {
        let p = facet_at(facet, offset);
        if exact {
            sum += e * triangle(medium, p);
        } else {
            sum += e * three_points(medium, p);
        }
    }
    let first = first_piece[index];
    if first != EVEN {
        for (var piece = first; piece < first + settings.pieces; piece += 1u) {
            let a = pieces[3u * piece];
            let b = pieces[3u * piece + 1u];
            let c = pieces[3u * piece + 2u];
            let p = array<vec3<f32>, 3>(offset + a.xyz, offset + b.xyz, offset + c.xyz);
            if exact {
                sum += vec3(a.w, b.w, c.w) * triangle(medium, p);
            } else {
                sum += vec3(a.w, b.w, c.w) * area_at_centroid(medium, p);
            }
        }
    }
    return sum;
}
