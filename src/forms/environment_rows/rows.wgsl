// Stored irradiance rows times a cube map, as in compress/rows.rs.

struct Settings {
    terms: u32,
    // Texels of a face.
    face: u32,
    rows: u32,
    padding: u32,
}

struct Row {
    patch_index: u32,
    part: u32,
    first: u32,
    end: u32,
    step: f32,
    scaling_step: f32,
    padding0: u32,
    padding1: u32,
}

@group(0) @binding(0) var<uniform> settings: Settings;
// Haar coefficients of the cube map.
@group(0) @binding(1) var<storage, read> radiance: array<vec4<f32>>;
// Of each part: the coefficients of the functions of the angle.
@group(0) @binding(2) var<storage, read> coefficients: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> products: array<vec4<f32>>;

@group(1) @binding(0) var<storage, read> rows: array<Row>;
// 16 bits each.
@group(1) @binding(1) var<storage, read> indices: array<u32>;
// 8 bits each: for each row and term the values of all its coefficients.
@group(1) @binding(2) var<storage, read> values: array<u32>;
// 16 bits each: [row][term][face].
@group(1) @binding(3) var<storage, read> scaling: array<u32>;

const FACES: u32 = 6u;
const LANES: u32 = 16u;

var<workgroup> sums: array<vec3<f32>, 64>;

fn value_at(i: u32) -> f32 {
    return f32(extractBits(bitcast<i32>(values[i / 4u]), 8u * (i % 4u), 8u));
}

@compute @workgroup_size(64)
fn multiply_rows(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let lane = thread % LANES;
    let index = 4u * (group.x + 65535u * group.y) + thread / LANES;
    var total = vec3(0.0);
    if index < settings.rows {
        let row = rows[index];
        let count = row.end - row.first;
        let c = coefficients[row.part];
        var detail = vec3(0.0);
        for (var i = lane; i < count; i += LANES) {
            var weight = 0.0;
            for (var j = 0u; j < settings.terms; j += 1u) {
                weight += c[j] * value_at(row.first * settings.terms + j * count + i);
            }
            let at = row.first + i;
            let texel = extractBits(indices[at / 2u], 16u * (at % 2u), 16u);
            detail += weight * radiance[texel].xyz;
        }
        total = detail * row.step;
        for (var k = lane; k < settings.terms * FACES; k += LANES) {
            let at = index * settings.terms * FACES + k;
            let value = f32(extractBits(bitcast<i32>(scaling[at / 2u]), 16u * (at % 2u), 16u));
            total += (c[k / FACES] * value * row.scaling_step) * radiance[(k % FACES) * settings.face].xyz;
        }
    }
    sums[thread] = total;
    workgroupBarrier();
    if lane == 0u && index < settings.rows {
        var sum = vec3(0.0);
        for (var i = 0u; i < LANES; i += 1u) {
            sum += sums[thread + i];
        }
        products[rows[index].patch_index] = vec4(sum, 0.0);
    }
}
