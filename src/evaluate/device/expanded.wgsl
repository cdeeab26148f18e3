// Far radiosity of every basis function at the receivers, as weighted sums over the points that it is stored at; after runs.wgsl.

// [point][function] and [receiver][function], RGB.
@group(0) @binding(0) var<storage, read> stored: array<f32>;
@group(0) @binding(1) var<storage, read_write> expanded: array<f32>;

// An invocation for each receiver of a run.
@compute @workgroup_size(64)
fn expand(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let lane = thread % RECEIVERS;
    let run = (group.x + 65535u * group.y) * (64u / RECEIVERS) + thread / RECEIVERS;
    let receiver = (shard.first_run + run) * RECEIVERS + lane;
    if run >= shard.runs || receiver >= shard.receivers {
        return;
    }
    let end = offsets[run + 1u];
    for (var k = 0u; k < shard.terms; k += 1u) {
        var sum = vec3(0.0);
        for (var i = offsets[run]; i < end; i += 1u) {
            let at = 3u * (sources[i] * shard.terms + k);
            sum += weight_of(i, lane) * vec3(stored[at], stored[at + 1u], stored[at + 2u]);
        }
        let at = 3u * (receiver * shard.terms + k);
        expanded[at] = sum.x * UNIT;
        expanded[at + 1u] = sum.y * UNIT;
        expanded[at + 2u] = sum.z * UNIT;
    }
}
