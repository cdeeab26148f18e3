//! What an engine reads of an asset, without the baker: `cargo run -p translux-format --example engine -- A.tlux`.
//! `engine.c` beside it does the same in C.

use std::process::ExitCode;

use translux_format::far_field::{FarField, LANES, NO_RECEIVER, Shape, over_lanes};
use translux_format::rows::IrradianceRows;
use translux_format::{AssetFile, Budget, FormatError};

fn main() -> ExitCode {
    let Some(path) = std::env::args_os().nth(1) else {
        eprintln!("usage: engine A.tlux");
        return ExitCode::from(1);
    };
    let bytes = match std::fs::read(&path) {
        Ok(bytes) => bytes,
        Err(e) => {
            eprintln!("{}: {e}", path.display());
            return ExitCode::from(2);
        }
    };
    match describe(&bytes) {
        Ok(text) => print!("{text}"),
        Err(e) => {
            eprintln!("{}: {e}", path.display());
            return ExitCode::from(3);
        }
    }
    ExitCode::SUCCESS
}

/// Everything that goes into an engine's buffers, as text.
pub(crate) fn describe(bytes: &[u8]) -> Result<String, FormatError> {
    // Checksums, lengths and indices are verified here; nothing below can be out of range.
    let asset = AssetFile::from_bytes(bytes, Budget::default())?;
    let (mesh, parts, samples) = (&asset.mesh, &asset.parts, &asset.samples);
    let mut text = format!(
        "method {}\nmesh: {} vertices, {} triangles, {} welded points\n",
        asset.provenance.method,
        mesh.positions_mm.len(),
        mesh.triangles.len(),
        mesh.weld.iter().enumerate().filter(|(vertex, weld)| *vertex == **weld as usize).count(),
    );
    for medium in &parts.media {
        text += &format!("medium {}: sigma_s' {:.4?} 1/mm\n", medium.name, medium.sigma_s_reduced_per_mm);
    }
    text += &format!("samples: {}\n", samples.patch_count());
    if let Some(rows) = IrradianceRows::from_sections(&asset.extra, samples.patch_count())? {
        text += &format!("irradiance rows: cube map of 6 x {0} x {0}, {1} bytes decoded\n", rows.side, rows.bytes());
    }
    if let Some(far) = FarField::from_sections(&asset.extra, &Shape::new(mesh.positions_mm.len(), samples))? {
        text += &format!(
            "far field: {} basis functions, {} of {} vertices in {} groups of {LANES}, {} coefficients\n",
            far.terms,
            far.receivers(),
            mesh.positions_mm.len(),
            far.groups.len(),
            far.nodes.len()
        );
        text += &first_vertex(&far);
    }
    Ok(text)
}

/// The first coefficients of the group that the first vertex with a receiver is in, as SPEC.md describes them: what to multiply the light's details by.
fn first_vertex(far: &FarField) -> String {
    let Some(vertex) = far.receiver_of_vertex.iter().position(|&r| r != NO_RECEIVER) else { return String::new() };
    let receiver = far.receiver_of_vertex[vertex];
    let index = far.groups.partition_point(|group| group.rows_end <= receiver);
    let before = &far.groups[..index];
    let first_receiver = before.last().map_or(0, |group| group.rows_end);
    let first = before.last().map_or(0, |group| group.coefficients_end as usize);
    let end = far.groups[index].coefficients_end as usize;
    let ones = |masks: &[u16]| masks.iter().map(|m| m.count_ones() as usize).sum::<usize>();
    // Values of 8 and of 16 bits lie in lists of their own, in the order of the coefficients and their functions.
    let mut wide = ones(&far.wide_masks[..first]);
    let mut narrow = ones(&far.masks[..first]) - wide;
    let mut text = format!("vertex {vertex} is receiver {receiver}; of its {} coefficients:\n", end - first);
    for c in (first..end).take(5) {
        for k in (0..far.terms).filter(|k| far.masks[c] >> k & 1 == 1) {
            let row = if far.wide_masks[c] >> k & 1 == 1 {
                wide += 1;
                far.wide[wide - 1].map(f32::from)
            } else {
                narrow += 1;
                far.narrow[narrow - 1].map(f32::from)
            };
            let value = over_lanes(row)[(receiver - first_receiver) as usize] * far.steps[k];
            text += &format!("  node {} function {k}: {value:.3e}\n", far.nodes[c]);
        }
    }
    text
}
