// Descents of the hierarchy over the texels, as in forms/texture_space/descent.rs; after kernel.wgsl and node.wgsl. Each invocation walks for
// one receiver by the sphere around its group, so that neighbours take the same way; where its loops would become too long it leaves its place to a
// later dispatch.

struct Walk {
    // Bounding sphere of the group.
    centre: vec3<f32>,
    radius: f32,
    // Of the walk.
    first: u32,
    end: u32,
    medium: u32,
    // Of the table of the medium: where it begins, the last segment, the upper bits of the first one.
    table: u32,
    last: u32,
    bits: u32,
    scale: f32,
    most: f32,
}

struct Limits {
    limit: f32,
    turns: u32,
    // Turns of a triangle of a patch nearby.
    of_triangle: u32,
    // Receivers, or groups that are counted.
    count: u32,
}

@group(1) @binding(0) var<uniform> limits: Limits;
@group(1) @binding(1) var<storage, read> nodes: array<Node>;
@group(1) @binding(2) var<storage, read> falloffs: array<f32>;
@group(1) @binding(3) var<storage, read> walks: array<Walk>;
// Walks that are not at their ends; then three for each receiver: its group, its node, and its patch there; or where groups are counted the number so
// far, the node, and nothing.
@group(1) @binding(4) var<storage, read_write> places: array<atomic<u32>>;

// Not within a texel.
const OUTSIDE: u32 = 0xffffffffu;

// Extent of a node in root-mean-square distances, see forms/texture_space/descent.rs.
const EXTENT: f32 = 2.0;
const MOST_OF_EXTENT: f32 = 0.083333336;
const TAU: f32 = 6.2831855;

// The falloff of a walk's medium at a distance, see forms/texture_space/falloff.rs.
fn falloff_at(walk: u32, distance: f32) -> f32 {
    let segment = (bitcast<u32>(distance + walks[walk].scale) >> FALLOFF_SHIFT) - walks[walk].bits;
    return falloffs[walks[walk].table + min(segment, walks[walk].last)];
}

// What is to be done about a node: 0 skip it, 1 take it as a point, 2 take its patches, 3 go on below.
fn choice(walk: u32, node: u32) -> u32 {
    let weight = nodes[node].weight;
    if weight <= 0.0 {
        return 0u;
    }
    let offset = nodes[node].at - walks[walk].centre;
    let distance = max(sqrt(dot(offset, offset)) - walks[walk].radius, 0.0);
    let nearby = falloff_at(walk, distance);
    let opened = select(3u, 2u, nodes[node].first < nodes[node].end);
    if nodes[node].moment * nearby >= limits.limit || weight * nearby >= walks[walk].most {
        return opened;
    }
    // See `opens` in forms/texture_space/descent.rs.
    let square = nodes[node].moment / weight;
    let nearest = falloff_at(walk, max(distance - EXTENT * sqrt(square), 0.0));
    if TAU * square * nearest >= MOST_OF_EXTENT * walks[walk].most {
        return opened;
    }
    return 1u;
}

fn is_near(walk: u32, index: u32) -> bool {
    let offset = patches[index].centre - walks[walk].centre;
    let distance = max(sqrt(dot(offset, offset)) - walks[walk].radius, 0.0);
    let exact = settings.exact_below * patches[index].radius;
    return distance * distance < exact * exact - media[walks[walk].medium].smooth2;
}

@compute @workgroup_size(64)
fn descend(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let receiver = 64u * (group.x + 65535u * group.y) + thread;
    if receiver >= limits.count {
        return;
    }
    let walk = atomicLoad(&places[1u + 3u * receiver]);
    var node = atomicLoad(&places[2u + 3u * receiver]);
    var index = atomicLoad(&places[3u + 3u * receiver]);
    let end = walks[walk].end;
    if node >= end {
        return;
    }
    let medium = walks[walk].medium;
    let at = receivers[receiver].xyz;
    var total = vec3(0.0);
    if node > walks[walk].first || index != OUTSIDE {
        total = radiosity[receiver].xyz;
    }
    var partial = vec3(0.0);
    var count = 0u;
    var turns = 0u;
    while node < end && turns < limits.turns {
        turns += 1u;
        if index == OUTSIDE {
            let chosen = choice(walk, node);
            if chosen == 2u {
                index = nodes[node].first;
                continue;
            }
            if chosen == 1u {
                let offset = nodes[node].at - at;
                partial += nodes[node].rgb * reflectance(medium, dot(offset, offset));
                count += 1u;
            }
            node = select(nodes[node].next, node + 1u, chosen == 3u);
        } else {
            let e = irradiance[index].xyz;
            if max(e.x, max(e.y, e.z)) > 0.0 {
                let offset = patches[index].centre - at;
                if is_near(walk, index) {
                    partial += close_patch(medium, index, offset, true);
                    turns += limits.of_triangle * (patches[index].end_facet - patches[index].first_facet);
                } else {
                    partial += e * (patches[index].area * reflectance(medium, dot(offset, offset)));
                }
                count += 1u;
            }
            index += 1u;
            if index >= nodes[node].end {
                node = nodes[node].next;
                index = OUTSIDE;
            }
        }
        if count > FLUSH {
            total += partial;
            partial = vec3(0.0);
            count = 0u;
        }
    }
    radiosity[receiver] = vec4(total + partial, 0.0);
    atomicStore(&places[2u + 3u * receiver], node);
    atomicStore(&places[3u + 3u * receiver], index);
    if node < end {
        atomicAdd(&places[0], 1u);
    }
}

@compute @workgroup_size(64)
fn count(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let walk = 64u * (group.x + 65535u * group.y) + thread;
    if walk >= limits.count {
        return;
    }
    var found = atomicLoad(&places[1u + 3u * walk]);
    var node = atomicLoad(&places[2u + 3u * walk]);
    let end = walks[walk].end;
    var turns = 0u;
    while node < end && turns < limits.turns {
        turns += 1u;
        let chosen = choice(walk, node);
        found += select(0u, 1u, chosen == 1u) + select(0u, nodes[node].end - nodes[node].first, chosen == 2u);
        node = select(nodes[node].next, node + 1u, chosen == 3u);
    }
    atomicStore(&places[1u + 3u * walk], found);
    atomicStore(&places[2u + 3u * walk], node);
    if node < end {
        atomicAdd(&places[0], 1u);
    }
}
