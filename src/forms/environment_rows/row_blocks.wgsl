// From products of rows in blocks to irradiance, as in compress/row_blocks.rs: each sample adds up what is on its way down.

struct Settings {
    samples: u32,
    // Scale of the cube map over that of the irradiance.
    factor: f32,
    padding0: u32,
    padding1: u32,
}

@group(0) @binding(0) var<uniform> settings: Settings;
@group(0) @binding(1) var<storage, read> products: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> irradiance: array<vec4<f32>>;

// Of each sample: the first sample of its block, and how many there are.
@group(1) @binding(0) var<storage, read> blocks: array<vec2<u32>>;

@compute @workgroup_size(64)
fn add_blocks(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let index = 64u * (group.x + 65535u * group.y) + thread;
    if index >= settings.samples {
        return;
    }
    var first = blocks[index].x;
    var count = blocks[index].y;
    var sum = products[first].xyz;
    while count > 1u {
        let left = (count + 1u) / 2u;
        let right = count - left;
        let difference = products[first + left].xyz;
        if index < first + left {
            sum += difference * (f32(right) / f32(count));
            count = left;
        } else {
            sum -= difference * (f32(left) / f32(count));
            first += left;
            count = right;
        }
    }
    irradiance[index] += vec4(sum * settings.factor, 0.0);
}
