//! Transport handed on to engines as glTF: radiosity as colours of vertices or as a light map, transfer as spherical harmonics,
//! or as functions that serve edits of the material too. Beside them a page for browsers ([`page`]).
//!
//! A document is either made of the asset's mesh ([`fresh`]), or a file that is there, to which attributes are added ([`onto`]).

pub mod basis;
pub mod colours;
pub mod fresh;
mod functions;
pub mod harmonics;
pub mod lightmap;
pub mod onto;
pub mod page;
mod raster;

use serde_json::{Map, Value};

use crate::error::{Error, Result};
use crate::io::gltf::written::{Column, Document};
use crate::scene::Scene;

/// Floats of a vertex that Godot takes from a file beside position, normal, colour and two texture coordinates: `CUSTOM0` to `CUSTOM2`.
pub const GODOT_FLOATS: usize = 12;

/// First texture coordinates that Godot takes as `CUSTOM0`.
const GODOT_FIRST: usize = 2;

/// Floats for each source vertex of a mesh, as attributes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct VertexData {
    /// The attributes.
    pub columns: Vec<Column>,
    /// The floats of each vertex in the order of the columns.
    pub rows: Vec<f32>,
}

impl VertexData {
    /// Floats of a vertex.
    pub fn width(&self) -> usize {
        self.columns.iter().map(|column| column.width).sum()
    }

    /// The floats of some vertices, those of vertices that there are not 0.
    fn gathered(&self, vertices: impl Iterator<Item = u32>) -> Vec<f32> {
        let width = self.width();
        let mut rows = Vec::new();
        for vertex in vertices {
            let start = vertex as usize * width;
            match self.rows.get(start..start + width) {
                Some(row) => rows.extend_from_slice(row),
                None => rows.resize(rows.len() + width, 0.0),
            }
        }
        rows
    }

    /// The same with attributes of the program's own as `TEXCOORD_2` and on, two floats each, four by four: Godot's importer makes
    /// `CUSTOM0` to `CUSTOM2` of them, and reads no others.
    ///
    /// # Errors
    /// Unsupported: more floats than these have.
    pub fn for_godot(&self) -> Result<Self> {
        let own = |column: &&Column| column.name.starts_with('_');
        let floats: usize = self.columns.iter().filter(own).map(|column| column.width).sum();
        if floats > GODOT_FLOATS {
            return Err(Error::unsupported(format!(
                "--engine godot: {floats} floats a vertex, and Godot takes {GODOT_FLOATS} from a glTF file: --as sh1 has {GODOT_FLOATS}"
            )));
        }
        let padded = floats.next_multiple_of(4);
        let mut columns: Vec<Column> = self.columns.iter().filter(|column| !own(column)).cloned().collect();
        columns.extend((0..padded / 2).map(|i| Column::new(format!("TEXCOORD_{}", GODOT_FIRST + i), 2)));
        let mut rows = Vec::with_capacity(self.rows.len() / self.width().max(1) * (self.width() + padded - floats));
        for row in self.rows.chunks_exact(self.width().max(1)) {
            let (mut plain, mut custom, mut rest) = (Vec::new(), Vec::new(), row);
            for column in &self.columns {
                let (values, after) = rest.split_at(column.width);
                if own(&column) { &mut custom } else { &mut plain }.extend_from_slice(values);
                rest = after;
            }
            custom.resize(padded, 0.0);
            rows.extend(plain.into_iter().chain(custom));
        }
        Ok(Self { columns, rows })
    }
}

/// For each source vertex whether a triangle of a translucent part has it.
pub fn translucent_vertices(scene: &Scene) -> Vec<bool> {
    let mut result = vec![false; scene.mesh.local_mm.len()];
    for triangle in translucent_triangles(scene) {
        for vertex in scene.mesh.triangles[triangle as usize] {
            result[vertex as usize] = true;
        }
    }
    result
}

/// The triangles of translucent parts.
fn translucent_triangles(scene: &Scene) -> impl Iterator<Item = u32> {
    (0..scene.mesh.triangles.len() as u32).filter(|&triangle| scene.parts.transfers(triangle))
}

/// Puts attributes into a primitive; what it has of the same name goes to the next number (`COLOR_1`).
fn attach(
    document: &mut Document,
    attributes: &mut Map<String, Value>,
    columns: &[Column],
    (rows, vertices): (&[f32], usize),
) -> Result<()> {
    for (column, accessor) in columns.iter().zip(document.attributes(columns, rows)?) {
        if let Some((kind, "0")) = column.name.rsplit_once('_') {
            let mut moved = attributes.remove(&column.name);
            for next in 1.. {
                let Some(value) = moved.take() else { break };
                moved = attributes.insert(format!("{kind}_{next}"), value);
            }
        }
        attributes.insert(column.name.clone(), accessor.into());
    }
    // The numbers of texture coordinates must have no gaps.
    let number = |name: &String| name.strip_prefix("TEXCOORD_")?.parse::<usize>().ok();
    let sets = attributes.keys().filter_map(number).max().map_or(0, |most| most + 1);
    for missing in (0..sets).map(|set| format!("TEXCOORD_{set}")) {
        if !attributes.contains_key(&missing) {
            let zeros = document.attributes(&[Column::new(&missing, 2)], &vec![0.0; 2 * vertices])?;
            attributes.extend(zeros.into_iter().map(|accessor| (missing.clone(), accessor.into())));
        }
    }
    Ok(())
}

/// Adds what the program says of a file, mesh or material to its extras.
fn tell(object: &mut Value, what: &Value) {
    if !object.get("extras").is_some_and(Value::is_object) {
        object["extras"] = Value::Object(Map::new());
    }
    object["extras"]["translux"] = what.clone();
}

/// Adds what the program says of a file to the file: the same as of its meshes, and the table of functions of the vertices, where there are any.
fn tell_of_file(document: &mut Document, extras: Option<&Value>, table: Option<&Value>) {
    let asset = document.object("asset");
    if let Some(extras) = extras {
        tell(asset, extras);
    }
    if let Some(table) = table {
        asset["extras"]["translux"]["basis"] = table.clone();
    }
}

#[cfg(test)]
#[path = "tests.rs"]
mod tests;
