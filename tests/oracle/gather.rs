//! The integral over the surface for one receiver.

use super::lights::{Extended, OracleLight, Sharp, prepare};
use super::medium::{Channel, OracleMedium};
use super::mesh::OracleMesh;
use super::patch::{Patch, radon_rule};
use super::rays::{Blockers, Ray};
use super::shadow::{ShadowTree, Shadows};
use super::vector::{V3, add, distance, hash, mul, sub};

/// How fine; shares are of the total diffuse reflectance times the root-mean-square irradiance.
#[derive(Clone, Copy, Debug)]
pub struct OracleSettings {
    /// A patch is bisected until its longest edge is below this times the length over which the kernel changes.
    pub kernel_step: f64,
    /// The same for the one-point rule that stands for a whole far triangle.
    pub far_step: f64,
    /// Largest contribution of a patch that a shadow edge crosses.
    pub edge_share: f64,
    /// Largest contribution of a patch that counts as all lit or all dark on the word of sixteen points.
    pub probe_share: f64,
    /// Largest contribution of a patch with one estimate of the extended lights' irradiance.
    pub extended_share: f64,
    /// Draws for each of the seven points of a patch and for each of two independent estimates; even, as
    /// environments are drawn from in two ways by turns.
    pub draws: u64,
    /// Pixels of an environment with more than this share of its power are directional lights.
    pub sharp_pixel_share: f64,
    pub seed: u64,
    pub threads: usize,
}

impl Default for OracleSettings {
    fn default() -> Self {
        Self {
            kernel_step: 1.2,
            far_step: 0.1,
            edge_share: 3e-5,
            probe_share: 1e-3,
            extended_share: 2e-3,
            draws: 8,
            sharp_pixel_share: 5e-3,
            seed: 1,
            threads: std::thread::available_parallelism().map_or(1, usize::from),
        }
    }
}

/// Two independent estimates of the extended lights' irradiance.
type Pair = [V3; 2];

/// A scene whose visibility has been prepared; `radiosity` may be called for any vertex.
pub struct Oracle {
    settings: OracleSettings,
    positions: Vec<V3>,
    roots: Vec<Patch>,
    channels: [Channel; 3],
    totals: V3,
    eta: f64,
    sharp: Vec<Sharp>,
    extended: Vec<Extended>,
    blockers: Blockers,
    trees: Vec<ShadowTree>,
    /// Mean irradiance of each triangle from the extended lights.
    means: Vec<Pair>,
    /// Root-mean-square irradiance over the surface, per channel.
    scale: V3,
}

/// What one receiver's recursion carries: the receiver, the tolerances, and where the sum goes.
struct Receiver<'a> {
    x: V3,
    settings: &'a OracleSettings,
    sum: V3,
    halves: Pair,
}

impl Oracle {
    pub fn new(mesh: &OracleMesh, medium: &OracleMedium, lights: &[OracleLight], settings: OracleSettings) -> Self {
        assert!(settings.draws > 0 && settings.draws.is_multiple_of(2), "draws must be even");
        let (sharp, extended) = prepare(lights, settings.sharp_pixel_share);
        let channels = medium.channels();
        let mut oracle = Self {
            settings,
            positions: mesh.positions.clone(),
            roots: (0..mesh.triangles.len()).map(|t| Patch::new(mesh.corners(t))).collect(),
            channels,
            totals: channels.map(|c| c.total()),
            eta: medium.eta,
            sharp,
            extended,
            blockers: Blockers::new(mesh),
            trees: Vec::new(),
            means: Vec::new(),
            scale: [0.0; 3],
        };
        oracle.scale = oracle.rms(|o, t| o.shadows().unshadowed(&o.roots[t]).fold([0.0; 3], add));
        if !oracle.extended.is_empty() {
            oracle.means = oracle.for_each(oracle.roots.len(), |o, t| o.extended_mean(t));
            let sharp = oracle.scale;
            oracle.scale = add(sharp, oracle.rms(|o, t| mul(add(o.means[t][0], o.means[t][1]), 0.5)));
        }
        if !oracle.sharp.is_empty() {
            oracle.trees = oracle.for_each(oracle.roots.len(), |o, t| {
                o.shadows().tree(t as u32, &o.roots[t], |patch, k| {
                    // A receiver two mean free paths away is the nearest for which the shared tree is made.
                    let share = o.share(patch, |c| 2.0 * c.z[0], o.unshadowed_by(k, patch));
                    share > o.settings.edge_share && patch.size > 1e-3 * o.roots[t].size
                })
            });
        }
        oracle
    }

    /// Radiosity at a vertex, RGB.
    pub fn radiosity(&self, vertex: usize) -> V3 {
        self.at_point(self.positions[vertex], &self.settings).0
    }

    /// The same with light that entered through the triangles named only: the vertex' own part, without what is
    /// opaque. All triangles cast shadows.
    pub fn radiosity_through(&self, vertex: usize, triangles: &[usize]) -> V3 {
        self.gather(self.positions[vertex], &self.settings, triangles.iter().copied()).0
    }

    /// Radiosity at a vertex and what it differs by under looser tolerances and other draws.
    pub fn radiosity_with_error(&self, vertex: usize) -> (V3, V3) {
        let s = self.settings;
        let loose = OracleSettings {
            kernel_step: 1.4 * s.kernel_step,
            far_step: 1.4 * s.far_step,
            edge_share: 4.0 * s.edge_share,
            probe_share: 4.0 * s.probe_share,
            ..s
        };
        let (fine, noise) = self.at_point(self.positions[vertex], &s);
        let (coarse, _) = self.at_point(self.positions[vertex], &loose);
        (fine, [0, 1, 2].map(|c| (fine[c] - coarse[c]).abs() + noise[c]))
    }

    /// Radiosity at many vertices.
    pub fn radiosities(&self, vertices: &[usize]) -> Vec<V3> {
        self.for_each(vertices.len(), |o, i| o.radiosity(vertices[i]))
    }

    /// Radiosity at any point of the surface, and half the difference of the two estimates of extended lights.
    pub fn at_point(&self, x: V3, settings: &OracleSettings) -> (V3, V3) {
        self.gather(x, settings, 0..self.roots.len())
    }

    fn gather(&self, x: V3, settings: &OracleSettings, triangles: impl Iterator<Item = usize>) -> (V3, V3) {
        let mut receiver = Receiver { x, settings, sum: [0.0; 3], halves: [[0.0; 3]; 2] };
        for t in triangles {
            if !self.sharp.is_empty() {
                self.gather_sharp_root(&mut receiver, t);
            }
            if !self.extended.is_empty() {
                self.gather_extended_root(&mut receiver, t);
            }
        }
        let [a, b] = receiver.halves;
        let noise = sub(a, b).map(|d| 0.5 * d.abs());
        (add(receiver.sum, mul(add(a, b), 0.5)), noise)
    }

    fn shadows(&self) -> Shadows<'_> {
        Shadows { lights: &self.sharp, blockers: &self.blockers, eta: self.eta }
    }

    fn unshadowed_by(&self, light: usize, patch: &Patch) -> V3 {
        self.sharp[light].unshadowed(self.eta, patch.centroid, patch.normal)
    }

    fn kernel(&self, x: V3, y: V3) -> V3 {
        let d = sub(x, y);
        self.channels.map(|c| c.r_d(super::vector::dot(d, d)))
    }

    /// Distance over which the kernel changes by a factor of about e, at `r` from the receiver, mm.
    fn kernel_length(&self, r: f64) -> f64 {
        let slope = |c: &Channel| c.sigma_tr + 3.0 / (r * r + c.z[0] * c.z[0]).sqrt();
        1.0 / self.channels.iter().filter(|c| c.albedo > 0.0).map(slope).fold(0.0, f64::max)
    }

    /// Contribution of the patch with irradiance `e` to a receiver at the distance `r(channel)`, as a share of the
    /// total reflectance times the surface's irradiance; the largest over the channels.
    fn share(&self, patch: &Patch, r: impl Fn(&Channel) -> f64, e: V3) -> f64 {
        (0..3)
            .filter(|&c| self.totals[c] > 0.0 && self.scale[c] > 0.0)
            .map(|c| {
                let channel = &self.channels[c];
                channel.r_d(r(channel).powi(2)) * patch.area / self.totals[c] * e[c] / self.scale[c]
            })
            .fold(0.0, f64::max)
    }

    fn gather_sharp_root(&self, receiver: &mut Receiver, t: usize) {
        let (root, tree) = (&self.roots[t], &self.trees[t]);
        if tree.nodes.len() == 1 && self.shadows().unshadowed(root).all(|e| e == [0.0; 3]) {
            return;
        }
        let near = (distance(receiver.x, root.centroid) - root.radius).max(0.0);
        let light_length = self.sharp.iter().map(|l| l.scale_length(root.centroid)).fold(f64::INFINITY, f64::min);
        if root.size < receiver.settings.far_step * self.kernel_length(near).min(light_length) {
            let k = self.kernel(receiver.x, tree.centre);
            receiver.sum = add(receiver.sum, [0, 1, 2].map(|c| k[c] * tree.flux[c]));
            return;
        }
        self.gather_sharp(receiver, t, root, &tree.nodes[0].lit, Some(0));
    }

    fn gather_sharp(&self, receiver: &mut Receiver, t: usize, patch: &Patch, lit: &[f64], node: Option<u32>) {
        let settings = receiver.settings;
        let near = (distance(receiver.x, patch.centroid) - patch.radius).max(0.0);
        let mut smooth = patch.size < settings.kernel_step * self.kernel_length(near);
        let (mut edges, mut all) = (0.0, 0.0);
        let mut trusted = vec![true; lit.len()];
        for (k, light) in self.sharp.iter().enumerate() {
            let share = self.share(patch, |_| near, self.unshadowed_by(k, patch));
            all += share;
            trusted[k] = share < settings.probe_share;
            if lit[k] > 0.0 && lit[k] < 1.0 {
                edges += share;
            }
            smooth &= share == 0.0 || patch.size < 0.3 * light.scale_length(patch.centroid);
        }
        if all == 0.0 {
            return;
        }
        let dark = lit.iter().all(|&f| f == 0.0);
        if all < settings.probe_share && dark {
            return;
        }
        let tiny = patch.size < 1e-6 * self.roots[t].size;
        if tiny || (smooth && all < settings.probe_share && edges < settings.edge_share) {
            for (barycentric, w) in radon_rule() {
                let p = patch.point(barycentric);
                let k = self.kernel(receiver.x, p);
                for (light, share) in self.sharp.iter().zip(lit).filter(|(_, share)| **share > 0.0) {
                    let e = light.unshadowed(self.eta, p, patch.normal);
                    receiver.sum = add(receiver.sum, [0, 1, 2].map(|c| w * patch.area * share * k[c] * e[c]));
                }
            }
            return;
        }
        let stored = node.map_or(0, |n| self.trees[t].nodes[n as usize].first_child);
        for (i, half) in patch.bisected().iter().enumerate() {
            if stored > 0 {
                let child = stored + i as u32;
                self.gather_sharp(receiver, t, half, &self.trees[t].nodes[child as usize].lit, Some(child));
            } else {
                let shares = self.shadows().child_shares(t as u32, half, lit, &trusted);
                self.gather_sharp(receiver, t, half, &shares, None);
            }
        }
    }

    fn gather_extended_root(&self, receiver: &mut Receiver, t: usize) {
        let (root, means) = (&self.roots[t], &self.means[t]);
        let near = (distance(receiver.x, root.centroid) - root.radius).max(0.0);
        if root.size < receiver.settings.far_step * self.kernel_length(near) {
            let k = self.kernel(receiver.x, root.centroid);
            self.add_pair(receiver, k, root.area, means);
            return;
        }
        self.gather_extended(receiver, t, root, self.root_key(t), None);
    }

    fn gather_extended(&self, receiver: &mut Receiver, t: usize, patch: &Patch, key: u64, known: Option<Pair>) {
        let near = (distance(receiver.x, patch.centroid) - patch.radius).max(0.0);
        let smooth = patch.size < receiver.settings.kernel_step * self.kernel_length(near);
        let mut known = known;
        if known.is_none() {
            let root_key = self.root_key(t);
            // The floor keeps a triangle whose few draws all missed a light from being trusted as dark.
            let mean = add(self.means[t][0], self.means[t][1]);
            let e = [0, 1, 2].map(|c| (0.5 * mean[c]).max(0.1 * self.scale[c]));
            let tiny = patch.size < 1e-4 * self.roots[t].size;
            if tiny || self.share(patch, |_| near, e) < receiver.settings.extended_share {
                if key == root_key {
                    known = Some(self.means[t]);
                } else {
                    let estimates = self.estimate(t as u32, patch, key);
                    if smooth {
                        for ((barycentric, w), pair) in radon_rule().iter().zip(&estimates) {
                            let k = self.kernel(receiver.x, patch.point(*barycentric));
                            self.add_pair(receiver, k, w * patch.area, pair);
                        }
                        return;
                    }
                    known = Some(weighted(&estimates));
                }
            }
        }
        if let (Some(pair), true) = (known, smooth) {
            for (barycentric, w) in radon_rule() {
                let k = self.kernel(receiver.x, patch.point(barycentric));
                self.add_pair(receiver, k, w * patch.area, &pair);
            }
            return;
        }
        for (i, half) in patch.bisected().iter().enumerate() {
            self.gather_extended(receiver, t, half, hash(key, i as u64), known);
        }
    }

    fn add_pair(&self, receiver: &mut Receiver, kernel: V3, area: f64, pair: &Pair) {
        for (half, e) in receiver.halves.iter_mut().zip(pair) {
            *half = add(*half, [0, 1, 2].map(|c| kernel[c] * area * e[c]));
        }
    }

    fn root_key(&self, t: usize) -> u64 {
        hash(self.settings.seed, t as u64)
    }

    fn extended_mean(&self, t: usize) -> Pair {
        weighted(&self.estimate(t as u32, &self.roots[t], self.root_key(t)))
    }

    /// Irradiance behind the surface at the seven points; one sequence runs over all of them, for stratification.
    fn estimate(&self, t: u32, patch: &Patch, key: u64) -> [Pair; 7] {
        let points = radon_rule().map(|(barycentric, _)| patch.point(barycentric));
        let mut sums = [[[0.0; 3]; 2]; 7];
        for (index, light) in self.extended.iter().enumerate() {
            for half in [0, 1] {
                let shift = hash(hash(key, 1000 + index as u64), half as u64);
                for j in 0..7 * self.settings.draws {
                    // Blocks of draws, so that an even and an odd one fall on each point.
                    let q = (j / self.settings.draws) as usize;
                    let Some(draw) = light.draw(self.eta, points[q], patch.normal, shift, j) else { continue };
                    let ray = Ray { origin: points[q], direction: draw.direction, reach: draw.reach };
                    if self.blockers.sees(t, ray) {
                        sums[q][half] = add(sums[q][half], mul(draw.value, 1.0 / self.settings.draws as f64));
                    }
                }
            }
        }
        sums
    }

    fn rms(&self, value: impl Fn(&Self, usize) -> V3) -> V3 {
        let (mut squares, mut area) = ([0.0; 3], 0.0);
        for (t, root) in self.roots.iter().enumerate() {
            squares = add(squares, mul(value(self, t).map(|e| e * e), root.area));
            area += root.area;
        }
        if area > 0.0 { squares.map(|s| (s / area).sqrt()) } else { [0.0; 3] }
    }

    /// `f` for 0..n, in order, on the settings' threads.
    fn for_each<T: Send>(&self, n: usize, f: impl Fn(&Self, usize) -> T + Sync) -> Vec<T> {
        let threads = self.settings.threads.clamp(1, n.max(1));
        let f = &f;
        std::thread::scope(|scope| {
            let workers: Vec<_> = (0..threads)
                .map(|w| scope.spawn(move || (w..n).step_by(threads).map(|i| (i, f(self, i))).collect::<Vec<_>>()))
                .collect();
            let mut all: Vec<(usize, T)> = workers.into_iter().flat_map(|w| w.join().unwrap()).collect();
            all.sort_by_key(|(i, _)| *i);
            all.into_iter().map(|(_, value)| value).collect()
        })
    }
}

/// The mean over a patch from its seven points.
fn weighted(estimates: &[Pair; 7]) -> Pair {
    let mut mean = [[0.0; 3]; 2];
    for ((_, w), pair) in radon_rule().iter().zip(estimates) {
        for (sum, e) in mean.iter_mut().zip(pair) {
            *sum = add(*sum, mul(*e, *w));
        }
    }
    mean
}
