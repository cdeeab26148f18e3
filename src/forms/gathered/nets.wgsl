// Multilevel summation over nets of points, as in transport/multilevel: values brought to fewer points, and softened kernels summed
// from point to point. Interpolation back is interpolated.wgsl.

// Invocations of a row, and of a point.
const ROW: u32 = 16u;
const LANES: u32 = 16u;
const SLICES: u32 = 4u;

var<workgroup> slices: array<vec3<f32>, 64>;

struct Shard {
    // Rows or groups of points before these, and how many these are.
    first: u32,
    count: u32,
    padding0: u32,
    padding1: u32,
}

@group(1) @binding(0) var<uniform> shard: Shard;

// RGB and 0.
@group(0) @binding(0) var<storage, read> values: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read_write> sums: array<vec4<f32>>;

// Where the cells of each row begin; and the end.
@group(1) @binding(1) var<storage, read> offsets: array<u32>;
// What a cell sums, and the bits of its weight.
@group(1) @binding(2) var<storage, read> cells: array<vec2<u32>>;

@compute @workgroup_size(64)
fn restricted(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let row = (group.x + 65535u * group.y) * (64u / ROW) + thread / ROW;
    var sum = vec3(0.0);
    if row < shard.count {
        let end = offsets[row + 1u];
        for (var i = offsets[row] + thread % ROW; i < end; i += ROW) {
            let cell = cells[i];
            sum += bitcast<f32>(cell.y) * values[cell.x].xyz;
        }
    }
    slices[thread] = sum;
    workgroupBarrier();
    if row < shard.count && thread % ROW == 0u {
        for (var k = 1u; k < ROW; k += 1u) {
            sum += slices[thread + k];
        }
        sums[shard.first + row] = vec4(sum, 0.0);
    }
}

struct NetKernel {
    table: RadialTable,
    // 1: adds to the potential that is there.
    is_added: u32,
    padding0: u32,
    padding1: u32,
    padding2: u32,
}

// Positions, mm, and their charges.
@group(0) @binding(2) var<storage, read> points: array<vec4<f32>>;
@group(0) @binding(3) var<uniform> kernel: NetKernel;
// A value at the start of each segment, and its slope per mm^2.
@group(0) @binding(4) var<storage, read> segments: array<vec4<f32>>;

// First and last point of a group, and where its list begins and ends.
@group(1) @binding(1) var<storage, read> groups: array<vec4<u32>>;
@group(1) @binding(2) var<storage, read> list: array<u32>;

@compute @workgroup_size(64)
fn smoothed(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let lane = thread % LANES;
    let index = workgroup.x + 65535u * workgroup.y;
    let group = groups[min(index, shard.count - 1u)];
    let point = group.x + lane;
    let at = points[min(point, group.y - 1u)].xyz;
    var sum = vec3(0.0);
    for (var i = group.z + thread / LANES; i < group.w; i += SLICES) {
        let source = list[i];
        let offset = points[source].xyz - at;
        sum += values[source].xyz * looked_up(kernel.table, dot(offset, offset));
    }
    slices[thread] = sum;
    workgroupBarrier();
    if thread < LANES && point < group.y && index < shard.count {
        sum = slices[lane] + slices[lane + LANES] + slices[lane + 2u * LANES] + slices[lane + 3u * LANES];
        if kernel.is_added == 1u {
            sum += sums[point].xyz;
        }
        sums[point] = vec4(sum, 0.0);
    }
}
