//! Poses: skins, morph targets and animations, and files that lie about them.

use std::path::Path;

use glam::{DQuat, DVec3};
use serde_json::json;

use super::super::poses::of_bytes;
use super::super::{Animated, PoseSampling};
use super::{Maker, SQUARE, square};
use crate::error::{ExitCode, Result};

impl Maker {
    fn poses(&self, frames: usize, animation: Option<&str>) -> Result<Animated> {
        of_bytes(&self.glb(), Path::new("made.glb"), PoseSampling { frames, animation })
    }

    fn refused(&self, fragment: &str) {
        let error = self.poses(3, None).unwrap_err();
        assert_eq!(error.code(), ExitCode::InvalidInput, "{error}");
        assert!(error.to_string().contains(fragment), "{error} does not say `{fragment}`");
    }
}

/// A square whose vertices 2 and 3 follow a joint at (0, 1, 0) that turns by 90 degrees about z within a second.
fn skinned() -> Maker {
    let mut maker = square();
    let joints = maker.accessor("VEC4", 5121, 4, &[0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0]);
    let weights = maker.floats("VEC4", 4, &[1., 0., 0., 0., 1., 0., 0., 0., 1., 0., 0., 0., 0.5, 0.5, 0., 0.]);
    let identity = [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0.];
    let inverse: Vec<f32> =
        [[0., 0., 0., 1.], [0., -1., 0., 1.]].iter().flat_map(|last| identity.iter().chain(last)).copied().collect();
    let inverse = maker.floats("MAT4", 16, &inverse);
    let half = 0.5f32.sqrt();
    let times = maker.floats("SCALAR", 1, &[0., 1.]);
    let turns = maker.floats("VEC4", 4, &[0., 0., 0., 1., 0., 0., half, half]);
    let json = &mut maker.json;
    json["meshes"][0]["primitives"][0]["attributes"]["JOINTS_0"] = json!(joints);
    json["meshes"][0]["primitives"][0]["attributes"]["WEIGHTS_0"] = json!(weights);
    // The transform of a skinned mesh's own node is not used.
    json["nodes"] = json!([
        {"mesh": 0, "skin": 0, "translation": [5, 5, 5]}, {"children": [2]}, {"translation": [0, 1, 0]}
    ]);
    json["scenes"] = json!([{"nodes": [0, 1]}]);
    json["skins"] = json!([{"joints": [1, 2], "inverseBindMatrices": inverse}]);
    json["animations"] = json!([{
        "name": "turn", "samplers": [{"input": times, "output": turns}],
        "channels": [{"sampler": 0, "target": {"node": 2, "path": "rotation"}}]
    }]);
    maker
}

#[test]
fn vertices_follow_their_joints() {
    let read = skinned().poses(3, Some("turn")).unwrap();
    assert_eq!(read.animation.as_deref(), Some("turn"));
    assert_eq!(read.model.warnings, [""; 0]);
    assert_eq!(read.poses.iter().map(|p| p.seconds).collect::<Vec<_>>(), [Some(0.0), Some(0.5), Some(1.0)]);
    for pose in &read.poses {
        let turn = DQuat::from_rotation_z(pose.seconds.unwrap() * std::f64::consts::FRAC_PI_2);
        let about = |p: DVec3| turn * (p - DVec3::Y) + DVec3::Y;
        let [a, b, c, d] =
            [0, 3, 6, 9].map(|i| DVec3::new(SQUARE[i].into(), SQUARE[i + 1].into(), SQUARE[i + 2].into()));
        // Vertex 3 has the same two joints: half of the second, which starts where the first slot says, and half of the first.
        let expected = [a, b, about(c), 0.5 * about(d) + 0.5 * d];
        for (place, expected) in pose.positions.iter().zip(expected) {
            assert!(place.distance(expected) < 1e-6, "{place} {expected}");
        }
    }
    assert_eq!(skinned().poses(1, Some("0")).unwrap().poses.len(), 1);
    let error = skinned().poses(3, Some("walk")).unwrap_err();
    assert!(error.code() == ExitCode::CommandLine && error.to_string().contains("'turn'"), "{error}");
    // Without an animation the joints stand where their nodes are.
    let mut still = skinned();
    still.json.as_object_mut().unwrap().remove("animations");
    let read = still.poses(3, None).unwrap();
    assert_eq!((read.poses.len(), read.poses[0].seconds), (1, None));
    assert!(read.poses[0].positions[2].distance(DVec3::new(1.0, 1.0, 0.0)) < 1e-6);
}

#[test]
fn morph_targets_and_nodes_move() {
    let mut maker = square();
    let up = maker.floats("VEC3", 3, &[0., 0., 1., 0., 0., 0., 0., 0., 0., 0., 0., 2.]);
    let times = maker.floats("SCALAR", 1, &[0.5, 1.5]);
    let weights = maker.floats("SCALAR", 1, &[0., 1.]);
    let steps = maker.floats("VEC3", 3, &[0., 0., 0., 3., 0., 0.]);
    maker.json["meshes"][0]["primitives"][0]["targets"] = json!([{"POSITION": up}]);
    maker.json["meshes"][0]["weights"] = json!([0.25]);
    let read = maker.poses(4, None).unwrap();
    assert_eq!(read.poses[0].positions[3], DVec3::new(0.0, 1.0, 0.5));
    assert_eq!(read.model.warnings, [""; 0]);
    maker.json["animations"] = json!([{
        "samplers": [{"input": times, "output": weights}, {"input": times, "output": steps, "interpolation": "STEP"}],
        "channels": [
            {"sampler": 0, "target": {"node": 0, "path": "weights"}},
            {"sampler": 1, "target": {"node": 0, "path": "translation"}}
        ]
    }]);
    let read = maker.poses(3, None).unwrap();
    let third: Vec<DVec3> = read.poses.iter().map(|pose| pose.positions[3]).collect();
    assert_eq!(third, [DVec3::new(0.0, 1.0, 0.0), DVec3::new(0.0, 1.0, 1.0), DVec3::new(3.0, 1.0, 2.0)]);
    assert_eq!(read.model.positions[3], DVec3::new(0.0, 1.0, 0.0));
}

#[test]
fn an_animation_of_no_length_is_one_pose() {
    let mut maker = skinned();
    maker.json["accessors"].as_array_mut().unwrap().iter_mut().rev().take(2).for_each(|a| a["count"] = json!(1));
    assert_eq!(maker.poses(8, None).unwrap().poses.len(), 1);
    let mut empty = skinned();
    empty.json["animations"] = json!([{"samplers": [], "channels": []}]);
    assert_eq!(empty.poses(8, None).unwrap().poses.len(), 1);
}

#[test]
fn what_lies_is_refused() {
    let attributes = |maker: &mut Maker, name: &str, index: usize| {
        maker.json["meshes"][0]["primitives"][0]["attributes"][name] = json!(index);
    };
    let mut far = skinned();
    let joints = far.accessor("VEC4", 5121, 4, &[0, 0, 0, 0, 0, 0, 0, 0, 7, 0, 0, 0, 1, 0, 0, 0]);
    attributes(&mut far, "JOINTS_0", joints);
    far.refused("vertex 2 follows joint 7");
    for (weight, fragment) in [(f32::NAN, "vertex 1 has the weight NaN"), (-1.0, "vertex 1 has the weight -1")] {
        let mut bad = skinned();
        let weights = bad.floats("VEC4", 4, &[1., 0., 0., 0., weight, 0., 0., 0., 1., 0., 0., 0., 1., 0., 0., 0.]);
        attributes(&mut bad, "WEIGHTS_0", weights);
        bad.refused(fragment);
    }
    let mut without = skinned();
    let weights = without.floats("VEC4", 4, &[0.; 16]);
    attributes(&mut without, "WEIGHTS_0", weights);
    assert!(without.poses(2, None).unwrap().model.warnings[0].contains("4 vertices have no weights"));

    for (path, value, fragment) in [
        ("/skins/0/joints/1", json!(9), "node 9"),
        ("/skins/0/joints", json!([]), "joints"),
        ("/skins/0/inverseBindMatrices", json!(0), "MAT4"),
        ("/nodes/0/skin", json!(4), "skin 4"),
        ("/scenes/0/nodes", json!([0]), "not in the scene"),
        ("/animations/0/samplers/0/input", json!(99), "does not exist"),
        ("/animations/0/samplers/0/input", json!(0), "SCALAR"),
        ("/animations/0/samplers/0/output", json!(0), "VEC4"),
        ("/animations/0/samplers/0/interpolation", json!("SPLINE"), "interpolation"),
        ("/animations/0/samplers/0/interpolation", json!("CUBICSPLINE"), "2 keys of 4 values"),
        ("/animations/0/channels/0/sampler", json!(3), "sampler"),
        ("/animations/0/channels/0/target/node", json!(77), "node 77"),
        ("/animations/0/channels/0/target/path", json!("colour"), "path"),
    ] {
        let mut maker = skinned();
        let (parent, key) = path.rsplit_once('/').unwrap();
        let parent = maker.json.pointer_mut(parent).unwrap();
        match parent.as_array_mut() {
            Some(list) => list[key.parse::<usize>().unwrap()] = value,
            None => parent[key] = value,
        }
        maker.refused(fragment);
    }
    for times in [[1.0, 1.0], [2.0, 1.0], [0.0, f32::INFINITY], [f32::NAN, 1.0]] {
        let mut maker = skinned();
        let input = maker.floats("SCALAR", 1, &times);
        maker.json["animations"][0]["samplers"][0]["input"] = json!(input);
        maker.refused("do not rise");
    }
    let mut zero = skinned();
    let output = zero.floats("VEC4", 4, &[0.; 8]);
    zero.json["animations"][0]["samplers"][0]["output"] = json!(output);
    zero.refused("is zero");
    let mut matrix = skinned();
    matrix.json["nodes"][2] = json!({"matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 1, 0, 1]});
    matrix.refused("has a matrix");
}
