// Rays against triangles in the tree of geometry/bvh, in single precision: sheared into the frame of the ray, a triangle is hit where no two of
// its edge functions have opposite signs.

// The boxes of eight children: low x, y, z, high x, y, z, each of four and four children; and references to these.
struct TreeNode {
    planes: array<vec4<f32>, 12>,
    children: array<vec4<u32>, 2>,
}

// Eight triangles: coordinates by corner, axis, four and four; and their indices.
struct TreeBlock {
    corners: array<vec4<f32>, 18>,
    triangles: array<vec4<u32>, 2>,
}

@group(0) @binding(0) var<storage, read> tree: array<TreeNode>;
@group(0) @binding(1) var<storage, read> blocks: array<TreeBlock>;

const LEAF: u32 = 0x80000000u;
const NO_TRIANGLE: u32 = 0xffffffffu;

struct Ray {
    origin: vec3<f32>,
    // Of the shear; the direction is largest along the last.
    axes: vec3<u32>,
    shear: vec2<f32>,
    along: f32,
    inverse: vec3<f32>,
    near_offset: vec3<f32>,
    far_offset: vec3<f32>,
    // Planes where it enters boxes.
    near: vec3<u32>,
    // Distances from the ray's own origin that count, ends excluded; and the distance of `origin` from there.
    range: vec2<f32>,
    start: f32,
}

struct Hit {
    triangle: u32,
    t: f32,
}

fn ray(from_origin: vec3<f32>, direction: vec3<f32>, range: vec2<f32>) -> Ray {
    var r: Ray;
    let size = abs(direction);
    let length = max(size.x, max(size.y, size.z));
    let z = select(select(2u, 1u, size.y >= size.z), 0u, size.x >= size.y && size.x >= size.z);
    r.origin = from_origin;
    r.start = 0.0;
    let beyond = max(TREE_LOW - from_origin, from_origin - TREE_HIGH);
    let away = max(beyond.x, max(beyond.y, beyond.z));
    if away > 4.0 * TREE_EXTENT {
        // A ray from far away starts over beside the scene.
        r.start = (away - TREE_EXTENT) / length;
        r.origin = from_origin + r.start * direction;
    }
    let from_zero = max(abs(r.origin.x), max(abs(r.origin.y), abs(r.origin.z)));
    let grow = 1.9073486e-6 * max(TREE_MAGNITUDE, from_zero);
    let least = length * 9.313226e-10;
    let negative = direction < vec3(0.0);
    r.inverse = select(vec3<f32>(1.0), vec3<f32>(-1.0), negative) / max(size, vec3(least));
    let grown = select(vec3(grow), vec3(-grow), negative);
    r.near_offset = (r.origin + grown) * r.inverse;
    r.far_offset = (r.origin - grown) * r.inverse;
    r.near = vec3<u32>(0u, 1u, 2u) + select(vec3<u32>(0u), vec3<u32>(3u), negative);
    r.axes = vec3((z + 1u) % 3u, (z + 2u) % 3u, z);
    r.along = direction[z];
    r.shear = vec2(direction[r.axes.x], direction[r.axes.y]) * r.inverse[z];
    r.range = range;
    return r;
}

fn as_bits(which: vec4<bool>) -> u32 {
    let bits = select(vec4<u32>(0u), vec4<u32>(1u, 2u, 4u, 8u), which);
    return bits.x | bits.y | bits.z | bits.w;
}

// Bits of the four boxes, the first or the last of a node, that a ray may meet up to a distance.
fn boxes(r: Ray, node: u32, four: u32, end: f32) -> u32 {
    let nx = tree[node].planes[2u * r.near.x + four] * r.inverse.x - r.near_offset.x;
    let ny = tree[node].planes[2u * r.near.y + four] * r.inverse.y - r.near_offset.y;
    let nz = tree[node].planes[2u * r.near.z + four] * r.inverse.z - r.near_offset.z;
    let far = (r.near + vec3<u32>(3u)) % vec3<u32>(6u);
    let fx = tree[node].planes[2u * far.x + four] * r.inverse.x - r.far_offset.x;
    let fy = tree[node].planes[2u * far.y + four] * r.inverse.y - r.far_offset.y;
    let fz = tree[node].planes[2u * far.z + four] * r.inverse.z - r.far_offset.z;
    let enter = max(max(nx, ny), max(nz, vec4(r.range.x - r.start)));
    let leave = min(min(fx, fy), min(fz, vec4(end - r.start)));
    return as_bits(enter <= leave);
}

// The nearest hit of a ray with four triangles of a block, the first or the last; nearer than `best`.
fn of_block(r: Ray, leaf: u32, four: u32, skip: u32, best: Hit) -> Hit {
    let index = (leaf & ~LEAF) >> 3u;
    let count = (leaf & 7u) + 1u;
    var x: array<vec4<f32>, 3>;
    var y: array<vec4<f32>, 3>;
    var z: array<vec4<f32>, 3>;
    for (var corner = 0u; corner < 3u; corner += 1u) {
        let row = 6u * corner + four;
        z[corner] = blocks[index].corners[row + 2u * r.axes.z] - r.origin[r.axes.z];
        x[corner] = blocks[index].corners[row + 2u * r.axes.x] - r.origin[r.axes.x] - r.shear.x * z[corner];
        y[corner] = blocks[index].corners[row + 2u * r.axes.y] - r.origin[r.axes.y] - r.shear.y * z[corner];
    }
    let u = x[2] * y[1] - y[2] * x[1];
    let v = x[0] * y[2] - y[0] * x[2];
    let w = x[1] * y[0] - y[1] * x[0];
    let least = min(min(u, v), w);
    let most = max(max(u, v), w);
    let total = u + v + w;
    let inside = (least >= vec4(0.0)) | (most <= vec4(0.0));
    let divisor = select(total * r.along, vec4(1.0), total == vec4(0.0));
    let t = vec4(r.start) + (u * z[0] + v * z[1] + w * z[2]) / divisor;
    var found = best;
    for (var lane = 0u; lane < 4u; lane += 1u) {
        let triangle = blocks[index].triangles[four][lane];
        let counts = 4u * four + lane < count && inside[lane] && total[lane] != 0.0 && triangle != skip;
        let nearer = t[lane] < found.t || (t[lane] == found.t && triangle < found.triangle);
        if counts && t[lane] > r.range.x && t[lane] < r.range.y && nearer {
            found.t = t[lane];
            found.triangle = triangle;
        }
    }
    return found;
}

// The nearest hit, or with `any` some hit, with another triangle than `skip`.
fn trace(r: Ray, skip: u32, any: bool) -> Hit {
    var stack: array<u32, TREE_STACK>;
    var found = Hit(NO_TRIANGLE, 3e38);
    var at = 0u;
    var count = 0u;
    loop {
        if (at & LEAF) == 0u {
            let end = min(r.range.y, found.t);
            var mask = boxes(r, at, 0u, end) | (boxes(r, at, 1u, end) << 4u);
            while mask != 0u {
                let child = firstTrailingBit(mask);
                mask &= mask - 1u;
                stack[count] = tree[at].children[child >> 2u][child & 3u];
                count += 1u;
            }
        } else {
            found = of_block(r, at, 0u, skip, found);
            if (at & 7u) > 3u {
                found = of_block(r, at, 1u, skip, found);
            }
            if any && found.triangle != NO_TRIANGLE {
                break;
            }
        }
        if count == 0u {
            break;
        }
        count -= 1u;
        at = stack[count];
    }
    return found;
}

fn is_occluded(from_origin: vec3<f32>, direction: vec3<f32>, distance: f32, skip: u32) -> bool {
    return trace(ray(from_origin, direction, vec2(0.0, distance)), skip, true).triangle != NO_TRIANGLE;
}
