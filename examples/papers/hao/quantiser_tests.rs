use super::*;
use translux::math::random::uniform;

impl Quantiser8 {
    /// Signal-to-noise ratio of quantised values in decibels, `10 log10(mean v^2 / mean (v - q(v))^2)` (Gersho & Gray 1992):
    /// infinite where nothing is lost, minus infinite where something is lost of zeros.
    fn signal_to_noise_db(&self, values: &[f32]) -> f64 {
        let (signal, noise) = (sum(values, f64::from), self.square_error(values));
        if noise > 0.0 { 10.0 * (signal / noise).log10() } else { f64::INFINITY }
    }
}

fn random(stage: u64, count: u64, f: impl Fn(f64) -> f64) -> Vec<f32> {
    (0..count).map(|i| f(uniform(stage, i, 0)) as f32).collect()
}

/// As `random`, evenly spread.
fn even(count: u64, f: impl Fn(f64) -> f64) -> Vec<f32> {
    (0..count).map(|i| f((i as f64 + 0.5) / count as f64) as f32).collect()
}

/// Normal numbers by Box & Muller from a Fibonacci lattice.
fn gaussian(count: u64) -> Vec<f32> {
    let angle = |i: u64| std::f64::consts::TAU * (i as f64 * 0.618_033_988_749_894_9).fract();
    let number = |i: u64| (-2.0 * ((i as f64 + 0.5) / count as f64).ln()).sqrt() * angle(i).cos();
    (0..count).map(|i| number(i) as f32).collect()
}

/// Laplacian numbers of variance 1.
fn laplacian(u: f64) -> f64 {
    let magnitude = -(1.0 - 2.0 * (u - 0.5).abs()).max(1e-300).ln() * std::f64::consts::FRAC_1_SQRT_2;
    magnitude * (u - 0.5).signum()
}

fn nearest_by_search(table: &[f32; LEVELS], value: f32) -> u8 {
    let distance = |i: &usize| (f64::from(table[*i]) - f64::from(value)).abs();
    (0..LEVELS).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap() as u8
}

#[test]
fn codes_are_those_of_the_nearest_entries() {
    let values = random(1, 3000, |u| laplacian(u) * 3.0);
    let mut narrow = Quantiser8::uniform(1.0, 1.000_01).unwrap();
    for quantiser in [
        Quantiser8::lloyd(&values).unwrap(),
        Quantiser8::uniform(-2.0, 5.0).unwrap(),
        Quantiser8::lloyd(&[-1.0, 0.0, 7.5]).unwrap(),
        Quantiser8::uniform(-f32::MAX, f32::MAX).unwrap(),
        narrow.clone(),
    ] {
        // Distances that the search can tell apart.
        let scale = if quantiser.table()[255] > 1e30 { 1e37 } else { 1.0 };
        let scaled = values.iter().map(|value| value * scale);
        for value in scaled.chain(*quantiser.table()).chain([30.0 * scale, -30.0 * scale]) {
            assert_eq!(quantiser.encode(value), nearest_by_search(quantiser.table(), value), "{value}");
        }
        for pair in quantiser.table().windows(2) {
            assert!(pair[0] <= pair[1]);
            let middle = (0.5 * (f64::from(pair[0]) + f64::from(pair[1]))) as f32;
            let told_apart = scale == 1.0 || middle.abs() > 1e30;
            for value in [middle.next_down(), middle, middle.next_up()].into_iter().filter(|_| told_apart) {
                assert_eq!(quantiser.encode(value), nearest_by_search(quantiser.table(), value), "{value}");
            }
        }
        assert_eq!([f32::NAN, f32::NEG_INFINITY].map(|v| quantiser.encode(v)), [0, 0]);
        assert_eq!(quantiser.decode(quantiser.encode(f32::INFINITY)), quantiser.table()[255]);
        let codes = quantiser.encode_all(&values);
        assert!(codes.iter().zip(&values).all(|(code, value)| *code == quantiser.encode(*value)));
    }
    narrow.table[3] = 0.0;
    assert!(Quantiser8::from_table(narrow.table()).is_err());
}

#[test]
fn bad_input_is_refused() {
    for values in [&[][..], &[1.0, f32::NAN], &[f32::INFINITY, 0.0], &[f32::NEG_INFINITY]] {
        assert!(Quantiser8::lloyd(values).is_err() && lloyd_levels(values, 8).is_err(), "{values:?}");
    }
    let mut many = vec![0.25f32; 200_000];
    many[150_001] = f32::NAN;
    assert!(Quantiser8::lloyd(&many).unwrap_err().message().contains("value 150001 to quantise is NaN"));
    assert!(lloyd_levels(&[1.0], 0).is_err());
    for (min, max) in [(1.0, 0.0), (f32::NAN, 0.0), (0.0, f32::INFINITY)] {
        assert!(Quantiser8::uniform(min, max).is_err());
    }
    assert!(Quantiser8::from_table(&[0.0; 255]).is_err() && Quantiser8::from_table(&[f32::NAN; 256]).is_err());
}

#[test]
fn up_to_256_different_values_are_exact() {
    for different in [1usize, 2, 3, 255, 256] {
        let values: Vec<f32> =
            (0..70_000).map(|i| laplacian(uniform(3, i % different as u64, 0)) as f32 - 0.0).collect();
        let quantiser = Quantiser8::lloyd(&values).unwrap();
        assert!(values.iter().all(|value| quantiser.decode(quantiser.encode(*value)) == *value), "{different}");
        assert_eq!(quantiser.signal_to_noise_db(&values), f64::INFINITY);
        assert_eq!(Quantiser8::from_table(quantiser.table()).unwrap(), quantiser);
    }
    assert_eq!(lloyd_levels(&[-0.0, 0.0, -0.0], 4).unwrap(), [0.0]);
    assert_eq!(Quantiser8::lloyd(&[0.0; 10]).unwrap().signal_to_noise_db(&[0.0; 10]), f64::INFINITY);
    assert_eq!(Quantiser8::lloyd(&[1.0]).unwrap().signal_to_noise_db(&[0.0; 10]), f64::NEG_INFINITY);
}

/// One outlier far away from crowded values, values within rounding of each other, the widest range there is.
#[test]
fn crowded_and_extreme_values_are_safe() {
    let mut crowded = random(4, 300_000, |u| 1e-3 * u);
    crowded.push(1e6);
    let quantiser = Quantiser8::lloyd(&crowded).unwrap();
    assert_eq!(quantiser.decode(quantiser.encode(1e6)), 1e6);
    let error = (quantiser.square_error(&crowded) / 3e5).sqrt();
    // 255 levels for a uniform density.
    assert!((error / (1e-3 / 255.0 / 12.0f64.sqrt()) - 1.0).abs() < 0.02, "{error:e}");
    let near: Vec<f32> = (0..400_000u32).map(|i| f32::from_bits(1.0f32.to_bits() + i % 700)).collect();
    assert!(Quantiser8::lloyd(&near).unwrap().square_error(&near) < 4e5 * 1.2e-7f64.powi(2));
    let wide: Vec<f32> = (0..1000u32).map(|i| f32::MAX * (i as f32 / 500.0 - 1.0)).collect();
    assert!(Quantiser8::lloyd(&wide).unwrap().signal_to_noise_db(&wide) > 48.0);
    let tiny: Vec<f32> = (0..150_000).map(|i| f32::from_bits(i % 1000)).collect();
    assert!(Quantiser8::lloyd(&tiny).unwrap().table().windows(2).all(|pair| pair[0] < pair[1]));
}

#[test]
fn a_uniform_density_gets_equal_steps() {
    let values = even(2_000_000, |u| u);
    let quantiser = Quantiser8::lloyd(&values).unwrap();
    for (i, level) in quantiser.table().iter().enumerate() {
        assert!((f64::from(*level) - (i as f64 + 0.5) / 256.0).abs() < 2e-5, "{i} {level}");
    }
    // mean u^2 = 1/3, noise step^2 / 12: 20 log10(256) + 10 log10(4).
    let expected = 20.0 * 256.0f64.log10() + 10.0 * 4.0f64.log10();
    assert!((quantiser.signal_to_noise_db(&values) - expected).abs() < 0.001);
}

/// Optimal levels for a variance of 1 (Max 1960; Paez & Glisson 1972).
#[test]
fn eight_levels_are_the_published_ones() {
    for (count, allowed) in [(100_000, 5e-3), (4_000_000, 1.5e-3)] {
        let cases = [
            (gaussian(count), [0.2451, 0.7560, 1.3439, 2.1520]),
            (even(count, laplacian), [0.2334, 0.8330, 1.6725, 3.0868]),
        ];
        for (values, published) in cases {
            let levels = lloyd_levels(&values, 8).unwrap();
            assert_eq!(levels.len(), 8);
            for (i, level) in published.iter().enumerate() {
                let found = [-f64::from(levels[3 - i]), f64::from(levels[4 + i])];
                assert!(found.iter().all(|found| (found - level).abs() < allowed), "{count} {level}: {found:?}");
            }
        }
    }
}

#[test]
fn never_worse_than_equal_steps() {
    let densities: [fn(f64) -> f64; 6] =
        [|u| u, |u| u * u, |u| u.powi(8), |u| (40.0 * u).sin(), laplacian, |u| if u < 0.9 { 0.0 } else { u }];
    for (stage, density) in densities.into_iter().enumerate() {
        for count in [300, 20_000, 300_000] {
            let values = random(10 + stage as u64, count, density);
            let (min, max) = range(&values).unwrap();
            let equal = Quantiser8::uniform(min, max).unwrap();
            let lloyd = Quantiser8::lloyd(&values).unwrap();
            assert!(lloyd.square_error(&values) <= equal.square_error(&values), "{stage} {count}");
            let gain = lloyd.signal_to_noise_db(&values) - equal.signal_to_noise_db(&values);
            let least = [0.0, 0.4, 2.0, 0.2, 5.0, 1.0][stage];
            assert!(gain >= least, "{stage} {count}: {gain} dB");
        }
    }
}

#[test]
fn threads_do_not_matter() {
    let values = random(20, 700_000, laplacian);
    let many = Quantiser8::lloyd(&values).unwrap();
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let (one, noise) = pool.install(|| (Quantiser8::lloyd(&values).unwrap(), many.square_error(&values)));
        assert_eq!(one, many);
        assert_eq!(noise.to_bits(), many.square_error(&values).to_bits());
    }
}

/// Times, for whoever changes this: `cargo test --release --lib quantiser::tests::speed -- --ignored --nocapture`.
#[test]
#[ignore = "prints times"]
fn speed() {
    for (name, density) in [("uniform", (|u| u) as fn(f64) -> f64), ("u^4", |u| u.powi(4)), ("laplacian", laplacian)] {
        for count in [100_000, 2_000_000, 30_000_000] {
            let values = random(30, count, density);
            let start = std::time::Instant::now();
            let levels = lloyd_levels(&values, 256).unwrap().len();
            let placing = start.elapsed().as_secs_f64();
            let start = std::time::Instant::now();
            let quantiser = Quantiser8::lloyd(&values).unwrap();
            let whole = start.elapsed().as_secs_f64();
            let start = std::time::Instant::now();
            let codes = quantiser.encode_all(&values).len();
            let coding = start.elapsed().as_secs_f64();
            let (min, max) = range(&values).unwrap();
            println!(
                "{name} {count}: {levels} levels in {:.0} ms, table in {:.0} ms, {:.0} M codes/s; {:.2} dB, equal steps {:.2} dB",
                1e3 * placing,
                1e3 * whole,
                1e-6 * codes as f64 / coding,
                quantiser.signal_to_noise_db(&values),
                Quantiser8::uniform(min, max).unwrap().signal_to_noise_db(&values)
            );
        }
    }
}
