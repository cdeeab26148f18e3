// All samples and clusters of a list against the receivers of a job, as in transport/gather.rs, where kernels are tables: of a
// single layer and, where there is one, of a double layer, which knows the normals of both ends of a pair.

struct Kernel {
    single: RadialTable,
    // Int_r^inf of the single layer times s ds.
    tail: RadialTable,
    // The double layer over the single one, 1/mm.
    slope: RadialTable,
    // The double layer itself, 1/mm^3, and its tail.
    double: RadialTable,
    double_tail: RadialTable,
    // On which the single layer is smooth, mm.
    scale: f32,
    // 1: there is a double layer.
    is_double: u32,
    padding0: u32,
    padding1: u32,
}

// Flux, and flux times normal by axis; RGB.
struct Cluster {
    centre: vec4<f32>,
    flux: vec4<f32>,
    moments: array<vec4<f32>, 3>,
}

@group(1) @binding(2) var<storage, read> clusters: array<Cluster>;
// A value at the start of each segment, and its slope per mm^2.
@group(1) @binding(3) var<storage, read> segments: array<vec4<f32>>;
@group(1) @binding(4) var<uniform> kernels: array<Kernel, MOST_KERNELS>;

// Of the receiver.
var<private> normal: vec3<f32>;

// What leaves at the receiver from a flux at a way from it; `under` is the flux times the height of the receiver's side, the way
// along the normal of the source.
fn brought(kernel: u32, way: vec3<f32>, flux: vec3<f32>, under: vec3<f32>) -> vec3<f32> {
    let r2 = dot(way, way);
    let single = looked_up(kernels[kernel].single, r2);
    if kernels[kernel].is_double == 0u {
        return single * flux;
    }
    let slope = looked_up(kernels[kernel].slope, r2);
    return single * (flux + slope * (flux * dot(way, normal) - under));
}

// (tail(H) - tail(d)) / step^2 of a radial function: half its mean over r^2 between the foot, at a distance H, and a node at d.
fn half_mean(values: RadialTable, tail: RadialTable, height2: f32, step2: f32) -> vec3<f32> {
    if step2 < SHORT_STEP * (height2 + values.scale2) {
        // Simpson's rule.
        let between = looked_up(values, height2 + 0.5 * step2);
        return (looked_up(values, height2) + 4.0 * between + looked_up(values, height2 + step2)) / 12.0;
    }
    return (looked_up(tail, height2) - looked_up(tail, height2 + step2)) / step2;
}

// Both layers integrated over a triangle with corners relative to the receiver, as in transport/kernel/double_layer.rs: sums over its
// edges of Int (tail(H) - tail(d)) p / (p^2 + s^2) ds, and of the double layer's tail along the outward normals.
fn integral(kernel: u32, p: array<vec3<f32>, 3>) -> vec3<f32> {
    var corner = p;
    let across = cross(corner[1] - corner[0], corner[2] - corner[0]);
    let across2 = dot(across, across);
    if across2 <= 0.0 {
        return vec3(0.0);
    }
    let upwards = across * inverseSqrt(across2);
    // Of the plane over the receiver.
    let height = dot(upwards, corner[0]);
    let height2 = height * height;
    let scale = kernels[kernel].scale;
    let is_double = kernels[kernel].is_double == 1u;
    var single = vec3(0.0);
    var double = vec3(0.0);
    var around = vec3(0.0);
    for (var k = 0u; k < 3u; k += 1u) {
        let from_corner = corner[k];
        let edge = corner[(k + 1u) % 3u] - from_corner;
        let length2 = dot(edge, edge);
        let inverse_length = select(0.0, inverseSqrt(length2), length2 > 0.0);
        let along = edge * inverse_length;
        let outward = cross(along, upwards);
        let pedal = dot(from_corner, outward);
        let s0 = dot(from_corner, along);
        let s1 = s0 + length2 * inverse_length;
        let span2 = height2 + scale * scale + pedal * pedal;
        let rule = rule_of(s0, s1 - s0, span2);
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
            let minus = max(1.0 - v2, 1e-7);
            let s = 2.0 * span * v / minus;
            let step2 = pedal * pedal + s * s;
            let length = node.y * half * 2.0 * span * (1.0 + v2) / (minus * minus);
            single += (length * pedal) * half_mean(kernels[kernel].single, kernels[kernel].tail, height2, step2);
            if is_double {
                double += (length * pedal) * half_mean(kernels[kernel].double, kernels[kernel].double_tail, height2, step2);
                around += (length * dot(outward, normal)) * looked_up(kernels[kernel].double_tail, height2 + step2);
            }
        }
    }
    // The edges of a near, but dark triangle cancel up to rounding.
    single = max(single, vec3(0.0));
    if !is_double {
        return single;
    }
    return single + height * (dot(upwards, normal) - 1.0) * double - around;
}

// A triangle of an irradiance, RGB, at the midpoints between its centroid and its corners, a third of the flux each.
fn by_three_points(kernel: u32, p: array<vec3<f32>, 3>, e: vec3<f32>) -> vec3<f32> {
    let centre = (p[0] + p[1] + p[2]) / 3.0;
    let across = cross(p[1] - p[0], p[2] - p[0]);
    let doubled = length(across);
    let upwards = across / max(doubled, 1e-37);
    let flux = (0.5 * doubled * THREE_POINTS.y) * e;
    var sum = vec3(0.0);
    for (var k = 0u; k < 3u; k += 1u) {
        let at = centre + THREE_POINTS.x * (p[k] - centre);
        sum += brought(kernel, at, flux, flux * dot(at, upwards));
    }
    return sum;
}

fn of_entry(job: u32, kernel: u32, entry: u32, at: vec3<f32>) -> vec3<f32> {
    if (entry & CLUSTER) != 0u {
        let index = entry ^ CLUSTER;
        let way = clusters[index].centre.xyz - at;
        let moments = clusters[index].moments;
        let under = moments[0].xyz * way.x + moments[1].xyz * way.y + moments[2].xyz * way.z;
        return brought(kernel, way, clusters[index].flux.xyz, under);
    }
    return of_patch(job, kernel, entry, at);
}

fn of_patch(job: u32, kernel: u32, index: u32, at: vec3<f32>) -> vec3<f32> {
    let centre = patches[index].centre;
    let own = patches[index].normal;
    let offset = centre - at;
    let e = irradiance[index].xyz;
    let how = summed_by(job, index, offset, kernels[kernel].scale * kernels[kernel].scale);
    if how == WHOLE {
        let flux = e * patches[index].area;
        return brought(kernel, offset, flux, flux * dot(offset, own));
    }
    let exact = how == TRIANGLES;
    var sum = vec3(0.0);
    for (var facet = patches[index].first_facet; facet < patches[index].end_facet; facet += 1u) {
        let p = facet_at(facet, offset);
        if exact {
            sum += e * integral(kernel, p);
        } else {
            sum += by_three_points(kernel, p, e);
        }
    }
    let first = first_piece[index];
    if first != EVEN {
        for (var piece = first; piece < first + settings.pieces; piece += 1u) {
            let a = pieces[3u * piece];
            let b = pieces[3u * piece + 1u];
            let c = pieces[3u * piece + 2u];
            let p = array<vec3<f32>, 3>(offset + a.xyz, offset + b.xyz, offset + c.xyz);
            let deviation = vec3(a.w, b.w, c.w);
            if exact {
                sum += deviation * integral(kernel, p);
            } else {
                let middle = (p[0] + p[1] + p[2]) / 3.0;
                let flux = (0.5 * length(cross(p[1] - p[0], p[2] - p[0]))) * deviation;
                sum += brought(kernel, middle, flux, flux * dot(middle, own));
            }
        }
    }
    return sum;
}

@compute @workgroup_size(WORKGROUP)
fn gather(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let job = group.x;
    let receiver = jobs[job].first_receiver + thread % LANES;
    let is_there = receiver < jobs[job].end_receiver;
    if settings.oriented > 0u {
        normal = normal_of(min(receiver, jobs[job].end_receiver - 1u));
    }
    sum_slices(job, thread);
    if thread < LANES && is_there {
        store(job, receiver, factor_of(receiver) * sum_of(thread));
    }
}
