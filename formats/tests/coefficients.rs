//! Coded coefficients come back, take little more than their entropy, and damaged ones are refused.
#![allow(clippy::unwrap_used)]

mod common;

use std::collections::BTreeMap;

use common::Random;
use translux_format::coefficients::{Coefficients, NO_ROW, decode, encode, shape};
use translux_format::range_coder::{Bit, Coder, Decoder, Encoder, Signed};
use translux_format::{Budget, FormatError, Tag};

const TAG: Tag = Tag::from_static("x_coef");

fn unit(random: &mut Random) -> f64 {
    (random.next() >> 11) as f64 / (1u64 << 53) as f64
}

/// A Laplacian number of this scale (mean magnitude).
fn laplacian(random: &mut Random, scale: f64) -> f64 {
    let u = unit(random) - 0.5;
    -scale * u.signum() * (1.0 - 2.0 * u.abs()).max(1e-300).ln()
}

/// Bits of entropy of a Laplacian number rounded to whole numbers.
fn laplacian_entropy(scale: f64) -> f64 {
    let bits = |p: f64| if p > 0.0 { -p * p.log2() } else { 0.0 };
    let tail = |x: f64| 0.5 * (-x / scale).exp();
    let each: f64 = (1..40_000).map(|k| 2.0 * bits(tail(f64::from(k) - 0.5) - tail(f64::from(k) + 0.5))).sum();
    each + bits(1.0 - 2.0 * tail(0.5))
}

/// Independent Laplacian columns whose scale falls by a factor each.
fn falling(rows: usize, columns: usize, first: f64, factor: f64) -> (Vec<i16>, f64) {
    let mut random = Random(5);
    let scales: Vec<f64> = (0..columns).map(|c| first * factor.powi(c as i32)).collect();
    let values =
        (0..rows).flat_map(|_| scales.iter().map(|s| laplacian(&mut random, *s).round() as i16).collect::<Vec<_>>());
    let values = values.collect();
    (values, scales.iter().map(|s| laplacian_entropy(*s)).sum::<f64>() * rows as f64 / 8.0)
}

/// Rows near their parent in a tree, with a scale of their own.
fn tree(rows: usize, columns: usize, first: f64, factor: f64) -> (Vec<i16>, Vec<u32>) {
    let mut random = Random(6);
    let mut exact = vec![0.0; rows * columns];
    let mut scale = vec![0.0f64; rows];
    let mut parents = vec![NO_ROW; rows];
    for row in 0..rows {
        let parent = if row == 0 { 0 } else { row / 2 + random.below(row.div_ceil(2)) };
        if row > 0 {
            parents[row] = parent as u32;
        }
        scale[row] = 0.8 * scale[parent] + 0.6 * (unit(&mut random) * 4.0 - 2.0);
        for c in 0..columns {
            let s = first * factor.powi(c as i32) * scale[row].exp();
            exact[row * columns + c] = 0.5 * exact[parent * columns + c] + laplacian(&mut random, s);
        }
    }
    (exact.iter().map(|x| x.round().clamp(-32768.0, 32767.0) as i16).collect(), parents)
}

fn zstd_bytes(values: &[i16]) -> usize {
    let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    let planes: Vec<u8> = values.iter().map(|v| *v as u8).chain(values.iter().map(|v| (v >> 8) as u8)).collect();
    [bytes, planes].iter().map(|b| zstd::bulk::compress(b, 19).unwrap().len()).min().unwrap()
}

#[test]
fn matrices_survive_and_have_one_form() {
    let mut random = Random(1);
    for round in 0..300 {
        let (rows, columns) = (random.below(40), random.below(if round % 10 == 0 { 300 } else { 40 }));
        let bits = random.below(17) as u32;
        let values: Vec<i16> = (0..rows * columns)
            .map(|_| match random.below(20) {
                0 if bits > 12 => i16::MIN,
                1 if bits > 12 => i16::MAX,
                2..12 => 0,
                _ => ((random.next() & ((1 << bits) - 1)) as i32 - (1 << bits) / 2) as i16,
            })
            .collect();
        let named: Vec<u32> = (0..rows)
            .map(|row| if random.below(4) == 0 { NO_ROW } else { random.below(row) as u32 })
            .enumerate()
            .map(|(row, named)| if row == 0 { NO_ROW } else { named })
            .collect();
        for named in [None, Some(&named[..])] {
            let bytes = encode(TAG, rows, columns, &values, named).unwrap();
            assert_eq!(shape(TAG, &bytes).unwrap(), (rows, columns));
            let back = decode(TAG, &bytes, named, Budget::bytes(2 * values.len() as u64)).unwrap();
            assert_eq!(back, Coefficients { rows, columns, values: values.clone() });
            assert_eq!(encode(TAG, rows, columns, &values, named).unwrap(), bytes);
        }
    }
}

/// The widest matrix, and one that is nothing but zeros.
#[test]
fn extreme_shapes_survive() {
    let mut wide = vec![0; 3 * 65_535];
    for (i, value) in [(0, 1), (65_534, -2), (65_535 + 40_000, i16::MIN), (3 * 65_535 - 1, i16::MAX)] {
        wide[i] = value;
    }
    let bytes = encode(TAG, 3, 65_535, &wide, None).unwrap();
    assert!(bytes.len() < 2500, "{}", bytes.len());
    assert_eq!(decode(TAG, &bytes, None, Budget::default()).unwrap().values, wide);
    let zeros = encode(TAG, 100_000, 64, &vec![0; 6_400_000], None).unwrap();
    assert!(zeros.len() < 60, "{}", zeros.len());
    assert!(decode(TAG, &zeros, None, Budget::default()).unwrap().values.iter().all(|value| *value == 0));
}

#[test]
fn sizes_are_near_the_entropy_and_below_zstd() {
    let (rows, columns) = (8000, 48);
    let (values, entropy) = falling(rows, columns, 6.0, 0.88);
    let bytes = encode(TAG, rows, columns, &values, None).unwrap();
    let excess = bytes.len() as f64 / entropy - 1.0;
    // The sample's own entropy scatters by about 0.3 % around that of its distribution.
    assert!((-0.01..0.03).contains(&excess), "{} bytes, {entropy} of entropy", bytes.len());
    assert!(bytes.len() * 4 < zstd_bytes(&values) * 3);
    let (values, parents) = tree(rows, columns, 3.0, 0.9);
    let alone = encode(TAG, rows, columns, &values, None).unwrap();
    let predicted = encode(TAG, rows, columns, &values, Some(&parents)).unwrap();
    assert!(predicted.len() * 100 < alone.len() * 96, "{} bytes, {} without predictors", predicted.len(), alone.len());
    assert!(alone.len() * 4 < zstd_bytes(&values) * 3);
}

fn small() -> (Vec<i16>, Vec<u32>) {
    tree(30, 9, 4.0, 0.8)
}

#[test]
fn every_cut_and_every_changed_byte_is_refused() {
    let (values, parents) = small();
    for named in [None, Some(&parents[..])] {
        let bytes = encode(TAG, 30, 9, &values, named).unwrap();
        for end in 0..bytes.len() {
            assert!(decode(TAG, &bytes[..end], named, Budget::default()).is_err(), "cut at {end}");
        }
        for extra in [&[0][..], &[1], &[0; 9], &[255; 20]] {
            assert!(decode(TAG, &[&bytes, extra].concat(), named, Budget::default()).is_err());
        }
        for at in 3..bytes.len() {
            for bit in 0..8 {
                let mut damaged = bytes.clone();
                damaged[at] ^= 1 << bit;
                assert!(decode(TAG, &damaged, named, Budget::default()).is_err(), "bit {bit} of byte {at}");
            }
        }
    }
}

/// Random streams are refused in the end; nothing is read or taken that should not be on the way.
#[test]
fn random_bytes_are_refused() {
    let mut random = Random(2);
    for round in 0..20_000 {
        let (rows, columns) = (random.below(12), 1 + random.below(11));
        let mut bytes = vec![rows as u8, columns as u8, 0];
        let length = random.below(6 + round % 30);
        bytes.extend((0..length).map(|_| if random.below(3) == 0 { 0xff } else { random.next() as u8 }));
        let found = decode(TAG, &bytes, None, Budget::bytes(1000));
        assert!(matches!(found, Err(FormatError::Invalid { tag: TAG, .. })), "{bytes:?}");
    }
}

#[test]
fn claims_are_checked_before_memory_is_taken() {
    let claim = |rows: u32, columns: u32| -> Vec<u8> {
        let mut bytes = Vec::new();
        for mut number in [rows, columns, 0] {
            while number >= 0x80 {
                bytes.push(number as u8 | 0x80);
                number >>= 7;
            }
            bytes.push(number as u8);
        }
        bytes
    };
    for (rows, columns) in [(u32::MAX - 1, 65_535), (1 << 20, 1025), (51, 10)] {
        let budget = if rows == 51 { 1019 } else { 2 << 30 };
        let found = decode(TAG, &claim(rows, columns), None, Budget::bytes(budget));
        let needed = 2 * u64::from(rows) * u64::from(columns);
        assert_eq!(found, Err(FormatError::OverBudget { tag: TAG, needed, budget }));
    }
    for (rows, columns) in [(u32::MAX, 1), (1, 65_536), (0, u32::MAX)] {
        let found = decode(TAG, &claim(rows, columns), None, Budget::default());
        assert!(matches!(found, Err(FormatError::Invalid { .. })));
    }
    // Rows of no columns take no memory, however many.
    let none = decode(TAG, &claim(u32::MAX - 1, 0), None, Budget::bytes(0)).unwrap();
    assert_eq!(none, Coefficients { rows: u32::MAX as usize - 1, columns: 0, values: vec![] });
    for wrong in [&[][..], &[3], &[3, 4], &[3, 4, 2], &[0x83, 0, 4, 0], &[0xff; 8]] {
        assert!(decode(TAG, wrong, None, Budget::default()).is_err(), "{wrong:?}");
        assert!(shape(TAG, wrong).is_err());
    }
}

#[test]
fn wrong_arguments_are_refused() {
    let (values, parents) = small();
    assert!(encode(TAG, 30, 8, &values, None).is_err());
    assert!(encode(TAG, usize::MAX, 9, &values, None).is_err());
    assert!(encode(TAG, 1, 65_536, &[0; 65_536], None).is_err());
    let coded = encode(TAG, 30, 9, &values, Some(&parents)).unwrap();
    assert!(decode(TAG, &coded, None, Budget::default()).is_err());
    assert!(decode(TAG, &encode(TAG, 30, 9, &values, None).unwrap(), Some(&parents), Budget::default()).is_err());
    for (row, named) in [(0, 0), (5, 5), (5, 6), (29, NO_ROW - 1)] {
        let mut wrong = parents.clone();
        wrong[row] = named;
        assert!(encode(TAG, 30, 9, &values, Some(&wrong)).is_err());
        assert!(decode(TAG, &coded, Some(&wrong), Budget::default()).is_err());
    }
    assert!(encode(TAG, 30, 9, &values, Some(&parents[1..])).is_err());
    assert!(decode(TAG, &coded, Some(&parents[1..]), Budget::default()).is_err());
}

#[test]
fn bits_of_every_probability_survive_with_carries() {
    let mut random = Random(4);
    for ones_of_1000 in [0, 1, 20, 500, 980, 1000] {
        for length in [0, 1, 2, 63, 64, 5000] {
            let bits: Vec<bool> = (0..length).map(|_| random.below(1000) < ones_of_1000).collect();
            let plain: Vec<u32> = (0..length)
                .map(|i| {
                    if ones_of_1000 == 1000 {
                        (1 << (i % 17)) - 1
                    } else {
                        random.next() as u32 & ((1 << (i % 17)) - 1)
                    }
                })
                .collect();
            let (mut encoder, mut model) = (Encoder::new(), Bit::NEW);
            for (i, (bit, plain)) in bits.iter().zip(&plain).enumerate() {
                encoder.bit(&mut model, *bit);
                encoder.direct(i as u32 % 17, *plain);
            }
            let bytes = encoder.finish();
            let (mut decoder, mut model) = (Decoder::new(&bytes), Bit::NEW);
            for (i, (bit, plain)) in bits.iter().zip(&plain).enumerate() {
                assert_eq!(decoder.bit(&mut model, false), *bit);
                assert_eq!(decoder.direct(i as u32 % 17, 0), *plain);
            }
            assert!(decoder.clone().finish());
            decoder.direct(16, 0);
            assert!(!decoder.finish(), "read on");
        }
    }
}

#[test]
fn signed_integers_survive() {
    let mut random = Random(8);
    let numbers: Vec<i32> = (0..20_000)
        .map(|i| match i % 7 {
            0 => [0, 1, -1, 65_535, -65_535, 32_768, -32_768][random.below(7)],
            _ => laplacian(&mut random, 30.0) as i32,
        })
        .collect();
    let (mut encoder, mut models) = (Encoder::new(), Signed::NEW);
    for number in &numbers {
        assert_eq!(models.code(&mut encoder, *number), *number);
    }
    assert_eq!(models.code(&mut encoder, i32::MIN), -65_535);
    let bytes = encoder.finish();
    let (mut decoder, mut models) = (Decoder::new(&bytes), Signed::default());
    for number in &numbers {
        assert_eq!(models.code(&mut decoder, 0), *number);
    }
    assert_eq!(models.code(&mut decoder, 0), -65_535);
    assert!(decoder.finish());
}

/// A decoder made from the words of spec/coding.md alone.
struct ByTheBook<'a> {
    bytes: &'a [u8],
    used: usize,
    code: u64,
    range: u64,
    models: BTreeMap<Vec<usize>, (u64, u32)>,
}

impl ByTheBook<'_> {
    fn new(bytes: &[u8]) -> ByTheBook<'_> {
        let code = (0..8).fold(0, |code, i| code << 8 | u64::from(bytes.get(i).copied().unwrap_or(0)));
        ByTheBook { bytes, used: 8, code, range: u64::MAX, models: BTreeMap::new() }
    }

    fn go_on(&mut self) {
        if self.range < 1 << 32 {
            self.range <<= 32;
            for _ in 0..4 {
                self.code = self.code << 8 | u64::from(self.bytes.get(self.used).copied().unwrap_or(0));
                self.used += 1;
            }
        }
    }

    fn bit(&mut self, name: &[usize]) -> usize {
        let (p, n) = self.models.entry(name.to_vec()).or_insert((1 << 23, 0));
        let bound = (self.range >> 16) * (*p >> 8).max(1);
        let s = f64::from(*n + 2).log2().floor() as i32;
        let bit = if self.code < bound {
            self.range = bound;
            *p += ((1 << 24) - *p) / 2u64.pow(s as u32);
            0
        } else {
            (self.code, self.range) = (self.code - bound, self.range - bound);
            *p -= *p / 2u64.pow(s as u32);
            1
        };
        *n = (*n + 1).min(126);
        self.go_on();
        bit
    }

    fn plain(&mut self, k: usize) -> usize {
        if k == 0 {
            return 0;
        }
        self.range >>= k;
        let number = (self.code / self.range).min((1 << k) - 1);
        self.code -= number * self.range;
        self.go_on();
        number as usize
    }

    /// Bits from the highest, so many of them under models with this name.
    fn bits(&mut self, name: &[usize], count: usize, under_models: usize) -> usize {
        let mut before = Vec::new();
        for _ in 0..count.min(under_models) {
            let bit = self.bit(&[name, &before].concat());
            before.push(bit);
        }
        let rest = count - before.len();
        before.iter().fold(0, |number, bit| 2 * number + bit) << rest | self.plain(rest)
    }

    fn matrix(&mut self, rows: usize, columns: usize, predictors: &[Option<usize>]) -> Vec<Vec<i32>> {
        let h = |x: usize| if x < 4 { x } else { 2 * x.ilog2() as usize + (x >> (x.ilog2() - 1)) % 2 };
        let bits = (1..).find(|bits| columns >> bits == 0).unwrap();
        let g = |x: i64| {
            let j = (x + 16).ilog2() as i64;
            16 * j + (x + 16) / 2i64.pow(j as u32 - 4) % 16
        };
        let near = |x: i64, y: i64, s: u32| x + (y - x).div_euclid(2i64.pow(s));
        let mut means = vec![8192i64; columns];
        let mut counts: Vec<usize> = Vec::new();
        let mut matrix: Vec<Vec<i32>> = Vec::new();
        for (number, predictor) in predictors.iter().take(rows).enumerate() {
            let expected = predictor.map_or(counts.last().copied().unwrap_or(0), |row| counts[row]);
            let c = self.bits(&[0, ((16 * expected) >> bits).min(15)], bits, 7);
            let mut row = vec![0i32; columns];
            let (mut a, mut b) = (4096, 4096);
            for k in 0..c {
                let t = predictor.map_or(0, |row| matrix[row][k]);
                let level = ((g(means[k]) + g(a) - g(b)).div_euclid(8)).clamp(0, 63) as usize;
                let q = if k < 32 { k } else { 22 + h(k) };
                let mut m = usize::from(k == c - 1);
                while m < 16 && self.bit(&[1, level, m]) == 1 {
                    m += 1;
                }
                if m > 0 {
                    let magnitude = 1 << (m - 1) | self.bits(&[2, level / 2, m], m - 1, 3);
                    let sign = self.bit(&[3, q, (t.signum() + 3) as usize % 3]);
                    row[k] = if sign == 1 { -(magnitude as i32) } else { magnitude as i32 };
                }
                a = near(a, 4096 * i64::from(row[k].abs()), 5);
                b = near(b, means[k], 5);
            }
            let s = (number + 2).ilog2().min(5);
            for (mean, value) in means.iter_mut().zip(&row) {
                *mean = near(*mean, 4096 * i64::from(value.abs()), s);
            }
            counts.push(c);
            matrix.push(row);
        }
        matrix
    }
}

#[test]
fn the_specification_is_enough_to_read() {
    let (rows, columns) = (300, 150);
    let (values, parents) = tree(rows, columns, 900.0, 0.93);
    let named: Vec<Option<usize>> = parents.iter().map(|row| (*row != NO_ROW).then_some(*row as usize)).collect();
    for (parents, named) in [(Some(&parents[..]), named), (None, vec![None; rows])] {
        let bytes = encode(TAG, rows, columns, &values, parents).unwrap();
        assert_eq!(bytes[..5], [0xac, 2, 0x96, 1, u8::from(parents.is_some())]);
        let mut book = ByTheBook::new(&bytes[5..]);
        let found = book.matrix(rows, columns, &named).concat();
        assert_eq!([book.plain(16), book.plain(16)], [0xe7d1, 0xa5c3]);
        assert!(found.iter().zip(&values).all(|(found, value)| *found == i32::from(*value)));
    }
}

/// Frozen: a change of these bytes is another format.
#[test]
fn the_example_of_the_specification_holds() {
    let page = include_str!("../spec/coding.md");
    let example = page.lines().find(|line| line.starts_with("Example: the rows `5 -1 0 0`")).unwrap();
    let bytes = encode(TAG, 3, 4, &[5, -1, 0, 0, 0, 0, 0, 0, -300, 2, 0, 1], Some(&[NO_ROW, NO_ROW, 0])).unwrap();
    let hex: Vec<String> = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
    assert!(example.ends_with(&format!("are the {} bytes `{}`.", bytes.len(), hex.join(" "))), "{}", hex.join(" "));
}

/// Sizes and speeds, for whoever changes the coder:
/// `cargo test --release -p translux-format --test coefficients sizes -- --ignored --nocapture`.
#[test]
#[ignore = "prints sizes and times"]
fn sizes_and_speeds() {
    for (rows, columns, first, factor) in
        [(30_000, 64, 20.0, 0.9), (30_000, 64, 1.0, 0.93), (30_000, 200, 300.0, 0.96), (3000, 32, 5.0, 0.9)]
    {
        for kind in ["falling", "tree"] {
            let (values, entropy, parents) = match kind {
                "falling" => {
                    let (v, e) = falling(rows, columns, first, factor);
                    (v, e, None)
                }
                _ => {
                    let (v, p) = tree(rows, columns, 0.3 * first, factor);
                    (v, 0.0, Some(p))
                }
            };
            let alone = encode(TAG, rows, columns, &values, None).unwrap().len();
            let start = std::time::Instant::now();
            let bytes = encode(TAG, rows, columns, &values, parents.as_deref()).unwrap();
            let encoding = start.elapsed().as_secs_f64();
            let start = std::time::Instant::now();
            let back = decode(TAG, &bytes, parents.as_deref(), Budget::default()).unwrap();
            let decoding = start.elapsed().as_secs_f64();
            assert!(back.values == values);
            let n = values.len() as f64;
            println!(
                "{kind} {rows} x {columns} from {first}: {} bytes ({alone} unpredicted), entropy {entropy:.0} ({:+.2} %), {:.3} bit/coefficient, zstd 19 {}, encode {:.0} M/s, decode {:.0} M/s",
                bytes.len(),
                100.0 * (bytes.len() as f64 / entropy - 1.0),
                8.0 * bytes.len() as f64 / n,
                zstd_bytes(&values),
                1e-6 * n / encoding,
                1e-6 * n / decoding
            );
        }
    }
    let mut random = Random(9);
    for p in [0.5, 0.1, 0.01] {
        let bits: Vec<bool> = (0..10_000_000).map(|_| unit(&mut random) < p).collect();
        let start = std::time::Instant::now();
        let mut encoder = Encoder::new();
        let mut models = [Bit::NEW; 16];
        for (i, bit) in bits.iter().enumerate() {
            encoder.bit(&mut models[i % 16], *bit);
        }
        let bytes = encoder.finish();
        let encoding = start.elapsed().as_secs_f64();
        let start = std::time::Instant::now();
        let mut decoder = Decoder::new(&bytes);
        let mut models = [Bit::NEW; 16];
        let mut ones = 0;
        for i in 0..bits.len() {
            ones += usize::from(decoder.bit(&mut models[i % 16], false));
        }
        let decoding = start.elapsed().as_secs_f64();
        assert!(decoder.finish());
        assert_eq!(ones, bits.iter().filter(|b| **b).count());
        let h = -p * f64::log2(p) - (1.0 - p) * f64::log2(1.0 - p);
        println!(
            "p {p}: {:.4} bit, entropy {h:.4}; encode {:.0}, decode {:.0} M bits/s",
            8.0 * bytes.len() as f64 / 1e7,
            10.0 / encoding,
            10.0 / decoding
        );
    }
}
