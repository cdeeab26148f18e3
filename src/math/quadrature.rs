//! Gauss-Legendre quadrature and an adaptive integrator for tests and tables.
//!
//! Everything here is f64 and deterministic: the same integrand gives the same bits on every run and thread.

/// A node of a quadrature rule on [-1, 1].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Node {
    /// Abscissa at which the integrand is evaluated, in (-1, 1).
    pub position: f64,
    /// Its weight; the weights of a rule sum to 2.
    pub weight: f64,
}

/// The largest order that [`gauss_legendre_cached`] holds.
pub const LARGEST_CACHED_ORDER: usize = 16;

/// cos(x) for x in [0, pi/2] by its Taylor series, for constant evaluation.
const fn const_cosine(x: f64) -> f64 {
    let (mut term, mut sum, mut k) = (1.0, 1.0, 1);
    while k <= 12 {
        term *= -x * x / ((2 * k - 1) as f64 * (2 * k) as f64);
        sum += term;
        k += 1;
    }
    sum
}

/// P_n(x) and P_n'(x) by the three-term recurrence, |x| < 1.
const fn legendre(n: usize, x: f64) -> (f64, f64) {
    let (mut previous, mut current, mut k) = (1.0, x, 1);
    while k < n {
        let k_real = k as f64;
        let next = ((2.0 * k_real + 1.0) * x * current - k_real * previous) / (k_real + 1.0);
        previous = current;
        current = next;
        k += 1;
    }
    (current, n as f64 * (previous - x * current) / ((1.0 - x) * (1.0 + x)))
}

/// The `i`-th positive node of the rule of order `n` (0 is nearest to 1), for i < (n + 1) / 2.
const fn positive_node(n: usize, i: usize) -> Node {
    if 2 * i + 1 == n {
        let (_, derivative) = legendre(n, 0.0);
        return Node { position: 0.0, weight: 2.0 / (derivative * derivative) };
    }
    let order = n as f64;
    // Tricomi's estimate is close enough for Newton's steps to stay with the same root.
    let angle = std::f64::consts::PI * (i as f64 + 0.75) / (order + 0.5);
    let mut x = (1.0 - (order - 1.0) / (8.0 * order * order * order)) * const_cosine(angle);
    let mut step = 0;
    while step < 6 {
        let (value, derivative) = legendre(n, x);
        x -= value / derivative;
        step += 1;
    }
    let (_, derivative) = legendre(n, x);
    Node { position: x, weight: 2.0 / ((1.0 - x) * (1.0 + x) * derivative * derivative) }
}

const NO_NODE: Node = Node { position: 0.0, weight: 0.0 };

/// Writes the rule of as many nodes as there are.
const fn write_rule(rule: &mut [Node]) {
    let mut i = 0;
    while 2 * i < rule.len() {
        let node = positive_node(rule.len(), i);
        rule[i] = Node { position: -node.position, weight: node.weight };
        rule[rule.len() - 1 - i] = node;
        i += 1;
    }
}

/// Gauss-Legendre rule with `N` nodes in ascending order, at compile time; exact for polynomials of degree 2N - 1.
pub const fn gauss_legendre_const<const N: usize>() -> [Node; N] {
    let mut nodes = [NO_NODE; N];
    write_rule(&mut nodes);
    nodes
}

/// Gauss-Legendre rule with `order` nodes in ascending order; exact for polynomials of degree 2 * order - 1.
/// Empty for order 0.
pub fn gauss_legendre(order: usize) -> Vec<Node> {
    let mut nodes = vec![NO_NODE; order];
    write_rule(&mut nodes);
    nodes
}

const CACHED_COUNT: usize = LARGEST_CACHED_ORDER * (LARGEST_CACHED_ORDER + 1) / 2;

static CACHED: [Node; CACHED_COUNT] = {
    let mut all = [NO_NODE; CACHED_COUNT];
    let (mut order, mut first) = (1, 0);
    while order <= LARGEST_CACHED_ORDER {
        let (_, rest) = all.split_at_mut(first);
        write_rule(rest.split_at_mut(order).0);
        first += order;
        order += 1;
    }
    all
};

/// The rule of [`gauss_legendre`] from a table that the compiler made; `order` is clamped to
/// 1..=[`LARGEST_CACHED_ORDER`].
pub fn gauss_legendre_cached(order: usize) -> &'static [Node] {
    let order = order.clamp(1, LARGEST_CACHED_ORDER);
    let first = order * (order - 1) / 2;
    &CACHED[first..first + order]
}

/// `Int_a^b f` with a rule on [-1, 1].
pub fn integrate_with(rule: &[Node], a: f64, b: f64, mut f: impl FnMut(f64) -> f64) -> f64 {
    let (centre, half) = (0.5 * (a + b), 0.5 * (b - a));
    half * rule.iter().map(|n| n.weight * f(centre + half * n.position)).sum::<f64>()
}

/// Positive nodes of the 15-point Kronrod rule from the outermost to 0, their weights, and the weights of the 7-point
/// Gauss rule that sits on every second of them (Piessens et al., QUADPACK, 1983, routine QK15).
#[rustfmt::skip]
const KRONROD: [(f64, f64, f64); 8] = [
    (0.991_455_371_120_812_6, 0.022_935_322_010_529_224, 0.0),
    (0.949_107_912_342_758_5, 0.063_092_092_629_978_56, 0.129_484_966_168_869_7),
    (0.864_864_423_359_769_1, 0.104_790_010_322_250_18, 0.0),
    (0.741_531_185_599_394_4, 0.140_653_259_715_525_92, 0.279_705_391_489_276_64),
    (0.586_087_235_467_691_1, 0.169_004_726_639_267_9, 0.0),
    (0.405_845_151_377_397_2, 0.190_350_578_064_785_4, 0.381_830_050_505_118_9),
    (0.207_784_955_007_898_47, 0.204_432_940_075_298_9, 0.0),
    (0.0, 0.209_482_141_084_727_82, 0.417_959_183_673_469_4),
];

/// The 15-point Kronrod value of `Int_a^b f` and its distance from the embedded 7-point Gauss value.
fn kronrod(f: &mut impl FnMut(f64) -> f64, a: f64, b: f64) -> (f64, f64) {
    let (centre, half) = (0.5 * (a + b), 0.5 * (b - a));
    let (mut fine, mut coarse) = (0.0, 0.0);
    for (position, weight, gauss_weight) in KRONROD {
        let pair = if position == 0.0 { f(centre) } else { f(centre - half * position) + f(centre + half * position) };
        fine += weight * pair;
        coarse += gauss_weight * pair;
    }
    (half * fine, (half * (fine - coarse)).abs())
}

/// Intervals after which [`integrate`] accepts the sum reached.
const MOST_INTERVALS: usize = 50_000;

/// Halvings after which an interval is accepted: its width is then 2^-48 of the whole.
const DEEPEST_HALVING: u32 = 48;

/// `Int_a^b f` by adaptive Gauss-Kronrod (7, 15) with bisection, to the absolute `tolerance` or to rounding, whichever is larger.
///
/// Kinks and integrable singularities at the ends converge as well, only slower; the ends themselves are never evaluated.
/// The work is bounded: an integrand that no bisection resolves gives the best value reached after
/// a fixed number of intervals.
pub fn integrate(mut f: impl FnMut(f64) -> f64, a: f64, b: f64, tolerance: f64) -> f64 {
    let mut pending = vec![(a, b, 0_u32)];
    let (mut sum, mut compensation, mut seen) = (0.0_f64, 0.0_f64, 0_usize);
    while let Some((left, right, depth)) = pending.pop() {
        let (value, difference) = kronrod(&mut f, left, right);
        seen += 1;
        let share = tolerance * 0.5_f64.powi(depth.min(1000) as i32);
        let rounding = 4.0 * f64::EPSILON * value.abs();
        if difference <= share.max(rounding) || depth >= DEEPEST_HALVING || seen >= MOST_INTERVALS {
            let corrected = value - compensation;
            let next = sum + corrected;
            compensation = (next - sum) - corrected;
            sum = next;
        } else {
            let middle = 0.5 * (left + right);
            pending.push((middle, right, depth + 1));
            pending.push((left, middle, depth + 1));
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    fn monomial(rule: &[Node], degree: i32) -> f64 {
        rule.iter().map(|n| n.weight * n.position.powi(degree)).sum()
    }

    fn exact_monomial(degree: i32) -> f64 {
        if degree % 2 == 0 { 2.0 / f64::from(degree + 1) } else { 0.0 }
    }

    #[test]
    fn gauss_rules_integrate_polynomials_up_to_their_degree_and_no_further() {
        for order in 1..=40_usize {
            let rule = gauss_legendre(order);
            assert_eq!(rule.len(), order);
            let highest = 2 * order as i32 - 1;
            for degree in 0..=highest {
                assert!((monomial(&rule, degree) - exact_monomial(degree)).abs() < 2e-14, "{order} {degree}");
            }
            if order <= 10 {
                assert!((monomial(&rule, highest + 1) - exact_monomial(highest + 1)).abs() > 1e-7, "{order}");
            }
            assert!(rule.windows(2).all(|w| w[0].position < w[1].position));
        }
    }

    #[test]
    fn large_orders_keep_their_accuracy() {
        for order in [64, 257, 1000, 3000] {
            let rule = gauss_legendre(order);
            assert!((monomial(&rule, 0) - 2.0).abs() < 1e-12, "{order}");
            let value = integrate_with(&rule, 0.0, 1.0, |x| (20.0 * x).cos());
            assert!((value - 20.0_f64.sin() / 20.0).abs() < 1e-13, "{order}");
        }
    }

    #[test]
    fn tables_equal_the_computed_rules() {
        for order in 1..=LARGEST_CACHED_ORDER {
            let computed = gauss_legendre(order);
            for (a, b) in gauss_legendre_cached(order).iter().zip(&computed) {
                assert!((a.position - b.position).abs() < 1e-15 && (a.weight - b.weight).abs() < 1e-15, "{order}");
            }
        }
        const FIVE: [Node; 5] = gauss_legendre_const::<5>();
        assert_eq!(&FIVE[..], gauss_legendre_cached(5));
        assert_eq!(gauss_legendre_cached(0).len(), 1);
        assert_eq!(gauss_legendre_cached(99).len(), LARGEST_CACHED_ORDER);
        assert!(gauss_legendre(0).is_empty());
    }

    #[test]
    fn three_point_rule_is_the_textbook_one() {
        let rule = gauss_legendre(3);
        assert!((rule[2].position - 0.6_f64.sqrt()).abs() < 1e-16);
        assert!((rule[2].weight - 5.0 / 9.0).abs() < 1e-15);
        assert_eq!(rule[1].position, 0.0);
        assert!((rule[1].weight - 8.0 / 9.0).abs() < 1e-15);
    }

    #[test]
    fn kronrod_rule_has_degree_twenty_two() {
        for degree in 0..=23 {
            let (value, _) = kronrod(&mut |x: f64| x.powi(degree), -1.0, 1.0);
            assert!((value - exact_monomial(degree)).abs() < 1e-15, "{degree}");
        }
        let (value, difference) = kronrod(&mut |x: f64| x.powi(24), -1.0, 1.0);
        assert!((value - exact_monomial(24)).abs() > 1e-10);
        assert!(difference > 1e-6);
    }

    #[test]
    fn adaptive_integrator_reaches_its_tolerance_on_hard_integrands() {
        let arctangent = integrate(|x| 1e-4 / (1e-8 + x * x), -1.0, 1.0, 1e-12);
        assert!((arctangent - 2.0 * 1e4_f64.atan()).abs() < 1e-11);
        assert!((integrate(f64::sqrt, 0.0, 1.0, 1e-13) - 2.0 / 3.0).abs() < 1e-12);
        assert!((integrate(|x| 1.0 / x.sqrt(), 0.0, 1.0, 1e-12) - 2.0).abs() < 1e-6);
        assert!((integrate(|x| (x - 0.3).abs(), 0.0, 1.0, 1e-13) - 0.29).abs() < 1e-12);
        assert!((integrate(f64::exp, 1.0, -1.0, 1e-13) + 2.0 * 1.0_f64.sinh()).abs() < 1e-13);
        assert_eq!(integrate(f64::exp, 1.0, 1.0, 1e-13), 0.0);
    }

    #[test]
    fn adaptive_integrator_ends_on_noise() {
        let noise = integrate(|x| crate::math::random::uniform(3, x.to_bits(), 0), 0.0, 1.0, 1e-300);
        assert!((noise - 0.5).abs() < 0.05);
    }
}
