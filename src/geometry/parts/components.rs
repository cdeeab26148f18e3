//! Connected components of a mesh within one medium: their triangles, closure, area and volume.

use glam::DVec3;

use super::roles::{MaterialRoles, Role};
use super::touch::{Corners, Crossing, crossing};
use super::turn::turn_over;
use crate::geometry::boxes::{Aabb, BoxTree};
use crate::geometry::mesh::{Chain, EdgeTable, Mesh, POSITION_RESOLUTION, RepairReport, simple_chains};

/// Closure of a surface: closed if it bounds a volume.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum Closure {
    /// Every edge has an even number of triangles, slits of no width aside.
    Closed,
    /// The surface has a border.
    Open,
}

/// Why the winding of a piece of surface cannot be told.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum WindingDoubt {
    /// It has one side only.
    OneSided,
    /// Neither winding has a clear majority of the area.
    Tie,
    /// It is closed and encloses no volume.
    NoVolume,
    /// More than two triangles meet at its edges.
    NonManifold,
}

impl WindingDoubt {
    /// The reason in words.
    pub fn reason(self) -> &'static str {
        match self {
            Self::OneSided => "the surface has one side only, as a Moebius strip has",
            Self::Tie => "neither winding has a clear majority",
            Self::NoVolume => "the surface encloses no volume",
            Self::NonManifold => "more than two triangles meet at edges, and which belong together is not clear",
        }
    }
}

/// Triangles of one medium that share welded vertices.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Component {
    pub role: Role,
    pub first_triangle: u32,
    pub triangles: usize,
    pub area_mm2: f64,
    /// Signed volume; meaningful where the component is closed.
    pub volume_mm3: f64,
    pub closure: Closure,
    /// Edges whose triangles do not run in opposite directions in pairs.
    pub inconsistent_edges: usize,
    /// Triangles that ran against the others and were turned over.
    pub turned_triangles: usize,
    /// Why windings that disagree were left.
    pub winding_doubts: Vec<WindingDoubt>,
    pub bounds: Aabb,
}

/// All components of a mesh in the order of their first triangle.
pub(crate) struct Components {
    pub of_triangle: Vec<u32>,
    pub list: Vec<Component>,
}

/// Disjoint sets whose representative is the smallest member.
pub(crate) struct DisjointSets(Vec<u32>);

impl DisjointSets {
    pub(crate) fn new(n: usize) -> Self {
        Self((0..n as u32).collect())
    }

    pub(crate) fn find(&mut self, mut x: u32) -> u32 {
        while self.0[x as usize] != x {
            let parent = self.0[x as usize];
            self.0[x as usize] = self.0[parent as usize];
            x = self.0[x as usize];
        }
        x
    }

    pub(crate) fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.find(a), self.find(b));
        self.0[a.max(b) as usize] = a.min(b);
    }

    /// Numbers the sets 0, 1, ... in the order of their smallest members; returns each member's number and the count.
    pub(crate) fn labels(mut self) -> (Vec<u32>, usize) {
        let mut labels = vec![0u32; self.0.len()];
        let mut count = 0;
        for x in 0..self.0.len() as u32 {
            let root = self.find(x);
            labels[x as usize] = if root == x {
                count += 1;
                count - 1
            } else {
                labels[root as usize]
            };
        }
        (labels, count as usize)
    }
}

impl Components {
    /// Finds the components of a mesh. Opaque triangles form components of their own.
    pub(crate) fn find(mesh: &Mesh, roles: &MaterialRoles, edges: &EdgeTable) -> Self {
        let (of_triangle, count) = connect(mesh, roles);
        let mut list: Vec<Component> = Vec::with_capacity(count);
        let mut reference = Vec::with_capacity(count);
        for t in 0..mesh.triangles.len() as u32 {
            let id = of_triangle[t as usize] as usize;
            let corners = mesh.corners_local_mm(t);
            if id == list.len() {
                reference.push(corners[0]);
                list.push(Component {
                    role: roles.of_triangle(mesh, t),
                    first_triangle: t,
                    triangles: 0,
                    area_mm2: 0.0,
                    volume_mm3: 0.0,
                    closure: Closure::Closed,
                    inconsistent_edges: 0,
                    turned_triangles: 0,
                    winding_doubts: Vec::new(),
                    bounds: Aabb::EMPTY,
                });
            }
            let component = &mut list[id];
            let [a, b, c] = corners.map(|p| p - reference[id]);
            component.triangles += 1;
            component.area_mm2 += 0.5 * (b - a).cross(c - a).length();
            component.volume_mm3 += a.dot(b.cross(c)) / 6.0;
            component.bounds = component.bounds.union(Aabb::of(&corners));
        }
        let mut components = Self { of_triangle, list };
        let of = |t: u32| Some((components.of_triangle[t as usize], 1));
        let found = inspect_edges(mesh, edges, of, count);
        for (component, (closure, inconsistent)) in components.list.iter_mut().zip(found) {
            (component.closure, component.inconsistent_edges) = (closure, inconsistent);
        }
        components
    }

    /// Turns closed components round whose normals all point inwards, unless they lie in another closed component of
    /// the same medium (then they are its cavities). Counts them in `report`.
    pub(crate) fn orient(&mut self, mesh: &mut Mesh, report: &mut RepairReport) {
        if !self.list.iter().any(Component::is_inverted) {
            return;
        }
        let flip = self.outermost_inverted(mesh);
        let flipped: Vec<bool> = self.of_triangle.iter().map(|&c| flip[c as usize]).collect();
        report.flipped_components += flip.iter().filter(|&&f| f).count();
        report.flipped_triangles += flipped.iter().filter(|&&f| f).count();
        turn_over(mesh, &flipped, |t| self.of_triangle[t] as usize, flip.len());
        for (component, _) in self.list.iter_mut().zip(&flip).filter(|(_, f)| **f) {
            component.volume_mm3 = -component.volume_mm3;
        }
    }

    /// For each component, true if it is inverted and in no other closed component of its medium.
    fn outermost_inverted(&self, mesh: &Mesh) -> Vec<bool> {
        let mut trees = ComponentTrees::new(mesh, self);
        (0..self.list.len() as u32)
            .map(|id| {
                let inner = &self.list[id as usize];
                inner.is_inverted() && !trees.near(id, 0.0).into_iter().any(|outer| trees.holds(outer, id))
            })
            .collect()
    }
}

impl Component {
    /// Closed, wound consistently, and with a clearly negative volume.
    pub(crate) fn is_inverted(&self) -> bool {
        let clear = clear_volume(self.volume_mm3, self.area_mm2, &self.bounds);
        self.closure == Closure::Closed && self.inconsistent_edges == 0 && self.volume_mm3 < 0.0 && clear
    }
}

/// Whether the sign of a volume is beyond rounding.
pub(super) fn clear_volume(volume_mm3: f64, area_mm2: f64, bounds: &Aabb) -> bool {
    volume_mm3.abs() > 1e-6 * area_mm2 * (bounds.max - bounds.min).length()
}

/// Closure of `count` sets of triangles, and for each the edges whose triangles do not run in opposite directions in
/// pairs. `of` gives the set of a triangle and the sign of its winding there, none for triangles that are in no set.
pub(super) fn inspect_edges(
    mesh: &Mesh,
    edges: &EdgeTable,
    of: impl Fn(u32) -> Option<(u32, i32)>,
    count: usize,
) -> Vec<(Closure, usize)> {
    let mut found = vec![(Closure::Closed, 0); count];
    let mut odd: Vec<(u32, [u32; 2])> = Vec::new();
    let mut here: Vec<(u32, i32)> = Vec::new();
    for edge in edges.edges() {
        here.clear();
        here.extend(edge.triangles().filter_map(|(t, direction)| of(t).map(|(set, sign)| (set, sign * direction))));
        if let [(c, d), (other_c, other_d)] = here[..]
            && c == other_c
            && d != other_d
        {
            continue;
        }
        here.sort_unstable();
        for run in here.chunk_by(|a, b| a.0 == b.0) {
            if run.len() % 2 == 1 {
                odd.push((run[0].0, edge.vertices));
            } else if run.iter().map(|r| r.1).sum::<i32>() != 0 {
                found[run[0].0 as usize].1 += 1;
            }
        }
    }
    odd.sort_unstable();
    for run in odd.chunk_by(|a, b| a.0 == b.0) {
        let border: Vec<[u32; 2]> = run.iter().map(|r| r.1).collect();
        if simple_chains(&border).iter().any(|chain| !is_slit(mesh, chain)) {
            found[run[0].0 as usize].0 = Closure::Open;
        }
    }
    found
}

/// Triangle labels by shared welded vertices within one role.
fn connect(mesh: &Mesh, roles: &MaterialRoles) -> (Vec<u32>, usize) {
    const NONE: u32 = u32::MAX;
    let triangles = mesh.triangles.len() as u32;
    let mut sets = DisjointSets::new(mesh.triangles.len());
    // The last triangle seen at each vertex, one role after another.
    let mut last = vec![NONE; mesh.weld.len()];
    for role in roles.distinct() {
        last.fill(NONE);
        for t in (0..triangles).filter(|&t| roles.of_triangle(mesh, t) == role) {
            for v in mesh.welded(t) {
                let seen = &mut last[v as usize];
                if *seen != NONE {
                    sets.join(t, *seen);
                }
                *seen = t;
            }
        }
    }
    sets.labels()
}

/// True if a border chain is a slit of no width: all of its vertices on one line, as far as positions resolve.
pub(crate) fn is_slit(mesh: &Mesh, chain: &Chain) -> bool {
    if !chain.closed {
        return false;
    }
    let points: Vec<DVec3> = chain.vertices.iter().map(|&v| mesh.local_mm[v as usize].as_dvec3()).collect();
    let far = |from: DVec3| {
        points.iter().copied().max_by(|a, b| a.distance_squared(from).total_cmp(&b.distance_squared(from)))
    };
    let Some(a) = points.first().and_then(|&p| far(p)) else { return true };
    let Some(b) = far(a) else { return true };
    let tolerance = 4.0 * POSITION_RESOLUTION * points.iter().map(|p| p.length()).fold(0.0, f64::max);
    let axis = (b - a).normalize_or_zero();
    points.iter().all(|&p| (p - a).cross(axis).length() <= tolerance)
}

/// The triangles of one component under a box tree.
pub(crate) struct ComponentTree {
    corners: Vec<Corners>,
    tree: BoxTree,
}

impl ComponentTree {
    pub(crate) fn of(corners: Vec<Corners>) -> Self {
        let boxes: Vec<Aabb> = corners.iter().map(|c| Aabb::of(c)).collect();
        Self { corners, tree: BoxTree::new(&boxes) }
    }

    /// True if any triangle of one tree comes within `distance` of one of the other.
    pub(crate) fn touches(&self, other: &Self, distance: f64) -> bool {
        use std::ops::ControlFlow::{Break, Continue};
        self.tree
            .near_pairs(&other.tree, distance, |i, j| {
                let near = super::touch::within(&self.corners[i as usize], &other.corners[j as usize], distance);
                if near { Break(()) } else { Continue(()) }
            })
            .is_break()
    }

    /// True if a point lies inside this closed surface: odd number of crossings of a ray.
    ///
    /// Rays that pass an edge or graze a face are given up for another direction; where all are unclear the point is
    /// taken as outside.
    pub(crate) fn contains(&self, point: DVec3) -> bool {
        // Directions of no special position to axis-aligned or 45-degree models.
        const DIRECTIONS: [[f64; 3]; 6] = [
            [0.846_51, 0.369_18, 0.383_57],
            [-0.291_73, 0.872_41, 0.392_06],
            [0.410_29, -0.352_83, 0.840_94],
            [-0.613_77, -0.561_92, 0.554_51],
            [0.273_19, 0.617_33, -0.737_71],
            [-0.802_87, 0.213_61, -0.556_63],
        ];
        for direction in DIRECTIONS.map(DVec3::from) {
            let mut inside = false;
            let mut clear = true;
            self.tree.along_ray(point, direction, f64::INFINITY, |item, t_max| {
                match crossing(point, direction, &self.corners[item as usize]) {
                    Crossing::None => t_max,
                    Crossing::At { .. } => {
                        inside = !inside;
                        t_max
                    }
                    Crossing::Unclear => {
                        clear = false;
                        -1.0
                    }
                }
            });
            if clear {
                return inside;
            }
        }
        false
    }

    /// Distance to the nearest accepted triangle beyond `t_min` that the ray leaves through its back.
    pub(crate) fn exit(
        &self,
        origin: DVec3,
        direction: DVec3,
        t_min: f64,
        accept: impl Fn(u32) -> bool,
    ) -> Option<f64> {
        let mut nearest = f64::INFINITY;
        self.tree.along_ray(origin, direction, f64::INFINITY, |item, t_max| {
            match crossing(origin, direction, &self.corners[item as usize]) {
                Crossing::At { t, outward: true } if t > t_min && t < nearest && accept(item) => {
                    nearest = t;
                    t
                }
                _ => t_max,
            }
        });
        nearest.is_finite().then_some(nearest)
    }
}

/// The box trees of components, made when first needed, and a tree over the boxes of the components themselves.
pub(crate) struct ComponentTrees<'a> {
    mesh: &'a Mesh,
    components: &'a Components,
    triangles_of: Vec<Vec<u32>>,
    trees: Vec<Option<ComponentTree>>,
    boxes: BoxTree,
}

impl<'a> ComponentTrees<'a> {
    pub(crate) fn new(mesh: &'a Mesh, components: &'a Components) -> Self {
        let mut triangles_of: Vec<Vec<u32>> = components.list.iter().map(|c| Vec::with_capacity(c.triangles)).collect();
        for (t, &c) in components.of_triangle.iter().enumerate() {
            triangles_of[c as usize].push(t as u32);
        }
        let mut trees = Vec::new();
        trees.resize_with(components.list.len(), || None);
        let boxes: Vec<Aabb> = components.list.iter().map(|c| c.bounds).collect();
        Self { mesh, components, triangles_of, trees, boxes: BoxTree::new(&boxes) }
    }

    fn tree(&mut self, id: u32) -> &ComponentTree {
        self.trees[id as usize].get_or_insert_with(|| {
            let triangles = &self.triangles_of[id as usize];
            ComponentTree::of(triangles.iter().map(|&t| self.mesh.corners_local_mm(t)).collect())
        })
    }

    /// Other components of the same role whose boxes come within `distance`, in ascending order.
    pub(crate) fn near(&self, id: u32, distance: f64) -> Vec<u32> {
        let component = &self.components.list[id as usize];
        let mut near = Vec::new();
        let _ = self.boxes.overlapping(&component.bounds.grown(distance), |other| {
            if other != id && self.components.list[other as usize].role == component.role {
                near.push(other);
            }
            std::ops::ControlFlow::Continue(())
        });
        near.sort_unstable();
        near
    }

    /// True if two components come within `distance`.
    pub(crate) fn touch(&mut self, a: u32, b: u32, distance: f64) -> bool {
        self.tree(a);
        self.tree(b);
        matches!((&self.trees[a as usize], &self.trees[b as usize]), (Some(a), Some(b)) if a.touches(b, distance))
    }

    /// True if `outer` is closed and holds the first corner of `inner`: all of it, where the two do not touch.
    pub(crate) fn holds(&mut self, outer: u32, inner: u32) -> bool {
        let inner = &self.components.list[inner as usize];
        self.holds_point(outer, &inner.bounds, self.mesh.corners_local_mm(inner.first_triangle)[0])
    }

    /// True if `outer` is closed and holds `point`, one of a surface with these bounds.
    pub(crate) fn holds_point(&mut self, outer: u32, bounds: &Aabb, point: DVec3) -> bool {
        let o = &self.components.list[outer as usize];
        o.closure == Closure::Closed && o.bounds.contains(bounds) && self.tree(outer).contains(point)
    }
}
