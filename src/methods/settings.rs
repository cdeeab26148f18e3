//! Values of `--set key=value`: defaults filled in, unknown keys refused, numbers parsed.

use std::collections::BTreeMap;
use std::str::FromStr;

use crate::error::{Error, Result};
use crate::evaluate::{Key, Method};

/// All keys of a method with the given values or their defaults.
///
/// # Errors
/// Command line: a key that the method does not have.
pub fn resolve(method: &dyn Method, given: &[(String, String)]) -> Result<BTreeMap<String, String>> {
    let mut values: BTreeMap<String, String> =
        method.keys().iter().map(|k| (k.name.to_owned(), k.default.to_owned())).collect();
    for (key, value) in given {
        match values.get_mut(key) {
            Some(slot) => slot.clone_from(value),
            None => {
                let keys: Vec<&str> = method.keys().iter().map(|k| k.name).collect();
                let name = method.name();
                let keys = if keys.is_empty() { "none".to_owned() } else { keys.join(", ") };
                return Err(Error::command_line(format!("--set {key}: `{name}` has no such key; its keys: {keys}")));
            }
        }
    }
    Ok(values)
}

/// The number of a key.
///
/// # Errors
/// Command line: not a number, or out of the range.
pub fn number<T>(values: &BTreeMap<String, String>, key: &Key, range: std::ops::RangeInclusive<T>) -> Result<T>
where
    T: FromStr + PartialOrd + std::fmt::Display,
{
    let text = values.get(key.name).map_or(key.default, String::as_str);
    let fail = || {
        let (low, high) = (range.start(), range.end());
        Error::command_line(format!("--set {}={text}: a number from {low} to {high} is needed", key.name))
    };
    let value: T = text.trim().parse().map_err(|_| fail())?;
    if range.contains(&value) { Ok(value) } else { Err(fail()) }
}

/// A share as `1%` or `0.01`.
///
/// # Errors
/// Command line: not a share in (0, 1].
pub fn share(text: &str, flag: &str) -> Result<f64> {
    let trimmed = text.trim();
    let (digits, unit) = trimmed.strip_suffix('%').map_or((trimmed, 1.0), |d| (d, 0.01));
    match digits.trim().parse::<f64>() {
        Ok(value) if value.is_finite() && value > 0.0 && value * unit <= 1.0 => Ok(value * unit),
        _ => Err(Error::command_line(format!("{flag} {text}: a share such as 1% or 0.01 is needed"))),
    }
}
