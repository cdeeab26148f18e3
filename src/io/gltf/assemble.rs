//! Assembly of all placements of all meshes into one model.

use std::collections::{BTreeMap, HashMap};

use glam::{DAffine3, DMat3, DVec3, Vec2, Vec3};
use gltf::json::Root;

use super::accessor::Accessors;
use super::document::{material_name, mesh_label, node_label};
use super::inside::inside;
use super::nodes::Placement;
use super::primitive::{CheckedPrimitive, Decoded};
use super::unused;
use super::warnings::Warnings;
use crate::error::{Error, Result};
use crate::geometry::source::{CornerAttribute, SourceModel};
use crate::medium::volume::Inside;

/// Largest number of vertices, and of triangles, of a model with every instance counted.
pub const MAX_ELEMENTS: usize = 1 << 26;

/// Determinant over the product of the axes' lengths below which the axes count as coplanar.
const SINGULAR: f64 = 1e-12;

/// Builds the model; sizes are known and limited before allocation.
pub(super) fn assemble(
    root: &Root,
    data: &Accessors<'_>,
    placements: &[Placement],
    mut warnings: Warnings,
) -> Result<SourceModel> {
    let checked = check_meshes(root, data, placements, &mut warnings)?;
    let mut builder = Builder::new(root, placements, &checked)?;
    let mut decoded: Vec<Option<Vec<Decoded>>> = checked.iter().map(|_| None).collect();
    for placement in placements {
        let (Some(Some(checked)), Some(decoded)) = (checked.get(placement.mesh), decoded.get_mut(placement.mesh))
        else {
            return Err(Error::input(format!("mesh {} does not exist", placement.mesh)));
        };
        if decoded.is_none() {
            *decoded = Some(checked.iter().map(|primitive| primitive.decode(&mut warnings)).collect::<Result<_>>()?);
        }
        let transform = Transform::new(&placement.to_scene);
        if transform.singular {
            let place = match placement.node.and_then(|node| Some((node, root.nodes.get(node)?))) {
                Some((index, node)) => node_label(index, node),
                None => "the scene".to_owned(),
            };
            warnings.add_at(&place, "its transform is singular: what it places is flat");
        }
        for (source, primitive) in checked.iter().zip(decoded.iter().flatten()) {
            builder.add(source, primitive, &transform).map_err(|e| e.at(&source.place))?;
        }
    }
    builder.finish(warnings)
}

/// The checked primitives of the meshes that are placed, by mesh; `None` for the others.
pub(super) fn check_meshes<'a>(
    root: &Root,
    data: &'a Accessors<'_>,
    placements: &[Placement],
    warnings: &mut Warnings,
) -> Result<Vec<Option<Vec<CheckedPrimitive<'a>>>>> {
    let mut checked: Vec<Option<Vec<CheckedPrimitive<'a>>>> = root.meshes.iter().map(|_| None).collect();
    // Many primitives may share one accessor: what is checked about them could alone outgrow memory.
    let mut totals = Totals::default();
    for placement in placements {
        let (Some(mesh), Some(of_mesh @ None)) = (root.meshes.get(placement.mesh), checked.get_mut(placement.mesh))
        else {
            continue;
        };
        let label = mesh_label(placement.mesh, mesh);
        let of_mesh = of_mesh.insert(Vec::new());
        for (index, primitive) in mesh.primitives.iter().enumerate() {
            if let Some(checked) =
                CheckedPrimitive::new(data, (index, format!("{label}, primitive {index}")), primitive, warnings)?
            {
                totals.add(&checked)?;
                of_mesh.push(checked);
            }
        }
    }
    Ok(checked)
}

/// Numbers of vertices and triangles so far, kept within the limits.
#[derive(Default)]
struct Totals {
    vertices: usize,
    triangles: usize,
}

impl Totals {
    fn add(&mut self, checked: &CheckedPrimitive<'_>) -> Result<()> {
        self.vertices = self.vertices.saturating_add(checked.vertices);
        self.triangles = self.triangles.saturating_add(checked.triangles_at_most());
        for (count, what) in [(self.vertices, "vertices"), (self.triangles, "triangles")] {
            if count > MAX_ELEMENTS {
                let advice = "place fewer instances or decimate the meshes";
                return Err(Error::input(format!("more than {MAX_ELEMENTS} {what} with all instances; {advice}")));
            }
        }
        Ok(())
    }
}

/// The transform of a placement with derived quantities.
struct Transform {
    to_scene: DAffine3,
    /// Inverse transpose of the linear part up to a positive factor; also defined where there is no inverse.
    normals: DMat3,
    mirrors: bool,
    singular: bool,
}

impl Transform {
    fn new(to_scene: &DAffine3) -> Self {
        let linear = to_scene.matrix3;
        let largest = linear.to_cols_array().into_iter().fold(0.0, |a: f64, b| a.max(b.abs()));
        let scaled = if largest > 0.0 { linear * largest.recip().min(f64::MAX) } else { linear };
        let DMat3 { x_axis, y_axis, z_axis } = scaled;
        let determinant = scaled.determinant();
        let mirrors = determinant < 0.0;
        // The cofactor matrix is the inverse transpose times the determinant.
        let cofactors = DMat3::from_cols(y_axis.cross(z_axis), z_axis.cross(x_axis), x_axis.cross(y_axis));
        let normals = if mirrors { -cofactors } else { cofactors };
        let singular = determinant.abs() <= SINGULAR * x_axis.length() * y_axis.length() * z_axis.length();
        Self { to_scene: *to_scene, normals, mirrors, singular }
    }

    fn normal(&self, normal: Vec3) -> Vec3 {
        (self.normals * normal.as_dvec3()).try_normalize().map_or(Vec3::ZERO, |normal| normal.as_vec3())
    }
}

/// The model under construction.
struct Builder<'a> {
    root: &'a Root,
    model: SourceModel,
    normals: Option<Vec<Vec3>>,
    uvs: Option<Vec<Vec2>>,
    lacks_normals: bool,
    lacks_uvs: bool,
    /// The document's materials that are used, with their index among those of the model.
    used: BTreeMap<Option<usize>, u32>,
    material_of_name: HashMap<String, u32>,
}

impl<'a> Builder<'a> {
    fn new(root: &'a Root, placements: &[Placement], checked: &[Option<Vec<CheckedPrimitive<'_>>>]) -> Result<Self> {
        let mut totals = Totals::default();
        for checked in placements.iter().filter_map(|placement| checked.get(placement.mesh)?.as_deref()).flatten() {
            totals.add(checked)?;
        }
        let Totals { vertices, triangles } = totals;
        let mut any = checked.iter().flatten().flatten();
        let has_normals = any.clone().any(CheckedPrimitive::has_normals);
        let has_uvs = any.any(CheckedPrimitive::has_uvs);
        let mut model = SourceModel { metres_per_unit: Some(1.0), ..SourceModel::default() };
        reserve(&mut model.positions, vertices)?;
        reserve(&mut model.triangles, triangles)?;
        reserve(&mut model.triangle_material, triangles)?;
        let (mut normals, mut uvs) = (has_normals.then(Vec::new), has_uvs.then(Vec::new));
        normals.as_mut().map_or(Ok(()), |normals| reserve(normals, vertices))?;
        uvs.as_mut().map_or(Ok(()), |uvs| reserve(uvs, vertices))?;
        Ok(Self {
            root,
            model,
            normals,
            uvs,
            lacks_normals: false,
            lacks_uvs: false,
            used: BTreeMap::new(),
            material_of_name: HashMap::new(),
        })
    }

    fn add(&mut self, checked: &CheckedPrimitive<'_>, primitive: &Decoded, transform: &Transform) -> Result<()> {
        let offset = u32::try_from(self.model.positions.len())
            .map_err(|_| Error::runtime("more vertices than 32 bits can number"))?;
        let mut finite = true;
        self.model.positions.extend(primitive.positions.iter().map(|position| {
            let position = transform.to_scene.transform_point3(DVec3::from_array(position.map(f64::from)));
            finite &= position.is_finite();
            position
        }));
        if !finite {
            check_used_positions(primitive, self.model.positions.get(offset as usize..).unwrap_or_default())?;
        }
        let corner = |index: u32| index + offset;
        self.model.triangles.extend(
            primitive
                .triangles
                .iter()
                .map(|&[a, b, c]| if transform.mirrors { [a, c, b].map(corner) } else { [a, b, c].map(corner) }),
        );
        let material = self.material(checked.material);
        self.model.triangle_material.resize(self.model.triangles.len(), material);
        let end = self.model.positions.len();
        if let Some(normals) = &mut self.normals {
            normals.extend(primitive.normals.iter().flatten().map(|&normal| transform.normal(normal)));
            normals.resize(end, Vec3::ZERO);
        }
        if let Some(uvs) = &mut self.uvs {
            uvs.extend_from_slice(primitive.uvs.as_deref().unwrap_or_default());
            uvs.resize(end, Vec2::ZERO);
        }
        self.lacks_normals |= !primitive.triangles.is_empty() && primitive.normals.is_none();
        self.lacks_uvs |= !primitive.triangles.is_empty() && primitive.uvs.is_none();
        Ok(())
    }

    /// The index of a material's name among those of the model, in the order of their first use.
    fn material(&mut self, index: Option<usize>) -> u32 {
        if let Some(known) = self.used.get(&index) {
            return *known;
        }
        let material = index.and_then(|index| Some((index, self.root.materials.get(index)?)));
        let (name, inside) = match material {
            None => ("default".to_owned(), Inside::Surface),
            Some((index, material)) => (material_name(index, material.name.as_deref()), inside(material)),
        };
        let SourceModel { materials, insides, .. } = &mut self.model;
        let number = *self.material_of_name.entry(name).or_insert_with_key(|name| {
            materials.push(name.clone());
            insides.push(inside.clone());
            (materials.len() - 1) as u32
        });
        if let Some(first) = insides.get_mut(number as usize).filter(|first| **first != inside) {
            let differ = "several materials of the file have this name and differ inside; give each a name of its own";
            *first = Inside::Invalid(differ.to_owned());
        }
        self.used.insert(index, number);
        number
    }

    /// Names of which the document has several used materials that differ.
    fn ambiguous_names(&self) -> Vec<&str> {
        let content = |index: Option<usize>| {
            let material = index.and_then(|index| self.root.materials.get(index));
            material.and_then(|material| serde_json::to_value(material).ok())
        };
        let mut first: BTreeMap<u32, Option<usize>> = BTreeMap::new();
        let mut names = Vec::new();
        for (&index, &number) in &self.used {
            let known = *first.entry(number).or_insert(index);
            let name = self.model.materials.get(number as usize).map(String::as_str);
            if known != index && content(known) != content(index) {
                names.extend(name.filter(|name| !names.contains(name)));
            }
        }
        names
    }

    fn finish(self, mut warnings: Warnings) -> Result<SourceModel> {
        let ambiguous = self.ambiguous_names();
        if !ambiguous.is_empty() {
            warnings.add(format!(
                "different materials have the same name and are one material here: {ambiguous:?}; give each a name of its own to tell them apart"
            ));
        }
        let used = self.used.keys().flatten().filter_map(|index| self.root.materials.get(*index));
        unused::of_materials(used).into_iter().for_each(|line| warnings.add(line));
        let mut model = self.model;
        if model.triangles.is_empty() {
            let why = warnings.into_lines().join("; ");
            let why = if why.is_empty() { String::new() } else { format!(" ({why})") };
            return Err(Error::input(format!("the model has no triangles{why}")));
        }
        if self.normals.is_some() && self.lacks_normals {
            warnings.add("some primitives store normals and others do not: the latter get computed ones");
        }
        if self.uvs.is_some() && self.lacks_uvs {
            warnings.add("some primitives store texture coordinates and others do not: those of the latter are 0");
        }
        model.normals = self.normals.map(|values| CornerAttribute { values, corners: model.triangles.clone() });
        model.uvs = self.uvs.map(|values| CornerAttribute { values, corners: model.triangles.clone() });
        model.warnings = warnings.into_lines();
        Ok(model)
    }
}

fn check_used_positions(primitive: &Decoded, in_scene: &[DVec3]) -> Result<()> {
    for (t, triangle) in primitive.triangles.iter().enumerate() {
        for &vertex in triangle {
            let stored = primitive.positions.get(vertex as usize).copied().unwrap_or_default();
            if in_scene.get(vertex as usize).is_none_or(|position| !position.is_finite()) {
                let [x, y, z] = stored;
                let cause = if stored.iter().all(|c| c.is_finite()) { " after its node's transform" } else { "" };
                let message = format!("vertex {vertex} ({x}, {y}, {z}) of triangle {t} is not finite{cause}");
                return Err(Error::input(message));
            }
        }
    }
    Ok(())
}

fn reserve<T>(vec: &mut Vec<T>, count: usize) -> Result<()> {
    vec.try_reserve_exact(count).map_err(|_| Error::runtime(format!("not enough memory for {count} elements")))
}
