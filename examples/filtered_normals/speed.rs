//! Times: bakes without a fit, changes of the filter.

use std::time::Instant;

use translux::error::Result;
use translux::medium::material::Medium;
use translux::progress::Silent;

use crate::bench::{baked, six_lights};
use crate::common::bench::{Context, bytes_per_vertex, properties, table};
use crate::common::lit::opened;

/// Models, and vertices that they are cut to.
const MODELS: [(&str, usize); 3] = [("bunny_closed", 0), ("bunny_closed", 134_000), ("bunny_closed", 1_000_000)];

const CHANGES: usize = 40;

pub(crate) fn run(context: &Context) -> Result<String> {
    let mut rows = Vec::new();
    let models = if context.quick { vec![("bunny_3k", 0)] } else { MODELS.to_vec() };
    for (model, vertices) in models {
        let scene = match vertices {
            0 => context.scene(model, "skin1")?,
            _ => context.finer_scene(model, vertices, "skin1")?,
        };
        let count = scene.mesh.local_mm.len();
        let mut sets = vec![("heat", "10")];
        if count < 500_000 {
            sets.push(("geometric", "10"));
        }
        if count < 50_000 {
            // 300 pairs and all of the paper's.
            sets.extend([("spectral", "17.8"), ("spectral", "10")]);
        }
        for (filter, wavelength) in sets {
            let mut set = vec![("filter", filter), ("alpha", "0.2"), ("width", "1")];
            if filter == "spectral" {
                set.push(("wavelength", wavelength));
            }
            let start = Instant::now();
            let asset = baked(&scene, &set)?;
            let bake = start.elapsed().as_secs_f64();
            let mut evaluator = opened(&asset)?;
            let light = six_lights(&scene)?.swap_remove(0).1;
            evaluator.set_lights(vec![light], &Silent)?;
            let media: Vec<Vec<Medium>> = ["skin1", "marble"]
                .map(|name| Ok(vec![Medium { name: name.to_owned(), properties: properties(name)? }]))
                .into_iter()
                .collect::<Result<_>>()?;
            let start = Instant::now();
            for i in 0..CHANGES {
                evaluator.set_media(media[i % 2].clone())?;
                evaluator.radiosity(&Silent)?;
            }
            let changes = CHANGES as f64 / start.elapsed().as_secs_f64();
            let pairs = if filter == "spectral" { format!(", wavelength {wavelength} edges") } else { String::new() };
            let row = vec![
                format!("{model}, {count} vertices"),
                format!("{filter}{pairs}"),
                format!("{bake:.2}"),
                format!("{changes:.0}"),
                format!("{:.1}", bytes_per_vertex(&asset)?),
            ];
            context.say(&row.join(", "));
            rows.push(row);
        }
    }
    Ok(table(&["mesh", "filter", "bake without fit, s", "changes of the filter a second", "bytes/vertex"], &rows))
}
