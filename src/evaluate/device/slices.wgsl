// Entries of jobs summed by workgroups: lanes of receivers times slices of the entries; after kernel.wgsl. The shader has `of_entry`.

struct Job {
    // Bounding sphere of the receivers' group.
    centre: vec3<f32>,
    radius: f32,
    first_receiver: u32,
    end_receiver: u32,
    first_entry: u32,
    end_entry: u32,
    medium: u32,
    // 1: the entries are the samples themselves, without a list.
    direct: u32,
    // Above 0: adds to what an earlier round wrote.
    round: u32,
    // 1: no round of these receivers comes after this.
    is_last: u32,
}

@group(1) @binding(0) var<storage, read> jobs: array<Job>;
@group(1) @binding(1) var<storage, read> list: array<u32>;

// One for each thread: a lane of receivers times a slice of the entries.
var<workgroup> slices: array<vec3<f32>, WORKGROUP>;

// The sum of a lane's slices, after a barrier.
fn sum_of(lane: u32) -> vec3<f32> {
    var sum = vec3(0.0);
    for (var slice = 0u; slice < SLICES; slice += 1u) {
        sum += slices[lane + slice * LANES];
    }
    return sum;
}

// Sums what the entries of a job bring to its receivers, `of_entry` of the shader, each thread those of its slice.
fn sum_slices(job: u32, thread: u32) {
    let receiver = min(jobs[job].first_receiver + thread % LANES, jobs[job].end_receiver - 1u);
    let at = receivers[receiver].xyz;
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
        partial += of_entry(job, medium, entry, at);
        count += 1u;
        if (count & FLUSH) == 0u {
            total += partial;
            partial = vec3(0.0);
        }
    }
    slices[thread] = total + partial;
    workgroupBarrier();
}

// Later rounds add to what earlier ones wrote.
fn store(job: u32, receiver: u32, sum: vec3<f32>) {
    var total = sum;
    if jobs[job].round > 0u {
        total += radiosity[receiver].xyz;
    }
    radiosity[receiver] = vec4(total, 0.0);
}

// What a sample is summed as, by the receivers of a job or, where it is near to a wide group, by each alone, as in transport/gather.rs.
const WHOLE: u32 = 0u;
const POINTS: u32 = 1u;
const TRIANGLES: u32 = 2u;

fn summed_as(radius: f32, distance2: f32, smooth2: f32) -> u32 {
    let reach2 = distance2 + smooth2;
    let three = settings.three_points_below * radius;
    let exact = settings.exact_below * radius;
    if reach2 >= three * three {
        return WHOLE;
    }
    return select(TRIANGLES, POINTS, reach2 >= exact * exact);
}

// The same of a sample at an offset from a receiver of a job.
fn summed_by(job: u32, index: u32, offset: vec3<f32>, smooth2: f32) -> u32 {
    let radius = patches[index].radius;
    let distance = max(length(patches[index].centre - jobs[job].centre) - jobs[job].radius, 0.0);
    let together = summed_as(radius, distance * distance, smooth2);
    if together == TRIANGLES && jobs[job].radius > settings.narrow {
        return summed_as(radius, dot(offset, offset), smooth2);
    }
    return together;
}
