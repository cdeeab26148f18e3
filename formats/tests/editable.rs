//! The far field and the profile basis: what is written is read, and every rule about their content is checked both ways.
#![allow(clippy::unwrap_used)]

mod common;

use common::{Random, far_field, far_shape, full_asset_0_1, profile_basis, small_far_field, uneven_far_field};
use translux_format::far_field::{self, FarField, LANES, NO_RECEIVER, Shape};
use translux_format::profile_basis::{self, ProfileBasis};
use translux_format::{AssetFile, Budget, FormatError, Kind, RawSection, Tag};

fn read(sections: &[RawSection]) -> Result<Option<FarField>, FormatError> {
    FarField::from_sections(sections, &far_shape())
}

#[test]
fn a_far_field_survives() {
    for terms in [1, 2, 10, 16] {
        let field = far_field(terms);
        let sections = field.to_sections(&far_shape()).unwrap();
        assert_eq!(sections.iter().map(|s| s.tag).collect::<Vec<_>>(), far_field::tags::ALL);
        assert_eq!(read(&sections).unwrap().unwrap(), field);
        assert_eq!(field.to_sections(&far_shape()).unwrap(), sections);
    }
    for terms in [2, 10, 16] {
        let field = uneven_far_field(terms);
        let sections = field.to_sections(&far_shape()).unwrap();
        let tags = [far_field::tags::FUNCTIONS, far_field::tags::ROWS];
        assert_eq!(sections[9..].iter().map(|s| s.tag).collect::<Vec<_>>(), tags);
        assert_eq!(read(&sections).unwrap().unwrap(), field);
        let coded = field.to_coded_sections(&far_shape()).unwrap();
        assert_eq!(read(&coded).unwrap().unwrap(), field);
        for tag in tags {
            let without: Vec<_> = coded.iter().filter(|s| s.tag != tag).cloned().collect();
            assert!(read(&without).is_err(), "{tag}");
        }
    }
    let nothing =
        FarField { terms: 1, receiver_of_vertex: vec![NO_RECEIVER; 90], steps: vec![1.0], ..Default::default() };
    assert_eq!(read(&nothing.to_sections(&far_shape()).unwrap()).unwrap().unwrap(), nothing);
}

#[test]
fn a_basis_survives() {
    for terms in [1, 3, 10] {
        let basis = profile_basis(terms);
        assert_eq!(basis.terms(), terms);
        let sections = basis.to_sections().unwrap();
        assert_eq!(ProfileBasis::from_sections(&sections).unwrap().unwrap(), basis);
    }
}

#[test]
fn they_survive_in_a_file_among_other_sections() {
    let bytes = full_asset_0_1().to_bytes().unwrap();
    let asset = AssetFile::from_bytes(&bytes, Budget::default()).unwrap();
    let shape = Shape::new(asset.mesh.positions_mm.len(), &asset.samples);
    assert_eq!(FarField::from_sections(&asset.extra, &shape).unwrap().unwrap(), small_far_field());
    assert_eq!(ProfileBasis::from_sections(&asset.extra).unwrap().unwrap(), profile_basis(2));
}

#[test]
fn all_of_their_sections_or_none() {
    assert_eq!(read(&[]).unwrap(), None);
    assert_eq!(ProfileBasis::from_sections(&far_field(2).to_sections(&far_shape()).unwrap()).unwrap(), None);
    for tag in far_field::tags::ALL {
        let mut sections = far_field(2).to_sections(&far_shape()).unwrap();
        sections.retain(|section| section.tag != tag);
        assert_eq!(read(&sections).unwrap_err(), FormatError::MissingSection { tag });
    }
    for tag in profile_basis::tags::ALL {
        let mut sections = profile_basis(2).to_sections().unwrap();
        sections.retain(|section| section.tag != tag);
        assert_eq!(ProfileBasis::from_sections(&sections).unwrap_err(), FormatError::MissingSection { tag });
    }
}

type Break<T> = (&'static str, &'static str, fn(&mut T));

#[test]
fn a_broken_far_field_is_not_written() {
    let rules: [Break<FarField>; 44] = [
        ("no vertex", "far.rcv", |f| f.receiver_of_vertex.clear()),
        ("one vertex more", "far.rcv", |f| f.receiver_of_vertex.push(0)),
        ("receiver beyond", "far.rcv", |f| f.receiver_of_vertex[0] = 61),
        ("receiver without a vertex", "far.rcv", |f| {
            f.receiver_of_vertex.iter_mut().filter(|r| **r == 60).for_each(|r| *r = NO_RECEIVER);
        }),
        ("part without samples", "far.grp", |f| f.groups[2].part = 1),
        ("part beyond", "far.grp", |f| f.groups[0].part = 3),
        ("part far beyond", "far.grp", |f| f.groups[0].part = u32::MAX),
        ("no receivers", "far.grp", |f| f.groups[1].rows_end = 16),
        ("descending receivers", "far.grp", |f| f.groups[1].rows_end = 3),
        ("17 receivers", "far.grp", |f| f.groups[0].rows_end = 17),
        ("descending coefficients", "far.grp", |f| f.groups[1].coefficients_end = 39),
        ("a group less", "far.rcv", |f| _ = f.groups.pop()),
        ("a node less", "far.nod", |f| _ = f.nodes.pop()),
        ("a node more", "far.nod", |f| f.nodes.push(419)),
        ("node at the first sample", "far.nod", |f| f.nodes[0] = 0),
        ("node at the end", "far.nod", |f| f.nodes[39] = 300),
        ("node twice", "far.nod", |f| f.nodes[8] = f.nodes[7]),
        ("order", "far.nod", |f| f.nodes.swap(3, 4)),
        ("node of another part", "far.nod", |f| f.nodes[41] = 299),
        ("a mask less", "far.msk", |f| _ = f.masks.pop()),
        ("empty mask", "far.msk", |f| f.masks[5] = 0),
        ("a function beyond", "far.msk", |f| f.masks[5] = 4),
        ("17 functions", "far.stp", |f| {
            f.terms = 17;
            f.steps = vec![1.0; 17];
            f.row_sums = vec![0.0; 61 * 17];
        }),
        ("no functions", "far.stp", |f| f.steps.clear()),
        ("one function more", "far.stp", |f| f.steps.push(1.0)),
        ("step", "far.stp", |f| f.steps[1] = 0.0),
        ("step", "far.stp", |f| f.steps[1] = f32::NAN),
        ("largest multiple", "far.stp", |f| f.steps[0] = 1.1e34),
        ("a sum less", "far.sum", |f| _ = f.row_sums.pop()),
        ("sum", "far.sum", |f| f.row_sums[7] = f32::NEG_INFINITY),
        ("a wide mask less", "far.wid", |f| _ = f.wide_masks.pop()),
        ("wide, but not kept", "far.wid", |f| {
            let i = f.masks.iter().position(|&mask| mask == 1).unwrap();
            f.wide_masks[i] = 2;
        }),
        ("a row more", "far.val", |f| f.narrow.push([0; LANES])),
        ("a wide row more", "far.big", |f| f.wide.push([0; LANES])),
        ("a group without functions", "far.fun", |f| f.groups[0].functions = 0),
        ("a group's function beyond", "far.fun", |f| f.groups[1].functions = 4),
        ("no group of a part with a function", "far.fun", |f| {
            *f = uneven_far_field(2);
            f.groups[2].functions = 1;
            f.row_sums[42..74].chunks_exact_mut(2).for_each(|sums| sums[1] = 0.0);
            f.groups.pop();
            f.others.truncate(3);
            f.nodes.pop();
            f.masks.pop();
            f.wide_masks.pop();
            f.narrow.pop();
            f.row_sums.truncate(2 * 64);
        }),
        ("a row of no receiver", "far.row", |f| {
            *f = uneven_far_field(2);
            f.others[0] = 61;
        }),
        ("rows that end in a group", "far.row", |f| {
            *f = uneven_far_field(2);
            f.others.pop();
        }),
        ("a row of another part", "far.row", |f| {
            *f = uneven_far_field(2);
            f.others[0] = 55;
        }),
        ("a row of a function that its receiver has", "far.row", |f| {
            *f = uneven_far_field(2);
            f.others[0] = 16;
        }),
        ("two rows of one function", "far.row", |f| {
            *f = uneven_far_field(2);
            f.others[1] = 2;
        }),
        ("a coefficient of a function that a group has not", "far.msk", |f| f.groups[0].functions = 2),
        ("a sum of a function that a group has not", "far.sum", |f| {
            *f = uneven_far_field(2);
            f.row_sums[1] = 1e-9;
        }),
    ];
    for (what, tag, break_rule) in rules {
        let mut field = far_field(2);
        break_rule(&mut field);
        let error = field.to_sections(&far_shape()).unwrap_err();
        assert_eq!((error.code(), error.tag().unwrap().as_str()), (21, tag), "{what}: {error}");
    }
}

#[test]
fn a_broken_basis_is_not_written() {
    let rules: [Break<ProfileBasis>; 14] = [
        ("split", "bas.rec", |b| b.split_mm = -0.5),
        ("split", "bas.rec", |b| b.split_mm = f64::NAN),
        ("no nodes", "bas.nod", |b| b.nodes_mm.clear()),
        ("node", "bas.nod", |b| b.nodes_mm[4] = f64::INFINITY),
        ("node", "bas.nod", |b| b.nodes_mm[0] = -1e-9),
        ("node twice", "bas.nod", |b| b.nodes_mm[1] = 0.0),
        ("a node more", "bas.wgt", |b| b.nodes_mm.push(10.0)),
        ("a weight less", "bas.wgt", |b| _ = b.weights_mm4.pop()),
        ("weight", "bas.wgt", |b| b.weights_mm4[2] = f64::NAN),
        ("weight", "bas.wgt", |b| b.weights_mm4[2] = f64::NEG_INFINITY),
        ("no functions", "bas.fun", |b| b.functions.clear()),
        ("a value less", "bas.fun", |b| _ = b.functions.pop()),
        ("value", "bas.fun", |b| b.functions[3] = f32::NAN),
        ("value", "bas.fun", |b| b.functions[0] = f32::INFINITY),
    ];
    for (what, tag, break_rule) in rules {
        let mut basis = profile_basis(2);
        break_rule(&mut basis);
        let error = basis.to_sections().unwrap_err();
        assert_eq!((error.code(), error.tag().unwrap().as_str()), (21, tag), "{what}: {error}");
    }
}

/// Changes one section of a far field and a basis of two functions; the error of reading them.
fn broken(tag: &str, change: impl Fn(&mut RawSection)) -> FormatError {
    let mut sections = far_field(2).to_sections(&far_shape()).unwrap();
    sections.extend(profile_basis(2).to_sections().unwrap());
    let section = sections.iter_mut().find(|section| section.tag.as_str() == tag).unwrap();
    change(section);
    read(&sections).and_then(|_| ProfileBasis::from_sections(&sections)).unwrap_err()
}

#[test]
fn reading_checks_what_only_bytes_can_break() {
    for tag in far_field::tags::ALL.iter().chain(&profile_basis::tags::ALL).map(Tag::as_str) {
        assert_eq!(broken(tag, |s| s.kind = Kind::Mesh).code(), 21, "{tag}");
        assert_eq!(broken(tag, |s| s.components = 7).code(), 19, "{tag}");
        assert_eq!(broken(tag, |s| s.element = translux_format::ElementType::I64).code(), 19, "{tag}");
        let cut = broken(tag, |s| s.bytes.clear()).code();
        assert_eq!(cut, if tag == "bas.rec" { 20 } else { 21 }, "{tag}");
        let odd = broken(tag, |s| _ = s.bytes.pop()).code();
        assert!([13, 20, 21].contains(&odd), "{tag}: {odd}");
        let more = broken(tag, |s| s.bytes.push(0)).code();
        assert!([13, 20, 21].contains(&more), "{tag}: {more}");
    }
    // The first node of the first group in six bytes, in two where one is enough, and beyond u32.
    for front in [&[0x80, 0x80, 0x80, 0x80, 0x80, 0][..], &[0x80, 0], &[0xff, 0xff, 0xff, 0xff, 0x0f]] {
        let error = broken("far.nod", |s| _ = s.bytes.splice(0..1, front.iter().copied()));
        assert_eq!((error.code(), error.tag().unwrap().as_str()), (21, "far.nod"));
    }
    let huge = broken("far.grp", |s| s.bytes[8..12].copy_from_slice(&u32::MAX.to_le_bytes()));
    assert_eq!((huge.code(), huge.tag().unwrap().as_str()), (21, "far.grp"));
}

/// A far field that fits one asset does not fit another.
#[test]
fn the_shape_is_checked() {
    let sections = far_field(2).to_sections(&far_shape()).unwrap();
    let code = |vertices, part_offsets: &[u32]| {
        FarField::from_sections(&sections, &Shape { vertices, part_offsets }).map(drop).map_err(|e| e.code())
    };
    assert_eq!(code(90, &[0, 300, 300, 420]), Ok(()));
    for (vertices, offsets) in
        [(89, &[0, 300, 300, 420][..]), (90, &[0, 299, 299, 420]), (90, &[0, 300, 300]), (90, &[]), (90, &[0])]
    {
        assert_eq!(code(vertices, offsets), Err(21), "{vertices} {offsets:?}");
    }
}

/// Whatever the bytes of the sections, the answer is an error or a far field that writes and reads back equal.
#[test]
fn twenty_thousand_mutations_of_the_sections() {
    let goods = [far_field(3), uneven_far_field(3)]
        .map(|far| [far.to_sections(&far_shape()).unwrap(), profile_basis(3).to_sections().unwrap()].concat());
    let mut random = Random(7);
    let (mut refused, mut accepted) = (0, 0);
    for i in 0..20_000 {
        let mut sections = goods[i % 2].clone();
        for _ in 0..=random.below(2) {
            let count = sections.len();
            let bytes = &mut sections[random.below(count)].bytes;
            common::mutate(&mut random, bytes);
        }
        match read(&sections) {
            Ok(field) => {
                let field = field.unwrap();
                accepted += 1;
                assert_eq!(read(&field.to_sections(&far_shape()).unwrap()).unwrap().unwrap(), field);
            }
            Err(error) => {
                refused += 1;
                assert!([13, 20, 21].contains(&error.code()), "{error}");
            }
        }
        if let Ok(basis) = ProfileBasis::from_sections(&sections) {
            let basis = basis.unwrap();
            assert_eq!(ProfileBasis::from_sections(&basis.to_sections().unwrap()).unwrap().unwrap(), basis);
        }
    }
    assert!(refused > 5000 && accepted > 500, "{refused} refused, {accepted} accepted");
}

#[test]
fn a_coded_far_field_is_the_plain_one() {
    for terms in [1, 2, 10, 16] {
        let field = far_field(terms);
        let sections = field.to_coded_sections(&far_shape()).unwrap();
        let tags: Vec<&str> = sections.iter().map(|s| s.tag.as_str()).collect();
        assert_eq!(tags, ["far.rcv", "far.grp", "far.stp", "far.sum", "far.cod"]);
        assert_eq!(read(&sections).unwrap().unwrap(), field);
        for section in &sections {
            let tag = section.tag;
            let rest: Vec<RawSection> = sections.iter().filter(|s| s.tag != tag).cloned().collect();
            let error = read(&rest).unwrap_err();
            // Without the coded section it is a plain one, of which others are missing.
            let missing = if tag == far_field::tags::CODED { far_field::tags::NODES } else { tag };
            assert_eq!(error, FormatError::MissingSection { tag: missing });
        }
        let needed = 16 * (field.narrow.len() + field.wide.len()) as u64;
        let small = FarField::from_sections_within(&sections, &far_shape(), Budget::bytes(needed)).unwrap_err();
        assert_eq!(small.code(), 14, "{small}");
    }
    let nothing =
        FarField { terms: 1, receiver_of_vertex: vec![NO_RECEIVER; 90], steps: vec![1.0], ..Default::default() };
    assert_eq!(read(&nothing.to_coded_sections(&far_shape()).unwrap()).unwrap().unwrap(), nothing);
    let mut twice = far_field(2).to_coded_sections(&far_shape()).unwrap();
    twice.extend(far_field(2).to_sections(&far_shape()).unwrap().into_iter().filter(|s| s.tag.as_str() == "far.msk"));
    assert_eq!(read(&twice).unwrap_err().tag().unwrap().as_str(), "far.cod");
    let mut wasteful = far_field(1);
    wasteful.wide[0] = [5; LANES];
    assert_eq!(wasteful.to_coded_sections(&far_shape()).unwrap_err().tag().unwrap().as_str(), "far.big");
}

/// Whatever the bytes, the answer is an error or a far field that is coded as the same bytes.
#[test]
fn damaged_coded_far_fields_are_refused() {
    let good = far_field(3).to_coded_sections(&far_shape()).unwrap();
    let index = good.iter().position(|s| s.tag == far_field::tags::CODED).unwrap();
    let read = |sections: &[RawSection]| FarField::from_sections_within(sections, &far_shape(), Budget::bytes(1 << 20));
    let accepted = |change: &dyn Fn(&mut Vec<u8>)| {
        let mut sections = good.clone();
        change(&mut sections[index].bytes);
        match read(&sections) {
            Ok(field) => {
                let again = field.unwrap().to_coded_sections(&far_shape()).unwrap();
                assert!(again[index].bytes == sections[index].bytes);
                true
            }
            Err(error) => {
                assert!([14, 21].contains(&error.code()), "{error}");
                false
            }
        }
    };
    let length = good[index].bytes.len();
    assert!(accepted(&|_| ()) && !accepted(&|bytes| bytes.push(0)));
    let mut others = 0;
    // All of the head, and some hundred places of the streams: each try decodes everything.
    for at in (0..64.min(length)).chain((64..length).step_by(length.div_ceil(300))) {
        assert!(!accepted(&|bytes| bytes.truncate(at)), "cut at {at}");
        others += (0..8).filter(|bit| accepted(&|bytes| bytes[at] ^= 1 << bit)).count();
    }
    // At the start of a stream, where the interval may still be a power of two, a bit can be a plain one of a value and of nothing
    // else. The checksums of the file know better.
    assert!(others <= 16, "{others} bits of {length} bytes");
    let mut random = Random(11);
    for _ in 0..2000 {
        let mut sections = good.clone();
        for _ in 0..=random.below(2) {
            let bytes = &mut sections[random.below(good.len())].bytes;
            common::mutate(&mut random, bytes);
        }
        if let Ok(field) = read(&sections) {
            let field = field.unwrap();
            assert!(read(&field.to_coded_sections(&far_shape()).unwrap()).unwrap().unwrap() == field);
        }
    }
}

#[test]
fn totals_of_a_basis_survive_and_are_checked() {
    let basis = ProfileBasis { totals: Some(vec![1.0, 0.5, 1e-3]), ..profile_basis(3) };
    let sections = basis.to_sections().unwrap();
    assert_eq!(sections.last().unwrap().tag, profile_basis::tags::TOTALS);
    assert_eq!(ProfileBasis::from_sections(&sections).unwrap().unwrap(), basis);
    for totals in [vec![], vec![1.0; 2], vec![1.0; 4], vec![1.0, 0.0, 1.0], vec![1.0, f64::NAN, 1.0], vec![-1.0; 3]] {
        let error = ProfileBasis { totals: Some(totals), ..profile_basis(3) }.to_sections().unwrap_err();
        assert_eq!((error.code(), error.tag().unwrap().as_str()), (21, "bas.tot"));
    }
}
