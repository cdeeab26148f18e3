//! Reads the frozen file with nothing but the numbers in SPEC.md (and a zstd decoder).
#![allow(clippy::unwrap_used)]

mod common;

use common::{crc32, f64_at, full_asset, u16_at, u32_at, u64_at};

const GOLDEN: &[u8] = include_bytes!("data/v0_0_full.tlux");

struct Section {
    tag: String,
    element: u8,
    components: u16,
    kind: u8,
    bytes: Vec<u8>,
}

fn read_by_hand(file: &[u8]) -> Vec<Section> {
    assert_eq!(file[..8], [0x89, 0x54, 0x4c, 0x55, 0x58, 0x0d, 0x0a, 0x1a]);
    assert_eq!((u16_at(file, 8), u16_at(file, 10)), (0, 0));
    let count = u32_at(file, 12) as usize;
    assert_eq!(u64_at(file, 16) as usize, file.len());
    let mut head = file[..32 + 48 * count].to_vec();
    head[24..28].fill(0);
    assert_eq!(u32_at(file, 24), crc32(&head));
    assert_eq!(u32_at(file, 28), 0);
    let mut end = head.len();
    let mut sections = Vec::new();
    for i in 0..count {
        let entry = &file[32 + 48 * i..32 + 48 * (i + 1)];
        let (offset, stored_length, length) =
            (u64_at(entry, 16) as usize, u64_at(entry, 24) as usize, u64_at(entry, 32));
        assert_eq!(offset, end.div_ceil(64) * 64);
        assert!(file[end..offset].iter().all(|&byte| byte == 0));
        end = offset + stored_length;
        let stored = &file[offset..end];
        assert_eq!(u32_at(entry, 40), crc32(stored));
        let bytes = match entry[9] {
            0 => stored.to_vec(),
            1 => zstd::bulk::decompress(stored, length as usize).unwrap(),
            codec => panic!("codec {codec}"),
        };
        assert_eq!(bytes.len() as u64, length);
        let tag = String::from_utf8(entry[..8].to_vec()).unwrap().trim_end_matches('\0').to_string();
        sections.push(Section { tag, element: entry[8], components: u16_at(entry, 10), kind: entry[12], bytes });
    }
    assert_eq!(end, file.len());
    sections
}

#[test]
fn the_crc_is_the_one_that_the_specification_names() {
    assert_eq!(crc32(b"123456789"), 0xcbf4_3926);
}

#[test]
fn arrays_lie_where_the_specification_says() {
    let (sections, asset) = (read_by_hand(GOLDEN), full_asset());
    let find = |tag: &str, element: u8, components: u16, kind: u8| {
        let section = sections.iter().find(|section| section.tag == tag).unwrap();
        assert_eq!((section.element, section.components, section.kind), (element, components, kind), "{tag}");
        &section.bytes
    };
    let u32s = |bytes: &[u8]| bytes.chunks_exact(4).map(|b| u32_at(b, 0)).collect::<Vec<_>>();
    let f32s = |bytes: &[u8]| u32s(bytes).into_iter().map(f32::from_bits).collect::<Vec<_>>();
    let origin = find("mesh.org", 11, 3, 0);
    assert_eq!([f64_at(origin, 0), f64_at(origin, 8), f64_at(origin, 16)], asset.mesh.origin_mm);
    assert_eq!(f32s(find("mesh.pos", 10, 3, 0)), asset.mesh.positions_mm.as_flattened());
    assert_eq!(u32s(find("mesh.tri", 5, 3, 0)), asset.mesh.triangles.as_flattened());
    let (normals, uvs) = (asset.mesh.normals.unwrap(), asset.mesh.uvs.unwrap());
    assert_eq!(f32s(find("mesh.nrm", 10, 3, 0)), normals.values.as_flattened());
    assert_eq!(u32s(find("mesh.nri", 5, 3, 0)), normals.corners.as_flattened());
    assert_eq!(f32s(find("mesh.uv", 10, 2, 0)), uvs.values.as_flattened());
    assert_eq!(u32s(find("mesh.uvi", 5, 3, 0)), uvs.corners.as_flattened());
    assert_eq!(u32s(find("mesh.mat", 5, 1, 3)), asset.mesh.triangle_material);
    let weld: Vec<u32> = (0..).zip(u32s(find("mesh.wld", 5, 1, 3))).map(|(i, back): (u32, u32)| i - back).collect();
    assert_eq!(weld, asset.mesh.weld);
    assert_eq!(u32s(find("part.tri", 5, 1, 3)), asset.parts.triangle_part);
    assert_eq!(u32s(find("samp.fac", 5, 2, 1)), asset.samples.facets.as_flattened());
    assert_eq!(u32s(find("samp.off", 5, 1, 1)), asset.samples.patch_offsets);
    assert_eq!(u32s(find("samp.prt", 5, 1, 1)), asset.samples.part_offsets);
    assert_eq!(f32s(find("x_F32-.9", 10, 4, 2))[..4], [1.0, -0.0, f32::MIN_POSITIVE, f32::MAX]);
}

/// Takes fields off the front of a record.
struct Fields<'a>(&'a [u8]);

impl<'a> Fields<'a> {
    fn take(&mut self, length: usize) -> &'a [u8] {
        let (front, rest) = self.0.split_at(length);
        self.0 = rest;
        front
    }
    fn u8(&mut self) -> u8 {
        self.take(1)[0]
    }
    fn u32(&mut self) -> u32 {
        u32_at(self.take(4), 0)
    }
    fn u64(&mut self) -> u64 {
        u64_at(self.take(8), 0)
    }
    fn f64(&mut self) -> f64 {
        f64_at(self.take(8), 0)
    }
    fn text(&mut self) -> &'a str {
        let length = self.u64() as usize;
        std::str::from_utf8(self.take(length)).unwrap()
    }
}

#[test]
fn records_read_field_by_field() {
    let (sections, asset) = (read_by_hand(GOLDEN), full_asset());
    let record = |tag: &str| {
        let section = sections.iter().find(|section| section.tag == tag).unwrap();
        assert_eq!((section.element, section.components, section.kind), (0, 1, 3), "{tag}");
        Fields(&section.bytes)
    };
    let mut names = record("mesh.mtn");
    assert_eq!((names.u64(), names.text(), names.text(), names.0.len()), (2, "Körper", "", 0));
    let mut parts = record("part.rec");
    assert_eq!(parts.u64(), 3);
    for part in &asset.parts.parts {
        assert_eq!((parts.text(), parts.u8() == 1, parts.u32()), (part.name.as_str(), part.opaque, part.medium));
    }
    let mut media = record("part.med");
    assert_eq!(media.u64(), 2);
    for medium in &asset.parts.media {
        assert_eq!(media.text(), medium.name);
        let numbers: Vec<f64> = (0..8).map(|_| media.f64()).collect();
        assert_eq!(numbers[0..3], medium.sigma_s_reduced_per_mm);
        assert_eq!(numbers[3..6], medium.sigma_a_per_mm);
        assert_eq!(numbers[6..8], [medium.g, medium.eta_inside_over_outside]);
    }
    let (mut source, provenance) = (record("meta.src"), &asset.provenance);
    assert_eq!((source.u32(), source.text()), (7, "two_pass"));
    let settings = (source.u64(), source.text(), source.text(), source.text(), source.text());
    assert_eq!(settings, (2, "max-rms", "0.01", "samples", "3"));
    assert_eq!(source.u64(), 0x0123_4567_89ab_cdef);
    assert_eq!((source.u64(), source.text(), source.take(32)), (1, "model.obj", [0xa5; 32].as_slice()));
    assert_eq!((source.u64(), source.text(), source.f64()), (123_456_789_012, "cm (stated)", 10.0));
    assert_eq!((source.u64(), source.text()), (1, provenance.notes[0].as_str()));
    let (mut ledger, entry) = (record("meta.err"), &asset.ledger[0]);
    assert_eq!((ledger.u64(), ledger.text()), (1, "truncation"));
    let numbers = [ledger.f64(), ledger.f64(), ledger.f64(), ledger.f64()];
    assert_eq!(numbers, [entry.relative_rms, entry.relative_bias, entry.p999, entry.worst]);
    assert_eq!(ledger.text(), entry.note);
    for fields in [names, parts, media, source, ledger] {
        assert!(fields.0.is_empty());
    }
}
