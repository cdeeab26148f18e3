//! Shadows that are kept while directional and point lights move: what the paper leaves to do between frames.
//!
//! A patch gets from such a light what it would get without shadows, or nothing. The former is computed anew, which of the two it is is kept. Of each
//! block of patches that lie side by side in the texture one in [`SHARE`] is looked at in every frame; where one of them has changed, or where some
//! patches of the block are lit and others in shadow, all of them are.

use glam::DVec3;

use super::map::TexelMap;
use crate::error::Result;
use crate::geometry::bvh::Bvh;
use crate::geometry::samples::Samples;
use crate::light::{Light, LightKind};
use crate::parallel::*;
use crate::progress::{Progress, Silent};
use crate::scene::Scene;
use crate::transport::irradiance::{Illumination, LightSampling, SurfacePoint};
use crate::transport::surface::Surface;

/// Patches of a block.
pub(super) const BLOCK: usize = 64;

/// One patch of so many is looked at in every frame.
pub(super) const SHARE: usize = 8;

/// What is known of a patch.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Sight {
    /// It faced away.
    #[default]
    Unknown,
    Lit,
    Shadowed,
}

/// What was seen of each light.
#[derive(Default)]
pub(super) struct Kept {
    lights: Vec<(LightKind, Vec<Sight>)>,
    frame: usize,
}

/// What lights shine on.
#[derive(Clone, Copy)]
pub(super) struct Shone<'a> {
    pub(super) map: &'a TexelMap,
    pub(super) scene: &'a Scene,
    pub(super) bvh: &'a Bvh,
    pub(super) sampling: LightSampling,
}

impl Shone<'_> {
    /// Irradiance of some points under some lights; `bvh` casts shadows.
    fn at(
        &self,
        bvh: &Bvh,
        lights: &[Light],
        points: &[(SurfacePoint, u32)],
        progress: &dyn Progress,
    ) -> Result<Vec<DVec3>> {
        let part_offsets = vec![0; self.scene.parts.parts.len() + 1];
        let samples = Samples { facets: Vec::new(), patch_offsets: vec![0], part_offsets };
        let surface = Surface { domain: self.scene.domain(), bvh, samples: &samples, patches: &[] };
        let etas: Vec<f64> = self.scene.media.iter().map(|m| m.properties.eta_inside_over_outside).collect();
        Ok(Illumination::new(&surface, lights, &etas, self.sampling)?.at_points(points, progress))
    }

    /// Irradiance of some points.
    ///
    /// # Errors
    /// Lights that cannot be served.
    pub(super) fn of_points(
        &self,
        lights: &[Light],
        points: &[(SurfacePoint, u32)],
        progress: &dyn Progress,
    ) -> Result<Vec<DVec3>> {
        self.at(self.bvh, lights, points, progress)
    }

    /// Irradiance of all patches, each light by its own rays.
    ///
    /// # Errors
    /// Lights that cannot be served.
    pub(super) fn irradiance(&self, lights: &[Light], progress: &dyn Progress) -> Result<Vec<DVec3>> {
        self.of_points(lights, &self.map.points, progress)
    }
}

impl Kept {
    /// Forgets what was seen.
    pub(super) fn clear(&mut self) {
        self.lights.clear();
    }

    /// Irradiance of all patches under lights that have moved.
    ///
    /// # Errors
    /// Lights that cannot be served.
    pub(super) fn irradiance(&mut self, shone: Shone, lights: &[Light], progress: &dyn Progress) -> Result<Vec<DVec3>> {
        let (sharp, soft): (Vec<Light>, Vec<Light>) = lights.iter().cloned().partition(Light::is_sharp);
        let mut result = match soft.is_empty() {
            true => vec![DVec3::ZERO; shone.map.points.len()],
            false => shone.irradiance(&soft, progress)?,
        };
        let kinds = || sharp.iter().map(Light::kind);
        if !self.lights.iter().map(|(kind, _)| *kind).eq(kinds()) {
            let unknown = |kind| (kind, vec![Sight::Unknown; shone.map.points.len()]);
            self.lights = kinds().map(unknown).collect();
        }
        let nothing = Bvh::from_triangles(&[]);
        for (light, (_, sights)) in sharp.iter().zip(&mut self.lights) {
            let light = std::slice::from_ref(light);
            let unshadowed = shone.at(&nothing, light, &shone.map.points, progress)?;
            let look = |indices: &[u32]| -> Result<Vec<bool>> {
                let points: Vec<_> = indices.iter().map(|i| shone.map.points[*i as usize]).collect();
                let found = shone.at(shone.bvh, light, &points, &Silent)?;
                Ok(found.iter().map(|e| e.max_element() > 0.0).collect())
            };
            see(sights, self.frame, &unshadowed, look)?;
            let of = |(e, (unshadowed, sight)): (&mut DVec3, (&DVec3, &Sight))| {
                if *sight == Sight::Lit {
                    *e += *unshadowed;
                }
            };
            result
                .par_iter_mut()
                .zip(unshadowed.par_iter().zip(sights.par_iter()))
                .with_min_len(BLOCK * BLOCK)
                .for_each(of);
        }
        self.frame += 1;
        Ok(result)
    }
}

/// Brings what is known of the patches up to date; returns the number of rays. `look` tells of some patches whether they are lit.
fn see(
    sights: &mut [Sight],
    frame: usize,
    unshadowed: &[DVec3],
    look: impl Fn(&[u32]) -> Result<Vec<bool>>,
) -> Result<usize> {
    let sight = |lit: &bool| if *lit { Sight::Lit } else { Sight::Shadowed };
    let mut first: Vec<u32> = Vec::new();
    for (i, (sight, e)) in sights.iter_mut().zip(unshadowed).enumerate() {
        if e.max_element() <= 0.0 {
            *sight = Sight::Unknown;
        } else if *sight == Sight::Unknown || i % SHARE == frame % SHARE {
            first.push(i as u32);
        }
    }
    let mut changed = vec![false; sights.len().div_ceil(BLOCK)];
    for (i, lit) in first.iter().zip(&look(&first)?) {
        let known = &mut sights[*i as usize];
        changed[*i as usize / BLOCK] |= *known != Sight::Unknown && *known != sight(lit);
        *known = sight(lit);
    }
    let mut then: Vec<u32> = Vec::new();
    let mut looked = first.iter().copied().peekable();
    for (block, (known, changed)) in sights.chunks(BLOCK).zip(&changed).enumerate() {
        let all = *changed || (known.contains(&Sight::Lit) && known.contains(&Sight::Shadowed));
        for (i, known) in (block * BLOCK..).map(|i| i as u32).zip(known) {
            let is_looked_at = looked.next_if_eq(&i).is_some();
            if all && !is_looked_at && *known != Sight::Unknown {
                then.push(i);
            }
        }
    }
    for (i, lit) in then.iter().zip(&look(&then)?) {
        sights[*i as usize] = sight(lit);
    }
    Ok(first.len() + then.len())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// A shadow that moves over a row of patches is followed, but for what is narrower than those that are looked at lie apart; few of them are looked
    /// at, and where it rests it is found.
    #[test]
    fn a_moving_shadow_is_followed() {
        let count = 100 * BLOCK;
        let unshadowed = vec![DVec3::ONE; count];
        let mut sights = vec![Sight::Unknown; count];
        for frame in 0..40 + SHARE {
            let edge = 20 * BLOCK + 37 * frame.min(40);
            let is_lit = |i: usize| i < edge || i > edge + 5 * BLOCK;
            let look = |indices: &[u32]| Ok(indices.iter().map(|i| is_lit(*i as usize)).collect());
            let rays = see(&mut sights, frame, &unshadowed, look).unwrap();
            assert!(frame == 0 || rays < count / 4, "{frame}: {rays}");
            let wrong = sights.iter().enumerate().filter(|(i, sight)| (**sight == Sight::Lit) != is_lit(*i)).count();
            assert!(wrong < if frame < 40 + SHARE - 1 { 2 * SHARE } else { 1 }, "{frame}: {wrong}");
        }
        // What faces away is forgotten.
        see(&mut sights, 0, &vec![DVec3::ZERO; count], |indices| Ok(vec![true; indices.len()])).unwrap();
        assert!(sights.iter().all(|sight| *sight == Sight::Unknown));
    }
}
