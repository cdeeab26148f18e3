// Far radiosity of some basis functions at the receivers that have none of their own, as weighted sums over the rows that have them, as in
// forms/factored/far_sums.rs; after runs.wgsl.

// [row][function], RGB; the first rows are those of the receivers. What is read is not written: a row has a function or not, and
// one buffer cannot be bound twice, to read and to write, as in expanded.wgsl.
@group(0) @binding(0) var<storage, read_write> values: array<f32>;
// Those that are filled in.
@group(0) @binding(1) var<storage, read> receivers: array<u32>;

// An invocation for each receiver of a run.
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
            let at = 3u * (sources[i] * shard.terms + k);
            sum += weight_of(i, lane) * vec3(values[at], values[at + 1u], values[at + 2u]);
        }
        let at = 3u * (receiver * shard.terms + k);
        values[at] = sum.x * UNIT;
        values[at + 1u] = sum.y * UNIT;
        values[at + 2u] = sum.z * UNIT;
    }
}
