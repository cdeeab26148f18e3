//! Base colours of materials, which other renderers multiply into diffuse light.

use std::path::Path;

use glam::{DVec2, DVec3};
use gltf::json::texture::{Info, WrappingMode};
use gltf::json::validation::Checked;
use gltf::json::{Material, Root, Texture};

use super::buffers::{Buffers, confined_path, decode_data_uri};
use super::document::material_name;
use super::warnings::Warnings;
use super::{container, document};
use crate::error::{Error, Result};
use crate::io::photo::decode_photo;
use crate::io::picture::read_capped;
use crate::io::png::PngImage;

/// A picture as WebP in place of, or beside, one that every reader knows.
const WEBP: &str = "EXT_texture_webp";
/// A picture as KTX2 likewise.
const KTX2: &str = "KHR_texture_basisu";

/// The base colours of a document.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BaseColours {
    /// Base colours in the order of the document.
    pub materials: Vec<BaseColour>,
    /// Linear pictures of the base colours.
    pub pictures: Vec<PngImage>,
    /// Deviations from the document, one line each.
    pub warnings: Vec<String>,
}

/// The base colour of a material.
#[derive(Clone, Debug, PartialEq)]
pub struct BaseColour {
    /// Name of the material as [`super::read_gltf`] gives it.
    pub name: String,
    /// Linear RGB in [0, 1], multiplied with the picture.
    pub factor: DVec3,
    /// The picture and its placement over the texture coordinates.
    pub picture: Option<PlacedPicture>,
}

/// A picture over the texture coordinates of a model, `uv * scale + offset` with v up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlacedPicture {
    /// Index of the picture.
    pub index: usize,
    /// Factors on u and v.
    pub scale: DVec2,
    /// Offset added after scaling.
    pub offset: DVec2,
}

/// Reads the base colours of a glTF file (`.gltf` or `.glb`): factors, and pictures (PNG, JPEG, WebP) over `TEXCOORD_0`, with
/// the offset and scale of `KHR_texture_transform`. Pictures repeat, whatever their sampler says.
///
/// # Errors
/// As [`super::read_gltf`]; pictures of other formats, over other texture coordinates or turned (exit 5).
pub fn read_base_colours(path: &Path) -> Result<BaseColours> {
    let bytes = std::fs::read(path).map_err(|e| Error::io(path, &e))?;
    read(&bytes, path).map_err(|e| e.in_file(path))
}

pub(super) fn read(bytes: &[u8], path: &Path) -> Result<BaseColours> {
    let mut warnings = Warnings::default();
    let container = container::split(bytes, path, &mut warnings)?;
    let root = document::parse(container.json)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let buffers = Buffers::new(&root, container.binary, folder);
    let mut read = BaseColours::default();
    let mut images: Vec<usize> = Vec::new();
    for (i, material) in root.materials.iter().enumerate() {
        let name = material_name(i, material.name.as_deref());
        let colour = base_colour(&root, material, &name, &mut images, &mut warnings)
            .map_err(|e| e.at(format_args!("material {name:?}")))?;
        let known = read.materials.iter().find(|known| known.name == name);
        match known {
            Some(known) if *known == colour => {}
            Some(_) => {
                return Err(Error::unsupported(format!(
                    "two materials are called {name:?} and have different base colours; give them different names"
                )));
            }
            None => read.materials.push(colour),
        }
    }
    for image in images {
        let picture = picture(&root, &buffers, folder, image).map_err(|e| e.at(format_args!("image {image}")))?;
        read.pictures.push(picture);
    }
    read.warnings = warnings.into_lines();
    Ok(read)
}

/// Reads the base colour of a material; adds its image to `images`, those named so far.
fn base_colour(
    root: &Root,
    material: &Material,
    name: &str,
    images: &mut Vec<usize>,
    warnings: &mut Warnings,
) -> Result<BaseColour> {
    let surface = &material.pbr_metallic_roughness;
    let [r, g, b, _] = surface.base_color_factor.0.map(f64::from);
    let factor = DVec3::new(r, g, b);
    if !factor.to_array().iter().all(|c| (0.0..=1.0).contains(c)) {
        return Err(Error::input(format!("its baseColorFactor {r},{g},{b} is not in [0, 1]")));
    }
    let picture = match &surface.base_color_texture {
        Some(info) => Some(placed(root, info, name, images, warnings)?),
        None => None,
    };
    Ok(BaseColour { name: name.to_owned(), factor, picture })
}

fn placed(
    root: &Root,
    info: &Info,
    name: &str,
    images: &mut Vec<usize>,
    warnings: &mut Warnings,
) -> Result<PlacedPicture> {
    let texture = root
        .textures
        .get(info.index.value())
        .ok_or_else(|| Error::input(format!("its texture {} does not exist", info.index.value())))?;
    let transform = info.extensions.as_ref().and_then(|e| e.texture_transform.as_ref());
    if transform.and_then(|t| t.tex_coord).unwrap_or(info.tex_coord) != 0 {
        return Err(Error::unsupported("its base colour lies over TEXCOORD_1 or later, and only TEXCOORD_0 is kept"));
    }
    let (mut scale, mut offset) = (DVec2::ONE, DVec2::ZERO);
    if let Some(transform) = transform {
        if transform.rotation.0 != 0.0 {
            return Err(Error::unsupported(
                "its base colour is turned by KHR_texture_transform; apply that before export",
            ));
        }
        let ([sx, sy], [ox, oy]) = (transform.scale.0.map(f64::from), transform.offset.0.map(f64::from));
        // The document counts v downwards.
        (scale, offset) = (DVec2::new(sx, sy), DVec2::new(ox, 1.0 - oy - sy));
        if !(scale.is_finite() && offset.is_finite()) {
            return Err(Error::input("its KHR_texture_transform is not finite"));
        }
    }
    let sampler = texture.sampler.and_then(|s| root.samplers.get(s.value()));
    let repeats = |wrap: &Checked<WrappingMode>| matches!(wrap, Checked::Valid(WrappingMode::Repeat));
    if sampler.is_some_and(|s| !(repeats(&s.wrap_s) && repeats(&s.wrap_t))) {
        warnings.add_at(&format!("material {name:?}"), "its base colour repeats instead of ending at the edge");
    }
    let image = image_of(root, texture)?;
    let index = images.iter().position(|known| *known == image).unwrap_or_else(|| {
        images.push(image);
        images.len() - 1
    });
    Ok(PlacedPicture { index, scale, offset })
}

/// The image of a texture that can be read: its own, or else that of an extension.
fn image_of(root: &Root, texture: &Texture) -> Result<usize> {
    let own = texture.source.value();
    if own < root.images.len() {
        return Ok(own);
    }
    let others = texture.extensions.as_ref().map(|e| &e.others);
    let webp = others.and_then(|e| e.get(WEBP)?.get("source")?.as_u64()).and_then(|i| usize::try_from(i).ok());
    match webp {
        Some(image) => Ok(image),
        None if others.is_some_and(|e| e.contains_key(KTX2)) => Err(Error::unsupported(format!(
            "its picture is KTX2 ({KTX2}), which is not read; convert it to PNG, JPEG or WebP"
        ))),
        // A texture without an image has the largest number there is.
        None if own == u32::MAX as usize => Err(Error::input("its texture has no image")),
        None => Ok(own),
    }
}

fn read_file(path: &Path) -> Result<Vec<u8>> {
    // A pipe or device named by a model would block or never end.
    if std::fs::metadata(path).is_ok_and(|meta| !meta.is_file()) {
        return Err(Error::input(format!("{} is not a regular file", path.display())));
    }
    read_capped(path)
}

fn picture(root: &Root, buffers: &Buffers, folder: &Path, index: usize) -> Result<PngImage> {
    let image = root.images.get(index).ok_or_else(|| Error::input("it does not exist"))?;
    let owned;
    let bytes: &[u8] = match (&image.uri, image.buffer_view) {
        (Some(uri), _) => {
            owned = match uri.strip_prefix("data:") {
                Some(data) => decode_data_uri(data)?,
                None => read_file(&folder.join(confined_path(uri)?))?,
            };
            &owned
        }
        (None, Some(view)) => {
            let missing = || Error::input(format!("its bufferView {} does not exist", view.value()));
            let view = root.buffer_views.get(view.value()).ok_or_else(missing)?;
            let buffer = buffers.get(view.buffer.value())?;
            let start = usize::try_from(view.byte_offset.unwrap_or_default().0).ok();
            let end = start.zip(usize::try_from(view.byte_length.0).ok()).and_then(|(s, l)| s.checked_add(l));
            let range = start.zip(end).and_then(|(start, end)| buffer.get(start..end));
            range.ok_or_else(|| Error::input("its bufferView is past the end of its buffer"))?
        }
        (None, None) => return Err(Error::input("it has neither a uri nor a bufferView")),
    };
    decode_photo(bytes)
}
