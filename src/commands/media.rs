//! `--material` and its companions: optical properties for a model's materials, or in place of an asset's.

use clap::Args;
use glam::DVec3;

use crate::error::Result;
use crate::evaluate::{Evaluator, Method};
use crate::import::materials::MaterialChoice;
use crate::medium::material::{Medium, Overrides};
use crate::medium::profiles::model::ProfileModel;

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
}

/// How light spreads below the surface.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Material")]
pub(super) struct ProfileArg {
    #[arg(long, value_name = "PROFILE", help = format!("Diffuse reflectance profile: dipole, better-dipole, photon-beam, \
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

impl ProfileArg {
    /// Returns whether a profile was given.
    pub(super) fn is_given(&self) -> bool {
        self.profile.is_some()
    }

    /// The profile that was given, otherwise the dipole.
    pub(super) fn model(&self) -> Result<ProfileModel> {
        self.profile.as_deref().map_or(Ok(ProfileModel::Dipole), ProfileModel::parse)
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
    /// The choice of materials with its overrides.
    pub(super) fn choice(&self) -> MaterialChoice {
        let overrides = Overrides {
            sigma_s_per_mm: self.sigma_s,
            sigma_a_per_mm: self.sigma_a,
            g: self.g,
            eta_inside_over_outside: self.eta,
            ..Overrides::default()
        };
        MaterialChoice { texts: self.material.clone(), overrides }
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
