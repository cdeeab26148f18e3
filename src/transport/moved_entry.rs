//! Entry of light where it first scatters.
//!
//! Light that enters at `y` along a refracted direction scatters for the first time a free path further on. A kernel
//! that was calibrated with diffuse entry knows the mean of that; under a lone direction the irradiance is moved by the
//! tangential part of the step: the place of the first collision is brought back to the surface along the outward normal
//! of the entrance. Where that meets no surface of the body, the light stays. No light is lost.
//!
//! Moved light is fetched, not thrown: each sample takes the irradiance of the places that steps of a few fixed lengths come from, which
//! is as smooth as the irradiance itself. Places are found between neighbours in a few directions and distances, which are looked up once for
//! all lights. What is thrown from the same samples with the same lengths says how much light there is of which
//! a neighbourhood has its share: where normals converge it gathers, and the fetched light is brought to that, over cells that are wide
//! enough to hold many samples.
//!
//! Light from everywhere enters as the walks of the calibration did, and must not change: each sample has a factor that makes the mean over
//! all directions of moved light what entered there. Light of skies is moved as a whole, by what moving changes in the first harmonics
//! of the direction that it comes from; that of small lights with an area by the mean of its directions.
mod cells;
mod neighbours;
mod steps;
mod ways;

use std::sync::OnceLock;

use glam::{DVec3, Vec3};

use self::steps::Steps;
use self::ways::{AT_ONCE, SKY_ORDER, Ways, bytes_of_a_sample};
use super::domain::Domain;
use super::irradiance::{Illumination, LightSampling, Pieces};
use super::many_lights::IrradianceRows;
use super::surface::Surface;
use crate::error::Result;
use crate::light::Light;
use crate::light::harmonics::coefficients;
use crate::light::suns::apart;
use crate::parallel::*;
use crate::progress::Progress;

/// Most bytes that the moving of light between so many samples takes, while it is prepared.
pub fn memory(samples: usize) -> u64 {
    samples as u64 * bytes_of_a_sample()
}

/// True for light that comes from one direction at each point, or nearly so; that of skies is moved as a whole.
fn moves(light: &Light) -> bool {
    light.is_sharp() || matches!(light, Light::Area { .. })
}

/// What the moving of light needs of a surface, whatever the light; made when light moves for the first time.
pub struct MovedEntry {
    /// Steps of each part; none of parts whose light stays.
    steps: Vec<Option<Steps>>,
    ways: OnceLock<Ways>,
}

impl MovedEntry {
    /// The samples of a surface, on parts whose light moves.
    pub fn new(surface: &Surface, moves: impl Fn(usize) -> bool) -> Self {
        let Domain { parts, media, .. } = surface.domain;
        let of_part = |(part, entry): (usize, &crate::geometry::part_table::PartEntry)| {
            let medium = media.get(entry.medium? as usize)?.properties;
            Steps::new(medium.eta_inside_over_outside, medium.mean_free_path_mm()).filter(|_| moves(part))
        };
        Self { steps: parts.parts.iter().enumerate().map(of_part).collect(), ways: OnceLock::new() }
    }

    /// True if the light of no part moves.
    pub fn is_still(&self) -> bool {
        self.steps.iter().all(Option::is_none)
    }

    /// Makes what is needed before light moves on several threads at once.
    pub fn prepare(&self, surface: &Surface) {
        if !self.is_still() {
            self.ways(surface);
        }
    }

    fn ways(&self, surface: &Surface) -> &Ways {
        self.ways.get_or_init(|| Ways::new(surface, self.steps.clone()))
    }

    /// Irradiance of every sample under lights, RGB, and of the pieces of samples that are lit unevenly: that of lights of one direction
    /// moved, and of the others, if there are any, as a function tells it. `etas` are the indices of the media, inside over outside.
    ///
    /// # Errors
    /// As [`Illumination::new`]; those of the function.
    pub fn entered(
        &self,
        surface: &Surface,
        lights: &[Light],
        (etas, sampling): (&[f64], LightSampling),
        of_others: impl FnOnce(&[Light]) -> Result<(Vec<DVec3>, Pieces)>,
        progress: &dyn Progress,
    ) -> Result<(Vec<DVec3>, Pieces)> {
        if self.is_still() {
            return of_others(lights);
        }
        // The suns of environments come from one direction too.
        let (moving, others): (Vec<Light>, Vec<Light>) = apart(lights, |_| true).into_iter().partition(moves);
        let (mut irradiance, mut pieces) = match others.as_slice() {
            [] => (vec![DVec3::ZERO; surface.samples.len()], Pieces::NONE),
            others => {
                let (mut irradiance, pieces) = of_others(others)?;
                for light in others {
                    self.move_sky(surface, &coefficients(light, SKY_ORDER)?, &mut irradiance);
                }
                (irradiance, pieces)
            }
        };
        for light in &moving {
            let lit = Illumination::new(surface, std::slice::from_ref(light), etas, sampling)?;
            let (moved, uneven) = self.moved(surface, light, lit.all_with_pieces(progress));
            irradiance.iter_mut().zip(moved).for_each(|(sum, e)| *sum += e);
            pieces = pieces.beside(uneven);
        }
        Ok((irradiance, pieces))
    }

    /// [`Self::entered`] with rays towards all lights.
    ///
    /// # Errors
    /// As [`Illumination::new`].
    pub fn entered_by_rays(
        &self,
        surface: &Surface,
        lights: &[Light],
        (etas, sampling): (&[f64], LightSampling),
        progress: &dyn Progress,
    ) -> Result<(Vec<DVec3>, Pieces)> {
        let rays = |others: &[Light]| Ok(Illumination::new(surface, others, etas, sampling)?.all_with_pieces(progress));
        self.entered(surface, lights, (etas, sampling), rays, progress)
    }

    /// Moves irradiance of light from far away in many directions at once, given by the first harmonics of its radiance.
    fn move_sky(&self, surface: &Surface, radiance: &[DVec3], irradiance: &mut [DVec3]) {
        if self.is_still() {
            return;
        }
        let ways = self.ways(surface);
        irradiance.par_iter_mut().zip(&ways.sky).for_each(|(e, changes)| {
            let of_harmonic =
                |(change, radiance): (&[f32; 3], &DVec3)| Vec3::from_array(*change).as_dvec3() * *radiance;
            // What all directions share does not change.
            *e = (*e + changes.iter().zip(&radiance[1..]).map(of_harmonic).sum::<DVec3>()).max(DVec3::ZERO);
        });
    }

    /// Moves the irradiance of one light, RGB for each sample, and of the pieces of samples that are lit unevenly, as far as their light stays
    /// within them. Light of many directions at once stays here.
    pub fn moved(
        &self,
        surface: &Surface,
        light: &Light,
        (irradiance, pieces): (Vec<DVec3>, Pieces),
    ) -> (Vec<DVec3>, Pieces) {
        if !moves(light) || self.is_still() {
            return (irradiance, pieces);
        }
        // One light has one colour: the channels are multiples of the brightest.
        let sum = irradiance.iter().copied().sum::<DVec3>();
        let brightest = [0, 1, 2].into_iter().fold(0, |best, c| if sum[c] > sum[best] { c } else { best });
        let colour = if sum[brightest] > 0.0 { sum / sum[brightest] } else { DVec3::ZERO };
        let values: Vec<f64> = irradiance.iter().map(|e| e[brightest]).collect();
        let (moved, of_own) = self.ways(surface).balanced(surface, light, &values);
        let moved = moved.into_iter().map(|e| DVec3::from_array(e) * colour).collect();
        (moved, pieces.scaled(|sample| DVec3::from_array(of_own(sample))))
    }

    /// Irradiance that is the same for all channels, moved: each channel has its own then. Nothing happens where no light moves.
    #[must_use]
    pub fn moved_rows(&self, surface: &Surface, lights: &[Light], rows: IrradianceRows) -> IrradianceRows {
        if self.is_still() || rows.by_channel {
            return rows;
        }
        let (count, ways) = (rows.lights, self.ways(surface));
        let mut result = IrradianceRows { lights: count, by_channel: true, values: vec![0.0; 3 * rows.values.len()] };
        let of_light = |(column, light): (usize, &Light)| -> Vec<[f64; 3]> {
            let values: Vec<f64> =
                rows.values.iter().skip(column).step_by(count.max(1)).map(|e| f64::from(*e)).collect();
            if moves(light) {
                ways.balanced(surface, light, &values).0
            } else {
                values.into_iter().map(|e| [e; 3]).collect()
            }
        };
        let all: Vec<(usize, &Light)> = lights.iter().enumerate().take(count).collect();
        for some in all.chunks(AT_ONCE) {
            let columns: Vec<Vec<[f64; 3]>> = some.par_iter().map(|&of| of_light(of)).collect();
            for ((column, _), values) in some.iter().zip(columns) {
                for (row, value) in result.values.chunks_exact_mut((3 * count).max(1)).zip(values) {
                    (0..3).for_each(|c| row[c * count + column] = value[c] as f32);
                }
            }
        }
        result
    }

    /// Bytes in memory.
    pub fn bytes(&self) -> usize {
        self.ways.get().map_or(0, Ways::bytes)
    }
}

#[cfg(test)]
#[path = "moved_entry_tests.rs"]
mod tests;
