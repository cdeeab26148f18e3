//! Walks from diffuse entry, and what they tell: moments of pairs of entry and exit, and the light that leaves at each
//! vertex where irradiance is the same everywhere.

use std::f64::consts::TAU;

use super::body::{Body, distance_and_heights};
use super::lattice::Lattice;
use super::layers::{SUPPORT, Splines};
use crate::medium::fresnel::{CosineTransmittance, refracted_cosine};
use crate::parallel::*;
use crate::progress::Progress;
use crate::transport::random_walk::boundary::MeshBoundary;
use crate::transport::random_walk::tally::SlotTally;
use crate::transport::random_walk::walk::{End, Start, Stream, WalkMedium, walk};

/// Photons of one task.
const CHUNK: u64 = 512;

/// Orders that are tallied apart: 1, and 2 and more.
pub(super) const ORDERS: usize = 2;

/// What walks of one channel tell, by order; sums of weights of the photons.
#[derive(Clone, Debug, Default)]
pub(super) struct Told {
    /// Photons.
    pub photons: u64,
    /// `Sum w B_k`, `Sum w B_k h` over the pairs: `[k][order]`.
    pub pairs: Vec<[[f64; 2]; ORDERS]>,
    /// Weight through the hat function of each slot: `[slot][order]`, of two independent halves.
    pub halves: [Vec<[f64; ORDERS]>; 2],
    /// Weight that was lost, over the photons.
    pub lost: f64,
    /// Scattering events.
    pub collisions: u64,
}

struct Chunk {
    pairs: Vec<[[f64; 2]; ORDERS]>,
    lost: f64,
    collisions: u64,
}

/// Walks photons through a body, an even number.
pub(super) fn told(
    (body, lattice): (&Body, &Lattice),
    (medium, entrance): (&WalkMedium, &CosineTransmittance),
    splines: &Splines,
    (photons, seed): (u64, u64),
    progress: &dyn Progress,
) -> Told {
    let half = photons.div_ceil(2);
    let mut result = Told { photons: 2 * half, pairs: vec![[[0.0; 2]; ORDERS]; splines.len()], ..Told::default() };
    for (index, of_half) in result.halves.iter_mut().enumerate() {
        let tally = SlotTally::new(lattice.len());
        let stage = crate::math::random::mix(seed ^ (index as u64 + 1));
        let chunk = |chunk: u64| {
            let range = chunk * CHUNK..((chunk + 1) * CHUNK).min(half);
            let mut sums = Chunk { pairs: vec![[[0.0; 2]; ORDERS]; splines.len()], lost: 0.0, collisions: 0 };
            progress.advance(range.end - range.start);
            for photon in range {
                let mut stream = Stream::new(stage, photon);
                let along = (photon as f64 + stream.uniform()) / half as f64;
                one((body, lattice), (medium, entrance), splines, (along, &mut stream), (&tally, &mut sums));
            }
            sums
        };
        let chunks: Vec<Chunk> = (0..half.div_ceil(CHUNK)).into_par_iter().map(chunk).collect();
        for chunk in chunks {
            let sums = result.pairs.as_flattened_mut().as_flattened_mut();
            sums.iter_mut().zip(chunk.pairs.as_flattened().as_flattened()).for_each(|(sum, part)| *sum += part);
            result.lost += chunk.lost;
            result.collisions += chunk.collisions;
        }
        *of_half = (0..lattice.len()).map(|slot| tally.take(slot)).collect();
    }
    result.lost /= result.photons.max(1) as f64;
    result
}

/// Walks one photon.
fn one(
    (body, lattice): (&Body, &Lattice),
    (medium, entrance): (&WalkMedium, &CosineTransmittance),
    splines: &Splines,
    (along, stream): (f64, &mut Stream),
    (tally, sums): (&SlotTally, &mut Chunk),
) {
    let Some(entry) = body.point(along, stream) else { return };
    let outside = entrance.sample_entrance_cosine(stream.uniform());
    let Some(inside) = refracted_cosine(entrance.eta_inside_over_outside(), outside) else { return };
    let (sin, cos) = (TAU * stream.uniform()).sin_cos();
    let (tangent, bitangent) = entry.normal.any_orthonormal_pair();
    let sideways = (1.0 - inside * inside).max(0.0).sqrt();
    let direction = sideways * (cos * tangent + sin * bitangent) - inside * entry.normal;
    let start = Start { at_mm: MeshBoundary::just_inside(entry.at_mm, entry.normal), direction };
    let walked = walk(&body.boundary, medium, start, stream);
    sums.collisions += walked.collisions;
    match walked.end {
        End::Left { site, order, weight } if order > 0 => {
            let (u, v) = (f64::from(site.u), f64::from(site.v));
            if let Some(there) = lattice.at(site.triangle, u, v) {
                tally.add_shares(there, order > 1, weight);
            }
            let exit = body.at_site(site.triangle, u, v);
            let (r, heights) = distance_and_heights(exit, entry);
            let h = heights * splines.fade_per_mm(r);
            let (first, values): (usize, [f64; SUPPORT]) = splines.at(r);
            for (entry, value) in sums.pairs.iter_mut().skip(first).zip(values) {
                let of_order = &mut entry[usize::from(order > 1)];
                of_order[0] += weight * value;
                of_order[1] += weight * value * h;
            }
        }
        End::Lost(weight) => sums.lost += weight,
        _ => {}
    }
}
