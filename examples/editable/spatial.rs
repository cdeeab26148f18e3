//! Compression in space: the columns of the transport (one basis function, one Haar coefficient of the samples, over all vertices)
//! as they are, by CDF 9/7 over a geometry image, by lifting on nested points, and at fewer points with kriging.

#[path = "spatial_columns.rs"]
mod columns;

use glam::DVec3;
use translux::error::Result;
use translux::geometry::bvh::Bvh;
use translux::geometry::mesh::Scale;
use translux::geometry::parts::PartsRule;
use translux::geometry::shapes::bumpy_head;
use translux::geometry::source::SourceModel;
use translux::measure::chart::draw::{Front, Point, Scatter, Unit, as_svg};
use translux::medium::fresnel::BoundaryFit;
use translux::medium::material::Medium;
use translux::medium::profile::Profile;
use translux::medium::profile_basis::{BasisSettings, Family, ProfileBasis};
use translux::scene::Scene;

use self::columns::{Basis, Columns, Found, Lifted, Spatial, Transport};
use crate::bench::percent;
use crate::common::bench::{Context, SIZE_MM, properties, scene_of, table};
use crate::geometry_image;

/// Samples, and vertices along an edge of a geometry image.
const SAMPLES: usize = 4608;
const SIDE: usize = 48;
const QUICK: (usize, usize) = (1152, 24);

const MATERIAL: &str = "marble";

/// Near-field radius and distances of points, in sample spacings.
const SPLIT: f64 = 6.0;
const POINTS: [(f64, Lifted); 4] = [(3.0, Lifted::No), (4.0, Lifted::No), (3.0, Lifted::Yes), (4.0, Lifted::Yes)];

/// Error that columns are compared at.
const EQUAL: f64 = 0.01;

/// Thresholds of the curves, over that of the first function at the equal error.
const CURVE: [f64; 5] = [4.0, 2.0, 1.0, 0.5, 0.25];

/// What the paper keeps of the energy, and what an error below 1 % takes.
const ENERGIES: [f64; 3] = [0.95, 0.98, 0.999];

fn model(context: &Context, name: &str, side: usize) -> Result<Scene> {
    let medium = || Ok(Medium { name: MATERIAL.to_owned(), properties: properties(MATERIAL)? });
    let image = |scene: Scene| -> SourceModel { geometry_image::of_mesh(&scene.mesh, &Bvh::new(&scene.mesh), side) };
    let source = match name {
        "bumpy head" => image(scene_of(bumpy_head(1.0, 5), Scale::DiagonalMm(SIZE_MM), PartsRule::Auto, medium()?)?),
        "beethoven" => image(context.scene(name, MATERIAL)?),
        other => return context.scene(other, MATERIAL),
    };
    scene_of(source, Scale::DiagonalMm(SIZE_MM), PartsRule::Joined, medium()?)
}

/// Bytes for each vertex at 4 bytes a coefficient, and by the entropy of the rounded ones.
fn bytes(found: &Found) -> String {
    format!("{:.0} ({:.0})", 4.0 * found.kept, found.entropy_bytes)
}

/// Kernels of one width each: what the transform gains depends on it.
fn kernels(vertex_mm: f64) -> Result<Vec<(String, Basis)>> {
    let mut all: Vec<(String, Basis)> = Vec::new();
    for widths in [0.5, 1.0, 2.0, 4.0, 8.0] {
        let sigma = widths * vertex_mm;
        let gauss = move |r2: f64| (-0.5 * r2 / (sigma * sigma)).exp() / (sigma * sigma);
        all.push((format!("Gaussian, sigma {widths} vertex spacings"), Box::new(gauss)));
    }
    for (name, channel) in [("marble", 1), ("skin1", 0)] {
        let dipole = properties(name)?.dipoles(BoundaryFit::Published)[channel];
        all.push((
            format!("whole dipole, {name}, {}", ["R", "G", "B"][channel]),
            Box::new(move |r2: f64| dipole.reflectance(r2.sqrt())),
        ));
    }
    Ok(all)
}

/// One model: a row for each function, rows of the paper's energies, and the curves of all functions together.
struct Measured {
    functions: Vec<Vec<String>>,
    energies: Vec<Vec<String>>,
    curves: Vec<Vec<String>>,
    points: Vec<Point>,
}

/// Sums over functions at each threshold of a curve.
#[derive(Clone, Default)]
struct Sum {
    kept: f64,
    entropy_bytes: f64,
    radiosity: Vec<Vec<f64>>,
}

impl Sum {
    fn add(&mut self, found: &Found, factor: f64) {
        self.kept += found.kept;
        self.entropy_bytes += found.entropy_bytes;
        self.radiosity.resize(found.values.len(), Vec::new());
        for (sum, values) in self.radiosity.iter_mut().zip(&found.values) {
            sum.resize(values.len(), 0.0);
            sum.iter_mut().zip(values).for_each(|(sum, v)| *sum += factor * v);
        }
    }
}

fn measure(context: &Context, name: &str) -> Result<Measured> {
    let (samples, side) = if context.quick { QUICK } else { (SAMPLES, SIDE) };
    let scene = model(context, name, side)?;
    let is_image = scene.mesh.local_mm.len() == side * side;
    let transport = Transport::new(&scene, samples)?;
    let (vertices, vertex_mm, sample_mm) = (transport.vertices(), transport.vertex_mm(), transport.sample_mm());
    context.say(&format!("spatial: {name}, {vertices} vertices {vertex_mm:.2} mm apart, {samples} samples"));
    let mut spatial = vec![Spatial::none(&transport)];
    if is_image {
        spatial.push(Spatial::cdf97(&transport, side));
    }
    spatial.push(Spatial::lifting(&transport));
    spatial.extend(POINTS.map(|(spacings, lifted)| Spatial::points(&transport, spacings, lifted)));

    let split_mm = SPLIT * sample_mm;
    let basis = ProfileBasis::new(&BasisSettings {
        split_mm,
        reach_mm: scene.mesh.diagonal_mm(),
        family: Family::Transported,
        terms: None,
        error: 0.15 * EQUAL,
    });
    let (functions, spread) = (basis.table(), basis.spread());
    let dipole = properties(MATERIAL)?.dipoles(BoundaryFit::Published)[1];
    let material = basis.project(&dipole).coefficients;
    let terms = context.some(&(0..basis.terms()).collect::<Vec<_>>(), 2);
    let mut result = Measured { functions: Vec::new(), energies: Vec::new(), curves: Vec::new(), points: Vec::new() };
    let mut sums = vec![vec![Sum::default(); CURVE.len()]; spatial.len()];
    let mut exact = Sum::default();
    let mut first_threshold = None;

    let far = terms.iter().map(|&k| {
        let functions = functions.clone();
        let of_r2 = move |r2: f64| {
            let mut values = [0.0f32; 16];
            functions.evaluate(r2 as f32, &mut values);
            f64::from(values[k])
        };
        (format!("far part, function {}", k + 1), Box::new(of_r2) as Basis, Some(k))
    });
    let widths = kernels(vertex_mm)?;
    let widths = widths.into_iter().take(if context.quick { 2 } else { usize::MAX }).map(|(n, f)| (n, f, None));
    for (label, function, term) in far.chain(widths) {
        let columns = Columns::new(&transport, &function);
        let scale = term.map_or(1.0, |k| spread[k]);
        let whole = columns.exact(&transport);
        let mut row = vec![label.clone()];
        let mut least: Option<(f64, &str)> = None;
        for (which, spatial) in spatial.iter().enumerate() {
            let transformed = columns.transformed(spatial);
            let found = transformed.at_error(&transport, spatial, &whole, EQUAL);
            row.push(found.as_ref().map_or_else(|| "-".to_owned(), |(_, found)| bytes(found)));
            if let Some((_, found)) = &found
                && least.is_none_or(|(bytes, _)| found.entropy_bytes < bytes)
            {
                least = Some((found.entropy_bytes, spatial.name()));
            }
            if let Some(k) = term {
                let threshold = *first_threshold
                    .get_or_insert_with(|| found.as_ref().map_or(1e-6, |(threshold, _)| threshold * scale));
                for (sum, step) in sums[which].iter_mut().zip(CURVE) {
                    sum.add(&transformed.at(&transport, spatial, threshold * step / scale), material[k]);
                }
            }
            if which == 1 && is_image && label.starts_with("whole") {
                for energy in ENERGIES {
                    let found = transformed.at_energy(&transport, spatial, energy);
                    let error = transport.error(&found.values, &whole);
                    result.energies.push(vec![
                        label.clone(),
                        format!("{} %", 100.0 * energy),
                        format!("{:.0}", found.kept),
                        format!("{:.0}", 4.0 * found.kept),
                        percent(error),
                        percent(transport.most_negative(&found.values, &whole)),
                    ]);
                }
            }
        }
        if let Some(k) = term {
            exact.add(&Found { kept: 0.0, entropy_bytes: 0.0, values: whole }, material[k]);
        }
        row.push(least.map_or("", |(_, name)| name).to_owned());
        context.say(&format!("spatial: {}", row.join(", ")));
        result.functions.push(row);
    }
    for (spatial, sums) in spatial.iter().zip(&sums) {
        for sum in sums {
            let error = transport.error(&sum.radiosity, &exact.radiosity);
            result.curves.push(vec![
                spatial.name().to_owned(),
                format!("{:.0}", 4.0 * sum.kept),
                format!("{:.0}", sum.entropy_bytes),
                percent(error),
            ]);
            result.points.push(Point { series: spatial.name().to_owned(), x: sum.entropy_bytes, y: error });
        }
    }
    Ok(result)
}

pub(crate) fn run(context: &Context) -> Result<String> {
    let mut text = String::new();
    for name in context.some(&["bumpy head", "beethoven", "bunny_3k"], 1) {
        let measured = measure(context, name)?;
        let file = format!("editable_columns_{}.svg", name.replace(' ', "_"));
        let chart = Scatter {
            title: format!(
                "All functions of the far part, {name}, {MATERIAL}, the worst of {} lights",
                columns::LIGHTS
            ),
            axes: ["bytes for each vertex (entropy)", "relative RMS of the far radiosity"].map(str::to_owned),
            units: [Unit::BytesPerVertex, Unit::Percent],
            points: measured.points,
            lines: Vec::new(),
            front: Front::Drawn,
        };
        translux::io::atomic::write(&context.pictures.join(&file), as_svg(&chart)?.as_bytes())?;
        text += &format!("### {name}\n\n![Bytes against error]({})\n\n", format_args!("pictures/{file}"));
        let head = ["transform", "bytes/vertex at 4 a coefficient", "by entropy", "RMS"];
        text += &format!("All functions, one threshold:\n\n{}\n", table(&head, &measured.curves));
        let mut head = vec!["one function"];
        let names = measured.curves.iter().map(|row| row[0].as_str());
        names.for_each(|name| {
            if !head.contains(&name) {
                head.push(name);
            }
        });
        head.push("fewest bytes");
        text += &format!("One function at an error of {}:\n\n{}\n", percent(EQUAL), table(&head, &measured.functions));
        if !measured.energies.is_empty() {
            let head = [
                "CDF 9/7 of",
                "energy kept",
                "coefficients/vertex",
                "bytes/vertex",
                "RMS",
                "most negative, of the peak",
            ];
            text += &format!("As the paper keeps them:\n\n{}\n", table(&head, &measured.energies));
        }
    }
    Ok(text)
}

/// For the lights of the columns.
pub(crate) fn directions() -> [DVec3; 2] {
    [DVec3::new(0.4, 0.7, 0.6), DVec3::new(-0.8, 0.1, -0.4)]
}
