// All samples and clusters of a list against the receivers of a job, as in transport/gather.rs.

struct Cluster {
    centre: vec4<f32>,
    flux: vec4<f32>,
}

@group(1) @binding(2) var<storage, read> clusters: array<Cluster>;

fn of_patch(job: u32, medium: u32, index: u32, at: vec3<f32>) -> vec3<f32> {
    let centre = patches[index].centre;
    let distance = max(length(centre - jobs[job].centre) - jobs[job].radius, 0.0);
    let reach2 = distance * distance + media[medium].smooth2;
    let three = settings.three_points_below * patches[index].radius;
    let offset = centre - at;
    if reach2 >= three * three {
        return irradiance[index].xyz * (patches[index].area * reflectance(medium, dot(offset, offset)));
    }
    let exact = settings.exact_below * patches[index].radius;
    return close_patch(medium, index, offset, reach2 < exact * exact);
}

@compute @workgroup_size(WORKGROUP)
fn gather(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let job = group.x;
    let lane = thread % LANES;
    let receiver = jobs[job].first_receiver + lane;
    let end_receiver = jobs[job].end_receiver;
    let at = receivers[min(receiver, end_receiver - 1u)].xyz;
    let medium = jobs[job].medium;
    let direct = jobs[job].direct == 1u;
    let end = jobs[job].end_entry;
    var total = vec3(0.0);
    var partial = vec3(0.0);
    var count = 0u;
    for (var i = jobs[job].first_entry + thread / LANES; i < end; i += SLICES) {
        var entry = i;
        if !direct {
            entry = list[i];
        }
        if (entry & CLUSTER) != 0u {
            let index = entry ^ CLUSTER;
            let offset = clusters[index].centre.xyz - at;
            partial += clusters[index].flux.xyz * reflectance(medium, dot(offset, offset));
        } else {
            partial += of_patch(job, medium, entry, at);
        }
        count += 1u;
        if (count & FLUSH) == 0u {
            total += partial;
            partial = vec3(0.0);
        }
    }
    slices[thread] = total + partial;
    workgroupBarrier();
    if thread < LANES && receiver < end_receiver {
        store(job, receiver, sum_of(lane));
    }
}
