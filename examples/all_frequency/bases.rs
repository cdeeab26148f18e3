//! Error against bytes of each representation of the light: wavelets chosen in several ways, spherical harmonics.

use translux::error::Result;
use translux::light::Light;
use translux::measure::chart::draw::{Front, Point, Scatter, Unit, as_svg};
use translux::progress::Silent;
use translux::scene::Scene;

use crate::bench::{Expected, Map, Spread, Truth, bake, compared, half_in, open, percent, sun, under};
use crate::common::bench::{Context, Recipe, bytes_per_vertex, table};

/// Suns that errors are measured under.
const SUNS: usize = 12;
const FEW: usize = 3;

/// A curve: name, keys, and what the number of coefficients is.
type Curve = (&'static str, &'static [(&'static str, &'static str)], &'static [&'static str]);

const COUNTS: &[&str] = &["32", "64", "128", "256", "512", "1024"];
const SOME: &[&str] = &["32", "128", "512"];

const CURVES: [Curve; 5] = [
    (
        "haar, magnitude, texels (the paper's)",
        &[("basis", "haar"), ("selection", "magnitude"), ("transform", "texels")],
        COUNTS,
    ),
    ("haar, magnitude, solid angle", &[("basis", "haar"), ("selection", "magnitude")], SOME),
    ("haar, expected light, solid angle", &[("basis", "haar"), ("selection", "light")], COUNTS),
    ("haar, rate, solid angle", &[("basis", "haar"), ("selection", "rate")], SOME),
    ("harmonics of an order", &[], &["9", "25", "49", "100", "196", "324", "576"]),
];

/// Errors that harmonics are asked for.
const ASKED: [f64; 4] = [0.05, 0.02, 0.01, 0.005];

/// Lights with their truths.
struct Lit {
    environments: Vec<(Light, Expected)>,
    /// With half of the energy in each.
    suns: Vec<(Light, Expected)>,
}

impl Lit {
    fn new(context: &Context, truth: &mut Truth) -> Result<Self> {
        let mut environments = Vec::new();
        for (index, map) in Map::all(context)?.iter().enumerate() {
            // Turns that no choice of a bake saw.
            let light = map.light(101.0 * index as f64 + 20.0);
            let expected = truth.under(std::slice::from_ref(&light))?;
            environments.push((light, expected));
        }
        let constant = truth.under(&[Light::Constant { radiance: glam::DVec3::ONE }])?;
        let count = if context.quick { FEW } else { SUNS };
        let mut suns = Vec::new();
        for index in 0..count {
            let light = sun(index, count);
            let expected = truth.under(std::slice::from_ref(&light))?;
            suns.push((light, constant.plus(&expected, crate::bench::SPHERE)));
        }
        Ok(Self { environments, suns })
    }
}

/// Bytes, resident bytes, errors.
struct Measured {
    bytes: f64,
    resident: f64,
    environments: Spread,
    suns: Spread,
}

fn measure(scene: &Scene, truth: &Truth, lit: &Lit, recipe: &Recipe) -> Result<Measured> {
    let asset = bake(scene, recipe, &Silent)?;
    let bytes = bytes_per_vertex(&asset)?;
    let mut evaluator = open(asset)?;
    let resident = evaluator.cost().resident_bytes as f64 / scene.mesh.local_mm.len() as f64;
    let (mut environments, mut suns) = (Vec::new(), Vec::new());
    for (light, expected) in &lit.environments {
        environments.push(truth.error(&under(evaluator.as_mut(), std::slice::from_ref(light))?, expected));
    }
    for (light, expected) in &lit.suns {
        suns.push(truth.error(&under(evaluator.as_mut(), &half_in(light))?, expected));
    }
    Ok(Measured { bytes, resident, environments: Spread::of(&environments), suns: Spread::of(&suns) })
}

/// Two charts and a table.
pub(crate) fn run(context: &Context) -> Result<String> {
    let scene = context.scene(context.model(), "marble")?;
    let mut truth = Truth::new(context, &scene)?;
    let lit = Lit::new(context, &mut truth)?;
    context.say("bases: truth");
    let chart = |title: &str, y: &str| Scatter {
        title: format!("{title}, {}, marble", context.model()),
        axes: ["bytes for each vertex on disk".to_owned(), y.to_owned()],
        units: [Unit::BytesPerVertex, Unit::Percent],
        points: Vec::new(),
        lines: Vec::new(),
        front: Front::Left,
    };
    let mut charts = [
        chart("Error under environments", "relative RMS, mean over the maps"),
        chart("Error with half of the energy in a sun", "relative RMS, mean over the suns"),
    ];
    let mut rows = Vec::new();
    let mut enter = |series: &str, count: &str, recipe: &Recipe| -> Result<()> {
        let found = measure(&scene, &truth, &lit, recipe)?;
        for (chart, spread) in charts.iter_mut().zip([found.environments, found.suns]) {
            chart.points.push(Point { series: series.to_owned(), x: found.bytes, y: spread.mean });
        }
        let pair = |s: Spread| format!("{}, {}", percent(s.mean), percent(s.worst));
        context.say(&format!("bases: {series}, {count}: {:.1} bytes, {}", found.bytes, pair(found.suns)));
        rows.push(vec![
            series.to_owned(),
            count.to_owned(),
            format!("{:.1}", found.bytes),
            format!("{:.0}", found.resident),
            pair(found.environments),
            pair(found.suns),
        ]);
        Ok(())
    };
    for (series, keys, counts) in CURVES {
        for count in context.some(counts, 2) {
            let mut set = keys.to_vec();
            set.push(("coefficients", count));
            enter(series, count, &compared(context, &set))?;
        }
    }
    for max_rms in context.some(&ASKED, 2) {
        let recipe = Recipe { max_rms, ..compared(context, &[]) };
        enter("harmonics, as the error asks", &format!("{} asked", percent(max_rms)), &recipe)?;
    }
    let files = ["all_frequency_bases.svg", "all_frequency_bases_sun.svg"];
    let mut text = String::new();
    for (file, chart) in files.iter().zip(&charts) {
        translux::io::atomic::write(&context.pictures.join(file), as_svg(chart)?.as_bytes())?;
        text.push_str(&format!("![{}](pictures/{file})\n\n", chart.title));
    }
    let head = [
        "representation",
        "coefficients",
        "bytes/vertex",
        "resident",
        "environments: mean, worst",
        "half in a sun: mean, worst",
    ];
    Ok(format!("{text}{}", table(&head, &rows)))
}
