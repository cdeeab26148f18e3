//! What was measured of each form of the coding: the chart and the tables.

use translux::error::{Error, Result};
use translux::measure::chart::draw::{Front, Point, Scatter, Unit, as_svg};

use super::clusters::Shape;
use super::{ALONE_DIRECTIONS, ALONE_MEMBERS, ASKED};
use crate::bench::percent;
use crate::common::bench::{Context, table};

/// The chart, the forms that it has, and the directions of its clusters alone.
const FILE: &str = "all_frequency_coding.svg";
const CHARTED: [&str; 9] =
    [FIXED, ENTROPY, COMPONENTS, CLUSTERS, PREDICTED, REFERENCES, REFERENCE_CLUSTERS, DEFAULT, CLOSER];
const TABLE: [&str; 12] = [
    FIXED,
    ENTROPY,
    FIXED_COMPONENTS,
    COMPONENTS,
    CLUSTERS,
    PREDICTED,
    REFERENCES,
    REFERENCE_CLUSTERS,
    DEFAULT,
    BAKED,
    COARSER,
    CLOSER,
];
const CHARTED_DIRECTIONS: usize = 4;

/// What forms are called.
pub(super) const FIXED: &str = "every vertex: harmonics, fixed width";
pub(super) const ENTROPY: &str = "every vertex: harmonics, entropy-coded";
pub(super) const FIXED_COMPONENTS: &str = "every vertex: components, fixed width";
pub(super) const COMPONENTS: &str = "every vertex: components, entropy-coded";
pub(super) const PREDICTED: &str = "every vertex: components, predicted";
pub(super) const REFERENCES: &str = "reference points, not predicted";
pub(super) const DEFAULT: &str = "reference points, predicted (the default)";
pub(super) const CLUSTERS: &str = "every vertex: clusters and differences";
pub(super) const COARSER: &str = "reference points, predicted, twice the step";
pub(super) const CLOSER: &str = "reference points 0.7 as far apart, predicted, twice the step";
pub(super) const BAKED: &str = "the same, an asset as baked";
pub(super) const REFERENCE_CLUSTERS: &str = "reference points: clusters and differences";

pub(super) fn alone_name(directions: usize) -> String {
    format!("every vertex: clustered PCA, {directions} direction{}", if directions == 1 { "" } else { "s" })
}

/// What a form takes and loses.
#[derive(Clone, Copy)]
pub(super) struct Measured {
    /// For each vertex.
    pub(super) bytes: f64,
    /// Coefficients that a light is multiplied with, for each vertex.
    pub(super) coefficients: f64,
    /// Against what is not coded, mean over environments and over suns with half of the energy.
    pub(super) environments: f64,
    pub(super) suns: f64,
    /// All of it under environments, against the truth.
    pub(super) whole: f64,
}

/// A form's points, one for each error asked.
pub(super) struct Curve {
    pub(super) name: String,
    pub(super) points: Vec<Measured>,
}

/// All of them.
#[derive(Default)]
pub(super) struct Curves(Vec<Curve>);

impl Curves {
    pub(super) fn add(&mut self, context: &Context, name: &str, what: &str, found: Measured) {
        let Measured { bytes, environments, suns, whole, .. } = found;
        let errors = [environments, suns, whole].map(percent).join(", ");
        context.say(&format!("coding: {name}, {what}: {bytes:.2} bytes, {errors}"));
        match self.0.iter_mut().find(|curve| curve.name == name) {
            Some(curve) => curve.points.push(found),
            None => self.0.push(Curve { name: name.to_owned(), points: vec![found] }),
        }
    }
}

impl Curves {
    pub(super) fn find(&self, name: &str) -> Result<&Curve> {
        let found = self.0.iter().find(|curve| curve.name == name);
        found.ok_or_else(|| Error::runtime(format!("nothing was measured of `{name}`")))
    }

    /// The chart and the tables.
    pub(super) fn page(mut self, context: &Context, shapes: &[(&str, Option<Shape>)]) -> Result<String> {
        // The default's own error is the first that was measured.
        let error = self.find(DEFAULT)?.points[0].environments;
        self.0.iter_mut().for_each(Curve::sort);
        let place = |curve: &Curve| TABLE.iter().position(|name| *name == curve.name).unwrap_or(TABLE.len());
        self.0.sort_by_key(place);
        let charted: Vec<String> =
            CHARTED.iter().map(|name| (*name).to_owned()).chain([alone_name(CHARTED_DIRECTIONS)]).collect();
        let mut points = Vec::new();
        for name in &charted {
            let of_curve = |p: &Measured| Point { series: name.clone(), x: p.bytes, y: p.environments };
            points.extend(self.find(name)?.points.iter().map(of_curve));
        }
        let chart = Scatter {
            title: format!("What each step of the coding saves, {}, marble", context.model()),
            axes: ["bytes for each vertex on disk", "relative RMS that it adds, mean over the maps"].map(str::to_owned),
            units: [Unit::BytesPerVertex, Unit::Percent],
            points,
            lines: Vec::new(),
            front: Front::Left,
        };
        translux::io::atomic::write(&context.pictures.join(FILE), as_svg(&chart)?.as_bytes())?;
        let default = self.find(DEFAULT)?.at(error);
        let of_curve = |curve: &Curve| {
            let bytes = curve.at(error);
            let times = bytes.zip(default).map(|(bytes, default)| format!("{:.2}", bytes / default));
            let shape = shapes.iter().find(|(name, _)| *name == curve.name).and_then(|(_, shape)| *shape);
            let shape = shape.map_or(String::new(), |s| format!(" ({})", s.words()));
            let mut row = vec![format!("{}{shape}", curve.name)];
            row.extend(curve.cells());
            row.push(curve.points.last().map_or(String::new(), |p| format!("{:.0}", p.coefficients)));
            row.extend([bytes.map_or("-".to_owned(), |b| format!("{b:.1}")), times.unwrap_or_else(|| "-".to_owned())]);
            row
        };
        let (alone, forms): (Vec<&Curve>, Vec<&Curve>) =
            self.0.iter().partition(|c| ALONE_DIRECTIONS.iter().any(|&d| alone_name(d) == c.name));
        let at = [
            "coefficients read a vertex".to_owned(),
            format!("bytes at {}", percent(error)),
            "of the default's".to_owned(),
        ];
        let head = |first: &str, points: Vec<String>| -> Vec<String> {
            [first.to_owned()].into_iter().chain(points).chain(at.clone()).collect()
        };
        let mut asked = context.some(&ASKED, 2);
        asked.sort_unstable_by(|a, b| b.total_cmp(a));
        let asked = asked.iter().map(|rms| format!("{} asked", percent(*rms))).collect();
        let members = context.some(&ALONE_MEMBERS, 2).iter().map(|m| format!("{m} vertices a cluster")).collect();
        let text = |head: Vec<String>, curves: &[&Curve]| {
            let rows: Vec<Vec<String>> = curves.iter().map(|curve| of_curve(curve)).collect();
            table(&head.iter().map(String::as_str).collect::<Vec<_>>(), &rows)
        };
        let forms = text(head("bytes/vertex: RMS added, RMS in all", asked), &forms);
        let alone = text(head("the same of clusters alone", members), &alone);
        Ok(format!("![{}](pictures/{FILE})\n\n{forms}\n{alone}\n@coding@\n", chart.title))
    }
}

impl Curve {
    /// Errors from the largest to the smallest.
    pub(super) fn sort(&mut self) {
        self.points.sort_by(|a, b| b.environments.total_cmp(&a.environments));
    }

    /// Bytes and errors of every point.
    pub(super) fn cells(&self) -> Vec<String> {
        let cell = |p: &Measured| format!("{:.1}: {}, {}", p.bytes, percent(p.environments), percent(p.whole));
        self.points.iter().map(cell).collect()
    }

    /// Bytes at an error, between points on logarithmic axes; none where the curve does not reach it.
    pub(super) fn at(&self, error: f64) -> Option<f64> {
        let pair = self.points.windows(2).find(|p| (p[0].environments - error) * (p[1].environments - error) <= 0.0)?;
        let [from, to] = [pair[0], pair[1]].map(|p| (p.environments.ln(), p.bytes.ln()));
        let share = if to.0 == from.0 { 0.0 } else { (error.ln() - from.0) / (to.0 - from.0) };
        Some((from.1 + share * (to.1 - from.1)).exp())
    }
}
