// The area-weighted Haar transform of irradiance on the balanced tree, level by level from the leaves, as in
// transport/balanced_tree.rs.

struct Node {
    // Named by the first sample of its right child.
    name: u32,
    left: u32,
    right: u32,
    // Bit 0: the left child is a sample, bit 1: the right one is.
    leaves: u32,
    left_area: f32,
    right_area: f32,
    padding0: u32,
    padding1: u32,
}

struct Level {
    first: u32,
    end: u32,
    padding0: u32,
    padding1: u32,
}

@group(0) @binding(0) var<storage, read> nodes: array<Node>;
@group(0) @binding(1) var<storage, read> irradiance: array<vec4<f32>>;
// Mean irradiance of each node, by its name.
@group(0) @binding(2) var<storage, read_write> node_means: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> details: array<vec4<f32>>;
// Of each part: its root, 1 in y where that is a sample, 1 in z where there is none.
@group(0) @binding(4) var<storage, read> roots: array<vec4<u32>>;
@group(0) @binding(5) var<storage, read_write> means: array<vec4<f32>>;

@group(1) @binding(0) var<uniform> level: Level;

@compute @workgroup_size(64)
fn up(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let i = level.first + 64u * (group.x + 65535u * group.y) + thread;
    if i >= level.end {
        return;
    }
    let node = nodes[i];
    var left: vec3<f32>;
    var right: vec3<f32>;
    if (node.leaves & 1u) != 0u {
        left = irradiance[node.left].xyz;
    } else {
        left = node_means[node.left].xyz;
    }
    if (node.leaves & 2u) != 0u {
        right = irradiance[node.right].xyz;
    } else {
        right = node_means[node.right].xyz;
    }
    let both = node.left_area > 0.0 && node.right_area > 0.0;
    details[node.name] = vec4(select(vec3(0.0), left - right, both), 0.0);
    let area = max(node.left_area + node.right_area, 1e-37);
    node_means[node.name] = vec4((left * node.left_area + right * node.right_area) / area, 0.0);
}

@compute @workgroup_size(64)
fn parts(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let part = 64u * group.x + thread;
    if part >= arrayLength(&roots) {
        return;
    }
    let root = roots[part];
    var mean = vec3(0.0);
    if root.z == 0u {
        if root.y == 1u {
            mean = irradiance[root.x].xyz;
        } else {
            mean = node_means[root.x].xyz;
        }
    }
    means[part] = vec4(mean, 0.0);
}
