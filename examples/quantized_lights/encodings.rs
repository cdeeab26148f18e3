//! The paper's encodings beside each other: one byte a value, spherical harmonics, vectors; and what the comparison itself is worth.

use std::time::Instant;

use glam::DVec3;
use translux::asset::Asset;
use translux::error::Result;
use translux::light::quantised::interpolation::Scheme;
use translux::scene::Scene;

use crate::bench::{
    Context, LIGHTS, all_lit, bytes_per_vertex, directions_of, encoded, met, noted, open, same_samples, summary, table,
    thousandths, truth,
};
use crate::figure5;
use crate::views::{ImageRms, Pictures, Spread, Views};

/// Directions of the set under which nothing is interpolated.
const OF_THE_SET: [usize; 4] = [0, 37, 111, 163];

/// A scene with pictures of the truth under some lights.
pub(crate) struct Stand {
    pub(crate) scene: Scene,
    pub(crate) views: Views,
    pub(crate) lights: Vec<DVec3>,
    /// From the same samples as every encoding.
    pub(crate) truth: Vec<Pictures>,
}

impl Stand {
    pub(crate) fn new(context: &Context, model: &str, material: &str) -> Result<Self> {
        let scene = context.scene(model, material)?;
        let (views, lights) = (Views::new(&scene, context.views())?, context.lights());
        let all = all_lit(same_samples(&scene)?.as_mut(), &lights)?;
        let truth = all.iter().map(|b| views.reference(b)).collect();
        Ok(Self { scene, views, lights, truth })
    }

    /// Errors of an asset's pictures against some, one for each light.
    pub(crate) fn error(&self, asset: &Asset, interpolation: Option<Scheme>, reference: &[Pictures]) -> Result<Spread> {
        let all = all_lit(open(asset, interpolation)?.as_mut(), &self.lights)?;
        let errors: Vec<ImageRms> = all.iter().zip(reference).map(|(b, r)| self.views.worst(b, r)).collect();
        Ok(Spread::of(&errors))
    }

    /// Pictures of an asset under the lights.
    pub(crate) fn pictures(&self, asset: &Asset, interpolation: Option<Scheme>) -> Result<Vec<Pictures>> {
        let all = all_lit(open(asset, interpolation)?.as_mut(), &self.lights)?;
        Ok(all.iter().map(|b| self.views.reference(b)).collect())
    }

    pub(crate) fn per_vertex(&self, share: f64) -> usize {
        (share * self.scene.mesh.local_mm.len() as f64).round() as usize
    }
}

/// Median and worst: with background, covered pixels, with background and one exposure for all views.
pub(crate) fn cells(error: Spread) -> [String; 3] {
    let pair = |figure: fn(&ImageRms) -> f64| {
        format!("{}, {}", thousandths(figure(&error.median)), thousandths(figure(&error.worst)))
    };
    [pair(|e| e.with_background), pair(|e| e.covered), pair(|e| e.one_exposure)]
}

/// Sections 4 and 4.1 of the paper, and what the figures of this page are worth.
pub(crate) fn run(context: &Context) -> Result<String> {
    let stand = Stand::new(context, context.model(), "marble")?;
    let raw = encoded(&stand.scene, &[("encoding", "raw")])?;
    context.say("encodings: raw");
    let mut text = worth(context, &stand, &raw)?;
    text.push_str(&one_byte(context, &stand, &raw)?);
    text.push_str(&harmonics(context, &stand)?);
    text.push_str(&vectors(context)?);
    Ok(text)
}

/// What sampling and hierarchy leave where nothing is interpolated, and figure 5 from an asset.
fn worth(context: &Context, stand: &Stand, raw: &Asset) -> Result<String> {
    let set = directions_of(LIGHTS)?;
    let own: Vec<DVec3> = OF_THE_SET.iter().filter_map(|i| set.directions().get(*i).copied()).collect();
    let found = all_lit(open(raw, None)?.as_mut(), &own)?;
    let of = |truth: Vec<Vec<DVec3>>| {
        let errors = truth.iter().zip(&found).map(|(t, f)| stand.views.worst(f, &stand.views.reference(t)));
        errors.fold(ImageRms::default(), ImageRms::max)
    };
    let same = of(all_lit(same_samples(&stand.scene)?.as_mut(), &own)?);
    let finest = of(all_lit(truth(&stand.scene)?.as_mut(), &own)?);
    let first = stand.lights.first().copied().unwrap_or(DVec3::Z);
    let lit = all_lit(open(raw, None)?.as_mut(), &[first])?;
    let check = stand.truth.first().zip(lit.first()).map_or(f64::NAN, |(t, b)| stand.views.check(b, t));
    let mut rows = Vec::new();
    let linear = figure5::measure(&stand.scene, &[LIGHTS], &stand.lights, &stand.views)?;
    for scheme in Scheme::ALL {
        let [asset, ..] = cells(stand.error(raw, Some(scheme), &stand.truth)?);
        let through =
            linear.iter().find(|f| f.scheme == scheme).map_or([const { String::new() }; 3], |f| cells(f.error));
        rows.push(vec![scheme.name().to_owned(), asset, through[0].clone()]);
    }
    context.say("encodings: what the figures are worth");
    Ok(format!(
        "Under directions of the set itself, where nothing is interpolated, an asset of raw values has an image RMS of at most {} \
         ({} covered) against `two_pass` from the same samples, and {} ({}) against 262,144 samples, all in 1e-3: the floor of \
         the columns *with the interpolation* and *to the truth* below and of the next table (16,384 samples are fewer than the \
         triangles). Figure 5 and the columns *added* compare the same transport and have none. The image errors of this page differ from \
         `measure::image_error` of the same pictures by {check:.0e}.\n\n\
         Figure 5 at {LIGHTS} lights from an asset (`encoding=raw`), beside the way above through irradiance ({}, marble, with \
         background, 1e-3):\n\n{}\n",
        thousandths(same.with_background),
        thousandths(same.covered),
        thousandths(finest.with_background),
        thousandths(finest.covered),
        context.model(),
        table(&["interpolation", "from an asset: median, worst", "through irradiance: median, worst"], &rows)
    ))
}

fn one_byte(context: &Context, stand: &Stand, raw: &Asset) -> Result<String> {
    let plain = stand.pictures(raw, None)?;
    let mut rows = Vec::new();
    for encoding in ["uniform8", "lloyd8"] {
        let asset = encoded(&stand.scene, &[("encoding", encoding)])?;
        let [added, added_covered, one] = cells(stand.error(&asset, None, &plain)?);
        let [whole, ..] = cells(stand.error(&asset, None, &stand.truth)?);
        let decibels = noted(&asset, "dB").map_or("?".to_owned(), |db| format!("{db:.2}"));
        rows.push(vec![
            encoding.to_owned(),
            decibels,
            format!("{:.0}", bytes_per_vertex(&asset)?),
            added,
            added_covered,
            one,
            whole,
        ]);
        context.say(&format!("encodings: {encoding}"));
    }
    let of = |name: &str| rows.iter().find(|row| row[0] == name).map_or(["?"; 2], |row| [&row[1], &row[3]]);
    let decibels = |name: &str| of(name)[0].parse().unwrap_or(0.0);
    let line = summary(
        "one byte a value: SNR; image RMS, 1e-3: median, worst",
        "50.99 dB; 0.88",
        ">= 51 dB",
        &format!(
            "`lloyd8` {} dB; {}; `uniform8` {} dB; {}; {}",
            of("lloyd8")[0],
            of("lloyd8")[1],
            of("uniform8")[0],
            of("uniform8")[1],
            met(decibels("lloyd8") >= 51.0)
        ),
    );
    rows.push(["the paper, grey teapot", "50.99", "200", "0.88", "", "", ""].map(str::to_owned).to_vec());
    let head = [
        "encoding",
        "SNR, dB",
        "bytes/vertex",
        "added, with background",
        "covered",
        "one exposure",
        "with the interpolation",
    ];
    Ok(format!("{line}\n### One byte a value\n\n@one-byte@\n\n{}\n", table(&head, &rows)))
}

fn harmonics(context: &Context, stand: &Stand) -> Result<String> {
    let mut rows = Vec::new();
    for order in context.some(&["1", "2", "3", "4", "5", "6", "7", "10"], 3) {
        let asset = encoded(&stand.scene, &[("encoding", "sh"), ("order", order)])?;
        let [whole, covered, one] = cells(stand.error(&asset, None, &stand.truth)?);
        let undershoot = noted(&asset, "% of full scale").map_or("?".to_owned(), |u| format!("{u:.1} %"));
        rows.push(vec![order.to_owned(), whole, covered, one, format!("{:.1}", bytes_per_vertex(&asset)?), undershoot]);
        context.say(&format!("encodings: sh {order}"));
    }
    let head = ["n", "image RMS", "covered", "one exposure", "bytes/vertex", "undershoot, of full scale"];
    Ok(format!("\n### Spherical harmonics alone (figures 6 and 7)\n\n@harmonics@\n\n{}\n", table(&head, &rows)))
}

/// The vector integral against the scalar one, on the paper's model.
fn vectors(context: &Context) -> Result<String> {
    let model = if context.quick { "bunny_3k" } else { "horse" };
    let stand = Stand::new(context, model, "marble")?;
    let scalar = encoded(&stand.scene, &[("encoding", "raw")])?;
    let start = Instant::now();
    let vector = encoded(&stand.scene, &[("encoding", "raw"), ("integral", "vector")])?;
    context.say(&format!("encodings: vectors in {:.0} s", start.elapsed().as_secs_f64()));
    let mut rows = Vec::new();
    for scheme in [Scheme::Nearest4, Scheme::Rbf] {
        let plain = stand.pictures(&scalar, Some(scheme))?;
        let [apart, covered, one] = cells(stand.error(&vector, Some(scheme), &plain)?);
        let [q, ..] = cells(stand.error(&scalar, Some(scheme), &stand.truth)?);
        let [v, ..] = cells(stand.error(&vector, Some(scheme), &stand.truth)?);
        rows.push(vec![scheme.name().to_owned(), apart, covered, one, q, v]);
    }
    context.say("encodings: vectors");
    let line = rows.first().zip(rows.last()).map_or(String::new(), |(nearest, smooth)| {
        let measured = format!("`nearest4` {} ({} with one exposure); `rbf` {}", nearest[1], nearest[3], smooth[1]);
        summary(&format!("Q against q, image RMS, {model}, 1e-3: median, worst"), "5.26", "measured", &measured)
    });
    let head = ["interpolation", "Q to q", "covered", "one exposure", "q to the truth", "Q to the truth"];
    Ok(format!("{line}\n### Vectors Q against scalars q\n\n@vectors@\n\n{}\n", table(&head, &rows)))
}
