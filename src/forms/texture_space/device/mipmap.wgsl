// Flux of the texels and of the nodes above them, level by level from the lowest, as in forms/texture_space/light.rs.

struct Point {
    at: vec3<f32>,
    area: f32,
    normal: vec3<f32>,
    spread: f32,
    origin: vec3<f32>,
    triangle: u32,
    turns: vec2<f32>,
    medium: u32,
    padding: u32,
}

struct Level {
    // Of the order.
    first: u32,
    end: u32,
    padding0: u32,
    padding1: u32,
}

@group(0) @binding(0) var<storage, read> points: array<Point>;
@group(0) @binding(1) var<storage, read> irradiance: array<vec4<f32>>;
// Nodes by their height.
@group(0) @binding(2) var<storage, read> order: array<u32>;
@group(0) @binding(3) var<storage, read_write> nodes: array<Node>;

@group(1) @binding(0) var<uniform> level: Level;

fn add(sum: ptr<function, Node>, rgb: vec3<f32>, at: vec3<f32>) {
    (*sum).rgb += rgb;
    (*sum).at += (rgb.x + rgb.y + rgb.z) * at;
}

@compute @workgroup_size(64)
fn up(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let place = level.first + 64u * (group.x + 65535u * group.y) + thread;
    if place >= level.end {
        return;
    }
    let index = order[place];
    var sum = nodes[index];
    sum.rgb = vec3(0.0);
    sum.at = vec3(0.0);
    sum.moment = 0.0;
    sum.weight = 0.0;
    sum.lit = 0u;
    let is_texel = sum.first < sum.end;
    for (var p = sum.first; p < sum.end; p += 1u) {
        add(&sum, points[p].area * irradiance[p].xyz, points[p].at);
    }
    if !is_texel {
        for (var child = index + 1u; child < sum.next; child = nodes[child].next) {
            add(&sum, nodes[child].rgb, nodes[child].at);
        }
    }
    sum.weight = sum.rgb.x + sum.rgb.y + sum.rgb.z;
    if sum.weight > 0.0 {
        sum.at /= sum.weight;
        // The theorem of parallel axes.
        for (var p = sum.first; p < sum.end; p += 1u) {
            let e = irradiance[p].xyz;
            let weight = points[p].area * (e.x + e.y + e.z);
            let offset = points[p].at - sum.at;
            sum.moment += weight * (points[p].spread + dot(offset, offset));
            sum.lit += select(0u, 1u, weight > 0.0);
        }
        if !is_texel {
            for (var child = index + 1u; child < sum.next; child = nodes[child].next) {
                let offset = nodes[child].at - sum.at;
                sum.moment += nodes[child].moment + nodes[child].weight * dot(offset, offset);
                sum.lit += nodes[child].lit;
            }
        }
    } else {
        sum.at = vec3(0.0);
    }
    nodes[index] = sum;
}
