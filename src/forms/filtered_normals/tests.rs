#![allow(clippy::unwrap_used)]

use std::sync::Arc;

use glam::DVec3;

use super::bake::{BEYOND_PROBES, GRAZING_TURNS, beside_probes};
use super::*;
use crate::asset::Asset;
use crate::evaluate::{BakeSettings, Evaluator, Form, Probes};
use crate::forms::density::Density;
use crate::forms::test_scene::{medium, scene};
use crate::geometry::shapes;
use crate::light::Light;
use crate::math::statistics::vertex_error;
use crate::medium::fresnel;
use crate::progress::Silent;
use crate::scene::Scene;

const FORM: FilteredNormals = FilteredNormals {
    density: Density { spacing: 0.35, least: 4000, most: 4000 },
    filter: Filter::Heat,
    response: Response::Material,
    rungs: 8,
    alpha: Some(0.0),
    width: Some(1.0),
    length: Length::Unit,
    shadows: Shadows::Cast,
    bleeding: Bleeding::Off,
};

fn baked(form: &FilteredNormals, scene: &Scene, probes: Probes) -> Asset {
    form.validate().unwrap();
    let settings = BakeSettings { probes, ..BakeSettings::new(0.05) };
    let parts = form.bake(scene, &settings, &Silent).unwrap();
    Asset { ledger: parts.ledger, ..Asset::of_scene(scene.clone(), parts.samples, parts.sections) }
}

fn opened(form: &FilteredNormals, scene: &Scene) -> Box<dyn Evaluator> {
    form.open(Arc::new(baked(form, scene, Probes::default()))).unwrap()
}

fn lit(evaluator: &mut dyn Evaluator, light: Light) -> Vec<DVec3> {
    evaluator.set_lights(vec![light], &Silent).unwrap();
    evaluator.radiosity(&Silent).unwrap()
}

/// Normals of a sphere are harmonics of the first band: their direction stays, and their length is the response there.
#[test]
fn normals_of_a_sphere_keep_their_direction() {
    let radius = 4.0;
    let scene = scene(shapes::icosphere(radius, 4), "skin1");
    let properties = scene.media[0].properties;
    let from = DVec3::new(0.3, 0.9, 0.1).normalize();
    let light = Light::directional(from, DVec3::ONE).unwrap();
    let geometric = Filter::Geometric { weights: Weights::Area, sum: Sum::Mean, reach: 5.0 };
    for filter in [Filter::Heat, Filter::Spectral { wavelength: 10.0 }, geometric] {
        let unit = lit(opened(&FilteredNormals { filter, ..FORM }, &scene).as_mut(), light.clone());
        let kept =
            lit(opened(&FilteredNormals { filter, length: Length::Kept, ..FORM }, &scene).as_mut(), light.clone());
        for (c, dipole) in properties.dipoles(fresnel::BoundaryFit::Published).iter().enumerate() {
            let total = crate::medium::profile::Profile::total(dipole);
            let length = response::response(Response::Material, dipole, 2.0 / (radius * radius));
            for (v, (unit, kept)) in unit.iter().zip(&kept).enumerate() {
                let cosine = scene.mesh.position_mm(v as u32).normalize().dot(from);
                if cosine < 0.1 {
                    continue;
                }
                let expected = total * cosine * fresnel::transmittance(properties.eta_inside_over_outside, cosine);
                // A step of the quantiser and the noise that coefficients make of it.
                assert!((unit[c] - expected).abs() < 0.025 * total, "{filter:?} {c} {cosine}: {} {expected}", unit[c]);
                if !matches!(filter, Filter::Geometric { .. }) && cosine > 0.3 {
                    let ratio = kept[c] / unit[c];
                    assert!((ratio - length).abs() < 0.06, "{filter:?} {c}: {ratio} {length}");
                }
            }
        }
    }
}

/// A filter that is set at run time is the one that a bake would have made; spectral and heat agree where the harmonics reach.
#[test]
fn ways_to_make_the_ladder_agree() {
    let scene = scene(shapes::bumpy_head(10.0, 4), "skin1");
    let light = Light::directional(DVec3::new(0.3, 0.9, 0.4), DVec3::ONE).unwrap();
    let areas = scene.vertex_areas_mm2();
    let mut heat = opened(&FORM, &scene);
    let mut spectral = opened(&FilteredNormals { filter: Filter::Spectral { wavelength: 5.0 }, ..FORM }, &scene);
    let mut plain = opened(&FilteredNormals { alpha: Some(1.0), ..FORM }, &scene);
    for material in ["skin1", "skimmilk"] {
        for evaluator in [&mut heat, &mut spectral, &mut plain] {
            evaluator.set_media(vec![medium(material)]).unwrap();
        }
        let [a, b, c] = [&mut heat, &mut spectral, &mut plain].map(|e| lit(e.as_mut(), light.clone()));
        let (agree, changed) = (vertex_error(&b, &a, &areas).rms, vertex_error(&c, &a, &areas).rms);
        assert!(agree < 0.02 && changed > 2.0 * agree, "{material}: {agree} {changed}");
    }
}

/// Fitted shapes are better than the filter left out, and the error in the ledger is the evaluator's under the worst of the probe lights and of suns
/// that graze.
#[test]
fn the_fit_lowers_the_error_and_the_ledger_says_it() {
    let scene = scene(shapes::bumpy_head(10.0, 3), "marble");
    let light = |x, y, z| Light::directional(DVec3::new(x, y, z), DVec3::ONE).unwrap();
    let probes =
        Probes { tuning: vec![light(1.0, 0.2, 0.1), light(-0.4, 0.3, 1.0)], unseen: vec![light(0.1, 1.0, 0.3)] };
    let error = |form: &FilteredNormals| {
        let asset = baked(form, &scene, probes.clone());
        let promised = asset.ledger.total_rms();
        let mut evaluator = form.open(Arc::new(asset)).unwrap();
        let mut measured = |light: &Light| {
            lit(evaluator.as_mut(), light.clone());
            evaluator.measured_error(&[], &Silent).unwrap().total_rms()
        };
        let settings = BakeSettings { probes: probes.clone(), ..BakeSettings::new(0.05) };
        let others = beside_probes(&scene, &settings);
        assert!(others.len() == probes.tuning.len() + GRAZING_TURNS.len() + 4);
        let worst = others.iter().chain(&probes.unseen).map(&mut measured).fold(0.0, f64::max);
        assert!((BEYOND_PROBES * worst - promised).abs() < 1e-9, "{worst} {promised}");
        measured(&probes.unseen[0])
    };
    let fitted = error(&FilteredNormals { alpha: None, width: None, ..FORM });
    let plain = error(&FilteredNormals { alpha: Some(1.0), width: Some(1.0), ..FORM });
    let bled = error(&FilteredNormals { bleeding: Bleeding::Irradiance, ..FORM });
    println!("fitted {fitted}, plain {plain}, bleeding {bled}");
    assert!(fitted < 0.5 && fitted <= plain && bled < fitted, "{fitted} {plain} {bled}");
}

#[test]
fn settings_out_of_range_are_refused() {
    let geometric = Filter::Geometric { weights: Weights::Count, sum: Sum::Plain, reach: 4.6 };
    for form in [
        FilteredNormals { rungs: 1, ..FORM },
        FilteredNormals { alpha: Some(1.5), ..FORM },
        FilteredNormals { width: Some(f64::NAN), ..FORM },
        FilteredNormals { filter: Filter::Spectral { wavelength: 0.0 }, ..FORM },
        FilteredNormals { filter: geometric, bleeding: Bleeding::Irradiance, ..FORM },
        FilteredNormals { filter: geometric, response: Response::Gaussian(1.0), ..FORM },
    ] {
        assert!(form.validate().is_err(), "{form:?}");
    }
}
