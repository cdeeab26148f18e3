//! Keys of `--set key=value`. One declaration of a key gives its parser, its range check, its default, its line of
//! help, its entry in reports and completions, and the typed value that a method puts into the settings of its forms.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Display;
use std::str::FromStr;

use crate::error::{Error, Result};

/// The values that a key takes, and how they are typed.
pub trait Domain: Sync {
    /// A value.
    type Value;

    /// Parses a text without spaces around it; none where it is no value.
    fn parse(&self, text: &str) -> Option<Self::Value>;

    /// The values in words that complete "needed is".
    fn describe(&self) -> String;

    /// The values that are words, for completions.
    fn words(&self) -> Vec<&'static str> {
        Vec::new()
    }
}

/// Numbers of a range, its ends included.
#[derive(Clone, Copy, Debug)]
pub struct Number<T>(pub T, pub T);

impl<T: FromStr + PartialOrd + Display + Sync> Domain for Number<T> {
    type Value = T;

    fn parse(&self, text: &str) -> Option<T> {
        text.parse().ok().filter(|value| (&self.0..=&self.1).contains(&value))
    }

    fn describe(&self) -> String {
        format!("a number from {} to {}", self.0, self.1)
    }
}

/// Powers of two of a range, its ends included.
#[derive(Clone, Copy, Debug)]
pub struct PowerOfTwo(pub u32, pub u32);

impl Domain for PowerOfTwo {
    type Value = u32;

    fn parse(&self, text: &str) -> Option<u32> {
        Number(self.0, self.1).parse(text).filter(|value| value.is_power_of_two())
    }

    fn describe(&self) -> String {
        format!("a power of two from {} to {}", self.0, self.1)
    }
}

/// One of several words, each with its value.
#[derive(Clone, Copy, Debug)]
pub struct OneOf<T: 'static>(pub &'static [(&'static str, T)]);

impl<T: Copy + Sync> Domain for OneOf<T> {
    type Value = T;

    fn parse(&self, text: &str) -> Option<T> {
        self.0.iter().find(|(name, _)| *name == text).map(|(_, value)| *value)
    }

    fn describe(&self) -> String {
        format!("one of {}", self.words().join(", "))
    }

    fn words(&self) -> Vec<&'static str> {
        self.0.iter().map(|(name, _)| *name).collect()
    }
}

/// A share in (0, 1], as `1%` or `0.01`.
#[derive(Clone, Copy, Debug)]
pub struct Share;

impl Domain for Share {
    type Value = f64;

    fn parse(&self, text: &str) -> Option<f64> {
        let (digits, unit) = text.strip_suffix('%').map_or((text, 1.0), |digits| (digits, 0.01));
        let value = digits.trim().parse::<f64>().ok()?;
        (value.is_finite() && value > 0.0 && value * unit <= 1.0).then_some(value * unit)
    }

    fn describe(&self) -> String {
        "a share such as 1% or 0.01".to_owned()
    }
}

/// `auto`, which is none, or a value.
#[derive(Clone, Copy, Debug)]
pub struct Auto<D>(pub D);

impl<D: Domain> Domain for Auto<D> {
    type Value = Option<D::Value>;

    fn parse(&self, text: &str) -> Option<Option<D::Value>> {
        if text == "auto" { Some(None) } else { self.0.parse(text).map(Some) }
    }

    fn describe(&self) -> String {
        format!("auto or {}", self.0.describe())
    }

    fn words(&self) -> Vec<&'static str> {
        std::iter::once("auto").chain(self.0.words()).collect()
    }
}

/// The users who need a key.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Audience {
    /// Everybody who bakes: listed by `methods NAME`.
    Everyday,
    /// Users who study the method or compare it with its paper: listed by `methods NAME --all`.
    Expert,
}

/// A key with the type of its values.
#[derive(Clone, Copy, Debug)]
pub struct Key<D> {
    /// Name.
    pub name: &'static str,
    /// Default, as it would be typed.
    pub default: &'static str,
    /// Help text in one line: effect and unit.
    pub help: &'static str,
    /// Users who need it.
    pub audience: Audience,
    /// The values that it takes.
    pub domain: D,
}

impl<D> Key<D> {
    /// A key that everybody needs.
    pub const fn new(name: &'static str, default: &'static str, domain: D, help: &'static str) -> Self {
        Self { name, default, help, audience: Audience::Everyday, domain }
    }

    /// The same key for experts.
    #[must_use]
    pub const fn expert(mut self) -> Self
    where
        D: Copy,
    {
        self.audience = Audience::Expert;
        self
    }
}

/// A key whatever the type of its values: listed, and able to check a text.
pub trait AnyKey: Sync {
    /// Name.
    fn name(&self) -> &'static str;

    /// Default, as it would be typed.
    fn default(&self) -> &'static str;

    /// Help text in one line: effect and unit.
    fn help(&self) -> &'static str;

    /// Users who need it.
    fn audience(&self) -> Audience;

    /// Its values in words.
    fn values(&self) -> String;

    /// The values that are words.
    fn words(&self) -> Vec<&'static str>;

    /// Refuses a text that is no value.
    ///
    /// # Errors
    /// Command line: the text is no value of the key; the message tells what is needed.
    fn check(&self, text: &str) -> Result<()>;
}

impl<D: Domain> AnyKey for Key<D> {
    fn name(&self) -> &'static str {
        self.name
    }

    fn default(&self) -> &'static str {
        self.default
    }

    fn help(&self) -> &'static str {
        self.help
    }

    fn audience(&self) -> Audience {
        self.audience
    }

    fn values(&self) -> String {
        self.domain.describe()
    }

    fn words(&self) -> Vec<&'static str> {
        self.domain.words()
    }

    fn check(&self, text: &str) -> Result<()> {
        self.parse(text).map(|_| ())
    }
}

impl<D: Domain> Key<D> {
    fn parse(&self, text: &str) -> Result<D::Value> {
        self.domain.parse(text.trim()).ok_or_else(|| {
            let needed = self.domain.describe();
            Error::command_line(format!("--set {}={text}: {needed} is needed", self.name))
        })
    }
}

/// The keys of a method with their checked values; a method reads only those that have a meaning under its other
/// choices.
pub struct Keys {
    method: &'static str,
    values: BTreeMap<&'static str, String>,
    defaults: BTreeMap<&'static str, &'static str>,
    read: RefCell<BTreeSet<&'static str>>,
}

impl Keys {
    /// All keys of a method with the given values or their defaults.
    ///
    /// # Errors
    /// Command line: a key that the method does not have or that is given twice; a text that is no value of its key.
    pub fn new(method: &'static str, keys: &[&'static dyn AnyKey], given: &[(String, String)]) -> Result<Self> {
        let defaults: BTreeMap<_, _> = keys.iter().map(|key| (key.name(), key.default())).collect();
        let mut values: BTreeMap<_, _> = defaults.iter().map(|(name, text)| (*name, (*text).to_owned())).collect();
        for (index, (name, text)) in given.iter().enumerate() {
            if let Some((_, other)) = given[..index].iter().find(|(other, _)| other == name) {
                return Err(Error::command_line(format!("--set {name}: given twice, as {other} and as {text}")));
            }
            let Some(key) = keys.iter().find(|key| key.name() == name) else {
                let names: Vec<&str> = keys.iter().map(|key| key.name()).collect();
                let names = if names.is_empty() { "none".to_owned() } else { names.join(", ") };
                return Err(Error::command_line(format!(
                    "--set {name}: `{method}` has no such key; its keys: {names}"
                )));
            };
            key.check(text)?;
            values.insert(key.name(), text.trim().to_owned());
        }
        Ok(Self { method, values, defaults, read: RefCell::default() })
    }

    /// The value of a key, which counts as read from here on.
    ///
    /// # Errors
    /// Run time: a key that the method does not list.
    pub fn get<D: Domain>(&self, key: &Key<D>) -> Result<D::Value> {
        let Some(text) = self.values.get(key.name) else {
            return Err(Error::runtime(format!(
                "`{}` reads the key `{}`, which it does not list",
                self.method, key.name
            )));
        };
        self.read.borrow_mut().insert(key.name);
        key.parse(text)
    }

    /// A key, with its value, that differs from its default although nothing read it.
    pub fn unread(&self) -> Option<(&'static str, &str)> {
        let read = self.read.borrow();
        let unread =
            |(name, text): &(&&'static str, &String)| !read.contains(*name) && self.defaults[*name] != text.as_str();
        self.values.iter().find(unread).map(|(name, text)| (*name, text.as_str()))
    }

    /// Returns whether a key was read.
    pub fn was_read(&self, name: &str) -> bool {
        self.read.borrow().contains(name)
    }

    /// Every key with its value as text.
    pub fn into_texts(self) -> BTreeMap<String, String> {
        self.values.into_iter().map(|(name, text)| (name.to_owned(), text)).collect()
    }
}

/// A share that an option takes, as `1%` or `0.01`.
///
/// # Errors
/// Command line: not a share in (0, 1].
pub fn share(text: &str, flag: &str) -> Result<f64> {
    Share
        .parse(text.trim())
        .ok_or_else(|| Error::command_line(format!("{flag} {text}: {} is needed", Share.describe())))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::error::ExitCode;

    const KIND: Key<OneOf<u8>> = Key::new("kind", "plain", OneOf(&[("plain", 0), ("fancy", 1)]), "how");
    const SIZE: Key<Auto<Number<f64>>> = Key::new("size", "auto", Auto(Number(0.5, 8.0)), "mm").expert();
    const RAYS: Key<PowerOfTwo> = Key::new("rays", "4", PowerOfTwo(1, 64), "rays");
    const ALL: &[&dyn AnyKey] = &[&KIND, &SIZE, &RAYS];

    fn keys(given: &[(&str, &str)]) -> Result<Keys> {
        let given: Vec<(String, String)> = given.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())).collect();
        Keys::new("toy", ALL, &given)
    }

    #[test]
    fn values_are_typed_and_checked() {
        let all = keys(&[("size", " 2.5 "), ("rays", "16")]).unwrap();
        assert_eq!((all.get(&KIND).unwrap(), all.get(&SIZE).unwrap(), all.get(&RAYS).unwrap()), (0, Some(2.5), 16));
        assert_eq!(all.unread(), None);
        let texts = all.into_texts();
        assert_eq!(
            texts.iter().map(|(k, v)| format!("{k}={v}")).collect::<Vec<_>>(),
            ["kind=plain", "rays=16", "size=2.5"]
        );
        assert_eq!(keys(&[]).unwrap().get(&SIZE).unwrap(), None);
        let refused = [
            ("kind", "odd"),
            ("kind", ""),
            ("size", "9"),
            ("size", "nan"),
            ("rays", "3"),
            ("rays", "128"),
            ("rays", "-1"),
        ];
        for (name, value) in refused {
            let error = keys(&[(name, value)]).err().unwrap();
            assert_eq!(error.code(), ExitCode::CommandLine);
            assert!(error.message().contains(name) && error.message().contains("is needed"), "{error}");
        }
        let twice = keys(&[("rays", "4"), ("size", "2"), ("rays", "8")]).err().unwrap();
        assert!(twice.message().contains("--set rays: given twice, as 4 and as 8"), "{twice}");
        let unknown = keys(&[("colour", "1")]).err().unwrap();
        assert!(unknown.message().contains("`toy` has no such key; its keys: kind, size, rays"), "{unknown}");
    }

    #[test]
    fn what_nothing_reads_is_found() {
        let all = keys(&[("kind", "fancy"), ("size", "2"), ("rays", "4")]).unwrap();
        all.get(&KIND).unwrap();
        assert!(all.was_read("kind") && !all.was_read("size"));
        // A default that was typed is no mistake.
        assert_eq!(all.unread(), Some(("size", "2")));
    }

    #[test]
    fn shares() {
        for (text, value) in [("1%", 0.01), ("0.01", 0.01), (" 100 % ", 1.0), ("1", 1.0)] {
            assert_eq!(share(text, "--max-rms").unwrap(), value, "{text}");
        }
        for text in ["", "0", "-1%", "101%", "nan", "inf", "1.5", "%"] {
            assert!(share(text, "--max-rms").unwrap_err().message().contains("--max-rms"), "{text}");
        }
    }
}
