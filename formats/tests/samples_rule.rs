//! Samples that follow the rule are not stored, and are the same when they are read.
#![allow(clippy::unwrap_used)]

mod common;

use common::{Entry, build, sections_of};
use translux_format::sample_rule::MOST_MADE;
use translux_format::subdivision::{Surface, in_tree_order, subdivide};
use translux_format::{
    AssetFile, Budget, FormatError, MediumRecord, Mesh, NO_MEDIUM, NO_PART, PartRecord, Parts, RawSection, Reader,
    Samples, Tag, scan,
};

/// A sheet of `side` x `side` uneven quadrilaterals, halved, in three parts of which the second is opaque, and some in none.
fn sheet(side: u32) -> AssetFile {
    let mut noise = 1u32;
    let mut uneven = || {
        noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (noise >> 8) as f32 / (1 << 24) as f32
    };
    let mut mesh = Mesh { materials: vec!["default".into()], ..Default::default() };
    for i in 0..=side {
        for j in 0..=side {
            mesh.positions_mm.push([i as f32 + 0.7 * uneven(), j as f32 + 0.7 * uneven(), 0.3 * uneven()]);
        }
    }
    let mut parts = Parts::default();
    for i in 0..side {
        for j in 0..side {
            let [a, b] = [i * (side + 1) + j, (i + 1) * (side + 1) + j];
            mesh.triangles.extend([[a, b, b + 1], [a, b + 1, a + 1]]);
            let part = if j == 0 { NO_PART } else { j % 3 };
            parts.triangle_part.extend([part; 2]);
        }
    }
    mesh.triangle_material = vec![0; mesh.triangles.len()];
    mesh.weld = (0..mesh.positions_mm.len() as u32).collect();
    let medium = MediumRecord { eta_inside_over_outside: 1.3, ..Default::default() };
    parts.media.push(medium);
    for (name, opaque, medium) in [("left", false, 0), ("stone", true, NO_MEDIUM), ("right", false, 0)] {
        parts.parts.push(PartRecord { name: name.into(), opaque, medium });
    }
    let mut asset = AssetFile { mesh, parts, ..Default::default() };
    asset.provenance.mm_per_source_unit = 1.0;
    asset
}

fn with_samples(mut asset: AssetFile, count: usize) -> AssetFile {
    asset.samples = subdivide(&Surface::new(&asset.mesh, &asset.parts), &[true, false, true], count);
    asset
}

fn in_order_of_a_tree(mut asset: AssetFile) -> AssetFile {
    asset.samples = in_tree_order(&Surface::new(&asset.mesh, &asset.parts), &asset.samples);
    asset
}

fn has(bytes: &[u8], tag: &str) -> bool {
    Reader::parse(bytes, Budget::default()).unwrap().find(Tag::new(tag).unwrap()).is_some()
}

#[test]
fn they_are_read_as_they_were_and_take_nothing() {
    // Clusters, one sample a triangle, pieces.
    for count in [2, 3, 17, 60, 113, 5000] {
        let cut = with_samples(sheet(8), count);
        assert_eq!(cut.samples.patch_count(), count);
        for asset in [cut.clone(), in_order_of_a_tree(cut)] {
            let bytes = asset.to_bytes().unwrap();
            assert!(has(&bytes, "samp.rul") && !has(&bytes, "samp.fac") && !has(&bytes, "samp.off"));
            let read = AssetFile::from_bytes(&bytes, Budget::default()).unwrap();
            assert_eq!(read, asset);
            assert_eq!(read.to_bytes().unwrap(), bytes);
            assert_eq!(scan(&bytes, Budget::default()).into_asset().unwrap(), asset);
            let stored = AssetFile { samples_stored: true, ..asset };
            let bytes_of_stored = stored.to_bytes().unwrap();
            assert!(has(&bytes_of_stored, "samp.fac") && !has(&bytes_of_stored, "samp.rul"));
            assert!(bytes_of_stored.len() > bytes.len() || count < 200, "{count}");
            assert_eq!(AssetFile::from_bytes(&bytes_of_stored, Budget::default()).unwrap(), stored);
        }
    }
}

/// Files rest on the rule: whoever changes it must give the changed one another number.
#[test]
fn the_rule_is_the_one_that_files_rest_on() {
    let checksum = |asset: &AssetFile| {
        let bytes = asset.to_bytes().unwrap();
        let reader = Reader::parse(&bytes, Budget::default()).unwrap();
        reader.array::<[u32; 2]>(Tag::new("samp.rul").unwrap()).unwrap()
    };
    let cut = with_samples(sheet(8), 300);
    assert_eq!(checksum(&in_order_of_a_tree(cut.clone())), [[1, 2_777_659_134]]);
    assert_eq!(checksum(&cut), [[0, 2_035_863_842]]);
}

#[test]
fn patches_partition_the_parts_and_are_of_similar_area() {
    let asset = with_samples(sheet(8), 400);
    let samples = &asset.samples;
    samples.validate().unwrap();
    asset.validate().unwrap();
    // Shares of whole triangles: 2^-depth each.
    let mut shares = vec![0.0; asset.mesh.triangles.len()];
    for [triangle, path] in &samples.facets {
        shares[*triangle as usize] += 0.5f64.powi(path.ilog2() as i32);
    }
    let expected = asset.parts.triangle_part.iter().map(|part| if [0, 2].contains(part) { 1.0 } else { 0.0 });
    assert!(shares.iter().copied().eq(expected), "{shares:?}");
    // No piece of a triangle is more than twice another piece of it.
    let depths = |t: u32| samples.facets.iter().filter(move |f| f[0] == t).map(|f| f[1].ilog2());
    for t in 0..shares.len() as u32 {
        let (least, most) = (depths(t).min().unwrap_or(0), depths(t).max().unwrap_or(0));
        assert!(most - least <= 1, "{t}: {least} to {most}");
    }
}

#[test]
fn what_does_not_follow_it_is_stored() {
    let asset = with_samples(sheet(4), 50);
    let mut other = asset.clone();
    other.samples.facets.swap(0, 1);
    // A vertex further away, and the same samples.
    let mut moved = asset.clone();
    moved.mesh.positions_mm[7][0] += 40.0;
    let none = AssetFile { samples: Samples::none(3), ..asset.clone() };
    for asset in [other, moved, none] {
        let bytes = asset.to_bytes().unwrap();
        assert!(has(&bytes, "samp.fac") && !has(&bytes, "samp.rul"));
        let read = AssetFile::from_bytes(&bytes, Budget::default()).unwrap();
        assert_eq!(read, AssetFile { samples_stored: true, ..asset });
    }
    // No more than a second.
    let side = 600;
    let large = with_samples(sheet(side), MOST_MADE - 2 * (side * side) as usize + 1);
    assert!(has(&large.to_bytes().unwrap(), "samp.fac"));
}

#[test]
fn a_rule_that_is_not_kept_is_refused() {
    let asset = with_samples(sheet(4), 50);
    let bytes = asset.to_bytes().unwrap();
    let file = |sections: &[RawSection]| build(&sections.iter().map(Entry::raw).collect::<Vec<_>>());
    let changed = |change: &dyn Fn(&mut Vec<u32>, &mut Vec<u32>)| {
        let mut sections = sections_of(&bytes);
        let place = |tag: &str| sections.iter().position(|section| section.tag.as_str() == tag).unwrap();
        let (rule, parts) = (place("samp.rul"), place("samp.prt"));
        let (mut rows, mut ends) = (sections[rule].scalars().unwrap(), sections[parts].scalars().unwrap());
        change(&mut rows, &mut ends);
        sections[rule].bytes = rows.iter().flat_map(|x| x.to_le_bytes()).collect();
        sections[parts].bytes = ends.iter().flat_map(|x| x.to_le_bytes()).collect();
        AssetFile::from_bytes(&file(&sections), Budget::default()).map(drop)
    };
    changed(&|_, _| ()).unwrap();
    type Change<'a> = &'a dyn Fn(&mut Vec<u32>, &mut Vec<u32>);
    let refused: [Change<'_>; 8] = [
        &|rule, _| rule[0] = 1,
        &|rule, _| rule[0] = 2,
        &|rule, _| rule[1] ^= 1,
        &|rule, _| rule.extend([0, 0]),
        &|rule, _| rule.clear(),
        &|_, ends| ends[3] = 0,
        &|_, ends| ends[3] += 1,
        &|_, ends| ends[3] = u32::MAX,
    ];
    for (index, change) in refused.into_iter().enumerate() {
        let error = changed(change).unwrap_err();
        let tag = error.tag().map(|tag| tag.to_string());
        assert!(matches!(error, FormatError::Invalid { .. }), "{index}: {error}");
        assert_eq!(tag.as_deref(), Some("samp.rul"), "{index}: {error}");
    }
    // Beside what it stands for.
    let stored = AssetFile { samples_stored: true, ..asset.clone() }.to_bytes().unwrap();
    let mut sections = sections_of(&stored);
    sections.extend(sections_of(&bytes).into_iter().filter(|section| section.tag.as_str() == "samp.rul"));
    let error = AssetFile::from_bytes(&file(&sections), Budget::default()).unwrap_err();
    assert_eq!(error.tag().unwrap().as_str(), "samp.fac", "{error}");
    // Memory is promised before it is taken.
    let small = Budget::bytes(6000);
    let error = AssetFile::from_bytes(&bytes, small).unwrap_err();
    assert!(matches!(error, FormatError::OverBudget { .. }), "{error}");
}
