//! Revisions of the algorithms: what the bytes of an asset mean changes only with the number that assets carry, and what earlier ones
//! wrote still opens, or is refused with the reason.
//!
//! `fixtures/assets/revision_N` has small assets of one revision, one for each form, and what they give under a light; those of released
//! revisions are never made again.

use std::path::{Path, PathBuf};

use glam::DVec3;
use serde_json::{Value, json};
use translux::asset::ALGORITHM_REVISION;
use translux::geometry::source::SourceModel;

use crate::common::Folder;

/// Set to write the assets of this revision.
const WRITE: &str = "TRANSLUX_BLESS";
/// Set to 1 where there is time.
const LONG: &str = "TRANSLUX_LONG";

/// A name, and how it is baked.
const ASSETS: [(&str, &str); 8] = [
    ("samples", "--method two_pass --samples 150"),
    ("environment_rows", "--method editable --samples 100 --for-lights environment --set coefficients=16"),
    ("factored", "--method editable --samples 150 --set transport=stored --for-lights directional --max-rms 10%"),
    ("projected_lights", "--method quantized_lights --samples 150 --set lights=24 --set shells=2"),
    ("projected_harmonics", "--method all_frequency --samples 150 --set coefficients=16"),
    (
        "rows_single_scattering",
        "--method all_frequency --samples 50 --for-lights directional --set basis=haar --set coefficients=8 --set single-scattering=isotropic",
    ),
    ("texture_space", "--method texture_space --for-lights directional --set resolution=32"),
    (
        "filtered_normals",
        "--method filtered_normals --for-lights directional --set rungs=2 --set alpha=0.2 --set width=1",
    ),
];

/// Likewise, but so slow to bake that its bytes are compared only where there is time, and elsewhere it is only opened.
const SLOW: (&str, &str) = ("calibrated", "--method two_pass --samples 100 --model calibrated --photons 2048");

/// What all of them are lit by.
const LIGHTS: &str = "--light directional:from=0.3,0.8,0.5:irradiance=3 --light constant:radiance=0.5";

/// Difference of mean radiosity, relative, that a later revision may make of an earlier one's asset, and another machine's rounding.
const SAME: f64 = 1e-3;
const ROUNDING: f64 = 1e-4;

/// The machine that wrote the assets of a revision, and what they give.
const MACHINE: &str = "machine.json";
const GIVEN: &str = "given.json";

fn assets() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/assets")
}

/// A bent ring with a bulge: closed, shadowed by itself, without symmetry; its coordinates are short decimals.
fn body() -> SourceModel {
    let (around, across) = (12, 6);
    let place = |i: usize, j: usize| {
        let turn = |k: usize, n: usize| std::f64::consts::TAU * k as f64 / n as f64;
        let (u, v) = (turn(i, around), turn(j, across));
        let r = 3.0 + (1.0 + 0.3 * (3.0 * u).sin()) * v.cos();
        let p = DVec3::new(r * u.cos(), v.sin() + 0.4 * (2.0 * u).cos(), r * u.sin());
        (p * 1000.0).round() / 1000.0
    };
    let index = |i: usize, j: usize| ((i % around) * across + j % across) as u32;
    let places = (0..around).flat_map(|i| (0..across).map(move |j| (i, j)));
    let quads = places.clone().map(|(i, j)| [index(i, j), index(i, j + 1), index(i + 1, j + 1), index(i + 1, j)]);
    SourceModel {
        positions: places.map(|(i, j)| place(i, j)).collect(),
        triangles: quads.flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]).collect(),
        triangle_material: vec![0; 2 * around * across],
        materials: vec!["default".into()],
        ..SourceModel::default()
    }
}

/// What rounds on a machine: its elementary functions, and the vector instructions that libraries choose by.
fn machine() -> Value {
    let functions = [f64::sin, f64::cos, f64::exp, f64::ln, f64::sqrt, f64::cbrt, f64::atan, f64::acos, f64::tanh];
    let values = (1..500u32).map(|i| f64::from(i) * 0.0019);
    let bits = values.flat_map(|x| functions.map(|f| f(x)).into_iter().chain([x.powf(1.7 + x), x.atan2(1.3 - x)]));
    let hash = bits.fold(0xcbf2_9ce4_8422_2325_u64, |hash, x| (hash ^ x.to_bits()).wrapping_mul(0x0100_0000_01b3));
    #[cfg(target_arch = "x86_64")]
    let vectors = (is_x86_feature_detected!("fma"), is_x86_feature_detected!("avx512f"));
    #[cfg(not(target_arch = "x86_64"))]
    let vectors = (false, false);
    json!({ "architecture": std::env::consts::ARCH, "fma": vectors.0, "avx512": vectors.1, "functions": format!("{hash:016x}") })
}

/// Returns whether mean radiosity is the same within a share of itself.
fn is_same(new: &Value, old: &Value, within: f64) -> bool {
    let mean = |of: &Value| -> Vec<f64> {
        of["mean_radiosity"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
    };
    let (new, old) = (mean(new), mean(old));
    new.len() == old.len() && new.iter().zip(&old).all(|(new, old)| *old > 0.0 && (new - old).abs() <= within * old)
}

/// What an asset gives under the lights.
fn given(folder: &Folder, asset: &Path) -> Value {
    let line = format!("evaluate {} {LIGHTS} -o b.ply --json", asset.display());
    let report = folder.run(&line).ok().json();
    json!({ "mean_radiosity": report["mean_radiosity"], "method": report["method"] })
}

#[test]
fn bytes_change_with_the_revision_alone() {
    let folder = Folder::new();
    folder.obj("ring.obj", &body());
    let kept = assets().join(format!("revision_{ALGORITHM_REVISION}"));
    let write = std::env::var_os(WRITE).is_some();
    let mut differ = Vec::new();
    let mut results = serde_json::Map::new();
    let read = |name: &str| -> Value { serde_json::from_slice(&std::fs::read(kept.join(name)).unwrap()).unwrap() };
    let is_same_machine = write || machine() == read(MACHINE);
    let has_time = write || std::env::var(LONG).is_ok_and(|value| value == "1");
    for (name, options) in ASSETS.into_iter().chain(has_time.then_some(SLOW)) {
        folder.run(&format!("bake ring.obj --unit mm --material marble {options} -q -o {name}.tlux")).ok();
        if write {
            std::fs::create_dir_all(&kept).unwrap();
            std::fs::write(kept.join(format!("{name}.tlux")), folder.read(&format!("{name}.tlux"))).unwrap();
            results.insert(name.to_owned(), given(&folder, Path::new(&format!("{name}.tlux"))));
        } else if std::fs::read(kept.join(format!("{name}.tlux"))).unwrap_or_default()
            != folder.read(&format!("{name}.tlux"))
        {
            let kept = kept.join(format!("{name}.tlux"));
            // Elsewhere the last bits of elementary functions and of matrix products may be others.
            if !is_same_machine
                && is_same(&given(&folder, Path::new(&format!("{name}.tlux"))), &given(&folder, &kept), ROUNDING)
            {
                println!("{name}: other bytes, the same radiosity, on {}", machine());
                continue;
            }
            let sections = folder.run_words(["compare", &format!("{name}.tlux"), &kept.display().to_string()]);
            differ.push(format!("{name}:\n{}{}", sections.text(), sections.stderr));
        }
    }
    if write {
        std::fs::write(kept.join(GIVEN), format!("{:#}\n", Value::from(results))).unwrap();
        std::fs::write(kept.join(MACHINE), format!("{:#}\n", machine())).unwrap();
    }
    assert!(
        differ.is_empty(),
        "the same input gives other bytes than revision {ALGORITHM_REVISION} of the algorithms gave. If that is meant: raise ALGORITHM_REVISION \
         in src/asset.rs; say in CHANGELOG.md what changes; {WRITE}=1 cargo test --release --test cli revisions writes the assets of the new \
         revision; the folder of one that no release had goes. Otherwise it is a fault.\n{}",
        differ.join("\n")
    );
}

#[test]
fn assets_of_every_revision_open_or_say_why_not() {
    let folder = Folder::new();
    let mut revisions: Vec<PathBuf> = std::fs::read_dir(assets()).unwrap().map(|entry| entry.unwrap().path()).collect();
    revisions.sort();
    assert!(revisions.contains(&assets().join(format!("revision_{ALGORITHM_REVISION}"))), "{revisions:?}");
    for revision in &revisions {
        let known: Value = serde_json::from_slice(&std::fs::read(revision.join(GIVEN)).unwrap()).unwrap();
        let files = std::fs::read_dir(revision).unwrap().count();
        assert_eq!(files, known.as_object().unwrap().len() + 2, "{}", revision.display());
        for (name, known) in known.as_object().unwrap() {
            let asset = revision.join(format!("{name}.tlux"));
            assert!(asset.metadata().unwrap().len() < 20_000, "{}: a few kB are enough", asset.display());
            if let Some(reason) = known["refused"].as_str() {
                let line = format!("evaluate {} {LIGHTS} -o b.ply", asset.display());
                assert!(folder.run(&line).stderr.contains(reason), "{}", asset.display());
                continue;
            }
            folder.run(&format!("validate {}", asset.display())).ok();
            let given = given(&folder, &asset);
            assert!(is_same(&given, known, SAME), "{}: {given} for {known}", asset.display());
            assert_eq!(given["method"], known["method"], "{}", asset.display());
        }
    }
}

/// Files of the format before assets named their form.
#[test]
fn what_cannot_be_opened_any_more_says_so() {
    let folder = Folder::new();
    for name in ["v0_0_full", "v0_1_full"] {
        let asset = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("formats/tests/data/{name}.tlux"));
        let line = format!("evaluate {} {LIGHTS} -o b.ply", asset.display());
        folder.run(&line).fails(3, &["without section form.nam", "bake it again"]);
    }
}
