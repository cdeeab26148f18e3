//! Reads the frozen file with nothing but the numbers in SPEC.md and its parts (and a zstd decoder).
#![allow(clippy::unwrap_used)]

mod common;

use common::{crc32, f64_at, full_asset, full_asset_0_1, u16_at, u32_at, u64_at};
use translux_format::far_field::{FarField, Group, NO_RECEIVER, Shape, over_lanes};
use translux_format::profile_basis::ProfileBasis;
use translux_format::rows::IrradianceRows;
use translux_format::{AssetFile, Mesh, PartRecord, Parts, Samples};

const GOLDEN_0_0: &[u8] = include_bytes!("data/v0_0_full.tlux");
const GOLDEN: &[u8] = include_bytes!("data/v0_2_full.tlux");
/// The parts whose examples are checked word by word.
const FACTORED: &str = include_str!("../spec/factored.md");
const ENVIRONMENT_ROWS: &str = include_str!("../spec/environment_rows.md");

struct Section {
    tag: String,
    element: u8,
    components: u16,
    kind: u8,
    bytes: Vec<u8>,
}

fn read_by_hand(file: &[u8]) -> Vec<Section> {
    assert_eq!(file[..8], [0x89, 0x54, 0x4c, 0x55, 0x58, 0x0d, 0x0a, 0x1a]);
    assert!(u16_at(file, 8) == 0 && u16_at(file, 10) <= 2);
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
    for golden in [GOLDEN_0_0, GOLDEN] {
        arrays_of(golden);
    }
}

fn arrays_of(golden: &[u8]) {
    let (sections, asset) = (read_by_hand(golden), full_asset());
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
    let (sections, asset) = (read_by_hand(GOLDEN_0_0), full_asset());
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
    let numbers: [f64; 4] = std::array::from_fn(|_| ledger.f64());
    assert_eq!(numbers, [entry.relative_rms, entry.relative_bias, entry.p999, entry.worst]);
    let sections_0_2 = read_by_hand(GOLDEN);
    let dark = sections_0_2.iter().find(|section| section.tag == "meta.drk").unwrap();
    assert_eq!((dark.element, dark.components, dark.kind), (11, 1, 3));
    assert_eq!((dark.bytes.len(), f64_at(&dark.bytes, 0)), (8, entry.dark));
    assert_eq!(ledger.text(), entry.note);
    for fields in [names, parts, media, source, ledger] {
        assert!(fields.0.is_empty());
    }
}

fn find<'a>(sections: &'a [Section], tag: &str, element: u8, components: u16) -> &'a [u8] {
    let section = sections.iter().find(|section| section.tag == tag).unwrap();
    assert_eq!((section.element, section.components, section.kind), (element, components, 2), "{tag}");
    &section.bytes
}

fn u32s(bytes: &[u8]) -> Vec<u32> {
    bytes.chunks_exact(4).map(|b| u32_at(b, 0)).collect()
}

fn f64s(bytes: &[u8]) -> Vec<f64> {
    bytes.chunks_exact(8).map(|b| f64_at(b, 0)).collect()
}

/// The far field and the basis, read as the page says.
struct ByHand {
    receiver_of_vertex: Vec<u32>,
    groups: Vec<[u32; 3]>,
    /// Bits of each group.
    functions_of: Vec<u16>,
    /// Receivers of the rows behind those of all receivers.
    others: Vec<u32>,
    nodes: Vec<u32>,
    steps: Vec<f32>,
    /// `[receiver][k]`
    row_sums: Vec<Vec<f32>>,
    /// `[coefficient][k][lane]`
    values: Vec<Vec<Vec<f64>>>,
    split_mm: f64,
    radii_mm: Vec<f64>,
    weights: Vec<f64>,
    /// `[k][g]`
    functions: Vec<Vec<f32>>,
}

/// Rows of one width in bytes, as (coefficient, k) and the values of the lanes.
fn rows_by_hand(bytes: &[u8], width: usize, functions: usize, masks: &[u16]) -> Vec<((usize, usize), Vec<f64>)> {
    let order: Vec<(usize, usize)> = (0..functions)
        .flat_map(|k| (0..masks.len()).map(move |c| (c, k)))
        .filter(|&(c, k)| masks[c] >> k & 1 == 1)
        .collect();
    assert_eq!(bytes.len(), 16 * width * order.len());
    let number = |n: usize, position: usize| {
        let byte = |j: usize| bytes[16 * (j * order.len() + n) + position];
        if width == 1 {
            return f64::from(byte(0) as i8);
        }
        let z = u16::from_le_bytes([byte(0), byte(1)]);
        f64::from((z >> 1) as i16 ^ ((z & 1) as i16).wrapping_neg())
    };
    let lanes = |n: usize| {
        let q: Vec<f64> = (0..16).map(|position| number(n, position)).collect();
        let mut s = vec![q[0]];
        for h in [1, 2, 4, 8] {
            s = (0..h).flat_map(|i| [s[i] - q[h + i], s[i] + q[h + i]].map(|x| x / 2f64.sqrt())).collect();
        }
        s
    };
    order.iter().enumerate().map(|(n, &place)| (place, lanes(n))).collect()
}

/// `[coefficient][k][lane]`; zeros where a function is not kept.
fn values_by_hand(sections: &[Section], functions: usize) -> Vec<Vec<Vec<f64>>> {
    let u16s = |tag| -> Vec<u16> {
        find(sections, tag, 3, 1).chunks_exact(2).map(|b| u16::from_le_bytes([b[0], b[1]])).collect()
    };
    let (masks, wide) = (u16s("far.msk"), u16s("far.wid"));
    let narrow: Vec<u16> = masks.iter().zip(&wide).map(|(kept, wide)| kept & !wide).collect();
    let mut values = vec![vec![vec![0.0; 16]; functions]; masks.len()];
    let rows = rows_by_hand(find(sections, "far.val", 2, 16), 1, functions, &narrow);
    for ((c, k), lanes) in rows.into_iter().chain(rows_by_hand(find(sections, "far.big", 1, 16), 2, functions, &wide)) {
        values[c][k] = lanes;
    }
    values
}

fn editable_by_hand(sections: &[Section], part_offsets: &[u32]) -> ByHand {
    let groups: Vec<[u32; 3]> =
        u32s(find(sections, "far.grp", 5, 3)).chunks_exact(3).map(|g| [g[0], g[1], g[2]]).collect();
    let [_, rows, coefficients] = groups.last().unwrap().map(|end| end as usize);
    let has = |tag: &str| sections.iter().any(|section| section.tag == tag);
    let u16s = |bytes: &[u8]| bytes.chunks_exact(2).map(|b| u16::from_le_bytes([b[0], b[1]])).collect::<Vec<u16>>();
    let functions_of = if has("far.fun") { u16s(find(sections, "far.fun", 3, 1)) } else { vec![!0; groups.len()] };
    let others = if has("far.row") { u32s(find(sections, "far.row", 5, 1)) } else { Vec::new() };
    let steps: Vec<f32> = u32s(find(sections, "far.stp", 10, 1)).into_iter().map(f32::from_bits).collect();
    let mut varints = find(sections, "far.nod", 1, 1).iter();
    let mut nodes = Vec::new();
    for group in &groups {
        let mut last = part_offsets[group[0] as usize];
        while nodes.len() < group[2] as usize {
            let (mut step, mut shift) = (0, 0);
            loop {
                let byte = *varints.next().unwrap();
                step |= u32::from(byte & 127) << shift;
                shift += 7;
                if byte < 128 {
                    break;
                }
            }
            last += step + 1;
            nodes.push(last);
        }
    }
    assert!(varints.next().is_none());
    let planes = find(sections, "far.sum", 1, 1);
    let mut row_sums = vec![Vec::new(); rows];
    for k in 0..steps.len() {
        let mut x = 0u32;
        for (i, sums) in row_sums.iter_mut().enumerate() {
            let z = (0..4).fold(0, |z, j| z | u32::from(planes[(k * 4 + j) * rows + i]) << (8 * j));
            x = x.wrapping_add((z >> 1) ^ (z & 1).wrapping_neg());
            sums.push(f32::from_bits(x));
        }
    }
    assert_eq!(find(sections, "far.msk", 3, 1).len(), 2 * coefficients);
    let (split, radii_mm) = (find(sections, "bas.rec", 0, 1), f64s(find(sections, "bas.nod", 11, 1)));
    assert_eq!(split.len(), 8);
    let functions: Vec<f32> = u32s(find(sections, "bas.fun", 10, 1)).into_iter().map(f32::from_bits).collect();
    ByHand {
        receiver_of_vertex: u32s(find(sections, "far.rcv", 5, 1)),
        values: values_by_hand(sections, steps.len()),
        groups,
        functions_of,
        others,
        nodes,
        steps,
        row_sums,
        split_mm: f64_at(split, 0),
        weights: f64s(find(sections, "bas.wgt", 11, 1)),
        functions: functions.chunks_exact(radii_mm.len()).map(<[f32]>::to_vec).collect(),
        radii_mm,
    }
}

fn mean(areas: &[f64], irradiance: &[f64]) -> f64 {
    areas.iter().zip(irradiance).map(|(a, e)| a * e).sum::<f64>() / areas.iter().sum::<f64>()
}

/// Fills in the details of the nodes below `[a, b)`.
fn details(a: usize, b: usize, areas: &[f64], irradiance: &[f64], detail: &mut [f64]) {
    if b - a > 1 {
        let m = a + (b - a).div_ceil(2);
        detail[m] = mean(&areas[a..m], &irradiance[a..m]) - mean(&areas[m..b], &irradiance[m..b]);
        details(a, m, areas, irradiance, detail);
        details(m, b, areas, irradiance, detail);
    }
}

impl ByHand {
    /// `s_k` of `R_d = profile`, whose value and first two derivatives with respect to the square of the radius are given.
    fn coefficients(&self, profile: impl Fn(f64) -> [f64; 3]) -> Vec<f64> {
        let far = |r: f64| {
            if r >= self.split_mm {
                return profile(r)[0];
            }
            let ([value, first, second], du) = (profile(self.split_mm), r * r - self.split_mm * self.split_mm);
            value + first * du + second * du * du / 2.0
        };
        let of = |b: &Vec<f32>| {
            self.radii_mm.iter().zip(&self.weights).zip(b).map(|((r, w), b)| w * far(*r) * f64::from(*b)).sum()
        };
        self.functions.iter().map(of).collect()
    }

    /// Of receivers that have every function of their own or take it from the only row that has it.
    fn far(&self, s: &[f64], part_offsets: &[u32], areas: &[f64], irradiance: &[f64]) -> Vec<f64> {
        let mut detail = vec![f64::NAN; areas.len()];
        let mut values: Vec<Vec<Option<f64>>> = Vec::new();
        let mut first = 0;
        for (group, mask) in self.groups.iter().zip(&self.functions_of) {
            let [part, rows_end, coefficients_end] = group.map(|x| x as usize);
            let (a, b) = (part_offsets[part] as usize, part_offsets[part + 1] as usize);
            details(a, b, areas, irradiance, &mut detail);
            let mean = mean(&areas[a..b], &irradiance[a..b]);
            let start = values.len();
            for row in start..rows_end {
                let of = |k: usize| {
                    let term = |c: usize| self.values[c][k][row - start] * detail[self.nodes[c] as usize];
                    let sum: f64 = (first..coefficients_end).map(term).sum();
                    let value = f64::from(self.row_sums[row][k]) * mean + f64::from(self.steps[k]) * sum;
                    (mask >> k & 1 == 1).then_some(value)
                };
                values.push((0..s.len()).map(of).collect());
            }
            first = coefficients_end;
        }
        let receivers = values.len() - self.others.len();
        for (row, &receiver) in (receivers..).zip(&self.others) {
            for (k, value) in values[row].clone().into_iter().enumerate().filter(|(_, value)| value.is_some()) {
                assert!(values[receiver as usize][k].is_none());
                values[receiver as usize][k] = value;
            }
        }
        values.truncate(receivers);
        let only = |k: usize| values.iter().find_map(|of| of[k]).unwrap();
        values.iter().map(|of| (0..s.len()).map(|k| s[k] * of[k].unwrap_or_else(|| only(k))).sum()).collect()
    }
}

#[test]
fn the_sections_of_editable_read_as_the_page_says() {
    let asset = full_asset_0_1();
    let by_hand = editable_by_hand(&read_by_hand(GOLDEN), &asset.samples.part_offsets);
    let shape = Shape::new(asset.mesh.positions_mm.len(), &asset.samples);
    let field = FarField::from_sections(&asset.extra, &shape).unwrap().unwrap();
    let basis = ProfileBasis::from_sections(&asset.extra).unwrap().unwrap();
    assert_eq!(by_hand.receiver_of_vertex, field.receiver_of_vertex);
    assert_eq!(by_hand.nodes, field.nodes);
    assert_eq!(by_hand.steps, field.steps);
    assert_eq!(by_hand.row_sums.concat(), field.row_sums);
    // One coefficient, whose first function is wide.
    let wide = over_lanes(field.wide[0].map(f32::from));
    let narrow = over_lanes(field.narrow[0].map(f32::from));
    for lane in 0..16 {
        assert!((by_hand.values[0][0][lane] - f64::from(wide[lane])).abs() < 0.01, "lane {lane}");
        assert!((by_hand.values[0][1][lane] - f64::from(narrow[lane])).abs() < 1e-5, "lane {lane}");
    }
    assert_eq!((by_hand.split_mm, by_hand.radii_mm), (basis.split_mm, basis.nodes_mm));
    assert_eq!((by_hand.weights, by_hand.functions.concat()), (basis.weights_mm4, basis.functions));
}

/// The asset of the page's example: triangles of 1, 1 and 2 mm^2, two of whose corners are receivers.
fn example() -> AssetFile {
    let mesh = Mesh {
        positions_mm: vec![[0.0; 3], [2.0, 0.0, 0.0], [0.0, 1.0, 0.0], [2.0, 1.0, 0.0], [0.0, 3.0, 0.0]],
        triangles: vec![[0, 1, 2], [1, 3, 2], [2, 3, 4]],
        triangle_material: vec![0; 3],
        materials: vec![String::new()],
        weld: (0..5).collect(),
        ..Default::default()
    };
    let part = PartRecord { name: String::new(), opaque: false, medium: 0 };
    let parts =
        Parts { triangle_part: vec![0; 3], parts: vec![part], media: vec![full_asset().parts.media[0].clone()] };
    let samples = Samples {
        facets: (0..3).map(|triangle| [triangle, 1]).collect(),
        patch_offsets: vec![0, 1, 2, 3],
        part_offsets: vec![0, 3],
    };
    let lanes = |first, second| {
        let mut row = [0; 16];
        row[..2].copy_from_slice(&[first, second]);
        row
    };
    let mut wide = [0; 16];
    wide[0] = 1184;
    let field = FarField {
        terms: 2,
        receiver_of_vertex: vec![0, NO_RECEIVER, NO_RECEIVER, NO_RECEIVER, 1],
        others: Vec::new(),
        groups: vec![Group { part: 0, rows_end: 2, coefficients_end: 2, functions: 3 }],
        nodes: vec![1, 2],
        masks: vec![3, 1],
        wide_masks: vec![0, 1],
        steps: vec![0.5, 0.25],
        narrow: vec![lanes(16, 0), lanes(4, -4)],
        wide: vec![wide],
        row_sums: vec![2.0, 1.0, 2.5, -0.5],
    };
    let basis = ProfileBasis {
        split_mm: 1.0,
        nodes_mm: vec![0.5, 2.0],
        weights_mm4: vec![3.0, 5.0],
        functions: vec![0.5, 0.25, 1.0, -0.5],
        totals: None,
    };
    let mut extra = field.to_sections(&Shape::new(5, &samples)).unwrap();
    extra.extend(basis.to_sections().unwrap());
    AssetFile { mesh, parts, samples, extra, ..Default::default() }
}

#[test]
fn the_example_of_the_page_is_right() {
    let sections = read_by_hand(&example().to_bytes().unwrap());
    let by_hand = editable_by_hand(&sections, &[0, 3]);
    assert_eq!(by_hand.groups, [[0, 2, 2]]);
    assert_eq!(find(&sections, "far.nod", 1, 1), [0, 0]);
    let (areas, irradiance) = ([1.0, 1.0, 2.0], [1.0, 2.0, 4.0]);
    let mut detail = [0.0; 3];
    details(0, 3, &areas, &irradiance, &mut detail);
    assert_eq!((mean(&areas, &irradiance), detail), (2.75, [0.0, -1.0, -2.5]));
    let near = |a: &[f64], b: [f64; 2]| a[..2].iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-9);
    let values = &by_hand.values;
    assert!(near(&values[0][0], [4.0, 4.0]) && near(&values[0][1], [2.0, 2.0]) && near(&values[1][0], [296.0, 296.0]));

    let s = by_hand.coefficients(|r| {
        let x = 1.0 + r * r;
        [1.0 / x, -1.0 / (x * x), 2.0 / (x * x * x)]
    });
    let far = by_hand.far(&s, &[0, 3], &areas, &irradiance);
    assert!((s[0] - 1.38671875).abs() < 1e-14 && (s[1] - 1.7734375).abs() < 1e-14, "{s:?}");
    assert!((far[0] + 504.2421875).abs() < 1e-9 && (far[1] + 509.65087890625).abs() < 1e-9, "{far:?}");

    // The same with function 1 at the first receiver alone.
    let mut asset = example();
    let shape = Shape::new(5, &asset.samples);
    let mut field = FarField::from_sections(&asset.extra, &shape).unwrap().unwrap();
    field.groups[0].functions = 1;
    field.groups.push(Group { part: 0, rows_end: 3, coefficients_end: 3, functions: 2 });
    field.others = vec![0];
    (field.nodes, field.masks, field.wide_masks) = (vec![1, 2, 1], vec![1, 1, 2], vec![0, 1, 0]);
    field.row_sums = vec![2.0, 0.0, 2.5, 0.0, 0.0, 1.0];
    asset.extra.retain(|section| !section.tag.as_str().starts_with("far."));
    asset.extra.extend(field.to_sections(&shape).unwrap());
    let sections = read_by_hand(&asset.to_bytes().unwrap());
    let by_hand = editable_by_hand(&sections, &[0, 3]);
    assert_eq!((by_hand.groups.concat(), by_hand.others.as_slice()), (vec![0, 2, 2, 0, 3, 3], &[0][..]));
    assert_eq!(by_hand.functions_of, [1, 2]);
    let far = by_hand.far(&s, &[0, 3], &areas, &irradiance);
    assert!((far[0] + 504.2421875).abs() < 1e-9 && (far[1] + 502.33544921875).abs() < 1e-9, "{far:?}");

    let numbers = [
        "-502.33544921875",
        "1.38671875 ",
        "1.7734375\n",
        "-504.2421875\n",
        "-509.65087890625\n",
        "-365.125\n",
        "296, 296",
    ];
    numbers.iter().for_each(|number| assert!(FACTORED.contains(number), "{number} is not on the page"));
}

/// Irradiance rows, read as the page says.
struct RowsByHand {
    /// `n` and `J`
    dimensions: [u32; 2],
    /// `[patch][detail]`
    places: Vec<Vec<u32>>,
    /// `[patch][term][detail]`
    values: Vec<Vec<Vec<i8>>>,
    /// `[patch][term][face]`
    scaling: Vec<Vec<Vec<i16>>>,
    steps: Vec<f32>,
    scaling_steps: Vec<f32>,
    /// `[term][power - 1]`
    functions: Vec<Vec<f64>>,
}

fn environment<'a>(sections: &'a [Section], tag: &str, element: u8, components: u16) -> &'a [u8] {
    let section = sections.iter().find(|section| section.tag == tag).unwrap();
    assert_eq!((section.element, section.components, section.kind), (element, components, 4), "{tag}");
    &section.bytes
}

fn rows_of_environment_by_hand(sections: &[Section]) -> RowsByHand {
    let f32s = |tag| u32s(environment(sections, tag, 10, 1)).into_iter().map(f32::from_bits).collect();
    let dimensions: [u32; 2] = u32s(environment(sections, "rows.dim", 5, 2)).try_into().unwrap();
    let terms = dimensions[1] as usize;
    let counts = environment(sections, "rows.cnt", 3, 1).chunks_exact(2).map(|b| usize::from(u16_at(b, 0)));
    let counts: Vec<usize> = counts.collect();
    let (patches, total): (usize, usize) = (counts.len(), counts.iter().sum());
    let two = |bytes: &[u8], i: usize| u16::from_le_bytes([bytes[i], bytes[bytes.len() / 2 + i]]);
    let differences = environment(sections, "rows.idx", 1, 1);
    let values = environment(sections, "rows.val", 2, 1);
    let scaling = environment(sections, "rows.sca", 1, 1);
    assert_eq!([differences.len(), values.len(), scaling.len()], [2 * total, terms * total, 12 * terms * patches]);
    let (mut places, mut of_details, mut first) = (Vec::new(), Vec::new(), 0);
    for count in counts {
        let mut row: Vec<u32> = Vec::new();
        for i in first..first + count {
            let number = u32::from(two(differences, i));
            row.push(row.last().map_or(number, |before| before + 1 + number));
        }
        places.push(row);
        let of_term = |j: usize| values[j * total + first..][..count].iter().map(|&byte| byte as i8).collect();
        of_details.push((0..terms).map(of_term).collect());
        first += count;
    }
    let of_face = |i: usize, j: usize, f: usize| two(scaling, (6 * j + f) * patches + i) as i16;
    let of_patch = |i: usize| (0..terms).map(|j| (0..6).map(|f| of_face(i, j, f)).collect()).collect();
    RowsByHand {
        dimensions,
        places,
        values: of_details,
        scaling: (0..patches).map(of_patch).collect(),
        steps: f32s("rows.stp"),
        scaling_steps: f32s("rows.scs"),
        functions: f64s(environment(sections, "rows.fun", 11, 9)).chunks_exact(9).map(<[f64]>::to_vec).collect(),
    }
}

#[test]
fn irradiance_rows_read_as_the_page_says() {
    let asset = full_asset_0_1();
    let by_hand = rows_of_environment_by_hand(&read_by_hand(GOLDEN));
    let rows = IrradianceRows::from_sections(&asset.extra, asset.samples.patch_count()).unwrap().unwrap();
    assert_eq!(by_hand.dimensions, [32, 2]);
    assert_eq!(by_hand.places, [vec![1, 700, 6143], vec![], vec![2, 1025]]);
    assert_eq!(by_hand.places.concat(), rows.indices.iter().map(|&place| u32::from(place)).collect::<Vec<_>>());
    assert_eq!(by_hand.values[0], [[127, -5, 3], [0, 2, -127]]);
    assert_eq!(by_hand.values.concat().concat(), rows.values);
    assert_eq!(by_hand.scaling.concat().concat(), rows.scaling);
    assert_eq!((by_hand.steps, by_hand.scaling_steps), (rows.steps, rows.scaling_steps));
    assert_eq!(by_hand.functions, rows.functions);
}

/// `Int_0^1 f dmu` by Simpson's rule.
fn integral(f: impl Fn(f64) -> f64) -> f64 {
    const INTERVALS: u32 = 4000;
    let weight = |i: u32| match i {
        0 | INTERVALS => 1.0,
        _ => f64::from(2 + 2 * (i % 2)),
    };
    (0..=INTERVALS).map(|i| weight(i) * f(f64::from(i) / f64::from(INTERVALS))).sum::<f64>() / f64::from(3 * INTERVALS)
}

/// The c_j of functions, as the page says.
fn entrance_by_hand(functions: &[Vec<f64>], eta: f64) -> (f64, Vec<f64>) {
    let f = |j: usize, mu: f64| functions[j].iter().zip(1..).map(|(a, power)| a * mu.powi(power)).sum::<f64>();
    let transmittance = |mu: f64| {
        let m = (mu * mu + eta * eta - 1.0).sqrt() / eta;
        2.0 * eta * mu * m * ((mu + eta * m).powi(-2) + (eta * mu + m).powi(-2))
    };
    let terms = 0..functions.len();
    let t = integral(|mu| transmittance(mu) * mu);
    let q: Vec<f64> = terms.clone().map(|j| integral(|mu| f(j, mu) * f(j, mu))).collect();
    let g: Vec<f64> = terms.clone().map(|j| integral(|mu| f(j, mu))).collect();
    let b: Vec<f64> = terms.clone().map(|j| integral(|mu| transmittance(mu) * mu * f(j, mu)) / q[j]).collect();
    let missing = t - terms.clone().map(|j| b[j] * g[j]).sum::<f64>();
    let size: f64 = terms.clone().map(|j| g[j] * g[j] / q[j]).sum();
    (t, terms.map(|j| b[j] + missing / size * g[j] / q[j]).collect())
}

/// The functions of the frozen file are those of the page's example.
#[test]
fn the_example_of_the_functions_of_the_angle_is_right() {
    let by_hand = rows_of_environment_by_hand(&read_by_hand(GOLDEN));
    let (t, c) = entrance_by_hand(&by_hand.functions, 1.5);
    let whole = integral(|mu| c[0] * mu + c[1] * (mu * mu - 0.75 * mu));
    assert!((whole - t).abs() < 1e-12, "{whole} {t}");
    for number in [t, c[0], c[1]] {
        let text = format!(" {number:.6}");
        assert!(ENVIRONMENT_ROWS.contains(&text), "{text} is not on the page");
    }
}
