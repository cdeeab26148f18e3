//! The difference of one tile of two tone-mapped pictures (LDR-FLIP).

use glam::DVec3;

use super::colour::Colours;
use super::filters::{Filters, Plane};

/// Filters and colours that all tiles of a comparison share.
pub(super) struct Viewing {
    pub(super) filters: Filters,
    pub(super) colours: Colours,
}

/// Size of a tile without its margin, which is as wide as the filters reach.
#[derive(Clone, Copy)]
pub(super) struct TileSize {
    pub(super) width: usize,
    pub(super) height: usize,
}

/// One tile as the eye sees it: filtered colours and the strength of edges and points.
struct Seen {
    hunt_lab: Vec<DVec3>,
    edges: Vec<f64>,
    points: Vec<f64>,
}

impl Viewing {
    /// FLIP of each pixel, in [0, 1]; the pictures are linear RGB in [0, 1] with the margin.
    pub(super) fn difference(&self, size: TileSize, reference: &[DVec3], test: &[DVec3]) -> Vec<f64> {
        let (a, b) = (self.seen(size, reference), self.seen(size, test));
        let colours = a.hunt_lab.iter().zip(&b.hunt_lab);
        let edges = a.edges.iter().zip(&b.edges);
        let points = a.points.iter().zip(&b.points);
        colours.zip(edges.zip(points)).map(|(lab, (edge, point))| self.combined(lab, edge, point)).collect()
    }

    /// The colour difference, amplified where features differ (FLIP 2020, section 4.3).
    fn combined(&self, lab: (&DVec3, &DVec3), edge: (&f64, &f64), point: (&f64, &f64)) -> f64 {
        let colour = self.colours.difference(*lab.0, *lab.1);
        let feature = (edge.0 - edge.1).abs().max((point.0 - point.1).abs());
        // A first or second derivative is at most 1 along an axis, so a feature at most the root of 2.
        let feature = (feature * std::f64::consts::FRAC_1_SQRT_2).min(1.0).sqrt();
        colour.powf(1.0 - feature)
    }

    fn seen(&self, size: TileSize, rgb: &[DVec3]) -> Seen {
        let f = &self.filters;
        let opponent: Vec<DVec3> = rgb.iter().map(|v| self.colours.opponent(*v)).collect();
        let plane = |of: fn(&DVec3) -> f64| {
            let mut plane = Plane::new(size.width, size.height, f.reach());
            plane.values_mut().iter_mut().zip(&opponent).for_each(|(to, from)| *to = of(from));
            plane
        };
        let (y, cx, cz) = (plane(|v| v.x), plane(|v| v.y), plane(|v| v.z));
        let achromatic = y.filtered(&f.achromatic, &f.achromatic);
        let red_green = cx.filtered(&f.red_green, &f.red_green);
        let [(wide, wide_share), (narrow, narrow_share)] = &f.blue_yellow;
        let (wide, narrow) = (cz.filtered(wide, wide), cz.filtered(narrow, narrow));
        let blue_yellow = wide.iter().zip(&narrow).map(|(w, n)| w * wide_share + n * narrow_share);
        let hunt_lab = achromatic
            .iter()
            .zip(red_green)
            .zip(blue_yellow)
            .map(|((y, cx), cz)| self.colours.hunt_lab(self.colours.rgb(DVec3::new(*y, cx, cz))))
            .collect();
        let grey = plane(|v| (v.x + 16.0) / 116.0);
        let smooth = grey.across(&f.smooth);
        let strength = |across: Vec<f64>, down: Vec<f64>| across.iter().zip(down).map(|(x, y)| x.hypot(y)).collect();
        Seen {
            hunt_lab,
            edges: strength(grey.across(&f.slope).down(&f.smooth), smooth.down(&f.slope)),
            points: strength(grey.across(&f.bend).down(&f.smooth), smooth.down(&f.bend)),
        }
    }
}
