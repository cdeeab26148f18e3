//! `--material` and its companions: optical properties for a model's materials, or in place of an asset's.

use std::path::PathBuf;

use clap::Args;
use glam::DVec3;

use crate::error::{Error, Result};
use crate::evaluate::Evaluator;
use crate::geometry::mesh::material_indices;
use crate::geometry::part_table::PartEntry;
use crate::medium::material::{Material, OpticalProperties, Overrides};
use crate::medium::profiles::model::ProfileModel;
use crate::transport::scene::{Medium, Scene};

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
    /// Diffuse reflectance profile, where samples are gathered at run time (two_pass, reference): dipole, better-dipole, photon-beam,
    /// burley[:fit=searchlight|diffuse|dmfp], slab:thickness=MM, layers:path=FILE.toml, gaussians:skin, gaussians:path=FILE.csv,
    /// measured[:interpolation=log|linear]:path=FILE.csv
    #[arg(long, value_name = "PROFILE")]
    profile: Option<String>,
}

impl ProfileArg {
    /// Whether there is one.
    pub(super) fn is_given(&self) -> bool {
        self.profile.is_some()
    }

    /// The profile that is asked for; the dipole without one.
    pub(super) fn model(&self) -> Result<ProfileModel> {
        self.profile.as_deref().map_or(Ok(ProfileModel::Dipole), ProfileModel::parse)
    }

    /// Puts the profile in force and its name beside those of the media.
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

/// Media of a model and who has which.
pub(super) struct ResolvedMedia {
    pub(super) media: Vec<Medium>,
    pub(super) by_name: Vec<(String, u32)>,
    pub(super) rest: u32,
}

impl MediumArgs {
    fn overrides(&self) -> Overrides {
        Overrides {
            sigma_s_per_mm: self.sigma_s,
            sigma_a_per_mm: self.sigma_a,
            g: self.g,
            eta_inside_over_outside: self.eta,
            ..Overrides::default()
        }
    }

    /// Material files among the arguments.
    pub(super) fn files(&self) -> impl Iterator<Item = PathBuf> {
        let texts = self.material.iter().map(|text| text.split_once('=').map_or(text.as_str(), |(_, text)| text));
        texts.map(PathBuf::from).filter(|path| super::output::suffix(path) == "toml")
    }

    /// A medium with what these arguments say in place of its own.
    fn changed(&self, medium: &Medium) -> Result<Medium> {
        let base = Material { name: medium.name.clone(), properties: medium.properties };
        let material = Material::from_flags(Some(base), &self.overrides())?;
        Ok(Medium { name: material.name, properties: material.properties })
    }

    /// The plain material of these arguments, if any.
    fn plain(&self) -> Result<Option<Medium>> {
        let plain: Vec<&String> = self.material.iter().filter(|m| !m.contains('=')).collect();
        if let [_, second, ..] = plain[..] {
            return Err(Error::command_line(format!(
                "--material {second}: a second one without NAME=; only one material can be the rest's"
            )));
        }
        let base = plain.first().map(|text| Material::from_argument(text)).transpose()?;
        let overrides = self.overrides();
        if base.is_none() && overrides.is_empty() {
            return Ok(None);
        }
        let material = Material::from_flags(base, &overrides)?;
        Ok(Some(Medium { name: material.name, properties: material.properties }))
    }

    /// Materials given by name.
    fn named(&self) -> Result<Vec<(String, Medium)>> {
        self.material
            .iter()
            .filter_map(|text| text.split_once('='))
            .map(|(name, text)| {
                let material = Material::from_argument(text)?;
                Ok((name.to_owned(), Medium { name: material.name, properties: material.properties }))
            })
            .collect()
    }

    /// Media for a model with these materials, of which `translucent` need one.
    pub(super) fn resolve(&self, materials: &[String], translucent: &[&str]) -> Result<ResolvedMedia> {
        let mut media = Vec::new();
        let mut index_of = |medium: Medium| {
            let known = media.iter().position(|m| *m == medium).unwrap_or_else(|| {
                media.push(medium);
                media.len() - 1
            });
            known as u32
        };
        let plain = self.plain()?;
        let rest = plain.map(&mut index_of);
        let by_name: Vec<(String, u32)> =
            self.named()?.into_iter().map(|(name, medium)| (name, index_of(medium))).collect();
        let Some(rest) = rest.or_else(|| by_name.first().map(|(_, index)| *index)) else {
            return Err(Error::command_line(
                "what is it made of? say for example --material marble (see `translux materials`), or --sigma-s and --sigma-a",
            ));
        };
        let named: Vec<String> = by_name.iter().map(|(name, _)| name.clone()).collect();
        material_indices(materials, &named, "--material")?;
        if self.plain()?.is_none() {
            let left: Vec<&str> = translucent.iter().copied().filter(|m| !named.iter().any(|n| n == m)).collect();
            if !left.is_empty() {
                let left = left.join(", ");
                return Err(Error::command_line(format!(
                    "no material for {left}: add a plain --material for the rest, or --opaque or --skip them"
                )));
            }
        }
        Ok(ResolvedMedia { media, by_name, rest })
    }
}

/// Replaces the media of a scene by `--material` and its companions; `None` where they say nothing.
pub(super) fn edited_media(arguments: &MediumArgs, scene: &Scene) -> Result<Option<Vec<Medium>>> {
    if arguments.material.is_empty() && !arguments.overrides().is_empty() {
        return scene.media.iter().map(|m| arguments.changed(m)).collect::<Result<_>>().map(Some);
    }
    let (plain, named) = (arguments.plain()?, arguments.named()?);
    if plain.is_none() && named.is_empty() {
        return Ok(None);
    }
    let mut media = scene.media.clone();
    if let Some(plain) = plain {
        media.fill(plain);
    }
    for (name, medium) in named {
        let Some(index) = medium_named(scene, &name)? else {
            let mut known: Vec<&str> = scene.parts.parts.iter().map(|p| p.name.as_str()).collect();
            known.extend(scene.media.iter().map(|m| m.name.as_str()));
            let known = known.join(", ");
            return Err(Error::command_line(format!(
                "--material {name}=...: no such part or medium; there are {known}"
            )));
        };
        media[index] = medium;
    }
    Ok(Some(media))
}

/// The medium of a part of that name, or the medium itself.
///
/// Parts of equal material have one medium: to edit it through one of them would change the others in silence.
fn medium_named(scene: &Scene, name: &str) -> Result<Option<usize>> {
    let parts = &scene.parts.parts;
    let Some(medium) = parts.iter().find(|p| p.name == name).and_then(|p| p.medium) else {
        return Ok(scene.media.iter().position(|m| m.name == name));
    };
    let sharing = |p: &&PartEntry| p.medium == Some(medium) && p.name != name;
    let others: Vec<&str> = parts.iter().filter(sharing).map(|p| p.name.as_str()).collect();
    match scene.media.get(medium as usize) {
        Some(shared) if !others.is_empty() => {
            let (others, shared) = (others.join(", "), &shared.name);
            Err(Error::command_line(format!(
                "--material {name}=...: {name} and {others} are one medium; edit all of them by --material {shared}=..., \
                 or bake them with different materials"
            )))
        }
        _ => Ok(Some(medium as usize)),
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

/// Optical properties as a report shows them.
#[derive(serde::Serialize)]
pub(super) struct MediumReport {
    name: String,
    #[serde(flatten)]
    properties: OpticalProperties,
    mean_free_path_mm: [f64; 3],
    /// Null where nothing absorbs.
    diffusion_length_mm: [Option<f64>; 3],
}

impl MediumReport {
    pub(super) fn of(medium: &Medium) -> Self {
        let finite = |v: f64| v.is_finite().then_some(v);
        Self {
            name: medium.name.clone(),
            properties: medium.properties,
            mean_free_path_mm: medium.properties.mean_free_path_mm().to_array(),
            diffusion_length_mm: medium.properties.diffusion_length_mm().to_array().map(finite),
        }
    }
}
