//! The tallies of photons: exitance on the vertices' hat functions, and the balance of the flux.

use std::sync::atomic::{AtomicU64, Ordering};

use super::boundary::Site;
use super::walk::{End, Walked};
use crate::geometry::mesh::Mesh;
use crate::geometry::part_table::PartTable;

/// No slot.
pub const NONE: u32 = u32::MAX;

/// The hat functions of a scene: one slot for each welded vertex and part with a medium.
#[derive(Clone, Debug, PartialEq)]
pub struct Hats {
    /// Slots of the corners of each triangle; [`NONE`] for opaque ones.
    pub corners: Vec<[u32; 3]>,
    /// Area of each triangle, mm^2.
    pub triangle_area_mm2: Vec<f64>,
    /// Integral of each hat function, mm^2: a third of the area of the triangles around it.
    pub mass_mm2: Vec<f64>,
    /// The welded vertex of each slot.
    pub vertex: Vec<u32>,
    /// The slot whose value each source vertex takes, that of the first of its parts; [`NONE`] without area.
    pub of_vertex: Vec<u32>,
}

impl Hats {
    /// The hat functions of the parts that transfer light.
    pub fn new(mesh: &Mesh, parts: &PartTable) -> Self {
        let part_of = |t: u32| parts.triangle_part.get(t as usize).copied().unwrap_or(NONE);
        let transfers = |t: u32| parts.parts.get(part_of(t) as usize).is_some_and(|p| p.transfers());
        let triangles = 0..mesh.triangles.len() as u32;
        let mut keys: Vec<(u32, u32)> = triangles
            .clone()
            .filter(|&t| transfers(t))
            .flat_map(|t| mesh.welded(t).map(|weld| (weld, part_of(t))))
            .collect();
        keys.sort_unstable();
        keys.dedup();
        let slot = |weld: u32, part: u32| keys.binary_search(&(weld, part)).map_or(NONE, |i| i as u32);
        let corners_of = |t: u32| if transfers(t) { mesh.welded(t).map(|w| slot(w, part_of(t))) } else { [NONE; 3] };
        let corners: Vec<[u32; 3]> = triangles.clone().map(corners_of).collect();
        let triangle_area_mm2: Vec<f64> = triangles.map(|t| mesh.area_mm2(t)).collect();
        let mut mass_mm2 = vec![0.0; keys.len()];
        for (corners, area) in corners.iter().zip(&triangle_area_mm2) {
            for &c in corners {
                if let Some(mass) = mass_mm2.get_mut(c as usize) {
                    *mass += area / 3.0;
                }
            }
        }
        let first = |weld: &u32| keys.partition_point(|k| k < &(*weld, 0));
        let of_weld = |weld: &u32| match keys.get(first(weld)) {
            Some((found, _)) if found == weld => first(weld) as u32,
            _ => NONE,
        };
        let of_vertex = mesh.weld.iter().map(of_weld).collect();
        let vertex = keys.iter().map(|k| k.0).collect();
        Self { corners, triangle_area_mm2, mass_mm2, vertex, of_vertex }
    }

    /// Number of slots.
    pub(super) fn len(&self) -> usize {
        self.mass_mm2.len()
    }

    /// Values of source vertices from values of slots; 0 for vertices without a slot.
    pub fn to_vertices<T: Copy + Default>(&self, values: &[T]) -> Vec<T> {
        self.of_vertex.iter().map(|&s| values.get(s as usize).copied().unwrap_or_default()).collect()
    }
}

/// Weights are counted in these units, so that the order of addition does not matter. A slot holds 2^32 photons.
const UNITS: f64 = 4_294_967_296.0;

/// Weight that left through each hat function, of one batch; may be added to from many threads.
pub(in crate::transport) struct SlotTally {
    sums: Vec<[AtomicU64; 2]>,
}

impl SlotTally {
    pub(in crate::transport) fn new(slots: usize) -> Self {
        Self { sums: std::iter::repeat_with(Default::default).take(slots).collect() }
    }

    /// Adds a photon that left at a site after one scattering event, or after several.
    #[inline]
    pub(super) fn add(&self, hats: &Hats, site: Site, several: bool, weight: f64) {
        let Some(&corners) = hats.corners.get(site.triangle as usize) else { return };
        let (u, v) = (f64::from(site.u), f64::from(site.v));
        self.add_shares((corners, [1.0 - u - v, u, v]), several, weight);
    }

    /// Adds a photon through the hat functions of three slots.
    #[inline]
    pub(in crate::transport) fn add_shares(&self, (slots, shares): ([u32; 3], [f64; 3]), several: bool, weight: f64) {
        for (slot, share) in slots.into_iter().zip(shares) {
            if let Some(sums) = self.sums.get(slot as usize) {
                // A site on an edge may have a weight below 0 by rounding; the conversion makes it 0.
                sums[usize::from(several)].fetch_add((weight * share * UNITS).round() as u64, Ordering::Relaxed);
            }
        }
    }

    /// Weights of order 1 and of higher orders of a slot; sets its sums to zero.
    pub(in crate::transport) fn take(&self, slot: usize) -> [f64; 2] {
        self.sums[slot].each_ref().map(|sum| sum.swap(0, Ordering::Relaxed) as f64 / UNITS)
    }
}

/// The balance of the flux that entered, in one unit: photons, or flux once scaled.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Budget {
    /// Flux that entered.
    pub entered: f64,
    /// Flux that left without having been scattered: straight through. It is not part of the exitance.
    pub left_unscattered: f64,
    /// Flux that left after one scattering event.
    pub left_once: f64,
    /// Flux that left after several scattering events.
    pub left_more: f64,
    /// Flux that was found outside without having left: openings and rounding. Otherwise it counts in `entered` only.
    pub lost: f64,
    /// Flux that total reflection keeps inside for good.
    pub trapped: f64,
    /// Scattering events and absorptions, a count.
    pub collisions: u64,
}

impl Budget {
    /// Adds the end of a photon that entered with weight 1.
    #[inline]
    pub fn add(&mut self, walked: &Walked) {
        self.entered += 1.0;
        self.collisions += walked.collisions;
        match walked.end {
            End::Left { order: 0, weight, .. } => self.left_unscattered += weight,
            End::Left { order: 1, weight, .. } => self.left_once += weight,
            End::Left { weight, .. } => self.left_more += weight,
            End::Absorbed => {}
            End::Lost(weight) => self.lost += weight,
            End::Trapped(weight) => self.trapped += weight,
        }
    }

    /// The sum of two budgets.
    #[must_use]
    pub fn plus(self, other: &Self) -> Self {
        let sum = self.of_each(other, |a, b| a + b);
        Self { collisions: self.collisions + other.collisions, ..sum }
    }

    /// Every flux times a factor.
    #[must_use]
    pub fn scaled(self, factor: f64) -> Self {
        self.of_each(&self, |flux, _| flux * factor)
    }

    /// A function of each flux of two budgets, beside the collisions of the first.
    fn of_each(self, other: &Self, of: impl Fn(f64, f64) -> f64) -> Self {
        Self {
            entered: of(self.entered, other.entered),
            left_unscattered: of(self.left_unscattered, other.left_unscattered),
            left_once: of(self.left_once, other.left_once),
            left_more: of(self.left_more, other.left_more),
            lost: of(self.lost, other.lost),
            trapped: of(self.trapped, other.trapped),
            collisions: self.collisions,
        }
    }

    /// Flux that left after at least one scattering event, over the flux that entered.
    pub fn reflectance(&self) -> f64 {
        self.share(self.left_once + self.left_more)
    }

    /// A flux over the flux that entered; 0 if none did.
    pub fn share(&self, flux: f64) -> f64 {
        if self.entered > 0.0 { flux / self.entered } else { 0.0 }
    }
}
