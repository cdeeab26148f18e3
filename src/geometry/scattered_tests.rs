use super::*;

/// Points of a sphere of radius 10 mm.
fn sphere(count: usize) -> Vec<OrientedPoint> {
    let of_index = |i: usize| {
        let z = 1.0 - (2 * i + 1) as f64 / count as f64;
        let (s, c) = (2.399_963_229_728_653 * i as f64).sin_cos();
        let normal = DVec3::new((1.0 - z * z).sqrt() * c, (1.0 - z * z).sqrt() * s, z);
        OrientedPoint { at_mm: 10.0 * normal, normal }
    };
    (0..count).map(of_index).collect()
}

fn smooth(p: &OrientedPoint) -> f64 {
    (0.3 * p.at_mm.x).sin() + (0.2 * p.at_mm.y).cos() * 0.1 * p.at_mm.z
}

#[test]
fn levels_are_nested_and_keep_their_distance() {
    let points = sphere(4000);
    let levels = choose(&points, 0.8);
    let mut all: Vec<u32> = Vec::new();
    for (level, members) in levels.iter().enumerate() {
        all.extend(members);
        let spacing = 0.8 * 2f64.powi((levels.len() - 1 - level) as i32);
        for (k, &i) in all.iter().enumerate() {
            for &j in &all[..k] {
                let d2 = distance2(&points[i as usize], &points[j as usize], NORMAL * spacing);
                assert!(d2 >= spacing * spacing * 0.999 || d2 >= 0.64, "{level}");
            }
        }
    }
    // Nothing else would fit.
    for p in &points {
        let near = all.iter().map(|&i| distance2(p, &points[i as usize], 0.4)).fold(f64::MAX, f64::min);
        assert!(near < 0.64 + 1e-9);
    }
    assert!(levels.len() >= 3 && all.len() > 800 && all.len() < 2200, "{} {}", levels.len(), all.len());
}

#[test]
fn weights_reproduce_constants_sources_and_smooth_values() {
    let points = sphere(6000);
    let mut errors = Vec::new();
    for spacing in [2.0, 1.0] {
        let chosen: Vec<u32> = choose(&points, spacing).concat();
        let sources: Vec<OrientedPoint> = chosen.iter().map(|&i| points[i as usize]).collect();
        let weights = Weights::new(&sources, &points, spacing, Kriging::RADIOSITY);
        let mut sum = 0.0;
        for (target, point) in points.iter().enumerate() {
            let total: f32 = weights.of(target).map(|(_, w)| w).sum();
            assert!((total - 1.0).abs() < 1e-5);
            let value: f64 = weights.of(target).map(|(s, w)| f64::from(w) * smooth(&sources[s as usize])).sum();
            sum += (value - smooth(point)).powi(2);
        }
        for (k, &i) in chosen.iter().enumerate() {
            assert_eq!(weights.of(i as usize).next(), Some((k as u32, 1.0)));
        }
        errors.push((sum / points.len() as f64).sqrt());
    }
    assert!(errors[0] < 0.02 && errors[1] < 0.5 * errors[0], "{errors:?}");
}

#[test]
fn the_other_side_of_a_sheet_is_far() {
    let side = |z: f64, normal: DVec3| {
        (0..400).map(move |i| OrientedPoint { at_mm: DVec3::new(f64::from(i % 20), f64::from(i / 20), z), normal })
    };
    let sources: Vec<OrientedPoint> = side(0.0, DVec3::NEG_Z).chain(side(0.1, DVec3::Z)).collect();
    let target = OrientedPoint { at_mm: DVec3::new(9.5, 9.5, 0.1), normal: DVec3::Z };
    let weights = Weights::new(&sources, &[target], 1.0, Kriging::RADIOSITY);
    let other: f32 = weights.of(0).filter(|(s, _)| *s < 400).map(|(_, w)| w.abs()).sum();
    assert!(other < 0.05, "{other}");
}

#[test]
fn odd_inputs_have_answers() {
    assert!(choose(&[], 1.0).concat().is_empty());
    let point = OrientedPoint { at_mm: DVec3::ONE, normal: DVec3::Z };
    let same = vec![point; 7];
    assert_eq!(choose(&same, 1.0).concat().len(), 1);
    for spacing in [0.0, f64::NAN, f64::INFINITY, 1e-300] {
        assert!(!choose(&same, spacing).concat().is_empty());
        let weights = Weights::new(&same, &same, spacing, Kriging::RADIOSITY);
        assert!(weights.values.iter().all(|w| w.is_finite()));
    }
    assert_eq!(Weights::new(&[], &same, 1.0, Kriging::RADIOSITY), Weights::default());
    let two = [point, OrientedPoint { at_mm: DVec3::ZERO, ..point }];
    let middle = OrientedPoint { at_mm: DVec3::splat(0.5), ..point };
    let weights: Vec<(u32, f32)> = Weights::new(&two, &[middle], 1.0, Kriging::RADIOSITY).of(0).collect();
    assert_eq!(weights.len(), 10);
    assert!((weights[0].1 - 0.5).abs() < 1e-6 && (weights[1].1 - 0.5).abs() < 1e-6 && weights[2].1 == 0.0);
    // Sources far away from where they are looked for.
    let far = OrientedPoint { at_mm: DVec3::splat(1e6), ..point };
    assert_eq!(
        Weights::new(&two, &[far], 1.0, Kriging { sources: 1, ..Kriging::RADIOSITY })
            .of(0)
            .map(|(_, w)| w)
            .sum::<f32>(),
        1.0
    );
}

#[test]
fn smooth_values_are_followed_off_a_rough_surface() {
    // Bumps of a tenth of the spacing; values that vary over four spacings, in space.
    let mut points = sphere(6000);
    for (i, p) in points.iter_mut().enumerate() {
        let bump = crate::math::random::uniform(3, i as u64, 0) - 0.5;
        *p = OrientedPoint { at_mm: p.at_mm + 0.1 * bump * p.normal, normal: DVec3::ZERO };
    }
    let spacing = 1.0;
    let sources: Vec<OrientedPoint> = choose(&points, spacing).concat().iter().map(|&i| points[i as usize]).collect();
    let value = |p: &OrientedPoint| (-p.at_mm.distance_squared(DVec3::new(0.0, 0.0, 10.0)) / 16.0).exp();
    let error = |fit: Kriging| {
        let weights = Weights::new(&sources, &points, spacing, fit);
        let square = |(target, point): (usize, &OrientedPoint)| {
            let found: f64 = weights.of(target).map(|(s, w)| f64::from(w) * value(&sources[s as usize])).sum();
            (found - value(point)).powi(2)
        };
        points.iter().enumerate().map(square).sum::<f64>().sqrt()
    };
    let (smooth, other) = (error(Kriging::SMOOTH), error(Kriging { sources: 32, ..Kriging::RADIOSITY }));
    assert!(smooth < 0.7 * other && smooth < 0.2 * error(Kriging::RADIOSITY), "{smooth:.1e} {other:.1e}");
    for fit in [Kriging::SMOOTH, Kriging { largest: 1.5, ..Kriging::SMOOTH }] {
        let weights = Weights::new(&sources, &points, spacing, fit);
        for target in 0..points.len() {
            let (sum, size) = weights.of(target).fold((0.0, 0.0), |(sum, size), (_, w)| (sum + w, size + w.abs()));
            assert!((sum - 1.0).abs() < 1e-4 && size < 8.01, "{sum} {size}");
        }
    }
}
