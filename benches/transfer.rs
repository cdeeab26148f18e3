//! Speed of the transfer's inner loops on one core: pairs of a sample and a receiver, and triangles in closed form.
//!
//! `cargo bench --bench transfer`. Best of many short runs, so other load matters little.

use std::hint::black_box;
use std::sync::Arc;
use std::time::Instant;

use glam::DVec3;
use translux::math::random::uniform;
use translux::math::simd::InstructionSet;
use translux::medium::fresnel::BoundaryFit;
use translux::medium::material::preset;
use translux::medium::profile::Profile;
use translux::transport::kernel::medium::MediumKernel;
use translux::transport::kernel::{Block, FlatSource, PointSource, Receiver};

/// Pairs of a second, a core and a channel that the project asks for.
const TARGET: f64 = 1e9;

fn main() {
    let Some(marble) = preset("marble") else { return };
    let dipoles = marble.properties().dipoles(BoundaryFit::Published);
    let kernel = MediumKernel::of_dipoles(dipoles);
    let free_path = dipoles[1].z_real_mm;
    let mut widest = 0.0;
    for level in InstructionSet::available() {
        for receivers in [16, 64] {
            let block = block_of(receivers, free_path);
            let pairs = points(&block, receivers, free_path, |b, sources| {
                kernel.add_points(level, b, sources);
            });
            println!("{level:?}, blocks of {receivers}: {:.2} G pairs/s a channel", pairs * 1e-9);
            widest = f64::max(widest, pairs);
            for size in [0.5, 2.0, 5.0, 20.0, 200.0] {
                let nanoseconds = triangles(&block, receivers, size * free_path, |b, sources| {
                    kernel.add_triangles(level, b, sources);
                });
                println!(
                    "{level:?}, blocks of {receivers}: triangle of {size} mean free paths {nanoseconds:.1} ns RGB"
                );
            }
        }
    }
    // The same dipoles as any profile is evaluated.
    let table = MediumKernel::of_profiles(dipoles.map(|d| Arc::new(d) as Arc<dyn Profile>), 100.0 * free_path);
    for level in InstructionSet::available() {
        let block = block_of(16, free_path);
        let pairs = points(&block, 16, free_path, |b, sources| {
            table.add_points(level, b, sources);
        });
        println!("{level:?}, tables: {:.2} G pairs/s a channel", pairs * 1e-9);
        for size in [0.5, 2.0, 20.0] {
            let nanoseconds = triangles(&block, 16, size * free_path, |b, sources| {
                table.add_triangles(level, b, sources);
            });
            println!("{level:?}, tables: triangle of {size} mean free paths {nanoseconds:.1} ns RGB");
        }
    }
    let verdict = if widest >= TARGET { "met" } else { "MISSED" };
    println!(
        "R_d pairs, SIMD f32 with f64 sums: {:.2} G pairs/s a core and channel; target {:.0} G: {verdict}",
        widest * 1e-9,
        TARGET * 1e-9
    );
}

fn block_of(receivers: usize, free_path: f64) -> Block {
    let at = |i| DVec3::new(uniform(1, i, 0), uniform(1, i, 1), 0.1 * uniform(1, i, 2)) * free_path;
    let positions: Vec<DVec3> = (0..receivers as u64).map(at).collect();
    let mut block = Block::default();
    block.reset(DVec3::ZERO, positions.iter().map(|&at_mm| Receiver { at_mm, normal: DVec3::ZERO }));
    block
}

/// Seconds of the fastest of many runs.
fn fastest(mut run: impl FnMut()) -> f64 {
    let once = |run: &mut dyn FnMut()| {
        let start = Instant::now();
        run();
        start.elapsed().as_secs_f64()
    };
    (0..40).map(|_| once(&mut run)).fold(f64::INFINITY, f64::min)
}

fn points(block: &Block, receivers: usize, free_path: f64, mut add: impl FnMut(&mut Block, &[PointSource])) -> f64 {
    let coordinate = |i, k| (10.0 * free_path * uniform(2, i, k)) as f32;
    let sources: Vec<PointSource> =
        (0..4096).map(|i| PointSource { at: [0, 1, 2].map(|k| coordinate(i, k)), flux: [1.0, 2.0, 3.0] }).collect();
    let mut block = block.clone();
    let seconds = fastest(|| add(black_box(&mut block), black_box(&sources)));
    3.0 * (sources.len() * receivers) as f64 / seconds
}

fn triangles(block: &Block, receivers: usize, size: f64, mut add: impl FnMut(&mut Block, &[FlatSource])) -> f64 {
    let sources: Vec<FlatSource> = (0..128)
        .filter_map(|i| {
            let at = DVec3::new(uniform(3, i, 0), uniform(3, i, 1), 0.1 * uniform(3, i, 2)) * size;
            FlatSource::new([at, at + DVec3::X * size, at + DVec3::Y * size], [1.0, 2.0, 3.0], DVec3::ZERO)
        })
        .collect();
    let mut block = block.clone();
    let seconds = fastest(|| add(black_box(&mut block), black_box(&sources)));
    seconds * 1e9 / (sources.len() * receivers) as f64
}
