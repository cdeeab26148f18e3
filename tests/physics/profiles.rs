//! Radial profiles in the dipole's place, as users have them.
#![allow(clippy::unwrap_used, missing_docs)]

use std::collections::BTreeMap;

use crate::common::{Folder, relative_difference};
use glam::DVec3;
use translux::geometry::mesh::{Mesh, Placement};
use translux::geometry::shapes;
use translux::medium::material::preset;
use translux::medium::profiles::model::ProfileModel;

/// A measured profile: what a dipole of some medium would give, sampled.
fn csv() -> String {
    let channels = ProfileModel::Dipole.channels(&preset("skin1").unwrap().properties()).unwrap();
    let mut text = "# sampled\nr_mm,r,g,b\n".to_owned();
    for k in 0..400 {
        let r = 0.02 * 1.03f64.powi(k) - 0.02;
        let [red, green, blue] = channels.each_ref().map(|p| p.reflectance(r));
        text.push_str(&format!("{r},{red:e},{green:e},{blue:e}\n"));
    }
    text
}

fn ball() -> (Folder, Mesh) {
    let folder = Folder::new();
    let model = shapes::icosphere(4.0, 2);
    folder.obj("ball.obj", &model).write("measured.csv", csv());
    let (mesh, _) = Mesh::from_source(model, &Placement { mm_per_unit: 1.0 }).unwrap();
    (folder, mesh)
}

/// Where a vertex of the ball lies among the corners of the icosahedron that the ball was divided from, which are its first twelve
/// vertices: vertices of one place are turned or mirrored into each other with all triangles.
fn place(mesh: &Mesh, vertex: usize) -> [i64; 12] {
    let at = |v: usize| mesh.local_mm[v].as_dvec3();
    let mut cosines = [0; 12];
    cosines.iter_mut().enumerate().for_each(|(v, c)| *c = (1e4 * at(v).angle_between(at(vertex)).cos()).round() as i64);
    cosines.sort_unstable();
    cosines
}

/// On a convex body under constant light irradiance is the same everywhere: radiosities are to each other as the integrals of
/// the profiles over its triangles.
#[test]
fn radiosity_is_the_integral_of_the_profile() {
    let (folder, mesh) = ball();
    let integrals = |text: &str| -> Vec<DVec3> {
        let channels = ProfileModel::parse(text).unwrap().channels(&preset("skin1").unwrap().properties()).unwrap();
        let mut known: BTreeMap<[i64; 12], DVec3> = BTreeMap::new();
        let mut at = |v: usize| {
            let x = mesh.local_mm[v].as_dvec3();
            let sum = |c: usize| -> f64 {
                (0..mesh.triangles.len() as u32).map(|t| channels[c].triangle(x, mesh.corners_local_mm(t))).sum()
            };
            *known.entry(place(&mesh, v)).or_insert_with(|| DVec3::new(sum(0), sum(1), sum(2)))
        };
        (0..mesh.local_mm.len()).step_by(13).map(&mut at).collect()
    };
    let line =
        "reference ball.obj --unit mm --material skin1 --samples 2000 --light constant:radiance=1 --no-measure -q";
    folder.run(&format!("{line} -o dipole.ply")).ok();
    let dipole = (folder.radiosity("dipole.ply"), integrals("dipole"));
    let some = |values: &[DVec3]| values.iter().step_by(13).copied().collect::<Vec<DVec3>>();
    for profile in
        ["better-dipole", "photon-beam", "burley", "burley:fit=diffuse", "slab:thickness=1.5", "gaussians:skin"]
    {
        let integrals = integrals(profile);
        for method in ["reference", "two_pass"] {
            folder.run(&format!("{line} --method {method} --profile {profile} -o other.ply")).ok();
            let scaled: Vec<DVec3> = some(&dipole.0).iter().zip(&dipole.1).map(|(b, i)| *b / *i).collect();
            let expected: Vec<DVec3> = integrals.iter().zip(scaled).map(|(i, e)| *i * e).collect();
            let found = some(&folder.radiosity("other.ply"));
            let difference = relative_difference(&found, &expected);
            assert!(difference < 0.01, "{profile} {method}: {difference}");
            assert!(relative_difference(&found, &some(&dipole.0)) > 0.03, "{profile} {method}: no effect");
        }
    }
    // The table of a dipole stands for the dipole.
    folder.run(&format!("{line} --profile measured:path=measured.csv -o measured.ply")).ok();
    let difference = relative_difference(&folder.radiosity("measured.ply"), &dipole.0);
    assert!(difference < 0.01, "{difference}");
    let text = String::from_utf8_lossy(&folder.read("measured.ply")).into_owned();
    assert!(text.contains("material skin1 (measured:path=measured.csv)"), "{}", &text[..400]);
}

#[test]
fn a_profile_is_put_on_an_asset_that_stores_none() {
    let (folder, _) = ball();
    folder.run("bake ball.obj --unit mm --material skin1 --method two_pass --samples 2000 -o ball.tlux -q").ok();
    let sun = "--light directional:from=0.3,0.8,0.5:irradiance=3 -q";
    folder.run(&format!("evaluate ball.tlux {sun} -o dipole.ply --measure")).ok();
    folder.run(&format!("evaluate ball.tlux --profile dipole {sun} -o same.ply")).ok();
    assert!(folder.read("same.ply") == folder.read("dipole.ply"));
    // A slab that is thick against everything is a half space; of another medium it is that medium's.
    folder.run(&format!("evaluate ball.tlux --profile slab:thickness=10000 {sun} -o thick.ply")).ok();
    assert!(relative_difference(&folder.radiosity("thick.ply"), &folder.radiosity("dipole.ply")) < 0.01);
    folder
        .run(&format!("evaluate ball.tlux --material marble --profile slab:thickness=10000 {sun} -o marble.ply"))
        .ok();
    folder.run(&format!("evaluate ball.tlux --material marble {sun} -o dipole.ply")).ok();
    assert!(relative_difference(&folder.radiosity("marble.ply"), &folder.radiosity("dipole.ply")) < 0.01);
    let measured =
        folder.run(&format!("evaluate ball.tlux --profile burley {sun} --measure --json -o burley.ply")).ok();
    assert!(measured.json()["measured"]["entries"].as_array().is_some_and(|entries| !entries.is_empty()));
    folder
        .run(&format!("render ball.tlux --profile burley {sun} --resolution 16x16 --samples-per-pixel 1 -o p.exr"))
        .ok();
}

#[test]
fn what_has_no_place_for_a_profile_says_so() {
    let (folder, _) = ball();
    let sun = "--light constant:radiance=1 -q -o x.ply";
    folder.run("bake ball.obj --unit mm --material skin1 --method two_pass --samples 500 -o free.tlux -q").ok();
    folder.run("bake ball.obj --method editable --unit mm --material skin1 --set transport=stored --samples 500 -o stored.tlux -q").ok();
    folder
        .run(&format!("evaluate stored.tlux --profile burley {sun}"))
        .fails(5, &["dipoles", "--method editable stores none"]);
    folder.run(&format!("evaluate free.tlux --profile lambert {sun}")).fails(1, &["lambert", "better-dipole"]);
    folder.run(&format!("evaluate free.tlux --profile measured:path=no.csv {sun}")).fails(2, &["no.csv"]);
    folder.write("bad.csv", "r_mm,r,g,b\n0,1,1,1\n0,1,1,1\n");
    folder.run(&format!("evaluate free.tlux --profile bad.csv {sun}")).fails(3, &["bad.csv", "3"]);
    let walk = "reference ball.obj --unit mm --material skin1 --model monte-carlo --photons 1000 --profile burley";
    folder.run(&format!("{walk} {sun}")).fails(1, &["--profile"]);
    assert!(!folder.names().contains(&"x.ply".to_owned()));
}
