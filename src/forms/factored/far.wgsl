// The stored far field under one light, for every basis function, as in forms/factored/far_sums.rs.

struct Group {
    part: u32,
    first_receiver: u32,
    end_receiver: u32,
    first: u32,
    end: u32,
    padding0: u32,
    padding1: u32,
    padding2: u32,
}

// Steps of the quantiser, four a vector.
struct Steps {
    values: array<vec4<f32>, 4>,
    terms: u32,
    padding0: u32,
    padding1: u32,
    padding2: u32,
}

@group(0) @binding(0) var<uniform> steps: Steps;
// Mean irradiance of the left child less that of the right one, by the name of the node.
@group(0) @binding(1) var<storage, read> details: array<vec4<f32>>;
// Mean irradiance of each part.
@group(0) @binding(2) var<storage, read> means: array<vec4<f32>>;
// [receiver][term], mm^2.
@group(0) @binding(3) var<storage, read> row_sums: array<f32>;
// [receiver][term], RGB.
@group(0) @binding(4) var<storage, read_write> far_values: array<f32>;

@group(1) @binding(0) var<storage, read> groups: array<Group>;
// Node, functions present and (in the upper half) those of 16 bits, first row of 8 bits, first row of 16 bits.
@group(1) @binding(1) var<storage, read> coefficients: array<vec4<u32>>;
@group(1) @binding(2) var<storage, read> narrow: array<u32>;
@group(1) @binding(3) var<storage, read> wide: array<u32>;

const LANES: u32 = 16u;
const HALF_ROOT: f32 = 0.70710678;

var<workgroup> level: array<vec3<f32>, 256>;

@compute @workgroup_size(256)
fn far(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let group = workgroup.x;
    let lane = thread % LANES;
    let k = thread / LANES;
    let bit = 1u << k;
    var sum = vec3(0.0);
    if k < steps.terms {
        let end = groups[group].end;
        for (var c = groups[group].first; c < end; c += 1u) {
            let coefficient = coefficients[c];
            let present = coefficient.y & 0xffffu;
            if (present & bit) == 0u {
                continue;
            }
            let wides = coefficient.y >> 16u;
            let below = present & (bit - 1u);
            var value: i32;
            if (wides & bit) != 0u {
                let row = coefficient.w + countOneBits(below & wides);
                value = extractBits(bitcast<i32>(wide[8u * row + lane / 2u]), 16u * (lane % 2u), 16u);
            } else {
                let row = coefficient.z + countOneBits(below & ~wides);
                value = extractBits(bitcast<i32>(narrow[4u * row + lane / 4u]), 8u * (lane % 4u), 8u);
            }
            sum += f32(value) * details[coefficient.x].xyz;
        }
    }
    // The Haar transform over the lanes, once for the sums.
    let row = k * LANES;
    for (var half = 1u; half < LANES; half *= 2u) {
        level[thread] = sum;
        workgroupBarrier();
        if lane < 2u * half {
            let a = level[row + lane / 2u];
            let b = level[row + half + lane / 2u];
            sum = HALF_ROOT * select(a - b, a + b, (lane & 1u) == 1u);
        }
        workgroupBarrier();
    }
    let receiver = groups[group].first_receiver + lane;
    if k < steps.terms && receiver < groups[group].end_receiver {
        let i = receiver * steps.terms + k;
        let value = sum * steps.values[k / 4u][k % 4u] + row_sums[i] * means[groups[group].part].xyz;
        far_values[3u * i] = value.x;
        far_values[3u * i + 1u] = value.y;
        far_values[3u * i + 2u] = value.z;
    }
}
