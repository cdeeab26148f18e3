//! Media for the materials of a model, or in place of those of a scene, by name.

use std::path::PathBuf;

use super::file::suffix;
use crate::error::{Error, Result};
use crate::geometry::mesh::material_indices;
use crate::geometry::part_table::PartEntry;
use crate::medium::material::{Material, Medium, Overrides};
use crate::scene::Scene;

/// Optical properties as named by a user.
#[derive(Clone, Debug, Default)]
pub struct MaterialChoice {
    /// Measured materials or TOML files; with `NAME=` in front, for that material of the model or part of the scene,
    /// otherwise for all others.
    pub texts: Vec<String>,
    /// Properties that replace those of the material without a name.
    pub overrides: Overrides,
}

/// Media of a model, and the assignment of its materials to them.
pub struct ModelMedia {
    /// Each medium once.
    pub media: Vec<Medium>,
    /// Materials of the model with a medium of their own, and its index.
    pub by_name: Vec<(String, u32)>,
    /// Index of the medium of all other materials.
    pub rest: u32,
}

impl From<Material> for Medium {
    fn from(Material { name, properties }: Material) -> Self {
        Self { name, properties }
    }
}

impl MaterialChoice {
    /// One measured material or TOML file for everything.
    pub fn plain(text: &str) -> Self {
        Self { texts: vec![text.to_owned()], overrides: Overrides::default() }
    }

    /// The material files among the texts.
    pub fn files(&self) -> impl Iterator<Item = PathBuf> {
        let texts = self.texts.iter().map(|text| text.split_once('=').map_or(text.as_str(), |(_, text)| text));
        texts.map(PathBuf::from).filter(|path| suffix(path) == "toml")
    }

    /// Media for a model with these materials; those in `translucent` need one.
    ///
    /// # Errors
    /// Unknown names, two materials without one, or a translucent material of the model without a medium.
    pub fn of_model(&self, materials: &[String], translucent: &[&str]) -> Result<ModelMedia> {
        let mut media = Vec::new();
        let mut index_of = |medium: Medium| {
            let known = media.iter().position(|m| *m == medium).unwrap_or_else(|| {
                media.push(medium);
                media.len() - 1
            });
            known as u32
        };
        let plain = self.without_name()?.map(&mut index_of);
        let by_name: Vec<(String, u32)> =
            self.named()?.into_iter().map(|(name, medium)| (name, index_of(medium))).collect();
        let Some(rest) = plain.or_else(|| by_name.first().map(|(_, index)| *index)) else {
            return Err(Error::command_line(
                "what is it made of? say for example --material marble (see `translux materials`), or --sigma-s and --sigma-a",
            ));
        };
        let named: Vec<String> = by_name.iter().map(|(name, _)| name.clone()).collect();
        material_indices(materials, &named, "--material")?;
        let left: Vec<&str> = translucent.iter().copied().filter(|m| !named.iter().any(|n| n == m)).collect();
        if plain.is_none() && !left.is_empty() {
            let left = left.join(", ");
            return Err(Error::command_line(format!(
                "no material for {left}: add a plain --material for the rest, or --opaque or --skip them"
            )));
        }
        Ok(ModelMedia { media, by_name, rest })
    }

    /// The media of a scene after this choice; none where the choice is empty.
    ///
    /// Names are those of parts or media. Overrides without a material change the properties that each medium has.
    ///
    /// # Errors
    /// Unknown names, and a name of one part among several that share a medium.
    pub fn of_scene(&self, scene: &Scene) -> Result<Option<Vec<Medium>>> {
        if self.texts.is_empty() && !self.overrides.is_empty() {
            let changed = |m: &Medium| {
                let base = Material { name: m.name.clone(), properties: m.properties };
                Material::from_flags(Some(base), &self.overrides).map(Medium::from)
            };
            return scene.media.iter().map(changed).collect::<Result<_>>().map(Some);
        }
        let (plain, named) = (self.without_name()?, self.named()?);
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

    /// The material without a name, if any.
    fn without_name(&self) -> Result<Option<Medium>> {
        let plain: Vec<&String> = self.texts.iter().filter(|m| !m.contains('=')).collect();
        if let [_, second, ..] = plain[..] {
            return Err(Error::command_line(format!(
                "--material {second}: a second one without NAME=; only one material can be the rest's"
            )));
        }
        let base = plain.first().map(|text| Material::from_argument(text)).transpose()?;
        if base.is_none() && self.overrides.is_empty() {
            return Ok(None);
        }
        Ok(Some(Material::from_flags(base, &self.overrides)?.into()))
    }

    /// The materials with a name.
    fn named(&self) -> Result<Vec<(String, Medium)>> {
        let named = self.texts.iter().filter_map(|text| text.split_once('='));
        named.map(|(name, text)| Ok((name.to_owned(), Material::from_argument(text)?.into()))).collect()
    }
}

/// The medium of the part with that name, or the medium with that name.
///
/// Parts of equal material have one medium: an edit through one of them would silently change the others.
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
