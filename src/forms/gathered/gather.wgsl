// All samples and clusters of a list against the receivers of a job, as in transport/gather.rs.

struct Cluster {
    centre: vec4<f32>,
    flux: vec4<f32>,
}

@group(1) @binding(2) var<storage, read> clusters: array<Cluster>;

fn of_entry(job: u32, medium: u32, entry: u32, at: vec3<f32>) -> vec3<f32> {
    if (entry & CLUSTER) != 0u {
        let index = entry ^ CLUSTER;
        let offset = clusters[index].centre.xyz - at;
        return clusters[index].flux.xyz * reflectance(medium, dot(offset, offset));
    }
    return of_patch(job, medium, entry, at);
}

fn of_patch(job: u32, medium: u32, index: u32, at: vec3<f32>) -> vec3<f32> {
    let centre = patches[index].centre;
    let offset = centre - at;
    let how = summed_by(job, index, offset, media[medium].smooth2);
    if how == WHOLE {
        return irradiance[index].xyz * (patches[index].area * reflectance(medium, dot(offset, offset)));
    }
    return close_patch(medium, index, offset, how == TRIANGLES);
}

@compute @workgroup_size(WORKGROUP)
fn gather(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let job = group.x;
    sum_slices(job, thread);
    let receiver = jobs[job].first_receiver + thread;
    if thread < LANES && receiver < jobs[job].end_receiver {
        store(job, receiver, sum_of(thread));
    }
}
