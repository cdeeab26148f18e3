//! The Pareto front: rows that no other row beats in everything.

/// Indices of the points (cost, error) for which no other point is at most equal in both and smaller in one, by
/// ascending cost; the first of equal points.
pub fn pareto(points: &[(f64, f64)]) -> Vec<usize> {
    let mut order: Vec<usize> =
        (0..points.len()).filter(|&i| points[i].0.is_finite() && points[i].1.is_finite()).collect();
    order.sort_by(|&a, &b| points[a].0.total_cmp(&points[b].0).then(points[a].1.total_cmp(&points[b].1)));
    let mut best = f64::INFINITY;
    order.retain(|&i| {
        let better = points[i].1 < best;
        best = best.min(points[i].1);
        better
    });
    order
}

#[cfg(test)]
mod tests {
    use super::pareto;

    #[test]
    fn the_front_is_what_nothing_beats() {
        let points = [(3.0, 1.0), (1.0, 5.0), (2.0, 2.0), (2.0, 3.0), (4.0, 1.0), (0.5, 9.0), (f64::NAN, 0.0)];
        assert_eq!(pareto(&points), [5, 1, 2, 0]);
        assert_eq!(pareto(&[(1.0, 1.0), (1.0, 1.0)]), [0]);
        assert!(pareto(&[]).is_empty());
        for (i, p) in points.iter().enumerate().take(6) {
            let beaten = points.iter().any(|q| q.0 <= p.0 && q.1 <= p.1 && (q.0 < p.0 || q.1 < p.1));
            assert_eq!(pareto(&points).contains(&i), !beaten, "{p:?}");
        }
    }
}
