//! Parts: the pieces of surface that exchange light inside one medium.
//!
//! Light inside a medium never crosses air, so transfer joins only triangles of one medium and one part. A *component*
//! is a set of triangles of one medium that hangs together by welded vertices; a *part* is one component or several.

mod components;
mod roles;
mod touch;
mod turn;
mod winding;

use std::collections::HashMap;

use serde::Serialize;

use components::ComponentTrees;
pub use components::{Closure, WindingDoubt};
pub(crate) use components::{Component, ComponentTree, Components, DisjointSets, is_slit};
pub use roles::{MaterialRoles, Role};

use super::mesh::{EdgeTable, Mesh, RepairReport};

/// Components of one medium that come this near, as a share of the mesh's diagonal, touch (`PartsRule::Auto`).
///
/// A hundred times the rounding of positions: parts modelled face to face touch, parts with a visible gap do not.
pub const TOUCH_TOLERANCE: f64 = 1e-5;

/// Rule by which components of one medium become parts (`--parts`).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, clap::ValueEnum)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum PartsRule {
    /// Components that touch, overlap or lie inside a closed one are one part.
    #[default]
    Auto,
    /// Each component is a part.
    Separate,
    /// All components of a medium are one part.
    Joined,
}

/// Surface that exchanges light within itself and with no other part.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Part {
    /// Material of the first triangle, numbered from the second part of that name on (`skin`, `skin 2`).
    pub name: String,
    /// Medium, or opaque (all opaque triangles are one part).
    pub role: Role,
    /// Closed if all of its components are.
    pub closure: Closure,
    /// Area in mm^2.
    pub area_mm2: f64,
    /// Signed volume in mm^3, cavities subtracted; overlapping components count twice. None for an open part.
    pub volume_mm3: Option<f64>,
    /// Number of triangles.
    pub triangle_count: usize,
    /// Number of connected components.
    pub components: usize,
    /// Triangles that were wound against the others and have been turned over.
    pub turned_triangles: usize,
    /// Edges whose triangles do not pair up in opposite directions (borders aside), as they were left.
    pub inconsistent_edges: usize,
    /// Why those were left: which winding is right is not clear.
    pub winding_doubts: Vec<WindingDoubt>,
}

/// The parts of a mesh in the order of their first triangles.
#[derive(Clone, Debug, PartialEq)]
pub struct Parts {
    /// For each triangle, an index into `parts`.
    pub triangle_part: Vec<u32>,
    /// The parts.
    pub parts: Vec<Part>,
    /// The rule that made them.
    pub rule: PartsRule,
}

impl Part {
    /// The triangles that were turned over, in words; none if there were none.
    pub fn turned(&self) -> Option<String> {
        let (name, turned, all) = (&self.name, self.turned_triangles, self.triangle_count);
        let line = format!("part '{name}': {turned} of {all} triangles were wound against the others: turned over");
        (turned > 0).then_some(line)
    }
}

impl Parts {
    fn group(mesh: &Mesh, components: &Components, rule: PartsRule) -> Self {
        let mut sets = DisjointSets::new(components.list.len());
        join_alike(&components.list, &mut sets, |role| rule == PartsRule::Joined || role == Role::Opaque);
        if rule == PartsRule::Auto {
            join_touching(mesh, components, &mut sets);
        }
        let (label, count) = sets.labels();
        let mut parts: Vec<Part> = Vec::with_capacity(count);
        let mut used_names: HashMap<&str, usize> = HashMap::new();
        for (component, &part) in components.list.iter().zip(&label) {
            if part as usize == parts.len() {
                let material = mesh.triangle_material[component.first_triangle as usize] as usize;
                let base = mesh.materials.get(material).map_or("default", String::as_str);
                let number = used_names.entry(base).and_modify(|n| *n += 1).or_insert(1);
                let name = if *number == 1 { base.to_string() } else { format!("{base} {number}") };
                parts.push(Part {
                    name,
                    role: component.role,
                    closure: Closure::Closed,
                    area_mm2: 0.0,
                    volume_mm3: Some(0.0),
                    triangle_count: 0,
                    components: 0,
                    turned_triangles: 0,
                    inconsistent_edges: 0,
                    winding_doubts: Vec::new(),
                });
            }
            let part = &mut parts[part as usize];
            part.area_mm2 += component.area_mm2;
            part.triangle_count += component.triangles;
            part.components += 1;
            part.turned_triangles += component.turned_triangles;
            part.inconsistent_edges += component.inconsistent_edges;
            part.winding_doubts.extend(&component.winding_doubts);
            part.winding_doubts.sort_unstable();
            part.winding_doubts.dedup();
            part.volume_mm3 = part.volume_mm3.map(|v| v + component.volume_mm3);
            if component.closure == Closure::Open {
                part.closure = Closure::Open;
                part.volume_mm3 = None;
            }
        }
        let triangle_part = components.of_triangle.iter().map(|&c| label[c as usize]).collect();
        Self { triangle_part, parts, rule }
    }

    /// One line about the choice, such as `3 components -> 1 part (auto: touching or nested)`.
    pub fn description(&self) -> String {
        let components: usize = self.parts.iter().map(|p| p.components).sum();
        let plural = |n: usize, word: &str| format!("{n} {word}{}", if n == 1 { "" } else { "s" });
        let merged = components > self.parts.len();
        let rule = match self.rule {
            PartsRule::Auto if merged => "auto: touching or nested",
            PartsRule::Auto if components > 1 => "auto: none touch",
            PartsRule::Auto => "auto",
            PartsRule::Separate => "separate",
            PartsRule::Joined => "joined",
        };
        let opaque: usize = self.parts.iter().filter(|p| p.role == Role::Opaque).count();
        let opaque = if opaque > 0 { ", one of them opaque" } else { "" };
        format!("{} -> {} ({rule}){opaque}", plural(components, "component"), plural(self.parts.len(), "part"))
    }
}

/// For each of `count` parts, its edges whose triangles do not pair up in opposite directions, borders aside;
/// `triangle_part` has one entry for each triangle.
pub fn inconsistent_edges(mesh: &Mesh, triangle_part: &[u32], count: usize) -> Vec<usize> {
    let of = |t: u32| triangle_part.get(t as usize).filter(|&&part| (part as usize) < count).map(|&part| (part, 1));
    components::inspect_edges(mesh, &EdgeTable::new(mesh), of, count).into_iter().map(|(_, edges)| edges).collect()
}

/// Parts, components and edges of a mesh, computed once for transport and the mesh check.
pub struct Analysis {
    /// The parts.
    pub parts: Parts,
    pub(crate) components: Components,
    pub(crate) edges: EdgeTable,
}

impl Analysis {
    /// Finds edges and components, turns triangles over that are wound against the others ([`Part::turned_triangles`])
    /// and closed components that are wound inwards ([`RepairReport::flipped_components`]), and groups parts.
    pub fn new(mesh: &mut Mesh, roles: &MaterialRoles, rule: PartsRule, report: &mut RepairReport) -> Self {
        let mut edges = EdgeTable::new(mesh);
        let mut components = Components::find(mesh, roles, &edges);
        winding::mend(mesh, roles, &mut components, &mut edges);
        let before = report.flipped_triangles;
        components.orient(mesh, report);
        if report.flipped_triangles != before {
            edges = EdgeTable::new(mesh);
        }
        let parts = Parts::group(mesh, &components, rule);
        Self { parts, components, edges }
    }
}

/// Joins all components of each role that `whole` selects.
fn join_alike(components: &[Component], sets: &mut DisjointSets, whole: impl Fn(Role) -> bool) {
    let mut first: HashMap<Role, u32> = HashMap::new();
    for (id, component) in components.iter().enumerate().filter(|(_, c)| whole(c.role)) {
        sets.join(*first.entry(component.role).or_insert(id as u32), id as u32);
    }
}

/// Joins components of one medium that touch, overlap or lie one inside the other.
fn join_touching(mesh: &Mesh, components: &Components, sets: &mut DisjointSets) {
    if components.list.len() < 2 {
        return;
    }
    let tolerance = TOUCH_TOLERANCE * mesh.diagonal_mm();
    let mut trees = ComponentTrees::new(mesh, components);
    for id in 0..components.list.len() as u32 {
        // Each pair once, from its later member.
        for other in trees.near(id, tolerance).into_iter().filter(|&other| other < id) {
            let joined = sets.find(id) == sets.find(other);
            if !joined && (trees.touch(id, other, tolerance) || trees.holds(id, other) || trees.holds(other, id)) {
                sets.join(id, other);
            }
        }
    }
}

#[cfg(test)]
mod tests;
