//! Media for the materials of a model, or in place of those of a scene, by name.

use std::fmt;
use std::path::PathBuf;

use super::file::suffix;
use super::of_file::{FromFile, OfFile};
use crate::error::{Error, Result};
use crate::geometry::mesh::material_indices;
use crate::geometry::part_table::PartEntry;
use crate::medium::inversion::Reflector;
use crate::medium::look::{Found, Look};
use crate::medium::material::{Material, Medium, Overrides};
use crate::medium::material_file::Chosen;
use crate::scene::Scene;

/// Optical properties as named by a user.
#[derive(Clone, Default)]
pub struct MaterialChoice {
    /// Measured materials or TOML files; with `NAME=` in front, for that material of the model or part of the scene,
    /// otherwise for all others.
    pub texts: Vec<String>,
    /// Properties that replace those of the material without a name.
    pub overrides: Overrides,
    /// A look in place of that material's coefficients.
    pub look: Look,
    /// What looks are inverted through.
    pub reflector: Reflector,
    /// Whether a medium is guessed for materials of a model of which neither a text nor the file says what they are made of.
    pub guess: bool,
}

/// Looks stand only where some are asked for, and what they are inverted through is a matter of the profile and the
/// model: assets keep a hash of this text as their request.
impl fmt::Debug for MaterialChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut text = f.debug_struct("MaterialChoice");
        text.field("texts", &self.texts).field("overrides", &self.overrides);
        if !self.look.is_empty() {
            text.field("look", &self.look);
        }
        if self.guess {
            text.field("guess", &self.guess);
        }
        text.finish()
    }
}

/// A look that was asked for, and what became of it.
#[derive(Clone, Debug, PartialEq)]
pub struct AskedLook {
    /// Name of the medium.
    pub name: String,
    /// What was asked for, and the medium that is nearest.
    pub found: Found,
}

/// Media of a model, and the assignment of its materials to them.
pub struct ModelMedia {
    /// Each medium once.
    pub media: Vec<Medium>,
    /// Materials of the model with a medium of their own, and its index.
    pub by_name: Vec<(String, u32)>,
    /// Index of the medium of all other materials.
    pub rest: u32,
    /// The looks among them.
    pub looks: Vec<AskedLook>,
    /// Materials of which only the file speaks, and what became of them.
    pub from_file: Vec<FromFile>,
}

/// The media of a scene after a choice.
pub struct SceneMedia {
    /// Each medium of the scene.
    pub media: Vec<Medium>,
    /// The looks among them.
    pub looks: Vec<AskedLook>,
}

/// The looks that were asked for, each once.
fn looks<'a>(chosen: impl IntoIterator<Item = &'a Chosen>) -> Vec<AskedLook> {
    let mut looks: Vec<AskedLook> = Vec::new();
    for Chosen { material, look } in chosen {
        let look = look.map(|found| AskedLook { name: material.name.clone(), found });
        looks.extend(look.filter(|look| !looks.contains(look)));
    }
    looks
}

impl From<Material> for Medium {
    fn from(Material { name, properties }: Material) -> Self {
        Self { name, properties }
    }
}

impl MaterialChoice {
    /// One measured material or TOML file for everything.
    pub fn plain(text: &str) -> Self {
        Self { texts: vec![text.to_owned()], ..Self::default() }
    }

    /// The material files among the texts.
    pub fn files(&self) -> impl Iterator<Item = PathBuf> {
        let texts = self.texts.iter().map(|text| text.split_once('=').map_or(text.as_str(), |(_, text)| text));
        texts.map(PathBuf::from).filter(|path| suffix(path) == "toml")
    }

    /// Media for a model with these materials; those in `translucent` need one. Where nothing is chosen for a material, nor
    /// for all others, what its file says of it counts.
    ///
    /// # Errors
    /// Unknown names, two materials without one, or a translucent material of the model without a medium.
    pub fn of_model(&self, materials: &[String], translucent: &[&str], file: &OfFile<'_>) -> Result<ModelMedia> {
        let mut media = Vec::new();
        let mut index_of = |medium: Medium| {
            let known = media.iter().position(|m| *m == medium).unwrap_or_else(|| {
                media.push(medium);
                media.len() - 1
            });
            known as u32
        };
        let (plain, named) = (self.without_name()?, self.named()?);
        let names: Vec<String> = named.iter().map(|(name, _)| name.clone()).collect();
        let is_left = |name: &&str| plain.is_none() && !names.iter().any(|known| known == name);
        let left: Vec<&str> = translucent.iter().copied().filter(is_left).collect();
        let from_file = file.media(&left, &self.reflector, self.guess)?;
        let found = from_file.iter().filter_map(|material| Some((material.name.clone(), material.chosen.clone()?)));
        let named: Vec<(String, Chosen)> = named.into_iter().chain(found).collect();
        let looks = looks(plain.iter().chain(named.iter().map(|(_, chosen)| chosen)));
        let is_plain = plain.is_some();
        let plain = plain.map(|chosen| index_of(chosen.material.into()));
        let by_name: Vec<(String, u32)> =
            named.into_iter().map(|(name, chosen)| (name, index_of(chosen.material.into()))).collect();
        let Some(rest) = plain.or_else(|| by_name.first().map(|(_, index)| *index)) else {
            return Err(Error::command_line(
                "what is it made of? say for example --material marble (see `translux materials`), --color '#e8c4b0' --radius-mm 1, or --sigma-s and --sigma-a",
            ));
        };
        material_indices(materials, &names, "--material")?;
        if !is_plain && from_file.is_empty() && !left.is_empty() {
            let left = left.join(", ");
            return Err(Error::command_line(format!(
                "no material for {left}: add a plain --material for the rest, or --opaque or --skip them"
            )));
        }
        Ok(ModelMedia { media, by_name, rest, looks, from_file })
    }

    /// The media of a scene after this choice; none where the choice is empty.
    ///
    /// Names are those of parts or media. Overrides without a material change the properties that each medium has.
    ///
    /// # Errors
    /// Unknown names, and a name of one part among several that share a medium.
    pub fn of_scene(&self, scene: &Scene) -> Result<Option<SceneMedia>> {
        if self.texts.is_empty() && self.changes() {
            let changed = |m: &Medium| {
                let base = Material { name: m.name.clone(), properties: m.properties };
                Chosen::from_flags(Some(base.into()), &self.overrides, &self.look, &self.reflector)
            };
            let chosen: Vec<Chosen> = scene.media.iter().map(changed).collect::<Result<_>>()?;
            let looks = looks(&chosen);
            return Ok(Some(SceneMedia { media: chosen.into_iter().map(|c| c.material.into()).collect(), looks }));
        }
        let (plain, named) = (self.without_name()?, self.named()?);
        if plain.is_none() && named.is_empty() {
            return Ok(None);
        }
        let looks = looks(plain.iter().chain(named.iter().map(|(_, chosen)| chosen)));
        let mut media = scene.media.clone();
        if let Some(plain) = plain {
            media.fill(plain.material.into());
        }
        for (name, chosen) in named {
            let Some(index) = medium_named(scene, &name)? else {
                let mut known: Vec<&str> = scene.parts.parts.iter().map(|p| p.name.as_str()).collect();
                known.extend(scene.media.iter().map(|m| m.name.as_str()));
                let known = known.join(", ");
                return Err(Error::command_line(format!(
                    "--material {name}=...: no such part or medium; there are {known}"
                )));
            };
            media[index] = chosen.material.into();
        }
        Ok(Some(SceneMedia { media, looks }))
    }

    /// Returns whether the material without a name is changed, or made of nothing.
    fn changes(&self) -> bool {
        !self.overrides.is_empty() || !self.look.is_empty()
    }

    /// The material without a name, if any.
    fn without_name(&self) -> Result<Option<Chosen>> {
        let plain: Vec<&String> = self.texts.iter().filter(|m| !m.contains('=')).collect();
        if let [_, second, ..] = plain[..] {
            return Err(Error::command_line(format!(
                "--material {second}: a second one without NAME=; only one material can be the rest's"
            )));
        }
        let base = plain.first().map(|text| Chosen::from_argument(text, &self.reflector)).transpose()?;
        if base.is_none() && !self.changes() {
            return Ok(None);
        }
        Chosen::from_flags(base, &self.overrides, &self.look, &self.reflector).map(Some)
    }

    /// The materials with a name.
    fn named(&self) -> Result<Vec<(String, Chosen)>> {
        let named = self.texts.iter().filter_map(|text| text.split_once('='));
        named.map(|(name, text)| Ok((name.to_owned(), Chosen::from_argument(text, &self.reflector)?))).collect()
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
