//! The rows of the suite: bodies with their media, and the lights of each.

use glam::DVec3;
use translux::error::Result;
use translux::geometry::mesh::Scale;
use translux::geometry::parts::PartsRule;
use translux::geometry::shapes::{icosphere, still_life};
use translux::geometry::source::SourceModel;
use translux::import::{ImportOptions, Source};
use translux::medium::material::{OpticalProperties, Overrides, preset};
use translux::progress::Silent;
use translux::{Imported, MaterialChoice};

use super::bodies;
use super::lamps::Lamp;

/// A body, how it is read, and the lights that fall on it.
pub struct Case {
    pub name: String,
    pub model: Box<dyn Fn() -> SourceModel>,
    pub scale: Scale,
    /// Materials as they are typed.
    pub materials: Vec<&'static str>,
    pub overrides: Overrides,
    pub parts: PartsRule,
    pub lamps: Vec<Lamp>,
    /// Surface samples of every method; none for their defaults.
    pub samples: Option<usize>,
    /// Keys of a method: its name, key, value.
    pub set: Vec<(&'static str, &'static str, &'static str)>,
    /// Properties that take the place of all media after the bake.
    pub edited: Option<OpticalProperties>,
}

impl Case {
    /// The scene as the command line imports it.
    pub fn imported(&self) -> Result<Imported> {
        let materials = MaterialChoice {
            texts: self.materials.iter().map(|text| (*text).to_owned()).collect(),
            overrides: self.overrides,
            ..MaterialChoice::default()
        };
        let options =
            ImportOptions { scale: Some(self.scale), materials, parts: self.parts, ..ImportOptions::default() };
        Source { model: (self.model)(), inputs: Vec::new() }.import(&options, &Silent)
    }
}

/// Samples of rows that are not about them.
pub const SAMPLES: usize = 1 << 13;

const MM: Scale = Scale::MillimetresPerUnit(1.0);

/// Skin of 30 mm under three suns, unless more is said.
fn case(name: &'static str, model: fn() -> SourceModel) -> Case {
    Case {
        name: name.to_owned(),
        model: Box::new(model),
        scale: Scale::DiagonalMm(30.0),
        materials: vec!["skin1"],
        overrides: Overrides::default(),
        parts: PartsRule::Auto,
        lamps: vec![Lamp::Sun, Lamp::EdgeOn, Lamp::Behind],
        samples: Some(SAMPLES),
        set: Vec::new(),
        edited: None,
    }
}

fn of_size(name: &'static str, mm: f64) -> Case {
    Case { scale: Scale::DiagonalMm(mm), ..case(name, bodies::head) }
}

/// A head of coefficients in 1/mm.
fn of_medium(name: &'static str, overrides: Overrides) -> Case {
    Case { overrides, ..case(name, bodies::head) }
}

fn with_keys(name: &'static str, lamps: Vec<Lamp>, set: &[(&'static str, &'static str, &'static str)]) -> Case {
    Case { lamps, set: set.to_vec(), ..case(name, bodies::head) }
}

/// All rows.
pub fn cases() -> Vec<Case> {
    let suns = vec![Lamp::Sun, Lamp::EdgeOn, Lamp::Behind, Lamp::Below, Lamp::Black];
    let points = vec![Lamp::PointAt(1.1), Lamp::PointAt(3.0), Lamp::OnVertex, Lamp::Inside, Lamp::FarPoint];
    let skies = vec![Lamp::Sky, Lamp::SkyWithSun, Lamp::LoneSun, Lamp::LowSun, Lamp::Constant];
    let coefficient = |v: f64| Some(DVec3::splat(v));
    let plain = Overrides::default;
    vec![
        Case { lamps: suns, samples: None, ..case("head, suns", bodies::head) },
        Case { lamps: points, samples: None, ..case("head, points", bodies::head) },
        Case { lamps: vec![Lamp::Area], ..case("head, area", bodies::head) },
        Case { lamps: skies, samples: None, ..case("head, skies", bodies::head) },
        of_size("head of 0.1 mm", 0.1),
        of_size("head of 1 mm", 1.0),
        of_size("head of 10 mm", 10.0),
        of_size("head of 100 mm", 100.0),
        of_size("head of 1 m", 1e3),
        of_size("head of 10 m", 1e4),
        Case { scale: MM, ..case("thin sheet", bodies::sheet) },
        Case { scale: MM, lamps: vec![Lamp::SkyWithSun], ..case("thin sheet, sky", bodies::sheet) },
        Case { scale: MM, parts: PartsRule::Joined, ..case("facing walls, joined", bodies::facing_walls) },
        Case { scale: MM, parts: PartsRule::Separate, ..case("facing walls, separate", bodies::facing_walls) },
        Case { scale: MM, materials: vec!["outer=skin1", "inner=marble"], ..case("nested", bodies::nested) },
        Case { scale: MM, ..case("cavity", bodies::cavity) },
        Case { scale: MM, ..case("touching cubes", bodies::touching) },
        Case { scale: MM, ..case("open half ball", bodies::open) },
        Case { scale: MM, ..case("open plane", bodies::open_plane) },
        Case { scale: MM, ..case("non-manifold edge", bodies::non_manifold) },
        Case { scale: MM, ..case("every triangle twice", bodies::duplicated) },
        case("mixed winding", bodies::mixed_winding),
        Case { scale: MM, ..case("uneven triangles", bodies::uneven) },
        Case { scale: MM, ..case("slivers", bodies::slivers) },
        Case { scale: MM, ..case("cube of 12 triangles", bodies::cube) },
        case("head, turned", bodies::turned),
        case("head, shuffled", bodies::shuffled),
        case("head, far from the origin", bodies::far_off),
        Case { scale: Scale::DiagonalMm(5.0), ..case("one triangle", bodies::triangle) },
        Case { materials: vec!["marble"], ..case("marble", bodies::head) },
        of_medium("sigma_a 0", Overrides { sigma_a_per_mm: coefficient(0.0), ..plain() }),
        of_medium("albedo 0.9999999", Overrides { sigma_a_per_mm: coefficient(1e-7), ..plain() }),
        of_medium("albedo 0.001", Overrides { sigma_a_per_mm: coefficient(1e3), ..plain() }),
        of_medium("eta 1", Overrides { eta_inside_over_outside: Some(1.0), ..plain() }),
        of_medium("eta 1.0001", Overrides { eta_inside_over_outside: Some(1.0001), ..plain() }),
        of_medium("eta 0.8", Overrides { eta_inside_over_outside: Some(0.8), ..plain() }),
        of_medium("eta 3", Overrides { eta_inside_over_outside: Some(3.0), ..plain() }),
        of_medium("g 0.99", Overrides { g: Some(0.99), ..plain() }),
        of_medium("g -0.99", Overrides { g: Some(-0.99), ..plain() }),
        Case { edited: preset("wholemilk").map(|p| p.properties()), ..case("edited to milk", bodies::head) },
        Case {
            // A mean free path of 3 m.
            edited: Some(OpticalProperties {
                sigma_s_reduced_per_mm: DVec3::splat(3e-4),
                sigma_a_per_mm: DVec3::splat(1e-5),
                g: 0.0,
                eta_inside_over_outside: 1.3,
            }),
            ..case("edited to what no basis holds", bodies::head)
        },
        with_keys("one coefficient", vec![Lamp::Sky], &[("all_frequency", "coefficients", "1")]),
        with_keys("one light", vec![Lamp::Sun], &[("quantized_lights", "lights", "1")]),
        with_keys("16 lights", vec![Lamp::Sun], &[("quantized_lights", "lights", "16")]),
        Case {
            scale: MM,
            materials: vec!["elephant=skin1", "ring=marble", "plate=wholemilk"],
            ..case("elephant, ring and plate", || still_life(4.0))
        },
        Case { scale: MM, ..case("ball", || icosphere(15.0, 4)) },
        case("a million triangles", bodies::a_million),
        Case { lamps: vec![Lamp::SpotAcross, Lamp::NarrowSpot], samples: None, ..case("head, spots", bodies::head) },
    ]
}
