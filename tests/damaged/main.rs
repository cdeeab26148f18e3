//! Assets whose checksums are right and whose contents are not: whatever they hold, commands answer with a result that is finite
//! or with an error, and nothing that validates fails to be evaluated.
//!
//! `TRANSLUX_MUTATIONS=1000000 cargo test --release --test damaged -- --nocapture` tries as many as it is told, over all recipes;
//! `TRANSLUX_FIRST=N` starts at another number. A failure names the number that makes it again.
#![allow(clippy::unwrap_used, missing_docs)]

#[path = "../../formats/tests/common/mod.rs"]
mod bytes;
mod changes;
#[path = "../common/mod.rs"]
mod common;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, LazyLock, Mutex, PoisonError};
use std::time::{Duration, Instant};

use bytes::{Entry, Random, build, sections_of};
use common::{Folder, called};
use glam::DVec3;
use translux::asset::Asset;
use translux::error::ExitCode;
use translux::evaluate::finer::Finer;
use translux::evaluate::memory::Limits;
use translux::evaluate::{BakeSettings, Capabilities, Evaluator, MaterialEdit, Model, ProfileEdit, Registry};
use translux::geometry::shapes;
use translux::light::Light;
use translux::light::environment::EnvironmentMap;
use translux::measure::probes;
use translux::measure::refine::{Goal, RefinedScene, refine_until};
use translux::medium::material::{Medium, preset};
use translux::methods::built_in;
use translux::progress::Silent;
use translux::render::camera::{Camera, Resolution};
use translux::render::frame::{RenderSettings, render};
use translux::report::validation::examine;
use translux::scene::Scene;
use translux::transport::calibration::Walks;
use translux::{ImportOptions, MaterialChoice, Scale, load};
use translux_format::RawSection;

/// Mutations of a run in which nobody asks for more.
const FEW: u64 = 1_500;

/// No mutation of such a small asset takes nearly this long.
const LONG: Duration = Duration::from_secs(20);

/// A method, some of its keys, and whether its kernels are calibrated.
type Recipe = (&'static str, &'static [(&'static str, &'static str)], bool);

/// Every form, and what may stand beside it.
const RECIPES: [Recipe; 13] = [
    (
        "reference",
        &[("single-scattering", "isotropic"), ("single-samples", "4"), ("points", "1"), ("directions", "8")],
        false,
    ),
    (
        "two_pass",
        &[("inter-reflection", "once"), ("inter-reflection-rays", "8"), ("points", "1"), ("directions", "8")],
        false,
    ),
    ("editable", &[("points", "1"), ("directions", "8"), ("coefficients", "16")], false),
    ("two_pass", &[("points", "1"), ("directions", "8")], true),
    ("editable", &[("transport", "stored"), ("coefficients", "16"), ("points", "1"), ("directions", "8")], false),
    ("quantized_lights", &[("lights", "24"), ("shells", "2")], false),
    (
        "quantized_lights",
        &[("lights", "16"), ("shells", "0"), ("interpolation", "nearest4"), ("blend", "linear")],
        false,
    ),
    ("all_frequency", &[("coefficients", "16")], false),
    ("all_frequency", &[("basis", "haar"), ("coefficients", "8"), ("single-scattering", "isotropic")], false),
    ("all_frequency", &[("coefficients", "9"), ("single-scattering", "phase"), ("phase-terms", "4")], false),
    ("all_frequency", &[("coefficients", "9"), ("inter-reflection", "once"), ("inter-reflection-rays", "8")], false),
    ("texture_space", &[("resolution", "16"), ("directions", "4"), ("area-side", "1")], false),
    ("filtered_normals", &[("rungs", "2")], false),
];

/// A body that is not convex, another inside its shadow, and a slab that only casts shadows.
fn scene() -> Scene {
    let wax = called(shapes::bumpy_head(8.0, 1), "wax");
    let soap = called(shapes::icosphere(4.0, 0), "soap");
    let slab = called(shapes::cuboid(DVec3::new(24.0, 1.0, 20.0), 1), "slab");
    let place = [DVec3::ZERO, DVec3::new(14.0, 1.0, 3.0), DVec3::new(6.0, -11.0, 0.0)];
    let model = shapes::compose(&[(wax, place[0]), (soap, place[1]), (slab, place[2])]);
    let folder = Folder::new();
    let path = folder.obj("group.obj", &model).path("group.obj");
    let options = ImportOptions {
        scale: Some(Scale::MillimetresPerUnit(1.0)),
        materials: MaterialChoice { texts: vec!["marble".into(), "soap=skin1".into()], ..MaterialChoice::default() },
        opaque: vec!["slab".into()],
        ..ImportOptions::default()
    };
    load(&path, &options).unwrap().scene
}

/// The sections of every recipe's asset.
fn assets(registry: &Registry) -> Vec<Vec<RawSection>> {
    let scene = scene();
    // Walks take longer than all else: not where few mutations are asked for.
    let few = std::env::var_os("TRANSLUX_MUTATIONS").is_none();
    let bake = |&(name, set, calibrated): &Recipe| {
        let began = Instant::now();
        let method = registry.method(name).unwrap();
        let probes = probes::for_bake(&scene.mesh);
        let walks = Walks { photons: 2048, collisions: 100_000, ..Walks::default() };
        let model = if calibrated && !few { Model::Calibrated(walks) } else { Model::Dipole };
        let settings = BakeSettings { samples: Some(160), probes, model, ..BakeSettings::new(0.1) };
        let keys: Vec<(String, String)> = set.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())).collect();
        let asset = method.recipe(&keys, settings).unwrap().bake(scene.clone(), Default::default(), &Silent);
        println!("{name}: {:?}", began.elapsed());
        sections_of(&asset.unwrap_or_else(|e| panic!("{name}: {e}")).to_bytes().unwrap())
    };
    RECIPES.iter().map(bake).collect()
}

/// A light of each kind.
static LIGHTS: LazyLock<Vec<Light>> = LazyLock::new(|| {
    vec![
        Light::directional(DVec3::new(1.0, 2.0, 3.0), DVec3::new(3.0, 2.0, 1.0)).unwrap(),
        Light::point(DVec3::new(-20.0, 30.0, 25.0), DVec3::splat(900.0)).unwrap(),
        Light::constant(DVec3::ONE).unwrap(),
        Light::environment(Arc::new(EnvironmentMap::new(4, 2, vec![[1.0; 3]; 8]).unwrap()), 40.0, DVec3::ONE).unwrap(),
        Light::area(DVec3::new(0.0, 40.0, 0.0), DVec3::NEG_Y, [20.0, 20.0], DVec3::ONE, None).unwrap(),
    ]
});

/// Numbers that no light could give, in words.
type Absurd = String;

fn sound(what: &str, values: &[DVec3]) -> Result<(), Absurd> {
    match values.iter().find(|v| !(v.is_finite() && v.abs().max_element() < 1e5)) {
        Some(odd) => Err(format!("{what} {odd}")),
        None => Ok(()),
    }
}

/// Opens an asset and does with it what commands do; `number` chooses among them.
fn use_asset(
    registry: &Registry,
    bytes: &[u8],
    number: u64,
    is_lit: bool,
) -> Result<Result<(), Absurd>, translux::error::Error> {
    let asset = Arc::new(Asset::from_bytes(bytes)?);
    let form = registry.form(&asset)?;
    let served = form.kinds();
    let mut evaluator = form.open(asset)?;
    if !is_lit {
        return Ok(Ok(()));
    }
    let of_kind: Vec<Light> = LIGHTS.iter().filter(|light| served.contains(&light.kind())).cloned().collect();
    let light = of_kind[number as usize / 3 % of_kind.len()].clone();
    let light = match evaluator.set_lights(vec![light.clone()], &Silent) {
        // Parallel light alone, as the bake was told.
        Err(e) if e.code() == ExitCode::Unsupported => {
            evaluator.set_lights(vec![LIGHTS[0].clone()], &Silent)?;
            LIGHTS[0].clone()
        }
        lit => lit.map(|()| light)?,
    };
    // Walks through another medium take as long as those of a bake.
    let Capabilities { material, profile, .. } = evaluator.capabilities();
    if number % 5 == 1 && material == MaterialEdit::Any && profile != ProfileEdit::Calibrated {
        let other = |medium: &Medium| Medium { properties: preset("cream").unwrap().properties(), ..medium.clone() };
        let media = evaluator.scene().media.iter().map(other).collect();
        evaluator.set_media(media)?;
    }
    let radiosity = evaluator.radiosity(&Silent)?;
    if let Err(absurd) = sound("radiosity", &radiosity) {
        return Ok(Err(absurd));
    }
    if let Some(single) = evaluator.single_scattering(&Silent)?
        && let Err(absurd) = sound("single scattering", &single)
    {
        return Ok(Err(absurd));
    }
    // Against as many samples as the asset says: more take time, and memory that commands are asked about.
    if number % 41 == 2 && evaluator.cost().samples < 10_000 {
        let _ = probes::by_stage(evaluator.as_mut(), &Silent)?;
    }
    drawn(evaluator.as_ref(), &radiosity, &light)?;
    // Frames of a mesh that is too coarse for its material.
    let refined = match number % 4 {
        3 => refine_until(evaluator.scene(), Goal::SHOWN, &Silent)?,
        _ => None,
    };
    if let Some(RefinedScene { scene, of_triangle, .. }) = refined.filter(|_| form.serves_points()) {
        let shown = Finer::of(evaluator, scene, &of_triangle).radiosity(&Silent)?;
        if let Err(absurd) = sound("radiosity of a refined mesh", &shown) {
            return Ok(Err(absurd));
        }
    }
    Ok(Ok(()))
}

fn drawn(evaluator: &dyn Evaluator, radiosity: &Vec<DVec3>, light: &Light) -> translux::error::Result<()> {
    let resolution = Resolution::new(6, 6)?;
    let settings = RenderSettings::new(Camera::framing(&evaluator.scene().mesh, resolution)?, resolution);
    let settings = RenderSettings { samples_per_pixel: 1, ..settings };
    let frame = render(evaluator, radiosity, std::slice::from_ref(light), &settings, &Silent)?;
    assert_eq!(frame.pixels.len(), 36);
    Ok(())
}

/// One mutation, from its number alone; the fault that it shows.
fn attempt(registry: &Registry, assets: &[Vec<RawSection>], number: u64) -> Option<String> {
    let mut random = Random(number);
    let recipe = (number % assets.len() as u64) as usize;
    let mut sections = assets[recipe].clone();
    let names: Vec<String> =
        (0..=random.below(2)).filter_map(|_| changes::change(&mut random, &mut sections, &assets[recipe])).collect();
    let file = build(&sections.iter().map(Entry::raw).collect::<Vec<_>>());
    // Other settings within their ranges may take minutes of rays: most of those are only opened.
    let settings = names.iter().any(|name| name.starts_with("form.set"));
    let is_lit = !settings || (number / assets.len() as u64).is_multiple_of(16);
    let began = Instant::now();
    let outcome = catch_unwind(AssertUnwindSafe(|| {
        let found = examine(Path::new("a.tlux"), &file, (registry, Limits::none()), &Silent).unwrap();
        let valid = found.errors == 0;
        match use_asset(registry, &file, number, is_lit) {
            Ok(Ok(())) => {
                LIT[usize::from(valid)].fetch_add(1, Ordering::Relaxed);
                None
            }
            Ok(Err(absurd)) => Some(absurd),
            Err(error) if valid => Some(format!("valid and refused: {error}")),
            Err(_) => None,
        }
    }));
    let took = began.elapsed();
    TIMES.lock().unwrap_or_else(PoisonError::into_inner)[recipe] += took;
    let fault = match outcome {
        Ok(None) if took < LONG => return None,
        Ok(None) => format!("took {took:?}"),
        Ok(Some(fault)) => fault,
        Err(_) => format!("panicked: {}", PANIC.lock().unwrap_or_else(PoisonError::into_inner)),
    };
    let told = format!("{number}: {} after {}: {fault}", RECIPES[recipe].0, names.join(", "));
    println!("{told}");
    Some(told)
}

/// Time that the mutations of each recipe took.
static TIMES: Mutex<[Duration; RECIPES.len()]> = Mutex::new([Duration::ZERO; RECIPES.len()]);

/// Mutations that gave a result, of files that are not valid and of valid ones.
static LIT: [AtomicU64; 2] = [const { AtomicU64::new(0) }; 2];

/// Where and why the last panic was.
static PANIC: Mutex<String> = Mutex::new(String::new());

fn number(name: &str, default: u64) -> u64 {
    std::env::var(name).map_or(default, |text| text.parse().unwrap())
}

#[test]
fn nothing_that_validates_fails_and_nothing_panics() {
    let registry = built_in();
    let assets = assets(&registry);
    for (recipe, sections) in RECIPES.iter().zip(&assets) {
        let file = build(&sections.iter().map(Entry::raw).collect::<Vec<_>>());
        let found = examine(Path::new("a.tlux"), &file, (&registry, Limits::none()), &Silent).unwrap();
        assert_eq!(found.errors, 0, "{recipe:?}: {found}");
        for number in [0, 3, 6, 9, 12] {
            let used = use_asset(&registry, &file, number, true);
            assert!(matches!(used, Ok(Ok(()))), "{recipe:?}: {:?}", used.err());
        }
    }
    std::panic::set_hook(Box::new(|info| {
        *PANIC.lock().unwrap_or_else(PoisonError::into_inner) = info.to_string().replace('\n', " ");
    }));
    let (first, count) = (number("TRANSLUX_FIRST", 0), number("TRANSLUX_MUTATIONS", FEW));
    let faults: Vec<String> = (first..first + count).filter_map(|n| attempt(&registry, &assets, n)).collect();
    let _ = std::panic::take_hook();
    let [invalid, valid] = LIT.each_ref().map(|lit| lit.load(Ordering::Relaxed));
    println!("{count} mutations: {valid} valid ones gave a result, {invalid} others");
    println!("times: {:?}", TIMES.lock().unwrap_or_else(PoisonError::into_inner));
    // Mutations that nothing accepts would test nothing.
    assert!(10 * valid > count, "{valid} of {count} were valid");
    assert!(faults.is_empty(), "{} of {count} mutations:\n{}", faults.len(), faults.join("\n"));
}
