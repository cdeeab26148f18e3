// Weighted sums over sources that runs of neighbouring receivers share, as in transport/interpolation.rs.

struct Shard {
    first_run: u32,
    runs: u32,
    // Of all runs.
    receivers: u32,
    terms: u32,
    // Where the receivers begin in what is written.
    first_receiver: u32,
    // 1: negative sums are written as they are, not as 0.
    is_signed: u32,
    padding0: u32,
    padding1: u32,
}

@group(0) @binding(0) var<storage, read> references: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read_write> radiosity: array<vec4<f32>>;

@group(1) @binding(0) var<uniform> shard: Shard;
// Of each run: where it begins in the sources; and the end.
@group(1) @binding(1) var<storage, read> offsets: array<u32>;
@group(1) @binding(2) var<storage, read> sources: array<u32>;
// [source][receiver of the run], two each.
@group(1) @binding(3) var<storage, read> weights: array<u32>;

// Receivers of a run, and invocations, two receivers each.
const RECEIVERS: u32 = 16u;
const LANES: u32 = 8u;
const UNIT: f32 = 1.0 / 16384.0;

fn store(receiver: u32, sum: vec3<f32>) {
    if receiver < shard.receivers {
        let value = sum * UNIT;
        radiosity[shard.first_receiver + receiver] = vec4(select(max(value, vec3(0.0)), value, shard.is_signed == 1u), 0.0);
    }
}

@compute @workgroup_size(64)
fn interpolate(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let lane = thread % LANES;
    let run = (group.x + 65535u * group.y) * (64u / LANES) + thread / LANES;
    if run >= shard.runs {
        return;
    }
    let end = offsets[run + 1u];
    var even = vec3(0.0);
    var odd = vec3(0.0);
    for (var i = offsets[run]; i < end; i += 1u) {
        let pair = bitcast<i32>(weights[LANES * i + lane]);
        let value = references[sources[i]].xyz;
        even += f32(extractBits(pair, 0u, 16u)) * value;
        odd += f32(extractBits(pair, 16u, 16u)) * value;
    }
    let receiver = (shard.first_run + run) * RECEIVERS + 2u * lane;
    store(receiver, even);
    store(receiver + 1u, odd);
}
