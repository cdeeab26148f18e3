// Double layers over nets of points, as in transport/multilevel/double.rs: sums of four fields. Charges are flux and its moments along
// the axes; potentials are what sources bring under the tangent planes of their own normals, and, by axis, over those of receivers.

// Lanes of points, and slices of the sources of each.
const LANES: u32 = 16u;
const SLICES: u32 = 4u;

var<workgroup> slices: array<array<vec3<f32>, 4>, 64>;

struct Shard {
    first: u32,
    count: u32,
    padding0: u32,
    padding1: u32,
}

struct NetKernel {
    table: RadialTable,
    // 1: adds to the potentials that are there.
    is_added: u32,
    padding0: u32,
    padding1: u32,
    padding2: u32,
}

@group(0) @binding(0) var<storage, read> flux: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read> moments_x: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> moments_y: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> moments_z: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> under: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> over_x: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> over_y: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> over_z: array<vec4<f32>>;
// Positions, mm.
@group(0) @binding(8) var<storage, read> points: array<vec4<f32>>;
@group(0) @binding(9) var<uniform> kernel: NetKernel;
// A value at the start of each segment, and its slope per mm^2.
@group(0) @binding(10) var<storage, read> segments: array<vec4<f32>>;

@group(1) @binding(0) var<uniform> shard: Shard;
// First and last point of a group, and where its list begins and ends.
@group(1) @binding(1) var<storage, read> groups: array<vec4<u32>>;
@group(1) @binding(2) var<storage, read> list: array<u32>;

@compute @workgroup_size(64)
fn heights(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let lane = thread % LANES;
    let index = workgroup.x + 65535u * workgroup.y;
    let group = groups[min(index, shard.count - 1u)];
    let point = group.x + lane;
    let at = points[min(point, group.y - 1u)].xyz;
    var sums = array<vec3<f32>, 4>(vec3(0.0), vec3(0.0), vec3(0.0), vec3(0.0));
    for (var i = group.z + thread / LANES; i < group.w; i += SLICES) {
        let source = list[i];
        let way = points[source].xyz - at;
        let value = looked_up(kernel.table, dot(way, way));
        let own = value * flux[source].xyz;
        let below = moments_x[source].xyz * way.x + moments_y[source].xyz * way.y + moments_z[source].xyz * way.z;
        sums[0] -= value * below;
        sums[1] += own * way.x;
        sums[2] += own * way.y;
        sums[3] += own * way.z;
    }
    slices[thread] = sums;
    workgroupBarrier();
    if thread < LANES && point < group.y && index < shard.count {
        for (var slice = 1u; slice < SLICES; slice += 1u) {
            for (var field = 0u; field < 4u; field += 1u) {
                sums[field] += slices[lane + slice * LANES][field];
            }
        }
        if kernel.is_added == 1u {
            sums[0] += under[point].xyz;
            sums[1] += over_x[point].xyz;
            sums[2] += over_y[point].xyz;
            sums[3] += over_z[point].xyz;
        }
        under[point] = vec4(sums[0], 0.0);
        over_x[point] = vec4(sums[1], 0.0);
        over_y[point] = vec4(sums[2], 0.0);
        over_z[point] = vec4(sums[3], 0.0);
    }
}
