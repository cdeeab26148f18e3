//! Small assets of every form, and what commands do with one.

use std::sync::{Arc, LazyLock};
use std::time::Instant;

use glam::DVec3;
use translux::asset::Asset;
use translux::error::ExitCode;
use translux::evaluate::finer::Finer;
use translux::evaluate::{BakeSettings, Capabilities, Evaluator, MaterialEdit, Model, ProfileEdit, Registry};
use translux::geometry::mesh::{Mesh, Placement};
use translux::geometry::part_table::PartTable;
use translux::geometry::shapes;
use translux::geometry::source::SourceModel;
use translux::light::Light;
use translux::light::environment::EnvironmentMap;
use translux::measure::probes;
use translux::measure::refine::{Goal, RefinedScene, refine_until};
use translux::medium::material::{Medium, preset};
use translux::progress::Silent;
use translux::render::camera::{Camera, Resolution};
use translux::render::frame::{RenderSettings, render};
use translux::scene::Scene;
use translux::transport::calibration::Walks;
use translux_format::RawSection;

use crate::bytes::sections_of;

/// A method, some of its keys, and whether its kernels are calibrated.
pub(crate) type Recipe = (&'static str, &'static [(&'static str, &'static str)], bool);

/// Every form, and what may stand beside it.
pub(crate) const RECIPES: [Recipe; 13] = [
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
    let of = |model: SourceModel, name: &str| model.of_material(name);
    let wax = of(shapes::bumpy_head(8.0, 1), "wax");
    let soap = of(shapes::icosphere(4.0, 0), "soap");
    let slab = of(shapes::cuboid(DVec3::new(24.0, 1.0, 20.0), 1), "slab");
    let place = [DVec3::ZERO, DVec3::new(14.0, 1.0, 3.0), DVec3::new(6.0, -11.0, 0.0)];
    let model = shapes::compose(&[(wax, place[0]), (soap, place[1]), (slab, place[2])]);
    let (mesh, _) = Mesh::from_source(model, &Placement { mm_per_unit: 1.0 }).unwrap();
    let media = [("wax", "marble"), ("soap", "skin1")]
        .map(|(name, of)| Medium { name: name.to_owned(), properties: preset(of).unwrap().properties() });
    let medium = |name: &String| media.iter().position(|medium| medium.name == *name).map(|medium| medium as u32);
    let parts = mesh.materials.iter().map(|name| (name.clone(), medium(name))).collect();
    let parts = PartTable::new(&mesh, mesh.triangle_material.clone(), parts);
    Scene { mesh, parts, media: media.to_vec() }
}

/// The sections of every recipe's asset; kernels are calibrated where there is time for walks.
pub(crate) fn assets(registry: &Registry, has_time: bool) -> Vec<Vec<RawSection>> {
    let scene = scene();
    let bake = |&(name, set, calibrated): &Recipe| {
        let began = Instant::now();
        let method = registry.method(name).unwrap();
        let probes = probes::for_bake(&scene);
        let walks = Walks { photons: 2048, collisions: 100_000, ..Walks::default() };
        let model = if calibrated && has_time { Model::Calibrated(walks) } else { Model::Dipole };
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
pub(crate) type Absurd = String;

fn sound(what: &str, values: &[DVec3]) -> Result<(), Absurd> {
    match values.iter().find(|v| !(v.is_finite() && v.abs().max_element() < 1e5)) {
        Some(odd) => Err(format!("{what} {odd}")),
        None => Ok(()),
    }
}

/// Opens an asset and does with it what commands do; `number` chooses among them.
pub(crate) fn use_asset(
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
