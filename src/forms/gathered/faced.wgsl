// The fields of double layers at receivers added to their radiosity, each as its normal takes them; after kernel.wgsl.

struct Range {
    first: u32,
    end: u32,
    padding0: u32,
    padding1: u32,
}

@group(1) @binding(0) var<uniform> range: Range;
@group(1) @binding(1) var<storage, read> under: array<vec4<f32>>;
@group(1) @binding(2) var<storage, read> over_x: array<vec4<f32>>;
@group(1) @binding(3) var<storage, read> over_y: array<vec4<f32>>;
@group(1) @binding(4) var<storage, read> over_z: array<vec4<f32>>;

@compute @workgroup_size(64)
fn faced(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let receiver = range.first + 64u * (group.x + 65535u * group.y) + thread;
    if receiver >= range.end {
        return;
    }
    let normal = normal_of(receiver);
    let over = normal.x * over_x[receiver] + normal.y * over_y[receiver] + normal.z * over_z[receiver];
    radiosity[receiver] += vec4((under[receiver] + over).xyz, 0.0);
}
