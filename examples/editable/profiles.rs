//! Radial profiles against a random walk: what each is off by, as absorption grows, where the shape is nearly a half space and where it
//! is not.

use glam::DVec3;
use translux::error::Result;
use translux::geometry::mesh::Scale;
use translux::geometry::parts::PartsRule;
use translux::geometry::shapes::icosphere;
use translux::measure::chart::draw::{Front, Point, Scatter, Unit, as_svg};
use translux::medium::material::{Medium, OpticalProperties};
use translux::medium::profiles::model::ProfileModel;
use translux::progress::Silent;
use translux::scene::Scene;
use translux::transport::random_walk::exitance::{Effort, Exitance, exitance};
use translux::transport::random_walk::model_error::{ModelError, compare};

use crate::bench::{bake, open, percent, sun};
use crate::common::bench::{Context, Recipe, SIZE_MM, scene_of, table};

/// Reduced albedos, a channel each.
const ALBEDOS: [[f64; 3]; 2] = [[0.3, 0.6, 0.8], [0.9, 0.97, 0.995]];

/// sigma_s' + sigma_a, 1/mm: 60 free paths across.
const EXTINCTION: f64 = 2.0;

const PROFILES: [&str; 6] =
    ["dipole", "better-dipole", "photon-beam", "burley:fit=searchlight", "burley:fit=diffuse", "burley:fit=dmfp"];

/// Noise of the walk, and of a quick one; it is taken out of the errors.
const NOISE: f64 = 0.06;
const QUICK_NOISE: f64 = 0.2;

const SAMPLES: usize = 65_536;
const SEED: u64 = 1;

fn medium(albedos: [f64; 3]) -> Medium {
    let scattering = EXTINCTION * DVec3::from(albedos);
    let properties = OpticalProperties {
        sigma_s_reduced_per_mm: scattering,
        sigma_a_per_mm: DVec3::splat(EXTINCTION) - scattering,
        g: 0.0,
        eta_inside_over_outside: 1.3,
    };
    Medium { name: "grey".to_owned(), properties }
}

/// Orders of scattering that are compared.
const ORDERS: [&str; 2] = ["all orders", "all orders but single scattering"];

/// A photon leaves once, so that variances of orders add; its weight falls from order to order, so that the later ones have less of
/// the variance than of the sum.
fn without_single(walk: &Exitance) -> Exitance {
    let total: Vec<DVec3> = walk.total.iter().zip(&walk.single).map(|(total, single)| *total - *single).collect();
    let sum = |values: &[DVec3]| values.iter().zip(&walk.hats.mass_mm2).map(|(v, mass)| *v * *mass).sum::<DVec3>();
    let share = (sum(&total) / sum(&walk.total).max(DVec3::splat(f64::MIN_POSITIVE)))
        .clamp(DVec3::ZERO, DVec3::ONE)
        .map(f64::sqrt);
    let standard_error = walk.standard_error.iter().map(|error| *error * share).collect();
    Exitance { total, standard_error, ..walk.clone() }
}

/// Errors of every profile, in their order, against all orders and without the first.
fn errors(scene: &Scene, noise: f64) -> Result<Vec<[ModelError; 2]>> {
    let lights = [sun()];
    let walk = exitance(scene.domain(), &lights, Effort::Noise(noise), SEED, &Silent)?;
    let multiple = without_single(&walk);
    let (asset, _) = bake(scene, &Recipe { samples: Some(SAMPLES), max_rms: 0.005, set: &[] })?;
    let mut evaluator = open(asset)?;
    evaluator.set_lights(lights.to_vec(), &Silent)?;
    let of_profile = |name: &&str| {
        evaluator.set_profile(ProfileModel::parse(name)?.load()?)?;
        let radiosity = evaluator.radiosity(&Silent)?;
        Ok([compare(&walk, &radiosity)?, compare(&multiple, &radiosity)?])
    };
    PROFILES.iter().map(of_profile).collect()
}

pub(crate) fn run(context: &Context) -> Result<String> {
    let noise = if context.quick { QUICK_NOISE } else { NOISE };
    let mut text = String::new();
    for shape in ["ball", "bunny_3k"] {
        let (mut rows, mut points) = ([Vec::new(), Vec::new()], Vec::new());
        for albedos in ALBEDOS {
            let scene = match shape {
                // As wide as the bunny.
                "ball" => {
                    scene_of(icosphere(0.5, 4), Scale::MillimetresPerUnit(SIZE_MM), PartsRule::Auto, medium(albedos))?
                }
                model => Scene { media: vec![medium(albedos)], ..context.scene(model, "marble")? },
            };
            let errors = errors(&scene, noise)?;
            for (channel, albedo) in albedos.iter().enumerate() {
                for (order, rows) in rows.iter_mut().enumerate() {
                    let mut row = vec![albedo.to_string()];
                    for (name, errors) in PROFILES.iter().zip(&errors) {
                        let error = &errors[order];
                        let (rms, unsure) = (error.rms[channel], error.rms_error[channel]);
                        // Lost in the noise of the walk.
                        let rms_text = if rms < unsure { format!("< {}", percent(unsure)) } else { percent(rms) };
                        let rms = rms.max(unsure);
                        row.push(format!("{rms_text} ({:+.0} %)", 100.0 * error.bias[channel]));
                        if order == 1 {
                            points.push(Point { series: (*name).to_owned(), x: 1.0 - albedo, y: rms });
                        }
                    }
                    context.say(&format!("profiles: {shape}, {}: {}", ORDERS[order], row.join(", ")));
                    rows.push(row);
                }
            }
        }
        points.sort_by_key(|point| PROFILES.iter().position(|name| *name == point.series));
        let chart = Scatter {
            title: format!("Profiles against a random walk without single scattering, {shape}, one directional light"),
            axes: ["1 - albedo", "RMS of the difference over that of the walk"].map(str::to_owned),
            units: [Unit::Number, Unit::Percent],
            points,
            lines: Vec::new(),
            front: Front::Left,
        };
        let file = format!("editable_profiles_{shape}.svg");
        translux::io::atomic::write(&context.pictures.join(&file), as_svg(&chart)?.as_bytes())?;
        let head: Vec<&str> = std::iter::once("reduced albedo").chain(PROFILES).collect();
        text += &format!("### {shape}\n\n![Profiles, {shape}](pictures/{file})\n\n");
        for (order, rows) in ORDERS.iter().zip(&rows) {
            text += &format!("Against {order}:\n\n{}\n", table(&head, rows));
        }
    }
    Ok(text)
}
