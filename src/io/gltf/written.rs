//! A glTF document to be written: its JSON, and one binary chunk. It starts empty or as a file that is there, of which everything survives
//! that is not replaced.

use std::collections::BTreeMap;
use std::path::Path;

use serde_json::{Map, Value, json};

use super::accessor::Accessors;
use super::buffers::{Buffers, confined_path};
use super::layout::{self, PlacedMesh};
use super::warnings::Warnings;
use super::{checked, document};
use crate::error::{Error, Result};

/// Components of an element lie at multiples of 4 bytes, as all that this writes have.
const ALIGNMENT: usize = 4;

/// `ARRAY_BUFFER` of glTF.
const VERTICES: u32 = 34_962;
/// `ELEMENT_ARRAY_BUFFER`.
const INDICES: u32 = 34_963;

/// Component type of 16-bit indices.
const UNSIGNED_SHORT: u32 = 5_123;
/// Of 32-bit indices.
const UNSIGNED_INT: u32 = 5_125;
/// Of floats.
const FLOAT: u32 = 5_126;

/// Largest byteStride of glTF.
const MOST_STRIDE: usize = 252;

/// A vertex attribute of 32-bit floats.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Column {
    /// Its semantic: `POSITION`, `COLOR_0`, `_NAME`.
    pub name: String,
    /// Floats of a vertex, 1 to 4.
    pub width: usize,
}

impl Column {
    /// An attribute of this many floats, 1 to 4.
    pub fn new(name: impl Into<String>, width: usize) -> Self {
        Self { name: name.into(), width }
    }
}

/// A document to be written.
#[derive(Clone, Debug)]
pub struct Document {
    /// What is no list, such as `asset`.
    other: Map<String, Value>,
    /// Lists of the top level; those without entries are not written.
    lists: BTreeMap<String, Vec<Value>>,
    binary: Vec<u8>,
}

impl Default for Document {
    fn default() -> Self {
        let generator = format!("translux {}", env!("CARGO_PKG_VERSION"));
        let asset = json!({ "version": "2.0", "generator": generator });
        Self { other: Map::from_iter([("asset".to_owned(), asset)]), lists: BTreeMap::new(), binary: Vec::new() }
    }
}

impl Document {
    /// Reads a file, with the order in which [`super::read_gltf`] reads its vertices. Its buffers become one, and pictures beside it are
    /// taken in.
    ///
    /// # Errors
    /// As [`super::read_gltf`].
    pub fn read(path: &Path) -> Result<(Self, Vec<PlacedMesh>)> {
        let bytes = std::fs::read(path).map_err(|e| Error::io(path, &e))?;
        Self::parse(&bytes, path).map_err(|e| e.in_file(path))
    }

    fn parse(bytes: &[u8], path: &Path) -> Result<(Self, Vec<PlacedMesh>)> {
        let mut warnings = Warnings::default();
        let (container, root) = checked(bytes, path, &mut warnings)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let accessors = Accessors::new(&root, Buffers::new(&root, container.binary, folder));
        let placed = layout::placed(&root, &accessors)?;
        let all: Map<String, Value> = serde_json::from_slice(container.json)
            .map_err(|e| Error::input(format!("not a valid glTF document: {e}")))?;
        let mut result = Self { other: Map::new(), lists: BTreeMap::new(), binary: Vec::new() };
        for (name, value) in all {
            match value {
                Value::Array(list) => drop(result.lists.insert(name, list)),
                other => drop(result.other.insert(name, other)),
            }
        }
        let buffers = Buffers::new(&root, container.binary, folder);
        let mut starts = Vec::new();
        for index in 0..root.buffers.len() {
            starts.push(result.append(buffers.get(index)?));
        }
        result.rebase(&starts);
        result.list("accessors").iter_mut().for_each(round_bounds);
        result.take_pictures(folder)?;
        Ok((result, placed))
    }

    /// An object of the document's top level, such as `asset`.
    pub fn object(&mut self, name: &str) -> &mut Value {
        self.other.entry(name).or_insert_with(|| json!({}))
    }

    /// Sets what is no list, such as `scene`.
    pub fn set(&mut self, name: &str, value: Value) {
        self.other.insert(name.to_owned(), value);
    }

    /// A list of the document's top level, such as `meshes`; empty where it has none.
    pub fn list(&mut self, name: &str) -> &mut Vec<Value> {
        self.lists.entry(name.to_owned()).or_default()
    }

    /// Adds an entry to a list and returns its index.
    pub fn push(&mut self, list: &str, entry: Value) -> usize {
        let list = self.list(list);
        list.push(entry);
        list.len() - 1
    }

    /// Names an extension that the document uses.
    pub fn uses(&mut self, extension: &str) {
        let used = self.list("extensionsUsed");
        if !used.iter().any(|known| known == extension) {
            used.push(extension.into());
        }
    }

    /// Adds vertex attributes, interleaved; `rows` has the floats of each vertex in the order of the columns. Returns the accessor of each.
    ///
    /// # Errors
    /// Run time: values that are not finite, or too many columns for one stride.
    pub fn attributes(&mut self, columns: &[Column], rows: &[f32]) -> Result<Vec<usize>> {
        let width: usize = columns.iter().map(|column| column.width).sum();
        let stride = 4 * width;
        if width == 0 || stride > MOST_STRIDE || !rows.len().is_multiple_of(width) || rows.is_empty() {
            return Err(Error::runtime(format!("{} floats are no vertices of {width}", rows.len())));
        }
        if rows.iter().any(|value| !value.is_finite()) {
            let names: Vec<&str> = columns.iter().map(|column| column.name.as_str()).collect();
            return Err(Error::runtime(format!("{}: a value is beyond single precision", names.join(", "))));
        }
        let count = rows.len() / width;
        let bytes: Vec<u8> = rows.iter().flat_map(|value| value.to_le_bytes()).collect();
        let [least, most] = bounds(&bytes, (stride, stride), FLOAT.into());
        // Interleaved, because engines may have as few as eight buffers of vertices.
        let view = self.view(&bytes, Some(VERTICES), (columns.len() > 1).then_some(stride));
        let mut first = 0;
        let mut accessors = Vec::new();
        for column in columns {
            let kind = ["SCALAR", "VEC2", "VEC3", "VEC4"].get(column.width.wrapping_sub(1));
            let kind = kind.ok_or_else(|| Error::runtime(format!("{}: {} floats", column.name, column.width)))?;
            let own = first..first + column.width;
            accessors.push(self.push(
                "accessors",
                json!({ "bufferView": view, "byteOffset": 4 * first, "componentType": FLOAT, "count": count, "type": kind,
                    "min": least[own.clone()], "max": most[own] }),
            ));
            first += column.width;
        }
        Ok(accessors)
    }

    /// Adds the corners of triangles and returns their accessor.
    pub fn triangles(&mut self, triangles: &[[u32; 3]]) -> usize {
        let corners = triangles.as_flattened();
        let most = corners.iter().max().copied().unwrap_or_default();
        // The largest number of each type is a mark for another purpose.
        let (bytes, component): (Vec<u8>, u32) = if most < u32::from(u16::MAX) {
            (corners.iter().flat_map(|corner| (*corner as u16).to_le_bytes()).collect(), UNSIGNED_SHORT)
        } else {
            (corners.iter().flat_map(|corner| corner.to_le_bytes()).collect(), UNSIGNED_INT)
        };
        let view = self.view(&bytes, Some(INDICES), None);
        self.push(
            "accessors",
            json!({ "bufferView": view, "componentType": component, "count": corners.len(), "type": "SCALAR" }),
        )
    }

    /// Adds a PNG with a texture that shows it, ends at its edges, and returns the texture.
    pub fn texture(&mut self, png: &[u8], name: &str) -> usize {
        let view = self.view(png, None, None);
        let image = self.push("images", json!({ "bufferView": view, "mimeType": "image/png", "name": name }));
        // Linear filters, clamped to the edge.
        let sampler = json!({ "magFilter": 9729, "minFilter": 9987, "wrapS": 33071, "wrapT": 33071 });
        let sampler = self.push("samplers", sampler);
        self.push("textures", json!({ "source": image, "sampler": sampler, "name": name }))
    }

    /// Adds the elements of accessors of the document that have these indices, as accessors of their own, in the same order.
    ///
    /// # Errors
    /// Invalid input: an accessor whose bytes do not fit; indices beyond it.
    pub fn gathered(&mut self, accessors: &[usize], indices: &[u32]) -> Result<Vec<usize>> {
        let root = document::parse(self.text()?.as_slice())?;
        let packed = |&index: &usize| {
            let buffers = Buffers::new(&root, Some(&self.binary), Path::new(""));
            Accessors::new(&root, buffers).bytes(index).map_err(|e| e.at(format!("accessor {index}")))
        };
        let packed: Vec<(Vec<u8>, usize)> = accessors.iter().map(packed).collect::<Result<_>>()?;
        let each = accessors.iter().zip(packed);
        each.map(|(index, (bytes, size))| self.chosen(*index, &bytes, size, indices)).collect()
    }

    /// The same of one accessor, whose elements these bytes are.
    fn chosen(&mut self, accessor: usize, bytes: &[u8], size: usize, indices: &[u32]) -> Result<usize> {
        let stride = size.next_multiple_of(ALIGNMENT);
        let mut chosen = Vec::with_capacity(indices.len() * stride);
        for index in indices {
            let start = *index as usize * size;
            let element = bytes.get(start..start + size);
            let missing = || Error::input(format!("accessor {accessor} has no element {index}"));
            chosen.extend_from_slice(element.ok_or_else(missing)?);
            chosen.resize(chosen.len().next_multiple_of(ALIGNMENT), 0);
        }
        let view = self.view(&chosen, Some(VERTICES), (stride != size).then_some(stride));
        let source = self.list("accessors").get(accessor).cloned().unwrap_or_default();
        let mut result = json!({ "bufferView": view, "count": indices.len() });
        for key in ["componentType", "type", "normalized", "name", "extras"] {
            if let Some(value) = source.get(key) {
                result[key] = value.clone();
            }
        }
        if source.get("min").is_some() {
            let kind = source.get("componentType").and_then(Value::as_u64).unwrap_or_default();
            let [least, most] = bounds(&chosen, (size, stride), kind);
            result["min"] = least.into();
            result["max"] = most.into();
        }
        Ok(self.push("accessors", result))
    }

    /// The document as JSON.
    fn text(&self) -> Result<Vec<u8>> {
        let mut all = self.other.clone();
        let lists = self.lists.iter().filter(|(name, list)| !list.is_empty() && name.as_str() != "buffers");
        all.extend(lists.map(|(name, list)| (name.clone(), Value::Array(list.clone()))));
        if !self.binary.is_empty() {
            all.insert("buffers".to_owned(), json!([{ "byteLength": self.binary.len() }]));
        }
        serde_json::to_vec(&all).map_err(|e| Error::runtime(format!("glTF: {e}")))
    }

    /// The file, a GLB.
    ///
    /// # Errors
    /// Run time: more than the 4 GiB that a GLB may have.
    pub fn to_glb(mut self) -> Result<Vec<u8>> {
        let mut text = self.text()?;
        text.resize(text.len().next_multiple_of(ALIGNMENT), b' ');
        self.binary.resize(self.binary.len().next_multiple_of(ALIGNMENT), 0);
        let mut chunks: Vec<(&[u8; 4], &[u8])> = vec![(b"JSON", &text)];
        if !self.binary.is_empty() {
            chunks.push((b"BIN\0", &self.binary));
        }
        let length = 12 + chunks.iter().map(|(_, bytes)| 8 + bytes.len()).sum::<usize>();
        let declared = u32::try_from(length);
        let declared =
            declared.map_err(|_| Error::runtime(format!("a GLB of {length} bytes: it may have 4 GiB at most")))?;
        let mut file = Vec::with_capacity(length);
        file.extend_from_slice(b"glTF");
        file.extend(2_u32.to_le_bytes());
        file.extend(declared.to_le_bytes());
        for (kind, bytes) in chunks {
            file.extend((bytes.len() as u32).to_le_bytes());
            file.extend_from_slice(kind);
            file.extend_from_slice(bytes);
        }
        Ok(file)
    }

    /// Adds bytes to the chunk, aligned, and returns their place.
    fn append(&mut self, bytes: &[u8]) -> usize {
        self.binary.resize(self.binary.len().next_multiple_of(ALIGNMENT), 0);
        let start = self.binary.len();
        self.binary.extend_from_slice(bytes);
        start
    }

    fn view(&mut self, bytes: &[u8], target: Option<u32>, stride: Option<usize>) -> usize {
        let start = self.append(bytes);
        let mut view = json!({ "buffer": 0, "byteOffset": start, "byteLength": bytes.len() });
        if let Some(target) = target {
            view["target"] = target.into();
        }
        if let Some(stride) = stride {
            view["byteStride"] = stride.into();
        }
        self.push("bufferViews", view)
    }

    /// Makes views of several buffers views of one, in which they begin at these places. Extensions of views that name buffers likewise.
    fn rebase(&mut self, starts: &[usize]) {
        let rebase = |view: &mut Value| {
            let of = |key: &str| view.get(key).and_then(Value::as_u64).unwrap_or_default() as usize;
            let start = starts.get(of("buffer")).copied().unwrap_or_default() + of("byteOffset");
            view["buffer"] = 0.into();
            view["byteOffset"] = start.into();
        };
        for view in self.list("bufferViews") {
            rebase(view);
            let extensions = view.get_mut("extensions").and_then(Value::as_object_mut);
            extensions.into_iter().flat_map(Map::values_mut).filter(|e| e.get("buffer").is_some()).for_each(rebase);
        }
    }

    /// Takes in the pictures that lie beside the file.
    fn take_pictures(&mut self, folder: &Path) -> Result<()> {
        for index in 0..self.list("images").len() {
            let image = &self.list("images")[index];
            let uri = image.get("uri").and_then(Value::as_str).filter(|uri| !uri.starts_with("data:"));
            let Some(uri) = uri.map(str::to_owned) else { continue };
            let place = format!("image {index}");
            let path = folder.join(confined_path(&uri).map_err(|e| e.at(&place))?);
            let bytes = std::fs::read(&path).map_err(|e| Error::io(&path, &e).at(&place))?;
            let unknown =
                || Error::unsupported(format!("{place}, {}: neither PNG, JPEG, WebP nor KTX2", path.display()));
            let kind = mime_type(&bytes).ok_or_else(unknown)?;
            let view = self.view(&bytes, None, None);
            if let Value::Object(image) = &mut self.list("images")[index] {
                image.remove("uri");
                image.insert("bufferView".to_owned(), view.into());
                image.insert("mimeType".to_owned(), kind.into());
            }
        }
        Ok(())
    }
}

/// Makes bounds of floats floats again: what JSON says in decimals is read a last digit off, and bounds must be exact.
fn round_bounds(accessor: &mut Value) {
    if accessor.get("componentType").and_then(Value::as_u64) != Some(FLOAT.into()) {
        return;
    }
    for bound in ["min", "max"] {
        for value in accessor.get_mut(bound).and_then(Value::as_array_mut).into_iter().flatten() {
            if let Some(number) = value.as_f64().map(|number| number as f32).filter(|number| number.is_finite()) {
                *value = f64::from(number).into();
            }
        }
    }
}

/// The media type of a picture, by its first bytes.
fn mime_type(bytes: &[u8]) -> Option<&'static str> {
    let starts = |with: &[u8]| bytes.starts_with(with);
    match () {
        () if starts(b"\x89PNG") => Some("image/png"),
        () if starts(b"\xff\xd8\xff") => Some("image/jpeg"),
        () if starts(b"RIFF") && bytes.get(8..12) == Some(b"WEBP") => Some("image/webp"),
        () if starts(b"\xabKTX 20\xbb") => Some("image/ktx2"),
        () => None,
    }
}

/// Least and largest of each component of elements of `size` bytes, `stride` bytes apart, of a component type of glTF.
fn bounds(bytes: &[u8], (size, stride): (usize, usize), kind: u64) -> [Vec<f64>; 2] {
    let of = |b: &[u8]| match (kind, b) {
        (5_120, &[a]) => f64::from(a as i8),
        (5_121, &[a]) => f64::from(a),
        (5_122, &[a, b]) => f64::from(i16::from_le_bytes([a, b])),
        (5_123, &[a, b]) => f64::from(u16::from_le_bytes([a, b])),
        (5_125, &[a, b, c, d]) => f64::from(u32::from_le_bytes([a, b, c, d])),
        (_, &[a, b, c, d]) => f64::from(f32::from_le_bytes([a, b, c, d])),
        _ => 0.0,
    };
    let width = match kind {
        5_120 | 5_121 => 1,
        5_122 | 5_123 => 2,
        _ => 4,
    };
    let mut result = [vec![f64::INFINITY; size / width], vec![f64::NEG_INFINITY; size / width]];
    for element in bytes.chunks_exact(stride.max(1)) {
        for (c, component) in element[..size].chunks_exact(width).enumerate() {
            let value = of(component);
            result[0][c] = result[0][c].min(value);
            result[1][c] = result[1][c].max(value);
        }
    }
    result
}
