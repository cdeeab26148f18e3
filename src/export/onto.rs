//! Attributes added to a file that is there: its nodes, names, materials and other attributes stay.

use std::collections::{HashMap, HashSet};

use glam::Vec2;
use serde_json::{Map, Value, json};

use super::fresh::{Content, downwards};
use super::lightmap::Placed;
use super::{attach, tell, tell_of_file, translucent_vertices};
use crate::error::{Error, Result};
use crate::io::gltf::written::{Column, Document};
use crate::io::gltf::{PlacedMesh, PlacedPrimitive};
use crate::scene::Scene;

/// Adds the content to the file that a scene was read from. A mesh that several nodes place is copied, since its vertices have values of
/// their own wherever it stands; primitives of opaque parts, or of none, stay as they are.
///
/// # Errors
/// Invalid input: a file with another number of vertices. Unsupported: a node that places a mesh several times.
pub fn add(mut document: Document, placed: &[PlacedMesh], scene: &Scene, content: &Content<'_>) -> Result<Document> {
    let vertices: usize = placed.iter().flat_map(|mesh| &mesh.primitives).map(|primitive| primitive.vertices).sum();
    let expected = scene.mesh.local_mm.len();
    if vertices != expected {
        return Err(Error::input(format!(
            "it has {vertices} vertices, and the asset was made of {expected}: is it that model?"
        )));
    }
    let texture = content.map.map(|(_, png)| document.texture(png, "light map"));
    let adder =
        Adder { scene, content, texture, translucent: translucent_vertices(scene), triangles: by_first_vertex(scene) };
    let meshes = document.list("meshes").clone();
    let mut taken = HashSet::new();
    for of in placed {
        if of.instances > 1 {
            return Err(Error::unsupported(format!(
                "mesh {} stands in {} places of one node (EXT_mesh_gpu_instancing), whose vertices have no values of their own: give each a \
                 node, or leave --scene out",
                of.mesh, of.instances
            )));
        }
        let Some(mut mesh) = meshes.get(of.mesh).cloned() else { continue };
        let mut has_changed = false;
        for primitive in &of.primitives {
            has_changed |= adder.add(&mut document, &mut mesh, primitive, of.mirrors)?;
        }
        if !has_changed {
            continue;
        }
        if let Some(extras) = content.extras {
            tell(&mut mesh, extras);
        }
        if taken.insert(of.mesh) {
            document.list("meshes")[of.mesh] = mesh;
        } else {
            let index = document.push("meshes", mesh);
            if let Some(node) = of.node.and_then(|node| document.list("nodes").get_mut(node)) {
                node["mesh"] = index.into();
            }
        }
    }
    tell_of_file(&mut document, content.extras, content.table);
    Ok(document)
}

/// Triangles of the mesh in the order of the least of their vertices.
fn by_first_vertex(scene: &Scene) -> Vec<(u32, u32)> {
    let least = |(triangle, corners): (usize, &[u32; 3])| (corners[0].min(corners[1]).min(corners[2]), triangle as u32);
    let mut all: Vec<(u32, u32)> = scene.mesh.triangles.iter().enumerate().map(least).collect();
    all.sort_unstable();
    all
}

struct Adder<'a> {
    scene: &'a Scene,
    content: &'a Content<'a>,
    texture: Option<usize>,
    translucent: Vec<bool>,
    /// Least vertex and index of each triangle, ascending.
    triangles: Vec<(u32, u32)>,
}

impl Adder<'_> {
    /// Changes a primitive of a mesh; returns whether it did.
    fn add(&self, document: &mut Document, mesh: &mut Value, of: &PlacedPrimitive, mirrors: bool) -> Result<bool> {
        let own = of.first_vertex..of.first_vertex + of.vertices;
        if !self.translucent.get(own.clone()).is_some_and(|own| own.contains(&true)) {
            return Ok(false);
        }
        let Some(primitive) = mesh.get_mut("primitives").and_then(|all| all.get_mut(of.index)) else {
            return Ok(false);
        };
        let attributes = primitive.get("attributes").and_then(Value::as_object);
        let mut attributes = attributes.cloned().unwrap_or_default();
        // Its data would stand for attributes without what is added here; those beside it are whole.
        if let Some(extensions) = primitive.get_mut("extensions").and_then(Value::as_object_mut) {
            extensions.remove("KHR_draco_mesh_compression");
        }
        let mut vertices: Vec<u32> = own.map(|vertex| vertex as u32).collect();
        if let Some((placed, _)) = self.content.map {
            let set = match placed.is_own() {
                true => 0,
                false => self.cut(document, primitive, (&mut attributes, &mut vertices), (placed, of, mirrors))?,
            };
            let told = json!({ "lightmap": { "index": self.texture, "texCoord": set } });
            tell(primitive, &told);
        }
        if let Some(data) = self.content.data {
            let rows = data.gathered(vertices.iter().copied());
            attach(document, &mut attributes, &data.columns, (&rows, vertices.len()))?;
        }
        primitive["attributes"] = attributes.into();
        Ok(true)
    }

    /// Cuts a primitive along the seams of a map, whose coordinates become its next set; returns the set's number.
    fn cut(
        &self,
        document: &mut Document,
        primitive: &mut Value,
        (attributes, vertices): (&mut Map<String, Value>, &mut Vec<u32>),
        (placed, of, mirrors): (&Placed, &PlacedPrimitive, bool),
    ) -> Result<usize> {
        let (first, end) = (of.first_vertex as u32, (of.first_vertex + of.vertices) as u32);
        let from = self.triangles.partition_point(|&(least, _)| least < first);
        let mut own: Vec<u32> = self.triangles[from..].iter().take_while(|(v, _)| *v < end).map(|&(_, t)| t).collect();
        own.sort_unstable();
        let mut known: HashMap<(u32, [u32; 2]), u32> = HashMap::new();
        let (mut sources, mut rows, mut triangles) = (Vec::new(), Vec::new(), Vec::with_capacity(own.len()));
        for triangle in own {
            let corners = self.scene.mesh.triangles[triangle as usize];
            let places = placed.atlas.corners.get(triangle as usize).copied().unwrap_or([Vec2::ZERO; 3]);
            let [a, b, c] = [0, 1, 2].map(|corner| {
                let (vertex, place) = (corners[corner], places[corner]);
                *known.entry((vertex, place.to_array().map(f32::to_bits))).or_insert_with(|| {
                    sources.push(vertex);
                    rows.extend(downwards(place));
                    sources.len() as u32 - 1
                })
            });
            triangles.push(if mirrors { [a, c, b] } else { [a, b, c] });
        }
        let in_primitive: Vec<u32> = sources.iter().map(|vertex| vertex - first).collect();
        let index = |value: &Value| value.as_u64().map(|index| index as usize);
        let chosen = |document: &mut Document, of: &Map<String, Value>| -> Result<Map<String, Value>> {
            let names: Vec<&String> = of.keys().collect();
            let accessors: Vec<usize> = of.values().filter_map(index).collect();
            let gathered = document.gathered(&accessors, &in_primitive)?;
            Ok(names.into_iter().cloned().zip(gathered.into_iter().map(Value::from)).collect())
        };
        *attributes = chosen(document, attributes)?;
        for target in primitive.get_mut("targets").and_then(Value::as_array_mut).into_iter().flatten() {
            if let Some(map) = target.as_object() {
                *target = chosen(document, map)?.into();
            }
        }
        let set = (0..).find(|set| !attributes.contains_key(&format!("TEXCOORD_{set}"))).unwrap_or_default();
        attach(document, attributes, &[Column::new(format!("TEXCOORD_{set}"), 2)], (&rows, sources.len()))?;
        primitive["indices"] = document.triangles(&triangles).into();
        primitive["mode"] = 4.into();
        *vertices = sources;
        Ok(set)
    }
}
