//! Methods: names, of papers or our own, for choices of forms and their settings; and the registry of both.

use std::collections::BTreeMap;
use std::sync::Arc;

use translux_format::RawSection;
use translux_format::calibration::Calibration;
use translux_format::metadata::tags;

use super::evaluator::Evaluator;
use super::form::{AnyForm, BakeSettings, Model, Opener, RegisteredForm, read_error};
use super::keys::{AnyKey, Keys};
use super::model_error::ModelWalks;
use crate::asset::{Asset, Provenance};
use crate::error::{Error, Result};
use crate::light::LightKind;
use crate::progress::Progress;
use crate::scene::Scene;

/// What is known of a method before it is asked for anything.
#[derive(Clone, Copy)]
pub struct About {
    /// Name on the command line and in the asset.
    pub name: &'static str,
    /// One line for people: what it is, and its paper.
    pub summary: &'static str,
    /// Advice on when to choose it, in one or two sentences.
    pub choose_when: &'static str,
    /// Keys that `--set` takes.
    pub keys: &'static [&'static dyn AnyKey],
    /// Error that a bake aims at unless another one is asked for.
    pub default_max_rms: f64,
    /// Largest relative error of a method that is an approximation by design; the errors that its evaluators measure
    /// stay below. None where the error is as small as it is asked to be.
    pub declared_error: Option<f64>,
    /// Settings that charts compare, as options of `bake`, the defaults (no options) first: from fast or small to
    /// exact.
    pub ladder: &'static [&'static str],
}

/// A name for a choice of a form and its settings.
pub trait Method: Sync {
    /// Its name, its keys and what is said of it.
    fn about(&self) -> About;

    /// Choices of its keys that a plan considers, as `(key, value)`; none for methods that are baked when they are named alone.
    fn planned(&self) -> &'static [&'static [(&'static str, &'static str)]] {
        &[]
    }

    /// The form and settings that the keys choose.
    ///
    /// # Errors
    /// Command line: values that do not go together; unsupported: kinds of light that it does not serve.
    fn form(&self, keys: &Keys, settings: &BakeSettings) -> Result<Box<dyn AnyForm>>;
}

impl<'a> dyn Method + 'a {
    /// Name on the command line and in the asset.
    pub fn name(&self) -> &'static str {
        self.about().name
    }

    /// Keys that `--set` takes.
    pub fn keys(&self) -> &'static [&'static dyn AnyKey] {
        self.about().keys
    }

    /// Error that a bake aims at unless another one is asked for.
    pub fn default_max_rms(&self) -> f64 {
        self.about().default_max_rms
    }

    /// The recipe for keys as typed.
    ///
    /// # Errors
    /// Keys that are unknown, have no meaning beside the others or a value out of range; those of [`Method::form`].
    pub fn recipe(&self, given: &[(String, String)], settings: BakeSettings) -> Result<Recipe> {
        let keys = Keys::new(self.name(), self.keys(), given)?;
        let form = self.form(&keys, &settings)?;
        if let Some((name, text)) = keys.unread() {
            let needed = match self.gives_meaning(name, given, &settings) {
                choices if choices.is_empty() => "it means nothing beside the other keys; leave it out".to_owned(),
                choices => {
                    format!("it means something with {} only; set that too, or leave this out", choices.join(" or "))
                }
            };
            return Err(Error::command_line(format!("--set {name}={text}: {needed}")));
        }
        if !form.serves(settings.model) {
            return Err(Error::unsupported(format!(
                "the transport of `{}` with these settings holds the dipole: use --model dipole, or a method \
                 that can follow another, such as two_pass or all_frequency",
                self.name()
            )));
        }
        Ok(Recipe { method: self.name(), form, texts: keys.into_texts(), settings })
    }

    /// The single choices, `key=word`, that would have the method read a key.
    fn gives_meaning(&self, name: &str, given: &[(String, String)], settings: &BakeSettings) -> Vec<String> {
        let choices = self.keys().iter().flat_map(|key| key.words().into_iter().map(|word| (key.name(), word)));
        let reads = |(key, word): &(&'static str, &'static str)| {
            let others = given.iter().filter(|(other, _)| other != key).cloned();
            let tried: Vec<_> = others.chain([((*key).to_owned(), (*word).to_owned())]).collect();
            let Ok(keys) = Keys::new(self.name(), self.keys(), &tried) else { return false };
            self.form(&keys, settings).is_ok() && keys.was_read(name)
        };
        choices.filter(|(key, _)| *key != name).filter(reads).map(|(key, word)| format!("{key}={word}")).collect()
    }

    /// The recipe of the default keys.
    ///
    /// # Errors
    /// As `recipe`: none for a method whose defaults fit.
    pub fn default_recipe(&self) -> Result<Recipe> {
        self.recipe(&[], BakeSettings::new(self.default_max_rms()))
    }

    /// Kinds of light that its evaluators serve with the default keys.
    pub fn kinds(&self) -> &'static [LightKind] {
        self.default_recipe().map_or(&[], |recipe| recipe.form.kinds())
    }
}

/// A bake with every choice resolved.
pub struct Recipe {
    /// Name of the method.
    pub method: &'static str,
    /// The form with its settings.
    pub form: Box<dyn AnyForm>,
    /// Value of every key as text, for display.
    pub texts: BTreeMap<String, String>,
    /// Settings of the bake beside the keys.
    pub settings: BakeSettings,
}

impl Recipe {
    /// Memory that a bake of this scene takes, in bytes, estimated before the work.
    pub fn bake_memory(&self, scene: &Scene) -> u64 {
        self.form.bake_memory(scene, &self.settings)
    }

    /// Bakes a scene into an asset, which records the form, its settings and its provenance.
    ///
    /// # Errors
    /// Errors of the form.
    pub fn bake(&self, scene: Scene, provenance: Provenance, progress: &dyn Progress) -> Result<Asset> {
        Ok(self.baked(scene, provenance, progress)?.0)
    }

    /// [`Self::bake`], and the asset's evaluator where the bake has made it or most of it.
    ///
    /// # Errors
    /// Errors of the form.
    pub fn bake_and_open(
        &self,
        scene: Scene,
        provenance: Provenance,
        progress: &dyn Progress,
    ) -> Result<(Asset, Option<Box<dyn Evaluator>>)> {
        let (asset, opener) = self.baked(scene, provenance, progress)?;
        let evaluator = opener.map(|open| open(Arc::new(asset.clone()))).transpose()?;
        Ok((asset, evaluator))
    }

    fn baked(
        &self,
        scene: Scene,
        mut provenance: Provenance,
        progress: &dyn Progress,
    ) -> Result<(Asset, Option<Opener>)> {
        let parts = self.form.bake(&scene, &self.settings.with_probes_of_kinds(), progress)?;
        provenance.method = self.method.to_owned();
        provenance.settings.extend(self.texts.clone());
        let kinds: Vec<&str> = self.settings.for_lights.iter().map(|kind| kind.name()).collect();
        provenance.settings.extend([
            ("max-rms".to_owned(), self.settings.max_rms.to_string()),
            ("for-lights".to_owned(), kinds.join(",")),
            ("samples".to_owned(), parts.samples.len().to_string()),
        ]);
        if self.settings.samples_stored {
            provenance.settings.insert("store".to_owned(), "samples".to_owned());
        }
        if let Model::Calibrated(_) = self.settings.model {
            provenance.settings.insert("model".to_owned(), "calibrated".to_owned());
        }
        let sections = self.form.record()?.into_iter().chain(parts.sections).collect();
        let samples_stored = self.settings.samples_stored;
        let mut asset =
            Asset { scene, samples: parts.samples, samples_stored, provenance, ledger: parts.ledger, sections };
        if let Model::Calibrated(calibration) = self.settings.model
            && self.settings.tells_model
        {
            let walks = match &self.settings.walks {
                Some(walks) => Some(Arc::clone(walks)),
                // No part that walks could calibrate is one that they could tell the error of.
                None if !any_is_calibrated(&asset)? => None,
                None => ModelWalks::new(&asset.scene, calibration.photons, progress)?.map(Arc::new),
            };
            if let Some(walks) = walks {
                let finished = Arc::new(asset.clone());
                let mut evaluator = match parts.opener {
                    Some(open) => open(finished)?,
                    None => self.form.open(finished)?,
                };
                walks.enter(evaluator.as_mut(), &mut asset.ledger, progress)?;
                return Ok((asset, Some(Box::new(|_| Ok(evaluator)))));
            }
        }
        Ok((asset, parts.opener))
    }
}

/// True if walks calibrated a part of an asset.
fn any_is_calibrated(asset: &Asset) -> Result<bool> {
    let numbers = Calibration::numbers(&asset.sections).map_err(read_error)?;
    Ok(numbers.is_some_and(|numbers| numbers.parts.iter().any(Option::is_some)))
}

/// The methods that can be chosen and the forms that can be opened.
#[derive(Clone, Default)]
pub struct Registry {
    methods: Vec<&'static dyn Method>,
    forms: Vec<RegisteredForm>,
}

impl Registry {
    /// The registry with another method.
    #[must_use]
    pub fn with_method(mut self, method: &'static dyn Method) -> Self {
        self.methods.push(method);
        self
    }

    /// The registry with another form.
    #[must_use]
    pub fn with_form(mut self, form: RegisteredForm) -> Self {
        self.forms.push(form);
        self
    }

    /// Every method, in the order of listings.
    pub fn methods(&self) -> &[&'static dyn Method] {
        &self.methods
    }

    /// Every form.
    pub fn forms(&self) -> &[RegisteredForm] {
        &self.forms
    }

    /// The method of a name.
    ///
    /// # Errors
    /// Command line: no such method; the message lists them.
    pub fn method(&self, name: &str) -> Result<&'static dyn Method> {
        self.methods.iter().copied().find(|method| method.name() == name).ok_or_else(|| {
            let names: Vec<&str> = self.methods.iter().map(|method| method.name()).collect();
            Error::command_line(format!("no method `{name}`; there are {}", names.join(", ")))
        })
    }

    /// The form of an asset, with the settings that it was baked with.
    ///
    /// # Errors
    /// Invalid input: no record of them, or one out of range; unsupported: a form that is not here.
    pub fn form(&self, asset: &Asset) -> Result<Box<dyn AnyForm>> {
        self.form_of(&asset.sections)
    }

    /// The form that some sections name.
    ///
    /// # Errors
    /// As [`Self::form`].
    pub fn form_of(&self, sections: &[RawSection]) -> Result<Box<dyn AnyForm>> {
        let section = |tag| {
            sections.iter().find(|section| section.tag == tag).ok_or_else(|| {
                Error::input(format!("an asset without section {tag}, which says how to read it; bake it again"))
            })
        };
        let name: String = section(tags::FORM)?.record().map_err(read_error)?;
        let form = self.forms.iter().find(|form| form.name == name).ok_or_else(|| {
            Error::unsupported(format!("transport in the form `{name}`, which this build does not have"))
        })?;
        (form.read)(section(tags::SETTINGS)?)
    }

    /// The evaluator of an asset.
    ///
    /// # Errors
    /// As [`Self::form`]; sections that are missing or do not fit.
    pub fn open(&self, asset: Arc<Asset>) -> Result<Box<dyn Evaluator>> {
        self.form(&asset)?.open(asset)
    }
}
