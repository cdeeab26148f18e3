//! Animations: keys of translations, rotations, scales and weights of morph targets, and what they are at a time.

use std::collections::BTreeMap;

use glam::{DAffine3, DQuat, DVec3};
use gltf::json::Root;
use gltf::json::animation::{Animation as Stored, Interpolation, Property};
use gltf::json::validation::Checked;

use super::accessor::{Accessors, Role};
use super::document::node_label;
use super::nodes::Parts;
use crate::error::{Error, Result};

/// Largest number of values of the keys of one channel.
const MAX_VALUES: usize = 1 << 26;

/// What a node has at a time, where an animation says so.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Animated {
    /// Local transform of each animated node.
    pub(super) local: BTreeMap<usize, DAffine3>,
    /// Weights of the morph targets of the meshes of animated nodes.
    pub(super) weights: BTreeMap<usize, Vec<f64>>,
}

/// The keys of one property of one node.
struct Channel {
    node: usize,
    property: Property,
    interpolation: Interpolation,
    times: Vec<f64>,
    /// Values of the keys, `width` numbers each; with cubic splines three times as many: tangent in, value, tangent out.
    values: Vec<f64>,
    width: usize,
}

/// An animation, all of whose keys are checked.
pub(super) struct Animation {
    channels: Vec<Channel>,
    /// Transforms of the animated nodes without it.
    rest: BTreeMap<usize, Parts>,
    /// First and last time of a key, s.
    pub(super) range: [f64; 2],
}

/// The animation of a name, or the first; none where there are none and no name is asked for. The name may be a number from 0.
pub(super) fn chosen<'a>(root: &'a Root, name: Option<&str>) -> Result<Option<(String, &'a Stored)>> {
    let label = |index: usize, stored: &Stored| stored.name.clone().unwrap_or_else(|| index.to_string());
    let Some(name) = name else {
        return Ok(root.animations.first().map(|stored| (label(0, stored), stored)));
    };
    let by_name = root.animations.iter().position(|stored| stored.name.as_deref() == Some(name));
    let index = by_name.or_else(|| name.parse().ok().filter(|index| *index < root.animations.len()));
    if let Some((index, stored)) = index.and_then(|index| Some((index, root.animations.get(index)?))) {
        return Ok(Some((label(index, stored), stored)));
    }
    let known: Vec<String> = root.animations.iter().enumerate().map(|(i, a)| format!("'{}'", label(i, a))).collect();
    let known = if known.is_empty() { "none".to_owned() } else { known.join(", ") };
    Err(Error::command_line(format!("--animation {name}: the file has no such animation; it has {known}")))
}

impl Animation {
    /// Reads the keys of an animation; `targets` tells the number of morph targets of a node's mesh.
    pub(super) fn read(
        root: &Root,
        data: &Accessors<'_>,
        stored: &Stored,
        targets: impl Fn(usize) -> usize,
    ) -> Result<Self> {
        let mut result =
            Self { channels: Vec::new(), rest: BTreeMap::new(), range: [f64::INFINITY, f64::NEG_INFINITY] };
        for (index, channel) in stored.channels.iter().enumerate() {
            let at = |e: Error| e.at(format_args!("channel {index} of the animation"));
            let node = channel.target.node.value();
            let of_node = root.nodes.get(node);
            let of_node = of_node.ok_or_else(|| at(Error::input(format!("node {node} does not exist"))))?;
            let sampler = stored.samplers.get(channel.sampler.value());
            let sampler = sampler.ok_or_else(|| at(Error::input("its sampler does not exist")))?;
            let (Checked::Valid(property), Checked::Valid(interpolation)) =
                (channel.target.path, sampler.interpolation)
            else {
                return Err(at(Error::input("its path or its interpolation is not one of glTF's")));
            };
            if property != Property::MorphTargetWeights {
                if of_node.matrix.is_some() {
                    let message = format!("{} has a matrix, which no animation can change", node_label(node, of_node));
                    return Err(at(Error::input(message)));
                }
                result.rest.insert(node, Parts::of(of_node).map_err(at)?.0);
            }
            let times = data.elements(sampler.input.value(), Role::Times).map_err(at)?.floats::<1>();
            let times: Vec<f64> = times.into_iter().map(|[t]| f64::from(t)).collect();
            check_times(&times).map_err(at)?;
            let output = sampler.output.value();
            let flat = |role: Role| -> Result<(Vec<f64>, usize)> {
                let elements = data.elements(output, role)?;
                Ok(match role {
                    Role::AnimatedVector => (wide(elements.floats::<3>()), 3),
                    Role::AnimatedRotation => (wide(elements.floats::<4>()), 4),
                    _ => (wide(elements.floats::<1>()), targets(node)),
                })
            };
            let (values, width) = flat(match property {
                Property::Translation | Property::Scale => Role::AnimatedVector,
                Property::Rotation => Role::AnimatedRotation,
                Property::MorphTargetWeights => Role::AnimatedWeights,
            })
            .map_err(at)?;
            let each = if interpolation == Interpolation::CubicSpline { 3 } else { 1 };
            let needed = times.len().saturating_mul(width).saturating_mul(each);
            if values.len() != needed || needed > MAX_VALUES {
                let (there, keys) = (values.len(), times.len());
                return Err(at(Error::input(format!(
                    "{there} numbers for {keys} keys of {width} values, not {needed}"
                ))));
            }
            if values.iter().any(|value| !value.is_finite()) {
                return Err(at(Error::input("a value of its keys is not finite")));
            }
            let [first, last] = result.range;
            result.range = [first.min(times[0]), last.max(times[times.len() - 1])];
            result.channels.push(Channel { node, property, interpolation, times, values, width });
        }
        if result.channels.is_empty() {
            result.range = [0.0; 2];
        }
        Ok(result)
    }

    /// What animated nodes have at a time, s; before the first key and after the last what that says.
    ///
    /// # Errors
    /// Invalid input: rotations that no direction is left of.
    pub(super) fn at(&self, seconds: f64) -> Result<Animated> {
        let mut parts = self.rest.clone();
        let mut result = Animated::default();
        for channel in &self.channels {
            let values = channel.at(seconds);
            let own = parts.get_mut(&channel.node);
            match (channel.property, own, values.as_slice()) {
                (Property::Translation, Some(own), &[x, y, z]) => own.translation = DVec3::new(x, y, z),
                (Property::Scale, Some(own), &[x, y, z]) => own.scale = DVec3::new(x, y, z),
                (Property::Rotation, Some(own), &[x, y, z, w]) => {
                    let turn = DQuat::from_xyzw(x, y, z, w);
                    let length = turn.length();
                    if !(length.is_finite() && length > 0.0) {
                        let node = channel.node;
                        return Err(Error::input(format!(
                            "the rotation of node {node} at {seconds} s is zero or not finite"
                        )));
                    }
                    own.rotation = turn / length;
                }
                (Property::MorphTargetWeights, ..) => drop(result.weights.insert(channel.node, values)),
                _ => {}
            }
        }
        result.local = parts.into_iter().map(|(node, parts)| (node, parts.together())).collect();
        Ok(result)
    }
}

impl Channel {
    /// The value of a key: its tangent in (0), itself (1) or its tangent out (2).
    fn key(&self, key: usize, which: usize) -> &[f64] {
        let (each, which) = if self.interpolation == Interpolation::CubicSpline { (3, which) } else { (1, 0) };
        let first = (key * each + which) * self.width;
        self.values.get(first..first + self.width).unwrap_or_default()
    }

    fn at(&self, seconds: f64) -> Vec<f64> {
        // Times rise, and there is one at least.
        let after = self.times.partition_point(|t| *t <= seconds);
        let last = self.times.len() - 1;
        if after == 0 || after > last {
            return self.key(after.min(last), 1).to_vec();
        }
        let (from, to) = (after - 1, after);
        let span = self.times[to] - self.times[from];
        let share = (seconds - self.times[from]) / span;
        let (a, b) = (self.key(from, 1), self.key(to, 1));
        match self.interpolation {
            Interpolation::Step => a.to_vec(),
            Interpolation::Linear if self.property == Property::Rotation => slerp(a, b, share),
            Interpolation::Linear => a.iter().zip(b).map(|(a, b)| a + share * (b - a)).collect(),
            Interpolation::CubicSpline => {
                let (s, s2, s3) = (share, share * share, share * share * share);
                let tangents = self.key(from, 2).iter().zip(self.key(to, 0));
                let of = |((a, b), (out, into)): ((&f64, &f64), (&f64, &f64))| {
                    (2.0 * s3 - 3.0 * s2 + 1.0) * a
                        + span * (s3 - 2.0 * s2 + s) * out
                        + (3.0 * s2 - 2.0 * s3) * b
                        + span * (s3 - s2) * into
                };
                a.iter().zip(b).zip(tangents).map(of).collect()
            }
        }
    }
}

/// The shorter way from one rotation to another, whatever their lengths.
fn slerp(a: &[f64], b: &[f64], share: f64) -> Vec<f64> {
    match (a, b) {
        (&[ax, ay, az, aw], &[bx, by, bz, bw]) => {
            let [a, b] = [DQuat::from_xyzw(ax, ay, az, aw), DQuat::from_xyzw(bx, by, bz, bw)];
            let (from, to) = (a.length(), b.length());
            if from == 0.0 || to == 0.0 {
                return vec![0.0; 4];
            }
            (a / from).slerp(b / to, share).to_array().to_vec()
        }
        _ => Vec::new(),
    }
}

fn check_times(times: &[f64]) -> Result<()> {
    if times.is_empty() {
        return Err(Error::input("it has no keys"));
    }
    let rise = times.windows(2).all(|pair| matches!(pair, [a, b] if a < b));
    if !rise || times.iter().any(|t| !t.is_finite()) {
        return Err(Error::input("the times of its keys do not rise, or are not finite"));
    }
    Ok(())
}

fn wide<const N: usize>(values: Vec<[f32; N]>) -> Vec<f64> {
    values.into_flattened().into_iter().map(f64::from).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn channel(interpolation: Interpolation, property: Property, values: &[f64], width: usize) -> Channel {
        Channel { node: 0, property, interpolation, times: vec![1.0, 3.0], values: values.to_vec(), width }
    }

    #[test]
    fn keys_are_met_and_what_is_between_follows_the_interpolation() {
        use Interpolation::{CubicSpline, Linear, Step};
        let linear = channel(Linear, Property::Translation, &[0.0, 0.0, 0.0, 2.0, 4.0, -2.0], 3);
        assert_eq!(linear.at(0.0), [0.0; 3]);
        assert_eq!(linear.at(1.5), [0.5, 1.0, -0.5]);
        assert_eq!([linear.at(3.0), linear.at(9.0)], [[2.0, 4.0, -2.0]; 2]);
        let step = channel(Step, Property::MorphTargetWeights, &[1.0, 5.0], 1);
        assert_eq!([step.at(2.9), step.at(3.0)], [[1.0], [5.0]]);
        // The cubic of these ends and tangents is t^2 with t from 1: values 0 and 4, tangents 0 and 4.
        let cubic = channel(CubicSpline, Property::Scale, &[9.0, 0.0, 0.0, 4.0, 4.0, 9.0], 1);
        for t in [0.0, 0.5, 1.2, 2.0] {
            assert!((cubic.at(1.0 + t)[0] - t * t).abs() < 1e-12, "{t}");
        }
        // Quarter of a turn about z, the long way round in the file.
        let root = 0.5f64.sqrt();
        let turn = channel(Linear, Property::Rotation, &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -root, -root], 4);
        let half = DQuat::from_rotation_z(0.25 * std::f64::consts::FRAC_PI_2 * 2.0);
        let there = turn.at(2.0);
        let there = DQuat::from_xyzw(there[0], there[1], there[2], there[3]);
        assert!(there.dot(half).abs() > 1.0 - 1e-12);
    }
}
