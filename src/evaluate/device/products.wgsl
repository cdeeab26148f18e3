// Dot products of rows of 16-bit integers with a few columns, one for each channel, as in forms/projected/components.rs.

struct Shard {
    // Two integers each.
    words: u32,
    first_row: u32,
    rows: u32,
    padding: u32,
}

// Of each column: RGB and 0.
@group(0) @binding(0) var<storage, read> columns: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read_write> references: array<vec4<f32>>;
// 1 to add to what is there, 0 to replace it; then a factor for each reference point.
@group(0) @binding(2) var<storage, read> factors: array<f32>;

@group(1) @binding(0) var<uniform> shard: Shard;
// [row][word]
@group(1) @binding(1) var<storage, read> coefficients: array<u32>;

const LANES: u32 = 16u;
// Rows of an invocation, which share what it reads of the columns.
const ROWS: u32 = 4u;

var<workgroup> sums: array<vec3<f32>, 256>;

fn term(word: u32, even: vec3<f32>, odd: vec3<f32>) -> vec3<f32> {
    let pair = bitcast<i32>(word);
    return f32(extractBits(pair, 0u, 16u)) * even + f32(extractBits(pair, 16u, 16u)) * odd;
}

@compute @workgroup_size(64)
fn products(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let lane = thread % LANES;
    let slot = thread / LANES * ROWS;
    let first = (group.x + 65535u * group.y) * ROWS * (64u / LANES) + slot;
    let last = shard.rows - 1u;
    let at = vec4(min(first, last), min(first + 1u, last), min(first + 2u, last), min(first + 3u, last)) * shard.words;
    var a = vec3(0.0);
    var b = vec3(0.0);
    var c = vec3(0.0);
    var d = vec3(0.0);
    for (var i = lane; i < shard.words; i += LANES) {
        let even = columns[2u * i].xyz;
        let odd = columns[2u * i + 1u].xyz;
        a += term(coefficients[at.x + i], even, odd);
        b += term(coefficients[at.y + i], even, odd);
        c += term(coefficients[at.z + i], even, odd);
        d += term(coefficients[at.w + i], even, odd);
    }
    sums[slot * LANES + lane] = a;
    sums[(slot + 1u) * LANES + lane] = b;
    sums[(slot + 2u) * LANES + lane] = c;
    sums[(slot + 3u) * LANES + lane] = d;
    workgroupBarrier();
    let row = first + lane;
    if lane < ROWS && row < shard.rows {
        var sum = vec3(0.0);
        for (var i = 0u; i < LANES; i += 1u) {
            sum += sums[(slot + lane) * LANES + i];
        }
        let at = shard.first_row + row;
        let before = select(vec4(0.0), references[at], factors[0] > 0.0);
        references[at] = before + vec4(factors[at + 1u] * sum, 0.0);
    }
}
