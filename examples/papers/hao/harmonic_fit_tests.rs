use super::*;
use translux::math::quadrature::gauss_legendre_const;
use translux::math::random::uniform;
use translux::math::sh::evaluate;

impl Fit {
    /// Projection by plain quadrature, `c_k = 4 pi / N Sum_i v_i y_k(direction_i)`: what the paper does for its uniform set. Its
    /// error falls with the number of directions, where that of [`Fit::new`] is the part beyond the order only.
    ///
    /// # Errors
    /// As [`Fit::new`], but fewer directions will do; at least one.
    fn quadrature(directions: &[DVec3], order: usize) -> Result<Self> {
        check(directions, order)?;
        let samples = directions.len();
        let mut matrix = transposed_harmonics(directions, order);
        matrix.iter_mut().for_each(|y| *y *= 4.0 * PI / samples as f64);
        Ok(Self { order, samples, matrix, condition: 1.0 })
    }

    /// The order.
    fn order(&self) -> usize {
        self.order
    }

    /// Number of directions.
    fn samples(&self) -> usize {
        self.samples
    }

    /// Condition number of the normal equations in the norm of row sums; 1 for quadrature.
    fn condition(&self) -> f64 {
        self.condition
    }

    /// `order^2` coefficients of the function with these values at the directions.
    ///
    /// # Errors
    /// Another number of values than directions (exit 3).
    fn coefficients(&self, values: &[f64]) -> Result<Vec<f64>> {
        if values.len() != self.samples {
            return Err(Error::input(format!("{} values for {} directions", values.len(), self.samples)));
        }
        Ok(self.matrix.chunks_exact(self.samples).map(|row| dot(row, values)).collect())
    }
}

impl Window {
    /// Every window.
    const ALL: [Self; 3] = [Self::None, Self::Lanczos, Self::Hanning];

    /// Multiplies `order^2` coefficients.
    fn apply(self, coefficients: &mut [f64]) {
        let order = coefficients.len().isqrt();
        for (i, c) in coefficients.iter_mut().enumerate() {
            *c *= self.factor(band(i), order);
        }
    }
}

/// A rule that is exact for polynomials of degree 2 * 32 on the sphere.
fn sphere() -> Vec<(DVec3, f64)> {
    const AROUND: usize = 66;
    let nodes = gauss_legendre_const::<33>();
    let angle = |i: usize| 2.0 * PI * (i as f64 + 0.3) / AROUND as f64;
    let point = |z: f64, i: usize| {
        let r = (1.0 - z * z).sqrt();
        DVec3::new(r * angle(i).cos(), r * angle(i).sin(), z)
    };
    nodes
        .iter()
        .flat_map(|node| (0..AROUND).map(move |i| (point(node.position, i), node.weight * 2.0 * PI / AROUND as f64)))
        .collect()
}

fn fibonacci(count: usize) -> Vec<DVec3> {
    let point = |i: usize| {
        let z = 1.0 - (2 * i + 1) as f64 / count as f64;
        let angle = i as f64 * PI * (3.0 - 5.0f64.sqrt());
        DVec3::new((1.0 - z * z).sqrt() * angle.cos(), (1.0 - z * z).sqrt() * angle.sin(), z)
    };
    (0..count).map(point).collect()
}

#[test]
fn fits_give_back_what_has_their_order() {
    assert_eq!((0..10).map(band).collect::<Vec<_>>(), [0, 1, 1, 1, 2, 2, 2, 2, 2, 3]);
    for (order, samples) in [(1, 1), (3, 30), (7, 200), (10, 250)] {
        let directions = fibonacci(samples);
        let weights: Vec<f64> = (0..samples as u64).map(|i| 0.5 + uniform(2, i, 0)).collect();
        let truth: Vec<f64> = (0..(order * order) as u64).map(|i| uniform(3, i, 0) - 0.5).collect();
        let values: Vec<f64> = directions.iter().map(|d| evaluate(&truth, *d)).collect();
        for weights in [None, Some(&weights[..])] {
            let fit = Fit::new(&directions, order, weights).unwrap();
            let found = fit.coefficients(&values).unwrap();
            assert_eq!((found.len(), fit.order(), fit.samples()), (order * order, order, samples));
            for (found, truth) in found.iter().zip(&truth) {
                assert!((found - truth).abs() < 1e-15 * fit.condition().max(10.0), "{order}: {found} {truth}");
            }
        }
        assert!(Fit::new(&directions, order, None).unwrap().coefficients(&values[1..]).is_err());
    }
    let exact: Vec<DVec3> = sphere().iter().map(|point| point.0).collect();
    let weights: Vec<f64> = sphere().iter().map(|point| point.1).collect();
    assert!(Fit::new(&exact, MOST_ORDER, Some(&weights)).unwrap().condition() < 1.0 + 1e-10);
}

/// At the least-squares solution the weighted residual is orthogonal to every harmonic.
#[test]
fn least_squares_is_better_than_quadrature() {
    let directions = fibonacci(200);
    let values: Vec<f64> = directions.iter().map(|d| d.x.max(0.0) + if d.y > 0.3 { 0.5 } else { 0.0 }).collect();
    let weights: Vec<f64> = (0..200).map(|i| 1.0 + f64::from(i % 3)).collect();
    let residuals = |fit: &Fit| -> Vec<f64> {
        let c = fit.coefficients(&values).unwrap();
        directions.iter().zip(&values).map(|(d, v)| v - evaluate(&c, *d)).collect()
    };
    let squares = |r: &[f64]| r.iter().map(|r| r * r).sum::<f64>();
    let weighted = residuals(&Fit::new(&directions, 7, Some(&weights)).unwrap());
    let mut sums = [0.0; 49];
    for ((d, r), w) in directions.iter().zip(&weighted).zip(&weights) {
        let mut y = [0.0; 49];
        real_sh(7, *d, &mut y);
        sums.iter_mut().zip(y).for_each(|(sum, y)| *sum += w * r * y);
    }
    assert!(sums.iter().all(|sum| sum.abs() < 1e-12), "{sums:?}");
    let plain = residuals(&Fit::new(&directions, 7, None).unwrap());
    let quadrature = residuals(&Fit::quadrature(&directions, 7).unwrap());
    assert!(squares(&plain) < squares(&weighted) && squares(&plain) < squares(&quadrature));
    assert!(squares(&quadrature) < 1.1 * squares(&plain));
    let constant = Fit::quadrature(&directions, 1).unwrap().coefficients(&[1.0; 200]).unwrap();
    assert!((constant[0] - (4.0 * PI).sqrt()).abs() < 1e-14);
}

#[test]
fn fits_that_cannot_be_are_refused() {
    let directions = fibonacci(100);
    assert!(Fit::new(&directions, 11, None).unwrap_err().message().contains("do not determine 121"));
    // Half a sphere determines order 10 on paper only.
    let half: Vec<DVec3> = fibonacci(4000).into_iter().filter(|d| d.z > 0.9).collect();
    assert!(Fit::new(&half, 10, None).is_err());
    assert!(Fit::new(&[DVec3::X; 50], 2, None).is_err());
    for order in [0, MOST_ORDER + 1, usize::MAX] {
        assert!(Fit::new(&directions, order, None).is_err() && Fit::quadrature(&directions, order).is_err());
    }
    for bad in [DVec3::ZERO, DVec3::NAN, DVec3::ONE, DVec3::INFINITY] {
        assert!(Fit::new(&[DVec3::X, bad], 1, None).is_err());
    }
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(Fit::new(&[DVec3::X, DVec3::Y], 1, Some(&[1.0, bad])).is_err());
    }
    assert!(Fit::new(&[DVec3::X], 1, Some(&[])).is_err() && Fit::quadrature(&[], 1).is_err());
}

/// A step rings; windows lower the undershoot at the price of the fit.
#[test]
fn windows_damp_ringing() {
    let directions = fibonacci(400);
    let values: Vec<f64> = directions.iter().map(|d| if d.z > 0.5 { 1.0 } else { 0.0 }).collect();
    for order in [3, 5, 7, 10] {
        let fit = Fit::new(&directions, order, None).unwrap();
        let measured = Window::ALL.map(|window| {
            let mut c = fit.coefficients(&values).unwrap();
            window.apply(&mut c);
            undershoot(directions.iter().map(|d| evaluate(&c, *d)))
        });
        assert!(
            measured[0] > 0.05 && measured[1] < 0.7 * measured[0] && measured[2] < 0.95 * measured[0],
            "{measured:?}"
        );
        println!("order {order}: {measured:?}");
    }
    assert_eq!(undershoot([]), 0.0);
    assert_eq!(undershoot([1.0, 0.0]), 0.0);
    assert_eq!(undershoot([2.0, -0.5]), 0.25);
    assert_eq!(undershoot([-1.0]), f64::INFINITY);
    for window in Window::ALL {
        assert_eq!((window.factor(0, 0), window.factor(0, 5)), (1.0, 1.0));
        assert!((1..5).all(|l| (0.0..=window.factor(l - 1, 5)).contains(&window.factor(l, 5))));
    }
    assert!((Window::Lanczos.factor(2, 4) - 2.0 / PI).abs() < 1e-15);
    assert!((Window::Hanning.factor(2, 4) - 0.5).abs() < 1e-15);
}

/// Times, for whoever changes this: `cargo test --release --example papers harmonic_fit::tests::speed -- --ignored --nocapture`.
#[test]
#[ignore = "prints times"]
fn speed() {
    for (order, samples) in [(7, 200), (16, 400), (24, 800), (MOST_ORDER, 1400)] {
        let directions = fibonacci(samples);
        let start = std::time::Instant::now();
        let fit = Fit::new(&directions, order, None).unwrap();
        let seconds = start.elapsed().as_secs_f64();
        println!("order {order}, {samples} directions: {seconds:.3} s, condition {:.3}", fit.condition());
    }
}
