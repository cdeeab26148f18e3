//! HDR-FLIP against the authors' own evaluator (PyPI `flip-evaluator` 1.7), and what that evaluator refuses.
//!
//! `scripts/flip-reference` runs it on the pictures that this file makes, rewrites `fixtures/flip/NAME.u16` (its error
//! of each pixel, 65535 for 1) and prints the rows of [`EXPECTED`].
#![allow(clippy::unwrap_used, missing_docs)]

use std::path::Path;

use translux::error::ExitCode;
use translux::io::exr::{ExrPlane, read_exr_channels};
use translux::math::random::uniform;
use translux::measure::flip::{Exposures, ExposuresFrom, HdrFlip, Picture, Settings, hdr};

/// Name of a pair, and of the evaluator's answer: mean, first and last exposure in stops, number of exposures.
const EXPECTED: [(&str, f64, f64, f64, usize); 11] = [
    ("noise", 0.3474980, 0.113250, 1.104485, 2),
    ("grain", 0.0109854, 2.070458, 2.765161, 2),
    ("edge", 0.0579569, 1.380126, 3.889412, 3),
    ("point", 0.0010540, 2.070458, 2.765161, 2),
    ("colour", 0.1721605, 2.070458, 2.765161, 2),
    ("highlight", 0.1412221, -8.560589, 6.989901, 16),
    ("on-black", 0.1116509, 1.541129, 24.083298, 23),
    ("black-test", 0.9761935, 2.070458, 2.765161, 2),
    ("constant", 0.1569580, 2.083297, 2.083297, 2),
    ("pixel", 0.1100906, 2.456774, 2.456774, 2),
    ("tiles", 0.0459265, 1.342945, 2.135462, 2),
];

/// Two pictures of one size.
#[derive(Clone)]
struct Pair {
    width: usize,
    height: usize,
    reference: Vec<[f32; 3]>,
    test: Vec<[f32; 3]>,
}

impl Pair {
    fn new(width: usize, height: usize, at: impl Fn(f64, f64) -> [[f64; 3]; 2]) -> Self {
        let pixels = (0..width * height).map(|i| at((i % width) as f64, (i / width) as f64));
        let narrow = |rgb: [f64; 3]| rgb.map(|v| v as f32);
        let (reference, test) = pixels.map(|[a, b]| (narrow(a), narrow(b))).unzip();
        Self { width, height, reference, test }
    }

    fn pictures(&self) -> [Picture<'_>; 2] {
        [&self.reference, &self.test].map(|rgb| Picture { width: self.width, height: self.height, rgb })
    }

    fn flip(&self) -> HdrFlip {
        self.with(&Settings::default())
    }

    fn with(&self, settings: &Settings) -> HdrFlip {
        let [reference, test] = self.pictures();
        hdr(&reference, &test, settings).unwrap()
    }
}

fn noise(x: f64, y: f64, seed: u64) -> [f64; 3] {
    [0, 1, 2].map(|c| uniform(seed, (y * 4096.0 + x) as u64, c))
}

fn grey(v: f64) -> [f64; 3] {
    [v; 3]
}

/// A soft, coloured surface.
fn surface(x: f64, y: f64) -> [f64; 3] {
    let wave = 0.5 + 0.3 * (x * 0.31).sin() * (y * 0.23).cos();
    [0.7 * wave + 0.01 * x, 0.5 * wave, 0.3 * wave + 0.008 * y]
}

/// The pair of a name in [`EXPECTED`].
fn pair(name: &str) -> Pair {
    let scaled = |rgb: [f64; 3], by: [f64; 3]| [rgb[0] * by[0], rgb[1] * by[1], rgb[2] * by[2]];
    let edge = |x: f64, y: f64| if x + 0.3 * y < 20.0 { [0.9, 0.8, 0.7] } else { [0.1, 0.15, 0.2] };
    let blob = |x: f64, y: f64| 800.0 * (-((x - 20.0).powi(2) + (y - 14.0).powi(2)) / 5.0).exp();
    let ball = |x: f64, y: f64| 1.0 - ((x - 20.0).powi(2) + (y - 16.0).powi(2)) / 100.0;
    let lit = |v: f64, rgb: [f64; 3]| if v > 0.0 { scaled(rgb, grey(v.sqrt())) } else { grey(0.0) };
    let sum = |a: [f64; 3], b: f64| a.map(|v| v + b);
    match name {
        "noise" => Pair::new(40, 32, |x, y| [noise(x, y, 1).map(|v| 2.0 * v), noise(x, y, 2).map(|v| 2.0 * v)]),
        "grain" => Pair::new(40, 32, |x, y| {
            [surface(x, y), std::array::from_fn(|c| surface(x, y)[c] * (0.98 + 0.04 * noise(x, y, 3)[c]))]
        }),
        "edge" => Pair::new(40, 32, |x, y| [edge(x, y), edge(x - 1.0, y)]),
        "point" => Pair::new(40, 32, |x, y| {
            let dot = f64::from(x == 19.0 && y == 15.0);
            [surface(x, y), sum(surface(x, y), 0.6 * dot)]
        }),
        "colour" => Pair::new(40, 32, |x, y| [surface(x, y), scaled(surface(x, y), [1.15, 1.0, 0.8])]),
        "highlight" => Pair::new(40, 32, |x, y| {
            let dim = scaled(surface(x, y), grey(0.05));
            [sum(dim, blob(x, y)), sum(scaled(dim, grey(1.05)), 0.8 * blob(x - 0.5, y))]
        }),
        "on-black" => {
            Pair::new(40, 32, |x, y| [lit(ball(x, y), [0.9, 0.7, 0.5]), lit(ball(x - 0.7, y), [0.85, 0.7, 0.52])])
        }
        "black-test" => Pair::new(40, 32, |x, y| [surface(x, y), grey(0.0)]),
        "constant" => Pair::new(7, 5, |_, _| [grey(0.5), [0.6, 0.55, 0.4]]),
        "pixel" => Pair::new(1, 1, |_, _| [[0.3, 0.4, 0.5], [0.35, 0.4, 0.4]]),
        // One pixel more than a tile each way.
        "tiles" => Pair::new(193, 49, |x, y| [surface(x, y), surface(x + 0.2, y - 0.1)]),
        _ => panic!("{name}"),
    }
}

fn fixture(name: &str) -> Vec<f64> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("fixtures/flip/{name}.u16"));
    let bytes = std::fs::read(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    bytes.chunks_exact(2).map(|b| f64::from(u16::from_le_bytes([b[0], b[1]])) / 65535.0).collect()
}

#[test]
fn every_pixel_is_that_of_the_authors_evaluator() {
    for (name, mean, start, stop, count) in EXPECTED {
        let found = pair(name).flip();
        let expected = fixture(name);
        assert_eq!(expected.len(), found.per_pixel.len(), "{name}");
        let worst = expected.iter().zip(&found.per_pixel).map(|(a, b)| (a - f64::from(*b)).abs()).fold(0.0, f64::max);
        println!("{name}: mean {:.6}, theirs {mean:.6}, worst pixel {worst:.6}", found.mean);
        assert!((found.mean - mean).abs() < 1e-4, "{name}: {} is not {mean}", found.mean);
        assert!(worst < 1e-3, "{name}: a pixel differs by {worst}");
        let Exposures { start: first, stop: last, count: found, .. } = found.exposures;
        assert!((first - start).abs() < 1e-4 && (last - stop).abs() < 1e-4, "{name}: {first} to {last}");
        // Two equal exposures say what one does.
        assert_eq!(found, if start == stop { 1 } else { count }, "{name}");
    }
}

/// Writes each pair and its figures as raw 32-bit floats to the folder `TRANSLUX_FLIP_DUMP`; the two OpenEXR files
/// `TRANSLUX_FLIP_EXR` (with a space between, the reference first) as pair `files`.
#[test]
#[ignore = "for scripts/flip-reference"]
fn write_pairs() {
    let folder = std::env::var("TRANSLUX_FLIP_DUMP").unwrap();
    let mut pairs: Vec<(String, Pair)> = EXPECTED.iter().map(|row| (row.0.to_owned(), pair(row.0))).collect();
    if let Ok(files) = std::env::var("TRANSLUX_FLIP_EXR") {
        let pictures: Vec<Vec<ExrPlane>> =
            files.split_whitespace().map(|path| read_exr_channels(Path::new(path)).unwrap()).collect();
        let rgb = |planes: &[ExrPlane]| -> Vec<[f32; 3]> {
            let plane = |name| &planes.iter().find(|p| p.name == name).unwrap().samples;
            let (r, g, b) = (plane("diffuse.R"), plane("diffuse.G"), plane("diffuse.B"));
            r.iter().zip(g).zip(b).map(|((r, g), b)| [*r, *g, *b]).collect()
        };
        let (width, height) = (pictures[0][0].width, pictures[0][0].height);
        pairs = vec![("files".into(), Pair { width, height, reference: rgb(&pictures[0]), test: rgb(&pictures[1]) })];
    }
    for (name, pair) in pairs {
        let start = std::time::Instant::now();
        let found = pair.flip();
        println!("{name}: {:.3} s", start.elapsed().as_secs_f64());
        let write = |kind: &str, values: &[f32]| {
            let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
            std::fs::write(format!("{folder}/{name}.{}x{}.{kind}", pair.width, pair.height), bytes).unwrap();
        };
        write("reference", pair.reference.as_flattened());
        write("test", pair.test.as_flattened());
        write("found", &found.per_pixel);
    }
}

#[test]
fn equal_pictures_are_equal_everywhere() {
    for (name, ..) in EXPECTED {
        let mut equal = pair(name);
        equal.test = equal.reference.clone();
        let found = equal.flip();
        assert_eq!(found.mean, 0.0, "{name}");
        assert!(found.per_pixel.iter().all(|e| *e == 0.0), "{name}");
    }
}

#[test]
fn errors_stay_within_zero_and_one() {
    let mut extreme = pair("noise");
    for (i, (a, b)) in extreme.reference.iter_mut().zip(&mut extreme.test).enumerate() {
        // From the smallest to the largest number, both signs.
        let huge = [f32::MAX, f32::MIN_POSITIVE, 1e-45, 0.0, -1.0, f32::MIN, 1e30, -0.0][i % 8];
        *a = [huge, a[1], a[2] * 1e4];
        *b = [b[0], -b[1], huge * 0.5];
    }
    let [a, b] = extreme.pictures();
    for found in [hdr(&a, &b, &Settings::default()), hdr(&b, &a, &Settings::default())] {
        let found = found.unwrap();
        assert!((0.0..=1.0).contains(&found.mean));
        assert!(found.per_pixel.iter().all(|e| (0.0..=1.0).contains(e)));
        assert!(found.per_pixel.iter().any(|e| *e > 0.0));
    }
}

#[test]
fn negative_light_counts_as_none() {
    let mut negative = pair("colour");
    negative.test[5] = [-0.3, 0.2, -1e-3];
    let mut none = negative.clone();
    none.test[5] = [0.0, 0.2, 0.0];
    assert_eq!(negative.flip(), none.flip());
}

#[test]
fn a_black_reference_takes_the_exposures_of_the_test_picture() {
    let both = pair("black-test");
    let swapped = Pair { reference: both.test.clone(), test: both.reference.clone(), ..both };
    let (a, b) = (both.flip(), swapped.flip());
    assert_eq!((a.exposures.from, b.exposures.from), (ExposuresFrom::Reference, ExposuresFrom::Test));
    // The same exposures, and each exposure's figure is symmetric.
    assert_eq!((a.exposures.start, a.exposures.stop), (b.exposures.start, b.exposures.stop));
    assert_eq!(a.per_pixel, b.per_pixel);
    assert!(b.mean > 0.5);
}

#[test]
fn two_black_pictures_are_equal() {
    let black = Pair::new(9, 4, |_, _| [grey(0.0), grey(0.0)]);
    let found = black.flip();
    let exposures = Exposures { start: 0.0, stop: 0.0, count: 1, from: ExposuresFrom::Neither };
    assert_eq!((found.mean, found.exposures), (0.0, exposures));
    assert_eq!(found.per_pixel, [0.0; 36]);
    let negative = Pair::new(1, 1, |_, _| [grey(-1.0), grey(-0.5)]);
    assert_eq!(negative.flip().mean, 0.0);
}

#[test]
fn a_reference_darker_than_the_bound_has_one_exposure() {
    let dark = Pair::new(8, 8, |x, _| [grey(1e-12 * (x + 1.0)), grey(2e-12 * (x + 1.0))]);
    let found = dark.flip();
    assert_eq!((found.exposures.count, found.exposures.from), (1, ExposuresFrom::Reference));
    assert!(found.mean > 0.01 && found.mean < 1.0, "{}", found.mean);
}

#[test]
fn what_is_not_finite_is_an_error_that_says_where() {
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let mut pair = pair("constant");
        pair.test[7 + 2] = [0.0, bad, 0.0];
        let [a, b] = pair.pictures();
        let message = hdr(&a, &b, &Settings::default()).unwrap_err();
        assert_eq!(message.code(), ExitCode::InvalidInput);
        assert!(message.to_string().starts_with("the test picture is not finite at column 2, row 1"), "{message}");
        let message = hdr(&b, &a, &Settings::default()).unwrap_err().to_string();
        assert!(message.starts_with("the reference is not finite"), "{message}");
    }
}

#[test]
fn sizes_and_settings_are_checked() {
    let pair = pair("constant");
    let [a, b] = pair.pictures();
    let code = |a: &Picture, b: &Picture, s: &Settings| hdr(a, b, s).unwrap_err().code();
    let settings = Settings::default();
    let turned = Picture { width: 5, height: 7, ..b };
    assert_eq!(code(&a, &turned, &settings), ExitCode::InvalidInput);
    let empty = Picture { width: 0, height: 3, rgb: &[] };
    assert_eq!(code(&empty, &empty, &settings), ExitCode::InvalidInput);
    for (width, height) in [(7, 6), (usize::MAX, 2)] {
        let wrong = Picture { width, height, ..a };
        assert_eq!(code(&wrong, &wrong, &settings), ExitCode::InvalidInput);
    }
    for pixels_per_degree in [0.0, 0.5, 1001.0, f64::NAN, f64::INFINITY, -67.0] {
        let wrong = Settings { pixels_per_degree, ..settings };
        assert_eq!(code(&a, &b, &wrong), ExitCode::CommandLine, "{pixels_per_degree}");
    }
    for (start, stop, count) in [(f64::NAN, 0.0, 2), (0.0, 1e9, 2), (0.0, 1.0, 0), (0.0, 1.0, 1_000_000)] {
        let wrong = Exposures { start, stop, count, from: ExposuresFrom::Settings };
        let wrong = Settings { exposures: Some(wrong), ..settings };
        assert_eq!(code(&a, &b, &wrong), ExitCode::CommandLine);
    }
}

#[test]
fn any_viewing_distance_gives_figures() {
    let pair = pair("edge");
    let at = |pixels_per_degree| pair.with(&Settings { pixels_per_degree, exposures: None }).mean;
    for pixels_per_degree in [1.0, 2.0, 20.0, 67.0, 200.0, 1000.0] {
        let mean = at(pixels_per_degree);
        assert!(mean > 0.0 && mean < 1.0, "{pixels_per_degree}: {mean}");
    }
    // From far away fine grain is hard to see.
    let noise = self::pair("noise");
    let at = |pixels_per_degree| noise.with(&Settings { pixels_per_degree, exposures: None }).mean;
    assert!(at(200.0) < 0.5 * at(10.0), "{} {}", at(200.0), at(10.0));
}

#[test]
fn light_scales_exposures_and_not_errors() {
    let unit = pair("colour");
    let scaled = |rgb: &[[f32; 3]]| rgb.iter().map(|p| p.map(|v| v * 8.0)).collect::<Vec<_>>();
    let bright = Pair { reference: scaled(&unit.reference), test: scaled(&unit.test), ..unit.clone() };
    let (a, b) = (unit.flip(), bright.flip());
    assert!((a.exposures.start - b.exposures.start - 3.0).abs() < 1e-12);
    assert!((a.mean - b.mean).abs() < 1e-9, "{} {}", a.mean, b.mean);
}

#[test]
fn given_exposures_are_used() {
    let pair = pair("colour");
    let own = pair.flip();
    let Exposures { start, stop, count, .. } = own.exposures;
    let given = Exposures { start, stop, count, from: ExposuresFrom::Reference };
    let again = pair.with(&Settings { exposures: Some(given), ..Settings::default() });
    assert_eq!((again.per_pixel, again.exposures.from), (own.per_pixel, ExposuresFrom::Settings));
    let dark = Exposures { start: -20.0, stop: -20.0, count: 1, from: ExposuresFrom::Settings };
    let dark = pair.with(&Settings { exposures: Some(dark), ..Settings::default() });
    assert!(dark.mean < 1e-3 * own.mean.max(1.0) + 1e-2, "{}", dark.mean);
}

#[test]
fn a_mask_chooses_the_pixels_of_a_mean() {
    let found = pair("on-black").flip();
    let count = found.per_pixel.len();
    assert_eq!(found.mean_over(&vec![true; count]), Some(found.mean));
    assert_eq!(found.mean_over(&vec![false; count]), None);
    assert_eq!(found.mean_over(&[true]), None);
    let mask: Vec<bool> = (0..count).map(|i| i == 17 || i == 600).collect();
    let expected = (f64::from(found.per_pixel[17]) + f64::from(found.per_pixel[600])) / 2.0;
    assert_eq!(found.mean_over(&mask), Some(expected));
}

#[test]
fn threads_do_not_change_a_bit() {
    let pair = Pair::new(300, 130, |x, y| [surface(x, y), noise(x, y, 5)]);
    let on = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| pair.flip());
    let one = on(1);
    assert!(one.mean > 0.0);
    for threads in [2, 3, 8] {
        assert_eq!(on(threads), one, "{threads} threads");
    }
}
