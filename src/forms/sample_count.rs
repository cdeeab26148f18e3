//! The number of samples that an asked error needs.
//!
//! A density in mean free paths is made for shapes that shade themselves in every place. Most small models are simpler: there the error of
//! twice as many samples is measured, from few on, until it is a small share of what is asked.

use glam::DVec3;

use super::density::Density;
use crate::error::Result;
use crate::evaluate::stages::{of_kinds, spread};
use crate::evaluate::{BakeSettings, Model};
use crate::geometry::bvh::Bvh;
use crate::geometry::samples::{self, Samples};
use crate::light::{Light, LightKind};
use crate::medium::material::{Medium, preset};
use crate::progress::Silent;
use crate::scene::Scene;
use crate::transport::calibration::any_is_closed;
use crate::transport::gather::{Gather, Scheme};
use crate::transport::irradiance::{Illumination, LightSampling};
use crate::transport::kernel::medium::MediumKernel;
use crate::transport::near_rule::NearField;
use crate::transport::receivers::Receivers;
use crate::transport::surface::Surface;
use crate::transport::tree::SampleTree;

/// Share of the asked error that samples may take in the media of the scene, and in others: independent of the stages that have the most of
/// it, half adds an eighth.
const SHARE: f64 = 0.2;
const SHARE_IN_OTHERS: f64 = 0.5;

/// Samples that are looked at first; as many as triangles at least, since clusters of triangles err in another way.
const LEAST: usize = 1 << 11;

/// More than this part of the samples that the density asks for is not tried: what it would save is less than what it costs.
const MOST_PART: usize = 2;

/// Probe suns, beside one along the largest flat area, and vertices.
const SUNS: usize = 3;
const VERTICES: usize = 128;
const GROUP: usize = 16;

/// Turn of the sun that grazes, in full turns.
const TURN: f64 = 0.13;

/// Published materials that light scatters in most differently, for methods whose material is chosen later.
pub const UNLIKE_MATERIALS: [&str; 3] = ["ketchup", "chicken1", "spectralon"];

/// Samples of a scene: as many as are asked for, else as the density says, or fewer where these are enough for the asked error under a few
/// of the tuning lights, in the media of the scene and in those of some published `materials`.
///
/// # Errors
/// As [`Illumination::new`].
pub fn samples_for(
    scene: &Scene,
    (density, sampling): (Density, LightSampling),
    settings: &BakeSettings,
    materials: &[&str],
) -> Result<usize> {
    let most = density.count(scene, settings.samples);
    let mut count = LEAST.max(scene.mesh.triangles.len());
    let lights = lights(scene, settings);
    // Where light enters elsewhere than it falls it goes from sample to sample, and needs them all.
    let is_moved = || settings.model != Model::Dipole && any_is_closed(scene.domain());
    if settings.samples.is_some() || lights.is_empty() || 2 * count * MOST_PART > most || is_moved() {
        return Ok(most);
    }
    let receivers = Receivers::new(&scene.mesh, &scene.parts, GROUP);
    if receivers.is_empty() {
        return Ok(most);
    }
    let (subset, points) = receivers.probe_points(&receivers.areas_mm2(&scene.mesh), (VERTICES, 0));
    let kernels =
        std::iter::once(MediumKernel::of_media(&scene.media)).chain(kernels_in(&scene.media, materials)).collect();
    let trial = Trial { scene, bvh: Bvh::new(&scene.mesh), sampling, lights, kernels };
    let mut before = trial.radiosity(count, &subset)?;
    while 2 * count * MOST_PART <= most {
        count *= 2;
        let values = trial.radiosity(count, &subset)?;
        // The error falls with the number of samples at least: that of these is no more than what they differ by from half as many.
        let is_enough = |(index, (few, many)): (usize, (&Vec<DVec3>, &Vec<DVec3>))| {
            let share = if index % trial.kernels.len() == 0 { SHARE } else { SHARE_IN_OTHERS };
            points.error(few, many).rms <= share * settings.max_rms
        };
        if before.iter().zip(&values).enumerate().all(is_enough) {
            return Ok(count);
        }
        before = values;
    }
    Ok(most)
}

/// Sharp lights, under which samples err most. Light from nearby varies even over flat faces, where suns are even: all points are taken.
fn lights(scene: &Scene, settings: &BakeSettings) -> Vec<Light> {
    let of_kind = |kind: LightKind| of_kinds(&settings.probes.tuning, &[kind]);
    let suns = of_kind(LightKind::Directional);
    let mut lights: Vec<Light> = spread(&suns, SUNS).cloned().collect();
    if !lights.is_empty() {
        lights.push(Light::Directional { from: scene.grazing(TURN), irradiance: DVec3::ONE });
    }
    if [LightKind::Point, LightKind::Area].iter().any(|kind| settings.is_for(*kind)) {
        lights.extend(of_kind(LightKind::Point));
    }
    lights
}

/// Kernels of media with the properties of each of some published materials.
pub fn kernels_in(media: &[Medium], materials: &[&str]) -> impl Iterator<Item = Vec<MediumKernel>> {
    materials.iter().filter_map(|name| preset(name)).map(move |preset| {
        let other = |medium: &Medium| MediumKernel::new(&Medium { properties: preset.properties(), ..medium.clone() });
        media.iter().map(other).collect()
    })
}

/// What is the same for every number of samples.
struct Trial<'a> {
    scene: &'a Scene,
    bvh: Bvh,
    sampling: LightSampling,
    lights: Vec<Light>,
    kernels: Vec<Vec<MediumKernel>>,
}

impl Trial<'_> {
    /// Radiosity of some receivers from so many samples over all pairs, RGB, for each light and its kernels, that of the scene first.
    fn radiosity(&self, count: usize, receivers: &Receivers) -> Result<Vec<Vec<DVec3>>> {
        let Scene { mesh, parts, media } = self.scene;
        let samples = Samples::new(mesh, parts, count);
        let patches = samples::patches(mesh, &samples);
        let surface = Surface { domain: self.scene.domain(), bvh: &self.bvh, samples: &samples, patches: &patches };
        let etas: Vec<f64> = media.iter().map(|m| m.properties.eta_inside_over_outside).collect();
        let tree = SampleTree::default();
        let mut values = Vec::new();
        for light in &self.lights {
            let lit = Illumination::new(&surface, std::slice::from_ref(light), &etas, self.sampling)?;
            let (irradiance, pieces) = lit.all_with_pieces(&Silent);
            for kernels in &self.kernels {
                let gather = Gather::with_kernels(&surface, &tree, kernels.clone(), NearField::REFERENCE);
                let lit = gather.light_with_pieces(&irradiance, &pieces);
                values.push(gather.radiosity(receivers, &lit, Scheme::AllPairs, &Silent));
            }
        }
        Ok(values)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::evaluate::Probes;
    use crate::forms::test_scene::scene;
    use crate::geometry::shapes;

    const DENSITY: Density = Density { spacing: 0.35, least: 1 << 15, most: 1 << 16 };

    fn settings(max_rms: f64) -> BakeSettings {
        let suns = |from: &[[f64; 3]]| {
            from.iter().map(|&from| Light::directional(DVec3::from_array(from), DVec3::ONE).unwrap()).collect()
        };
        let tuning = suns(&[[1.0, 2.0, 3.0], [-3.0, 1.0, 0.5], [0.2, -1.0, 0.4]]);
        let probes = Probes { tuning, unseen: suns(&[[-1.0, -0.3, 2.0], [2.0, 0.5, -1.0]]) };
        BakeSettings { probes, ..BakeSettings::new(max_rms) }
    }

    fn found(scene: &Scene, settings: &BakeSettings, materials: &[&str]) -> usize {
        samples_for(scene, (DENSITY, LightSampling::FAST), settings, materials).unwrap()
    }

    #[test]
    fn simple_bodies_take_few_samples_and_err_less_than_their_share() {
        let scene = scene(shapes::bumpy_head(8.0, 2), "skin1");
        let settings = settings(0.01);
        let count = found(&scene, &settings, &[]);
        assert!((2 * LEAST..DENSITY.least as usize).contains(&count), "{count}");
        // Against many times as many, under lights that no choice saw.
        let receivers = Receivers::new(&scene.mesh, &scene.parts, GROUP);
        let (subset, points) = receivers.probe_points(&receivers.areas_mm2(&scene.mesh), (VERTICES, 1));
        let lights: Vec<Light> = settings.probes.unseen.clone();
        let kernels = vec![MediumKernel::of_media(&scene.media)];
        let trial = Trial { scene: &scene, bvh: Bvh::new(&scene.mesh), sampling: LightSampling::FAST, lights, kernels };
        let [few, many] = [count, 16 * count].map(|count| trial.radiosity(count, &subset).unwrap());
        let worst = few.iter().zip(&many).map(|(a, b)| points.error(a, b).rms).fold(0.0, f64::max);
        assert!(worst > 0.0 && worst < 2.0 * SHARE * settings.max_rms, "{worst}");
        // A smaller error takes more, and one out of reach as many as the density says.
        let finer = found(&scene, &BakeSettings { max_rms: 0.002, ..settings.clone() }, &[]);
        assert!(finer > count, "{finer}");
        let most = found(&scene, &BakeSettings { max_rms: 1e-7, ..settings.clone() }, &[]);
        assert_eq!(most, DENSITY.count(&scene, None));
        assert!(found(&scene, &settings, &UNLIKE_MATERIALS) >= count);
    }

    #[test]
    fn flat_faces_take_more_samples_under_a_lamp_nearby_than_under_suns() {
        let cube = scene(shapes::cuboid(DVec3::splat(10.0), 1), "skin1");
        let mut settings = settings(0.005);
        settings.probes.tuning.push(Light::point(DVec3::splat(13.0), DVec3::splat(500.0)).unwrap());
        let lamps = found(&cube, &settings, &[]);
        settings.for_lights = [LightKind::Directional].into();
        let suns = found(&cube, &settings, &[]);
        assert!(suns == 2 * LEAST && lamps > suns, "{suns} {lamps}");
    }

    #[test]
    fn what_is_asked_for_and_what_cannot_be_tried_stay_as_they_are() {
        let ball = scene(shapes::icosphere(8.0, 2), "marble");
        let asked = BakeSettings { samples: Some(777), ..settings(0.01) };
        assert_eq!(found(&ball, &asked, &[]), 777);
        let density = DENSITY.count(&ball, None);
        assert_eq!(found(&ball, &BakeSettings::new(0.01), &[]), density, "no probe lights");
        let walks = Model::Calibrated(crate::transport::calibration::Walks::default());
        assert_eq!(found(&ball, &BakeSettings { model: walks, ..settings(0.01) }, &[]), density);
        // A body that walks cannot calibrate keeps its dipole.
        let mut open = shapes::icosphere(8.0, 2);
        open.triangles.truncate(open.triangles.len() - 40);
        open.triangle_material.truncate(open.triangles.len());
        let open = scene(open, "marble");
        let count = found(&open, &settings(0.01), &[]);
        assert_eq!(found(&open, &BakeSettings { model: walks, ..settings(0.01) }, &[]), count);
        assert!(count < density, "{count}");
        // More than half as many triangles as samples.
        let fine = scene(shapes::icosphere(8.0, 5), "marble");
        assert_eq!(found(&fine, &settings(0.01), &[]), DENSITY.count(&fine, None));
    }
}
