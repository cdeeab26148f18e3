//! The dipole, the calibrated kernel and a walk through the volume, side by side.

use translux::error::Result;
use translux::io::atomic;
use translux::progress::Silent;
use translux::transport::calibration::surface::CalibratedSurface;
use translux::transport::calibration::{Told, Walks};
use translux::transport::random_walk::exitance::{Effort, exitance};

use crate::common::bench::Context;
use crate::common::lit::{exposure, picture, shown, truth};
use crate::common::sheet;
use crate::truth::{SAMPLES, SAMPLING, sun};

const SIDE: usize = 360;

/// Photons of the walks: their noise is what grains the third picture.
const PHOTONS: u64 = 3_000_000;

/// Gain of the differences.
const GAIN: f32 = 3.0;

pub(crate) fn run(context: &Context) -> Result<String> {
    let mut sheet_rows = Vec::new();
    for material in ["marble", "skin1", "skimmilk"] {
        let scene = context.scene("bunny_3k", material)?;
        let photons = if context.quick { PHOTONS / 20 } else { PHOTONS };
        let walked = exitance(scene.domain(), &[sun()], Effort::Photons(photons), 5, &Silent)?;
        let body = CalibratedSurface::new(scene.domain(), SAMPLES, Walks::default(), &Silent)?;
        let dipole = CalibratedSurface::with(scene.domain(), SAMPLES, Told::nothing(scene.domain()), &Silent)?;
        let drawn = truth(context, &scene)?;
        let walk = picture(drawn.as_ref(), &walked.hats.to_vertices(&walked.total), SIDE)?;
        let factor = exposure(&walk);
        let walk = shown(&walk, factor);
        let mut row = Vec::new();
        for body in [&dipole, &body] {
            let radiosity = body.radiosity(&[sun()], SAMPLING, &Silent)?;
            row.push(shown(&picture(drawn.as_ref(), &radiosity, SIDE)?, factor));
        }
        let difference = |picture: &[[f32; 3]]| -> Vec<[f32; 3]> {
            let pixel =
                |(a, b): (&[f32; 3], &[f32; 3])| [0, 1, 2].map(|c| (0.5 + GAIN * (a[c] - b[c])).clamp(0.0, 1.0));
            picture.iter().zip(&walk).map(pixel).collect()
        };
        let differences = [difference(&row[0]), difference(&row[1])];
        row.push(walk.clone());
        row.extend(differences);
        sheet_rows.push(row);
        context.say(material);
    }
    let name = "model.png";
    atomic::write(&context.pictures.join(name), &sheet::png(SIDE, &sheet_rows)?)?;
    Ok(format!(
        "![Dipole, calibrated, walk, and three times the differences of the first two from the third](pictures/{name})\n\n\
         bunny_3k, 30 mm, in marble, skin1 and skim milk: the dipole, the calibrated kernel, the walk; three times the differences of both from \
         the walk, grey where there is none.\n"
    ))
}
