//! The paper's Figure 2: what an uneven mesh does to a filter. Edges of the same surface are cut, so that only the vertices change; a
//! filter of the surface gives the same values at the vertices that were there.

use translux::error::Result;

use crate::bench::{baked, six_lights};
use crate::common::bench::{Context, table};
use crate::common::lit::{exposure, opened, percent, picture, rms, shown, truth, under};
use crate::common::sheet;

const MODELS: [&str; 3] = ["cow", "dragon_res3", "bunny_3k"];

/// Vertices after cutting, over those before.
const FINER: usize = 3;

const SIDE: usize = 220;

const MATERIAL: &str = "skimmilk";

const FILTERS: [(&str, &[(&str, &str)]); 4] = [
    (
        "geometric, as the paper",
        &[
            ("filter", "geometric"),
            ("weights", "count"),
            ("alpha", "0.5"),
            ("width", "1"),
            ("shadows", "off"),
            ("length", "unit"),
        ],
    ),
    (
        "geometric, by area",
        &[
            ("filter", "geometric"),
            ("weights", "area"),
            ("sum", "mean"),
            ("alpha", "0"),
            ("width", "1"),
            ("shadows", "off"),
            ("length", "unit"),
        ],
    ),
    ("spectral", &[("filter", "spectral"), ("alpha", "0"), ("width", "1"), ("shadows", "off"), ("length", "unit")]),
    ("heat", &[("alpha", "0"), ("width", "1"), ("shadows", "off"), ("length", "unit")]),
];

pub(crate) fn run(context: &Context) -> Result<String> {
    let (mut rows, mut sheets) = (Vec::new(), Vec::new());
    for model in context.some(&MODELS, 1) {
        let scene = context.scene(model, MATERIAL)?;
        let vertices = scene.mesh.local_mm.len();
        let finer = context.finer_scene(model, FINER * vertices, MATERIAL)?;
        let lights = six_lights(&scene)?;
        let mut truth = truth(context, &scene)?;
        let mut sheet = Vec::new();
        let lit = under(truth.as_mut(), &lights[0].1)?;
        let factor = exposure(&picture(truth.as_ref(), &lit, SIDE)?);
        sheet.push(shown(&picture(truth.as_ref(), &lit, SIDE)?, factor));
        for (name, set) in FILTERS {
            let [mut own, mut cut] = [opened(&baked(&scene, set)?)?, opened(&baked(&finer, set)?)?];
            let (mut change, mut error) = (0.0, 0.0);
            for (_, light) in &lights {
                let [a, mut b] = [under(own.as_mut(), light)?, under(cut.as_mut(), light)?];
                b.truncate(vertices);
                change += rms(&scene, &b, &a).powi(2) / lights.len() as f64;
                error += rms(&scene, &a, &under(truth.as_mut(), light)?).powi(2) / lights.len() as f64;
            }
            let values = under(own.as_mut(), &lights[0].1)?;
            sheet.push(shown(&picture(own.as_ref(), &values, SIDE)?, factor));
            let row = vec![model.to_owned(), name.to_owned(), percent(change.sqrt()), percent(error.sqrt())];
            context.say(&row.join(", "));
            rows.push(row);
        }
        sheets.push(sheet);
    }
    let path = "filtered_normals_figure2.png";
    translux::io::atomic::write(&context.pictures.join(path), &sheet::png(SIDE, &sheets)?)?;
    let head = ["mesh", "filter", "change when edges are cut, % RMS", "error without shadows, % RMS"];
    Ok(format!(
        "![Exact sums; geometric, geometric by area, spectral, heat](pictures/{path})\n\n{}",
        table(&head, &rows)
    ))
}
