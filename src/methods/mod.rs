//! The precomputation methods. A method is one folder and one line in [`ALL`].

pub mod reference;
pub mod sampling;
pub mod settings;
pub mod two_pass;

use crate::error::{Error, Result};
use crate::evaluate::Method;

/// Every method.
pub const ALL: [&dyn Method; 2] = [&reference::Reference, &two_pass::TwoPass];

/// The method of a name.
///
/// # Errors
/// Command line: no such method; the message lists them.
pub fn named(name: &str) -> Result<&'static dyn Method> {
    ALL.into_iter().find(|m| m.name() == name).ok_or_else(|| {
        let names: Vec<&str> = ALL.iter().map(|m| m.name()).collect();
        Error::command_line(format!("no method `{name}`; there are {}", names.join(", ")))
    })
}
