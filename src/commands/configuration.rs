//! Options of a bake in files: each long option is a key, and what is typed beats what a file says. The parser's own definitions say
//! what there is, so that no option is declared twice.

use std::collections::BTreeMap;
use std::ffi::{OsStr, OsString};
use std::fmt::Write;
use std::path::{Path, PathBuf};

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::parser::ValueSource;
use clap::{Arg, ArgAction, ArgMatches, Args, Command};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::error::{Error, ExitCode, Result};

/// Key of what is typed without an option.
pub(super) const INPUT: &str = "input";

/// Options that say where the others come from.
const META: [&str; 3] = ["config", "jobs", "print-config"];

/// Where options come from, beside the command line.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Options in files")]
pub(super) struct FileOptions {
    /// TOML file whose keys are the options of this command, the model as `input` among them; what is typed beats it
    #[arg(long, value_name = "FILE", conflicts_with = "jobs")]
    pub(super) config: Option<PathBuf>,
    /// TOML file of many bakes: a table [[job]] for each, with the keys of --config, and [defaults] for all of them; one after another,
    /// each with all threads and all of the memory. One that fails does not stop the others
    #[arg(long, value_name = "FILE", conflicts_with = "print_config")]
    pub(super) jobs: Option<PathBuf>,
    /// Print the options of this bake as a file for --config, and do not bake
    #[arg(long)]
    pub(super) print_config: bool,
}

/// Option whose bake keeps its other options in a file.
pub(super) const KEEPING: &str = "shard";

/// Returns whether some argument asks for options in a file: for some to be read, before the arguments are complete, or to be written.
pub(super) fn are_wanted(arguments: &[OsString]) -> bool {
    let all = || META.into_iter().chain([KEEPING]);
    let is_one = |text: &str| all().any(|name| text.strip_prefix("--").is_some_and(|t| t.starts_with(name)));
    arguments.iter().any(|argument| argument.to_str().is_some_and(is_one))
}

/// Where the values of an option are from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Origin {
    Typed,
    /// A line of the file, from 1.
    Line(usize),
    Default,
}

/// A value of an option; of a flag `true` or `false`.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Given {
    value: OsString,
    origin: Origin,
}

/// Options by their keys.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Options(BTreeMap<String, Vec<Given>>);

/// The command whose options are meant, with all that other commands have in common with it.
pub(super) struct Schema {
    command: Command,
}

/// The key of an option; none for those that are no options of a bake.
fn key(arg: &Arg) -> Option<&str> {
    if arg.is_positional() {
        return Some(INPUT);
    }
    arg.get_long().filter(|long| !matches!(*long, "help" | "version"))
}

fn is_flag(arg: &Arg) -> bool {
    matches!(arg.get_action(), ArgAction::SetTrue)
}

/// Returns whether each value of an option begins with a name that it is for.
fn is_by_name(arg: &Arg) -> bool {
    arg.get_value_names().is_some_and(|names| names.iter().any(|name| name.contains('=')))
}

/// The name that a value is for.
fn name_of(value: &OsStr) -> Option<&str> {
    value.to_str().and_then(|text| text.split_once('=')).map(|(name, _)| name)
}

impl Schema {
    /// The options of a command, whose own and common options must be known (`Command::build`).
    pub(super) fn new(command: &Command) -> Self {
        Self { command: command.clone() }
    }

    fn args(&self) -> impl Iterator<Item = (&str, &Arg)> {
        self.command.get_arguments().filter_map(|arg| Some((key(arg)?, arg)))
    }

    fn arg(&self, key: &str) -> Option<&Arg> {
        self.args().find(|(known, _)| *known == key).map(|(_, arg)| arg)
    }

    /// What was typed.
    pub(super) fn typed(&self, matches: &ArgMatches) -> Options {
        self.of_matches(matches, |source| (source == ValueSource::CommandLine).then_some(Origin::Typed))
    }

    /// What was typed, and what it stands on.
    pub(super) fn complete(&self, matches: &ArgMatches) -> Options {
        self.of_matches(matches, |source| match source {
            ValueSource::CommandLine => Some(Origin::Typed),
            ValueSource::DefaultValue => Some(Origin::Default),
            // The environment is another machine's matter.
            _ => None,
        })
    }

    fn of_matches(&self, matches: &ArgMatches, origin: impl Fn(ValueSource) -> Option<Origin>) -> Options {
        let given = |(key, arg): (&str, &Arg)| {
            let id = arg.get_id().as_str();
            let origin = matches.value_source(id).and_then(&origin).filter(|_| !META.contains(&key))?;
            let values: Vec<OsString> = match is_flag(arg) {
                true => vec![matches.get_flag(id).to_string().into()],
                false => matches.get_raw(id)?.map(OsStr::to_owned).collect(),
            };
            Some((key.to_owned(), values.into_iter().map(|value| Given { value, origin }).collect()))
        };
        Options(self.args().filter_map(given).collect())
    }

    /// Options on others that they beat: of those that are for names, the ones for the same name, else all of the same key, and what
    /// cannot stand beside them.
    pub(super) fn over(&self, over: &Options, under: &Options) -> Options {
        let mut all = under.clone();
        for (key, given) in &over.0 {
            let Some(arg) = self.arg(key) else { continue };
            for rival in self.rivals(arg) {
                all.0.remove(rival);
            }
            let below = all.0.entry(key.clone()).or_default();
            let names: Vec<_> = given.iter().map(|given| name_of(&given.value)).collect();
            below.retain(|below| is_by_name(arg) && !names.contains(&name_of(&below.value)));
            below.extend(given.iter().cloned());
        }
        all
    }

    /// Returns whether an option is common to all commands.
    pub(super) fn is_common(&self, key: &str) -> bool {
        self.arg(key).is_some_and(Arg::is_global_set)
    }

    /// Options without those of some keys, and without those that are common to all commands.
    pub(super) fn without(&self, options: &Options, keys: &[&str]) -> Options {
        let stays = |key: &str| !keys.contains(&key) && !self.is_common(key);
        Options(
            options.0.iter().filter(|(key, _)| stays(key)).map(|(key, given)| (key.clone(), given.clone())).collect(),
        )
    }

    /// Keys of options that cannot stand beside one.
    fn rivals(&self, arg: &Arg) -> Vec<&str> {
        let of_groups = self.command.get_groups().filter(|group| !(*group).clone().is_multiple());
        let siblings = of_groups.filter(|group| group.get_args().any(|id| id == arg.get_id())).flat_map(|group| {
            group.get_args().filter_map(|id| self.command.get_arguments().find(|other| other.get_id() == id))
        });
        let conflicting = self.command.get_arg_conflicts_with(arg);
        let rivals = siblings.chain(conflicting).filter(|other| other.get_id() != arg.get_id());
        rivals.filter_map(key).collect()
    }

    /// Options of a table of a file; `refused` says why a key has no place there.
    ///
    /// # Errors
    /// The command line: unknown keys and values of another kind, with their lines.
    pub(super) fn of_table(
        &self,
        file: &File,
        table: &DeTable<'_>,
        refused: impl Fn(&str) -> Option<&'static str>,
    ) -> Result<Options> {
        let mut options = BTreeMap::new();
        for (name, value) in table {
            let (key, line) = (name.get_ref().as_ref(), file.line(name.span().start));
            let fail = |message: &str| Err(file.error(line, format!("{key}: {message}")));
            let Some(arg) = self.arg(key).filter(|_| !META.contains(&key)) else {
                let message = match self.closest(key) {
                    Some(near) => format!("there is no such option of `bake`; did you mean {near}?"),
                    None => "there is no such option of `bake`".to_owned(),
                };
                return fail(&message);
            };
            if let Some(reason) = refused(key) {
                return fail(reason);
            }
            match file.values(value, arg) {
                Ok(values) => drop(options.insert(key.to_owned(), values)),
                Err(needed) => return fail(needed),
            }
        }
        Ok(Options(options))
    }

    /// A key that has the given one within it, or is within it.
    fn closest(&self, key: &str) -> Option<&str> {
        let plain = |text: &str| text.replace('_', "-").to_lowercase();
        let wanted = plain(key);
        let known = || self.args().map(|(known, _)| known).filter(|known| !META.contains(known));
        known().find(|known| *known == wanted).or_else(|| {
            known().find(|known| !wanted.is_empty() && (known.starts_with(&wanted) || wanted.starts_with(known)))
        })
    }

    /// Arguments of a command line with these options alone.
    pub(super) fn arguments(&self, options: &Options) -> Vec<OsString> {
        let mut words = vec![OsString::from("translux"), self.command.get_name().into()];
        let mut inputs = vec![OsString::from("--")];
        for (key, given) in &options.0 {
            let Some(arg) = self.arg(key) else { continue };
            let values = given.iter().map(|given| &given.value);
            if arg.is_positional() {
                inputs.extend(values.cloned());
            } else if is_flag(arg) {
                words.extend(values.filter(|value| *value == "true").map(|_| format!("--{key}").into()));
            } else {
                words.extend(values.map(|value| {
                    let mut word = OsString::from(format!("--{key}="));
                    word.push(value);
                    word
                }));
            }
        }
        words.append(&mut inputs);
        words
    }

    /// A file for `--config` with these options.
    ///
    /// # Errors
    /// The command line: a value that is no Unicode, which TOML cannot hold.
    pub(super) fn to_toml(&self, options: &Options) -> Result<String> {
        let mut text = String::new();
        for (key, arg) in self.args() {
            let Some(given) = options.0.get(key) else { continue };
            let values = given.iter().map(|Given { value, .. }| match value.to_str() {
                Some(text) if is_flag(arg) || is_number(text) => Ok(text.to_owned()),
                Some(text) => Ok(toml::Value::String(text.to_owned()).to_string()),
                None => Err(Error::command_line(format!(
                    "--print-config: {}: TOML holds Unicode alone",
                    value.to_string_lossy()
                ))),
            });
            let values = values.collect::<Result<Vec<String>>>()?;
            let value = match values.as_slice() {
                [one] => one.clone(),
                many => format!("[{}]", many.join(", ")),
            };
            // A flag that is not set says nothing, and a list of none is not there.
            if value != "false" && value != "[]" {
                let _ = writeln!(text, "{key} = {value}");
            }
        }
        Ok(text)
    }
}

/// Returns whether TOML reads a text as a number, whose digits it would keep.
fn is_number(text: &str) -> bool {
    let begins = text.starts_with(|c: char| c.is_ascii_digit() || c == '-');
    begins
        && matches!(toml::from_str::<toml::Table>(&format!("v = {text}")).map(|mut table| table.remove("v")),
        Ok(Some(value)) if value.is_integer() || value.is_float())
}

/// A file of options.
pub(super) struct File {
    path: PathBuf,
    text: String,
}

impl File {
    /// A text that stands in a file.
    pub(super) fn of(path: &Path, text: String) -> Self {
        Self { path: path.to_owned(), text }
    }

    /// # Errors
    /// I/O.
    pub(super) fn read(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path).map_err(|e| Error::io(path, &e))?;
        Ok(Self { path: path.to_owned(), text })
    }

    /// # Errors
    /// The command line: no TOML.
    pub(super) fn parse(&self) -> Result<DeTable<'_>> {
        DeTable::parse(&self.text).map(Spanned::into_inner).map_err(|e| {
            let line = self.line(e.span().map_or(0, |span| span.start));
            self.error(line, e.message().lines().collect::<Vec<_>>().join("; "))
        })
    }

    /// The line of a byte, from 1.
    pub(super) fn line(&self, byte: usize) -> usize {
        self.text.bytes().take(byte).filter(|byte| *byte == b'\n').count() + 1
    }

    /// An error of a line.
    pub(super) fn error(&self, line: usize, message: impl std::fmt::Display) -> Error {
        self.coded(ExitCode::CommandLine, line, message)
    }

    fn coded(&self, code: ExitCode, line: usize, message: impl std::fmt::Display) -> Error {
        Error::new(code, format!("{}:{line}: {message}", self.path.display())).of_file(&self.path)
    }

    /// What an option is given by a value, else what it needs.
    fn values(&self, value: &Spanned<DeValue<'_>>, arg: &Arg) -> std::result::Result<Vec<Given>, &'static str> {
        let scalar = |value: &Spanned<DeValue<'_>>| match value.get_ref() {
            DeValue::String(text) => Ok(text.clone().into_owned()),
            // As it is written, to the digit.
            DeValue::Integer(_) | DeValue::Float(_) => Ok(self.text[value.span()].replace('_', "")),
            DeValue::Boolean(flag) if is_by_name(arg) => Ok(flag.to_string()),
            _ => Err("a text or a number is needed"),
        };
        let given = |text: String, value: &Spanned<DeValue<'_>>| Given {
            value: text.into(),
            origin: Origin::Line(self.line(value.span().start)),
        };
        match value.get_ref() {
            DeValue::Boolean(flag) if is_flag(arg) => Ok(vec![given(flag.to_string(), value)]),
            _ if is_flag(arg) => Err("true or false is needed"),
            DeValue::Array(array) if matches!(arg.get_action(), ArgAction::Append) => {
                array.iter().map(|value| Ok(given(scalar(value)?, value))).collect()
            }
            DeValue::Array(array) if !array.is_empty() => {
                let texts = array.iter().map(scalar).collect::<std::result::Result<Vec<String>, _>>()?;
                Ok(vec![given(texts.join(","), value)])
            }
            DeValue::Table(table) if is_by_name(arg) => {
                let pairs = table.iter();
                pairs.map(|(name, value)| Ok(given(format!("{}={}", name.get_ref(), scalar(value)?), value))).collect()
            }
            _ => Ok(vec![given(scalar(value)?, value)]),
        }
    }

    /// An error of a command whose options stand partly in this file: with the line of the option that it is about.
    #[must_use]
    pub(super) fn located(&self, error: Error, options: &Options) -> Error {
        if error.code() != ExitCode::CommandLine || error.path().is_some() {
            return error;
        }
        match self.line_of(error.message(), options) {
            Some(line) => self.error(line, error.message()),
            None => error,
        }
    }

    /// The line of the option that a message begins with, or of one whose value it names.
    fn line_of(&self, message: &str, options: &Options) -> Option<usize> {
        let first = message.split_whitespace().next().unwrap_or_default();
        let flag = if first == "-o" { Some("output") } else { first.strip_prefix("--") };
        let named = flag.and_then(|flag| options.0.get(flag.trim_end_matches([':', ','])));
        let is_told = |given: &&Given| {
            let text = given.value.to_str().unwrap_or_default();
            let text = text.split_once('=').map_or(text, |(_, value)| value);
            text.len() > 1 && message.contains(text)
        };
        let line = |given: &Given| match given.origin {
            Origin::Line(line) => Some(line),
            _ => None,
        };
        match named {
            Some(given) => given.iter().find(is_told).or(given.first()).and_then(line),
            None => options.0.values().flatten().find(is_told).and_then(line),
        }
    }

    /// An error of the parser where it is about an option of this file.
    pub(super) fn of_parser(&self, error: &clap::Error, options: &Options) -> Option<Error> {
        if error.kind() == ErrorKind::MissingRequiredArgument {
            return None;
        }
        let texts = [ContextKind::InvalidArg, ContextKind::PriorArg].map(|kind| match error.get(kind) {
            Some(ContextValue::String(text)) => vec![text.clone()],
            Some(ContextValue::Strings(texts)) => texts.clone(),
            _ => Vec::new(),
        });
        let message = parser_message(error);
        let of_text = |text: String| {
            let name = text.split([' ', '=']).next().unwrap_or_default().trim_start_matches('-').to_owned();
            let lines = options.0.get(&name)?.iter().filter_map(|given| match given.origin {
                Origin::Line(line) => Some(line),
                _ => None,
            });
            lines.min().map(|line| self.error(line, &message))
        };
        texts.into_iter().flatten().find_map(of_text)
    }
}

/// What the parser says, without its usage.
pub(super) fn parser_message(error: &clap::Error) -> String {
    let text = error.to_string();
    let lines = text.lines().take_while(|line| !line.starts_with("Usage") && !line.starts_with("For more"));
    let message = lines.map(str::trim).filter(|line| !line.is_empty()).collect::<Vec<_>>().join(" ");
    message.strip_prefix("error: ").unwrap_or(&message).to_owned()
}

impl Options {
    /// The first value of a key as text; empty where there is none.
    pub(super) fn text(&self, key: &str) -> String {
        let first = self.0.get(key).and_then(|given| given.first());
        first.map_or_else(String::new, |given| given.value.to_string_lossy().into_owned())
    }

    /// Returns whether a key has a value.
    pub(super) fn has(&self, key: &str) -> bool {
        self.0.get(key).is_some_and(|given| !given.is_empty())
    }
}

/// A table of a file by its name; none where there is none.
///
/// # Errors
/// The command line: something else of that name.
pub(super) fn table<'a, 'i>(
    file: &File,
    value: Option<&'a Spanned<DeValue<'i>>>,
    name: &str,
) -> Result<Option<&'a DeTable<'i>>> {
    match value {
        None => Ok(None),
        Some(value) => match value.get_ref() {
            DeValue::Table(table) => Ok(Some(table)),
            _ => Err(file.error(file.line(value.span().start), format!("{name}: a table is needed"))),
        },
    }
}
