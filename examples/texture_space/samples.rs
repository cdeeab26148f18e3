//! The error of pictures by the number of samples (the paper's Figure 7), and the paper's own figures.

use translux::error::Result;
use translux::io::atomic;
use translux::measure::chart::draw::{Front, Point, Scatter, Unit, as_svg};

use crate::bench::{Compared, baked, four, with_count};
use crate::common::bench::{Context, table};
use crate::common::lit::percent;
use crate::common::runner::summary;

/// Model, diagonal in mm, materials, and the number of samples and the errors of the paper.
type Case = (&'static str, f64, [&'static str; 2], u32, [&'static str; 2]);
const CASES: [Case; 2] = [
    ("igea_8k", 10.0, ["skin1", "skin2"], 1600, [".0096", ".0098"]),
    ("santa", 30.0, ["skin1", "skin2"], 2500, [".0138", ".0119"]),
];

const COUNTS: [u32; 8] = [49, 100, 256, 400, 900, 1600, 2500, 6400];

pub(crate) const CHOICES: [(&str, &str); 3] =
    [("shared (the paper's)", "shared"), ("clusters", "clusters"), ("product", "product")];

/// What is wanted of the better choices.
const WANTED: [f64; 2] = [0.005, 0.007];

pub(crate) fn run(context: &Context) -> Result<String> {
    let mut text = String::new();
    let mut scatter = Scatter {
        title: "Image error against the number of samples".to_owned(),
        axes: ["samples".to_owned(), "RMS of covered pixels, worse of two lights".to_owned()],
        units: [Unit::Number, Unit::Number],
        points: Vec::new(),
        lines: Vec::new(),
        front: Front::Left,
    };
    for ((model, size, materials, at, paper), wanted) in context.some(&CASES, 1).into_iter().zip(WANTED) {
        for (material, paper) in context.some(&materials, 1).into_iter().zip(paper) {
            let compared = Compared::new(context, context.sized_scene(model, material, size)?)?;
            let mut rows = Vec::new();
            let mut found = Vec::new();
            for (name, sampling) in CHOICES {
                let asset = baked(&compared.scene, &[("sampling", sampling)], 1)?;
                let mut row = vec![name.to_owned()];
                for count in context.some(&COUNTS, 4) {
                    let errors = compared.errors(&with_count(&asset, count)?)?;
                    row.push(format!("{} ({} %)", four(errors.image), percent(errors.vertices)));
                    let series = format!("{model}, {material}, {sampling}");
                    if material == "skin2" || context.quick {
                        scatter.points.push(Point { series, x: f64::from(count), y: errors.image });
                    }
                    if count == at {
                        found.push(four(errors.image));
                    }
                }
                context.say(&row.join(", "));
                rows.push(row);
            }
            if let [shared, clusters, product] = found.as_slice() {
                text.push_str(&summary(
                    &format!("image RMS, {model} {size} mm, {material}, {at} samples"),
                    paper,
                    &format!("<= {wanted}"),
                    &format!("the paper's draws {shared}; clusters {clusters}, product {product}"),
                ));
            }
            let counts: Vec<String> = context.some(&COUNTS, 4).iter().map(u32::to_string).collect();
            let head: Vec<&str> = std::iter::once("samples").chain(counts.iter().map(String::as_str)).collect();
            text.push_str(&format!(
                "**{model}, {size} mm, {material}**: image RMS (vertex RMS).\n\n{}\n",
                table(&head, &rows)
            ));
        }
    }
    let name = "texture_space_samples.svg";
    atomic::write(&context.pictures.join(name), as_svg(&scatter)?.as_bytes())?;
    text.push_str(&format!("![Image error against the number of samples](pictures/{name})\n\n"));
    Ok(text)
}
