//! Single scattering in media so thin that the way inside ends in another part: two blocks that touch against one of both.

use glam::DVec3;
use translux::error::Result;
use translux::geometry::bvh::Bvh;
use translux::geometry::mesh::{Mesh, Scale};
use translux::geometry::part_table::PartTable;
use translux::geometry::parts::PartsRule;
use translux::geometry::shapes::{compose, cuboid};
use translux::light::Light;
use translux::medium::material::{Medium, OpticalProperties};
use translux::progress::Silent;
use translux::scene::Scene;
use translux::transport::single_scattering::radiance::{Settings, SingleScattering};
use translux::transport::single_scattering::{Crossings, ExitPoint};

use crate::bench::percent;
use crate::common::bench::{Context, parallel, scene_of, table};

/// Edge of a block, mm, and mean free paths over it.
const EDGE_MM: f64 = 4.0;
const FREE_PATHS: [f64; 4] = [0.1, 0.5, 2.0, 10.0];

/// A gap between the blocks, mm.
const APART_MM: f64 = 0.01;

/// Points along an edge of a face.
const GRID: usize = 12;

/// Share of scattering.
const ALBEDO: f64 = 0.8;

fn medium(mean_free_path_mm: f64) -> Medium {
    let sigma_t_per_mm = 1.0 / mean_free_path_mm;
    let properties = OpticalProperties {
        sigma_s_reduced_per_mm: DVec3::splat(ALBEDO * sigma_t_per_mm),
        sigma_a_per_mm: DVec3::splat((1.0 - ALBEDO) * sigma_t_per_mm),
        g: 0.0,
        eta_inside_over_outside: 1.3,
    };
    Medium { name: "thin".to_owned(), properties }
}

/// Points of the outside of both blocks together, with the part that they have where the blocks are two.
fn points() -> Vec<ExitPoint> {
    let at = |i: usize| (i as f64 + 0.5) / GRID as f64 - 0.5;
    let mut all = Vec::new();
    for (axis, side) in (0..3).flat_map(|axis| [(axis, -1.0), (axis, 1.0)]) {
        let mut normal = DVec3::ZERO;
        normal[axis] = side;
        for (i, j) in (0..GRID).flat_map(|i| (0..GRID).map(move |j| (i, j))) {
            let mut p = DVec3::ZERO;
            p[axis] = 0.5 * side;
            p[(axis + 1) % 3] = at(i);
            p[(axis + 2) % 3] = at(j);
            let at_mm = p * DVec3::new(2.0, 1.0, 1.0) * EDGE_MM;
            all.push(ExitPoint { at_mm, normal, geometric: normal, part: u32::from(at_mm.x > 0.0) });
        }
    }
    all
}

/// The blocks as parts, whatever edges they share.
fn two_parts(mesh: &Mesh) -> PartTable {
    let part = |t: u32| {
        let x: f64 = mesh.corners_local_mm(t).iter().map(|p| p.x).sum();
        // Where they touch, each looks at the other.
        u32::from(if x.abs() < 1e-2 * EDGE_MM { mesh.normal(t).x < 0.0 } else { x > 0.0 })
    };
    let of_triangle = (0..mesh.triangles.len() as u32).map(part).collect();
    PartTable::new(mesh, of_triangle, vec![("left".to_owned(), Some(0)), ("right".to_owned(), Some(0))])
}

/// The table.
pub(crate) fn run(context: &Context) -> Result<String> {
    let block = |size: DVec3| cuboid(size, 8);
    let size = DVec3::splat(EDGE_MM);
    let shift = DVec3::new(0.5 * EDGE_MM, 0.0, 0.0);
    let mut rows = Vec::new();
    let lights = [
        ("constant", Light::Constant { radiance: DVec3::ONE }),
        ("a sun from aside", parallel(DVec3::new(1.0, 0.4, 0.3).normalize())),
    ];
    for free_path in context.some(&FREE_PATHS, 3) {
        let scene = |source, rule| scene_of(source, Scale::MillimetresPerUnit(1.0), rule, medium(free_path * EDGE_MM));
        let one = scene(block(size * DVec3::new(2.0, 1.0, 1.0)), PartsRule::Auto)?;
        let blocks = |apart: f64| -> Result<Scene> {
            let shift = shift + DVec3::new(0.5 * apart, 0.0, 0.0);
            let mut two = scene(compose(&[(block(size), -shift), (block(size), shift)]), PartsRule::Separate)?;
            two.parts = two_parts(&two.mesh);
            Ok(two)
        };
        let (touching, apart) = (blocks(0.0)?, blocks(APART_MM)?);
        for (name, light) in &lights {
            let lights = std::slice::from_ref(light);
            let single = |scene: &Scene, crossings: Crossings, points: &[ExitPoint]| -> Result<Vec<DVec3>> {
                let bvh = Bvh::new(&scene.mesh);
                let settings = Settings { crossings, ..Settings::REFERENCE };
                Ok(SingleScattering::new(scene.domain(), &bvh, lights, settings)?.per_points(points, &Silent))
            };
            let separate = points();
            let whole: Vec<ExitPoint> = separate.iter().map(|p| ExitPoint { part: 0, ..*p }).collect();
            let truth = single(&one, Crossings::Occluded, &whole)?;
            let mut cells = vec![format!("{free_path}"), (*name).to_owned()];
            let ways = [
                (&touching, Crossings::Occluded, 0.0),
                (&touching, Crossings::Attenuated, 0.0),
                (&apart, Crossings::Attenuated, 0.5 * APART_MM),
            ];
            for (two, crossings, shift) in ways {
                let moved = |p: &ExitPoint| ExitPoint { at_mm: p.at_mm + DVec3::X * shift.copysign(p.at_mm.x), ..*p };
                let found = single(two, crossings, &separate.iter().map(moved).collect::<Vec<_>>())?;
                let (mut error, mut unit, mut lost) = (0.0, 0.0, 0.0);
                for (f, t) in found.iter().zip(&truth) {
                    error += (f.x - t.x).powi(2);
                    unit += t.x * t.x;
                    lost += f.x - t.x;
                }
                let mean = truth.iter().map(|t| t.x).sum::<f64>();
                cells.push(format!("{}, {}", percent((error / unit).sqrt()), percent(lost / mean)));
            }
            rows.push(cells);
        }
    }
    context.say("failures: thin media");
    let head = [
        "mean free path over the edge of a block",
        "light",
        "the other block occludes (as the paper): RMS, in the mean",
        "it attenuates: RMS, in the mean",
        "it attenuates, 0.01 mm apart",
    ];
    Ok(format!("@thin@\n\n{}", table(&head, &rows)))
}
