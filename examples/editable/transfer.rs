//! The transfer side: which basis, and how its coefficients are packed.

use glam::DVec3;
use translux::asset::Asset;
use translux::error::{Error, Result};
use translux::evaluate::Evaluator;
use translux::light::Light;
use translux::measure::chart::draw::{Front, Point, Scatter, Unit, as_svg};
use translux::medium::profile_basis::ProfileBasis;
use translux::scene::Scene;
use translux_format::far_field::{FarField, LANES, Shape, tags};
use translux_format::{Codec, profile_basis as file};

use crate::bench::{bake, bytes_per_vertex, open, percent, rms, sun, truth, under};
use crate::common::bench::{Context, Recipe, table};

/// Model, vertices, samples: the first of the tables.
const MODEL: (&str, usize, usize) = ("beethoven", 16_384, 65_536);
const QUICK: (&str, usize, usize) = ("bunny_3k", 0, 16_384);

/// Bases, and how many spacings their functions may have.
const BASES: [(&str, &str, &str); 5] = [
    ("ladder", "ladder", "4"),
    ("ladder, one spacing", "ladder", "1"),
    ("transported", "transported", "4"),
    ("transported, one spacing", "transported", "1"),
    ("plain, one spacing", "plain", "1"),
];

/// Those whose packings are shown.
const SHOWN: [&str; 2] = ["ladder", "transported"];

/// Errors asked of everything; packings are shown for the second.
const ASKED: [f64; 3] = [0.02, 0.01, 0.005];
const PACKED: f64 = 0.01;

/// Those that are worst in the tables.
const MATERIALS: [&str; 2] = ["ketchup", "chicken1"];

/// Distance of the light that makes a spot, mm.
const SPOT_MM: f64 = 1.0;

/// The paper's widths of a value: with an index of 16 bits, and beyond that range with one of 18 (section 4).
const INDEX_RANGE: usize = 1 << 16;
const PAPER_VALUE_BITS: [u32; 2] = [16, 14];
const PAPER_BYTES: usize = 4;

/// A light so near the surface that it lights a spot.
fn spot(scene: &Scene) -> Light {
    let mesh = &scene.mesh;
    let right = mesh.local_mm.iter().map(|v| v.as_dvec3()).max_by(|a, b| a.x.total_cmp(&b.x)).unwrap_or(DVec3::ZERO);
    Light::Point { at_mm: mesh.origin_mm + right + DVec3::new(SPOT_MM, 0.0, 0.0), intensity: DVec3::ONE }
}

/// The least radiosity over the greatest.
fn most_negative(values: &[DVec3]) -> f64 {
    let least = values.iter().map(|v| v.min_element()).fold(0.0, f64::min);
    least / values.iter().map(|v| v.max_element()).fold(f64::MIN_POSITIVE, f64::max)
}

/// What is measured of an asset: the worst of the materials.
#[derive(Clone, Copy, Default)]
struct Found {
    sun: f64,
    spot: f64,
    negative: f64,
}

/// Radiosity of the truth, material by material, under the sun and the spot.
type Truth = Vec<[Vec<DVec3>; 2]>;

fn both(evaluator: &mut dyn Evaluator, scene: &Scene, material: &str) -> Result<[Vec<DVec3>; 2]> {
    Ok([under(evaluator, material, &[sun()])?, under(evaluator, material, &[spot(scene)])?])
}

fn measured(scene: &Scene, asset: Asset, truth: &Truth) -> Result<Found> {
    let mut evaluator = open(asset)?;
    let mut worst = Found::default();
    for (material, expected) in MATERIALS.iter().zip(truth) {
        let [lit, spotted] = both(evaluator.as_mut(), scene, material)?;
        worst.sun = worst.sun.max(rms(scene, &lit, &expected[0]));
        worst.spot = worst.spot.max(rms(scene, &spotted, &expected[1]));
        worst.negative = worst.negative.min(most_negative(&lit)).min(most_negative(&spotted));
    }
    Ok(worst)
}

fn fail(error: translux_format::FormatError) -> Error {
    Error::runtime(error.to_string())
}

fn shape(asset: &Asset) -> Shape<'_> {
    Shape { vertices: asset.scene.mesh.local_mm.len(), part_offsets: &asset.samples.part_offsets }
}

fn far_field(asset: &Asset) -> Result<FarField> {
    let missing = || Error::runtime("an asset without a far field");
    FarField::from_sections(&asset.sections, &shape(asset)).map_err(fail)?.ok_or_else(missing)
}

fn basis(asset: &Asset) -> Result<ProfileBasis> {
    let missing = || Error::runtime("an asset without a basis");
    let file::ProfileBasis { split_mm, nodes_mm, weights_mm4, functions, totals } =
        file::ProfileBasis::from_sections(&asset.sections).map_err(fail)?.ok_or_else(missing)?;
    ProfileBasis::from_parts(split_mm, nodes_mm, weights_mm4, functions, totals)
}

/// The same asset with its far field in the plain layout.
fn plain(asset: &Asset, codec: Codec) -> Result<Asset> {
    let mut sections = far_field(asset)?.to_sections(&shape(asset)).map_err(fail)?;
    sections.iter_mut().filter(|s| tags::REPLACED.contains(&s.tag)).for_each(|s| s.codec = codec);
    let mut changed = asset.clone();
    changed.sections.retain(|section| section.tag.as_str().split('.').next() != Some("far"));
    changed.sections.extend(sections);
    Ok(changed)
}

/// Bytes for each vertex as the paper packs: 32 bits, index and value, for each coefficient that is not 0, row sums included. And the
/// asset with the values that are left.
fn as_the_paper(asset: &Asset) -> Result<(f64, Asset)> {
    let mut far = far_field(asset)?;
    let bits = PAPER_VALUE_BITS[usize::from(asset.samples.len() > INDEX_RANGE)];
    let most = f64::from((1u32 << (bits - 1)) - 1);
    let (mut narrow, mut wide) = (far.narrow.iter(), far.wide.iter());
    let (mut rows, mut largest) = (Vec::new(), vec![1.0f64; far.terms]);
    for (&mask, &wide_mask) in far.masks.iter().zip(&far.wide_masks) {
        for k in (0..far.terms).filter(|k| mask >> k & 1 == 1) {
            let row: Option<[i16; LANES]> = match wide_mask >> k & 1 {
                1 => wide.next().copied(),
                _ => narrow.next().map(|row| row.map(i16::from)),
            };
            let row = row.ok_or_else(|| Error::runtime("a far field with too few rows"))?;
            largest[k] = row.iter().fold(largest[k], |a, v| a.max(f64::from(v.unsigned_abs())));
            rows.push((k, row));
        }
    }
    let numbers: usize = rows.iter().map(|(_, row)| row.iter().filter(|v| **v != 0).count()).sum();
    let factors: Vec<f64> = largest.iter().map(|largest| most / largest).collect();
    let packed = |(k, row): (usize, [i16; LANES])| row.map(|v| (f64::from(v) * factors[k]).round() as i16);
    let mut rows = rows.into_iter().map(packed);
    (far.narrow, far.wide) = (Vec::new(), Vec::new());
    for (mask, wide_mask) in far.masks.iter().zip(&mut far.wide_masks) {
        *wide_mask = 0;
        for (k, row) in (0..far.terms).filter(|k| mask >> k & 1 == 1).zip(&mut rows) {
            let fits = row.iter().all(|v| i8::try_from(*v).is_ok());
            if fits {
                far.narrow.push(row.map(|v| v as i8));
            } else {
                *wide_mask |= 1 << k;
                far.wide.push(row);
            }
        }
    }
    for (step, factor) in far.steps.iter_mut().zip(&factors) {
        *step = (f64::from(*step) / factor) as f32;
    }
    let mut changed = asset.clone();
    changed.sections.retain(|section| section.tag.as_str().split('.').next() != Some("far"));
    let sections = far.to_coded_sections(&shape(asset)).map_err(fail)?;
    let kept = [tags::RECEIVERS, tags::GROUPS, tags::STEPS, tags::FUNCTIONS, tags::ROWS];
    let mut others = changed.clone();
    others.sections.extend(sections.iter().filter(|s| kept.contains(&s.tag)).cloned());
    let sums = far.row_sums.iter().filter(|sum| **sum != 0.0).count();
    let coefficients = PAPER_BYTES * (numbers + sums);
    let bytes = bytes_per_vertex(&others)? + coefficients as f64 / asset.scene.mesh.local_mm.len() as f64;
    changed.sections.extend(sections);
    Ok((bytes, changed))
}

pub(crate) fn run(context: &Context) -> Result<String> {
    let (model, vertices, samples) = if context.quick { QUICK } else { MODEL };
    let scene = context.finer_scene(model, vertices, "marble")?;
    let mut evaluator = truth(context, &scene)?;
    let expected: Truth = MATERIALS.iter().map(|m| both(evaluator.as_mut(), &scene, m)).collect::<Result<_>>()?;
    drop(evaluator);
    context.say("transfer: the truth");
    let (mut bases, mut packings, mut points) = (Vec::new(), Vec::new(), Vec::new());
    for (name, basis_name, levels) in BASES {
        for asked in context.some(&ASKED, 2) {
            let set = [("transport", "stored"), ("basis", basis_name), ("far-levels", levels), ("points", "1")];
            let (asset, seconds) = bake(&scene, &Recipe { samples: Some(samples), max_rms: asked, set: &set })?;
            let bytes = bytes_per_vertex(&asset)?;
            let functions = basis(&asset)?;
            let found = measured(&scene, asset.clone(), &expected);
            let row =
                vec![name.to_owned(), percent(asked), functions.terms().to_string(), percent(functions.worst_error())];
            let rest = match &found {
                Ok(found) => vec![percent(found.sun), percent(found.spot), format!("{:.3} %", 100.0 * found.negative)],
                Err(error) => vec![error.message().to_owned(), "-".to_owned(), "-".to_owned()],
            };
            let row = [row, vec![format!("{bytes:.0}")], rest, vec![format!("{seconds:.0} s")]].concat();
            context.say(&format!("transfer: {}", row.join(", ")));
            bases.push(row);
            let Ok(found) = found else { continue };
            points.push(Point { series: format!("{name}, entropy-coded"), x: bytes, y: found.sun });
            if asked == PACKED && SHOWN.contains(&name) {
                let (paper, rounded) = as_the_paper(&asset)?;
                let rounded = measured(&scene, rounded, &expected)?;
                let [fixed, zstd] = [Codec::Raw, Codec::Zstd].map(|codec| bytes_per_vertex(&plain(&asset, codec)?));
                let shown = [
                    ("32 bits each, as the paper", paper, rounded.sun),
                    ("8 or 16 bits, fixed width", fixed?, found.sun),
                    ("8 or 16 bits, zstd", zstd?, found.sun),
                    ("8 or 16 bits, entropy-coded", bytes, found.sun),
                ];
                for (packing, bytes, error) in shown {
                    packings.push(vec![name.to_owned(), packing.to_owned(), format!("{bytes:.0}"), percent(error)]);
                    if packing != shown[3].0 {
                        points.push(Point { series: format!("{name}, {packing}"), x: bytes, y: error });
                    }
                }
            }
        }
    }
    let chart = Scatter {
        title: format!("Bases and packings, {model}, worst of {} materials, one directional light", MATERIALS.len()),
        axes: ["bytes for each vertex", "relative RMS against the truth"].map(str::to_owned),
        units: [Unit::BytesPerVertex, Unit::Percent],
        points,
        lines: Vec::new(),
        front: Front::Drawn,
    };
    translux::io::atomic::write(&context.pictures.join("editable_transfer.svg"), as_svg(&chart)?.as_bytes())?;
    let head = [
        "basis",
        "error asked",
        "functions",
        "T1, worst judge",
        "bytes/vertex",
        "RMS, sun",
        "RMS, spot",
        "most negative over peak",
        "bake",
    ];
    Ok(format!(
        "{}\n![Bases and packings](pictures/editable_transfer.svg)\n\nHow the coefficients are packed, {} asked:\n\n{}",
        table(&head, &bases),
        percent(PACKED),
        table(&["basis", "coefficients", "bytes/vertex", "RMS, sun"], &packings)
    ))
}
