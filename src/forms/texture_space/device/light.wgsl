// Irradiance of single points with shadows, as Illumination::at_points in transport/irradiance/points.rs; after rays.wgsl.

struct Point {
    at: vec3<f32>,
    area: f32,
    // Unit normal.
    normal: vec3<f32>,
    // Mean squared distance from the centroid.
    spread: f32,
    // Where its rays begin.
    origin: vec3<f32>,
    triangle: u32,
    // Turns of its directions towards a constant light.
    turns: vec2<f32>,
    medium: u32,
    padding: u32,
}

struct Light {
    // 0: directional, 1: point or spot, 2: constant, 3: area, 4: environment.
    kind: u32,
    // Rays of each point that this pass casts, of so many.
    first: u32,
    end: u32,
    count: u32,
    // Over the unit of irradiance.
    colour: vec3<f32>,
    points: u32,
    // The direction that it comes from, its place, or the corner of a rectangle.
    place: vec3<f32>,
    side: u32,
    // Edge of a rectangle; or axis of a point light's cone, whose edge and full light `width` and `height` are, as 1 less the cosine.
    u: vec3<f32>,
    width: f32,
    v: vec3<f32>,
    height: f32,
    normal: vec3<f32>,
    key_low: u32,
    key_high: u32,
    frame: u32,
    padding0: u32,
    padding1: u32,
}

// How light enters a medium: eta, eta^2 - 1, Int F_t cos over the half space, 0.
struct Entrance {
    eta: vec4<f32>,
    // Cosines by the cube root of a number in [0, 1).
    cosines: array<f32, ENTRANCE_NUMBERS>,
}

@group(0) @binding(2) var<storage, read> points: array<Point>;
@group(0) @binding(3) var<storage, read> entrances: array<Entrance>;
@group(0) @binding(4) var<storage, read_write> irradiance: array<vec4<f32>>;

@group(1) @binding(0) var<uniform> light: Light;
// Two for each candidate of each stratum: direction, the stratum's shift; weight over the unit.
@group(1) @binding(1) var<storage, read> candidates: array<vec4<f32>>;
// Where lights move: what is known of each patch, 0 nothing as it faced away, 1 lit, 2 in shadow.
@group(1) @binding(2) var<storage, read_write> sights: array<u32>;

const TAU: f32 = 6.2831855;

// F_t of unpolarised light from outside times the cosine, as in medium/fresnel.rs.
fn entering(medium: u32, given: f32) -> f32 {
    if given <= 0.0 {
        return 0.0;
    }
    let eta = entrances[medium].eta.x;
    let outside = min(given, 1.0);
    let square = outside * outside + entrances[medium].eta.y;
    if eta == 1.0 {
        return given;
    }
    if square <= 0.0 {
        return 0.0;
    }
    let inside = min(sqrt(square) / eta, 1.0);
    let product = 4.0 * eta * outside * inside;
    let perpendicular = outside + eta * inside;
    let parallel = eta * outside + inside;
    let value = 0.5 * (product / (perpendicular * perpendicular) + product / (parallel * parallel));
    return min(value, 1.0) * given;
}

// Share of a cone's light, as in light/cone.rs.
fn of_cone(to_light: vec3<f32>) -> f32 {
    let off = -to_light - light.u;
    let t = clamp((light.width - 0.5 * dot(off, off)) / max(light.width - light.height, 1e-30), 0.0, 1.0);
    return t * t * (3.0 - 2.0 * t);
}

fn arriving(p: u32, direction: vec3<f32>, distance: f32) -> f32 {
    let value = entering(points[p].medium, dot(points[p].normal, direction));
    if value <= 0.0 || is_occluded(points[p].origin, direction, distance, points[p].triangle) {
        return 0.0;
    }
    return value;
}

// The direction at a cosine and an azimuth around an axis.
fn around(axis: vec3<f32>, mu: f32, azimuth: f32) -> vec3<f32> {
    let sign = select(1.0, -1.0, axis.z < 0.0);
    let a = -1.0 / (sign + axis.z);
    let b = axis.x * axis.y * a;
    let t = vec3(1.0 + sign * axis.x * axis.x * a, sign * b, -sign * axis.x);
    let s = vec3(b, sign + axis.y * axis.y * a, -axis.y);
    let radius = sqrt(max(1.0 - mu * mu, 0.0));
    return axis * mu + t * (radius * cos(azimuth)) + s * (radius * sin(azimuth));
}

// Directions with density F_t cos: only visibility varies.
fn of_constant(p: u32, ray: u32) -> f32 {
    let medium = points[p].medium;
    let inverse = f32(reverseBits(ray)) * 2.3283064e-10;
    let place = pow(fract(inverse + points[p].turns.x), 1.0 / 3.0) * f32(ENTRANCE_NUMBERS - 1u);
    let step = min(u32(place), ENTRANCE_NUMBERS - 2u);
    let mu = mix(entrances[medium].cosines[step], entrances[medium].cosines[step + 1u], place - f32(step));
    let azimuth = TAU * fract((f32(ray) + points[p].turns.y) / f32(light.count));
    let direction = around(points[p].normal, mu, azimuth);
    if is_occluded(points[p].origin, direction, 3e38, points[p].triangle) {
        return 0.0;
    }
    return entrances[medium].eta.z / f32(light.count);
}

// Numbers of 64 bits, the lower half first, as in math/random.rs.
fn product64(a: u32, b: u32) -> vec2<u32> {
    let low = (a & 0xffffu) * (b & 0xffffu);
    let middle = (a >> 16u) * (b & 0xffffu) + (low >> 16u);
    let other = (a & 0xffffu) * (b >> 16u) + (middle & 0xffffu);
    return vec2((other << 16u) | (low & 0xffffu), (a >> 16u) * (b >> 16u) + (middle >> 16u) + (other >> 16u));
}

fn times64(a: vec2<u32>, b: vec2<u32>) -> vec2<u32> {
    let low = product64(a.x, b.x);
    return vec2(low.x, low.y + a.x * b.y + a.y * b.x);
}

fn plus64(a: vec2<u32>, b: vec2<u32>) -> vec2<u32> {
    let low = a.x + b.x;
    return vec2(low, a.y + b.y + select(0u, 1u, low < a.x));
}

fn shifted64(a: vec2<u32>, by: u32) -> vec2<u32> {
    return vec2((a.x >> by) | (a.y << (32u - by)), a.y >> by);
}

fn mix64(given: vec2<u32>) -> vec2<u32> {
    var z = plus64(given, vec2(0x7f4a7c15u, 0x9e3779b9u));
    z = times64(z ^ shifted64(z, 30u), vec2(0x1ce4e5b9u, 0xbf58476du));
    z = times64(z ^ shifted64(z, 27u), vec2(0x133111ebu, 0x94d049bbu));
    return z ^ shifted64(z, 31u);
}

fn uniform_of(mixed: vec2<u32>, dimension: u32) -> f32 {
    return f32(mix64(mixed ^ vec2(dimension, 0u)).y >> 8u) * 5.9604645e-8;
}

fn quotient(a: f32, b: f32) -> f32 {
    return a / sqrt(a * a + b * b);
}

// The built-in function may be 4096 units of the last place off. After Cephes: 2e-7.
fn atan_of(value: f32) -> f32 {
    let size = abs(value);
    var x = size;
    var from_zero = 0.0;
    if size > 2.4142135 {
        from_zero = 1.5707964;
        x = -1.0 / size;
    } else if size > 0.41421357 {
        from_zero = 0.78539816;
        x = (size - 1.0) / (size + 1.0);
    }
    let z = x * x;
    let beyond = (((0.080537446 * z - 0.13877686) * z + 0.19977711) * z - 0.3333295) * z * x + x;
    return sign_of(value) * (from_zero + beyond);
}

fn asin_of(value: f32) -> f32 {
    return atan_of(value / sqrt(max(1.0 - value * value, 1e-12)));
}

// Solid angle of a triangle whose corners span a volume (Van Oosterom and Strackee 1983).
fn triangle_angle(a: vec3<f32>, b: vec3<f32>, c: vec3<f32>, volume: f32) -> f32 {
    let la = length(a);
    let lb = length(b);
    let lc = length(c);
    let below = la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb;
    if below == 0.0 {
        return 3.1415927;
    }
    return 2.0 * (atan_of(volume / below) + select(0.0, 3.1415927, below < 0.0));
}

// A rectangle by cells of equal solid angle, as in math/spherical_rectangle.rs.
fn rectangle(p: u32) -> f32 {
    let offset = light.place - points[p].at;
    if dot(offset, light.normal) >= 0.0 {
        return 0.0;
    }
    var n = cross(light.u, light.v);
    var z = dot(offset, n);
    if z > 0.0 {
        z = -z;
        n = -n;
    }
    let x = vec2(dot(offset, light.u), dot(offset, light.u) + light.width);
    let y = vec2(dot(offset, light.v), dot(offset, light.v) + light.height);
    let reach = max(max(abs(x.x), abs(x.y)), max(abs(y.x), abs(y.y)));
    z = min(z, -1e-7 * reach);
    // Normals of the planes through the edges, along n and across.
    let across = vec4(y.x, x.y, y.y, x.x);
    let along = vec4(-across.x, across.y, across.z, -across.w) / sqrt(across * across + vec4(z * z));
    // The last two angles between neighbouring planes less right angles.
    let less = asin_of(along.z * along.w) + asin_of(along.w * along.x);
    let volume = -z * (x.y - x.x) * (y.y - y.x);
    let opposite = vec3(x.y, y.y, z);
    let first_corner = vec3(x.x, y.x, z);
    let solid = triangle_angle(first_corner, vec3(x.y, y.x, z), opposite, volume)
        + triangle_angle(first_corner, opposite, vec3(x.x, y.y, z), volume);
    let side2 = light.side * light.side;
    let first = product64(p, side2);
    var sum = 0.0;
    for (var cell = light.first; cell < light.end; cell += 1u) {
        let mixed = mix64(vec2(light.key_low, light.key_high) ^ plus64(first, vec2(cell, 0u)));
        let s = (f32(cell % light.side) + uniform_of(mixed, 0u)) / f32(light.side);
        let t = (f32(cell / light.side) + uniform_of(mixed, 1u)) / f32(light.side);
        // Less pi, which changes the signs of sine and cosine.
        let angle = s * solid - less;
        let sine = -sin(angle);
        let fu = (-cos(angle) * along.x - along.z) / select(sine, 1e-30, abs(sine) < 1e-30);
        let cosine = clamp(sign_of(fu) / max(sqrt(fu * fu + along.x * along.x), 1e-30), -1.0, 1.0);
        let xu = clamp(-(cosine * z) / sqrt(max(1.0 - cosine * cosine, 1e-30)), x.x, x.y);
        let d = sqrt(xu * xu + z * z);
        let h0 = quotient(y.x, d);
        let hv = h0 + t * (quotient(y.y, d) - h0);
        var yv = y.y;
        if hv * hv < 1.0 - 1e-6 {
            yv = hv * d / sqrt(1.0 - hv * hv);
        }
        let to_light = xu * light.u + clamp(yv, y.x, y.y) * light.v + z * n;
        let distance = max(sqrt(dot(to_light, to_light)), 1e-30);
        sum += arriving(p, to_light / distance, distance);
    }
    return sum * solid / f32(side2);
}

fn sign_of(value: f32) -> f32 {
    return select(1.0, -1.0, value < 0.0);
}

@compute @workgroup_size(64)
fn shine(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let p = 64u * (group.x + 65535u * group.y) + thread;
    if p >= light.points || points[p].medium == 0xffffffffu {
        return;
    }
    var sum = vec3(0.0);
    if light.kind == 0u {
        sum = light.colour * arriving(p, light.place, 3e38);
    } else if light.kind == 1u {
        let to_light = light.place - points[p].at;
        let square = max(dot(to_light, to_light), 1e-30);
        let distance = sqrt(square);
        let share = of_cone(to_light / distance);
        if share > 0.0 {
            sum = light.colour * (share * arriving(p, to_light / distance, distance) / square);
        }
    } else if light.kind == 2u {
        for (var ray = light.first; ray < light.end; ray += 1u) {
            sum += light.colour * of_constant(p, ray);
        }
    } else if light.kind == 3u {
        sum = light.colour * rectangle(p);
    } else {
        let turn = reverseBits(p) >> (32u - STRATUM_BITS);
        for (var stratum = light.first; stratum < light.end; stratum += 1u) {
            let shift = u32(candidates[2u * (stratum << STRATUM_BITS)].w);
            let at = 2u * ((stratum << STRATUM_BITS) + (shift ^ turn));
            let direction = candidates[at].xyz;
            sum += candidates[at + 1u].xyz * arriving(p, direction, 3e38);
        }
    }
    irradiance[p] += vec4(sum, 0.0);
}

// What was seen in a block: 1 patches that are lit, 2 patches in shadow, 4 a change.
var<workgroup> seen: atomic<u32>;

fn sight(p: u32, direction: vec3<f32>, distance: f32) -> u32 {
    return select(1u, 2u, is_occluded(points[p].origin, direction, distance, points[p].triangle));
}

// A directional or point light that has moved, as in forms/texture_space/kept.rs: a workgroup for each block.
@compute @workgroup_size(BLOCK)
fn keep(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    // Invocations side by side are those that look at their patches in the same frame.
    let own = SHARE * (thread % (BLOCK / SHARE)) + thread / (BLOCK / SHARE);
    let p = BLOCK * (group.x + 65535u * group.y) + own;
    var direction = light.place;
    var distance = 3e38;
    var gain = 0.0;
    var known = 0u;
    var is_known = false;
    if p < light.points && points[min(p, light.points - 1u)].medium != 0xffffffffu {
        gain = 1.0;
        if light.kind == 1u {
            let to_light = light.place - points[p].at;
            let square = max(dot(to_light, to_light), 1e-30);
            distance = sqrt(square);
            direction = to_light / distance;
            gain = of_cone(direction) / square;
        }
        gain *= entering(points[p].medium, dot(points[p].normal, direction));
        if gain > 0.0 {
            let before = sights[p];
            known = before;
            is_known = before != 0u && own % SHARE != light.frame % SHARE;
            if !is_known {
                known = sight(p, direction, distance);
                if before != 0u && before != known {
                    atomicOr(&seen, 4u);
                }
            }
            atomicOr(&seen, known);
        }
    }
    workgroupBarrier();
    let of_block = atomicLoad(&seen);
    if is_known && (of_block & 7u) > 2u {
        known = sight(p, direction, distance);
    }
    if p < light.points {
        sights[p] = known;
        if known == 1u {
            irradiance[p] += vec4(gain * light.colour, 0.0);
        }
    }
}
