//! Every rule about the content of the common sections, broken once: on writing and on reading.
#![allow(clippy::unwrap_used)]

mod common;

use common::{Entry, build, full_asset, sections_of};
use translux_format::{AssetFile, Budget, FormatError, MAX_STRING_BYTES, NO_MEDIUM, Samples};

/// One way to break an asset: what, the section that is blamed, how.
type Rule = (&'static str, &'static str, fn(&mut AssetFile));

fn refuse_on_writing(rules: &[Rule]) {
    for (what, tag, break_rule) in rules {
        let mut asset = full_asset();
        break_rule(&mut asset);
        assert_ne!(asset, full_asset(), "{what} changes nothing");
        for error in [asset.validate().unwrap_err(), asset.to_bytes().unwrap_err()] {
            assert!(matches!(&error, FormatError::Invalid { .. }), "{what}: {error}");
            assert_eq!(error.tag().unwrap().as_str(), *tag, "{what}: {error}");
        }
    }
}

#[test]
fn mesh() {
    refuse_on_writing(&[
        ("origin", "mesh.org", |a| a.mesh.origin_mm[2] = f64::INFINITY),
        ("position", "mesh.pos", |a| a.mesh.positions_mm[5][1] = f32::NAN),
        ("position", "mesh.pos", |a| a.mesh.positions_mm[5][2] = f32::NEG_INFINITY),
        ("corner", "mesh.tri", |a| a.mesh.triangles[3][2] = 6),
        ("corner", "mesh.tri", |a| a.mesh.triangles[0][0] = u32::MAX),
        ("one triangle more", "mesh.mat", |a| a.mesh.triangles.push([0, 1, 2])),
        ("material", "mesh.mat", |a| a.mesh.triangle_material[1] = 2),
        ("one material less", "mesh.mat", |a| _ = a.mesh.triangle_material.pop()),
        ("no names", "mesh.mat", |a| a.mesh.materials.clear()),
        ("long name", "mesh.mtn", |a| a.mesh.materials[0] = "x".repeat(MAX_STRING_BYTES + 1)),
        ("weld forward", "mesh.wld", |a| a.mesh.weld[3] = 4),
        ("weld beyond", "mesh.wld", |a| a.mesh.weld[5] = 6),
        ("weld to a welded one", "mesh.wld", |a| a.mesh.weld[5] = 3),
        ("one weld less", "mesh.wld", |a| _ = a.mesh.weld.pop()),
        ("normal", "mesh.nrm", |a| a.mesh.normals.as_mut().unwrap().values[0][0] = f32::NAN),
        ("corner of a normal", "mesh.nri", |a| a.mesh.normals.as_mut().unwrap().corners[3][0] = 3),
        ("one normal less", "mesh.nri", |a| _ = a.mesh.normals.as_mut().unwrap().corners.pop()),
        ("uv", "mesh.uv", |a| a.mesh.uvs.as_mut().unwrap().values[1][1] = f32::INFINITY),
        ("corner of a uv", "mesh.uvi", |a| a.mesh.uvs.as_mut().unwrap().corners[0][2] = 2),
        ("uvs without values", "mesh.uvi", |a| a.mesh.uvs.as_mut().unwrap().values.clear()),
    ]);
}

#[test]
fn parts_and_media() {
    refuse_on_writing(&[
        ("part", "part.tri", |a| a.parts.triangle_part[0] = 3),
        ("one part less", "part.tri", |a| _ = a.parts.triangle_part.pop()),
        ("no parts", "part.tri", |a| a.parts.parts.clear()),
        ("medium", "part.rec", |a| a.parts.parts[0].medium = 2),
        ("no medium", "part.rec", |a| a.parts.parts[0].medium = NO_MEDIUM),
        ("opaque with a wrong medium", "part.rec", |a| a.parts.parts[2].medium = 2),
        ("not opaque", "part.rec", |a| a.parts.parts[2].opaque = false),
        ("long name", "part.rec", |a| a.parts.parts[1].name = "x".repeat(MAX_STRING_BYTES + 1)),
        ("long name", "part.med", |a| a.parts.media[1].name = "x".repeat(MAX_STRING_BYTES + 1)),
        ("negative", "part.med", |a| a.parts.media[0].sigma_s_reduced_per_mm[2] = -1e-9),
        ("infinite", "part.med", |a| a.parts.media[0].sigma_s_reduced_per_mm[0] = f64::INFINITY),
        ("not a number", "part.med", |a| a.parts.media[1].sigma_a_per_mm[1] = f64::NAN),
        ("g", "part.med", |a| a.parts.media[0].g = 1.0),
        ("g", "part.med", |a| a.parts.media[0].g = -1.0),
        ("g", "part.med", |a| a.parts.media[0].g = f64::NAN),
        ("eta", "part.med", |a| a.parts.media[0].eta_inside_over_outside = 0.0),
        ("eta", "part.med", |a| a.parts.media[0].eta_inside_over_outside = f64::INFINITY),
        ("eta", "part.med", |a| a.parts.media[0].eta_inside_over_outside = f64::NAN),
    ]);
}

#[test]
fn samples() {
    refuse_on_writing(&[
        ("triangle", "samp.fac", |a| a.samples.facets[0][0] = 4),
        ("path", "samp.fac", |a| a.samples.facets[4][1] = 0),
        ("facet of another part", "samp.fac", |a| a.samples.facets[4][0] = 0),
        ("facet of no part", "samp.fac", |a| a.samples.facets[4][0] = 3),
        ("one facet more", "samp.off", |a| a.samples.facets.push([2, 1])),
        ("empty patch", "samp.off", |a| a.samples.patch_offsets.insert(1, 1)),
        ("descending", "samp.off", |a| a.samples.patch_offsets.insert(2, 0)),
        ("beyond", "samp.off", |a| a.samples.patch_offsets[2] = 6),
        ("first not 0", "samp.off", |a| _ = a.samples.patch_offsets.remove(0)),
        ("none", "samp.off", |a| a.samples.patch_offsets.clear()),
        ("one part less", "samp.prt", |a| _ = a.samples.part_offsets.pop()),
        ("descending", "samp.prt", |a| a.samples.part_offsets[1] = 4),
        ("last", "samp.prt", |a| a.samples.part_offsets[3] = 2),
        ("first", "samp.prt", |a| a.samples.part_offsets[0] = 1),
        ("none", "samp.prt", |a| a.samples.part_offsets.clear()),
    ]);
    let mut without = full_asset();
    without.samples = Samples::none(3);
    assert_eq!(AssetFile::from_bytes(&without.to_bytes().unwrap(), Budget::default()).unwrap(), without);
}

#[test]
fn provenance_and_ledger() {
    refuse_on_writing(&[
        ("order", "meta.src", |a| a.provenance.settings.reverse()),
        ("key twice", "meta.src", |a| a.provenance.settings[1].0 = "max-rms".into()),
        ("long key", "meta.src", |a| a.provenance.settings[1].0 = "x".repeat(MAX_STRING_BYTES + 1)),
        ("long value", "meta.src", |a| a.provenance.settings[1].1 = "x".repeat(MAX_STRING_BYTES + 1)),
        ("long method", "meta.src", |a| a.provenance.method = "x".repeat(MAX_STRING_BYTES + 1)),
        ("long unit", "meta.src", |a| a.provenance.source_unit = "x".repeat(MAX_STRING_BYTES + 1)),
        ("long note", "meta.src", |a| a.provenance.notes.push("x".repeat(MAX_STRING_BYTES + 1))),
        ("long name", "meta.src", |a| a.provenance.inputs[0].name = "x".repeat(MAX_STRING_BYTES + 1)),
        ("path", "meta.src", |a| a.provenance.inputs[0].name = "/tmp/model.obj".into()),
        ("path", "meta.src", |a| a.provenance.inputs[0].name = "tmp\\model.obj".into()),
        ("no name", "meta.src", |a| a.provenance.inputs[0].name.clear()),
        ("scale", "meta.src", |a| a.provenance.mm_per_source_unit = 0.0),
        ("scale", "meta.src", |a| a.provenance.mm_per_source_unit = f64::NAN),
        ("rms", "meta.err", |a| a.ledger[0].relative_rms = -1e-300),
        ("bias", "meta.err", |a| a.ledger[0].relative_bias = f64::NEG_INFINITY),
        ("p999", "meta.err", |a| a.ledger[0].p999 = f64::NAN),
        ("worst", "meta.err", |a| a.ledger[0].worst = f64::INFINITY),
        ("long stage", "meta.err", |a| a.ledger[0].stage = "x".repeat(MAX_STRING_BYTES + 1)),
        ("long note", "meta.err", |a| a.ledger[0].note = "x".repeat(MAX_STRING_BYTES + 1)),
    ]);
    let mut longest = full_asset();
    longest.provenance.notes = vec!["x".repeat(MAX_STRING_BYTES)];
    assert_eq!(AssetFile::from_bytes(&longest.to_bytes().unwrap(), Budget::default()).unwrap(), longest);
}

/// Changes the decoded bytes of one section and reads the file.
fn read_with(tag: &str, change: impl Fn(&mut Entry)) -> FormatError {
    let sections = sections_of(&full_asset().to_bytes().unwrap());
    let mut entries: Vec<Entry> = sections.iter().map(Entry::raw).collect();
    let index = sections.iter().position(|section| section.tag.as_str() == tag).unwrap();
    change(&mut entries[index]);
    entries[index].decoded = entries[index].stored.len() as u64;
    AssetFile::from_bytes(&build(&entries), Budget::default()).unwrap_err()
}

#[test]
fn reading_checks_the_same_rules() {
    let word = |at: usize, value: u32| {
        move |entry: &mut Entry| entry.stored[4 * at..4 * at + 4].copy_from_slice(&value.to_le_bytes())
    };
    let nan = f32::NAN.to_bits();
    let cases: [(&str, usize, u32); 17] = [
        ("mesh.org", 1, 0x7ff0_0000),
        ("mesh.pos", 7, nan),
        ("mesh.tri", 0, 6),
        ("mesh.nrm", 2, nan),
        ("mesh.nri", 3, 3),
        ("mesh.uv", 1, nan),
        ("mesh.uvi", 11, 2),
        ("mesh.mat", 3, 2),
        ("mesh.wld", 0, 1),
        ("mesh.wld", 5, 2),
        ("part.tri", 2, 3),
        ("samp.fac", 0, 4),
        ("samp.fac", 1, 0),
        ("samp.off", 1, 0),
        ("samp.off", 2, 9),
        ("samp.prt", 3, 9),
        ("samp.prt", 1, 1),
    ];
    for (tag, at, value) in cases {
        let error = read_with(tag, word(at, value));
        assert_eq!(error.code(), 21, "{tag} {at}: {error}");
        // Fewer patches in part 0 leave a patch whose facets belong to it in part 1.
        let blamed = if (tag, at) == ("samp.prt", 1) { "samp.fac" } else { tag };
        assert_eq!(error.tag().unwrap().as_str(), blamed, "{tag} {at}: {error}");
    }
}

#[test]
fn records_are_read_strictly() {
    for tag in ["mesh.mtn", "part.rec", "part.med", "meta.src", "meta.err"] {
        assert_eq!(read_with(tag, |entry| entry.stored.push(0)).code(), 20, "{tag}");
        assert_eq!(read_with(tag, |entry| _ = entry.stored.pop()).code(), 20, "{tag}");
        assert_eq!(read_with(tag, |entry| entry.stored.clear()).code(), 20, "{tag}");
    }
    // The first part: its list's length, its name's length, "body", opaque, medium.
    assert_eq!(read_with("part.rec", |entry| entry.stored[20] = 2).code(), 20);
    assert_eq!(read_with("part.rec", |entry| entry.stored[16] = 0xff).code(), 20);
}

#[test]
fn type_width_kind_and_number_of_rows_are_checked() {
    assert_eq!(read_with("mesh.pos", |entry| entry.head[8] = 5).code(), 19);
    assert_eq!(read_with("mesh.pos", |entry| entry.head[10] = 1).code(), 19);
    assert_eq!(read_with("mesh.pos", |entry| entry.head[12] = 2).code(), 21);
    assert_eq!(read_with("samp.off", |entry| entry.head[12] = 0).code(), 21);
    assert_eq!(read_with("mesh.mtn", |entry| entry.head[8] = 1).code(), 19);
    assert_eq!(read_with("mesh.org", |entry| entry.stored.clear()).code(), 21);
    assert_eq!(read_with("mesh.org", |entry| entry.stored.extend([0; 24])).code(), 21);
    assert_eq!(read_with("mesh.pos", |entry| entry.stored.truncate(70)).code(), 13);
    for tag in ["mesh.nrm", "mesh.nri", "mesh.uv", "mesh.uvi", "meta.src", "samp.prt", "mesh.wld"] {
        let error = read_with(tag, |entry| entry.head[..8].copy_from_slice(b"x.gone\0\0"));
        assert_eq!((error.code(), error.tag().unwrap().as_str()), (18, tag));
    }
}
