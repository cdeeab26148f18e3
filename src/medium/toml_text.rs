//! What TOML files of media have in common: their text, where something stands in it, numbers of the channels.

use std::fmt;
use std::io::Read;
use std::path::Path;

use glam::DVec3;
use serde::de::{Deserialize, Deserializer, Error as _, Expected, SeqAccess, Visitor};

use crate::error::{Error, Result};

/// The three numbers of a sequence.
pub(super) fn three<'de, A: SeqAccess<'de>>(
    mut sequence: A,
    expected: &dyn Expected,
) -> std::result::Result<DVec3, A::Error> {
    let mut values: Vec<f64> = Vec::with_capacity(3);
    while let Some(value) = sequence.next_element()? {
        values.push(value);
    }
    <[f64; 3]>::try_from(values.as_slice())
        .map(DVec3::from_array)
        .map_err(|_| A::Error::invalid_length(values.len(), expected))
}

/// One number for all channels, or three.
#[derive(Clone, Copy)]
pub(super) struct Channels(pub(super) DVec3);

impl<'de> Deserialize<'de> for Channels {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        deserializer.deserialize_any(ChannelsVisitor)
    }
}

struct ChannelsVisitor;

impl<'de> Visitor<'de> for ChannelsVisitor {
    type Value = Channels;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("one number or [red, green, blue]")
    }

    fn visit_f64<E>(self, value: f64) -> std::result::Result<Channels, E> {
        Ok(Channels(DVec3::splat(value)))
    }

    fn visit_i64<E>(self, value: i64) -> std::result::Result<Channels, E> {
        Ok(Channels(DVec3::splat(value as f64)))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, sequence: A) -> std::result::Result<Channels, A::Error> {
        three(sequence, &self).map(Channels)
    }
}

/// The text of a file of at most `most_mib` MiB, since a path given by mistake must not fill the memory; errors name the
/// expected `kind` of file.
pub(super) fn read_text(path: &Path, kind: &str, most_mib: u64) -> Result<String> {
    let file = std::fs::File::open(path).map_err(|error| Error::io(path, &error))?;
    let mut bytes = Vec::new();
    file.take((most_mib << 20) + 1).read_to_end(&mut bytes).map_err(|error| Error::io(path, &error))?;
    let wrong = |what: &str| Error::input(format!("{what}, so this is no {kind}")).in_file(path);
    if bytes.len() as u64 > most_mib << 20 {
        return Err(wrong(&format!("longer than {most_mib} MiB")));
    }
    String::from_utf8(bytes).map_err(|_| wrong("not UTF-8 text"))
}

/// `line:column` of a byte offset, both from 1, columns in characters.
pub(super) fn position(text: &str, offset: usize) -> String {
    let before = text.get(..offset).unwrap_or(text);
    let line = before.matches('\n').count() + 1;
    let column = before.rsplit('\n').next().map_or(0, |line| line.chars().count()) + 1;
    format!("{line}:{column}")
}

pub(super) fn one_line(message: &str) -> String {
    message.split('\n').map(str::trim).collect::<Vec<_>>().join(", ")
}
