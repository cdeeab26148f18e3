//! Far fields summed over every sample, or over a few neighbours as one, against which choices are made and errors measured.

use glam::DVec3;

use crate::geometry::samples::{Patch, Samples};
use crate::math::simd::{InstructionSet, multiversion};
use crate::medium::profile_basis::Table;
use crate::parallel::*;
use crate::transport::far_field::TERMS;
use crate::transport::receivers::Receivers;

/// Neighbouring samples merged into one source.
const NEIGHBOURS: usize = 4;

/// Far radiosity `[receiver][k]` under one light.
pub(super) type FarRadiosity = Vec<Vec<f64>>;

/// Source patches, and where each part begins among them.
pub(super) type Sources<'a> = (&'a [Patch], &'a [u32]);

/// Sources that each stand for a few neighbouring samples in tree order, so that a sum over all pairs costs less by
/// that factor. They serve to measure how a far field changes between receivers or with the basis, not its absolute
/// value.
pub(super) struct Merged {
    patches: Vec<Patch>,
    part_offsets: Vec<u32>,
    /// Area of each sample, mm^2.
    areas: Vec<f64>,
    /// One past the last sample of each source.
    ends: Vec<u32>,
}

impl Merged {
    pub(super) fn new(samples: &Samples, patches: &[Patch]) -> Self {
        let mut merged = Self {
            patches: Vec::new(),
            part_offsets: vec![0],
            areas: patches.iter().map(|p| p.area_mm2).collect(),
            ends: Vec::new(),
        };
        for part in 0..samples.part_offsets.len().saturating_sub(1) {
            let range = samples.part(part);
            let mut end = range.start;
            for run in patches[range].chunks(NEIGHBOURS) {
                let area_mm2: f64 = run.iter().map(|p| p.area_mm2).sum();
                let moment: DVec3 = run.iter().map(|p| p.centre_mm * p.area_mm2).sum();
                let centre_mm = if area_mm2 > 0.0 { moment / area_mm2 } else { run[0].centre_mm };
                merged.patches.push(Patch { centre_mm, area_mm2, ..Patch::default() });
                end += run.len();
                merged.ends.push(end as u32);
            }
            merged.part_offsets.push(merged.patches.len() as u32);
        }
        merged
    }

    pub(super) fn sources(&self) -> Sources<'_> {
        (&self.patches, &self.part_offsets)
    }

    /// Mean irradiance of the sources.
    pub(super) fn light(&self, irradiance: &[DVec3]) -> Vec<DVec3> {
        let mut first = 0;
        let mean = |(&end, patch): (&u32, &Patch)| {
            let samples = first..end as usize;
            first = samples.end;
            let flux: DVec3 = samples.map(|i| irradiance[i] * self.areas[i]).sum();
            if patch.area_mm2 > 0.0 { flux / patch.area_mm2 } else { DVec3::ZERO }
        };
        self.ends.iter().zip(&self.patches).map(mean).collect()
    }

    /// Far radiosity of each basis function at some receivers, under the first channel of each light (irradiance of the samples).
    pub(super) fn far_radiosity(
        &self,
        table: &Table,
        receivers: &Receivers,
        irradiances: &[&[DVec3]],
    ) -> Vec<FarRadiosity> {
        let lights: Vec<Vec<DVec3>> = irradiances.par_iter().map(|irradiance| self.light(irradiance)).collect();
        let lights: Vec<&[DVec3]> = lights.iter().map(Vec::as_slice).collect();
        all_pairs(self.sources(), table, receivers, &lights)
    }
}

/// Far radiosity of each basis function from every source at some receivers, under the first channel of each light.
pub(super) fn all_pairs(
    (patches, part_offsets): Sources,
    table: &Table,
    receivers: &Receivers,
    irradiances: &[&[DVec3]],
) -> Vec<FarRadiosity> {
    let (terms, lights) = (table.terms(), irradiances.len());
    let level = InstructionSet::detect();
    let of_source = |(index, patch): (usize, &Patch)| {
        let area = patch.area_mm2;
        irradiances.iter().map(move |irradiance| irradiance[index].x * area)
    };
    let fluxes: Vec<f64> = patches.iter().enumerate().flat_map(of_source).collect();
    let of_receiver = |(receiver, part): (DVec3, u32)| {
        let mut sums = vec![[0.0; TERMS]; lights];
        let part = part as usize;
        let sources = part_offsets[part] as usize..part_offsets[part + 1] as usize;
        let flux = &fluxes[sources.start * lights..sources.end * lights];
        pairs(level, table, receiver, (&patches[sources], flux), &mut sums);
        sums
    };
    let places: Vec<(DVec3, u32)> =
        receivers.groups.iter().flat_map(|g| receivers.positions[g.run.range()].iter().map(|&p| (p, g.part))).collect();
    let rows: Vec<Vec<[f64; TERMS]>> = places.into_par_iter().map(of_receiver).collect();
    (0..lights).map(|light| rows.iter().map(|row| row[light][..terms].to_vec()).collect()).collect()
}

#[inline(always)]
fn pairs_body(table: &Table, receiver: DVec3, (patches, flux): (&[Patch], &[f64]), sums: &mut [[f64; TERMS]]) {
    for (patch, flux) in patches.iter().zip(flux.chunks_exact(sums.len().max(1))) {
        let mut single = [0.0; TERMS];
        table.evaluate(patch.centre_mm.distance_squared(receiver) as f32, &mut single);
        let values = single.map(f64::from);
        for (sum, flux) in sums.iter_mut().zip(flux) {
            for k in 0..TERMS {
                sum[k] += flux * values[k];
            }
        }
    }
}

multiversion! {
    /// Adds the far radiosity of every function at a receiver under some lights, `[light][k]`; fluxes are `[patch][light]`.
    fn pairs(table: &Table, receiver: DVec3, sources: (&[Patch], &[f64]), sums: &mut [[f64; TERMS]]) => pairs_body
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three parts, of 6, 0 and 9 samples, and one of them without area.
    fn samples() -> (Samples, Vec<Patch>) {
        let samples =
            Samples { facets: Vec::new(), patch_offsets: (0..=15).collect(), part_offsets: vec![0, 6, 6, 15] };
        let place = |i: u32| DVec3::new(f64::from(i), f64::from(i * i % 7), f64::from(i * 5 % 3));
        let patch = |i: u32| Patch {
            centre_mm: place(i),
            area_mm2: if i == 14 { 0.0 } else { 0.5 + f64::from(i % 4) },
            ..Patch::default()
        };
        (samples, (0..15).map(patch).collect())
    }

    #[test]
    fn merged_sources_keep_the_light_of_each_part_and_where_it_is() {
        let (samples, patches) = samples();
        let merged = Merged::new(&samples, &patches);
        let (sources, part_offsets) = merged.sources();
        assert_eq!(part_offsets, [0, 2, 2, 5]);
        let irradiance: Vec<DVec3> = (0..15).map(|i| DVec3::new(f64::from(i * 3 % 8), 2.0, 1.0)).collect();
        let light = merged.light(&irradiance);
        // Flux of each channel, and where the area of a run is.
        let flux = |patches: &[Patch], e: &[DVec3]| patches.iter().zip(e).map(|(p, e)| *e * p.area_mm2).sum::<DVec3>();
        let moment = |patches: &[Patch]| patches.iter().map(|p| p.centre_mm * p.area_mm2).sum::<DVec3>();
        let runs = [0..4, 4..6, 6..10, 10..14, 14..15];
        for (i, run) in runs.into_iter().enumerate() {
            let (one, many) = (&sources[i..=i], &patches[run.clone()]);
            assert!((flux(one, &light[i..=i]) - flux(many, &irradiance[run])).length() < 1e-12);
            assert!((moment(one) - moment(many)).length() < 1e-12);
        }
        assert_eq!(sources[4].centre_mm, patches[14].centre_mm);
        assert_eq!(light[4], DVec3::ZERO);
    }
}
