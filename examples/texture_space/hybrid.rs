//! The hybrid method: its division, three materials and three sizes at a constant number of samples.

use translux::error::Result;

use crate::bench::{Compared, baked, four};
use crate::common::bench::{Context, table};
use crate::common::lit::percent;
use crate::common::runner::summary;

const MATERIALS: [&str; 3] = ["skin1", "marble", "cream"];
const SIZES: [f64; 3] = [10.0, 20.0, 30.0];

/// Values of the lower bound c, 1/mm.
const BOUNDS: [&str; 7] = ["0.003", "0.01", "0.03", "0.05", "0.1", "0.15", "0.2"];

/// Samples of the far part: the paper's, and those that hold all of the light.
const FAR: [&str; 2] = ["drawn", "clusters"];

/// Global samples, and with those of the local part.
const GLOBAL: usize = 900;
const ALL: usize = 1301;

pub(crate) fn run(context: &Context) -> Result<String> {
    let model = if context.quick { "bunny_3k" } else { "santa" };
    let mut text = String::new();
    let (mut sweep, mut rows, mut found) = (Vec::new(), Vec::new(), Vec::new());
    for material in context.some(&MATERIALS, 1) {
        for size in context.some(&SIZES, 1) {
            if material != "skin1" && size != 30.0 {
                continue;
            }
            let compared = Compared::new(context, context.sized_scene(model, material, size)?)?;
            let mut row = vec![format!("{material}, {size} mm")];
            for (set, count) in [
                (vec![("sampling", "shared")], GLOBAL),
                (vec![("sampling", "shared")], ALL),
                (vec![("sampling", "hybrid"), ("far", FAR[0])], GLOBAL),
                (vec![("sampling", "hybrid"), ("far", FAR[1])], GLOBAL),
                (vec![("sampling", "clusters")], ALL),
                (vec![("sampling", "product")], ALL),
            ] {
                let errors = compared.errors(&baked(&compared.scene, &set, count)?)?;
                row.push(format!("{} ({} %)", four(errors.image), percent(errors.vertices)));
                if size == 30.0 && ["hybrid", "product"].contains(&set[0].1) {
                    found.push(four(errors.image));
                }
            }
            context.say(&row.join(", "));
            rows.push(row);
            if size == 30.0 || context.quick {
                for far in FAR {
                    let mut row = vec![format!("{material}, {size} mm, {far}")];
                    for bound in context.some(&BOUNDS, 1) {
                        let set = [("sampling", "hybrid"), ("far", far), ("importance", bound)];
                        row.push(four(compared.errors(&baked(&compared.scene, &set, GLOBAL)?)?.image));
                    }
                    context.say(&row.join(", "));
                    sweep.push(row);
                }
            }
        }
    }
    if let [[a, b, c], [d, e, f], [g, h, i]] = found.as_chunks().0 {
        text.push_str(&summary(
            &format!("image RMS, {model} 30 mm, skin1 / marble / cream, {GLOBAL} + 401 samples"),
            ".0107 to .0144",
            "<= .007",
            &format!(
                "the paper's hybrid {a} / {d} / {g}; far part by clusters {b} / {e} / {h}; product, {ALL} samples {c} / {f} / {i}"
            ),
        ));
    }
    let head = [
        model,
        &format!("shared, {GLOBAL}"),
        &format!("shared, {ALL}"),
        &format!("hybrid, {GLOBAL} drawn + 401"),
        &format!("hybrid, {GLOBAL} clusters + 401"),
        &format!("clusters, {ALL}"),
        &format!("product, {ALL}"),
    ];
    text.push_str(&format!("Image RMS (vertex RMS).\n\n{}\n", table(&head, &rows)));
    let head: Vec<&str> = std::iter::once("c, 1/mm").chain(context.some(&BOUNDS, 1)).collect();
    text.push_str(&format!(
        "The lower bound c, which the paper leaves open (0.1 is the default): image RMS of the hybrid method.\n\n{}\n",
        table(&head, &sweep)
    ));
    Ok(text)
}
