//! Figure 5: what is saved in space, against error: the distance of the points of the far field, and the truncation.

use translux::error::Result;
use translux::measure::chart::draw::{Front, Point, Scatter, Unit, as_svg};
use translux::progress::Silent;

use crate::bench::{bake, bytes_per_vertex, exposure, open, percent, picture, rms, shown, sun, times_ms, truth, under};
use crate::common::bench::{Context, Recipe, table};
use crate::common::sheet;

const MODEL: (&str, usize, usize) = ("gargoyle", 65_536, 131_072);
const QUICK: (&str, usize, usize) = ("bunny_3k", 0, 16_384);

/// Distances of points in sample spacings, and errors asked of everything.
const SPACINGS: [&str; 5] = ["0", "2", "3", "4", "6"];
const ASKED: [f64; 3] = [0.005, 0.01, 0.02];

/// What is pictured: an error asked, spacings.
const PICTURED: f64 = 0.01;
const MATERIAL: &str = "skin1";
const SIDE: usize = 200;

pub(crate) fn run(context: &Context) -> Result<String> {
    let (model, vertices, samples) = if context.quick { QUICK } else { MODEL };
    let scene = context.finer_scene(model, vertices, MATERIAL)?;
    let mut truth = truth(context, &scene)?;
    let lights = [sun()];
    let expected = under(truth.as_mut(), MATERIAL, &lights)?;
    let reference = picture(truth.as_ref(), &expected, (SIDE, None))?;
    let factor = exposure(&reference);
    let (mut pictures, mut rows, mut points) = (Vec::new(), Vec::new(), Vec::new());
    for spacing in context.some(&SPACINGS, 3) {
        for asked in context.some(&ASKED, 2) {
            let set = [("transport", "stored"), ("far-spacing", spacing), ("points", "1")];
            let (asset, seconds) = bake(&scene, &Recipe { samples: Some(samples), max_rms: asked, set: &set })?;
            let bytes = bytes_per_vertex(&asset)?;
            let mut evaluator = open(asset)?;
            evaluator.prepare_for_edits(&Silent);
            let found = under(evaluator.as_mut(), MATERIAL, &lights)?;
            let error = rms(&scene, &found, &expected);
            let (light_ms, edit_ms) = times_ms(evaluator.as_mut())?;
            context.say(&format!(
                "figure 5: {spacing} apart, {} asked: {bytes:.0} bytes, {}",
                percent(asked),
                percent(error)
            ));
            let series =
                if spacing == "0" { "every vertex".to_owned() } else { format!("{spacing} sample spacings apart") };
            rows.push(vec![
                series.clone(),
                percent(asked),
                format!("{bytes:.0}"),
                percent(error),
                format!("{seconds:.0} s"),
                format!("{light_ms:.0} ms"),
                format!("{edit_ms:.0} ms"),
            ]);
            points.push(Point { series, x: bytes, y: error });
            if asked == PICTURED {
                pictures.push(shown(&picture(evaluator.as_ref(), &found, (SIDE, None))?, factor));
            }
        }
    }
    pictures.push(shown(&reference, factor));
    translux::io::atomic::write(&context.pictures.join("editable_figure5.png"), &sheet::png(SIDE, &[pictures])?)?;
    let chart = Scatter {
        title: format!("Far field at fewer points, {model}, {MATERIAL}, one directional light"),
        axes: ["bytes for each vertex", "relative RMS against the truth"].map(str::to_owned),
        units: [Unit::BytesPerVertex, Unit::Percent],
        points,
        lines: Vec::new(),
        front: Front::Drawn,
    };
    translux::io::atomic::write(&context.pictures.join("editable_spatial.svg"), as_svg(&chart)?.as_bytes())?;
    let head = [
        "points of the far field",
        "error asked",
        "bytes/vertex",
        "RMS against the truth",
        "bake",
        "a new light",
        "an edit",
    ];
    Ok(format!(
        "![Pictures with fewer and fewer points](pictures/editable_figure5.png)\n\n@figure5@\n\n\
         ![Bytes against error](pictures/editable_spatial.svg)\n\n{}",
        table(&head, &rows)
    ))
}
