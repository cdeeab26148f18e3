// The near field that is never stored, as in transport/near_field.rs, and the stored far field combined for the material.

// [receiver][term], RGB.
@group(1) @binding(2) var<storage, read> far_values: array<f32>;
// [medium][term], RGB and 0; 16 for each medium.
@group(1) @binding(3) var<storage, read> coefficients: array<vec4<f32>>;

fn of_entry(job: u32, medium: u32, index: u32, at: vec3<f32>) -> vec3<f32> {
    let offset = patches[index].centre - at;
    let r2 = dot(offset, offset);
    let radius = patches[index].radius;
    let three = settings.three_points_below * radius;
    let split2 = media[medium].split2;
    let is_close = r2 < three * three - media[medium].smooth2;
    if !is_close && r2 >= split2 {
        return vec3(0.0);
    }
    let whole = reflectance(medium, r2);
    var far = whole;
    if r2 < split2 {
        far = polynomial(medium, r2 - split2);
    }
    let flux = irradiance[index].xyz * patches[index].area;
    if !is_close {
        return flux * (whole - far);
    }
    let exact = settings.exact_below * radius;
    return close_patch(medium, index, offset, r2 < exact * exact - media[medium].smooth2) - flux * far;
}

@compute @workgroup_size(WORKGROUP)
fn near(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let job = group.x;
    sum_slices(job, thread);
    let receiver = jobs[job].first_receiver + thread;
    if thread < LANES && receiver < jobs[job].end_receiver {
        var sum = sum_of(thread);
        for (var k = 0u; k < settings.terms && jobs[job].round == 0u; k += 1u) {
            let i = 3u * (receiver * settings.terms + k);
            let value = vec3(far_values[i], far_values[i + 1u], far_values[i + 2u]);
            sum += coefficients[16u * jobs[job].medium + k].xyz * value;
        }
        store(job, receiver, sum);
    }
}
