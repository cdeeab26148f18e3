//! Stanford PLY: writing of per-vertex results (binary), reading of vertex properties (text and binary little-endian).
//!
//! Format: Greg Turk, "The PLY Polygon File Format", 1994.

use std::path::Path;

use crate::error::{Error, Result};

mod header;
#[cfg(test)]
mod tests;

use header::{Element, Encoding, Header, Kind, Property, Scalar};

/// Radiosity of a mesh, vertex by vertex in source order, ready to be written.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RadiosityPly {
    /// Vertex positions, in the unit of the caller (state it in a comment). Written as `x y z`.
    pub positions: Vec<[f32; 3]>,
    /// Colours for viewers, sRGB-encoded. Written as `red green blue`.
    pub colors: Vec<[u8; 3]>,
    /// Radiosity, linear RGB. Written as `b_r b_g b_b`.
    pub b: Vec<[f32; 3]>,
    /// Single scattering, linear RGB. Written as `s_r s_g s_b`.
    pub s: Option<Vec<[f32; 3]>>,
    /// Further properties: a name and one value for each vertex. Written as `float` after the others, in this order.
    pub columns: Vec<(&'static str, Vec<f32>)>,
    /// Triangles; without any, the file has no `face` element.
    pub triangles: Vec<[u32; 3]>,
    /// Comments of the header for people: material, light, unit.
    pub comments: Vec<String>,
}

/// The scalar properties of the `vertex` element of a PLY file; every value is finite.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PlyVertexTable {
    /// Number of vertices.
    pub vertex_count: usize,
    /// Name and one value for each vertex, in the order of the header. A `float` keeps the value it has in 32 bits.
    pub columns: Vec<(String, Vec<f64>)>,
    /// Comments of the header.
    pub comments: Vec<String>,
    /// Faces of the `face` element, polygons cut into fans; every index is that of a vertex.
    pub triangles: Vec<[u32; 3]>,
}

impl PlyVertexTable {
    /// The values of a property, if the file has it.
    pub fn column(&self, name: &str) -> Option<&[f64]> {
        self.columns.iter().find(|(known, _)| known == name).map(|(_, values)| values.as_slice())
    }

    /// Three properties joined for each vertex, such as `["x", "y", "z"]` or `["b_r", "b_g", "b_b"]`; none unless the
    /// file has all three.
    pub fn triples(&self, names: [&str; 3]) -> Option<Vec<[f64; 3]>> {
        let [Some(a), Some(b), Some(c)] = names.map(|name| self.column(name)) else { return None };
        Some(a.iter().zip(b).zip(c).map(|((&a, &b), &c)| [a, b, c]).collect())
    }
}

/// The bytes of a binary little-endian PLY file. The same input gives the same bytes.
///
/// # Errors
/// Run-time failure where the arrays do not match each other, a value is not finite, or a triangle refers to a vertex
/// that does not exist: such a file is never written.
pub fn write_ply(ply: &RadiosityPly) -> Result<Vec<u8>> {
    check_radiosity(ply)?;
    let mut bytes = header_of(ply).into_bytes();
    let row = 12 + 3 + 12 + if ply.s.is_some() { 12 } else { 0 } + 4 * ply.columns.len();
    bytes.reserve(row * ply.positions.len() + 13 * ply.triangles.len());
    for (vertex, ((position, color), b)) in ply.positions.iter().zip(&ply.colors).zip(&ply.b).enumerate() {
        bytes.extend(position.iter().flat_map(|value| value.to_le_bytes()));
        bytes.extend(color);
        bytes.extend(b.iter().flat_map(|value| value.to_le_bytes()));
        if let Some(s) = &ply.s {
            bytes.extend(s[vertex].iter().flat_map(|value| value.to_le_bytes()));
        }
        bytes.extend(ply.columns.iter().flat_map(|(_, values)| values[vertex].to_le_bytes()));
    }
    for triangle in &ply.triangles {
        bytes.push(3);
        bytes.extend(triangle.iter().flat_map(|index| index.to_le_bytes()));
    }
    Ok(bytes)
}

fn header_of(ply: &RadiosityPly) -> String {
    let mut text = String::from("ply\nformat binary_little_endian 1.0\n");
    for line in ply.comments.iter().flat_map(|comment| comment.split(['\n', '\r'])) {
        let line = line.replace(char::is_control, " ");
        if !line.trim().is_empty() {
            text += &format!("comment {}\n", line.trim());
        }
    }
    text += &format!("element vertex {}\n", ply.positions.len());
    let columns = [("float", "x y z"), ("uchar", "red green blue"), ("float", "b_r b_g b_b"), ("float", "s_r s_g s_b")];
    for (kind, names) in &columns[..if ply.s.is_some() { 4 } else { 3 }] {
        for name in names.split(' ') {
            text += &format!("property {kind} {name}\n");
        }
    }
    for (name, _) in &ply.columns {
        text += &format!("property float {name}\n");
    }
    if !ply.triangles.is_empty() {
        text += &format!("element face {}\nproperty list uchar int vertex_indices\n", ply.triangles.len());
    }
    text + "end_header\n"
}

fn check_radiosity(ply: &RadiosityPly) -> Result<()> {
    let n = ply.positions.len();
    let s_len = ply.s.as_ref().map_or(n, Vec::len);
    if ply.colors.len() != n || ply.b.len() != n || s_len != n {
        let (colors, b) = (ply.colors.len(), ply.b.len());
        return Err(Error::runtime(format!("PLY: {n} positions, {colors} colours, {b} and {s_len} radiosities")));
    }
    let no_values = Vec::new();
    let s = ply.s.as_ref().unwrap_or(&no_values);
    for (what, values) in [("position", &ply.positions), ("radiosity", &ply.b), ("single scattering", s)] {
        if let Some(vertex) = values.iter().position(|value| !value.iter().all(|v| v.is_finite())) {
            return Err(Error::runtime(format!("PLY: the {what} of vertex {vertex} is not finite")));
        }
    }
    for (name, values) in &ply.columns {
        if values.len() != n {
            return Err(Error::runtime(format!("PLY: {n} positions, {} values of `{name}`", values.len())));
        }
        if let Some(vertex) = values.iter().position(|value| !value.is_finite()) {
            return Err(Error::runtime(format!("PLY: `{name}` of vertex {vertex} is not finite")));
        }
    }
    // Indices are written as the signed 32-bit type that every reader knows.
    let limit = n.min(i32::MAX as usize);
    if ply.triangles.iter().flatten().any(|&index| index as usize >= limit) {
        return Err(Error::runtime(format!("PLY: a triangle refers to a vertex outside of the {limit} possible ones")));
    }
    Ok(())
}

/// Reads the vertex properties of a PLY file.
///
/// # Errors
/// I/O where the file cannot be read; otherwise as [`parse_ply`].
pub fn read_ply(path: &Path) -> Result<PlyVertexTable> {
    let bytes = std::fs::read(path).map_err(|error| Error::io(path, &error))?;
    parse_ply(&bytes, &path.display().to_string()).map_err(|error| error.of_file(path))
}

/// Parses the bytes of a PLY file; `name` stands in front of every error. The scalars of `vertex` and the vertex
/// indices of `face` are kept, everything else is skipped.
///
/// # Errors
/// Invalid input where the header or a row is malformed, a vertex value is not finite, or the data is shorter or longer
/// than the header says (checked before memory is asked for). Unsupported for big-endian files.
pub fn parse_ply(bytes: &[u8], name: &str) -> Result<PlyVertexTable> {
    parse(bytes).map_err(|error| error.at(name))
}

fn parse(bytes: &[u8]) -> Result<PlyVertexTable> {
    let header = Header::parse(bytes)?;
    let data = &bytes[header.data_start..];
    let mut table = PlyVertexTable { comments: header.comments, ..PlyVertexTable::default() };
    match header.encoding {
        Encoding::Text => {
            let mut rows = TextRows { rest: data, line: header.data_line };
            for element in &header.elements {
                rows.element(element, &mut table)?;
            }
            if rows.next_row().is_some() {
                return Err(Error::input(format!("line {}: more rows than the header counts", rows.line - 1)));
            }
        }
        Encoding::BinaryLittleEndian => {
            let mut rows = BinaryRows { rest: data };
            for element in &header.elements {
                rows.element(element, &mut table)?;
            }
            if !rows.rest.is_empty() {
                return Err(Error::input(format!("{} bytes more than the header counts", rows.rest.len())));
            }
        }
    }
    let vertices = table.vertex_count;
    if let Some(index) = table.triangles.iter().flatten().find(|&&index| index as usize >= vertices) {
        return Err(Error::input(format!("a face refers to vertex {index} of {vertices}")));
    }
    Ok(table)
}

fn too_short(element: &Element) -> Error {
    Error::input(format!(
        "the file ends within the {} rows of element `{}`: it is cut off",
        element.count, element.name
    ))
}

/// Makes the columns of the vertex element, once its length has been checked against the available bytes.
fn start_table(element: &Element, table: &mut PlyVertexTable) {
    table.vertex_count = element.count;
    let scalars = element.properties.iter().filter(|property| matches!(property.kind, Kind::Scalar(_)));
    table.columns = scalars.map(|property| (property.name.clone(), Vec::with_capacity(element.count))).collect();
}

fn finite(value: f64, row: usize, property: &Property) -> Result<f64> {
    if value.is_finite() {
        return Ok(value);
    }
    Err(Error::input(format!("`{}` of vertex {row} is not finite", property.name)))
}

/// Reads a row; `value` gives its numbers one after the other.
fn read_row(
    element: &Element,
    row: usize,
    table: &mut PlyVertexTable,
    mut value: impl FnMut(Scalar, &Property) -> Result<f64>,
) -> Result<()> {
    let mut column = 0;
    for property in &element.properties {
        match property.kind {
            Kind::Scalar(scalar) => {
                let number = value(scalar, property)?;
                if element.is_vertex() {
                    table.columns[column].1.push(finite(number, row, property)?);
                    column += 1;
                }
            }
            Kind::List { count, item } => {
                let length = value(count, property)?;
                if length < 0.0 {
                    return Err(Error::input(format!("list `{}` of length {length}", property.name)));
                }
                let mut fan = Fan::new(element, property);
                // At most 2^32 - 1: lengths are of integer types.
                for _ in 0..length as usize {
                    fan.corner(value(item, property)?, table);
                }
            }
        }
    }
    Ok(())
}

/// Rows of numbers, one to a line.
struct TextRows<'a> {
    rest: &'a [u8],
    /// Number of the first line of `rest`.
    line: usize,
}

impl<'a> TextRows<'a> {
    fn next_row(&mut self) -> Option<&'a [u8]> {
        while !self.rest.is_empty() {
            let end = self.rest.iter().position(|&byte| byte == b'\n').unwrap_or(self.rest.len());
            let row = self.rest[..end].trim_ascii();
            self.rest = self.rest.get(end + 1..).unwrap_or_default();
            self.line += 1;
            if !row.is_empty() {
                return Some(row);
            }
        }
        None
    }

    fn element(&mut self, element: &Element, table: &mut PlyVertexTable) -> Result<()> {
        if element.properties.is_empty() {
            return Ok(());
        }
        // A value and what separates it from the next take two bytes; the last line end may be missing.
        let least = element.count.checked_mul(2 * element.properties.len());
        if least.is_none_or(|least| least > self.rest.len() + 1) {
            return Err(too_short(element));
        }
        if element.is_vertex() {
            start_table(element, table);
        }
        for row in 0..element.count {
            let text = self.next_row().ok_or_else(|| too_short(element))?;
            let line = self.line - 1;
            self.row(element, row, text, table).map_err(|error| error.at(format!("line {line}")))?;
        }
        Ok(())
    }

    fn row(&self, element: &Element, row: usize, text: &[u8], table: &mut PlyVertexTable) -> Result<()> {
        let mut words = text.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
        // The words of the line bound the loop over a list, whatever its length says.
        read_row(element, row, table, |scalar, property| {
            let word = words
                .next()
                .ok_or_else(|| Error::input(format!("row {row} of `{}` has no `{}`", element.name, property.name)))?;
            scalar.parse(word).ok_or_else(|| {
                let word: String =
                    String::from_utf8_lossy(word).chars().take(40).flat_map(char::escape_debug).collect();
                Error::input(format!("`{word}` is no {} for `{}`", scalar.name(), property.name))
            })
        })?;
        if words.next().is_some() {
            return Err(Error::input(format!("row {row} of `{}` has too many values", element.name)));
        }
        Ok(())
    }
}

/// Cuts one face into a fan while its corners arrive.
struct Fan {
    kept: bool,
    first: Option<u32>,
    last: Option<u32>,
}

impl Fan {
    fn new(element: &Element, property: &Property) -> Self {
        let kept = element.name == "face" && matches!(property.name.as_str(), "vertex_indices" | "vertex_index");
        Self { kept, first: None, last: None }
    }

    fn corner(&mut self, index: f64, table: &mut PlyVertexTable) {
        if !self.kept {
            return;
        }
        // Negative and fractional indices saturate or round to something that the check of the range judges.
        let index = if index < 0.0 { u32::MAX } else { index as u32 };
        match (self.first, self.last) {
            (Some(first), Some(last)) => {
                table.triangles.push([first, last, index]);
                self.last = Some(index);
            }
            (Some(_), None) => self.last = Some(index),
            (None, _) => self.first = Some(index),
        }
    }
}

/// Rows of little-endian numbers without gaps.
struct BinaryRows<'a> {
    rest: &'a [u8],
}

impl BinaryRows<'_> {
    fn element(&mut self, element: &Element, table: &mut PlyVertexTable) -> Result<()> {
        let least_row: usize = element.properties.iter().map(|property| property.least_bytes()).sum();
        let least = element.count.checked_mul(least_row).filter(|&least| least <= self.rest.len());
        let least = least.ok_or_else(|| too_short(element))?;
        if element.is_vertex() {
            start_table(element, table);
        } else if element.properties.iter().all(|property| matches!(property.kind, Kind::Scalar(_))) {
            self.rest = &self.rest[least..];
            return Ok(());
        }
        for row in 0..element.count {
            read_row(element, row, table, |scalar, _| {
                let (bytes, rest) = self.rest.split_at_checked(scalar.bytes()).ok_or_else(|| too_short(element))?;
                self.rest = rest;
                Ok(scalar.decode(bytes))
            })?;
        }
        Ok(())
    }
}
