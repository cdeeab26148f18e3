//! Errors against the exact sums on the bunny, beside Lambert's cosine that wraps around the terminator and has the right total.

use glam::DVec3;
use translux::error::Result;
use translux::evaluate::Evaluator;
use translux::geometry::bvh::{NO_TRIANGLE, Ray, offset_origin};
use translux::light::Light;
use translux::medium::fresnel::{BoundaryFit, diffuse_transmittance};
use translux::progress::Silent;
use translux::scene::Scene;
use translux::transport::random_walk::exitance::{Effort, exitance};
use translux::transport::random_walk::model_error::compare;

use crate::bench::{baked, six_lights, wide_lights};
use crate::common::bench::{Context, bytes_per_vertex, table};
use crate::common::lit::{exposure, opened, percent, picture, rms, shown, truth, under};
use crate::common::sheet;

const MATERIALS: [&str; 3] = ["marble", "skin1", "skimmilk"];

/// Settings, and what they are called.
const VARIANTS: [(&str, &[(&str, &str)]); 8] = [
    ("normals as they are", &[("alpha", "1"), ("width", "1")]),
    ("heat, fitted", &[]),
    ("heat, not fitted", &[("alpha", "0"), ("width", "1")]),
    ("heat, length multiplies", &[("length", "kept")]),
    ("heat, renormalised", &[("length", "unit")]),
    ("geometric, fitted", &[("filter", "geometric")]),
    ("spectral, fitted", &[("filter", "spectral")]),
    ("bleeding", &[("bleeding", "irradiance")]),
];

const RIVAL: &str = "wrapped Lambert, the best wrap";

/// How far the cosine wraps; the best of them under the same lights is taken, which favours the rival.
const WRAPS: [f64; 6] = [0.0, 0.1, 0.2, 0.3, 0.5, 0.8];

const SIDE: usize = 220;

/// Noise of the walk at single vertices.
const WALK_NOISE: f64 = 0.2;

/// The light under which radiosity is compared with the volume, and pictures are made: the sun from the side.
const SHOWN: usize = 2;

/// Unit normals of the welded vertices, weighted by area.
fn normals(scene: &Scene) -> Vec<DVec3> {
    let mesh = &scene.mesh;
    let mut sums = vec![DVec3::ZERO; mesh.local_mm.len()];
    for triangle in 0..mesh.triangles.len() as u32 {
        mesh.welded(triangle).iter().for_each(|v| sums[*v as usize] += mesh.cross_mm2(triangle));
    }
    mesh.weld.iter().map(|w| sums[*w as usize].normalize_or_zero()).collect()
}

/// `R C V L max(0, mu + w) / (1 + w)^2`: over all normals it sends back what a cosine does. Shadows fade towards the horizon as those of
/// the method do, and nothing is known of how open a vertex is.
fn wrapped(evaluator: &dyn Evaluator, normals: &[DVec3], light: &Light, wrap: f64) -> Vec<DVec3> {
    let scene = evaluator.scene();
    let properties = &scene.media[0].properties;
    let totals = DVec3::from_array(properties.total_reflectance(BoundaryFit::Published));
    let enters = diffuse_transmittance(properties.eta_inside_over_outside);
    let value = |(v, normal): (usize, &DVec3)| {
        let at = scene.mesh.local_mm[v].as_dvec3();
        let (to, arriving, distance) = match light {
            Light::Directional { from, irradiance } => (*from, *irradiance, f64::INFINITY),
            Light::Point { at_mm, intensity } => {
                let to = *at_mm - scene.mesh.origin_mm - at;
                (to.normalize(), *intensity / to.length_squared(), to.length())
            }
            _ => return DVec3::ZERO,
        };
        let mu = normal.dot(to);
        let high = (mu / 0.3).clamp(0.0, 1.0);
        let share = high * high * (3.0 - 2.0 * high);
        let mut ray = Ray::new(offset_origin(at.as_vec3(), normal.as_vec3()), to.as_vec3());
        ray.t_max = distance as f32;
        let seen = if evaluator.bvh().occluded(&ray, NO_TRIANGLE) { 1.0 - share } else { 1.0 };
        totals * arriving * (seen * enters * (mu + wrap).max(0.0) / ((1.0 + wrap) * (1.0 + wrap)))
    };
    normals.iter().enumerate().map(value).collect()
}

pub(crate) fn run(context: &Context) -> Result<String> {
    let (model, few) = if context.quick { ("bunny_3k", 1) } else { ("bunny_closed", MATERIALS.len()) };
    let mut text = String::new();
    for material in &MATERIALS[..few] {
        let scene = context.scene(model, material)?;
        let lights = six_lights(&scene)?;
        let wide = wide_lights(&scene)?;
        let mut truth = truth(context, &scene)?;
        let mut exact = |lights: &[(&str, Light)]| -> Result<Vec<Vec<DVec3>>> {
            lights.iter().map(|l| under(truth.as_mut(), &l.1)).collect()
        };
        let (expected, wide_expected) = (exact(&lights)?, exact(&wide)?);
        let walk = exitance(scene.domain(), &[lights[SHOWN].1.clone()], Effort::Noise(WALK_NOISE), 0, &Silent)?;
        let off_volume = |values: &[DVec3]| compare(&walk, values).map(|e| percent(e.worst()[0]));
        let (mut rows, mut wide_rows) = (Vec::new(), Vec::new());
        let mut sheet = vec![];
        let mut row = |name: &str, bytes: String, errors: &[f64], note: String| {
            let mean = (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt();
            let mut row = vec![name.to_owned(), bytes, percent(mean)];
            row.extend(errors.iter().map(|e| percent(*e)));
            row.push(note);
            context.say(&format!("{material}: {}", row.join(", ")));
            rows.push(row);
        };
        let none = || vec![String::new(); wide.len()];
        wide_rows.push([vec!["exact sums".to_owned()], none(), vec![off_volume(&expected[SHOWN])?]].concat());
        let factor = exposure(&picture(truth.as_ref(), &expected[SHOWN], SIDE)?);
        sheet.push(shown(&picture(truth.as_ref(), &expected[SHOWN], SIDE)?, factor));
        for (name, set) in VARIANTS {
            let asset = baked(&scene, set)?;
            let mut evaluator = opened(&asset)?;
            let mut errors = Vec::new();
            let mut of_volume = String::new();
            for (index, ((_, light), expected)) in lights.iter().zip(&expected).enumerate() {
                let found = under(evaluator.as_mut(), light)?;
                errors.push(rms(&scene, &found, expected));
                if index == SHOWN {
                    sheet.push(shown(&picture(evaluator.as_ref(), &found, SIDE)?, factor));
                    of_volume = off_volume(&found)?;
                }
            }
            let numbers = asset.sections.iter().find(|s| s.tag == translux_format::filtered_normals::tags::NUMBERS);
            let numbers = numbers.and_then(|s| s.record::<translux_format::filtered_normals::Numbers>().ok());
            let shape = numbers.map_or(String::new(), |n| format!("{:.2}, {:.2}", n.alpha, n.width));
            row(name, format!("{:.1}", bytes_per_vertex(&asset)?), &errors, shape);
            let mut cells = vec![name.to_owned()];
            for ((_, light), expected) in wide.iter().zip(&wide_expected) {
                cells.push(percent(rms(&scene, &under(evaluator.as_mut(), light)?, expected)));
            }
            cells.push(of_volume);
            context.say(&format!("{material}: {}", cells.join(", ")));
            wide_rows.push(cells);
        }
        let normals = normals(&scene);
        let of = |wrap: f64| -> Vec<f64> {
            let error = |(light, expected): (&(&str, Light), &Vec<DVec3>)| {
                rms(&scene, &wrapped(truth.as_ref(), &normals, &light.1, wrap), expected)
            };
            lights.iter().zip(&expected).map(error).collect()
        };
        let square = |errors: &Vec<f64>| errors.iter().map(|e| e * e).sum::<f64>();
        let all = WRAPS.map(|wrap| (wrap, of(wrap)));
        if let Some((wrap, errors)) = all.iter().min_by(|a, b| square(&a.1).total_cmp(&square(&b.1))) {
            row(RIVAL, "0".to_owned(), errors, format!("{wrap:.1}"));
            let of_volume = off_volume(&wrapped(truth.as_ref(), &normals, &lights[SHOWN].1, *wrap))?;
            wide_rows.push([vec![RIVAL.to_owned()], none(), vec![of_volume]].concat());
        }
        let path = format!("filtered_normals_{material}.png");
        translux::io::atomic::write(&context.pictures.join(&path), &sheet::png(SIDE, &[sheet])?)?;
        let mut head = vec!["", "bytes/vertex", "all six"];
        head.extend(lights.iter().map(|l| l.0));
        head.push("alpha, width; wrap");
        let mut wide_head = vec![""];
        wide_head.extend(wide.iter().map(|l| l.0));
        wide_head.push("off the volume");
        let vertices = scene.mesh.local_mm.len();
        text += &format!(
            "### {model}, {vertices} vertices, {material}\n\n![Exact sums, then the rows of the table, lit from the side]"
        );
        text += &format!("(pictures/{path})\n\n{}\n{}\n", table(&head, &rows), table(&wide_head, &wide_rows));
    }
    Ok(text)
}
