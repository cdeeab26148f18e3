//! Against an independent program's walks through the bunny: every vertex, noise taken out by two halves.

use std::path::Path;
use std::time::Instant;

use glam::DVec3;
use translux::error::{Error, Result};
use translux::light::Light;
use translux::medium::profile::Orders;
use translux::progress::Silent;
use translux::scene::Scene;
use translux::transport::calibration::surface::CalibratedSurface;
use translux::transport::calibration::{Told, Walks};
use translux::transport::irradiance::LightSampling;
use translux::transport::random_walk::model_error::project;
use translux::transport::random_walk::tally::Hats;

use crate::common::bench::{Context, table};
use crate::common::lit::percent;
use crate::common::runner::summary;

pub(crate) const SAMPLING: LightSampling = LightSampling { points_per_patch: 4, directions: 256, area_side: 8 };

pub(crate) const SAMPLES: usize = 65_536;

/// The light of the truth.
pub(crate) fn sun() -> Light {
    Light::Directional { from: DVec3::new(0.3, 0.8, 0.5).normalize(), irradiance: DVec3::ONE }
}

/// Walks of the page's rows, and their name.
const EFFORTS: [(u64, u64, &str); 2] = [(200_000, 20_000_000, "few walks"), (4_000_000, 400_000_000, "many walks")];

pub(crate) fn run(context: &Context) -> Result<String> {
    let mut rows = Vec::new();
    let mut text = String::new();
    for material in ["marble", "skin1"] {
        let scene = context.scene("bunny_3k", material)?;
        let truths = [("directional", sun()), ("constant", Light::Constant { radiance: DVec3::ONE })];
        let told = Told::nothing(scene.domain());
        let dipole = CalibratedSurface::with(scene.domain(), SAMPLES, told, &Silent)?;
        rows.push(row(context, (material, "dipole", 0.0), &dipole, &scene, (&truths, Orders::FromOne))?.0);
        let mut worst = Vec::new();
        for (photons, collisions, name) in context.some(&EFFORTS, 1) {
            for orders in [Orders::FromOne, Orders::FromTwo] {
                let start = Instant::now();
                let walks = Walks { photons, collisions, orders, ..Walks::default() };
                let body = CalibratedSurface::new(scene.domain(), SAMPLES, walks, &Silent)?;
                let seconds = start.elapsed().as_secs_f64();
                let of_orders = if orders == Orders::FromOne { "orders >= 1" } else { "orders >= 2" };
                let label = format!("calibrated, {name}, {of_orders}");
                let (row, [directional, constant]) =
                    row(context, (material, &label, seconds), &body, &scene, (&truths, orders))?;
                rows.push(row);
                worst.push((label.clone(), directional, constant));
                context.say(&format!("{material}, {label}: {} {}", percent(directional), percent(constant)));
            }
        }
        let wanted = if material == "marble" { ("<= 4 %", "<= 3 %") } else { ("<= 8 %", "<= 4 %") };
        let of = |words: &str, which: usize| -> String {
            let each = worst.iter().filter(|w| w.0.ends_with(words));
            each.map(|w| percent(if which == 0 { w.1 } else { w.2 })).collect::<Vec<_>>().join(" / ")
        };
        let name = format!("bunny_3k 30 mm, {material}, worst channel, sun");
        text += &summary(&format!("{name}, no stage for order 1"), "-", wanted.0, &format!("{} %", of(">= 1", 0)));
        text +=
            &summary(&format!("{name}, order 1 apart (of all light)"), "-", wanted.1, &format!("{} %", of(">= 2", 0)));
        text += &summary(&format!("{name}, constant light"), "-", "<= 2 %", &format!("{} %", of(">= 1", 1)));
    }
    let head = ["material", "kernel", "s", "sun R", "G", "B", "bias R G B", "constant light R", "G", "B"];
    Ok(text + &table(&head, &rows))
}

type Named<'a> = (&'a str, &'a str, f64);

/// A row of the table, and the errors of the worst channel under the two lights.
fn row(
    context: &Context,
    (material, label, seconds): Named,
    body: &CalibratedSurface,
    scene: &Scene,
    (truths, orders): (&[(&str, Light); 2], Orders),
) -> Result<(Vec<String>, [f64; 2])> {
    let mut cells = vec![material.to_owned(), label.to_owned(), format!("{seconds:.1}")];
    let mut worst = [0.0f64; 2];
    for (which, (name, light)) in truths.iter().enumerate() {
        let radiosity = body.radiosity(std::slice::from_ref(light), SAMPLING, &Silent)?;
        let hats = &Hats::new(&scene.mesh, &scene.parts);
        let projected = hats.to_vertices(&project(hats, &radiosity)?);
        let mut biases = Vec::new();
        for (c, channel) in ["r", "g", "b"].iter().enumerate() {
            let file = format!("../truth/volumetric/bunny_3k_30mm_{material}_{channel}_{name}.f32");
            let [error, bias] = against(&context.data.join(file), c, &projected, orders)?;
            worst[which] = worst[which].max(error);
            cells.push(percent(error));
            biases.push(format!("{bias:.2}"));
        }
        if which == 0 {
            cells.push(biases.join(" "));
        }
    }
    assert_eq!(scene.mesh.local_mm.len(), body.calibrated.lattice.of_vertex.len());
    Ok((cells, worst))
}

/// Error of a channel relative to the light of orders >= 1, and its bias relative to that of its own orders.
fn against(path: &Path, c: usize, values: &[DVec3], orders: Orders) -> Result<[f64; 2]> {
    const COLUMNS: usize = 8;
    let bytes = std::fs::read(path).map_err(|e| Error::io(path, &e))?;
    let numbers: Vec<f64> = bytes.as_chunks::<4>().0.iter().map(|b| f64::from(f32::from_le_bytes(*b))).collect();
    let (mut square, mut all, mut difference, mut mean) = (0.0, 0.0, 0.0, 0.0);
    for (row, value) in numbers.as_chunks::<COLUMNS>().0.iter().zip(values) {
        let [_, _, once_a, once_b, more_a, more_b, _, area] = *row;
        let once = if orders == Orders::FromOne { 1.0 } else { 0.0 };
        let (a, b) = (more_a + once * once_a, more_b + once * once_b);
        square += area * (value[c] - a) * (value[c] - b);
        all += area * (more_a + once_a) * (more_b + once_b);
        difference += area * (value[c] - 0.5 * (a + b));
        mean += area * 0.5 * (a + b);
    }
    Ok([(square / all).max(0.0).sqrt(), 1.0 + difference / mean])
}
