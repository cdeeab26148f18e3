//! What the forecasts of the forms are fitted to: bytes, processor seconds of the bake, and processor milliseconds to new radiosity under a
//! new light of each kind. One line for
//!
//! `plan_costs MODEL SIZE-MM MATERIAL METHOD SAMPLES|auto KINDS|all [KEY=VALUE...]`
#![allow(clippy::unwrap_used, missing_docs)]
use glam::DVec3;
use std::sync::Arc;
use std::time::Instant;
use translux::evaluate::BakeSettings;
use translux::light::{Light, LightKind};
use translux::measure::probes;
use translux::progress::Silent;
use translux::{ImportOptions, MaterialChoice, Scale, load};

/// Processor seconds of this process.
fn cpu() -> f64 {
    let text = std::fs::read_to_string("/proc/self/stat").unwrap();
    let fields: Vec<f64> =
        text.rsplit(')').next().unwrap().split_whitespace().skip(1).map(|f| f.parse().unwrap_or(0.0)).collect();
    (fields[10] + fields[11]) / 100.0
}

fn main() {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [model, size, material, method, samples, kinds, set @ ..] = args.as_slice() else {
        panic!("plan_costs MODEL SIZE-MM MATERIAL METHOD SAMPLES|auto KINDS|all [KEY=VALUE...]")
    };
    let options = ImportOptions {
        scale: Some(Scale::DiagonalMm(size.parse().unwrap())),
        materials: MaterialChoice::plain(material),
        ..ImportOptions::default()
    };
    let imported = load(model.as_ref(), &options).unwrap();
    let registry = translux::methods::built_in();
    let m = registry.method(method).unwrap();
    let mut settings = BakeSettings::new(0.01);
    settings.samples = samples.parse().ok();
    settings.probes = probes::for_bake(&imported.scene);
    if kinds != "all" {
        settings.for_lights = LightKind::ALL.into_iter().filter(|k| kinds.contains(k.name())).collect();
    }
    let set: Vec<(String, String)> =
        set.iter().map(|s| s.split_once('=').map(|(a, b)| (a.to_owned(), b.to_owned())).unwrap()).collect();
    let recipe = m.recipe(&set, settings).unwrap();
    let (v, t) = (imported.scene.mesh.local_mm.len(), imported.scene.mesh.triangles.len());
    let mesh = imported.scene.mesh.clone();
    let start = cpu();
    let asset = recipe.bake(imported.scene, imported.origin.into(), &Silent).unwrap();
    let bake = cpu() - start;
    let bytes = asset.to_bytes().unwrap();
    let sizes = translux::report::sizes::sizes(&bytes).unwrap();
    let start = Instant::now();
    let mut e = registry.open(Arc::new(asset.clone())).unwrap();
    let open = start.elapsed().as_secs_f64();
    let area: f64 = asset.scene.parts.parts.iter().filter(|p| p.transfers()).map(|p| p.area_mm2).sum();
    let path = asset.scene.media[0].properties.mean_free_path_mm().min_element();
    print!(
        "A/l2 {:.0} {} v {v} t {t} {method} {set:?} n {} {kinds} | file {} own {} env {} | ledger {:.3} {:.3} | bake {bake:.2} open {open:.2} |",
        area / (path * path),
        model.rsplit('/').next().unwrap(),
        asset.samples.len(),
        bytes.len(),
        sizes.stored_without_mesh,
        sizes.stored_environment,
        100.0 * asset.ledger.total_rms(),
        100.0 * asset.ledger.total_rms_without_environment()
    );
    let r = mesh.diagonal_mm();
    let lights = |turn: f64| -> Vec<Light> {
        vec![
            Light::Directional { from: DVec3::new(turn, 0.6, 0.5).normalize(), irradiance: DVec3::ONE },
            Light::Point {
                at_mm: mesh.origin_mm + DVec3::new(turn, 0.6, 0.5).normalize() * r,
                intensity: DVec3::splat(r * r),
            },
            translux::light(&format!(
                "area:at={},{},{}:normal=0,-1,0:size={r},{r}:radiance=1",
                mesh.origin_mm.x + turn,
                mesh.origin_mm.y + r,
                mesh.origin_mm.z
            ))
            .unwrap(),
            Light::Environment {
                map: Arc::new(translux::light::sky::sky_with_sun()),
                rotate_degrees: 90.0 * turn,
                scale: DVec3::ONE,
            },
            probes::constant(),
        ]
    };
    for k in 0..5 {
        let mut failed = false;
        let (mut start, mut count) = (0.0, 0);
        while count < 2 || (cpu() - start < 0.5 && count < 40) {
            let light = lights(0.1 + 0.02 * f64::from(count))[k].clone();
            if e.set_lights(vec![light], &Silent).is_err() {
                failed = true;
                break;
            }
            e.radiosity(&Silent).unwrap();
            if count == 0 {
                start = cpu();
            }
            count += 1;
        }
        let best = (cpu() - start) / f64::from((count - 1).max(1));
        let name = lights(0.1)[k].kind().name();
        if failed {
            print!(" {name} -");
        } else {
            print!(" {name} {:.1}ms", 1e3 * best);
        }
    }
    println!();
}
