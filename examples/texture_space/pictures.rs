//! Pictures at few and many samples: shared ones leave patterns, which all places have in common.

use translux::error::Result;
use translux::io::atomic;

use crate::bench::{baked, lights, with_count};
use crate::common::bench::Context;
use crate::common::lit::{exposure, opened, picture, shown, truth, under};
use crate::common::sheet;

use crate::samples::CHOICES;

const COUNTS: [u32; 4] = [25, 100, 400, 1600];
const SIDE: usize = 220;

pub(crate) fn run(context: &Context) -> Result<String> {
    let (model, size, material) = if context.quick { ("bunny_3k", 10.0, "skin1") } else { ("igea_8k", 10.0, "skin1") };
    let scene = context.sized_scene(model, material, size)?;
    let [light, _] = lights();
    let mut truth = truth(context, &scene)?;
    let expected = under(truth.as_mut(), &light)?;
    let frame = picture(truth.as_ref(), &expected, SIDE)?;
    let factor = exposure(&frame);
    let right = shown(&frame, factor);
    let mut rows = Vec::new();
    for (_, sampling) in CHOICES {
        let asset = baked(&scene, &[("sampling", sampling)], 1)?;
        let mut row = Vec::new();
        for count in COUNTS {
            let mut evaluator = opened(&with_count(&asset, count)?)?;
            let values = under(evaluator.as_mut(), &light)?;
            row.push(shown(&picture(evaluator.as_ref(), &values, SIDE)?, factor));
        }
        row.push(right.clone());
        rows.push(row);
    }
    let name = "texture_space_samples.png";
    atomic::write(&context.pictures.join(name), &sheet::png(SIDE, &rows)?)?;
    Ok(format!(
        "![{model}, {size} mm, {material}: 25, 100, 400 and 1600 samples and the exact sums; shared, clusters, product](pictures/{name})\n\n\
         {model}, {size} mm, {material}; 25, 100, 400 and 1600 samples and the exact sums. From above: shared, clusters, product.\n"
    ))
}
