//! A document made of an asset's mesh: metres, a primitive for each material.

use std::collections::HashMap;

use glam::Vec2;
use serde_json::{Map, Value, json};

use super::lightmap::Placed;
use super::{VertexData, attach, tell, tell_of_file, translucent_vertices};
use crate::error::Result;
use crate::io::gltf::written::{Column, Document};
use crate::render::normals::ShadingNormals;
use crate::scene::Scene;

const M_PER_MM: f64 = 1e-3;

/// What is written beside the mesh.
#[derive(Clone, Copy, Default)]
pub struct Content<'a> {
    /// Attributes of the vertices.
    pub data: Option<&'a VertexData>,
    /// A light map, as PNG, and where it lies on the surface.
    pub map: Option<(&'a Placed, &'a [u8])>,
    /// Whether the file shows light that is in it already: materials of translucent parts are then not lit.
    pub is_lit: bool,
    /// What the file and each of its meshes say of themselves.
    pub extras: Option<&'a Value>,
    /// What the file says of its functions of the vertices, once.
    pub table: Option<&'a Value>,
}

/// Corners that share everything are one vertex.
type Key = (u32, [u32; 3], u32, [u32; 2]);

/// Vertices of a primitive while they are found.
#[derive(Default)]
struct Vertices {
    known: HashMap<Key, u32>,
    source: Vec<u32>,
    /// Position, normal, and texture coordinates where there are any.
    rows: Vec<f32>,
    triangles: Vec<[u32; 3]>,
}

/// Makes a document of a scene in metres, whose mesh and node have this name.
///
/// Normals are those of pictures: the source's where they can be used, else smooth ones but for creases of 60 degrees.
///
/// # Errors
/// Run time: values beyond single precision.
pub fn document(scene: &Scene, name: &str, content: &Content<'_>) -> Result<Document> {
    let mesh = &scene.mesh;
    let mut document = Document::default();
    let translucent = translucent_vertices(scene);
    let texture = content.map.map(|(_, png)| document.texture(png, "light map"));
    let own_set = content.map.is_some_and(|(placed, _)| placed.is_own());
    let mut columns = vec![Column::new("POSITION", 3), Column::new("NORMAL", 3)];
    columns.extend(mesh.uvs.is_some().then(|| Column::new("TEXCOORD_0", 2)));
    let set = columns.len() - 2;
    if content.map.is_some() && !own_set {
        columns.push(Column::new(format!("TEXCOORD_{set}"), 2));
    }
    let set = if own_set { 0 } else { set };
    let mut of_material: Vec<Vertices> = mesh.materials.iter().map(|_| Vertices::default()).collect();
    let normals = ShadingNormals::new(scene);
    for (triangle, corners) in mesh.triangles.iter().enumerate() {
        let Some(vertices) = of_material.get_mut(mesh.triangle_material[triangle] as usize) else { continue };
        let uv = |corner: usize| {
            let uvs = mesh.uvs.as_ref()?;
            let index = uvs.corners.get(triangle)?[corner];
            Some((index, *uvs.values.get(index as usize)?))
        };
        let map = |corner: usize| {
            let (placed, _) = content.map.filter(|_| !own_set)?;
            placed.atlas.corners.get(triangle).map(|corners| corners[corner])
        };
        vertices.triangles.push([0, 1, 2].map(|corner| {
            let normal = normals.at(triangle as u32, std::array::from_fn(|c| f64::from(u8::from(c == corner))));
            let normal =
                if normal.is_finite() && normal.length() > 0.5 { normal } else { normals.geometric(triangle as u32) };
            let normal = normal.as_vec3();
            let (vertex, uv, map) = (corners[corner], uv(corner), map(corner));
            let key = (
                vertex,
                normal.to_array().map(f32::to_bits),
                uv.map_or(u32::MAX, |(index, _)| index),
                map.unwrap_or_default().to_array().map(f32::to_bits),
            );
            *vertices.known.entry(key).or_insert_with(|| {
                vertices.source.push(vertex);
                let at = mesh.local_mm[vertex as usize].as_dvec3() * M_PER_MM;
                vertices.rows.extend(at.as_vec3().to_array());
                vertices.rows.extend(normal.to_array());
                if mesh.uvs.is_some() {
                    vertices
                        .rows
                        .extend(downwards(uv.map(|(_, uv)| uv).filter(|uv| uv.is_finite()).unwrap_or_default()));
                }
                vertices.rows.extend(map.map(downwards).into_iter().flatten());
                vertices.source.len() as u32 - 1
            })
        }));
    }
    let mut primitives = Vec::new();
    for (material, vertices) in mesh.materials.iter().zip(&of_material).filter(|(_, v)| !v.triangles.is_empty()) {
        let scatters = vertices.source.iter().any(|&v| translucent[v as usize]);
        let shown = texture.filter(|_| scatters).map(|texture| (texture, set));
        let material = document.push("materials", of(material, scatters && content.is_lit, shown));
        if scatters && content.is_lit {
            document.uses("KHR_materials_unlit");
        }
        let accessors = document.attributes(&columns, &vertices.rows)?;
        let mut attributes: Map<String, Value> =
            columns.iter().zip(accessors).map(|(column, accessor)| (column.name.clone(), accessor.into())).collect();
        if let Some(data) = content.data.filter(|_| scatters) {
            let rows = data.gathered(vertices.source.iter().copied());
            attach(&mut document, &mut attributes, &data.columns, (&rows, vertices.source.len()))?;
        }
        let indices = document.triangles(&vertices.triangles);
        primitives.push(json!({ "attributes": attributes, "indices": indices, "material": material }));
    }
    document.push("meshes", json!({ "name": name, "primitives": primitives }));
    let origin = (mesh.origin_mm * M_PER_MM).as_vec3().to_array();
    document.push("nodes", json!({ "name": name, "mesh": 0, "translation": origin }));
    document.push("scenes", json!({ "nodes": [0] }));
    document.set("scene", 0.into());
    if let Some(extras) = content.extras {
        tell(&mut document.list("meshes")[0], extras);
    }
    tell_of_file(&mut document, content.extras, content.table);
    Ok(document)
}

/// Texture coordinates of glTF, whose v points down.
pub(super) fn downwards(uv: Vec2) -> [f32; 2] {
    [uv.x, 1.0 - uv.y]
}

/// A material: dielectric, white, and not lit where it shows light that is in the file.
fn of(name: &str, is_lit: bool, texture: Option<(usize, usize)>) -> Value {
    let mut material =
        json!({ "name": name, "pbrMetallicRoughness": { "metallicFactor": 0.0, "roughnessFactor": 0.5 } });
    if let Some((texture, set)) = texture {
        material["pbrMetallicRoughness"]["baseColorTexture"] = json!({ "index": texture, "texCoord": set });
    }
    if is_lit {
        material["extensions"] = json!({ "KHR_materials_unlit": {} });
    }
    material
}
