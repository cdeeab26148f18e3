//! A handmade asset that uses every feature, and a second writer made from the numbers in SPEC.md alone.
#![allow(dead_code, unreachable_pub, clippy::unwrap_used)]

use translux_format::far_field::{FarField, Group, LANES, NO_RECEIVER, Shape, all_functions};
use translux_format::profile_basis::ProfileBasis;
use translux_format::rows::IrradianceRows;
use translux_format::{
    AssetFile, Codec, CornerAttribute, F16Bits, InputRecord, Kind, LedgerEntry, MediumRecord, Mesh, NO_MEDIUM, NO_PART,
    PartRecord, Parts, Provenance, RawSection, Reader, Samples, Tag,
};

pub fn full_mesh() -> Mesh {
    Mesh {
        origin_mm: [1.5, -2.25, 1e3],
        positions_mm: vec![
            [0.0, 0.0, 0.0],
            [4.0, 0.0, 0.0],
            [0.0, 3.0, 0.0],
            [4.0, 0.0, 0.0],
            [0.0, 0.0, 5.0],
            [0.125, -0.5, 7.0],
        ],
        triangles: vec![[0, 2, 1], [0, 3, 4], [4, 2, 0], [5, 4, 1]],
        triangle_material: vec![0, 1, 0, 1],
        materials: vec!["Körper".into(), String::new()],
        weld: vec![0, 1, 2, 1, 4, 5],
        normals: Some(CornerAttribute {
            values: vec![[0.0, 0.0, 1.0], [0.0; 3], [-0.6, 0.8, 0.0]],
            corners: vec![[0, 0, 0], [1, 1, 1], [2, 0, 1], [2, 2, 2]],
        }),
        uvs: Some(CornerAttribute {
            values: vec![[0.0, 1.0], [-0.5, 2.0]],
            corners: vec![[0, 1, 0], [1, 1, 1], [0, 0, 0], [1, 0, 1]],
        }),
    }
}

pub fn full_parts() -> Parts {
    let medium = |name: &str, scale: f64| MediumRecord {
        name: name.into(),
        sigma_s_reduced_per_mm: [2.19 * scale, 2.62 * scale, 3.0],
        sigma_a_per_mm: [0.0021, 0.0041, 0.0],
        g: -0.25,
        eta_inside_over_outside: 1.5,
    };
    let part = |name: &str, opaque, medium| PartRecord { name: name.into(), opaque, medium };
    Parts {
        triangle_part: vec![0, 0, 1, NO_PART],
        parts: vec![part("body", false, 1), part("eyes", false, 0), part("base", true, NO_MEDIUM)],
        media: vec![medium("marble", 1.0), medium("skin1", 0.25)],
    }
}

pub fn full_asset() -> AssetFile {
    AssetFile {
        mesh: full_mesh(),
        parts: full_parts(),
        samples: Samples {
            facets: vec![[0, 0b10], [0, 0b110], [0, 0b111], [1, 1], [2, 1]],
            patch_offsets: vec![0, 1, 4, 5],
            part_offsets: vec![0, 2, 3, 3],
        },
        samples_stored: true,
        provenance: Provenance {
            algorithm_revision: 7,
            method: "two_pass".into(),
            settings: vec![("max-rms".into(), "0.01".into()), ("samples".into(), "3".into())],
            seed: 0x0123_4567_89ab_cdef,
            inputs: vec![InputRecord { name: "model.obj".into(), blake3: [0xa5; 32], bytes: 123_456_789_012 }],
            source_unit: "cm (stated)".into(),
            mm_per_source_unit: 10.0,
            notes: vec!["2 degenerate triangles left out".into()],
        },
        ledger: vec![LedgerEntry {
            stage: "truncation".into(),
            relative_rms: 0.003,
            relative_bias: -0.0004,
            p999: 0.02,
            worst: 0.05,
            dark: 0.4,
            note: "measured on the probe lights".into(),
        }],
        extra: extra_sections(),
    }
}

/// One section of every element type, both codecs, every kind, wide and empty rows.
fn extra_sections() -> Vec<RawSection> {
    let tag = |text: &str| Tag::new(text).unwrap();
    let (raw, zstd, method) = (Codec::Raw, Codec::Zstd, Kind::Method);
    vec![
        RawSection::from_rows(tag("x.u8"), method, raw, &[1u8, 2, 255]),
        RawSection::from_rows(tag("x.i8"), method, zstd, &[[-1i8, 2], [-128, 127]]),
        RawSection::from_rows(tag("x.u16"), method, zstd, &(0..500u16).map(|i| i / 7).collect::<Vec<_>>()),
        RawSection::from_rows(tag("x.i16"), method, raw, &[-32768i16]),
        RawSection::from_rows(tag("x.u32"), method, raw, &[0u32; 0]),
        RawSection::from_rows(tag("x.i32"), Kind::Samples, zstd, &[0i32; 0]),
        RawSection::from_rows(tag("x.u64"), Kind::Metadata, raw, &[[u64::MAX; 4]]),
        RawSection::from_rows(tag("x.i64"), Kind::Mesh, raw, &[i64::MIN]),
        RawSection::from_rows(tag("x.f16"), method, zstd, &[[F16Bits(0x3c00); 3]; 5]),
        RawSection::from_rows(tag("x_F32-.9"), method, raw, &[[1.0f32, -0.0, f32::MIN_POSITIVE, f32::MAX]; 3]),
        RawSection::from_scalars(tag("x.f64"), method, zstd, 300, &[0.5f64; 600]),
        RawSection::from_record(tag("x.rec"), method, zstd, &("k".to_string(), Some(3u8), vec![1.5f32])).unwrap(),
    ]
}

/// Part offsets that [`far_field`] fits: a part without samples, and none of them starts at 0 but the first.
pub const FAR_PARTS: [u32; 4] = [0, 300, 300, 420];

pub fn far_shape() -> Shape<'static> {
    Shape { vertices: 90, part_offsets: &FAR_PARTS }
}

/// Full and part-filled groups, one without coefficients, every size of value, vertices that share a receiver or have none.
pub fn far_field(terms: usize) -> FarField {
    far_field_with(terms, [all_functions(terms); 6])
}

/// The same with groups that lack functions, and a group of each part with rows of some that receivers of it lack.
pub fn uneven_far_field(terms: usize) -> FarField {
    let (all, narrow) = (all_functions(terms), all_functions(terms.div_ceil(2)));
    let wide = all & !narrow;
    let mut field = far_field_with(terms, [narrow, all, all, narrow, narrow, narrow]);
    for (part, receivers, node) in [(0, &[2u32, 40, 13][..], 150), (2, &[37, 60], 400)] {
        field.others.extend(receivers);
        field.nodes.push(node);
        field.masks.push(wide);
        field.wide_masks.push(0);
        field.narrow.extend((0..wide.count_ones()).map(|k| [k as i8 + 1; LANES]));
        let sums = (0..terms).map(|k| if wide >> k & 1 == 1 { 1.5 + k as f32 } else { 0.0 });
        receivers.iter().for_each(|_| field.row_sums.extend(sums.clone()));
        let rows_end = field.rows() as u32 + receivers.len() as u32;
        let coefficients_end = field.nodes.len() as u32;
        field.groups.push(Group { part, rows_end, coefficients_end, functions: wide });
    }
    field
}

fn far_field_with(terms: usize, functions: [u16; 6]) -> FarField {
    let mut random = Random(terms as u64);
    let sizes = [(0, 16, 40), (0, 5, 1), (2, 16, 0), (2, 1, 90), (0, 16, 299), (2, 7, 3)];
    let mut field = FarField { terms, ..Default::default() };
    let (mut receivers, mut lanes_of) = (0, Vec::new());
    for ((part, lanes, count), functions) in sizes.into_iter().zip(functions) {
        receivers += lanes;
        let (first, end) = (FAR_PARTS[part as usize], FAR_PARTS[part as usize + 1]);
        let mut nodes: Vec<u32> = (first + 1..end).collect();
        while nodes.len() > count {
            nodes.swap_remove(random.below(nodes.len()));
        }
        nodes.sort_unstable();
        lanes_of.extend(nodes.iter().map(|_| (lanes as usize, functions)));
        field.nodes.extend(nodes);
        field.groups.push(Group { part, rows_end: receivers, coefficients_end: field.nodes.len() as u32, functions });
    }
    field.receiver_of_vertex =
        (0..90).map(|i| if i % 9 == 8 { NO_RECEIVER } else { (i * 7 + i / 3) % receivers }).collect();
    for receiver in 0..receivers {
        field.receiver_of_vertex[29 + receiver as usize] = receiver;
    }
    field.steps = (0..terms).map(|k| 0.01 * 0.5f32.powi(k as i32)).collect();
    field.row_sums = (0..receivers as usize * terms).map(|i| (i as f32 * 0.1).sin()).collect();
    for (receiver, sums) in field.row_sums.chunks_exact_mut(terms).enumerate() {
        let group = field.groups.iter().find(|group| receiver < group.rows_end as usize).unwrap();
        (0..terms).filter(|k| group.functions >> k & 1 == 0).for_each(|k| sums[k] = 0.0);
    }
    for (lanes, functions) in lanes_of {
        let any = 1 + random.below((1 << terms) - 1) as u16;
        let mask = if any & functions != 0 { any & functions } else { functions & functions.wrapping_neg() };
        field.masks.push(mask);
        let mut wide = 0;
        for k in (0..terms).filter(|k| mask >> k & 1 == 1) {
            let range = if k % 2 == 1 { 1usize << 7 } else { 1 << (15 - k.min(14)) };
            let mut value =
                |lane| if lane < lanes { (random.below(2 * range) as i32 - range as i32) as i16 } else { 0 };
            let row: [i16; LANES] = std::array::from_fn(&mut value);
            match row.map(i8::try_from) {
                narrow if narrow.iter().all(|x| x.is_ok()) => field.narrow.push(narrow.map(|x| x.unwrap())),
                _ => {
                    field.wide.push(row);
                    wide |= 1 << k;
                }
            }
        }
        field.wide_masks.push(wide);
    }
    field
}

pub fn profile_basis(terms: usize) -> ProfileBasis {
    ProfileBasis {
        split_mm: 0.5,
        nodes_mm: vec![0.0, 0.125, 0.5, 2.0, 9.5],
        weights_mm4: vec![0.01, 0.02, 1.0, 8.0, 30.0],
        functions: (0..5 * terms).map(|i| 1.0 / (1 + i) as f32 - 0.25).collect(),
        totals: None,
    }
}

/// A far field that fits [`full_asset`].
pub fn small_far_field() -> FarField {
    let (mut wide, mut narrow) = ([0; LANES], [0; LANES]);
    wide[..3].copy_from_slice(&[-300, 7, 32_767]);
    narrow[..3].copy_from_slice(&[1, 0, -1]);
    FarField {
        terms: 2,
        receiver_of_vertex: vec![0, 1, 2, 1, 3, NO_RECEIVER],
        groups: vec![
            Group { part: 0, rows_end: 3, coefficients_end: 1, functions: 3 },
            Group { part: 1, rows_end: 4, coefficients_end: 1, functions: 3 },
        ],
        nodes: vec![1],
        masks: vec![3],
        wide_masks: vec![1],
        steps: vec![0.5, 0.0625],
        narrow: vec![narrow],
        wide: vec![wide],
        row_sums: vec![1.0, -0.5, 1.25, 0.0, 1.5, 0.25, 3.0, -0.0],
        others: Vec::new(),
    }
}

/// Rows of three patches, as [`full_asset`] has: two with details, one without.
pub fn small_rows() -> IrradianceRows {
    IrradianceRows {
        side: 32,
        terms: 2,
        block: 0,
        offsets: vec![0, 3, 3, 5],
        indices: vec![1, 700, 6143, 2, 1025],
        values: vec![127, -5, 3, 0, 2, -127, 9, 1, -1, 0],
        steps: vec![0.5, 0.0, 1e-3],
        scaling: (0..36).map(|i| i * 1800 - 32_767).collect(),
        scaling_steps: vec![1e-4, 2e-4, 0.0],
        functions: vec![
            [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            [-0.75, 1.0, 0.0, -0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        ],
    }
}

/// [`full_asset`] as files of 0.0 and 0.1 hold it: without dark errors.
pub fn full_asset_0_0() -> AssetFile {
    let mut asset = full_asset();
    asset.ledger.iter_mut().for_each(|entry| entry.dark = 0.0);
    asset
}

/// [`full_asset_0_0`] with what version 0.1 added: a far field, a basis, irradiance rows.
pub fn full_asset_0_1() -> AssetFile {
    with_0_1(full_asset_0_0())
}

/// The same with what version 0.2 added: dark errors, and records of the form.
pub fn full_asset_0_2() -> AssetFile {
    use translux_format::metadata::tags;
    let mut asset = with_0_1(full_asset());
    let record = |tag, value: &(&str, u32)| RawSection::from_record(tag, Kind::Metadata, Codec::Zstd, value).unwrap();
    asset.extra.push(record(tags::FORM, &("factored", 0)));
    asset.extra.push(record(tags::SETTINGS, &("settings", 7)));
    asset
}

fn with_0_1(mut asset: AssetFile) -> AssetFile {
    asset.provenance.method = "editable".into();
    let shape = Shape::new(asset.mesh.positions_mm.len(), &asset.samples);
    asset.extra.extend(small_far_field().to_sections(&shape).unwrap());
    asset.extra.extend(profile_basis(2).to_sections().unwrap());
    asset.extra.extend(small_rows().to_sections().unwrap());
    asset
}

/// Every section of a file as its decoded bytes.
pub fn sections_of(file: &[u8]) -> Vec<RawSection> {
    let reader = Reader::parse(file, Default::default()).unwrap();
    let section = |info: &translux_format::SectionInfo| RawSection {
        tag: info.tag,
        kind: info.kind,
        element: info.element,
        components: info.components,
        codec: info.codec,
        bytes: reader.bytes(info.tag).unwrap().into_owned(),
    };
    reader.sections().iter().map(section).collect()
}

/// One section as the directory has it, any field free to be wrong.
pub struct Entry {
    pub head: [u8; 16],
    pub decoded: u64,
    pub stored: Vec<u8>,
}

impl Entry {
    pub fn raw(section: &RawSection) -> Self {
        let mut head = [0; 16];
        head[0..8].copy_from_slice(&section.tag.to_bytes());
        head[8] = section.element.code();
        head[10..12].copy_from_slice(&section.components.to_le_bytes());
        head[12] = section.kind.code();
        Self { head, decoded: section.bytes.len() as u64, stored: section.bytes.clone() }
    }

    pub fn zstd(tag: &str, element: u8, components: u16, kind: u8, decoded: u64, stored: Vec<u8>) -> Self {
        let mut head = [0; 16];
        head[..tag.len()].copy_from_slice(tag.as_bytes());
        head[8..13].copy_from_slice(&[element, 1, components as u8, (components >> 8) as u8, kind]);
        Self { head, decoded, stored }
    }
}

/// A file with these sections, laid out as SPEC.md says.
pub fn build(entries: &[Entry]) -> Vec<u8> {
    let mut file = b"\x89TLUX\r\n\x1a\0\0\0\0".to_vec();
    file.extend((entries.len() as u32).to_le_bytes());
    file.resize(32 + 48 * entries.len(), 0);
    for (i, entry) in entries.iter().enumerate() {
        file.resize(file.len().div_ceil(64) * 64, 0);
        let (at, offset) = (32 + 48 * i, file.len() as u64);
        file[at..at + 16].copy_from_slice(&entry.head);
        file[at + 16..at + 24].copy_from_slice(&offset.to_le_bytes());
        file[at + 24..at + 32].copy_from_slice(&(entry.stored.len() as u64).to_le_bytes());
        file[at + 32..at + 40].copy_from_slice(&entry.decoded.to_le_bytes());
        file.extend(&entry.stored);
    }
    let length = file.len() as u64;
    file[16..24].copy_from_slice(&length.to_le_bytes());
    seal(&mut file);
    file
}

/// Makes every checksum right again, as far as the directory still makes sense.
pub fn seal(file: &mut [u8]) {
    if file.len() < 32 {
        return;
    }
    let count = (u32_at(file, 12) as usize).min((file.len() - 32) / 48);
    for i in 0..count {
        let at = 32 + 48 * i;
        let (start, length) = (u64_at(file, at + 16), u64_at(file, at + 24));
        let stored = start.checked_add(length).and_then(|end| file.get(start as usize..end as usize));
        if let Some(crc) = stored.map(crc32) {
            file[at + 40..at + 44].copy_from_slice(&crc.to_le_bytes());
        }
    }
    file[24..28].fill(0);
    let crc = crc32(&file[..32 + 48 * count]);
    file[24..28].copy_from_slice(&crc.to_le_bytes());
}

pub fn u16_at(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes(bytes[at..at + 2].try_into().unwrap())
}

pub fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
}

pub fn u64_at(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap())
}

pub fn f64_at(bytes: &[u8], at: usize) -> f64 {
    f64::from_bits(u64_at(bytes, at))
}

/// The CRC-32 of SPEC.md, bit by bit.
pub fn crc32(bytes: &[u8]) -> u32 {
    let mut crc = !0u32;
    for byte in bytes {
        crc ^= u32::from(*byte);
        for _ in 0..8 {
            crc = if crc & 1 == 1 { (crc >> 1) ^ 0xedb8_8320 } else { crc >> 1 };
        }
    }
    !crc
}

/// SplitMix64 with a fixed seed.
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    pub fn below(&mut self, limit: usize) -> usize {
        if limit == 0 { 0 } else { (self.next() % limit as u64) as usize }
    }
}

/// Changes a few bytes, or copies, removes or repeats some.
pub fn mutate(random: &mut Random, bytes: &mut Vec<u8>) {
    for _ in 0..=random.below(6) {
        let (at, length) = (random.below(bytes.len()), random.below(9));
        match random.below(8) {
            0 => drop(bytes.drain(at..(at + length).min(bytes.len()))),
            1 => {
                let again = bytes[at..(at + length).min(bytes.len())].to_vec();
                bytes.splice(at..at, again);
            }
            2 if at < bytes.len() => bytes[at] = [0, 1, 0x7f, 0x80, 0xff][random.below(5)],
            3 => {
                let word = [0, 1, u64::MAX, 1 << 31, 1 << 40, f64::NAN.to_bits()][random.below(6)];
                bytes.iter_mut().skip(at).zip(word.to_le_bytes()).for_each(|(byte, new)| *byte = new);
            }
            _ if at < bytes.len() => bytes[at] ^= 1 << random.below(8),
            _ => {}
        }
    }
}
