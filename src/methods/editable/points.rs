//! Where the far field is stored: points among the receivers that are apart by a few sample spacings. It is smooth inside the split
//! radius, so that the receivers between take what kriging makes of the points around them.

use glam::DVec3;
use translux_format::far_field::FarField;

use crate::error::{Error, Result};
use crate::geometry::cluster::Run;
use crate::geometry::scattered::{Kriging, OrientedPoint, choose};
use crate::methods::references::weights_of_some;
use crate::methods::stage::parts;
use crate::transport::far_field::LANES;
use crate::transport::interpolation::SharedWeights;
use crate::transport::receivers::{Group, NONE, Receivers};

/// How the far field is interpolated. Closed bunny of 30 mm, points 4 sample spacings apart: 0.37 % from 32 sources, 0.72 % from 16.
const FIT: Kriging = Kriging::SMOOTH;

/// Points of the far field.
pub(super) struct FarPoints {
    /// In groups; their vertices alone have one of them.
    pub(super) receivers: Receivers,
    /// Weights of all receivers over them; none where every receiver is one.
    pub(super) weights: Option<SharedWeights>,
}

impl FarPoints {
    /// Some of `all`, about so far apart, mm; all of them at 0.
    pub(super) fn choose(all: &Receivers, spacing_mm: f64) -> Self {
        let places = places(all);
        let of_part = |part: std::ops::Range<usize>| {
            let first = part.start as u32;
            let mut chosen: Vec<u32> = match spacing_mm > 0.0 {
                true => choose(&places[part], spacing_mm).concat(),
                false => (0..part.len() as u32).collect(),
            };
            chosen.sort_unstable();
            chosen.into_iter().map(move |i| first + i)
        };
        let chosen: Vec<u32> = parts(all).into_iter().flat_map(of_part).collect();
        let mut receivers = all.only(&chosen, LANES);
        let mut index = vec![NONE; all.len()];
        chosen.iter().enumerate().for_each(|(i, &receiver)| index[receiver as usize] = i as u32);
        receivers.of_vertex = all.of_vertex.iter().map(|&r| index.get(r as usize).copied().unwrap_or(NONE)).collect();
        let weights = weights(all, &places, &chosen);
        Self { receivers, weights }
    }

    /// Those of a stored far field.
    ///
    /// # Errors
    /// Points that are not some of the receivers in their order (exit 3).
    pub(super) fn of(far: &FarField, all: &Receivers) -> Result<Self> {
        let apart = || Error::input("the far field and the mesh do not belong together; bake the asset again");
        let mut chosen = vec![NONE; far.receivers()];
        for (&point, &receiver) in far.receiver_of_vertex.iter().zip(&all.of_vertex) {
            if let Some(slot) = chosen.get_mut(point as usize) {
                *slot = receiver;
            }
        }
        let places = places(all);
        if !chosen.is_sorted_by(|a, b| a < b) || chosen.last().is_some_and(|&last| last as usize >= all.len()) {
            return Err(apart());
        }
        let mut receivers = Receivers {
            positions: chosen.iter().map(|&i| places[i as usize].at_mm).collect(),
            groups: Vec::with_capacity(far.groups.len()),
            of_vertex: far.receiver_of_vertex.clone(),
        };
        let mut first = 0;
        for group in &far.groups {
            receivers.groups.push(Group { run: Run { first, end: group.receivers_end }, part: group.part });
            first = group.receivers_end;
        }
        let part_of = |index: u32| all.groups.get(all.groups.partition_point(|g| g.run.end <= index)).map(|g| g.part);
        let fits = |g: &Group| chosen[g.run.range()].iter().all(|&i| part_of(i) == Some(g.part));
        if !receivers.groups.iter().all(fits) {
            return Err(apart());
        }
        let weights = weights(all, &places, &chosen);
        Ok(Self { receivers, weights })
    }

    /// Values at the points brought to all receivers.
    pub(super) fn expand(&self, values: Vec<DVec3>) -> Vec<DVec3> {
        let Some(weights) = &self.weights else { return values };
        let largest = values.iter().map(|v| v.abs().max_element()).fold(0.0, f64::max);
        let scale = crate::transport::balanced_tree::power_of_two_near(largest);
        let single: Vec<[f32; 4]> = values.iter().map(|v| (*v / scale).extend(0.0).as_vec4().into()).collect();
        let mut gathered = Vec::new();
        weights.apply_signed(&single, &mut gathered);
        gathered.iter().map(|&[r, g, b, _]| DVec3::new(r.into(), g.into(), b.into()) * scale).collect()
    }

    /// Bytes in memory.
    pub(super) fn bytes(&self) -> usize {
        self.weights.as_ref().map_or(0, SharedWeights::bytes) + size_of_val(self.receivers.positions.as_slice())
    }
}

/// Without normals: kernels are smooth across an edge, and through something thin.
fn places(all: &Receivers) -> Vec<OrientedPoint> {
    all.positions.iter().map(|&at_mm| OrientedPoint { at_mm, normal: DVec3::ZERO }).collect()
}

/// About how far apart so many points among others are: only how fast neighbours are found depends on it.
fn apart_mm(points: &[OrientedPoint], count: usize) -> f64 {
    let grow = |(low, high): (DVec3, DVec3), p: &OrientedPoint| (low.min(p.at_mm), high.max(p.at_mm));
    let (low, high) = points.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), grow);
    low.distance(high) / (count.max(1) as f64).sqrt()
}

fn weights(all: &Receivers, places: &[OrientedPoint], chosen: &[u32]) -> Option<SharedWeights> {
    if chosen.len() == all.len() {
        return None;
    }
    let weights = weights_of_some(chosen, places, all, (apart_mm(places, chosen.len()), 1), FIT);
    Some(SharedWeights::new(&weights))
}
