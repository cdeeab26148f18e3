use super::*;
use crate::geometry::shapes;
use crate::light::Light;
use crate::math::random::uniform;
use crate::medium::material::OpticalProperties;
use crate::medium::profiles::model::ProfileModel;
use crate::progress::Silent;
use crate::transport::calibration::{Calibrated, Walks};
use crate::transport::gather::{Gather, Scheme};
use crate::transport::irradiance::{Illumination, LightSampling, Pieces};
use crate::transport::kernel::medium::MediumKernel;
use crate::transport::near_rule::NearField;
use crate::transport::sample_light::SampleLight;
use crate::transport::test_scene::{Fixture, medium, named, worst_rms};

/// Radiosity by nets.
fn by_nets(fixture: &Fixture, kernels: &[MediumKernel], lit: (&[DVec3], &Pieces), quality: Quality) -> Vec<DVec3> {
    let surface = fixture.surface();
    let receivers = fixture.receivers(16);
    let nets = SurfaceNets::new(&surface, &receivers, quality);
    let of_part: Vec<Option<u32>> = surface.domain.parts.parts.iter().map(|part| part.medium).collect();
    let tables = nets.tables(&surface, &receivers, (kernels, &of_part));
    nets.radiosity(&surface, &tables, SampleLight::new(lit.0, lit.1), (&receivers, None))
}

/// Radiosity by all pairs.
fn all_pairs(fixture: &Fixture, kernels: &[MediumKernel], lit: (&[DVec3], &Pieces)) -> Vec<DVec3> {
    let gather = Gather::with_kernels(&fixture.surface(), &fixture.tree, kernels.to_vec(), NearField::REFERENCE);
    let light = gather.light_with_pieces(lit.0, lit.1);
    gather.radiosity(&fixture.receivers(16), &light, Scheme::AllPairs, &Silent)
}

/// RMS of the difference of nets from all pairs over that of the latter, worst channel.
fn error(fixture: &Fixture, kernels: &[MediumKernel], lit: (&[DVec3], &Pieces), quality: Quality) -> f64 {
    worst_rms(&by_nets(fixture, kernels, lit, quality), &all_pairs(fixture, kernels, lit))
}

/// Quality that a bake finds to be enough under three lights.
fn tuned(fixture: &Fixture, asked: f64) -> Quality {
    let receivers = fixture.receivers(16);
    let areas = vec![1.0; receivers.len()];
    let lights = [DVec3::new(0.2, 1.0, 0.1), DVec3::new(-1.0, -0.3, 0.5), DVec3::NEG_Z].map(|from| lit(fixture, from));
    let of_part = fixture.scene.parts.parts.iter().map(|part| part.medium).collect();
    SurfaceNets::tuned((&fixture.surface(), &[(kernels(fixture), of_part)]), (&receivers, &areas), &lights, asked)
        .quality()
}

fn kernels(fixture: &Fixture) -> Vec<MediumKernel> {
    MediumKernel::of_media(&fixture.scene.media)
}

fn lit(fixture: &Fixture, from: DVec3) -> (Vec<DVec3>, Pieces) {
    let light = [Light::Directional { from: from.normalize(), irradiance: DVec3::new(3.0, 2.0, 1.0) }];
    let surface = fixture.surface();
    Illumination::new(&surface, &light, &[1.3], LightSampling::FAST).unwrap().all_with_pieces(&Silent)
}

fn head(properties: OpticalProperties, samples: usize) -> Fixture {
    Fixture::new(shapes::bumpy_head(20.0, 4), properties, samples)
}

#[test]
fn the_asked_error_is_kept_in_any_medium() {
    for material in ["marble", "skin1", "cream", "ketchup", "spectralon"] {
        // Of 40 mm, with samples 0.6 to 1.3 mm apart.
        let fixture = head(named(material), 6000);
        let (irradiance, pieces) = lit(&fixture, DVec3::new(1.0, 0.5, 0.3));
        let (kernels, lit) = (kernels(&fixture), (irradiance.as_slice(), &pieces));
        let truth = all_pairs(&fixture, &kernels, lit);
        for asked in [0.02, 0.001] {
            let found = worst_rms(&by_nets(&fixture, &kernels, lit, tuned(&fixture, asked)), &truth);
            assert!(found <= asked, "{material}: {found:.1e} where {asked} was asked");
        }
    }
}

#[test]
fn media_from_far_below_to_far_above_the_spacing_come_out_right() {
    for (scale, absorption) in [(1e3, 1e-3), (100.0, 0.01), (10.0, 0.0), (0.1, 0.1), (0.01, 0.0), (1e-4, 1e-3)] {
        let (sigma_s, sigma_a) = (DVec3::new(1.0, 2.0, 4.0) * scale, DVec3::splat(absorption * scale));
        let fixture = head(medium(sigma_s, sigma_a, 1.3), 6000);
        let (irradiance, pieces) = lit(&fixture, DVec3::new(-0.4, 0.2, 1.0));
        let found = error(&fixture, &kernels(&fixture), (&irradiance, &pieces), Quality::for_error(0.005));
        assert!(found <= 0.005, "{scale} {absorption}: {found:.1e}");
    }
}

#[test]
fn noise_on_the_samples_is_summed_too() {
    let fixture = head(named("skin1"), 12_000);
    let noise: Vec<DVec3> = (0..fixture.patches.len() as u64)
        .map(|i| DVec3::new(uniform(1, i, 0), uniform(1, i, 1), uniform(1, i, 2)))
        .collect();
    let found = error(&fixture, &kernels(&fixture), (&noise, &Pieces::NONE), Quality::for_error(0.005));
    assert!(found <= 0.005, "{found:.1e}");
}

#[test]
fn any_profile_may_take_the_place_of_the_dipole() {
    let fixture = head(named("marble"), 12_000);
    let (irradiance, pieces) = lit(&fixture, DVec3::new(1.0, 0.5, 0.3));
    for model in ["better-dipole", "burley", "photon-beam", "slab:thickness=3"] {
        let profile = ProfileModel::parse(model).unwrap().load().unwrap();
        let reach = fixture.scene.mesh.diagonal_mm();
        let kernels: Vec<MediumKernel> =
            fixture.scene.media.iter().map(|m| MediumKernel::with_profile(m, &profile, reach).unwrap()).collect();
        let found = error(&fixture, &kernels, (&irradiance, &pieces), Quality::for_error(0.005));
        // The tables of both sides err by up to 5e-4.
        assert!(found <= 0.0055, "{model}: {found:.1e}");
    }
}

#[test]
fn few_samples_and_few_receivers_need_no_nets() {
    for (cells, samples) in [(1, 1), (1, 2), (2, 40), (30, 3)] {
        let fixture = Fixture::new(shapes::plane(10.0, 10.0, cells), named("marble"), samples);
        let irradiance = vec![DVec3::ONE; fixture.patches.len()];
        let found = error(&fixture, &kernels(&fixture), (&irradiance, &Pieces::NONE), Quality::for_error(0.005));
        assert!(found <= 0.01, "{cells} {samples}: {found:.1e}");
    }
}

#[test]
fn an_opaque_part_takes_and_gives_nothing() {
    let whole = shapes::bumpy_head(20.0, 4);
    let triangles = crate::transport::test_scene::mesh_of(shapes::bumpy_head(20.0, 4)).triangles.len();
    let fixture = Fixture::with_opaque(whole, triangles / 2, named("skin1"), 4000);
    let irradiance = vec![DVec3::ONE; fixture.patches.len()];
    let found = error(&fixture, &kernels(&fixture), (&irradiance, &Pieces::NONE), Quality::for_error(0.005));
    assert!(found <= 0.005, "{found:.1e}");
}

#[test]
fn double_layers_are_summed_over_nets_of_their_own() {
    for (samples, resolved) in [(40_000, true), (4000, false)] {
        let fixture = head(named("skin1"), samples);
        let surface = fixture.surface();
        let walks = Walks { photons: 20_000, ..Walks::default() };
        let calibrated = Calibrated::by_walks(surface.domain, surface.bvh, walks, &Silent).unwrap();
        let receivers = calibrated.at_vertices(fixture.receivers(16));
        let factors = calibrated.of_samples(&surface);
        let (irradiance, pieces) = lit(&fixture, DVec3::new(1.0, 0.5, 0.3));
        let areas = vec![1.0; receivers.len()];
        // All pairs of 40,000 samples take long.
        let (subset, points) = receivers.probe_points(&areas, (400, 2));
        let of_lights = [(irradiance.clone(), pieces.clone())];
        let all = (&surface, std::slice::from_ref(&calibrated.kernels));
        let quality = SurfaceNets::tuned(all, (&receivers, &areas), &of_lights, 0.005).quality();
        let nets = SurfaceNets::new(&surface, &receivers, quality);
        let (kernels, of_part) = &calibrated.kernels;
        let summed = |kernels: &[MediumKernel]| {
            let light = SampleLight::new(&irradiance, &pieces).with_factors(&factors);
            let tables = nets.tables(&surface, &receivers, (kernels, of_part));
            points.of(&nets.radiosity(&surface, &tables, light, (&receivers, Some(&points.indices))))
        };
        assert_eq!(nets.resolve((kernels, of_part)), resolved, "{samples}");
        if !resolved {
            continue;
        }
        let gather = Gather::calibrated(&surface, &fixture.tree, (&calibrated.kernels, &factors), NearField::REFERENCE);
        let lit = gather.light_with_pieces(&irradiance, &pieces);
        let truth = gather.radiosity(&subset, &lit, Scheme::AllPairs, &Silent);
        let found = worst_rms(&summed(kernels), &truth);
        let reach = fixture.scene.mesh.diagonal_mm();
        let single = kernels.iter().map(|k| MediumKernel::of_profiles(k.profiles().clone(), reach)).collect::<Vec<_>>();
        let without = worst_rms(&summed(&single), &truth);
        assert!(found < 0.01 && without > 0.05, "{found:.1e}, {without:.1e} without");
    }
}

#[test]
fn receivers_that_are_asked_for_have_what_they_have_among_all() {
    let fixture = head(named("marble"), 6000);
    let (irradiance, pieces) = lit(&fixture, DVec3::new(0.2, 1.0, 0.1));
    let (surface, receivers, kernels) = (fixture.surface(), fixture.receivers(16), kernels(&fixture));
    let of_part: Vec<Option<u32>> = surface.domain.parts.parts.iter().map(|part| part.medium).collect();
    let light = SampleLight::new(&irradiance, &pieces);
    let radiosity = |nets: &SurfaceNets, asked: Option<&[u32]>| {
        nets.radiosity(&surface, &nets.tables(&surface, &receivers, (&kernels, &of_part)), light, (&receivers, asked))
    };
    let quality = Quality::for_error(0.005);
    let all = SurfaceNets::new(&surface, &receivers, quality);
    let (whole, asked) = (radiosity(&all, None), [3, 40, 41]);
    let some = SurfaceNets::at_some(&surface, &receivers, quality, Some(&asked));
    for found in [radiosity(&all, Some(&asked)), radiosity(&some, Some(&asked)), radiosity(&some, None)] {
        assert!(asked.iter().all(|&i| found[i as usize] == whole[i as usize] && found[i as usize] != DVec3::ZERO));
    }
}
