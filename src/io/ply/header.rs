//! The header of a PLY file: elements, their properties, and the number types.

use crate::error::{Error, Result};

#[derive(Clone, Copy, PartialEq)]
pub(super) enum Encoding {
    Text,
    BinaryLittleEndian,
}

/// A number type of the format.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

/// The number types with their two names and their bytes, in the order of their declaration.
const SCALARS: [(Scalar, [&str; 2], usize); 8] = [
    (Scalar::I8, ["char", "int8"], 1),
    (Scalar::U8, ["uchar", "uint8"], 1),
    (Scalar::I16, ["short", "int16"], 2),
    (Scalar::U16, ["ushort", "uint16"], 2),
    (Scalar::I32, ["int", "int32"], 4),
    (Scalar::U32, ["uint", "uint32"], 4),
    (Scalar::F32, ["float", "float32"], 4),
    (Scalar::F64, ["double", "float64"], 8),
];

impl Scalar {
    fn from_name(name: &str) -> Option<Self> {
        SCALARS.iter().find(|(_, names, _)| names.contains(&name)).map(|(scalar, ..)| *scalar)
    }

    pub(super) fn name(self) -> &'static str {
        SCALARS[self as usize].1[0]
    }

    pub(super) fn bytes(self) -> usize {
        SCALARS[self as usize].2
    }

    fn is_integer(self) -> bool {
        !matches!(self, Self::F32 | Self::F64)
    }

    /// The value of a number's little-endian bytes.
    pub(super) fn decode(self, bytes: &[u8]) -> f64 {
        let mut wide = [0; 8];
        wide[..bytes.len()].copy_from_slice(bytes);
        let [a, b, c, d, ..] = wide;
        match self {
            Self::I8 => f64::from(a as i8),
            Self::U8 => f64::from(a),
            Self::I16 => f64::from(i16::from_le_bytes([a, b])),
            Self::U16 => f64::from(u16::from_le_bytes([a, b])),
            Self::I32 => f64::from(i32::from_le_bytes([a, b, c, d])),
            Self::U32 => f64::from(u32::from_le_bytes([a, b, c, d])),
            Self::F32 => f64::from(f32::from_le_bytes([a, b, c, d])),
            Self::F64 => f64::from_le_bytes(wide),
        }
    }

    /// The value of a word, rounded as the type rounds it; none where the word does not fit the type.
    pub(super) fn parse(self, word: &[u8]) -> Option<f64> {
        fn of<T: std::str::FromStr + Into<f64>>(text: &str) -> Option<f64> {
            text.parse::<T>().ok().map(Into::into)
        }
        let text = std::str::from_utf8(word).ok()?;
        match self {
            Self::I8 => of::<i8>(text),
            Self::U8 => of::<u8>(text),
            Self::I16 => of::<i16>(text),
            Self::U16 => of::<u16>(text),
            Self::I32 => of::<i32>(text),
            Self::U32 => of::<u32>(text),
            Self::F32 => of::<f32>(text),
            Self::F64 => of::<f64>(text),
        }
    }
}

#[derive(Clone, Copy, PartialEq)]
pub(super) enum Kind {
    Scalar(Scalar),
    List { count: Scalar, item: Scalar },
}

pub(super) struct Property {
    pub(super) name: String,
    pub(super) kind: Kind,
}

impl Property {
    /// Least number of bytes of the property in a row of a binary file.
    pub(super) fn least_bytes(&self) -> usize {
        match self.kind {
            Kind::Scalar(scalar) => scalar.bytes(),
            Kind::List { count, .. } => count.bytes(),
        }
    }
}

pub(super) struct Element {
    pub(super) name: String,
    pub(super) count: usize,
    pub(super) properties: Vec<Property>,
}

impl Element {
    pub(super) fn is_vertex(&self) -> bool {
        self.name == "vertex"
    }
}

pub(super) struct Header {
    pub(super) encoding: Encoding,
    pub(super) elements: Vec<Element>,
    pub(super) comments: Vec<String>,
    /// Offset of the first byte after the header.
    pub(super) data_start: usize,
    /// Number of the line that starts there.
    pub(super) data_line: usize,
}

impl Header {
    pub(super) fn parse(bytes: &[u8]) -> Result<Self> {
        let mut lines = Lines { bytes, at: 0, line: 0 };
        if lines.next().is_none_or(|line| line != b"ply") {
            return Err(Error::input("this is no PLY file: it does not start with a line `ply`"));
        }
        let mut encoding = None;
        let mut elements = Vec::new();
        let mut comments = Vec::new();
        loop {
            let Some(line) = lines.next() else {
                return Err(Error::input("the header has no line `end_header`"));
            };
            let text = String::from_utf8_lossy(line);
            if let Some(comment) = text.strip_prefix("comment") {
                comments.push(comment.trim().to_owned());
                continue;
            }
            let words: Vec<&str> = text.split_ascii_whitespace().collect();
            let result = match words[..] {
                ["end_header"] => break,
                [] | ["obj_info", ..] => Ok(()),
                ["format", format, version] => parse_format(format, version).map(|parsed| encoding = Some(parsed)),
                ["element", name, count] => parse_element(name, count, &mut elements),
                ["property", ref words @ ..] => parse_property(words, &mut elements),
                _ => Err(unknown(&text)),
            };
            result.map_err(|error| error.at(format!("line {}", lines.line)))?;
        }
        let encoding = encoding.ok_or_else(|| Error::input("the header has no line `format`"))?;
        match elements.iter().find(|element| element.is_vertex()) {
            None => return Err(Error::input("the header has no element `vertex`")),
            Some(vertex) if !vertex.properties.iter().any(|property| matches!(property.kind, Kind::Scalar(_))) => {
                return Err(Error::input("the element `vertex` has no scalar property"));
            }
            Some(_) => {}
        }
        Ok(Self { encoding, elements, comments, data_start: lines.at, data_line: lines.line + 1 })
    }
}

/// Lines of the header; each ends with a line feed, before which a carriage return may stand.
struct Lines<'a> {
    bytes: &'a [u8],
    at: usize,
    line: usize,
}

impl<'a> Iterator for Lines<'a> {
    type Item = &'a [u8];

    fn next(&mut self) -> Option<&'a [u8]> {
        let rest = self.bytes.get(self.at..)?;
        let end = rest.iter().position(|&byte| byte == b'\n')?;
        self.at += end + 1;
        self.line += 1;
        let line = &rest[..end];
        Some(line.strip_suffix(b"\r").unwrap_or(line))
    }
}

fn unknown(text: &str) -> Error {
    let text: String = text.chars().take(60).flat_map(char::escape_debug).collect();
    Error::input(format!("`{text}` is no line of a PLY header"))
}

fn parse_format(format: &str, version: &str) -> Result<Encoding> {
    match (format, version) {
        ("ascii", "1.0") => Ok(Encoding::Text),
        ("binary_little_endian", "1.0") => Ok(Encoding::BinaryLittleEndian),
        ("binary_big_endian", "1.0") => {
            Err(Error::unsupported("big-endian PLY is not supported; convert it to binary_little_endian"))
        }
        _ => Err(unknown(&format!("format {format} {version}"))),
    }
}

fn parse_element(name: &str, count: &str, elements: &mut Vec<Element>) -> Result<()> {
    let count = count.parse().map_err(|_| unknown(&format!("element {name} {count}")))?;
    if elements.iter().any(|element| element.name == name) {
        return Err(Error::input(format!("a second element `{name}`")));
    }
    elements.push(Element { name: name.to_owned(), count, properties: Vec::new() });
    Ok(())
}

fn parse_property(words: &[&str], elements: &mut [Element]) -> Result<()> {
    let wrong = || unknown(&format!("property {}", words.join(" ")));
    let element = elements.last_mut().ok_or_else(|| Error::input("a property before the first element"))?;
    let scalar = |name: &str| Scalar::from_name(name).ok_or_else(wrong);
    let (name, kind) = match *words {
        ["list", count, item, name] => {
            let kind = Kind::List { count: scalar(count)?, item: scalar(item)? };
            if !scalar(count)?.is_integer() {
                return Err(wrong());
            }
            (name, kind)
        }
        [kind, name] => (name, Kind::Scalar(scalar(kind)?)),
        _ => return Err(wrong()),
    };
    if element.properties.iter().any(|property| property.name == name) {
        return Err(Error::input(format!("a second property `{name}` of element `{}`", element.name)));
    }
    element.properties.push(Property { name: name.to_owned(), kind });
    Ok(())
}
