//! Transport before it is coded: radiosity of every vertex under each spherical harmonic of the light. What each step of the coding
//! saves, and what it costs in error, is measured on it; a bake codes the same numbers at reference points.

use glam::DVec3;
use translux_format::quantised_lights::Set;

use translux::compress::prediction::Net;
use translux::error::Result;
use translux::evaluate::BakeSettings;
use translux::forms::projected::harmonics::{Harmonics, coded, coding_error, everywhere};
use translux::forms::projected::references::weights;
use translux::forms::sampled_scene::{GROUP, oriented, parts};
use translux::geometry::scattered::OrientedPoint;
use translux::progress::Progress;
use translux::scene::Scene;
use translux::transport::interpolation::SharedWeights;
use translux::transport::receivers::Receivers;

/// Radiosity of every point of a scene under the harmonics of an order.
pub(crate) struct Uncoded {
    /// The vertices that radiosity is transferred to, those in one place together, neighbours near each other.
    pub(crate) points: Vec<OrientedPoint>,
    /// Order n: n^2 harmonics.
    pub(crate) order: usize,
    /// `[point][channel][harmonic]`.
    pub(crate) values: Vec<f32>,
    receivers: Receivers,
}

impl Uncoded {
    /// What a bake with these settings computes, at every vertex.
    ///
    /// # Errors
    /// Those of a bake.
    pub(crate) fn new(
        scene: &Scene,
        form: &Harmonics,
        settings: &BakeSettings,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let (order, values) = everywhere(scene, &form.0, settings, progress)?;
        let receivers = Receivers::new(&scene.mesh, &scene.parts, GROUP);
        Ok(Self { points: oriented(scene, &receivers), order, values, receivers })
    }

    /// Reference points at a spacing, coarse to fine, as a bake takes them; all points where it is small.
    pub(crate) fn net(&self, spacing_mm: f64) -> Net {
        Net::new(&self.points, &parts(&self.receivers), spacing_mm)
    }

    /// Numbers of one point.
    pub(crate) fn row(&self, point: u32) -> &[f32] {
        let size = 3 * self.order * self.order;
        self.values.get(point as usize * size..(point as usize + 1) * size).unwrap_or(&[])
    }

    /// The points of a net, coded as a bake codes them that is asked for an error of `max_rms`.
    ///
    /// # Errors
    /// Numbers that have no principal components, or more than a format holds.
    pub(crate) fn coded(&self, net: &Net, max_rms: f64) -> Result<Set> {
        let values: Vec<f32> = net.point.iter().flat_map(|&point| self.row(point)).copied().collect();
        coded(&values, self.order, net, coding_error(max_rms))
    }

    /// Radiosity of every source vertex from that of the points of a net (RGB and nothing, in the order of its rows), none negative:
    /// interpolated as an evaluator does it, unless the net has all points.
    pub(crate) fn at_vertices(&self, net: &Net, spacing_mm: f64, values: &[[f32; 4]]) -> Vec<DVec3> {
        let mut rows: Vec<usize> = (0..net.point.len()).collect();
        rows.sort_unstable_by_key(|&row| net.point[row]);
        let chosen: Vec<u32> = rows.iter().map(|&row| net.point[row]).collect();
        let sorted: Vec<[f32; 4]> = rows.iter().map(|&row| values.get(row).copied().unwrap_or_default()).collect();
        if sorted.len() == self.points.len() {
            let clamped: Vec<[f32; 4]> = sorted.iter().map(|value| value.map(|v| v.max(0.0))).collect();
            return self.receivers.expand_rgb(&clamped, 1.0);
        }
        let mut gathered = Vec::new();
        SharedWeights::new(&weights(&chosen, &self.points, &self.receivers, spacing_mm)).apply(&sorted, &mut gathered);
        self.receivers.expand_rgb(&gathered, 1.0)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use translux::asset::Asset;
    use translux::evaluate::{Form, Probes};
    use translux::forms::density::Density;
    use translux::forms::distant::{Basis, Choice, Distant, Integrand, Single};
    use translux::forms::projected::references::Spacing;
    use translux::geometry::mesh::{Mesh, Placement};
    use translux::geometry::part_table::PartTable;
    use translux::geometry::shapes::icosphere;
    use translux::light::Light;
    use translux::light::cube_light::Transform;
    use translux::light::harmonics::coefficients;
    use translux::medium::material::Medium;
    use translux::medium::material::preset;
    use translux::progress::Silent;

    const MAX_RMS: f64 = 0.02;

    fn scene() -> Scene {
        let mesh = Mesh::from_source(icosphere(5.0, 3), &Placement { mm_per_unit: 1.0 }).unwrap().0;
        let parts = PartTable::new(&mesh, vec![0; mesh.triangles.len()], vec![("body".into(), Some(0))]);
        let properties = preset("marble").unwrap().properties();
        Scene { mesh, parts, media: vec![Medium { name: "marble".into(), properties }] }
    }

    /// Sixteen harmonics at points 1.5 mm apart.
    fn form() -> Harmonics {
        Harmonics(Distant {
            density: Density { spacing: 1.0, least: 4096, most: 4096 },
            side: 32,
            transform: Transform::SolidAngle,
            choice: Choice::Light,
            row: 128,
            order: Some(4),
            spacing: Spacing { mm: Some(1.5), references: None },
            single: Single::Off,
            single_basis: Basis::Harmonics,
            integrand: Integrand::default(),
            outside: None,
        })
    }

    #[test]
    fn it_is_what_a_bake_codes() {
        let (scene, form) = (scene(), form());
        let sun = |from| Light::Directional { from, irradiance: DVec3::ONE };
        let tuning: Vec<Light> = [DVec3::X, DVec3::Y, DVec3::NEG_Z].map(sun).into();
        let probes = Probes { tuning: tuning.clone(), unseen: Vec::new() };
        let settings = BakeSettings { probes, ..BakeSettings::new(MAX_RMS) };
        let uncoded = Uncoded::new(&scene, &form, &settings, &Silent).unwrap();
        assert_eq!((uncoded.order, uncoded.points.len()), (4, scene.mesh.local_mm.len()));
        let parts = Form::bake(&form, &scene, &settings, &Silent).unwrap();
        let asset = Asset { ledger: parts.ledger, ..Asset::of_scene(scene.clone(), parts.samples, parts.sections) };
        let mut evaluator = Form::open(&form, Arc::new(asset)).unwrap();
        let net = uncoded.net(1.5);
        assert!(net.point.len() < uncoded.points.len() / 2, "{}", net.point.len());
        for light in [Light::Constant { radiance: DVec3::ONE }, tuning[0].clone()] {
            evaluator.set_lights(vec![light.clone()], &Silent).unwrap();
            let baked = evaluator.radiosity(&Silent).unwrap();
            let vector = coefficients(&light, uncoded.order).unwrap();
            let of_point = |&point: &u32| {
                let channel = |c: usize| -> f64 {
                    uncoded.row(point)[16 * c..].iter().zip(&vector).map(|(v, w)| f64::from(*v) * w[c]).sum()
                };
                [channel(0) as f32, channel(1) as f32, channel(2) as f32, 0.0]
            };
            let every = Net::unpredicted(uncoded.points.len());
            for (net, spacing_mm) in [(&net, 1.5), (&every, 1.0)] {
                let values: Vec<[f32; 4]> = net.point.iter().map(of_point).collect();
                let found = uncoded.at_vertices(net, spacing_mm, &values);
                let largest = found.iter().map(|v| v.max_element()).fold(0.0, f64::max);
                for (a, b) in found.iter().zip(&baked) {
                    assert!((*a - *b).abs().max_element() < 2.0 * MAX_RMS * largest, "{a} {b}");
                }
            }
        }
        let coded = uncoded.coded(&net, MAX_RMS).unwrap();
        let finer = uncoded.coded(&net, 0.25 * MAX_RMS).unwrap();
        assert!(finer.coefficients.len() > coded.coefficients.len());
    }
}
