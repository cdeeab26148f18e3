// Samples of a part at equal steps of its flux in the order of the mip-map, as in forms/texture_space/samples.rs; after node.wgsl.

struct Part {
    root: u32,
    // Of the samples of all parts.
    first: u32,
    end: u32,
    padding: u32,
}

struct Sample {
    centre: vec4<f32>,
    flux: vec4<f32>,
}

@group(0) @binding(0) var<storage, read> nodes: array<Node>;
@group(0) @binding(1) var<storage, read> parts: array<Part>;
@group(0) @binding(2) var<storage, read_write> samples: array<Sample>;

struct Numbers {
    samples: u32,
    parts: u32,
    padding0: u32,
    padding1: u32,
}

@group(1) @binding(0) var<uniform> numbers: Numbers;

@compute @workgroup_size(64)
fn draw(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let index = 64u * (group.x + 65535u * group.y) + thread;
    if index >= numbers.samples {
        return;
    }
    var part = 0u;
    while part + 1u < numbers.parts && index >= parts[part].end {
        part += 1u;
    }
    var node = parts[part].root;
    let total = nodes[node].weight;
    samples[index].centre = vec4(nodes[node].at, 0.0);
    samples[index].flux = vec4(0.0);
    if total <= 0.0 {
        return;
    }
    let count = f32(parts[part].end - parts[part].first);
    let share = total / count;
    var wanted = (f32(index - parts[part].first) + 0.5) * share;
    while nodes[node].first >= nodes[node].end {
        // Rounding may leave a little beyond the last child that is lit.
        var last = node + 1u;
        for (var child = node + 1u; child < nodes[node].next; child = nodes[child].next) {
            let weight = nodes[child].weight;
            if weight > 0.0 {
                last = child;
                if wanted < weight {
                    break;
                }
                wanted -= weight;
            }
        }
        if wanted >= nodes[last].weight {
            wanted = 0.5 * nodes[last].weight;
        }
        node = last;
    }
    let weight = nodes[node].weight;
    samples[index].centre = vec4(nodes[node].at, 0.0);
    samples[index].flux = vec4(nodes[node].rgb * select(0.0, share / weight, weight > 0.0), 0.0);
}
