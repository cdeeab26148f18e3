//! Tables 1 and 2: bakes, sizes, and the rates of new lights and new materials, with what the paper never states: the error.

use translux::error::Result;
use translux::math::statistics::vertex_error;
use translux::progress::Silent;

use crate::bench::{bake, bytes_per_vertex, open, percent, sun, times_ms, truth, under};
use crate::common::bench::{Context, Recipe, met, table};
use crate::common::runner::summary;

/// Models (with their longest edges cut until they have as many vertices as the paper's), samples, and what the paper has of them: minutes of both passes, MB, frames a second of a new light and of an edit.
const MODELS: [(&str, usize, usize, &str); 4] = [
    ("beethoven", 16_384, 65_536, "16K vertices, 64K samples: 18 min; 44 MB; 68, 120"),
    ("gargoyle", 65_536, 131_072, "64K vertices, 128K samples: 113 min; 125 MB; 20, 50"),
    ("bunny_closed", 0, 131_072, "-"),
    ("horse", 0, 131_072, "-"),
];
const QUICK: [(&str, usize, usize, &str); 1] = [("bunny_3k", 0, 16_384, "-")];

/// Materials of the errors: one that is clear, one that is dense, one that absorbs.
pub(crate) const MATERIALS: [&str; 4] = ["marble", "skin1", "ketchup", "chicken1"];

/// A name, the error that is asked for, keys.
type Form = (&'static str, f64, &'static [(&'static str, &'static str)]);

/// Stored transport, and none.
const FORMS: [Form; 2] = [
    ("stored", 0.01, &[("transport", "stored"), ("points", "1")]),
    ("nothing stored", 0.005, &[("transport", "none"), ("points", "1")]),
];

/// Bytes a vertex and error that are wanted of each form.
const WANTED: [(f64, f64); 2] = [(300.0, 0.01), (40.0, 0.001)];
const WANTED_FPS: (f64, f64) = (60.0, 300.0);

pub(crate) fn run(context: &Context) -> Result<String> {
    let models: &[_] = if context.quick { &QUICK } else { &MODELS };
    let (mut rows, mut text) = (Vec::new(), String::new());
    for &(model, vertices, samples, paper) in models {
        let scene = context.finer_scene(model, vertices, "marble")?;
        let areas = scene.vertex_areas_mm2();
        let mut truth = truth(context, &scene)?;
        let lights = [sun()];
        let expected = MATERIALS.map(|material| under(truth.as_mut(), material, &lights));
        for (form, (name, max_rms, set)) in FORMS.iter().enumerate() {
            let recipe = Recipe { samples: Some(samples), max_rms: *max_rms, set };
            let (asset, seconds) = bake(&scene, &recipe)?;
            let bytes = bytes_per_vertex(&asset)?;
            let mut evaluator = open(asset)?;
            evaluator.prepare_for_edits(&Silent);
            let mut worst = (0.0f64, "");
            for (material, expected) in MATERIALS.iter().zip(&expected) {
                let Ok(expected) = expected else { continue };
                let found = under(evaluator.as_mut(), material, &lights)?;
                let error = vertex_error(&found, expected, &areas).rms;
                worst = if error > worst.0 { (error, material) } else { worst };
            }
            let (light_ms, edit_ms) = times_ms(evaluator.as_mut())?;
            let vertices = scene.mesh.local_mm.len();
            context.say(&format!("tables: {model}, {name}: {seconds:.0} s, {bytes:.0} bytes, {}", percent(worst.0)));
            rows.push(vec![
                model.to_owned(),
                (*name).to_owned(),
                vertices.to_string(),
                samples.to_string(),
                format!("{seconds:.0} s"),
                format!("{bytes:.0}"),
                format!("{:.1} MB", bytes * vertices as f64 / 1e6),
                format!("{} ({})", percent(worst.0), worst.1),
                format!("{:.0}", 1e3 / light_ms),
                format!("{:.0}", 1e3 / edit_ms),
                paper.to_owned(),
            ]);
            if model == "gargoyle" {
                let (wanted_bytes, wanted_rms) = WANTED[form];
                let ok = bytes <= wanted_bytes && worst.0 <= wanted_rms;
                text += &summary(
                    &format!(
                        "bytes/vertex, {name}, {model}, {} asked; RMS against the truth, worst of {} materials",
                        percent(*max_rms),
                        MATERIALS.len()
                    ),
                    "1,953; 3 to 14 %",
                    &format!("<= {wanted_bytes:.0}; <= {:.1} %", 100.0 * wanted_rms),
                    &format!("{bytes:.0}; {}; {}", percent(worst.0), met(ok)),
                );
            }
            if model == "gargoyle" && form == 0 {
                let (light, edit) = (1e3 / light_ms, 1e3 / edit_ms);
                for (what, paper, wanted, found) in [
                    ("a new light, shadows included", "20 to 68", WANTED_FPS.0, light),
                    ("a new material", "50 to 220", WANTED_FPS.1, edit),
                ] {
                    text += &summary(
                        &format!("{what}, a second (stored, gargoyle)"),
                        paper,
                        &format!(">= {wanted:.0}"),
                        &format!("{found:.0}; {}", met(found >= wanted)),
                    );
                }
            }
        }
    }
    let head = [
        "model",
        "transport",
        "vertices",
        "samples",
        "bake",
        "bytes/vertex",
        "in all",
        "RMS, worst material",
        "lights/s",
        "edits/s",
        "the paper",
    ];
    Ok(text + &table(&head, &rows))
}
