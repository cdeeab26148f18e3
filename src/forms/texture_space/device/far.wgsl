// Sums over the samples of a part with any radial profile, by its table; after radial_table.wgsl.

struct Sample {
    centre: vec4<f32>,
    flux: vec4<f32>,
}

struct Turn {
    // Samples of each part that come before these, and how many these are.
    before: u32,
    count: u32,
    receivers: u32,
    padding: u32,
}

@group(0) @binding(0) var<storage, read> receivers: array<vec4<f32>>;
// Part and medium of each receiver.
@group(0) @binding(1) var<storage, read> owners: array<vec2<u32>>;
// First and end of the samples of each part.
@group(0) @binding(2) var<storage, read> parts: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read> samples: array<Sample>;
@group(0) @binding(4) var<storage, read> tables: array<RadialTable>;
@group(0) @binding(5) var<storage, read> segments: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> radiosity: array<vec4<f32>>;

@group(1) @binding(0) var<uniform> turn: Turn;

@compute @workgroup_size(64)
fn far(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let receiver = 64u * (group.x + 65535u * group.y) + thread;
    if receiver >= turn.receivers {
        return;
    }
    let at = receivers[receiver].xyz;
    let table = tables[owners[receiver].y];
    let of_part = parts[owners[receiver].x];
    var total = vec3(0.0);
    if turn.before > 0u {
        total = radiosity[receiver].xyz;
    }
    var partial = vec3(0.0);
    let end = min(of_part.y, of_part.x + turn.before + turn.count);
    for (var i = of_part.x + turn.before; i < end; i += 1u) {
        let offset = samples[i].centre.xyz - at;
        partial += samples[i].flux.xyz * looked_up(table, dot(offset, offset));
        if (i & 31u) == 31u {
            total += partial;
            partial = vec3(0.0);
        }
    }
    radiosity[receiver] = vec4(total + partial, 0.0);
}
