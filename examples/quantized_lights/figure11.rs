//! The paper's Figure 11: close-ups of a shadow boundary under each encoding, and where they differ from the truth.

use glam::DVec3;
use rayon::prelude::*;
use translux::asset::Asset;
use translux::error::Result;
use translux::evaluate::Evaluator;
use translux::math::srgb::linear_from_srgb;
use translux::measure::image_error::{ImageError, image_error};
use translux::methods;
use translux::progress::Silent;
use translux::render::background::Background;
use translux::render::camera::{Camera, Resolution};
use translux::render::film::Exposure;
use translux::render::frame::{Frame, RenderSettings, Specular, render};

use crate::bench::{Context, Recipe, bake, bytes_per_vertex, lit, open, table, thousandths, truth};
use crate::common::sheet;
use crate::hao::{METHOD, registry};

/// Side of a close-up in pixels.
const SIDE: usize = 300;

/// From where the light and the eye come, and what is looked at, in diagonals from the middle.
const LIGHT: DVec3 = DVec3::new(-0.75, 0.6, 0.28);
const EYE: DVec3 = DVec3::new(-0.1, 0.25, 1.0);
const LOOK: DVec3 = DVec3::new(-0.12, 0.13, 0.1);
const FOV_DEGREES: f64 = 13.0;

/// How far from the middle of the model the eye is, in diagonals.
const DISTANCE: f64 = 2.0;

/// Differences are shown so many times larger.
const TIMES: f32 = 8.0;

/// The error that the components are baked for.
const COMPONENTS_RMS: f64 = 0.02;

/// Samples of the paper's encodings.
const SAMPLES: usize = 65_536;

/// The figure and its table.
pub(crate) fn run(context: &Context) -> Result<String> {
    let scene = context.scene(context.model(), "marble")?;
    let vertices = scene.mesh.local_mm.len();
    let references = |share: f64| ((share * vertices as f64) as usize).to_string();
    let (few, some) = (references(0.01), references(0.03));
    let paper = |count| {
        [
            ("encoding", "reference-points"),
            ("order", "3"),
            ("choice", "geometry"),
            ("weights", "barycentric"),
            ("references", count),
        ]
    };
    let paper_bake = |set: &[(&str, &str)]| {
        let all: Vec<(&str, &str)> = set.iter().copied().chain([("lights", "200")]).collect();
        bake(registry().method(METHOD)?, &scene, &Recipe { samples: Some(SAMPLES), max_rms: COMPONENTS_RMS, set: &all })
    };
    let columns: Vec<(String, Asset)> = vec![
        ("200 lights, raw".to_owned(), paper_bake(&[("encoding", "raw")])?),
        ("n = 7 alone".to_owned(), paper_bake(&[("encoding", "sh"), ("order", "7")])?),
        (format!("{few} reference points, n = 3"), paper_bake(&paper(&few))?),
        (format!("{some} reference points, n = 3"), paper_bake(&paper(&some))?),
        (
            "components, 2 % asked".to_owned(),
            bake(
                methods::built_in().method("quantized_lights")?,
                &scene,
                &Recipe { samples: None, max_rms: COMPONENTS_RMS, set: &[] },
            )?,
        ),
    ];
    context.say("figure 11: baked");
    let mut truth = truth(&scene)?;
    let reference = close_up(truth.as_mut())?;
    let factor = Exposure::Auto.factor(&reference) as f32;
    let colours = |frame: &Frame| -> Vec<[f32; 3]> { frame.pixels.iter().map(|p| p.diffuse).collect() };
    let covered: Vec<bool> = reference.pixels.iter().map(|p| p.coverage > 0.0).collect();
    let expected = colours(&reference);
    let exposed = |rgb: &[[f32; 3]]| rgb.iter().map(|p| p.map(|v| v * factor)).collect::<Vec<_>>();
    let (mut shown, mut differences) = (vec![exposed(&expected)], vec![vec![[0.0; 3]; SIDE * SIDE]]);
    let mut rows = Vec::new();
    for (name, asset) in &columns {
        let picture = colours(&close_up(open(asset, None)?.as_mut())?);
        let ImageError { rms, worst, .. } = image_error(&picture, &expected, &covered);
        let bytes = format!("{:.1}", bytes_per_vertex(asset)?);
        rows.push(vec![name.clone(), bytes, thousandths(rms), format!("{:.2}", worst)]);
        // Codes of the picture are in proportion to the difference.
        let code = |a: f32, b: f32| linear_from_srgb(f64::from((TIMES * factor * (a - b).abs()).min(1.0))) as f32;
        let difference = |(a, b): (&[f32; 3], &[f32; 3])| std::array::from_fn(|c| code(a[c], b[c]));
        differences.push(picture.par_iter().zip(&expected).map(difference).collect());
        shown.push(exposed(&picture));
    }
    let file = "quantized_figure11.png";
    translux::io::atomic::write(&context.pictures.join(file), &sheet::png(SIDE, &[shown, differences])?)?;
    let head = ["picture", "bytes/vertex", "image RMS, covered", "largest difference, of full scale"];
    let names: Vec<&str> = columns.iter().map(|(name, _)| name.as_str()).collect();
    Ok(format!(
        "![Close-ups](pictures/quantized_figure11.jpg)\n\nFrom the left: the truth (`two_pass` from 262,144 samples), {}. Below: \
         the difference, {TIMES} times.\n\n{}",
        names.join("; "),
        table(&head, &rows)
    ))
}

/// The close-up, diffuse radiance alone.
fn close_up(evaluator: &mut dyn Evaluator) -> Result<Frame> {
    let radiosity = lit(evaluator, LIGHT.normalize())?;
    let mesh = &evaluator.scene().mesh;
    let [low, high] = mesh.bounds_local_mm();
    let look_mm = 0.5 * (low + high) + mesh.origin_mm + LOOK * mesh.diagonal_mm();
    let at_mm = look_mm + EYE.normalize() * DISTANCE * mesh.diagonal_mm();
    let camera = Camera::new(at_mm, look_mm, DVec3::Y, FOV_DEGREES)?;
    let settings = RenderSettings {
        background: Background::None,
        specular: Specular::Off,
        ..RenderSettings::new(camera, Resolution::new(SIDE, SIDE)?)
    };
    render(&*evaluator, &radiosity, &[], &settings, &Silent)
}
