//! The work of a gather, cut to what adapters take: bindings of limited size, dispatches of limited length, and loops
//! of limited length. Mesa's llvmpipe ends every loop of an invocation after 65,535 turns of all loops together,
//! without a word.

use std::ops::Range;

use bytemuck::{Pod, Zeroable};

use super::Device;
use crate::error::Result;
use crate::geometry::samples::Patch;
use crate::transport::kernel::EdgeRule;
use crate::transport::near_rule::NearField;
use crate::transport::receivers::{Receivers, Sphere};
use crate::transport::surface::Surface;

/// Receivers of one workgroup.
pub(super) const RECEIVERS: usize = 16;

/// Workgroups of one dispatch along one axis, on every adapter.
const MOST_WORKGROUPS: usize = 65_535;

/// Turns of all loops of one dispatch: long ones are ended where the adapter also draws the desktop.
const MOST_TURNS: usize = 1 << 30;

/// Turns of all loops of one invocation on a software adapter, and on others.
pub const MOST_TURNS_OF_SOFTWARE: usize = 60_000;
const MOST_TURNS_OF_HARDWARE: usize = 1 << 22;

/// Marks the entries of a list that are clusters.
pub const CLUSTER: u32 = 1 << 31;

/// Receivers that one workgroup serves, and the entries that they gather from in one round.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Job {
    centre: [f32; 3],
    radius: f32,
    first_receiver: u32,
    end_receiver: u32,
    first_entry: u32,
    end_entry: u32,
    medium: u32,
    direct: u32,
    round: u32,
    is_last: u32,
}

/// The samples or clusters that the receivers of a group gather from.
#[derive(Clone, Debug)]
pub enum Entries {
    /// The samples of a range.
    Samples(Range<u32>),
    /// The samples and clusters of a list.
    List(Vec<u32>),
}

impl Entries {
    fn len(&self) -> usize {
        match self {
            Self::Samples(range) => range.len(),
            Self::List(list) => list.len(),
        }
    }

    fn get(&self, index: usize) -> u32 {
        match self {
            Self::Samples(range) => range.start + index as u32,
            Self::List(list) => list[index],
        }
    }
}

/// Jobs of one dispatch and their lists.
pub struct Shard {
    /// Jobs, bound at 0.
    pub jobs: wgpu::Buffer,
    /// Lists of entries, bound at 1.
    pub list: wgpu::Buffer,
    /// Number of workgroups.
    pub count: u32,
}

/// Largest number of turns of the shaders' loops for each entry.
pub struct Effort {
    /// Turns of each sample closer than either distance.
    samples: Vec<(Patch, [usize; 2])>,
    /// In radii of a sample.
    below: [f64; 2],
}

impl Effort {
    /// The effort for samples in at most `pieces` pieces, edges integrated by the longest of some rules.
    pub fn new(surface: &Surface, near: NearField, rules: &[EdgeRule], pieces: usize) -> Self {
        let nodes = rules.iter().map(|(_, nodes)| nodes.len()).max().unwrap_or(0);
        // Three edges, their nodes and the search for the rule.
        let triangle = 3 * (nodes + 1) + rules.len();
        Self::with_turns(surface.patches, [near.exact_below, near.three_points_below], |index| {
            let facets = surface.samples.patch(index).len();
            // Neighbouring receivers may do both.
            let three_points = 4 * facets + pieces;
            [(triangle + 1) * (facets + pieces) + three_points, three_points]
        })
    }

    /// The effort for samples that take `turns` each: `[closer than the first distance, than the second]`, distances in
    /// radii of a sample.
    pub fn with_turns(patches: &[Patch], below: [f64; 2], turns: impl Fn(usize) -> [usize; 2]) -> Self {
        let of_sample = |(index, patch): (usize, &Patch)| (*patch, turns(index));
        Self { samples: patches.iter().enumerate().map(of_sample).collect(), below }
    }

    fn of(&self, entry: u32, sphere: &Sphere) -> usize {
        let Some((patch, turns)) = self.samples.get(entry as usize) else { return 1 };
        let distance = patch.centre_mm.distance(sphere.centre_mm) - sphere.radius_mm;
        // A little farther than the shader, which computes in single precision.
        let is_below = |radii: f64| distance < 1.001 * radii * patch.radius_mm;
        self.below.iter().zip(turns).find(|(radii, _)| is_below(**radii)).map_or(1, |(_, turns)| 1 + turns)
    }

    /// Cuts entries into ranges that one invocation takes.
    fn cut(&self, entries: &Entries, sphere: &Sphere, most: usize) -> Vec<Range<usize>> {
        let (mut result, mut first, mut turns) = (Vec::new(), 0, 0);
        for index in 0..entries.len() {
            let more = self.of(entries.get(index), sphere);
            if turns + more > most && index > first {
                result.push(first..index);
                (first, turns) = (index, 0);
            }
            turns += more;
        }
        // Receivers without sources have a job as well: it writes 0.
        result.push(first..entries.len());
        result
    }
}

/// The jobs and lists of the unfinished shard.
#[derive(Default)]
struct Pending {
    jobs: Vec<Job>,
    list: Vec<u32>,
    turns: usize,
}

impl Pending {
    fn finish(&mut self, device: &Device, shards: &mut Vec<Shard>) -> Result<()> {
        let Self { jobs, list, .. } = std::mem::take(self);
        if !jobs.is_empty() {
            let count = jobs.len() as u32;
            shards.push(Shard { jobs: device.storage("jobs", &jobs)?, list: device.storage("lists", &list)?, count });
        }
        Ok(())
    }
}

/// Makes the jobs of all groups of receivers from the `entries` of each group and the `medium` of each part, to be run
/// in their order.
///
/// # Errors
/// A single list beyond the adapter's bindings (exit 5).
pub fn shards(
    device: &Device,
    receivers: &Receivers,
    medium: impl Fn(u32) -> Option<u32>,
    entries: &[Entries],
    effort: &Effort,
) -> Result<Vec<Shard>> {
    use crate::parallel::*;
    let most = if device.is_software() { MOST_TURNS_OF_SOFTWARE } else { MOST_TURNS_OF_HARDWARE };
    let cuts: Vec<Vec<Range<usize>>> = receivers
        .groups
        .par_iter()
        .zip(entries)
        .map(|(group, entries)| effort.cut(entries, &receivers.sphere(*group), most))
        .collect();
    let most_entries = (device.largest_binding() / 4) as usize;
    let rounds = cuts.iter().map(Vec::len).max().unwrap_or(0);
    let (mut result, mut pending) = (Vec::new(), Pending::default());
    for round in 0..rounds {
        for ((group, entries), cuts) in receivers.groups.iter().zip(entries).zip(&cuts) {
            let Some(cut) = cuts.get(round) else { continue };
            let members = group.run.range();
            let listed = matches!(entries, Entries::List(_));
            if (listed && pending.list.len() + cut.len() > most_entries)
                || pending.jobs.len() + members.len().div_ceil(RECEIVERS) > MOST_WORKGROUPS
                || pending.turns > MOST_TURNS
            {
                pending.finish(device, &mut result)?;
            }
            pending.turns += cut.len() * members.len();
            let sphere = receivers.sphere(*group);
            let (first_entry, end_entry) = match entries {
                Entries::Samples(range) => (range.start + cut.start as u32, range.start + cut.end as u32),
                Entries::List(list) => {
                    let first = pending.list.len() as u32;
                    pending.list.extend_from_slice(&list[cut.clone()]);
                    (first, pending.list.len() as u32)
                }
            };
            // A part without a medium has no sources either, and its radiosity is 0.
            let (medium, end_entry) = medium(group.part).map_or((0, first_entry), |medium| (medium, end_entry));
            pending.jobs.extend(members.clone().step_by(RECEIVERS).map(|first| Job {
                centre: sphere.centre_mm.as_vec3().to_array(),
                radius: sphere.radius_mm as f32,
                first_receiver: first as u32,
                end_receiver: members.end.min(first + RECEIVERS) as u32,
                first_entry,
                end_entry,
                medium,
                direct: u32::from(!listed),
                round: round as u32,
                is_last: u32::from(round + 1 == cuts.len()),
            }));
        }
        // What adds to a receiver comes after what it adds to.
        pending.finish(device, &mut result)?;
    }
    Ok(result)
}
