//! One row: the coefficients of a point, their selection and their quantiser.

use translux_format::rows::IrradianceRows;

use crate::math::cube_map::FACES;

/// Details that a row keeps, selected by energy: the sum of their squares over the terms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Keep {
    /// The so many of the largest energy.
    Largest(usize),
    /// All whose energy is above this.
    Above(f32),
}

/// Memory of one thread.
pub(super) struct Work {
    face: usize,
    terms: usize,
    /// Coefficients, `[face][term][row][column]`.
    pub(super) coefficients: Vec<f32>,
    pub(super) lit: [bool; FACES],
    pub(super) scratch: Vec<f32>,
    /// Energy of each detail (sum of the squares over the terms) as bits, which order as the numbers do.
    energies: Vec<u32>,
    bins: Vec<u32>,
    kept: Vec<u16>,
    ties: Vec<(u32, u16)>,
}

/// Bits of an energy that its bin leaves out.
const BIN_SHIFT: u32 = 20;

impl Work {
    pub(super) fn new(side: usize, terms: usize) -> Self {
        let face = side * side;
        Self {
            face,
            terms,
            coefficients: vec![0.0; FACES * terms * face],
            lit: [false; FACES],
            scratch: vec![0.0; face],
            energies: vec![0; FACES * face],
            bins: vec![0; 1 << (32 - BIN_SHIFT)],
            kept: Vec::new(),
            ties: Vec::new(),
        }
    }

    /// Copies coefficients `[place][term]` of three terms.
    pub(super) fn take(&mut self, vector: &[[f32; 3]]) {
        let pictures = self.coefficients.chunks_exact_mut(3 * self.face);
        for ((out, vector), lit) in pictures.zip(vector.chunks_exact(self.face)).zip(&mut self.lit) {
            *lit = vector.iter().any(|v| *v != [0.0; 3]);
            for (term, out) in out.chunks_exact_mut(self.face).enumerate() {
                out.iter_mut().zip(vector).for_each(|(out, v)| *out = v[term]);
            }
        }
    }

    /// Appends the row with some of its details; `importance` multiplies the squares that are compared.
    pub(super) fn append(&mut self, keep: Keep, importance: Option<&[f32]>, rows: &mut IrradianceRows) {
        self.measure(importance);
        match keep {
            Keep::Largest(count) => self.choose(count),
            Keep::Above(energy) => self.choose_above(energy),
        }
        push(&self.coefficients, &self.kept, [0.0; 2], rows);
    }

    /// Computes the energies of all details, times the importance.
    fn measure(&mut self, importance: Option<&[f32]>) {
        for (index, energies) in self.energies.chunks_exact_mut(self.face).enumerate().filter(|(i, _)| self.lit[*i]) {
            let terms = &self.coefficients[index * self.terms * self.face..][..self.terms * self.face];
            for (x, energy) in energies.iter_mut().enumerate() {
                let square = |term: &[f32]| term[x] * term[x];
                let sum = terms.chunks_exact(self.face).map(square).sum::<f32>();
                let importance = importance.and_then(|all| all.get(index * self.face + x)).unwrap_or(&1.0);
                *energy = (sum * importance).to_bits();
            }
            energies[0] = 0;
        }
    }

    /// Fills `kept` with the places of details of more than an energy in ascending order.
    fn choose_above(&mut self, energy: f32) {
        self.kept.clear();
        for index in (0..FACES).filter(|i| self.lit[*i]) {
            let from = index * self.face;
            let energies = self.energies[from..from + self.face].iter().enumerate();
            let above = energies.filter(|(_, e)| f32::from_bits(**e) > energy);
            self.kept.extend(above.map(|(x, _)| (from + x) as u16));
        }
    }

    /// Fills `kept` with the places of the largest details in ascending order; of equal ones the first.
    fn choose(&mut self, count: usize) {
        self.kept.clear();
        self.bins.fill(0);
        for (_, energies) in self.energies.chunks_exact(self.face).enumerate().filter(|(i, _)| self.lit[*i]) {
            energies.iter().for_each(|e| self.bins[(e >> BIN_SHIFT) as usize] += 1);
        }
        // The lowest bin that has room together with all above it; details without energy are never kept.
        let (mut above, mut bin) = (0usize, self.bins.len());
        while bin > 1 && above + (self.bins[bin - 1] as usize) <= count {
            bin -= 1;
            above += self.bins[bin] as usize;
        }
        let lowest = (bin as u32) << BIN_SHIFT;
        let partly = (bin as u32).saturating_sub(1);
        self.ties.clear();
        for index in (0..FACES).filter(|i| self.lit[*i]) {
            let from = index * self.face;
            for (x, &energy) in self.energies[from..from + self.face].iter().enumerate() {
                if bin < self.bins.len() && energy >= lowest {
                    self.kept.push((from + x) as u16);
                } else if energy >> BIN_SHIFT == partly && energy > 0 {
                    self.ties.push((u32::MAX - energy, (from + x) as u16));
                }
            }
        }
        self.ties.sort_unstable();
        self.kept.extend(self.ties.iter().take(count.saturating_sub(above)).map(|(_, i)| *i));
        self.kept.sort_unstable();
    }
}

/// Appends a row of coefficients `[face][term][place]` with some of its details, quantised as finely as 8 bits (scaling coefficients
/// 16) let it, in steps of at least `least` (details, scaling coefficients).
pub(super) fn push(coefficients: &[f32], details: &[u16], least: [f32; 2], rows: &mut IrradianceRows) {
    let (face, terms) = (rows.side * rows.side, rows.terms);
    let value = |place: usize, term: usize| coefficients[(place / face * terms + term) * face + place % face];
    let largest = |values: &mut dyn Iterator<Item = f32>| values.fold(0.0f32, |m, v| m.max(v.abs()));
    let step = |least: f32, largest: f32, levels: f32| {
        let step = least.max(largest / levels);
        if step >= f32::MIN_POSITIVE { step } else { 0.0 }
    };
    let quantised = |v: f32, step: f32| if step > 0.0 { (v / step).round_ties_even() } else { 0.0 };
    let all = |term: usize| details.iter().map(move |&place| value(usize::from(place), term));
    let detail = step(least[0], largest(&mut (0..terms).flat_map(all)), f32::from(i8::MAX));
    let visible = |place: usize| (0..terms).any(|term| quantised(value(place, term), detail) != 0.0);
    let kept: Vec<u16> = details.iter().copied().filter(|&place| visible(usize::from(place))).collect();
    for term in 0..terms {
        rows.values.extend(kept.iter().map(|&place| quantised(value(usize::from(place), term), detail) as i8));
    }
    rows.indices.extend_from_slice(&kept);
    rows.offsets.push(rows.indices.len() as u32);
    rows.steps.push(detail);
    let first = |k: usize| value(k % FACES * face, k / FACES);
    let scaling = step(least[1], largest(&mut (0..terms * FACES).map(first)), f32::from(i16::MAX));
    rows.scaling.extend((0..terms * FACES).map(|k| quantised(first(k), scaling) as i16));
    rows.scaling_steps.push(scaling);
}
