//! The bytes of buffers: the binary chunk, `data:` URIs, and files in the model's folder.

use std::borrow::Cow;
use std::cell::OnceCell;
use std::fs::File;
use std::io::Read;
use std::path::{Component, Path, PathBuf};

use base64::Engine;
use base64::alphabet::STANDARD;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use gltf::json::Root;

use super::extensions;
use crate::error::{Error, ExitCode, Result};

/// Every buffer of a document, loaded when first asked for.
pub(super) struct Buffers<'a> {
    root: &'a Root,
    binary: Option<&'a [u8]>,
    folder: &'a Path,
    loaded: Vec<OnceCell<Cow<'a, [u8]>>>,
}

impl<'a> Buffers<'a> {
    /// Buffers of a document; `binary` is the chunk of a GLB, `folder` the base of relative URIs.
    pub(super) fn new(root: &'a Root, binary: Option<&'a [u8]>, folder: &'a Path) -> Self {
        Self { root, binary, folder, loaded: vec![OnceCell::new(); root.buffers.len()] }
    }

    /// Exactly the `byteLength` bytes of one buffer.
    pub(super) fn get(&self, index: usize) -> Result<&[u8]> {
        let Some(cell) = self.loaded.get(index) else {
            return Err(Error::input(format!("buffer {index} does not exist")));
        };
        if let Some(bytes) = cell.get() {
            return Ok(bytes);
        }
        let bytes = self.load(index).map_err(|e| e.at(format_args!("buffer {index}")))?;
        Ok(cell.get_or_init(|| bytes))
    }

    fn load(&self, index: usize) -> Result<Cow<'a, [u8]>> {
        let Some(buffer) = self.root.buffers.get(index) else {
            return Err(Error::input("it does not exist"));
        };
        let declared = buffer.byte_length.0;
        let mut bytes = match (&buffer.uri, self.binary) {
            (Some(uri), _) => match uri.strip_prefix("data:") {
                Some(data) => Cow::Owned(decode_data_uri(data)?),
                None => Cow::Owned(self.read_file(uri, declared)?),
            },
            (None, Some(binary)) if index == 0 => Cow::Borrowed(binary),
            (None, _) if extensions::declares_meshopt(self.root) => {
                return Err(extensions::refusal("EXT_meshopt_compression"));
            }
            (None, _) => return Err(Error::input("it has neither a uri nor a binary chunk")),
        };
        let actual = bytes.len();
        match usize::try_from(declared) {
            Ok(declared) if declared <= actual => {
                match &mut bytes {
                    Cow::Borrowed(slice) => *slice = slice.get(..declared).unwrap_or(slice),
                    Cow::Owned(vec) => vec.truncate(declared),
                }
                Ok(bytes)
            }
            _ => Err(Error::input(format!("it declares byteLength {declared}, and only {actual} bytes are there"))),
        }
    }

    fn read_file(&self, uri: &str, byte_length: u64) -> Result<Vec<u8>> {
        let path = self.folder.join(confined_path(uri)?);
        let fail = |e: &std::io::Error| {
            let hint = "the file of a .gltf's buffer must lie where its uri says, relative to the model";
            Error::new(ExitCode::Io, format!("cannot read {}: {e}; {hint}", path.display()))
        };
        // A pipe or device named by a model would block or never end.
        if !std::fs::metadata(&path).map_err(|e| fail(&e))?.is_file() {
            return Err(Error::input(format!("{} is not a regular file", path.display())));
        }
        let mut bytes = Vec::new();
        File::open(&path).and_then(|file| file.take(byte_length).read_to_end(&mut bytes)).map_err(|e| fail(&e))?;
        Ok(bytes)
    }
}

/// The path that a relative URI names, or an error if it could leave the model's folder.
pub(super) fn confined_path(uri: &str) -> Result<PathBuf> {
    if let Some((scheme, _)) = uri.split_once(':')
        && scheme.starts_with(|c: char| c.is_ascii_alphabetic())
        && scheme.chars().all(|c| c.is_ascii_alphanumeric() || "+-.".contains(c))
    {
        let advice = "only files in the model's folder are read; put the file there and name it";
        return Err(Error::input(format!("its uri {} uses the scheme `{scheme}:`: {advice}", shown(uri))));
    }
    let name = percent_decode(uri)
        .and_then(|bytes| String::from_utf8(bytes).ok())
        .filter(|name| !name.is_empty() && !name.contains('\0'))
        .ok_or_else(|| Error::input(format!("its uri {} is not a valid file name", shown(uri))))?;
    let path = PathBuf::from(name);
    if path.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir)) {
        return Ok(path);
    }
    Err(Error::input(format!("its uri {} leaves the model's folder; move the file into that folder", shown(uri))))
}

/// A URI quoted for a message: control characters escaped, shortened.
fn shown(uri: &str) -> String {
    match uri.char_indices().nth(80) {
        Some((end, _)) => format!("{:?}...", uri.get(..end).unwrap_or_default()),
        None => format!("{uri:?}"),
    }
}

/// Decodes percent escapes; `None` where a `%` is not followed by two hexadecimal digits.
fn percent_decode(text: &str) -> Option<Vec<u8>> {
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text.bytes();
    while let Some(byte) = rest.next() {
        if byte != b'%' {
            bytes.push(byte);
            continue;
        }
        let mut digit = || char::from(rest.next()?).to_digit(16);
        let value = digit()? * 16 + digit()?;
        bytes.push(u8::try_from(value).ok()?);
    }
    Some(bytes)
}

/// Decodes a data URI; `data` follows `data:`, and the media type is ignored.
pub(super) fn decode_data_uri(data: &str) -> Result<Vec<u8>> {
    let (kind, payload) = data.split_once(',').ok_or_else(|| Error::input("its data: uri has no comma"))?;
    if !kind.ends_with(";base64") {
        return Err(Error::input("its data: uri is not base64"));
    }
    let bad = || Error::input("its data: uri is not valid base64");
    if payload.contains('%') {
        decode_base64(&percent_decode(payload).ok_or_else(bad)?)
    } else {
        decode_base64(payload.as_bytes())
    }
    .ok_or_else(bad)
}

/// Decodes base64 (RFC 4648, section 4); padding may be missing. `None` for any other byte or an impossible length.
fn decode_base64(text: &[u8]) -> Option<Vec<u8>> {
    const ANY_END: GeneralPurposeConfig = GeneralPurposeConfig::new()
        .with_decode_padding_mode(DecodePaddingMode::Indifferent)
        .with_decode_allow_trailing_bits(true);
    // The crate also takes a part of the padding.
    let is_whole = !text.ends_with(b"=") || text.len().is_multiple_of(4);
    GeneralPurpose::new(&STANDARD, ANY_END).decode(text).ok().filter(|_| is_whole)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn base64_agrees_with_the_vectors_of_rfc_4648() {
        let vectors =
            [("", ""), ("Zg==", "f"), ("Zm8=", "fo"), ("Zm9v", "foo"), ("Zm9vYg==", "foob"), ("Zm9vYmFy", "foobar")];
        for (text, bytes) in vectors {
            assert_eq!(decode_base64(text.as_bytes()).unwrap(), bytes.as_bytes(), "{text}");
            assert_eq!(decode_base64(text.trim_end_matches('=').as_bytes()).unwrap(), bytes.as_bytes(), "{text}");
        }
        for text in ["Z", "Zm9vY", "Zg=", "=", "====", "Zg===", "Zm 9", "Zm-_", "Z=g="] {
            assert_eq!(decode_base64(text.as_bytes()), None, "{text}");
        }
    }

    #[test]
    fn uris_stay_in_the_folder_of_the_model() {
        assert_eq!(confined_path("a%20b/%c3%a9.bin").unwrap(), Path::new("a b/\u{e9}.bin"));
        assert_eq!(confined_path("./x.bin").unwrap(), Path::new("./x.bin"));
        for uri in ["/etc/passwd", "../x.bin", "a/../../x.bin", "%2e%2e/x.bin", "%2Fetc/passwd"] {
            assert!(confined_path(uri).unwrap_err().message().contains("leaves the model's folder"), "{uri}");
        }
        for uri in ["http://host/x.bin", "file:///x.bin", "C:/x.bin"] {
            assert!(confined_path(uri).unwrap_err().message().contains("scheme"), "{uri}");
        }
        for uri in ["", "a%zz", "a%2", "a%00b", "%ff"] {
            assert!(confined_path(uri).unwrap_err().message().contains("valid file name"), "{uri}");
        }
    }

    #[test]
    fn data_uris_need_base64() {
        assert_eq!(decode_data_uri("application/octet-stream;base64,Zm9v").unwrap(), b"foo");
        assert_eq!(decode_data_uri(";base64,Zg%3D%3D").unwrap(), b"f");
        for data in ["", "text/plain,abc", ";base64,?", ";base64,%4"] {
            assert!(decode_data_uri(data).is_err(), "{data}");
        }
    }
}
