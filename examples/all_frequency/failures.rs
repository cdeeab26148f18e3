//! Where the method fails: suns between texels, contact shadows, strongly forward phase functions, thin media, open meshes.

use glam::DVec3;
use translux::error::Result;
use translux::evaluate::Evaluator;
use translux::geometry::mesh::Scale;
use translux::geometry::parts::PartsRule;
use translux::light::Light;
use translux::medium::material::Medium;
use translux::scene::Scene;

use crate::bench::{Found, Map, Spread, Truth, baked, half_in, percent, texels, under};
use crate::common::bench::{Context, parallel, properties, scene_of, table};
use crate::figure6::{Few, figures};
use crate::meshes::{Cap, ball_above_plate, half_ball};

/// Suns of a kind.
const SUNS: usize = 12;
const FEW: usize = 3;

/// Terms of strongly forward phase functions.
const FORWARD_TERMS: [usize; 5] = [4, 16, 36, 64, 144];

/// Many coefficients, so that the texels are what is left.
const MANY_32: &[(&str, &str)] = &[("basis", "haar"), ("coefficients", "512")];
const MANY_64: &[(&str, &str)] = &[("basis", "haar"), ("coefficients", "512"), ("cube", "64")];
const PAPER: &[(&str, &str)] = &[("basis", "haar"), ("selection", "magnitude"), ("transform", "texels")];
const FINE_HARMONICS: &[(&str, &str)] = &[("cube", "64")];

/// What is compared: a name and keys.
const FORMS: [(&str, &[(&str, &str)]); 4] = [
    ("haar, 128, the paper's", PAPER),
    ("haar, 6 x 32 x 32, 512 coefficients", MANY_32),
    ("haar, 6 x 64 x 64, 512 coefficients", MANY_64),
    ("harmonics, the default", &[]),
];

/// Suns at centres of texels and between them.
pub(crate) fn between_texels(context: &Context) -> Result<String> {
    let scene = context.scene(context.model(), "marble")?;
    let mut truth = Truth::new(context, &scene)?;
    let count = if context.quick { FEW } else { SUNS };
    // The same texels of 6 x 32 x 32 for all: their centres are corners of 6 x 64 x 64, and a quarter aside are centres of that.
    let places = [
        ("at texel centres of 6 x 32 x 32", texels(32, count, 0.0)),
        ("of 6 x 64 x 64", texels(32, count, 0.25)),
        ("at texel corners of both", texels(32, count, 0.5)),
    ];
    let mut lit = Vec::new();
    for (name, directions) in &places {
        let mut own = Vec::new();
        for from in directions {
            let light = parallel(*from);
            own.push((light.clone(), truth.under(&[light])?));
        }
        lit.push((*name, own));
    }
    let mut rows = Vec::new();
    for (name, set) in context.some(&FORMS, 2) {
        let mut evaluator = baked(context, &scene, set)?;
        let mut cells = vec![name.to_owned()];
        for (_, own) in &lit {
            let mut found = Vec::new();
            for (light, expected) in own {
                found.push(truth.error(&under(evaluator.as_mut(), std::slice::from_ref(light))?, expected));
            }
            let spread = Spread::of(&found);
            cells.push(format!("{}, {}", percent(spread.mean), percent(spread.worst)));
        }
        rows.push(cells);
        context.say(&format!("failures: suns, {name}"));
    }
    let head: Vec<&str> = ["a sun alone: mean, worst"].into_iter().chain(places.iter().map(|p| p.0)).collect();
    Ok(format!("@between@\n\n{}", table(&head, &rows)))
}

/// Radius of the ball, its distance from the plate, and how far from its foot the shadow counts as one of contact, mm.
const BALL_MM: f64 = 5.0;
const GAP_MM: f64 = 0.3;
const CONTACT_MM: f64 = 5.0;

/// A ball just above a plate.
pub(crate) fn contact(context: &Context) -> Result<String> {
    let divisions = if context.quick { 24 } else { 64 };
    let medium = Medium { name: "marble".to_owned(), properties: properties("marble")? };
    let source = ball_above_plate(BALL_MM, GAP_MM, divisions);
    let scene = scene_of(source, Scale::MillimetresPerUnit(1.0), PartsRule::Separate, medium)?;
    let mut truth = Truth::new(context, &scene)?;
    let lights = [
        ("a sun from 45 degrees", vec![parallel(DVec3::new(1.0, 1.0, 0.35).normalize())]),
        ("half in that sun", half_in(&parallel(DVec3::new(1.0, 1.0, 0.35).normalize()))),
        ("Grace cathedral", vec![Map::load(context, "debevec_grace_256.hdr")?.light(40.0)]),
    ];
    let near: Vec<bool> = (0..scene.mesh.local_mm.len() as u32)
        .map(|v| {
            let p = scene.mesh.position_mm(v);
            p.y.abs() < 1e-3 && p.x.hypot(p.z) < CONTACT_MM
        })
        .collect();
    let mut expected = Vec::new();
    for (_, lights) in &lights {
        expected.push(truth.under(lights)?);
    }
    let mut rows = Vec::new();
    let forms = FORMS.into_iter().chain([("harmonics, 6 x 64 x 64", FINE_HARMONICS)]);
    for (name, set) in forms.take(if context.quick { 2 } else { 5 }) {
        let mut evaluator = baked(context, &scene, set)?;
        let mut cells = vec![name.to_owned()];
        for ((_, lights), expected) in lights.iter().zip(&expected) {
            let values = under(evaluator.as_mut(), lights)?;
            let whole = truth.error(&values, expected);
            let contact = truth.error_where(&values, expected, |v| near.get(v).copied().unwrap_or(false));
            cells.push(format!("{}, {}", percent(whole.rms), percent(contact.rms)));
        }
        rows.push(cells);
        context.say(&format!("failures: contact, {name}"));
    }
    let head: Vec<&str> = ["all, near the contact"].into_iter().chain(lights.iter().map(|l| l.0)).collect();
    Ok(format!(
        "A ball of radius {BALL_MM} mm, {GAP_MM} mm above a plate, marble; the second number is at the {} vertices of the \
         plate within {CONTACT_MM} mm of its foot.\n\n@contact@\n\n{}",
        near.iter().filter(|n| **n).count(),
        table(&head, &rows)
    ))
}

/// Terms that a strongly forward phase function would need.
pub(crate) fn forward(context: &Context) -> Result<String> {
    let mut rows = Vec::new();
    for g in [0.7, 0.9] {
        let mut cells = vec![g.to_string()];
        for terms in FORWARD_TERMS {
            let found = figures(g, &Few::legendre(g, terms));
            cells.push(format!("{}, {}", percent(found.rms), percent(found.least)));
        }
        rows.push(cells);
    }
    context.say("failures: forward phase functions");
    let terms = FORWARD_TERMS.map(|terms| format!("K = {terms}"));
    let head: Vec<&str> = ["g: RMS, least value"].into_iter().chain(terms.iter().map(String::as_str)).collect();
    Ok(format!("@forward@\n\n{}", table(&head, &rows)))
}

/// Half a ball, with and without its cap.
pub(crate) fn open_mesh(context: &Context) -> Result<String> {
    let (rings, segments) = if context.quick { (12, 36) } else { (48, 144) };
    let mut rows = Vec::new();
    for material in ["marble", "skin1"] {
        let scene = |cap: Cap| -> Result<Scene> {
            let medium = Medium { name: material.to_owned(), properties: properties(material)? };
            let source = half_ball(10.0, rings, segments, cap);
            scene_of(source, Scale::MillimetresPerUnit(1.0), PartsRule::Auto, medium)
        };
        let (closed, open) = (scene(Cap::There)?, scene(Cap::Missing)?);
        let shell = open.mesh.local_mm.len();
        let mut truth = Truth::new(context, &closed)?;
        let mut evaluators: [Box<dyn Evaluator>; 2] = [baked(context, &closed, &[])?, baked(context, &open, &[])?];
        let lights = [
            ("constant", Light::Constant { radiance: DVec3::ONE }),
            ("a sun from above", parallel(DVec3::Y)),
            ("a sun from below", parallel(DVec3::new(0.3, -1.0, 0.1).normalize())),
        ];
        for (name, light) in lights {
            let light = [light];
            let expected = truth.under(&light)?;
            let mut cells = vec![material.to_owned(), name.to_owned()];
            for evaluator in &mut evaluators {
                let values = under(evaluator.as_mut(), &light)?;
                // The shell's vertices come first in both.
                let Found { rms, .. } = truth.error_where(&values, &expected, |v| v < shell);
                cells.push(percent(rms));
            }
            rows.push(cells);
        }
        context.say(&format!("failures: open mesh, {material}"));
    }
    let head = ["material", "light", "closed mesh", "without the disc"];
    Ok(format!("@open@\n\n{}", table(&head, &rows)))
}
