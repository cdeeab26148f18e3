// The compact part of a kernel, sample by sample, as in transport/multilevel/near.rs, added to what nets of points bring.

// Where a part's tables of R_d less its softened form are: at a point, and averaged over a disc.
struct Compact {
    point: RadialTable,
    disc: RadialTable,
    smooth2: f32,
    split2: f32,
    // In radii of a sample.
    facets_below: f32,
    pieces_below: f32,
}

// E times area of every sample, RGB and 0.
@group(1) @binding(2) var<storage, read> flux: array<vec4<f32>>;
@group(1) @binding(3) var<storage, read> compact: array<Compact>;
// A value at the start of each segment, and its slope per mm^2.
@group(1) @binding(4) var<storage, read> segments: array<vec4<f32>>;

fn at_point(table: u32, r2: f32) -> vec3<f32> {
    return looked_up(compact[table].point, r2);
}

fn at_disc(table: u32, r2: f32) -> vec3<f32> {
    return looked_up(compact[table].disc, r2);
}

fn area_of(p: array<vec3<f32>, 3>) -> f32 {
    return 0.5 * length(cross(p[1] - p[0], p[2] - p[0]));
}

// Three points of a triangle.
fn three_of(table: u32, p: array<vec3<f32>, 3>, middle: vec3<f32>, rule: vec2<f32>) -> vec3<f32> {
    var corner = p;
    var sum = vec3(0.0);
    for (var k = 0u; k < 3u; k += 1u) {
        let at = middle + rule.x * (corner[k] - middle);
        sum += at_point(table, dot(at, at));
    }
    return rule.y * sum;
}

fn largest2(p: array<vec3<f32>, 3>, middle: vec3<f32>) -> f32 {
    let a = p[0] - middle;
    let b = p[1] - middle;
    let c = p[2] - middle;
    return max(dot(a, a), max(dot(b, b), dot(c, c)));
}

// A quarter of a triangle: at a corner, or in the middle.
fn quarter(p: array<vec3<f32>, 3>, which: u32) -> array<vec3<f32>, 3> {
    let ab = 0.5 * (p[0] + p[1]);
    let bc = 0.5 * (p[1] + p[2]);
    let ca = 0.5 * (p[2] + p[0]);
    switch which {
        case 0u: { return array<vec3<f32>, 3>(p[0], ab, ca); }
        case 1u: { return array<vec3<f32>, 3>(ab, p[1], bc); }
        case 2u: { return array<vec3<f32>, 3>(ca, bc, p[2]); }
        default: { return array<vec3<f32>, 3>(ab, bc, ca); }
    }
}

// True for a triangle whose area is below a share of its longest edge's square.
fn is_sliver(p: array<vec3<f32>, 3>) -> bool {
    let u = p[1] - p[0];
    let v = p[2] - p[1];
    let w = p[0] - p[2];
    let longest = 2.0 * SLIVER * max(dot(u, u), max(dot(v, v), dot(w, w)));
    let doubled = cross(u, -w);
    return dot(doubled, doubled) < longest * longest;
}

// A half of a triangle, cut in the middle of its longest edge.
fn half_of(p: array<vec3<f32>, 3>, which: u32) -> array<vec3<f32>, 3> {
    let u = p[1] - p[0];
    let v = p[2] - p[1];
    let w = p[0] - p[2];
    let longest = max(dot(u, u), max(dot(v, v), dot(w, w)));
    var q = p;
    if dot(u, u) < longest {
        if dot(v, v) == longest {
            q = array<vec3<f32>, 3>(p[1], p[2], p[0]);
        } else {
            q = array<vec3<f32>, 3>(p[2], p[0], p[1]);
        }
    }
    let middle = 0.5 * (q[0] + q[1]);
    if which == 0u {
        return array<vec3<f32>, 3>(q[0], middle, q[2]);
    }
    return array<vec3<f32>, 3>(middle, q[1], q[2]);
}

// A triangle in quarters, and halves of slivers, that are small enough, depth first; two bits of the path for each level above the
// current one, and one bit that tells halves.
fn split(table: u32, whole: array<vec3<f32>, 3>) -> vec3<f32> {
    var sum = vec3(0.0);
    var path = 0u;
    var halved = 0u;
    var depth = 0u;
    loop {
        var p = whole;
        for (var level = 0u; level < depth; level += 1u) {
            let which = extractBits(path, 2u * level, 2u);
            if extractBits(halved, level, 1u) == 1u {
                p = half_of(p, which);
            } else {
                p = quarter(p, which);
            }
        }
        let middle = (p[0] + p[1] + p[2]) / 3.0;
        if depth < MOST_SPLITS
            && dot(middle, middle) + compact[table].smooth2 < compact[table].split2 * largest2(p, middle) {
            path = insertBits(path, 0u, 2u * depth, 2u);
            halved = insertBits(halved, select(0u, 1u, is_sliver(p)), depth, 1u);
            depth += 1u;
            continue;
        }
        sum += area_of(p) * (three_of(table, p, middle, INNER_OF_SIX) + three_of(table, p, middle, OUTER_OF_SIX));
        // The last pieces of their triangles are done with.
        while depth > 0u
            && extractBits(path, 2u * (depth - 1u), 2u) == select(3u, 1u, extractBits(halved, depth - 1u, 1u) == 1u) {
            depth -= 1u;
        }
        if depth == 0u {
            break;
        }
        path += 1u << (2u * (depth - 1u));
    }
    return sum;
}

fn of_facet(table: u32, p: array<vec3<f32>, 3>) -> vec3<f32> {
    let middle = (p[0] + p[1] + p[2]) / 3.0;
    let from2 = dot(middle, middle) + compact[table].smooth2;
    let near2 = compact[table].split2 * largest2(p, middle);
    if from2 < near2 {
        return split(table, p);
    }
    if from2 < THREE_BEYOND2 * near2 {
        return area_of(p) * (three_of(table, p, middle, INNER_OF_SIX) + three_of(table, p, middle, OUTER_OF_SIX));
    }
    return area_of(p) * three_of(table, p, middle, THREE_POINTS);
}

fn of_piece(table: u32, p: array<vec3<f32>, 3>) -> vec3<f32> {
    let middle = (p[0] + p[1] + p[2]) / 3.0;
    let r2 = dot(middle, middle);
    if r2 + compact[table].smooth2 < PIECE_IS_POINT2 * largest2(p, middle) {
        return split(table, p);
    }
    return area_of(p) * at_point(table, r2);
}

fn of_entry(job: u32, table: u32, index: u32, at: vec3<f32>) -> vec3<f32> {
    let offset = patches[index].centre - at;
    let r2 = dot(offset, offset);
    let radius2 = patches[index].radius * patches[index].radius;
    let smooth2 = compact[table].smooth2;
    let facets2 = compact[table].facets_below * compact[table].facets_below * radius2 - smooth2;
    var sum = vec3(0.0);
    let first = first_piece[index];
    if first != EVEN && r2 < max(compact[table].pieces_below * compact[table].pieces_below * radius2 - smooth2, facets2) {
        for (var piece = first; piece < first + settings.pieces; piece += 1u) {
            let a = pieces[3u * piece];
            let b = pieces[3u * piece + 1u];
            let c = pieces[3u * piece + 2u];
            let p = array<vec3<f32>, 3>(offset + a.xyz, offset + b.xyz, offset + c.xyz);
            sum += vec3(a.w, b.w, c.w) * of_piece(table, p);
        }
    }
    if r2 >= facets2 {
        return sum + flux[index].xyz * at_disc(table, r2);
    }
    var mean = vec3(0.0);
    for (var facet = patches[index].first_facet; facet < patches[index].end_facet; facet += 1u) {
        mean += of_facet(table, facet_at(facet, offset));
    }
    return sum + irradiance[index].xyz * mean;
}

@compute @workgroup_size(WORKGROUP)
fn near(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let job = group.x;
    sum_slices(job, thread);
    let receiver = jobs[job].first_receiver + thread;
    if thread < LANES && receiver < jobs[job].end_receiver {
        let sum = radiosity[receiver].xyz + sum_of(thread);
        // What interpolation takes away where there is next to nothing is not less than nothing.
        radiosity[receiver] = vec4(select(sum, factor_of(receiver) * max(sum, vec3(0.0)), jobs[job].is_last == 1u), 0.0);
    }
}
