//! An open asset, and the crossing from and to pointers.

use std::sync::OnceLock;

use translux_format::far_field::{self, Shape};
use translux_format::{AssetFile, Budget, CornerAttribute, FormatError, RawSection, Tag, metadata, rows};

use crate::error::{Fault, Status};
use crate::views::{
    FarField, Group, Info, IrradianceRows, Medium, Mesh, Part, Samples, Section, Text, pointer, tag_text,
};

/// What is decoded when it is first asked for: an error, nothing, or the arrays.
type Decoded<T> = OnceLock<Result<Option<T>, FormatError>>;

/// An open asset. It never changes, but for what it decodes when it is first asked for, once for all threads.
#[derive(Debug)]
pub struct Asset {
    file: AssetFile,
    form: String,
    budget: Budget,
    rows: Decoded<rows::IrradianceRows>,
    far: Decoded<(far_field::FarField, Vec<Group>)>,
}

impl Asset {
    pub(crate) fn open(bytes: &[u8], budget: Budget) -> Result<Self, FormatError> {
        let file = AssetFile::from_bytes(bytes, budget)?;
        let named = file.extra.iter().find(|section| section.tag == metadata::tags::FORM);
        let form = named.and_then(|section| section.record().ok()).unwrap_or_default();
        Ok(Self { file, form, budget, rows: OnceLock::new(), far: OnceLock::new() })
    }

    pub(crate) fn info(&self) -> Info {
        let AssetFile { provenance, parts, extra, .. } = &self.file;
        Info {
            method: Text::of(&provenance.method),
            form: Text::of(&self.form),
            algorithm_revision: provenance.algorithm_revision,
            parts: parts.parts.len(),
            media: parts.media.len(),
            sections: extra.len(),
        }
    }

    pub(crate) fn mesh(&self) -> Mesh {
        let (mesh, parts) = (&self.file.mesh, &self.file.parts);
        let (normals, normal_values, normal_corners) = attribute(mesh.normals.as_ref());
        let (uvs, uv_values, uv_corners) = attribute(mesh.uvs.as_ref());
        Mesh {
            origin_mm: mesh.origin_mm,
            vertices: mesh.positions_mm.len(),
            positions_mm: pointer(&mesh.positions_mm),
            weld: pointer(&mesh.weld),
            triangles: mesh.triangles.len(),
            corners: pointer(&mesh.triangles),
            triangle_part: pointer(&parts.triangle_part),
            triangle_material: pointer(&mesh.triangle_material),
            normals,
            normal_values,
            normal_corners,
            uvs,
            uv_values,
            uv_corners,
        }
    }

    pub(crate) fn part(&self, index: usize) -> Result<Part, Fault> {
        let part = at("part", &self.file.parts.parts, index)?;
        Ok(Part { name: Text::of(&part.name), medium: part.medium, opaque: part.opaque })
    }

    pub(crate) fn medium(&self, index: usize) -> Result<Medium, Fault> {
        let medium = at("medium", &self.file.parts.media, index)?;
        Ok(Medium {
            name: Text::of(&medium.name),
            sigma_s_reduced_per_mm: medium.sigma_s_reduced_per_mm,
            sigma_a_per_mm: medium.sigma_a_per_mm,
            g: medium.g,
            eta_inside_over_outside: medium.eta_inside_over_outside,
        })
    }

    pub(crate) fn samples(&self) -> Samples {
        let samples = &self.file.samples;
        Samples {
            patches: samples.patch_count(),
            facets: samples.facets.len(),
            facet: pointer(&samples.facets),
            patch_offsets: pointer(&samples.patch_offsets),
            part_offsets: pointer(&samples.part_offsets),
        }
    }

    pub(crate) fn irradiance_rows(&self) -> Result<IrradianceRows, Fault> {
        let AssetFile { extra, samples, .. } = &self.file;
        let decode = || rows::IrradianceRows::from_sections(extra, samples.patch_count());
        let rows = decoded(&self.rows, decode)?.ok_or_else(|| Fault::absent("the asset has no irradiance rows"))?;
        Ok(IrradianceRows {
            side: rows.side,
            terms: rows.terms,
            block: rows.block,
            patches: rows.patches(),
            coefficients: rows.indices.len(),
            offsets: pointer(&rows.offsets),
            indices: pointer(&rows.indices),
            values: pointer(&rows.values),
            steps: pointer(&rows.steps),
            scaling: pointer(&rows.scaling),
            scaling_steps: pointer(&rows.scaling_steps),
            functions: pointer(&rows.functions),
        })
    }

    pub(crate) fn far_field(&self) -> Result<FarField, Fault> {
        let decode = || {
            let shape = Shape::new(self.file.mesh.positions_mm.len(), &self.file.samples);
            let far = far_field::FarField::from_sections_within(&self.file.extra, &shape, self.budget)?;
            Ok(far.map(|far| {
                let groups = far.groups.iter().map(group).collect();
                (far, groups)
            }))
        };
        let absent = || Fault::absent("the asset has no far field");
        let (far, groups) = decoded(&self.far, decode)?.ok_or_else(absent)?;
        Ok(FarField {
            terms: far.terms,
            vertices: far.receiver_of_vertex.len(),
            receiver_of_vertex: pointer(&far.receiver_of_vertex),
            receivers: far.receivers(),
            others: far.others.len(),
            receiver_of_other: pointer(&far.others),
            groups: groups.len(),
            group: pointer(groups),
            coefficients: far.nodes.len(),
            nodes: pointer(&far.nodes),
            masks: pointer(&far.masks),
            wide_masks: pointer(&far.wide_masks),
            steps: pointer(&far.steps),
            narrow_rows: far.narrow.len(),
            narrow: pointer(&far.narrow),
            wide_rows: far.wide.len(),
            wide: pointer(&far.wide),
            row_sums: pointer(&far.row_sums),
        })
    }

    pub(crate) fn section(&self, index: usize) -> Result<Section, Fault> {
        at("section", &self.file.extra, index).map(section)
    }

    pub(crate) fn find(&self, tag: Tag) -> Option<Section> {
        self.file.extra.iter().find(|section| section.tag == tag).map(section)
    }
}

fn at<'a, T>(what: &str, list: &'a [T], index: usize) -> Result<&'a T, Fault> {
    list.get(index).ok_or_else(|| Fault::out_of_range(what, index, list.len()))
}

/// The decoded arrays, by the first caller's work.
fn decoded<T>(
    cell: &Decoded<T>,
    decode: impl FnOnce() -> Result<Option<T>, FormatError>,
) -> Result<Option<&T>, FormatError> {
    cell.get_or_init(decode).as_ref().map(Option::as_ref).map_err(Clone::clone)
}

fn attribute<const N: usize>(attribute: Option<&CornerAttribute<N>>) -> (usize, *const [f32; N], *const [u32; 3]) {
    attribute.map_or((0, std::ptr::null(), std::ptr::null()), |attribute| {
        (attribute.values.len(), pointer(&attribute.values), pointer(&attribute.corners))
    })
}

fn group(group: &far_field::Group) -> Group {
    let &far_field::Group { part, rows_end, coefficients_end, functions } = group;
    Group { part, rows_end, coefficients_end, functions }
}

fn section(section: &RawSection) -> Section {
    let row = section.element.size() as usize * usize::from(section.components);
    Section {
        tag: tag_text(section.tag),
        element: section.element.code(),
        kind: section.kind.code(),
        components: section.components,
        rows: section.bytes.len() / row.max(1),
        length: section.bytes.len(),
        data: pointer(&section.bytes),
    }
}

/// The bytes of a caller.
///
/// # Safety
/// `bytes` is null or has `length` readable bytes that nobody writes while they are borrowed.
pub(crate) unsafe fn bytes_of<'a>(bytes: *const u8, length: usize) -> Result<&'a [u8], Fault> {
    if bytes.is_null() {
        return Err(Fault::null("bytes"));
    }
    if isize::try_from(length).is_err() {
        let message = format!("length {length}: no array is that long");
        return Err(Fault { status: Status::OutOfRange, section: None, message });
    }
    // SAFETY: not null, no longer than an array can be, and the caller's promise.
    Ok(unsafe { std::slice::from_raw_parts(bytes, length) })
}

/// The asset behind a caller's pointer.
///
/// # Safety
/// `asset` is null or open as long as it is borrowed.
pub(crate) unsafe fn borrowed<'a>(asset: *const Asset) -> Result<&'a Asset, Fault> {
    // SAFETY: the caller's promise.
    unsafe { asset.as_ref() }.ok_or_else(|| Fault::null("asset"))
}

/// Hands a value to the caller.
///
/// # Safety
/// `out` is null or can be written.
pub(crate) unsafe fn write<T>(out: *mut T, value: T) -> Result<(), Fault> {
    if out.is_null() {
        return Err(Fault::null("out"));
    }
    // SAFETY: not null, and the caller's promise.
    unsafe { out.write(value) };
    Ok(())
}
