//! The paper's Figure 9: image error against the number of reference points.

use translux::error::Result;
use translux::measure::chart::draw::{Front, Point, Scatter, Unit, as_svg};

use crate::bench::{Context, bytes_per_vertex, encoded, table};
use crate::encodings::{Stand, cells};

/// Shares of the vertices.
const SHARES: [f64; 5] = [0.005, 0.01, 0.02, 0.04, 0.08];

/// A curve: its name and the keys.
const CURVES: [(&str, &[(&str, &str)]); 4] = [
    (
        "the paper's, n = 3",
        &[("encoding", "reference-points"), ("order", "3"), ("choice", "geometry"), ("weights", "barycentric")],
    ),
    (
        "the paper's, n = 6",
        &[("encoding", "reference-points"), ("order", "6"), ("choice", "geometry"), ("weights", "barycentric")],
    ),
    ("illumination, best triangle, n = 3", &[("encoding", "reference-points"), ("order", "3")]),
    ("components", &[]),
];

/// The figure.
pub(crate) fn run(context: &Context) -> Result<String> {
    let stand = Stand::new(context, context.model(), "marble")?;
    let raw = encoded(&stand.scene, &[("encoding", "raw")])?;
    let plain = stand.pictures(&raw, None)?;
    let mut scatter = Scatter {
        title: format!("Image error against the number of reference points, {}, marble", context.model()),
        axes: ["reference points".to_owned(), "image RMS with background, worst light and view".to_owned()],
        units: [Unit::Number, Unit::Number],
        points: Vec::new(),
        lines: Vec::new(),
        front: Front::Left,
    };
    let mut rows = Vec::new();
    for (name, keys) in CURVES {
        for share in context.some(&SHARES, 2) {
            let count = stand.per_vertex(share);
            let text = count.to_string();
            let mut set = keys.to_vec();
            set.push(("references", &text));
            let asset = encoded(&stand.scene, &set)?;
            let error = stand.error(&asset, None, &plain)?;
            scatter.points.push(Point { series: name.to_owned(), x: count as f64, y: error.worst.with_background });
            let [added, covered, one] = cells(error);
            let [whole, ..] = cells(stand.error(&asset, None, &stand.truth)?);
            let bytes = format!("{:.1}", bytes_per_vertex(&asset)?);
            rows.push(vec![
                name.to_owned(),
                format!("{:.1} % ({count})", 100.0 * share),
                bytes,
                added,
                covered,
                one,
                whole,
            ]);
            context.say(&format!("figure 9: {name}, {count}"));
        }
    }
    let file = "quantized_figure9.svg";
    translux::io::atomic::write(&context.pictures.join(file), as_svg(&scatter)?.as_bytes())?;
    let head =
        ["encoding", "reference points", "bytes/vertex", "added", "covered", "one exposure", "with the interpolation"];
    Ok(format!("![Image error against the number of reference points](pictures/{file})\n\n{}", table(&head, &rows)))
}
