//! Expected details of a light in the basis of the sample tree, which tell the details that matter.

use super::balanced_tree::{BalancedTree, LightDetails};

/// Weight of the mean square at the node itself; the rest is that of all nodes of its size, because other lights draw
/// their shadows elsewhere.
const OWN_SHARE: f64 = 0.5;

/// RMS over lights of the detail at each node over the mean irradiance of its part, by the name of the node.
///
/// Takes the first channel of each light. Without lights every detail counts as much as the mean.
pub fn expected_details(tree: &BalancedTree, parts: usize, samples: usize, lights: &[LightDetails]) -> Vec<f32> {
    let mut expected = vec![0.0; samples];
    for part in 0..parts {
        let Some(root) = tree.root(part) else { continue };
        // Depth first, so that nodes of one size are found by their depth.
        let mut nodes = Vec::new();
        let mut stack = vec![(root, 0usize)];
        while let Some((node, depth)) = stack.pop() {
            if !node.is_leaf() {
                nodes.push((node.name(), depth));
                stack.extend(node.children().map(|child| (child, depth + 1)));
            }
        }
        let lit: Vec<(&LightDetails, f64)> =
            lights.iter().map(|l| (l, f64::from(l.means[part][0]))).filter(|(_, mean)| *mean > 0.0).collect();
        if lit.is_empty() {
            nodes.iter().for_each(|&(name, _)| expected[name] = 1.0);
            continue;
        }
        let own = |name: usize| {
            lit.iter().map(|(l, mean)| (f64::from(l.details[name][0]) / mean).powi(2)).sum::<f64>() / lit.len() as f64
        };
        let squares: Vec<f64> = nodes.iter().map(|&(name, _)| own(name)).collect();
        let mut levels: Vec<(f64, f64)> = Vec::new();
        for (&(_, depth), square) in nodes.iter().zip(&squares) {
            levels.resize(levels.len().max(depth + 1), (0.0, 0.0));
            levels[depth].0 += square;
            levels[depth].1 += 1.0;
        }
        for (&(name, depth), square) in nodes.iter().zip(&squares) {
            let level = levels[depth].0 / levels[depth].1;
            expected[name] = (OWN_SHARE * square + (1.0 - OWN_SHARE) * level).sqrt() as f32;
        }
    }
    expected
}
