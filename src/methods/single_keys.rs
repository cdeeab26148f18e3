//! Keys of the integrand of single scattering, which the methods that have it share.

use std::collections::BTreeMap;

use crate::error::{Error, Result};
use crate::evaluate::Key;
use crate::transport::single_scattering::{Crossings, Form};

/// Which form of equation (4) of Wang, Tran and Luebke 2005.
pub(in crate::methods) const FORM: Key = Key {
    name: "single-form",
    default: "physical",
    help: "integrand of single scattering: physical, or printed (the paper's, without the refraction factor: 2 to 3 times as bright)",
};

/// What becomes of light whose straight way crosses further surfaces.
pub(in crate::methods) const CROSSINGS: Key = Key {
    name: "single-crossings",
    default: "occluded",
    help: "light of single scattering that meets another body or fold on its way: occluded (the paper's) or attenuated (it passes \
           translucent ones)",
};

/// What is integrated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(in crate::methods) struct Integrand {
    pub(in crate::methods) form: Form,
    pub(in crate::methods) crossings: Crossings,
}

impl Integrand {
    /// What the keys ask for.
    ///
    /// # Errors
    /// Another value (command line).
    pub(in crate::methods) fn new(values: &BTreeMap<String, String>) -> Result<Self> {
        let text = |key: &Key| values.get(key.name).map_or(key.default, String::as_str).to_owned();
        let fail = |key: &Key, found: &str, known: &str| {
            Err(Error::command_line(format!("--set {}={found}: it is {known}", key.name)))
        };
        let form = match text(&FORM).as_str() {
            "physical" => Form::Physical,
            "printed" => Form::Printed,
            other => return fail(&FORM, other, "physical or printed"),
        };
        let crossings = match text(&CROSSINGS).as_str() {
            "occluded" => Crossings::Occluded,
            "attenuated" => Crossings::Attenuated,
            other => return fail(&CROSSINGS, other, "occluded or attenuated"),
        };
        Ok(Self { form, crossings })
    }

    /// Refuses other values than the defaults where there is no single scattering.
    ///
    /// # Errors
    /// Command line.
    pub(in crate::methods) fn check_unused(values: &BTreeMap<String, String>) -> Result<()> {
        let given = |key: &&Key| values.get(key.name).is_some_and(|text| text != key.default);
        match [&FORM, &CROSSINGS].into_iter().find(given) {
            Some(key) => Err(Error::command_line(format!(
                "--set {}: there is no single scattering (--set single-scattering)",
                key.name
            ))),
            None => Ok(()),
        }
    }
}
