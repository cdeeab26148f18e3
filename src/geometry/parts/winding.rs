//! Windings that disagree within a component: which triangles run against the others, and which of the two is right.
//!
//! Two triangles at an edge that no other triangle of the component has must run along it in opposite directions: so a
//! winding spreads over a *piece*, the triangles that hang together by such edges, and leaves one choice for the whole
//! of it. A closed piece is wound outwards, which its signed volume tells; inside another closed surface it may be a
//! cavity as well as a body, and the larger share of its area decides, as it does for an open piece. Where nothing
//! decides, the piece stays as it is and says why.

use glam::DVec3;

use super::components::{
    Closure, ComponentTree, ComponentTrees, Components, WindingDoubt, clear_volume, inspect_edges,
};
use super::roles::MaterialRoles;
use super::turn::turn_over;
use crate::geometry::boxes::Aabb;
use crate::geometry::mesh::{EdgeTable, Mesh};

/// Share of a piece's area from which on its winding is the right one where nothing else tells.
const CLEAR_MAJORITY: f64 = 0.6;

/// Triangles, the largest ones, from which rays tell inside from outside for a piece that is not closed by itself.
const RAYS: usize = 9;

/// Distance from the surface at which these rays start, as a share of the component's diagonal.
const RAY_OFFSET: f64 = 1e-6;

/// Triangles that hang together by edges with two triangles, with one winding spread over them.
struct Piece {
    component: u32,
    triangles: Vec<u32>,
    closure: Closure,
    /// No winding fits all of its edges with two triangles.
    one_sided: bool,
    /// Edges with more triangles at which the spread winding does not fit.
    misfits: usize,
    /// Areas that had the spread winding, and the other one.
    area_mm2: [f64; 2],
    /// Signed volume in the spread winding.
    volume_mm3: f64,
    bounds: Aabb,
}

/// Sign of a triangle that its piece turns over, or leaves.
type Choice = Result<f64, WindingDoubt>;

/// Turns triangles over that are wound against the others of their component, where it is clear which are wrong, and
/// says of the components what was done. `edges` are those of the mesh, before and after.
pub(super) fn mend(mesh: &mut Mesh, roles: &MaterialRoles, components: &mut Components, edges: &mut EdgeTable) {
    if components.list.iter().all(|c| c.inconsistent_edges == 0) {
        return;
    }
    let (turned, doubts) = choose(mesh, components, edges);
    if turned.contains(&true) {
        // Each triangle for itself: its neighbours may keep their normals.
        turn_over(mesh, &turned, |t| t, turned.len());
        *edges = EdgeTable::new(mesh);
        // What hangs together does not depend on the winding: the components keep their numbers.
        *components = Components::find(mesh, roles, edges);
    }
    for t in (0..turned.len()).filter(|&t| turned[t]) {
        components.list[components.of_triangle[t] as usize].turned_triangles += 1;
    }
    for (component, doubt) in doubts {
        components.list[component as usize].winding_doubts.push(doubt);
    }
    for component in &mut components.list {
        // Pieces that are sound each can still misfit where more than two triangles meet.
        if component.inconsistent_edges > 0 && component.winding_doubts.is_empty() {
            component.winding_doubts.push(WindingDoubt::NonManifold);
        }
    }
}

/// The triangles that are wrong, and components with the doubts about their pieces.
fn choose(mesh: &Mesh, components: &Components, edges: &EdgeTable) -> (Vec<bool>, Vec<(u32, WindingDoubt)>) {
    let (pieces, sign) = pieces(mesh, components, edges);
    let trees = ComponentTrees::new(mesh, components);
    let mut judge = Judge { mesh, components, pieces: &pieces, sign: &sign, trees };
    let (mut turned, mut doubts) = (vec![false; mesh.triangles.len()], Vec::new());
    for (index, piece) in pieces.iter().enumerate() {
        match judge.choice(index) {
            Ok(right) => {
                piece.triangles.iter().for_each(|&t| turned[t as usize] = f64::from(sign[t as usize]) != right);
            }
            Err(doubt) => doubts.push((piece.component, doubt)),
        }
    }
    (turned, doubts)
}

/// The pieces of the components whose windings disagree, and for each triangle +1 where it has the winding that was
/// spread over its piece, otherwise -1.
fn pieces(mesh: &Mesh, components: &Components, edges: &EdgeTable) -> (Vec<Piece>, Vec<i8>) {
    const NONE: u32 = u32::MAX;
    let triangles = mesh.triangles.len();
    let disagrees = |t: u32| components.list[components.of_triangle[t as usize] as usize].inconsistent_edges > 0;
    let mut sets = SignedSets::new(triangles);
    let mut conflicts = Vec::new();
    let mut here: Vec<(u32, u32, i32)> = Vec::new();
    for edge in edges.edges() {
        here.clear();
        here.extend(edge.triangles().map(|(t, d)| (components.of_triangle[t as usize], t, d)));
        here.sort_unstable();
        for run in here.chunk_by(|a, b| a.0 == b.0) {
            if let [(_, a, along), (_, b, other)] = *run
                && disagrees(a)
                && !sets.join(a, b, if along == other { -1 } else { 1 })
            {
                conflicts.push(a);
            }
        }
    }
    let mut sign = vec![1; triangles];
    let mut label = vec![NONE; triangles];
    let mut of_root = vec![NONE; triangles];
    let mut list: Vec<Piece> = Vec::new();
    for t in (0..triangles as u32).filter(|&t| disagrees(t)) {
        let (root, relative) = sets.find(t);
        let place = &mut of_root[root as usize];
        if *place == NONE {
            *place = list.len() as u32;
            list.push(Piece {
                component: components.of_triangle[t as usize],
                triangles: Vec::new(),
                closure: Closure::Closed,
                one_sided: false,
                misfits: 0,
                area_mm2: [0.0; 2],
                volume_mm3: 0.0,
                bounds: Aabb::EMPTY,
            });
        }
        (label[t as usize], sign[t as usize]) = (*place, relative);
        let piece = &mut list[*place as usize];
        let corners = mesh.corners_local_mm(t);
        let from = piece.triangles.first().map_or(corners[0], |&first| mesh.corners_local_mm(first)[0]);
        let [a, b, c] = corners.map(|p| p - from);
        piece.triangles.push(t);
        piece.area_mm2[usize::from(relative < 0)] += 0.5 * (b - a).cross(c - a).length();
        piece.volume_mm3 += f64::from(relative) * a.dot(b.cross(c)) / 6.0;
        piece.bounds = piece.bounds.union(Aabb::of(&corners));
    }
    for t in conflicts {
        list[label[t as usize] as usize].one_sided = true;
    }
    let of = |t: u32| Some((label[t as usize], i32::from(sign[t as usize]))).filter(|of| of.0 != NONE);
    let count = list.len();
    for (piece, (closure, misfits)) in list.iter_mut().zip(inspect_edges(mesh, edges, of, count)) {
        (piece.closure, piece.misfits) = (closure, misfits);
    }
    (list, sign)
}

/// Chooses the winding of pieces.
struct Judge<'a> {
    mesh: &'a Mesh,
    components: &'a Components,
    pieces: &'a [Piece],
    sign: &'a [i8],
    trees: ComponentTrees<'a>,
}

impl Judge<'_> {
    /// The sign of the triangles of a piece that are right.
    fn choice(&mut self, index: usize) -> Choice {
        let piece = &self.pieces[index];
        if piece.one_sided {
            return Err(WindingDoubt::OneSided);
        }
        if piece.misfits > 0 {
            return Err(WindingDoubt::NonManifold);
        }
        if piece.closure == Closure::Closed {
            let area = piece.area_mm2.iter().sum();
            if !clear_volume(piece.volume_mm3, area, &piece.bounds) {
                return Err(WindingDoubt::NoVolume);
            }
            return if self.is_nested(index) { majority(piece) } else { Ok(piece.volume_mm3.signum()) };
        }
        if self.components.list[piece.component as usize].closure == Closure::Closed {
            return self.by_rays(piece);
        }
        majority(piece)
    }

    /// Whether a piece lies in another closed surface of its medium.
    fn is_nested(&mut self, index: usize) -> bool {
        let piece = &self.pieces[index];
        let point = centroid(self.mesh, piece.triangles[0]);
        let others = self.trees.near(piece.component, 0.0);
        if others.into_iter().any(|outer| self.trees.holds_point(outer, &piece.bounds, point)) {
            return true;
        }
        // A cavity may touch the surface around it, and then both are of one component.
        let around = |(other, outer): (usize, &Piece)| {
            other != index
                && outer.component == piece.component
                && outer.closure == Closure::Closed
                && outer.bounds.contains(&piece.bounds)
                && tree(self.mesh, &outer.triangles).contains(point)
        };
        self.pieces.iter().enumerate().any(around)
    }

    /// The winding whose front is outside of the closed component that a piece belongs to.
    fn by_rays(&self, piece: &Piece) -> Choice {
        let component = &self.components.list[piece.component as usize];
        let of_component = (0..self.mesh.triangles.len() as u32)
            .filter(|&t| self.components.of_triangle[t as usize] == piece.component)
            .collect::<Vec<_>>();
        let whole = tree(self.mesh, &of_component);
        let offset = RAY_OFFSET * (component.bounds.max - component.bounds.min).length();
        let mut largest = piece.triangles.clone();
        largest.sort_by(|&a, &b| self.mesh.area_mm2(b).total_cmp(&self.mesh.area_mm2(a)).then(a.cmp(&b)));
        let votes = largest.iter().take(RAYS).map(|&t| {
            let (from, normal) = (centroid(self.mesh, t), self.mesh.normal(t));
            let [front, back] = [offset, -offset].map(|by| whole.contains(from + normal * by));
            let outwards = f64::from(i8::from(back) - i8::from(front));
            outwards * f64::from(self.sign[t as usize])
        });
        let votes: Vec<f64> = votes.collect();
        match votes.split_first() {
            Some((first, rest)) if *first != 0.0 && rest.iter().all(|vote| vote == first) => Ok(*first),
            _ => Err(WindingDoubt::NonManifold),
        }
    }
}

/// The winding of most of a piece's area, where that is clear.
fn majority(piece: &Piece) -> Choice {
    let [spread, other] = piece.area_mm2;
    let needed = CLEAR_MAJORITY * (spread + other);
    match (spread >= needed, other >= needed) {
        (true, _) => Ok(1.0),
        (_, true) => Ok(-1.0),
        _ => Err(WindingDoubt::Tie),
    }
}

fn centroid(mesh: &Mesh, triangle: u32) -> DVec3 {
    mesh.corners_local_mm(triangle).iter().sum::<DVec3>() / 3.0
}

fn tree(mesh: &Mesh, triangles: &[u32]) -> ComponentTree {
    ComponentTree::of(triangles.iter().map(|&t| mesh.corners_local_mm(t)).collect())
}

/// Disjoint sets whose members have a sign each, relative to the representative, which is the smallest member.
struct SignedSets {
    /// Towards the representative, and the sign relative to that.
    parent: Vec<(u32, i8)>,
}

impl SignedSets {
    fn new(n: usize) -> Self {
        Self { parent: (0..n as u32).map(|t| (t, 1)).collect() }
    }

    fn find(&mut self, member: u32) -> (u32, i8) {
        let (mut root, mut sign) = (member, 1);
        while self.parent[root as usize].0 != root {
            let (parent, relative) = self.parent[root as usize];
            (root, sign) = (parent, sign * relative);
        }
        // The way is walked again and shortened.
        let (mut at, mut left) = (member, sign);
        while at != root {
            let (parent, relative) = self.parent[at as usize];
            self.parent[at as usize] = (root, left);
            (at, left) = (parent, left * relative);
        }
        (root, sign)
    }

    /// Joins the sets of two members whose signs relative to each other are known; false if they contradict what is
    /// known already.
    fn join(&mut self, a: u32, b: u32, relative: i8) -> bool {
        let ((root_a, sign_a), (root_b, sign_b)) = (self.find(a), self.find(b));
        let between = sign_a * sign_b * relative;
        if root_a != root_b {
            self.parent[root_a.max(root_b) as usize] = (root_a.min(root_b), between);
        }
        root_a != root_b || between == 1
    }
}

#[cfg(test)]
#[path = "winding_tests.rs"]
mod tests;
