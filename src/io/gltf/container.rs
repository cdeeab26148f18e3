//! The two containers of glTF: plain JSON, and GLB with a JSON chunk and at most one binary chunk.

use std::path::Path;

use super::warnings::Warnings;
use crate::error::{Error, Result};

const MAGIC: &[u8; 4] = b"glTF";
const CHUNK_JSON: &[u8; 4] = b"JSON";
const CHUNK_BIN: &[u8; 4] = b"BIN\0";

/// The parts of a file that glTF defines.
pub(super) struct Container<'a> {
    pub(super) json: &'a [u8],
    pub(super) binary: Option<&'a [u8]>,
}

/// Finds the JSON and the binary chunk; the content decides the container, not the suffix.
pub(super) fn split<'a>(bytes: &'a [u8], path: &Path, warnings: &mut Warnings) -> Result<Container<'a>> {
    if bytes.is_empty() {
        return Err(Error::input("the file is empty"));
    }
    if bytes.starts_with(MAGIC) {
        return split_glb(bytes, warnings);
    }
    if path.extension().is_some_and(|suffix| suffix.eq_ignore_ascii_case("glb")) {
        return Err(Error::input("not a GLB file: it does not start with `glTF`"));
    }
    Ok(Container { json: bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes), binary: None })
}

fn split_glb<'a>(bytes: &'a [u8], warnings: &mut Warnings) -> Result<Container<'a>> {
    let mut rest = bytes;
    let (Some(_), Some(version), Some(declared)) = (take_u32(&mut rest), take_u32(&mut rest), take_u32(&mut rest))
    else {
        return Err(Error::input(format!("truncated GLB header: {} of 12 bytes", bytes.len())));
    };
    match version {
        2 => {}
        0 => return Err(Error::input("GLB container version 0 does not exist")),
        _ => return Err(unsupported_version(&format!("GLB container version {version}"))),
    }
    let declared = declared as usize;
    if declared > bytes.len() {
        let actual = bytes.len();
        return Err(Error::input(format!(
            "truncated GLB: its header declares {declared} bytes, the file has {actual}"
        )));
    }
    if declared < bytes.len() {
        warnings
            .add(format!("{} bytes after the end that the GLB header declares are ignored", bytes.len() - declared));
    }
    let Some(mut rest) = bytes.get(12..declared) else {
        return Err(Error::input(format!("the GLB header declares {declared} bytes, fewer than the header itself")));
    };
    let json = match take_chunk(&mut rest)? {
        Some((CHUNK_JSON, json)) => json,
        Some(_) => return Err(Error::input("the first chunk of the GLB is not JSON")),
        None => return Err(Error::input("the GLB has no JSON chunk")),
    };
    // Chunks of other types are for extensions: a reader must skip them.
    let binary = match take_chunk(&mut rest)? {
        Some((CHUNK_BIN, binary)) => Some(binary),
        _ => None,
    };
    Ok(Container { json, binary })
}

fn take_chunk<'a>(rest: &mut &'a [u8]) -> Result<Option<(&'a [u8; 4], &'a [u8])>> {
    if rest.is_empty() {
        return Ok(None);
    }
    let available = rest.len();
    let header = take_u32(rest).zip(rest.split_first_chunk::<4>());
    let Some((length, (kind, data))) = header else {
        return Err(Error::input(format!("truncated GLB chunk header: {available} of 8 bytes")));
    };
    let Some((chunk, after)) = data.split_at_checked(length as usize) else {
        let name = kind.escape_ascii();
        let left = data.len();
        return Err(Error::input(format!("truncated GLB: chunk `{name}` declares {length} bytes, {left} are left")));
    };
    *rest = after;
    Ok(Some((kind, chunk)))
}

fn take_u32(rest: &mut &[u8]) -> Option<u32> {
    let (word, after) = rest.split_first_chunk::<4>()?;
    *rest = after;
    Some(u32::from_le_bytes(*word))
}

/// The error for files of another generation of the format.
pub(super) fn unsupported_version(what: &str) -> Error {
    Error::unsupported(format!("{what}: only glTF 2.0 is read; export the model again as glTF 2.0"))
}
