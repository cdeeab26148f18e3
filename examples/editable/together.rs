//! Light and material new at once with nothing stored: rates against errors.

use translux::error::Result;
use translux::medium::material::PRESETS;
use translux::progress::Silent;

use crate::bench::{bake, both_ms, bytes_per_vertex, media, open, percent, sun};
use crate::common::bench::{Context, Recipe, met, table};
use crate::common::runner::summary;
use crate::tables::MATERIALS;

/// What is asked for, points of a sample that see the light, and how many times a second light and material should change.
const ASKED: [(f64, &str, f64); 2] = [(0.005, "1", 30.0), (0.001, "2", 10.0)];

pub(crate) fn run(context: &Context) -> Result<String> {
    let (model, samples) = if context.quick { ("bunny_3k", 16_384) } else { ("bunny_closed", 131_072) };
    let scene = context.scene(model, "marble")?;
    let vertices = scene.mesh.local_mm.len();
    let (mut rows, mut text) = (Vec::new(), String::new());
    for (max_rms, points, wanted) in ASKED {
        let recipe = Recipe { samples: Some(samples), max_rms, set: &[("transport", "none"), ("points", points)] };
        let (asset, seconds) = bake(&scene, &recipe)?;
        let bytes = bytes_per_vertex(&asset)?;
        let mut evaluator = open(asset)?;
        let mut worst = 0.0f64;
        for material in MATERIALS {
            evaluator.set_media(media(evaluator.scene(), material)?)?;
            evaluator.set_lights(vec![sun()], &Silent)?;
            worst = worst.max(evaluator.measured_error(&[], &Silent)?.total_rms());
        }
        let mut rates = Vec::new();
        for preset in &PRESETS {
            rates.push((1e3 / both_ms(evaluator.as_mut(), preset.name)?, preset.name));
        }
        rates.sort_by(|a, b| a.0.total_cmp(&b.0));
        let [slowest, median, fastest] = [0, rates.len() / 2, rates.len() - 1].map(|i| rates[i]);
        context.say(&format!("together: {}: {:.1} to {:.1} a second", percent(max_rms), slowest.0, fastest.0));
        rows.push(vec![
            percent(max_rms),
            points.to_owned(),
            percent(worst),
            format!("{seconds:.0} s"),
            format!("{bytes:.0}"),
            format!("{:.0} ({})", fastest.0, fastest.1),
            format!("{:.0} ({})", median.0, median.1),
            format!("{:.0} ({})", slowest.0, slowest.1),
        ]);
        text += &summary(
            &format!(
                "light and material new at once, a second, median of {} materials (the slowest); error of samples and transport, the worst of {} (nothing stored, {model}, {vertices} vertices, {samples} samples)",
                PRESETS.len(),
                MATERIALS.len()
            ),
            "-",
            &format!(">= {wanted:.0}; <= {}", percent(max_rms)),
            &format!(
                "{:.0} ({:.0}); {}; {}",
                median.0,
                slowest.0,
                percent(worst),
                met(median.0 >= wanted && worst <= max_rms)
            ),
        );
    }
    let head = [
        "asked",
        "rays a sample",
        "measured",
        "bake",
        "bytes/vertex",
        "fastest material",
        "median material",
        "slowest material",
    ];
    Ok(text + &table(&head, &rows))
}
