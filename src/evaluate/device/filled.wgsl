// Far radiosity of some basis functions at the receivers that have none of their own, as weighted sums over the rows that have them, which
// runs of neighbouring receivers share: forms/factored/far_sums.rs.

struct Shard {
    first_run: u32,
    runs: u32,
    // Of all runs.
    receivers: u32,
    terms: u32,
    padding0: u32,
    padding1: u32,
    // Bit k: function k is filled in.
    functions: u32,
    padding2: u32,
}

// [row][function], RGB; the first rows are those of the receivers. What is read is not written: a row has a function or not, and
// one buffer cannot be bound twice, to read and to write, as in expanded.wgsl.
@group(0) @binding(0) var<storage, read_write> values: array<f32>;
// Those that are filled in.
@group(0) @binding(1) var<storage, read> receivers: array<u32>;

@group(1) @binding(0) var<uniform> shard: Shard;
// Of each run: where it begins in the sources; and the end.
@group(1) @binding(1) var<storage, read> offsets: array<u32>;
@group(1) @binding(2) var<storage, read> sources: array<u32>;
// [source][receiver of the run], two each.
@group(1) @binding(3) var<storage, read> weights: array<u32>;

// Receivers of a run, one for each invocation.
const RECEIVERS: u32 = 16u;
const UNIT: f32 = 1.0 / 16384.0;

@compute @workgroup_size(64)
fn fill(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let lane = thread % RECEIVERS;
    let run = (group.x + 65535u * group.y) * (64u / RECEIVERS) + thread / RECEIVERS;
    let index = (shard.first_run + run) * RECEIVERS + lane;
    if run >= shard.runs || index >= shard.receivers {
        return;
    }
    let receiver = receivers[index];
    let end = offsets[run + 1u];
    for (var k = 0u; k < shard.terms; k += 1u) {
        if (shard.functions & (1u << k)) == 0u {
            continue;
        }
        var sum = vec3(0.0);
        for (var i = offsets[run]; i < end; i += 1u) {
            let pair = bitcast<i32>(weights[RECEIVERS / 2u * i + lane / 2u]);
            let weight = f32(extractBits(pair, 16u * (lane % 2u), 16u));
            let at = 3u * (sources[i] * shard.terms + k);
            sum += weight * vec3(values[at], values[at + 1u], values[at + 2u]);
        }
        let at = 3u * (receiver * shard.terms + k);
        values[at] = sum.x * UNIT;
        values[at + 1u] = sum.y * UNIT;
        values[at + 2u] = sum.z * UNIT;
    }
}
