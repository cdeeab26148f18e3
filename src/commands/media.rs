//! `--material` and its companions: optical properties or looks for a model's materials, or in place of an asset's.

use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use glam::DVec3;

use super::console::Console;
use crate::error::Result;
use crate::evaluate::{Evaluator, Method};
use crate::import::materials::{AskedLook, MaterialChoice};
use crate::import::of_file::FromFile;
use crate::math::srgb::hex_from_linear;
use crate::medium::inversion::{REACHED, Radius, Reflector};
use crate::medium::look::{Look, parse_colour};
use crate::medium::material::{Medium, Overrides};
use crate::medium::profiles::model::ProfileModel;
use crate::report::materials::LookReport;
use crate::report::text::significant;

/// Optical properties.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Material")]
pub(super) struct MediumArgs {
    /// A measured material, a TOML file, or NAME=either for one material of the model; repeatable
    #[arg(long, value_name = "[NAME=]MATERIAL")]
    material: Vec<String>,
    /// Scattering coefficient in 1/mm, unreduced: a number or R,G,B
    #[arg(long, value_name = "RGB", value_parser = rgb, allow_negative_numbers = true)]
    sigma_s: Option<DVec3>,
    /// Absorption coefficient in 1/mm: a number or R,G,B
    #[arg(long, value_name = "RGB", value_parser = rgb, allow_negative_numbers = true)]
    sigma_a: Option<DVec3>,
    /// Mean cosine of the phase function, -1 to 1; keeps the reduced scattering of a --material
    #[arg(long, allow_negative_numbers = true)]
    g: Option<f64>,
    /// Index of refraction, inside over outside
    #[arg(long, allow_negative_numbers = true)]
    eta: Option<f64>,
    /// Colour in place of coefficients: what a flat body scatters back under white light from everywhere, its highlight left out;
    /// '#e8c4b0' (sRGB), or linear R,G,B. With --material it keeps the material's length
    #[arg(long, value_name = "COLOR", value_parser = parse_colour, allow_negative_numbers = true)]
    color: Option<DVec3>,
    /// How far light goes inside, in mm: a number or R,G,B. With --material it keeps the material's colour
    #[arg(long, value_name = "RGB", value_parser = rgb, allow_negative_numbers = true)]
    radius_mm: Option<DVec3>,
    #[arg(long, value_name = "WHICH", value_parser = conventions(), help = format!(
        "What --radius-mm is (docs/materials.md): {}; {} where it is not given", conventions_in_words(), Radius::default().word()))]
    radius_convention: Option<Radius>,
}

/// The conventions by their words.
fn conventions() -> impl TypedValueParser<Value = Radius> {
    PossibleValuesParser::new(Radius::ALL.map(Radius::word)).try_map(|word| word.parse::<Radius>())
}

/// What each convention is, for the help.
fn conventions_in_words() -> String {
    let words = |radius: Radius| match radius {
        Radius::MeanFreePath => "mfp, the mean free path 1/sigma_t'",
        Radius::DiffusionLength => "diffusion, 1/sigma_tr (Random Walk (Skin) of Cycles)",
        Radius::Cycles => "cycles, Radius times Scale of Christensen-Burley and Random Walk, 4 pi mfp",
        Radius::Burley => "burley, d of Christensen and Burley",
        Radius::OpenPbr => "openpbr, subsurface_radius times its scale, 1/sigma_t unreduced",
    };
    Radius::ALL.map(words).join("; ")
}

/// How light spreads below the surface.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Material")]
pub(super) struct ProfileArg {
    #[arg(long, value_name = "PROFILE", help = format!("Diffuse reflectance profile: dipole[:from=2], better-dipole, photon-beam, \
        burley[:fit=searchlight|diffuse|dmfp], slab:thickness=MM, layers:path=FILE.toml, gaussians:skin, \
        gaussians:path=FILE.csv, measured[:interpolation=log|linear]:path=FILE.csv. {}", without_transport()))]
    profile: Option<String>,
}

/// Help text on where options apply that ask for another profile, size or mesh than the bake's.
pub(super) fn without_transport() -> String {
    let registry = crate::methods::built_in();
    let gathers =
        |method: &&&'static dyn Method| method.default_recipe().is_ok_and(|recipe| !recipe.form.holds_transport());
    let names: Vec<&str> = registry.methods().iter().filter(gathers).map(|method| method.name()).collect();
    format!(
        "Where no transport is stored, as by default with {} (`translux inspect` says it of an asset)",
        names.join(", ")
    )
}

/// Tells what became of looks: a line each, and a warning where a colour is out of reach. Reports keep them.
pub(super) fn tell(looks: &[AskedLook], console: &Console) {
    let triple = |v: DVec3| v.to_array().map(significant).join(" ");
    for AskedLook { name, found } in
        looks.iter().filter(|look| console.keep_look(LookReport::of(&look.name, &look.found)))
    {
        let (target, inversion) = (&found.target, &found.inversion);
        let [asked, achieved] =
            [inversion.asked, inversion.achieved].map(|c| format!("{} ({})", hex_from_linear(c), triple(c)));
        let (radius, mm) = (target.radius.name(), triple(target.radius_mm));
        let [scattering, absorption] =
            [inversion.properties.sigma_s_reduced_per_mm, inversion.properties.sigma_a_per_mm].map(triple);
        console.note(&format!(
            "LOOK {name}: asked {asked}, achieved {achieved}, {radius} {mm} mm | sigma_s' {scattering}, sigma_a {absorption} per mm, RGB"
        ));
        if !inversion.is_reached() {
            let gap = inversion.gap();
            let off: Vec<String> = ["red", "green", "blue"]
                .into_iter()
                .zip(gap.to_array())
                .filter(|(_, gap)| gap.abs() > REACHED)
                .map(|(channel, gap)| format!("{channel} {gap:+.3}"))
                .collect();
            let (eta, off) = (target.eta_inside_over_outside, off.join(", "));
            console.fault(&format!(
                "the colour {asked} of {name} is out of reach at eta {eta}: nearest is {achieved}, off by {off} in linear light"
            ));
        }
    }
}

/// Tells what became of materials of which only the file speaks, a line each.
pub(super) fn tell_from_file(materials: &[FromFile], console: &Console) {
    let triple = |v: DVec3| v.to_array().map(significant).join(" ");
    let guessed: Vec<&str> = materials.iter().filter(|m| m.is_guessed()).map(|m| m.name.as_str()).collect();
    if let [first, ..] = guessed[..] {
        console.note(&format!(
            "MATERIAL {}: guessed, since neither the file nor an option says what it is made of; --material '{first}=marble' or another of \
             `translux materials` says it",
            guessed.join(", ")
        ));
    }
    for FromFile { name, chosen, source, albedo_and_colour, .. } in materials.iter().filter(|m| !m.is_guessed()) {
        let (Some(chosen), Some(source)) = (chosen, source) else {
            console.note(&format!(
                "MATERIAL {name}: opaque, as the file says nothing of its inside (--material '{name}=wax' makes it a medium, --skip '{name}' \
                 leaves it out)"
            ));
            continue;
        };
        let properties = &chosen.material.properties;
        let [scattering, absorption] = [properties.sigma_s_reduced_per_mm, properties.sigma_a_per_mm].map(triple);
        let [g, eta] = [properties.g, properties.eta_inside_over_outside].map(significant);
        // The line of its look says what was asked for and what the medium is.
        let details = albedo_and_colour.map(|[multiple, colour]| {
            format!(
                " | asked multi-scatter albedo {}, seen as {} ({}) | sigma_s' {scattering}, sigma_a {absorption} per mm, RGB",
                triple(multiple),
                hex_from_linear(colour),
                triple(colour)
            )
        });
        console
            .note(&format!("MATERIAL {name}: {source} of the file, g {g}, eta {eta}{}", details.unwrap_or_default()));
    }
}

impl ProfileArg {
    /// Returns whether a profile was given.
    pub(super) fn is_given(&self) -> bool {
        self.profile.is_some()
    }

    /// The profile that was given, otherwise the dipole.
    pub(super) fn model(&self) -> Result<ProfileModel> {
        self.profile.as_deref().map_or(Ok(ProfileModel::Dipole), ProfileModel::parse)
    }

    /// What looks are inverted through: the profile.
    pub(super) fn reflector(&self) -> Result<Reflector> {
        Ok(self.model()?.load()?.into())
    }

    /// Puts the profile in force and adds its name to those of the media.
    pub(super) fn put(&self, evaluator: &mut dyn Evaluator) -> Result<()> {
        let model = self.model()?;
        if model == ProfileModel::Dipole {
            return Ok(());
        }
        evaluator.set_profile(model.load()?)?;
        let named = |m: &Medium| Medium { name: format!("{} ({model})", m.name), properties: m.properties };
        evaluator.set_media(evaluator.scene().media.iter().map(named).collect())
    }
}

impl MediumArgs {
    /// The choice of materials with its overrides; looks are inverted through `reflector`.
    pub(super) fn choice(&self, reflector: Reflector) -> MaterialChoice {
        let overrides = Overrides {
            sigma_s_per_mm: self.sigma_s,
            sigma_a_per_mm: self.sigma_a,
            g: self.g,
            eta_inside_over_outside: self.eta,
            ..Overrides::default()
        };
        let look = Look { colour: self.color, radius_mm: self.radius_mm, radius: self.radius_convention };
        MaterialChoice { texts: self.material.clone(), overrides, look, reflector, guess: false }
    }
}

/// A number, or three separated by commas.
fn rgb(text: &str) -> std::result::Result<DVec3, String> {
    let numbers: Vec<f64> = text
        .split(',')
        .map(|part| part.trim().parse::<f64>().map_err(|_| format!("`{part}` is not a number")))
        .collect::<std::result::Result<_, _>>()?;
    match numbers[..] {
        [v] => Ok(DVec3::splat(v)),
        [r, g, b] => Ok(DVec3::new(r, g, b)),
        _ => Err("one number or three separated by commas are needed".to_owned()),
    }
}
