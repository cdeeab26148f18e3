//! The sections of `editable`: the basis and the far field.

use translux_format::RawSection;
use translux_format::far_field::{FarField, Shape};
use translux_format::profile_basis as file;

use crate::asset::Asset;
use crate::error::{Error, Result};
use crate::evaluate::form::{read_error, write_error};
use crate::geometry::mesh::Mesh;
use crate::geometry::samples::Samples;
use crate::medium::profile_basis::ProfileBasis;

pub(super) fn write(basis: &ProfileBasis, far: &FarField, mesh: &Mesh, samples: &Samples) -> Result<Vec<RawSection>> {
    let mut sections = file::ProfileBasis {
        split_mm: basis.split_mm(),
        nodes_mm: basis.nodes_mm().to_vec(),
        weights_mm4: basis.weights_mm4().to_vec(),
        functions: basis.functions().to_vec(),
        totals: basis.totals().map(<[f64]>::to_vec),
    }
    .to_sections()
    .map_err(write_error)?;
    let shape = Shape { vertices: mesh.local_mm.len(), part_offsets: &samples.part_offsets };
    sections.extend(far.to_coded_sections(&shape).map_err(write_error)?);
    Ok(sections)
}

pub(super) fn read(asset: &Asset) -> Result<(ProfileBasis, FarField)> {
    let missing = |what: &str| Error::input(format!("an asset of `editable` without its {what}; bake it again"));
    let basis = file::ProfileBasis::from_sections(&asset.sections)
        .map_err(read_error)?
        .ok_or_else(|| missing("basis (sections bas.*)"))?;
    let shape = Shape { vertices: asset.scene.mesh.local_mm.len(), part_offsets: &asset.samples.part_offsets };
    let far = FarField::from_sections(&asset.sections, &shape)
        .map_err(read_error)?
        .ok_or_else(|| missing("far field (sections far.*)"))?;
    let file::ProfileBasis { split_mm, nodes_mm, weights_mm4, functions, totals } = basis;
    let basis = ProfileBasis::from_parts(split_mm, nodes_mm, weights_mm4, functions, totals)?;
    if basis.terms() != far.terms {
        let (a, b) = (basis.terms(), far.terms);
        return Err(Error::input(format!("the basis has {a} functions and the far field {b}; bake the asset again")));
    }
    Ok((basis, far))
}
