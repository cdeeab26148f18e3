//! The far field at run time: light meets the stored coefficients once for every basis function; a change of material
//! touches the last combination only.

use glam::DVec3;
use translux_format::far_field::{FarField, LANES, over_lanes};

use crate::math::simd::{InstructionSet, add_scaled, multiversion};
use crate::parallel::*;
use crate::transport::balanced_tree::LightDetails;
use crate::transport::interpolation::SharedWeights;
use crate::transport::light_range::CommonColour;

/// Basis functions at most.
const TERMS: usize = 16;

/// Far radiosity of every receiver and basis function, over the scale of the light.
#[derive(Clone, Debug, Default)]
pub(super) struct FarSums {
    /// `[row][k]`, RGB; row i is that of receiver i, as far as there are receivers.
    values: Vec<[f32; 3]>,
    terms: usize,
    scale: f64,
}

/// Receivers whose own rows lack some functions, and their weights over the rows that have them.
#[derive(Clone, Debug, Default, serde::Serialize, serde::Deserialize)]
pub(super) struct Fill {
    /// The missing functions: bit k.
    pub functions: u16,
    /// Receivers whose rows lack the functions.
    pub receivers: Vec<u32>,
    /// Weights of each of them over rows that have the functions.
    pub weights: SharedWeights,
}

impl Fill {
    /// Bytes in memory.
    pub(super) fn bytes(&self) -> usize {
        size_of_val(self.receivers.as_slice()) + self.weights.bytes()
    }
}

/// A value of the far field: the node that it belongs to, and its row among those of its width.
#[derive(Clone, Copy, Debug)]
struct Place {
    node: u32,
    row: u32,
}

/// Places of the values of each group and function. Functions are summed one after the other without a branch for each
/// value, which would cost more than its arithmetic.
#[derive(Clone, Debug, Default)]
pub(super) struct ByFunction {
    /// `[group][k]`: ends of the 8-bit and of the 16-bit values.
    ends: Vec<[u32; 2]>,
    places: Vec<Place>,
}

impl ByFunction {
    /// Sorts the values of a far field by group and function.
    pub(super) fn new(far: &FarField) -> Self {
        let terms = far.terms.min(TERMS);
        let mut result = Self {
            ends: Vec::with_capacity(far.groups.len() * terms),
            places: Vec::with_capacity(far.narrow.len() + far.wide.len()),
        };
        let (mut first, mut rows) = (0, [0; 2]);
        let mut of_group: [[Vec<Place>; 2]; TERMS] = Default::default();
        for group in &far.groups {
            for coefficient in first..group.coefficients_end as usize {
                let (mask, wide_mask) = (far.masks[coefficient], far.wide_masks[coefficient]);
                for (k, of_function) in of_group.iter_mut().enumerate().filter(|(k, _)| mask >> k & 1 == 1) {
                    let wide = usize::from(wide_mask >> k & 1);
                    of_function[wide].push(Place { node: far.nodes[coefficient], row: rows[wide] });
                    rows[wide] += 1;
                }
            }
            first = group.coefficients_end as usize;
            for of_function in &mut of_group[..terms] {
                result.ends.push(of_function.each_mut().map(|places| {
                    result.places.append(places);
                    result.places.len() as u32
                }));
            }
        }
        result
    }

    /// The 8-bit and the 16-bit values of a function in a group; `index` is `group * terms + k`.
    fn of(&self, index: usize) -> [&[Place]; 2] {
        let first = index.checked_sub(1).map_or(0, |before| self.ends[before][1]) as usize;
        let [narrow, wide] = self.ends[index].map(|end| end as usize);
        [&self.places[first..narrow], &self.places[narrow..wide]]
    }

    /// Bytes in memory.
    pub(super) fn bytes(&self) -> usize {
        size_of_val(self.ends.as_slice()) + size_of_val(self.places.as_slice())
    }
}

impl FarSums {
    /// Sums under one light. Without fills they are the values of each row, 0 for functions that its group lacks.
    pub(super) fn new(
        level: InstructionSet,
        (far, order, fills): (&FarField, &ByFunction, &[Fill]),
        light: &LightDetails,
    ) -> Self {
        let terms = far.terms.min(TERMS);
        let mut values = vec![[0.0; 3]; far.row_sums.len()];
        let mut jobs = Vec::with_capacity(far.groups.len());
        let (mut rest, mut row) = (values.as_mut_slice(), 0);
        for (index, group) in far.groups.iter().enumerate() {
            let (mine, others) = rest.split_at_mut((group.rows_end as usize - row) * terms);
            rest = others;
            let mean = light.means[group.part as usize];
            jobs.push(Job { index, mean, row_sums: &far.row_sums[row * terms..], out: mine });
            row = group.rows_end as usize;
        }
        let details = light.details.as_slice();
        match light.colour {
            Some(CommonColour { channel, rgb }) => {
                let rgb = rgb.as_vec3().to_array();
                let add = |places: [&[Place]; 2], sums: &mut _| add_one(level, far, places, (details, [channel]), sums);
                jobs.into_par_iter().for_each(|job| job.run(far, order, [channel], add, |[e]| rgb.map(|c| c * e)));
            }
            None => {
                let channels = [0, 1, 2];
                let add = |places: [&[Place]; 2], sums: &mut _| add_all(level, far, places, (details, channels), sums);
                jobs.into_par_iter().for_each(|job| job.run(far, order, channels, add, |e| e));
            }
        }
        let mut result = Self { values, terms, scale: light.scale };
        fills.iter().for_each(|fill| result.fill(fill, light.colour));
        result
    }

    /// Fills in missing functions, three numbers at a time: the channels of one function or, under light of one colour,
    /// three functions.
    fn fill(&mut self, fill: &Fill, colour: Option<CommonColour>) {
        let terms = self.terms.max(1);
        let functions: Vec<usize> = (0..self.terms).filter(|k| fill.functions >> k & 1 == 1).collect();
        let (mut stored, mut found): (Vec<[f32; 4]>, Vec<[f32; 4]>) = Default::default();
        for together in functions.chunks(if colour.is_some() { 3 } else { 1 }) {
            let number = |row: &[[f32; 3]], i: usize| match colour {
                Some(CommonColour { channel, .. }) => together.get(i).map_or(0.0, |&k| row[k][channel]),
                None => row[together[0]][i],
            };
            stored.clear();
            stored.extend(self.values.chunks_exact(terms).map(|row| {
                let [a, b, c] = [0, 1, 2].map(|i| number(row, i));
                [a, b, c, 0.0]
            }));
            fill.weights.apply_signed(&stored, &mut found);
            for (&receiver, &[a, b, c, _]) in fill.receivers.iter().zip(&found) {
                let first = receiver as usize * terms;
                let Some(row) = self.values.get_mut(first..first + terms) else { continue };
                match colour {
                    Some(CommonColour { rgb, .. }) => {
                        let rgb = rgb.as_vec3().to_array();
                        together.iter().zip([a, b, c]).for_each(|(&k, sum)| row[k] = rgb.map(|c| c * sum));
                    }
                    None => row[together[0]] = [a, b, c],
                }
            }
        }
    }

    /// Adds the far radiosity of receivers from `first` on for the coefficients of a material, `[channel][k]`.
    pub(super) fn combine(&self, first: usize, coefficients: &[Vec<f64>; 3], out: &mut [DVec3]) {
        let rows = self.values[first * self.terms..].chunks_exact(self.terms.max(1));
        for (out, row) in out.iter_mut().zip(rows) {
            let mut sum = DVec3::ZERO;
            for (k, value) in row.iter().enumerate() {
                for c in 0..3 {
                    sum[c] += coefficients[c][k] * f64::from(value[c]);
                }
            }
            *out += sum * self.scale;
        }
    }

    /// Far radiosity of one receiver and basis function, RGB.
    pub(super) fn value(&self, receiver: usize, k: usize) -> DVec3 {
        glam::Vec3::from_array(self.values[receiver * self.terms + k]).as_dvec3() * self.scale
    }

    /// Bytes in memory.
    pub(super) fn bytes(&self) -> usize {
        size_of_val(self.values.as_slice())
    }
}

/// Inputs and output of the sum for one group.
struct Job<'a> {
    index: usize,
    mean: [f32; 3],
    row_sums: &'a [f32],
    /// `[receiver][k]`.
    out: &'a mut [[f32; 3]],
}

impl Job<'_> {
    /// Sums some channels, from which `rgb` makes all three.
    fn run<const C: usize>(
        self,
        far: &FarField,
        order: &ByFunction,
        channels: [usize; C],
        add: impl Fn([&[Place]; 2], &mut [[f32; LANES]; C]),
        rgb: impl Fn([f32; C]) -> [f32; 3],
    ) {
        let terms = far.terms.min(TERMS);
        let mean = channels.map(|c| self.mean[c]);
        for k in 0..terms {
            let mut sums = [[0.0; LANES]; C];
            add(order.of(self.index * terms + k), &mut sums);
            // The transform over the lanes is linear: once for the sums instead of once for each coefficient.
            let sums = sums.map(over_lanes);
            let receivers = self.out.chunks_exact_mut(terms).zip(self.row_sums.chunks_exact(terms));
            for (lane, (out, whole)) in receivers.enumerate().take(LANES) {
                out[k] = rgb(std::array::from_fn(|c| sums[c][lane] * far.steps[k] + whole[k] * mean[c]));
            }
        }
    }
}

#[inline(always)]
fn add_body<const C: usize>(
    far: &FarField,
    [narrow, wide]: [&[Place]; 2],
    light: (&[[f32; 3]], [usize; C]),
    sums: &mut [[f32; LANES]; C],
) {
    // Two sums, taken in turns: an addition need not wait for the one before it.
    let mut others = [[0.0; LANES]; C];
    let (pairs, last) = narrow.as_chunks();
    for [even, odd] in pairs {
        add_value(&far.narrow, even, light, sums);
        add_value(&far.narrow, odd, light, &mut others);
    }
    last.iter().for_each(|place| add_value(&far.narrow, place, light, sums));
    wide.iter().for_each(|place| add_value(&far.wide, place, light, &mut others));
    for c in 0..C {
        add_scaled(&mut sums[c], 1.0, &others[c]);
    }
}

#[inline(always)]
fn add_value<const C: usize, T: Copy>(
    rows: &[[T; LANES]],
    place: &Place,
    (details, channels): (&[[f32; 3]], [usize; C]),
    sums: &mut [[f32; LANES]; C],
) where
    f32: From<T>,
{
    let (Some(row), Some(light)) = (rows.get(place.row as usize), details.get(place.node as usize)) else { return };
    // Plain loops over arrays: what the compiler turns into whole registers.
    let mut sizes = [0.0f32; LANES];
    for i in 0..LANES {
        sizes[i] = f32::from(row[i]);
    }
    for c in 0..C {
        add_scaled(&mut sums[c], light[channels[c]], &sizes);
    }
}

multiversion! {
    /// Adds value times detail of some values, all channels.
    fn add_all(far: &FarField, places: [&[Place]; 2], light: (&[[f32; 3]], [usize; 3]), sums: &mut [[f32; LANES]; 3]) => add_body
}

multiversion! {
    /// The same for one channel.
    fn add_one(far: &FarField, places: [&[Place]; 2], light: (&[[f32; 3]], [usize; 1]), sums: &mut [[f32; LANES]; 1]) => add_body
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::scattered::Weights;
    use crate::math::random::uniform;
    use translux_format::far_field::Group;

    const NODES: usize = 40;

    /// Two groups, 16 and 5 receivers, of a part each; random coefficients of three functions.
    fn field() -> FarField {
        let mut far = FarField { terms: 3, steps: vec![0.5, 0.25, 2.0], ..FarField::default() };
        for (part, receivers, coefficients) in [(0u32, 16u32, 1..30), (1, 5, 31..37)] {
            let rows_end = far.groups.last().map_or(0, |g| g.rows_end) + receivers;
            for node in coefficients {
                let mask = 1 + (uniform(1, node, 0) * 7.0) as u16;
                far.nodes.push(node as u32);
                far.masks.push(mask);
                far.wide_masks.push(mask & 0b010);
                for k in (0..3).filter(|k| mask >> k & 1 == 1) {
                    let value = |lane: usize| (uniform(2, node * 8 + k, lane as u64) * 200.0) as i16 - 100;
                    let row = std::array::from_fn(|lane| if lane < receivers as usize { value(lane) } else { 0 });
                    match k {
                        1 => far.wide.push(row.map(|x: i16| 30 * x)),
                        _ => far.narrow.push(row.map(|x| x as i8)),
                    }
                }
            }
            far.groups.push(Group { part, rows_end, coefficients_end: far.nodes.len() as u32, functions: 7 });
        }
        far.row_sums = (0..21 * 3).map(|i| i as f32).collect();
        far
    }

    fn light() -> LightDetails {
        let detail = |node: u64| std::array::from_fn(|c| uniform(3, node, c as u64) as f32 - 0.5);
        LightDetails {
            details: (0..NODES as u64).map(detail).collect(),
            means: vec![[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]],
            scale: 8.0,
            colour: None,
        }
    }

    #[test]
    fn sums_are_those_of_the_specification() {
        let (far, light) = (field(), light());
        let sums = FarSums::new(InstructionSet::detect(), (&far, &ByFunction::new(&far), &[]), &light);
        let (mut receiver, mut coefficient, mut used) = (0, 0, [0, 0]);
        for group in &far.groups {
            let first = used;
            for r in receiver..group.rows_end as usize {
                let mut expected = [DVec3::ZERO; 3];
                used = first;
                for c in coefficient..group.coefficients_end as usize {
                    for k in (0..3).filter(|k| far.masks[c] >> k & 1 == 1) {
                        let row = match k {
                            1 => far.wide[used[1]].map(f32::from),
                            _ => far.narrow[used[0]].map(f32::from),
                        };
                        let size = f64::from(over_lanes(row)[r - receiver]) * f64::from(far.steps[k]);
                        expected[k] += size * glam::Vec3::from_array(light.details[far.nodes[c] as usize]).as_dvec3();
                        used[usize::from(k == 1)] += 1;
                    }
                }
                for (k, expected) in expected.iter_mut().enumerate() {
                    let whole = f64::from(far.row_sums[3 * r + k]);
                    *expected += whole * glam::Vec3::from_array(light.means[group.part as usize]).as_dvec3();
                    let difference = sums.value(r, k) / light.scale - *expected;
                    assert!(difference.length() < 3e-4 * (1.0 + expected.length()), "{r} {k}: {difference}");
                }
            }
            receiver = group.rows_end as usize;
            coefficient = group.coefficients_end as usize;
        }
        assert_eq!(used, [far.narrow.len(), far.wide.len()]);
    }

    #[test]
    fn light_of_one_colour_by_one_channel_is_that_by_three() {
        let (far, mut light) = (field(), light());
        let order = ByFunction::new(&far);
        let rgb = [0.5, 1.0, 0.25];
        light.details.iter_mut().chain(&mut light.means).for_each(|e| *e = rgb.map(|c| c * e[1]));
        // With a fill, functions are summed together.
        for fills in [&[][..], &[fill()]] {
            light.colour = None;
            let three = FarSums::new(InstructionSet::detect(), (&far, &order, fills), &light);
            light.colour = Some(CommonColour { channel: 1, rgb: rgb.map(f64::from).into() });
            let one = FarSums::new(InstructionSet::detect(), (&far, &order, fills), &light);
            for (one, three) in one.values.as_flattened().iter().zip(three.values.as_flattened()) {
                assert!((one - three).abs() <= 1e-5 * three.abs(), "{one} {three}");
            }
        }
    }

    /// Two functions of three receivers from the rows of others.
    fn fill() -> Fill {
        let weights =
            Weights { each: 2, sources: vec![0, 3, 2, 2, 5, 4], values: vec![0.25, 0.75, 1.5, -0.5, 1.0, 0.0] };
        Fill { functions: 0b101, receivers: vec![16, 17, 20], weights: SharedWeights::new(&weights) }
    }

    #[test]
    fn receivers_take_functions_that_they_have_not_from_those_that_have() {
        let (far, light) = (field(), light());
        let order = ByFunction::new(&far);
        let plain = FarSums::new(InstructionSet::detect(), (&far, &order, &[]), &light);
        let filled = FarSums::new(InstructionSet::detect(), (&far, &order, &[fill()]), &light);
        for receiver in 0..21 {
            for k in 0..3 {
                let own = plain.value(receiver, k);
                let expected = match (receiver, k) {
                    (_, 1) => own,
                    (16, _) => 0.25 * plain.value(0, k) + 0.75 * plain.value(3, k),
                    (17, _) => plain.value(2, k),
                    (20, _) => plain.value(5, k),
                    _ => own,
                };
                let difference = filled.value(receiver, k).distance(expected);
                assert!(difference <= 1e-5 * expected.length(), "{receiver} {k}: {difference}");
            }
        }
    }

    #[test]
    fn every_instruction_set_gives_the_same_bits_and_materials_combine_linearly() {
        let (far, light) = (field(), light());
        let order = ByFunction::new(&far);
        let sums = FarSums::new(InstructionSet::Baseline, (&far, &order, &[]), &light);
        for level in InstructionSet::available() {
            assert_eq!(FarSums::new(level, (&far, &order, &[]), &light).values, sums.values, "{level:?}");
        }
        let coefficients = [vec![1.0, 0.0, 0.0], vec![0.0, 2.0, 0.0], vec![0.5, 0.0, -1.0]];
        let mut out = vec![DVec3::ONE; 4];
        sums.combine(10, &coefficients, &mut out);
        for (i, out) in out.iter().enumerate() {
            let (a, b, c) = (sums.value(10 + i, 0), sums.value(10 + i, 1), sums.value(10 + i, 2));
            let expected = DVec3::ONE + DVec3::new(a.x, 2.0 * b.y, 0.5 * a.z - c.z);
            assert!((*out - expected).length() < 1e-9 * expected.length());
        }
    }
}
