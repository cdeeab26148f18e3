//! The text of an OBJ file as numbered statements, words, numbers and indices.

use std::borrow::Cow;

use crate::error::{Error, Result};

/// A whole number that a face gives for a vertex, a texture coordinate or a normal.
pub(super) enum Index {
    /// Counted from 0 (the file counts from 1); it may refer to a line below.
    Absolute(u64),
    /// Counted back from the line of the face: 1 is the latest.
    Back(u64),
    /// Zero, which OBJ does not have.
    Zero,
}

/// The text of the file, or an error that tells what the bytes are instead.
pub(super) fn text_of<'a>(bytes: &'a [u8], name: &str) -> Result<&'a [u8]> {
    let wrong = |what: &str| Err(Error::input(format!("{name}: {what}; an OBJ file is plain UTF-8 or ASCII text")));
    if bytes.is_empty() {
        return Err(Error::input(format!("{name}: the file is empty")));
    }
    if bytes.starts_with(&[0xFE, 0xFF]) || bytes.starts_with(&[0xFF, 0xFE]) {
        return wrong("the text is UTF-16 (it starts with that byte order mark): save it as UTF-8");
    }
    if bytes[..bytes.len().min(1024)].contains(&0) {
        return wrong("zero bytes near the start: this is a binary file or UTF-16 text");
    }
    for (magic, format) in [(&b"ply"[..], "PLY"), (b"glTF", "GLB"), (b"solid ", "STL"), (b"OFF", "OFF")] {
        let rest = bytes.strip_prefix(magic);
        if rest.is_some_and(|rest| magic.ends_with(b" ") || rest.first().is_none_or(|b| is_space(*b) || *b < b' ')) {
            return wrong(&format!("this looks like a {format} file"));
        }
    }
    Ok(bytes.strip_prefix(&[0xEF, 0xBB, 0xBF]).unwrap_or(bytes))
}

/// Returns whether a byte is white space inside a line; a carriage return before the line feed is.
fn is_space(byte: u8) -> bool {
    matches!(byte, b' ' | b'\t' | b'\r' | b'\n' | 0x0B | 0x0C)
}

/// The statements of a file: lines, with continued ones joined.
pub(super) struct Statements<'a> {
    rest: Option<&'a [u8]>,
    line_end: u8,
    line: usize,
}

impl<'a> Statements<'a> {
    pub(super) fn new(text: &'a [u8]) -> Self {
        // Without a single line feed, lone carriage returns end the lines (classic Mac OS).
        let line_end = if text.contains(&b'\n') { b'\n' } else { b'\r' };
        Self { rest: Some(text), line_end, line: 0 }
    }

    fn next_line(&mut self) -> Option<&'a [u8]> {
        let rest = self.rest?;
        self.line += 1;
        match rest.iter().position(|&byte| byte == self.line_end) {
            Some(end) => {
                self.rest = Some(&rest[end + 1..]);
                Some(trim(&rest[..end]))
            }
            None => {
                self.rest = None;
                Some(trim(rest))
            }
        }
    }
}

impl<'a> Iterator for Statements<'a> {
    /// Line number of the statement's first line, and its bytes without outer white space.
    type Item = (usize, Cow<'a, [u8]>);

    fn next(&mut self) -> Option<Self::Item> {
        let first = self.next_line()?;
        let number = self.line;
        // A comment that ends with a backslash (a Windows path, say) must not swallow the next line.
        if first.first() == Some(&b'#') || first.last() != Some(&b'\\') {
            return Some((number, Cow::Borrowed(first)));
        }
        let mut joined = first[..first.len() - 1].to_vec();
        while let Some(line) = self.next_line() {
            joined.push(b' ');
            match line.split_last() {
                Some((b'\\', continued)) => joined.extend_from_slice(continued),
                _ => {
                    joined.extend_from_slice(line);
                    break;
                }
            }
        }
        Some((number, Cow::Owned(joined)))
    }
}

pub(super) fn trim(mut bytes: &[u8]) -> &[u8] {
    while let [first, rest @ ..] = bytes
        && is_space(*first)
    {
        bytes = rest;
    }
    while let [rest @ .., last] = bytes
        && is_space(*last)
    {
        bytes = rest;
    }
    bytes
}

/// Splits a statement into its first word and the rest.
pub(super) fn split_keyword(statement: &[u8]) -> (&[u8], &[u8]) {
    let end = statement.iter().position(|&b| is_space(b)).unwrap_or(statement.len());
    (&statement[..end], trim(&statement[end..]))
}

/// Words before a comment.
pub(super) fn words(rest: &[u8]) -> impl Iterator<Item = &[u8]> {
    rest.split(|&b| is_space(b)).filter(|word| !word.is_empty()).take_while(|word| word[0] != b'#')
}

/// A number, or NaN for the spellings by which programs write values that are not finite.
pub(super) fn number(word: &[u8]) -> Option<f64> {
    if let Some(value) = std::str::from_utf8(word).ok().and_then(|text| text.parse().ok()) {
        return Some(value);
    }
    let unsigned = word.strip_prefix(b"-").or(word.strip_prefix(b"+")).unwrap_or(word);
    let spelled = unsigned.starts_with(b"1.#") || unsigned.get(..4).is_some_and(|w| w.eq_ignore_ascii_case(b"nan("));
    spelled.then_some(f64::NAN)
}

/// An index of a face; none where the word is no whole number.
pub(super) fn index(word: &[u8]) -> Option<Index> {
    let value: i64 = std::str::from_utf8(word).ok()?.parse().ok()?;
    Some(match value {
        0 => Index::Zero,
        1.. => Index::Absolute(value.unsigned_abs() - 1),
        _ => Index::Back(value.unsigned_abs()),
    })
}

/// A word of the file as shown in messages.
pub(super) fn shown(word: &[u8]) -> String {
    let text = String::from_utf8_lossy(word);
    let mut short: String = text.chars().take(40).flat_map(char::escape_debug).collect();
    if text.chars().nth(40).is_some() {
        short.push('…');
    }
    short
}
