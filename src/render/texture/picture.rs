//! Pictures over the texture coordinates of a mesh, at most one for each of its materials.

use std::path::Path;

use glam::{DVec2, DVec3};

use super::spec::TextureSpec;
use crate::error::{Error, Result};
use crate::geometry::mesh::Mesh;
use crate::io::gltf::base_colour::{BaseColours, PlacedPicture, read_base_colours};
use crate::io::photo::read_photo;
use crate::io::png::PngImage;

/// A picture that repeats over the plane of texture coordinates, linear sRGB in [0, 1].
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    width: usize,
    height: usize,
    rgb: Vec<[f32; 3]>,
}

impl Picture {
    /// A picture of `width * height` pixels, row by row from the top.
    ///
    /// # Errors
    /// Another number of pixels, or none (exit 4: a caller's mistake).
    pub fn new(width: usize, height: usize, rgb: Vec<[f32; 3]>) -> Result<Self> {
        if rgb.is_empty() || Some(rgb.len()) != width.checked_mul(height) {
            return Err(Error::runtime(format!("{} pixels for a texture of {width} x {height}", rgb.len())));
        }
        Ok(Self { width, height, rgb })
    }

    /// The picture of a file; its alpha is not used.
    fn of(png: PngImage) -> Result<Self> {
        Self::new(png.width, png.height, png.rgb)
    }

    /// Width and height in pixels.
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// The albedo at texture coordinates (v up), interpolated between the centres of pixels.
    pub fn albedo(&self, uv: DVec2) -> DVec3 {
        if !uv.is_finite() {
            return DVec3::ONE;
        }
        // The fraction first, so that far repetitions lose digits only where the coordinates have.
        let place = |t: f64, size: usize| (t - t.floor()) * size as f64 - 0.5;
        let (x, y) = (place(uv.x, self.width), place(1.0 - uv.y, self.height));
        let wrapped = |at: f64, size: usize| (at.rem_euclid(size as f64) as usize).min(size - 1);
        let pixel = |x: f64, y: f64| {
            let index = wrapped(y, self.height) * self.width + wrapped(x, self.width);
            DVec3::from(self.rgb[index].map(f64::from))
        };
        let (left, top) = (x.floor(), y.floor());
        let row = |y: f64| pixel(left, y).lerp(pixel(left + 1.0, y), x - left);
        row(top).lerp(row(top + 1.0), y - top)
    }
}

/// The albedo of a material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coat {
    /// Colour factor, RGB in [0, 1].
    pub factor: DVec3,
    /// The picture that is multiplied by the factor.
    pub picture: Option<PlacedPicture>,
}

/// Pictures and factors on the materials of a mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct PictureTexture {
    /// The texture that was asked for, with its file.
    pub spec: TextureSpec,
    /// The coat of each material of the mesh.
    pub coats: Vec<Coat>,
    /// The pictures that the coats refer to.
    pub pictures: Vec<Picture>,
    /// Differences from the file's own texture, one line each.
    pub warnings: Vec<String>,
}

impl PictureTexture {
    /// Reads a picture (PNG, JPEG, WebP) that covers all of a mesh.
    ///
    /// # Errors
    /// A mesh without texture coordinates (exit 5), those of [`read_photo`].
    pub fn read_image(path: &Path, mesh: &Mesh) -> Result<Self> {
        check_coordinates(mesh).map_err(|e| e.at(format_args!("texture {}", path.display())))?;
        let picture = Picture::of(read_photo(path).map_err(|e| e.at("texture"))?)?;
        let placed = PlacedPicture { index: 0, scale: DVec2::ONE, offset: DVec2::ZERO };
        let coat = Coat { factor: DVec3::ONE, picture: Some(placed) };
        Ok(Self {
            spec: TextureSpec::Image(path.to_owned()),
            coats: vec![coat; mesh.materials.len()],
            pictures: vec![picture],
            warnings: Vec::new(),
        })
    }

    /// Reads the base colours of a glTF model for the mesh that was made from it; materials are matched by name.
    ///
    /// # Errors
    /// Another model (exit 3), pictures for a mesh without texture coordinates (exit 5), those of
    /// [`read_base_colours`].
    pub fn read_model(path: &Path, mesh: &Mesh) -> Result<Self> {
        let colours = read_base_colours(path).map_err(|e| e.at("texture"))?;
        Self::of_colours(path, colours, mesh).map_err(|e| e.at(format_args!("texture {}", path.display())))
    }

    fn of_colours(path: &Path, colours: BaseColours, mesh: &Mesh) -> Result<Self> {
        let coat = |name: &String| match colours.materials.iter().find(|m| m.name == *name) {
            Some(found) => Ok(Coat { factor: found.factor, picture: found.picture }),
            // Faces without a material are white.
            None if name == "default" => Ok(Coat { factor: DVec3::ONE, picture: None }),
            None => Err(Error::input(format!(
                "the file has no material {name:?}, which the asset has; name the model that the asset was baked from"
            ))),
        };
        let coats = mesh.materials.iter().map(coat).collect::<Result<Vec<Coat>>>()?;
        if coats.iter().any(|coat| coat.picture.is_some()) {
            check_coordinates(mesh)?;
        }
        let pictures = colours.pictures.into_iter().map(Picture::of).collect::<Result<_>>()?;
        Ok(Self { spec: TextureSpec::BaseColour(path.to_owned()), coats, pictures, warnings: colours.warnings })
    }

    /// The albedo of a material of the mesh at texture coordinates.
    pub fn albedo(&self, material: usize, uv: Option<DVec2>) -> DVec3 {
        let Some(coat) = self.coats.get(material) else { return DVec3::ONE };
        let seen = coat.picture.zip(uv).and_then(|(placed, uv)| {
            let picture = self.pictures.get(placed.index)?;
            Some(picture.albedo(uv * placed.scale + placed.offset))
        });
        coat.factor * seen.unwrap_or(DVec3::ONE)
    }
}

fn check_coordinates(mesh: &Mesh) -> Result<()> {
    if mesh.uvs.as_ref().is_some_and(|uvs| !uvs.values.is_empty()) {
        return Ok(());
    }
    Err(Error::unsupported(
        "the model has no texture coordinates for a picture; use --texture marble, or export the model with them and bake \
         it again",
    ))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::error::ExitCode;
    use crate::geometry::mesh::Placement;
    use crate::geometry::shapes;
    use crate::io::gltf::base_colour::BaseColour;

    fn four() -> Picture {
        // Black, red over green, blue.
        Picture::new(2, 2, vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]).unwrap()
    }

    #[test]
    fn pixels_stand_at_their_centres_with_v_up_and_repeat() {
        let picture = four();
        for (u, v) in [(0.0, 0.0), (3.0, -5.0), (-1.0, 1.0)] {
            let at = |x: f64, y: f64| picture.albedo(DVec2::new(u + x, v + y));
            assert_eq!([at(0.25, 0.75), at(0.75, 0.75)], [DVec3::ZERO, DVec3::X]);
            assert_eq!([at(0.25, 0.25), at(0.75, 0.25)], [DVec3::Y, DVec3::Z]);
            assert_eq!(at(0.5, 0.25), 0.5 * (DVec3::Y + DVec3::Z));
            // Across the edge.
            assert_eq!(at(0.0, 0.25), 0.5 * (DVec3::Y + DVec3::Z));
            assert_eq!(at(0.0, 0.0), DVec3::splat(0.25));
        }
        for far in [1e18, -1e300, f64::MAX] {
            assert!(picture.albedo(DVec2::new(far, far)).is_finite());
        }
        assert_eq!(picture.albedo(DVec2::NAN), DVec3::ONE);
        for (width, pixels) in [(0, 0), (2, 3)] {
            assert!(Picture::new(width, 2, vec![[0.0; 3]; pixels]).is_err());
        }
    }

    fn mesh(name: &str) -> Mesh {
        let mut model = shapes::icosphere(1.0, 0);
        model.materials = vec![name.to_owned()];
        Mesh::from_source(model, &Placement { mm_per_unit: 1.0 }).unwrap().0
    }

    #[test]
    fn meshes_without_coordinates_are_refused_where_there_are_pictures() {
        let error = PictureTexture::read_image(Path::new("wood.png"), &mesh("a")).unwrap_err();
        assert_eq!(error.code(), ExitCode::Unsupported);
        assert!(error.message().contains("no texture coordinates") && error.message().contains("wood.png"));
        let placed = PlacedPicture { index: 0, scale: DVec2::ONE, offset: DVec2::ZERO };
        let colours = |picture| BaseColours {
            materials: vec![BaseColour { name: "a".into(), factor: DVec3::splat(0.5), picture }],
            ..BaseColours::default()
        };
        let texture =
            |picture, name: &str| PictureTexture::of_colours(Path::new("m.glb"), colours(picture), &mesh(name));
        assert_eq!(texture(Some(placed), "a").unwrap_err().code(), ExitCode::Unsupported);
        assert_eq!(texture(None, "a").unwrap().albedo(0, None), DVec3::splat(0.5));
        assert_eq!(texture(None, "default").unwrap().albedo(0, None), DVec3::ONE);
        let error = texture(None, "b").unwrap_err();
        assert!(error.code() == ExitCode::InvalidInput && error.message().contains("\"b\""), "{error}");
    }
}
