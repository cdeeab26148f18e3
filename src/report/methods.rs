//! Report of methods and their keys.

use std::fmt;

use serde::Serialize;

use super::text::{percent, titled};
use crate::evaluate::Method;
use crate::evaluate::keys::{AnyKey, Audience};

/// The keys that the text shows; JSON has all.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Shown {
    /// No keys.
    NoKeys,
    /// The keys that everybody needs.
    Everyday,
    /// The keys for experts too.
    All,
}

/// Methods with their keys.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct MethodsReport {
    methods: Vec<MethodRow>,
    #[serde(skip)]
    shown: Shown,
}

#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
struct MethodRow {
    name: &'static str,
    summary: &'static str,
    choose_when: &'static str,
    /// Relative error that a bake aims at without `--max-rms`.
    default_max_rms: f64,
    keys: Vec<KeyRow>,
}

#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
struct KeyRow {
    name: &'static str,
    default: &'static str,
    /// The domain in words.
    values: String,
    /// The values that are words.
    words: Vec<&'static str>,
    audience: Audience,
    help: &'static str,
}

impl KeyRow {
    fn of(key: &dyn AnyKey) -> Self {
        Self {
            name: key.name(),
            default: key.default(),
            values: key.values(),
            words: key.words(),
            audience: key.audience(),
            help: key.help(),
        }
    }
}

impl MethodsReport {
    /// Lists methods in their order.
    pub(crate) fn of(methods: &[&dyn Method], shown: Shown) -> Self {
        let row = |method: &&dyn Method| MethodRow {
            name: method.name(),
            summary: method.about().summary,
            choose_when: method.about().choose_when,
            default_max_rms: method.default_max_rms(),
            keys: method.keys().iter().map(|key| KeyRow::of(*key)).collect(),
        };
        Self { methods: methods.iter().map(row).collect(), shown }
    }
}

impl MethodRow {
    fn lines(&self, shown: Shown) -> Vec<String> {
        let mut lines = vec![format!("{}: {}\n  {}", self.name, self.summary, self.choose_when)];
        if shown == Shown::NoKeys {
            return lines;
        }
        let is_shown = |key: &&KeyRow| shown == Shown::All || key.audience == Audience::Everyday;
        let aim = ["  --max-rms", &percent(self.default_max_rms), "relative error that a bake aims at"];
        let line = |key: &KeyRow| {
            let help = format!("{} ({})", key.help, key.values);
            [format!("  --set {}=", key.name), key.default.to_owned(), help]
        };
        let keys = self.keys.iter().filter(is_shown).map(line);
        lines.push(titled(aim, keys));
        let hidden = self.keys.iter().filter(|key| !is_shown(key)).count();
        if hidden > 0 {
            lines.push(format!("  {hidden} more for experts: translux methods {} --all", self.name));
        }
        lines
    }
}

impl fmt::Display for MethodsReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut lines: Vec<String> = self.methods.iter().flat_map(|method| method.lines(self.shown)).collect();
        if self.shown == Shown::NoKeys {
            lines.push("`bake` chooses among them for what it is asked for (--method auto, the default)".to_owned());
            lines.push("keys of a method: translux methods NAME".to_owned());
        }
        f.write_str(&lines.join("\n"))
    }
}
