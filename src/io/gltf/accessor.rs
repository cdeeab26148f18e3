//! Accessors: location of their elements, checked against the buffers, and conversion to plain arrays.

use gltf::json::Root;
use gltf::json::accessor::{Accessor, ComponentType, Type};
use gltf::json::validation::{Checked, USize64};

use super::buffers::Buffers;
use super::extensions;
use crate::error::{Error, Result};

/// Largest number of elements of an accessor without bytes in a buffer (sparse over zeros), whose count costs no file
/// size.
const MAX_UNBACKED: usize = 1 << 20;

/// Purpose for which an accessor is read; it decides the allowed types.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Role {
    Position,
    Normal,
    TexCoord,
    Indices,
    InstanceVector,
    InstanceRotation,
    /// Times of the keys of an animation.
    Times,
    /// Translations or scales of the keys of an animation.
    AnimatedVector,
    /// Rotations of the keys of an animation.
    AnimatedRotation,
    /// Weights of morph targets of the keys of an animation.
    AnimatedWeights,
    /// Four joints that a vertex follows.
    Joints,
    /// How far it follows them.
    JointWeights,
    /// Inverse bind matrices of joints.
    InverseBind,
    /// To be copied.
    Any,
}

impl Role {
    fn accepts(self, kind: Type, component: ComponentType, normalized: bool, quantized: bool) -> bool {
        use ComponentType::{F32, I8, I16, U8, U16, U32};
        match self {
            Role::Position => kind == Type::Vec3 && (component == F32 || (quantized && component != U32)),
            Role::Normal => {
                kind == Type::Vec3 && (component == F32 || (quantized && normalized && matches!(component, I8 | I16)))
            }
            Role::TexCoord => {
                kind == Type::Vec2
                    && match component {
                        F32 => true,
                        U8 | U16 => normalized || quantized,
                        I8 | I16 => quantized,
                        U32 => false,
                    }
            }
            Role::Indices => kind == Type::Scalar && !normalized && matches!(component, U8 | U16 | U32),
            Role::InstanceVector | Role::AnimatedVector => kind == Type::Vec3 && component == F32,
            Role::InstanceRotation => {
                kind == Type::Vec4 && (component == F32 || (normalized && matches!(component, I8 | I16)))
            }
            Role::Times => kind == Type::Scalar && component == F32,
            Role::AnimatedRotation => kind == Type::Vec4 && (component == F32 || (normalized && component != U32)),
            Role::AnimatedWeights => kind == Type::Scalar && (component == F32 || (normalized && component != U32)),
            Role::Joints => kind == Type::Vec4 && !normalized && matches!(component, U8 | U16),
            Role::JointWeights => {
                kind == Type::Vec4 && (component == F32 || (normalized && matches!(component, U8 | U16)))
            }
            Role::InverseBind => kind == Type::Mat4 && component == F32,
            // Columns of matrices have gaps of their own.
            Role::Any => !matches!(kind, Type::Mat2 | Type::Mat3 | Type::Mat4),
        }
    }

    fn expected(self) -> &'static str {
        match self {
            Role::Position => "POSITION must be VEC3 of f32, or of 8 or 16 bits with KHR_mesh_quantization",
            Role::Normal => "NORMAL must be VEC3 of f32, or of normalised i8 or i16 with KHR_mesh_quantization",
            Role::TexCoord => "TEXCOORD_0 must be VEC2 of f32, u8 or u16 (normalised unless KHR_mesh_quantization)",
            Role::Indices => "indices must be SCALAR of u8, u16 or u32",
            Role::InstanceVector => "TRANSLATION and SCALE of instances must be VEC3 of f32",
            Role::InstanceRotation => "ROTATION of instances must be VEC4 of f32 or of normalised i8 or i16",
            Role::Times => "times of an animation must be SCALAR of f32",
            Role::AnimatedVector => "translations and scales of an animation must be VEC3 of f32",
            Role::AnimatedRotation => "rotations of an animation must be VEC4 of f32 or of normalised integers",
            Role::AnimatedWeights => "weights of an animation must be SCALAR of f32 or of normalised integers",
            Role::Joints => "JOINTS_n must be VEC4 of u8 or u16",
            Role::JointWeights => "WEIGHTS_n must be VEC4 of f32 or of normalised u8 or u16",
            Role::InverseBind => "inverse bind matrices must be MAT4 of f32",
            Role::Any => "attributes of vertices must be no matrices",
        }
    }
}

/// Access to the accessors of a document whose references have been checked.
pub(super) struct Accessors<'a> {
    root: &'a Root,
    buffers: Buffers<'a>,
    quantized: bool,
}

impl<'a> Accessors<'a> {
    pub(super) fn new(root: &'a Root, buffers: Buffers<'a>) -> Self {
        Self { root, buffers, quantized: extensions::declares(root, extensions::QUANTIZATION) }
    }

    /// Number of elements that an accessor declares; nothing else is checked.
    pub(super) fn count(&self, index: usize) -> Result<usize> {
        self.accessor(index).and_then(|accessor| size(accessor.count, "count")).map_err(|e| e.at(place(index)))
    }

    /// Returns whether an accessor has bytes of its own; without them and without sparse values it is all zeros.
    pub(super) fn has_data(&self, index: usize) -> bool {
        self.accessor(index).is_ok_and(|accessor| accessor.buffer_view.is_some() || accessor.sparse.is_some())
    }

    /// The elements of an accessor, all of whose bytes are known to exist.
    pub(super) fn elements(&self, index: usize, role: Role) -> Result<Elements<'_>> {
        self.accessor(index).and_then(|accessor| self.locate(accessor, role)).map_err(|e| e.at(place(index)))
    }

    /// The elements of an accessor that is no matrix as bytes without gaps, and the bytes of one.
    pub(super) fn bytes(&self, index: usize) -> Result<(Vec<u8>, usize)> {
        let accessor = self.accessor(index)?;
        let elements = self.locate(accessor, Role::Any)?;
        let Checked::Valid(kind) = accessor.type_ else { return Err(Error::input("its type is not one of glTF's")) };
        let size = elements.component.size() * kind.multiplicity();
        Ok((elements.bytes(size), size))
    }

    fn accessor(&self, index: usize) -> Result<&Accessor> {
        self.root.accessors.get(index).ok_or_else(|| Error::input("it does not exist"))
    }

    fn locate(&self, accessor: &Accessor, role: Role) -> Result<Elements<'_>> {
        let (Checked::Valid(component), Checked::Valid(kind)) = (accessor.component_type, accessor.type_) else {
            return Err(Error::input("its type or componentType is not one of glTF's"));
        };
        let component = component.0;
        if !role.accepts(kind, component, accessor.normalized, self.quantized) {
            let normalized = if accessor.normalized { "normalised " } else { "" };
            return Err(Error::input(format!("it is {kind:?} of {normalized}{component:?}: {}", role.expected())));
        }
        let count = size(accessor.count, "count")?;
        let element_size = component.size() * kind.multiplicity();
        let base = match accessor.buffer_view {
            Some(view) => {
                let offset = accessor.byte_offset.unwrap_or_default();
                Some(self.strided(view.value(), offset, count, element_size)?)
            }
            None if accessor.sparse.is_none() => {
                return Err(Error::input("it has neither a bufferView nor sparse values"));
            }
            None if count > MAX_UNBACKED => {
                return Err(Error::input(format!(
                    "{count} elements without a bufferView; at most {MAX_UNBACKED} are read"
                )));
            }
            None => None,
        };
        let sparse = self.sparse(accessor, count, element_size).map_err(|e| e.at("sparse"))?;
        Ok(Elements { component, normalized: accessor.normalized, count, base, sparse })
    }

    fn sparse(&self, accessor: &Accessor, count: usize, element_size: usize) -> Result<Option<Sparse<'_>>> {
        let Some(sparse) = &accessor.sparse else {
            return Ok(None);
        };
        let replaced = size(sparse.count, "count")?;
        if replaced > count {
            return Err(Error::input(format!("{replaced} values for {count} elements")));
        }
        let Checked::Valid(component) = sparse.indices.component_type else {
            return Err(Error::input("the componentType of its indices is not u8, u16 or u32"));
        };
        let component = component.0;
        let view = sparse.indices.buffer_view.value();
        let base = Some(self.strided(view, sparse.indices.byte_offset, replaced, component.size())?);
        let indices = Elements { component, normalized: false, count: replaced, base, sparse: None }.integers();
        let rising = indices.windows(2).all(|pair| matches!(pair, [a, b] if a < b));
        if !rising || indices.last().is_some_and(|&last| last as usize >= count) {
            return Err(Error::input("its indices do not rise strictly within the accessor"));
        }
        let values =
            self.strided(sparse.values.buffer_view.value(), sparse.values.byte_offset, replaced, element_size)?;
        Ok(Some(Sparse { indices, values }))
    }

    fn strided(&self, view: usize, offset: USize64, count: usize, element_size: usize) -> Result<Strided<'_>> {
        self.strided_in_view(view, offset, count, element_size).map_err(|e| e.at(format_args!("bufferView {view}")))
    }

    fn strided_in_view(&self, view: usize, offset: USize64, count: usize, element_size: usize) -> Result<Strided<'_>> {
        let view = self.root.buffer_views.get(view).ok_or_else(|| Error::input("it does not exist"))?;
        let buffer = self.buffers.get(view.buffer.value())?;
        let start = size(view.byte_offset.unwrap_or_default(), "byteOffset")?;
        let length = size(view.byte_length, "byteLength")?;
        let bytes = start.checked_add(length).and_then(|end| buffer.get(start..end)).ok_or_else(|| {
            let end = buffer.len();
            Error::input(format!("byteOffset {start} + byteLength {length} is past the buffer's end ({end} bytes)"))
        })?;
        let stride = view.byte_stride.map_or(element_size, |stride| stride.0);
        if stride < element_size {
            return Err(Error::input(format!("byteStride {stride} is less than an element's {element_size} bytes")));
        }
        let offset = size(offset, "byteOffset")?;
        let needed = match count.checked_sub(1) {
            Some(gaps) => gaps.checked_mul(stride).and_then(|gaps| gaps.checked_add(element_size)),
            None => Some(0),
        };
        let bytes = needed.and_then(|needed| bytes.get(offset..)?.get(..needed)).ok_or_else(|| {
            let ask = format!("{count} elements of {element_size} bytes, stride {stride}, from byte {offset}");
            Error::input(format!("{ask}, do not fit into its {length} bytes"))
        })?;
        Ok(Strided { bytes, stride })
    }
}

fn place(index: usize) -> String {
    format!("accessor {index}")
}

fn size(value: USize64, what: &str) -> Result<usize> {
    usize::try_from(value.0).map_err(|_| Error::input(format!("{what} {} is too large", value.0)))
}

/// Bytes of equally spaced elements: `bytes` ends with the last element.
struct Strided<'a> {
    bytes: &'a [u8],
    stride: usize,
}

/// Elements that differ from the base; `indices` rise strictly and are in range.
struct Sparse<'a> {
    indices: Vec<u32>,
    values: Strided<'a>,
}

/// The elements of one accessor, located and checked, not yet converted.
pub(super) struct Elements<'a> {
    component: ComponentType,
    normalized: bool,
    count: usize,
    base: Option<Strided<'a>>,
    sparse: Option<Sparse<'a>>,
}

impl Elements<'_> {
    /// The index that strips use as a restart marker elsewhere, and that glTF forbids.
    pub(super) fn restart_value(&self) -> u32 {
        match self.component {
            ComponentType::U8 => u32::from(u8::MAX),
            ComponentType::U16 => u32::from(u16::MAX),
            _ => u32::MAX,
        }
    }

    /// Returns whether the components are plain, unnormalised integers.
    pub(super) fn is_unscaled_integer(&self) -> bool {
        self.component != ComponentType::F32 && !self.normalized
    }

    /// Components as f32; normalised integers as `max(c / MAX, -1)` (glTF 2.0, section 3.11).
    pub(super) fn floats<const N: usize>(&self) -> Vec<[f32; N]> {
        let scaled = |value: f32, most: f32| if self.normalized { (value / most).max(-1.0) } else { value };
        match self.component {
            ComponentType::F32 => self.gather(f32::from_le_bytes),
            ComponentType::U8 => self.gather(|[byte]| scaled(byte.into(), 255.0)),
            ComponentType::I8 => self.gather(|bytes| scaled(i8::from_le_bytes(bytes).into(), 127.0)),
            ComponentType::U16 => self.gather(|bytes| scaled(u16::from_le_bytes(bytes).into(), 65535.0)),
            ComponentType::I16 => self.gather(|bytes| scaled(i16::from_le_bytes(bytes).into(), 32767.0)),
            ComponentType::U32 => self.gather(|bytes| u32::from_le_bytes(bytes) as f32),
        }
    }

    /// The indices of an accessor that is read as [`Role::Indices`].
    pub(super) fn integers(&self) -> Vec<u32> {
        match self.component {
            ComponentType::U8 | ComponentType::I8 => self.gather::<1, 1, u32>(|[byte]| u32::from(byte)),
            ComponentType::U16 | ComponentType::I16 => {
                self.gather::<1, 2, u32>(|bytes| u32::from(u16::from_le_bytes(bytes)))
            }
            ComponentType::U32 | ComponentType::F32 => self.gather::<1, 4, u32>(u32::from_le_bytes),
        }
        .into_flattened()
    }

    /// Elements of `size` bytes without gaps.
    fn bytes(&self, size: usize) -> Vec<u8> {
        let mut bytes: Vec<u8> = match &self.base {
            Some(base) => {
                base.bytes.chunks(base.stride).flat_map(|element| element.iter().take(size)).copied().collect()
            }
            None => vec![0; self.count * size],
        };
        if let Some(Sparse { indices, values }) = &self.sparse {
            for (&index, element) in indices.iter().zip(values.bytes.chunks(values.stride)) {
                let start = index as usize * size;
                if let (Some(target), Some(element)) = (bytes.get_mut(start..start + size), element.get(..size)) {
                    target.copy_from_slice(element);
                }
            }
        }
        bytes
    }

    fn gather<const N: usize, const SIZE: usize, T: Copy + Default>(
        &self,
        decode: impl Fn([u8; SIZE]) -> T,
    ) -> Vec<[T; N]> {
        let element = |bytes: &[u8]| {
            let mut element = [T::default(); N];
            for (component, bytes) in element.iter_mut().zip(bytes.as_chunks::<SIZE>().0) {
                *component = decode(*bytes);
            }
            element
        };
        let mut elements: Vec<[T; N]> = match &self.base {
            Some(base) => base.bytes.chunks(base.stride).map(element).collect(),
            None => vec![[T::default(); N]; self.count],
        };
        if let Some(sparse) = &self.sparse {
            for (&index, bytes) in sparse.indices.iter().zip(sparse.values.bytes.chunks(sparse.values.stride)) {
                if let Some(target) = elements.get_mut(index as usize) {
                    *target = element(bytes);
                }
            }
        }
        elements
    }
}
