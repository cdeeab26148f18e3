//! The two passes of the paper: sparse irradiance rows of samples, and their sums through the tree.

use glam::DVec3;
use translux_format::rows::{FACES, IrradianceRows};

use super::evaluate::Rows;
use crate::compress::ledger::Ledger;
use crate::error::Result;
use crate::evaluate::stages::probe_points;
use crate::forms::baked_in::Stored;
use crate::forms::distant::{Choice, Distant, Work, under_suns};
use crate::light::Light;
use crate::light::cube_light::CubeLight;
use crate::light::sky::sky;
use crate::progress::{Progress, Silent};
use crate::transport::irradiance_rows::row::Keep;
use crate::transport::irradiance_rows::texels::TexelBaker;
use crate::transport::irradiance_rows::vectors::{RowTree, Selection, SparseRows, irradiance_rows};
use crate::transport::receivers::Receivers;

/// Coefficients of a sample or a node for each of a vertex, and their least number.
const MORE: usize = 2;
const LEAST: usize = 256;

/// Receivers that thresholds are found on.
const SOME: usize = 192;

/// Half of the largest number of thresholds that are tried.
const BISECTIONS: usize = 12;

/// Turns of the sky that expected light is taken from.
const TURNS: usize = 8;

/// Number of coefficients of each sample and node.
pub(super) fn of_sample(plan: &Distant) -> usize {
    (MORE * plan.row).max(LEAST).min(FACES * (plan.resolution().side() / 2).pow(2))
}

/// Transport vectors of all receivers.
pub(super) fn rows(work: &Work, ledger: &mut Ledger, progress: &dyn Progress) -> Result<IrradianceRows> {
    let (sampled, plan) = (work.sampled, work.plan);
    let surface = sampled.surface();
    let baker = TexelBaker::new(&surface, plan.resolution());
    let side = baker.side();
    let most = of_sample(plan);
    let rows = irradiance_rows(&baker, sampled.samples.len(), (plan.transform, most), progress)?;
    let tree = RowTree::new(work.transfer.gather(), &sampled.tree, &rows, side, most)?;
    let importance = match plan.choice {
        Choice::Magnitude => None,
        Choice::Light | Choice::Rate => Some(expected_light(side, plan)?),
    };
    let details = plan.row.saturating_sub(FACES);
    let keep = match plan.choice {
        Choice::Magnitude | Choice::Light => Keep::Largest(details),
        Choice::Rate => Keep::Above(threshold(work, &tree, details, importance.as_deref())?),
    };
    let selection = Selection { keep, importance: importance.as_deref() };
    let vectors = tree.vectors(&sampled.receivers, work.transfer.scheme(), selection, progress)?;
    measure(work, &rows, &tree, &vectors, ledger, progress)?;
    Ok(vectors)
}

/// Mean square of every coefficient of light: turns of the built-in sky, and as much energy in a sun anywhere.
pub(crate) fn expected_light(side: usize, plan: &Distant) -> Result<Vec<f32>> {
    let map = std::sync::Arc::new(sky());
    let energy = map.energy().element_sum() / 3.0;
    let mut squares = vec![0.0f64; FACES * side * side];
    for turn in 0..TURNS {
        let light = Light::environment(map.clone(), 360.0 * turn as f64 / TURNS as f64, DVec3::ONE)?;
        let cube = CubeLight::transformed(&light, side, plan.transform)?;
        for (sum, c) in squares.iter_mut().zip(cube.coefficients()) {
            let mean = f64::from(c[0] + c[1] + c[2]) / 3.0 * cube.scale() / energy;
            *sum += mean * mean / TURNS as f64;
        }
    }
    // A sun of the same energy anywhere: every orthonormal function has the mean square 1 / (4 pi).
    let sun = 0.25 / std::f64::consts::PI;
    Ok(squares.iter().map(|square| (square + sun) as f32).collect())
}

/// Energy above which `count` coefficients lie on average, on some receivers.
fn threshold(work: &Work, tree: &RowTree, count: usize, importance: Option<&[f32]>) -> Result<f32> {
    let (some, _) = work.sampled.receivers.subset(SOME, 0);
    let found = |energy: f32| -> Result<usize> {
        let selection = Selection { keep: Keep::Above(energy), importance };
        Ok(tree.vectors(&some, work.transfer.scheme(), selection, &Silent)?.indices.len())
    };
    let wanted = count * some.len();
    let (mut low, mut high) = (1e-30f64, 1e6f64);
    for _ in 0..BISECTIONS * 2 {
        let middle = (low * high).sqrt();
        if found(middle as f32)? > wanted {
            low = middle;
        } else {
            high = middle;
        }
        if high < 1.05 * low {
            break;
        }
    }
    Ok(high as f32)
}

/// Radiosity of receivers through the hierarchy, from the irradiance by rows.
fn through(work: &Work, rows: &SparseRows, light: &Light, receivers: &Receivers) -> Result<Vec<DVec3>> {
    let cube = CubeLight::transformed(light, (work.plan.resolution().side()) / 2, work.plan.transform)?;
    let channels = [0, 1, 2].map(|c| rows.under(cube.coefficients(), c));
    let of_sample = |i: usize| DVec3::new(channels[0][i], channels[1][i], channels[2][i]) * cube.scale();
    let irradiance: Vec<DVec3> = (0..rows.len()).map(of_sample).collect();
    let areas = vec![1.0; receivers.len()];
    Ok(work.transfer.towards(receivers, &areas).under(&irradiance))
}

/// Enters the error of each stage under lights that no choice saw, on some receivers.
fn measure(
    work: &Work,
    rows: &SparseRows,
    tree: &RowTree,
    vectors: &IrradianceRows,
    ledger: &mut Ledger,
    progress: &dyn Progress,
) -> Result<()> {
    work.enter_sampling(ledger, progress)?;
    let (some, points) = probe_points(&work.sampled.receivers, &work.sampled.areas);
    let all = Selection { keep: Keep::Largest(FACES * (tree.side() * tree.side() - 1)), importance: None };
    let whole = Rows::new(&tree.vectors(&some, work.transfer.scheme(), all, &Silent)?, work.plan.transform)?;
    let kept = Rows::new(vectors, work.plan.transform)?;
    let everything: Vec<u32> = (0..some.len() as u32).collect();
    let of_rows = |rows: &Rows, indices: &[u32], light: &Light| -> Result<Vec<DVec3>> {
        let cube = rows.light(std::slice::from_ref(light))?;
        let mut sums = Vec::new();
        rows.sums(&cube, &mut sums);
        let value = |&i: &u32| {
            let sum = sums.get(i as usize).map_or(DVec3::ZERO, |v| DVec3::new(v[0].into(), v[1].into(), v[2].into()));
            sum.max(DVec3::ZERO) * cube.scale
        };
        Ok(indices.iter().map(value).collect())
    };
    let values = |_, light: &Light| {
        let truth = work.transfer.towards(&some, &points.areas_mm2).under(&work.sampled.by_rays(light)?);
        let sampled = through(work, rows, light, &some)?;
        Ok([truth, sampled, of_rows(&whole, &everything, light)?, of_rows(&kept, &points.indices, light)?])
    };
    let (errors, suns) = work.errors(
        progress,
        values,
        |[truth, sampled, summed, stored]| {
            Ok([points.error(sampled, truth), points.error(summed, sampled), points.error(stored, summed)])
        },
        |[truth, .., stored]| points.error(stored, truth),
    )?;
    let count = of_sample(work.plan);
    ledger.add("irradiance rows", errors[0], format!("cube map and {count} coefficients of each sample, against rays"));
    ledger.add("tree", errors[1], format!("{count} coefficients of each node"));
    let per_vertex = vectors.indices.len() / vectors.patches().max(1) + FACES;
    ledger.add(
        "coefficients",
        errors[2],
        format!("{per_vertex} of each vertex in 8 bits; all of it {}", under_suns(suns)),
    );
    work.enter_sun(ledger, suns);
    Ok(())
}
