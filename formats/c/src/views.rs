//! What is lent to C: arrays as pointers and lengths.

use std::ffi::c_char;

use translux_format::{Tag, far_field};

/// An index that is none: the part of a triangle without one, the medium of an opaque part, the receiver of a vertex without one.
pub const NONE: u32 = u32::MAX;

/// Neighbouring receivers in a row of a far field.
pub const LANES: usize = 16;

/// Bytes of a section's tag, its zero included.
pub const TAG_BYTES: usize = 9;

const _: () = assert!(LANES == far_field::LANES && NONE == far_field::NO_RECEIVER);
const _: () = assert!(NONE == translux_format::NO_PART && NONE == translux_format::NO_MEDIUM);

/// The array's address, or null where it has no elements.
pub(crate) fn pointer<T>(array: &[T]) -> *const T {
    if array.is_empty() { std::ptr::null() } else { array.as_ptr() }
}

/// A tag as C has texts.
pub(crate) fn tag_text(tag: Tag) -> [c_char; TAG_BYTES] {
    let mut text = [0; TAG_BYTES];
    text.iter_mut().zip(tag.to_bytes()).for_each(|(to, byte)| *to = byte as c_char);
    text
}

/// UTF-8 without a zero at its end: `printf("%.*s", (int)text.length, text.data)`.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Text {
    /// Its bytes; null where there are none.
    pub data: *const c_char,
    /// Number of bytes.
    pub length: usize,
}

impl Text {
    pub(crate) fn of(text: &str) -> Self {
        Self { data: pointer(text.as_bytes()).cast(), length: text.len() }
    }
}

/// What an asset is, and how much of it there is.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Info {
    /// Name of the method that made it.
    pub method: Text,
    /// Name of the form that its transport is kept in; empty where the file says none that is a text.
    pub form: Text,
    /// Revision of the algorithms that made it.
    pub algorithm_revision: u32,
    /// Number of parts.
    pub parts: usize,
    /// Number of media.
    pub media: usize,
    /// Number of the method's own sections.
    pub sections: usize,
}

/// A triangle mesh in mm, vertices in the order of the source.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Mesh {
    /// World position of the local origin, in mm.
    pub origin_mm: [f64; 3],
    /// Number of vertices.
    pub vertices: usize,
    /// Positions relative to `origin_mm`, in mm: `vertices` rows.
    pub positions_mm: *const [f32; 3],
    /// For each vertex, the first vertex at the same place.
    pub weld: *const u32,
    /// Number of triangles.
    pub triangles: usize,
    /// Corners, counter-clockwise seen from outside: `triangles` rows.
    pub corners: *const [u32; 3],
    /// Part of each triangle, or `TRANSLUX_NONE`.
    pub triangle_part: *const u32,
    /// Index of each triangle's material in the source.
    pub triangle_material: *const u32,
    /// Number of shading normals; 0 where the mesh has none.
    pub normals: usize,
    /// Shading normals: `normals` rows; zero where the source has none.
    pub normal_values: *const [f32; 3],
    /// For each corner of each triangle, a row of `normal_values`; null where the mesh has none.
    pub normal_corners: *const [u32; 3],
    /// Number of texture coordinates; 0 where the mesh has none.
    pub uvs: usize,
    /// Texture coordinates, v up: `uvs` rows.
    pub uv_values: *const [f32; 2],
    /// For each corner of each triangle, a row of `uv_values`; null where the mesh has none.
    pub uv_corners: *const [u32; 3],
}

/// Triangles that light travels between inside one medium, or an opaque object that only casts shadows.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Part {
    /// Name for people.
    pub name: Text,
    /// Index of its medium; `TRANSLUX_NONE` where an opaque part has none.
    pub medium: u32,
    /// Whether it only casts shadows.
    pub opaque: bool,
}

/// Optical properties of a medium, for red, green and blue.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Medium {
    /// Name for people.
    pub name: Text,
    /// Reduced scattering coefficient sigma_s' = sigma_s (1 - g), in 1/mm.
    pub sigma_s_reduced_per_mm: [f64; 3],
    /// Absorption coefficient, in 1/mm.
    pub sigma_a_per_mm: [f64; 3],
    /// Mean cosine of the phase function, positive forward.
    pub g: f64,
    /// Refractive index inside over outside.
    pub eta_inside_over_outside: f64,
}

/// Surface samples. A facet is a triangle or a piece of one, a patch (a sample) a range of facets, a part a range of patches.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Samples {
    /// Number of patches.
    pub patches: usize,
    /// Number of facets.
    pub facets: usize,
    /// Triangle and path of each facet: `facets` rows. Path 1 is the whole triangle; SPEC.md names the halves that its bits select.
    pub facet: *const [u32; 2],
    /// Patch `i` has the facets from `patch_offsets[i]` to `patch_offsets[i + 1]`: `patches + 1` numbers.
    pub patch_offsets: *const u32,
    /// Part `p` has the patches from `part_offsets[p]` to `part_offsets[p + 1]`: one number more than parts.
    pub part_offsets: *const u32,
}

/// Irradiance of every patch from light that is far away: quantised Haar coefficients over a cube map of 6 x `side` x `side`.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct IrradianceRows {
    /// Texels along an edge of a face.
    pub side: usize,
    /// Number of functions of the angle.
    pub terms: usize,
    /// Largest number of patches of a block; 0 where every row is its patch's own (`formats/spec/environment_rows.md`).
    pub block: usize,
    /// Number of patches.
    pub patches: usize,
    /// Number of coefficients of all patches.
    pub coefficients: usize,
    /// Patch `i` has the coefficients from `offsets[i]` to `offsets[i + 1]`: `patches + 1` numbers.
    pub offsets: *const u32,
    /// Position of each coefficient: `(face * side + row) * side + column`.
    pub indices: *const u16,
    /// Values patch by patch, for each term those of all its coefficients: `terms * coefficients` numbers, in units of the patch's step.
    pub values: *const i8,
    /// Step of each patch's values.
    pub steps: *const f32,
    /// First coefficient of each face: `[patches][terms][6]`, in units of the patch's scaling step.
    pub scaling: *const i16,
    /// Step of each patch's scaling coefficients.
    pub scaling_steps: *const f32,
    /// Each term's function of the cosine with the normal: the coefficients of its powers 1 to 9, `terms` rows.
    pub functions: *const [f64; 9],
}

/// A run of rows of neighbouring receivers of one part, at most `TRANSLUX_LANES`, that share a list of coefficients.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Group {
    /// Part whose patches the group gathers from.
    pub part: u32,
    /// End of its rows, which begin where those of the group before end.
    pub rows_end: u32,
    /// End of its coefficients, likewise.
    pub coefficients_end: u32,
    /// Basis functions of its rows: bit `k`.
    pub functions: u16,
}

/// Transport from afar of each function of a profile basis, as quantised Haar coefficients over the tree of patches
/// (`formats/spec/factored.md`).
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct FarField {
    /// Number of basis functions.
    pub terms: usize,
    /// Number of vertices.
    pub vertices: usize,
    /// Receiver of each vertex, or `TRANSLUX_NONE`: its radiosity from afar is interpolated.
    pub receiver_of_vertex: *const u32,
    /// Number of receivers. Row `i` is receiver `i`'s, as far as there are receivers.
    pub receivers: usize,
    /// Number of rows beyond those of the receivers.
    pub others: usize,
    /// Receiver of each of these rows.
    pub receiver_of_other: *const u32,
    /// Number of groups.
    pub groups: usize,
    /// The groups.
    pub group: *const Group,
    /// Number of coefficients.
    pub coefficients: usize,
    /// Node of each coefficient, ascending within a group: the first patch of the node's right child.
    pub nodes: *const u32,
    /// Functions that each coefficient keeps: bit `k`.
    pub masks: *const u16,
    /// Those of them whose values have 16 bits.
    pub wide_masks: *const u16,
    /// Step of each function's values: `terms` numbers.
    pub steps: *const f32,
    /// Number of rows of 8-bit values.
    pub narrow_rows: usize,
    /// 8-bit values: for each coefficient its functions, ascending, for each of these the Haar transform over the lanes.
    pub narrow: *const [i8; LANES],
    /// Number of rows of 16-bit values.
    pub wide_rows: usize,
    /// 16-bit values, in the same order.
    pub wide: *const [i16; LANES],
    /// Sum of each row: `[receivers + others][terms]`.
    pub row_sums: *const f32,
}

/// A section of the asset's method as it is in the file, decompressed.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Section {
    /// Its name, ended by a zero.
    pub tag: [c_char; TAG_BYTES],
    /// Type of its numbers, by its code in SPEC.md: 0 a record, 1 `u8`, 2 `i8`, 3 `u16`, 4 `i16`, 5 `u32`, 6 `i32`, 7 `u64`, 8 `i64`,
    /// 9 half, 10 float, 11 double.
    pub element: u8,
    /// Purpose, by its code: 0 mesh, 1 samples, 2 method, 3 metadata, 4 environment.
    pub kind: u8,
    /// Numbers in a row.
    pub components: u16,
    /// Number of rows; of a record, its length in bytes.
    pub rows: usize,
    /// Number of bytes.
    pub length: usize,
    /// The bytes, little-endian, not aligned.
    pub data: *const u8,
}
