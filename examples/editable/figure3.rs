//! Figure 3: pictures with more and more basis functions.

use glam::DVec3;
use translux::error::Result;

use crate::bench::{View, bake, exposure, open, percent, picture, rms, shown, sun, truth, under};
use crate::common::bench::{Context, Recipe, table};
use crate::common::sheet;

const MODEL: (&str, usize) = ("horse", 65_536);
const QUICK: (&str, usize) = ("bunny_3k", 16_384);

/// Functions, and materials: as the paper.
const TERMS: [usize; 5] = [1, 2, 4, 8, 12];
const MATERIALS: [&str; 2] = ["marble", "potato"];

/// Bases: this program's and the paper's.
const BASES: [&str; 2] = ["transported", "plain"];

const SIDE: usize = 200;

/// The z axis of the horse is up.
const VIEW: Option<View> = Some(View { from: DVec3::new(0.72, 0.38, 0.22), up: DVec3::Z });

/// Nothing but the basis is to be seen.
const MAX_RMS: f64 = 0.01;

pub(crate) fn run(context: &Context) -> Result<String> {
    let (model, samples) = if context.quick { QUICK } else { MODEL };
    let scene = context.scene(model, "marble")?;
    let mut truth = truth(context, &scene)?;
    let lights = [sun()];
    let mut expected = Vec::new();
    for material in MATERIALS {
        expected.push(under(truth.as_mut(), material, &lights)?);
    }
    let (mut sheets, mut rows) = (vec![Vec::new(); MATERIALS.len()], Vec::new());
    for basis in BASES {
        for terms in context.some(&TERMS, 3) {
            let count = terms.to_string();
            let set = [("transport", "stored"), ("basis", basis), ("terms", count.as_str())];
            let (asset, _) = bake(&scene, &Recipe { samples: Some(samples), max_rms: MAX_RMS, set: &set })?;
            // The material of the bake itself may be among those that are refused.
            let mut evaluator = open(asset);
            let mut row = vec![basis.to_owned(), count.clone()];
            for ((material, expected), sheet) in MATERIALS.iter().zip(&expected).zip(&mut sheets) {
                // A material that the functions do not hold is refused, with the error that it would have.
                let opened = evaluator.as_mut().map_err(|error| error.clone());
                let found = opened.and_then(|e| Ok((under(e.as_mut(), material, &lights)?, e)));
                match found {
                    Ok((found, evaluator)) => {
                        row.push(percent(rms(&scene, &found, expected)));
                        if basis == BASES[0] {
                            let factor = exposure(&picture(evaluator.as_ref(), expected, (SIDE, VIEW))?);
                            sheet.push(shown(&picture(evaluator.as_ref(), &found, (SIDE, VIEW))?, factor));
                        }
                    }
                    Err(error) => {
                        let reason = error.message().split("could be off by ").nth(1).unwrap_or("");
                        row.push(format!("refused: {}", reason.split(';').next().unwrap_or("")));
                        if basis == BASES[0] {
                            sheet.push(vec![[0.5; 3]; SIDE * SIDE]);
                        }
                    }
                }
            }
            context.say(&format!("figure 3: {}", row.join(", ")));
            rows.push(row);
        }
    }
    for (expected, sheet) in expected.iter().zip(&mut sheets) {
        let frame = picture(truth.as_ref(), expected, (SIDE, VIEW))?;
        sheet.push(shown(&frame, exposure(&frame)));
    }
    translux::io::atomic::write(&context.pictures.join("editable_figure3.png"), &sheet::png(SIDE, &sheets)?)?;
    let head: Vec<&str> = ["basis", "functions"].into_iter().chain(MATERIALS).collect();
    Ok(format!(
        "![With more and more basis functions](pictures/editable_figure3.png)\n\n@figure3@\n\n{}",
        table(&head, &rows)
    ))
}
