// Weighted sums of RGB values over the sources of each run; after runs.wgsl.

@group(0) @binding(0) var<storage, read> references: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read_write> radiosity: array<vec4<f32>>;

// Invocations of a run, two receivers each.
const LANES: u32 = 8u;

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
