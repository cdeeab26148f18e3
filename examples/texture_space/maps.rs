//! Maps to the texture: what they give up, and what the paper's samples make of them.

use translux::error::Result;
use translux::math::statistics::vertex_error;

use crate::bench::{Compared, baked, four, lights};
use crate::common::bench::{Context, bytes_per_vertex, table};
use crate::common::lit::{opened, percent, truth, under};

const CASES: [(&str, f64, &str); 2] = [("igea_8k", 10.0, "skin1"), ("cow_head", 30.0, "marble")];
const MAPS: [&str; 3] = ["conformal", "shape", "area"];
const SAMPLES: usize = 1600;

/// A coarse texture, as maps that shrink the surface find it; and a fine one.
const RESOLUTIONS: [&str; 2] = ["128", "512"];

pub(crate) fn run(context: &Context) -> Result<String> {
    let mut rows = Vec::new();
    for (model, size, material) in context.some(&CASES, 1) {
        let scene = context.sized_scene(model, material, size)?;
        let compared = Compared::new(context, scene.clone())?;
        let mut truth = truth(context, &scene)?;
        let [light, _] = lights();
        let expected = under(truth.as_mut(), &light)?;
        for map in MAPS {
            for resolution in RESOLUTIONS {
                let mut row = vec![model.to_owned(), format!("{map}, {resolution}")];
                for sampling in ["shared", "product"] {
                    let set = [("sampling", sampling), ("map", map), ("resolution", resolution)];
                    let asset = baked(&scene, &set, SAMPLES)?;
                    if sampling == "shared" {
                        let numbers = translux_format::atlas::Atlas::from_sections(
                            &asset.sections,
                            &(0..scene.mesh.triangles.len() as u32).map(|t| scene.mesh.welded(t)).collect::<Vec<_>>(),
                            translux_format::Budget::default(),
                        );
                        let numbers = numbers.ok().flatten().map(|atlas| atlas.numbers).unwrap_or_default();
                        let [low, high] = numbers.area_range;
                        row.push(numbers.charts.to_string());
                        row.push(format!("{:.0} %", 100.0 * numbers.occupancy));
                        row.push(format!("{:.3}", numbers.stretch));
                        row.push(format!("{low:.2} to {high:.2}, {:.2}", numbers.smallest));
                        row.push(format!("{:.1}", bytes_per_vertex(&asset)?));
                    }
                    let errors = compared.errors(&asset)?;
                    let values = under(opened(&asset)?.as_mut(), &light)?;
                    let worst = vertex_error(&values, &expected, &scene.vertex_areas_mm2()).worst;
                    row.push(format!("{} ({} %)", four(errors.image), percent(worst)));
                }
                context.say(&row.join(", "));
                rows.push(row);
            }
        }
    }
    let head = [
        "model",
        "map, texels",
        "charts",
        "covered",
        "L2 stretch",
        "area ratio: 1st to 99th percentile, least",
        "bytes/vertex",
        "shared, image RMS (worst vertex)",
        "product",
    ];
    Ok(table(&head, &rows))
}
