//! The far field of `editable`: for groups of neighbouring receivers, weighted Haar coefficients of the transport of
//! every basis function over the tree of samples.

use crate::asset::{RawSection, pick};
use crate::checks::{addressable, indices_below, invalid, same_length};
use crate::error::Result;
use crate::far_values::{self, by_coefficient, by_function, from_planes, planes};
use crate::types::{Budget, Codec, Kind};
use crate::{far_coded, far_functions, far_sums, varints};

use crate::far_data::group_sizes;
pub use crate::far_data::{
    FarField, Group, LANES, MOST_TERMS, NO_RECEIVER, Shape, all_functions, over_lanes, tags, transform_lanes,
};

impl FarField {
    /// Checks every length, index, order and range that [`FarField::from_sections`] guarantees.
    ///
    /// # Errors
    /// [`crate::FormatError::Invalid`] with the tag of the section at fault.
    pub fn validate(&self, shape: &Shape<'_>) -> Result<()> {
        addressable(tags::NODES, self.nodes.len())?;
        check_groups(&self.groups, shape)?;
        far_functions::check_rows(self)?;
        check_receivers(&self.receiver_of_vertex, self.receivers(), shape)?;
        check_steps(&self.steps)?;
        same_length(tags::STEPS, "basis functions", self.steps.len(), self.terms)?;
        let coefficients = self.groups.last().map_or(0, |group| group.coefficients_end as usize);
        same_length(tags::NODES, "coefficients", self.nodes.len(), coefficients)?;
        self.check_nodes(shape)?;
        let expected = product(&[self.rows(), self.terms]);
        same_length(tags::ROW_SUMS, "rows times functions", self.row_sums.len(), expected)?;
        if let Some(i) = self.row_sums.iter().position(|sum| !sum.is_finite()) {
            return invalid(tags::ROW_SUMS, format!("row sum {i} is not finite"));
        }
        same_length(tags::MASKS, "coefficients", self.masks.len(), coefficients)?;
        same_length(tags::WIDE_MASKS, "coefficients", self.wide_masks.len(), coefficients)?;
        check_masks(&self.masks, &self.wide_masks, self.terms)?;
        far_functions::check(self)?;
        same_length(tags::NARROW, "8-bit rows", self.narrow.len(), far_values::count(self.narrow_masks()))?;
        same_length(tags::WIDE, "16-bit rows", self.wide.len(), far_values::count(self.wide_masks.iter().copied()))
    }

    /// Checks that the nodes of a group lie strictly inside its part's samples, in order.
    fn check_nodes(&self, shape: &Shape<'_>) -> Result<()> {
        let mut rest = self.nodes.as_slice();
        for ((g, group), (_, count)) in self.groups.iter().enumerate().zip(group_sizes(&self.groups)) {
            let (nodes, others) = rest.split_at(count);
            rest = others;
            let (first, end) = shape.samples(group.part).unwrap_or_default();
            let inside = nodes.first().is_none_or(|&node| node > first) && nodes.last().is_none_or(|&node| node < end);
            if !inside || nodes.windows(2).any(|pair| pair[0] >= pair[1]) {
                let what = format!("the nodes of group {g} do not ascend strictly between {first} and {end}");
                return invalid(tags::NODES, what);
            }
        }
        Ok(())
    }

    /// Mask of each coefficient's kept functions with 8-bit values.
    fn narrow_masks(&self) -> impl Iterator<Item = u16> + Clone {
        self.masks.iter().zip(&self.wide_masks).map(|(kept, wide)| kept & !wide)
    }

    /// The sections of a valid far field.
    ///
    /// # Errors
    /// [`crate::FormatError::Invalid`] as [`FarField::validate`].
    pub fn to_sections(&self, shape: &Shape<'_>) -> Result<Vec<RawSection>> {
        self.validate(shape)?;
        let (kind, zstd) = (Kind::Method, Codec::Zstd);
        let [receivers, groups, steps, row_sums] = self.without_coefficients();
        let narrow = by_function(&self.narrow, self.narrow_masks());
        let wide = planes(&by_function(&self.wide, self.wide_masks.iter().copied()));
        let mut sections = vec![
            receivers,
            groups,
            RawSection::from_rows(tags::NODES, kind, zstd, &self.node_bytes(shape)),
            RawSection::from_rows(tags::MASKS, kind, zstd, &self.masks),
            RawSection::from_rows(tags::WIDE_MASKS, kind, zstd, &self.wide_masks),
            steps,
            row_sums,
            RawSection::from_rows(tags::NARROW, kind, zstd, &narrow),
            RawSection::from_rows(tags::WIDE, kind, zstd, &wide),
        ];
        sections.extend(far_functions::sections(self));
        Ok(sections)
    }

    /// The sections of a valid far field with its coefficients entropy-coded: about three quarters of the bytes.
    ///
    /// # Errors
    /// [`crate::FormatError::Invalid`] as [`FarField::validate`], and where 16-bit values fit 8 bits.
    pub fn to_coded_sections(&self, shape: &Shape<'_>) -> Result<Vec<RawSection>> {
        self.validate(shape)?;
        let coded = far_coded::encode(self, shape)?;
        let mut sections = self.without_coefficients().to_vec();
        sections.extend(far_functions::sections(self));
        sections.push(RawSection::from_rows(tags::CODED, Kind::Method, Codec::Raw, &coded));
        Ok(sections)
    }

    /// The sections that both layouts share.
    fn without_coefficients(&self) -> [RawSection; 4] {
        let (kind, zstd) = (Kind::Method, Codec::Zstd);
        let groups: Vec<[u32; 3]> = self.groups.iter().map(|g| [g.part, g.rows_end, g.coefficients_end]).collect();
        [
            RawSection::from_rows(tags::RECEIVERS, kind, zstd, &self.receiver_of_vertex),
            RawSection::from_rows(tags::GROUPS, kind, zstd, &groups),
            RawSection::from_rows(tags::STEPS, kind, zstd, &self.steps),
            RawSection::from_rows(tags::ROW_SUMS, kind, zstd, &far_sums::encode(&self.row_sums, self.terms)),
        ]
    }

    /// Differences of successive nodes of each group, less 1, as varints.
    fn node_bytes(&self, shape: &Shape<'_>) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(2 * self.nodes.len());
        let mut nodes = self.nodes.iter();
        for (group, (_, count)) in self.groups.iter().zip(group_sizes(&self.groups)) {
            let mut last = shape.samples(group.part).map_or(0, |(first, _)| first);
            for &node in nodes.by_ref().take(count) {
                varints::push(&mut bytes, node.wrapping_sub(last).wrapping_sub(1));
                last = node;
            }
        }
        bytes
    }

    /// Reads the far field among the sections of an asset, in either layout; `None` where there is none. Other sections
    /// are ignored. Takes less than five times the bytes of its sections, or of their decoded size, at most 2 GiB.
    ///
    /// # Errors
    /// [`crate::FormatError::MissingSection`] where only some exist, and any fault of their type or content.
    pub fn from_sections(sections: &[RawSection], shape: &Shape<'_>) -> Result<Option<Self>> {
        Self::from_sections_within(sections, shape, Budget::default())
    }

    /// Like [`FarField::from_sections`], with a limit on the decoded size of coded sections.
    ///
    /// # Errors
    /// As [`FarField::from_sections`], and [`crate::FormatError::OverBudget`].
    pub fn from_sections_within(sections: &[RawSection], shape: &Shape<'_>, budget: Budget) -> Result<Option<Self>> {
        let field = if sections.iter().any(|section| section.tag == tags::CODED) {
            Self::from_coded(sections, shape, budget)?
        } else {
            Self::from_plain(sections, shape)?
        };
        if let Some(field) = &field {
            field.validate(shape)?;
        }
        Ok(field)
    }

    fn from_coded(sections: &[RawSection], shape: &Shape<'_>, budget: Budget) -> Result<Option<Self>> {
        if let Some(both) = sections.iter().find(|section| tags::REPLACED.contains(&section.tag)) {
            return invalid(
                tags::CODED,
                format!("the coefficients are there twice: section {} holds them too", both.tag),
            );
        }
        let wanted = [tags::RECEIVERS, tags::GROUPS, tags::STEPS, tags::ROW_SUMS, tags::CODED];
        let Some([receivers, groups, steps, row_sums, coded]) = pick(sections, wanted, Kind::Method)? else {
            return Ok(None);
        };
        let mut field = Self::read_without_coefficients([receivers, groups, steps, row_sums], shape)?;
        far_functions::read(sections, &mut field)?;
        far_coded::decode(coded.view()?, &mut field, shape, budget)?;
        Ok(Some(field))
    }

    /// Reads everything except nodes, masks and values.
    fn read_without_coefficients(
        [receivers, groups, steps, row_sums]: [&RawSection; 4],
        shape: &Shape<'_>,
    ) -> Result<Self> {
        let group = |[part, rows_end, coefficients_end]: [u32; 3]| Group {
            part,
            rows_end,
            coefficients_end,
            functions: u16::MAX,
        };
        let groups: Vec<Group> = groups.rows()?.into_iter().map(group).collect();
        check_groups(&groups, shape)?;
        let rows = groups.last().map_or(0, |g| g.rows_end as usize);
        let steps: Vec<f32> = steps.rows()?;
        check_steps(&steps)?;
        let terms = steps.len();
        if terms > MOST_TERMS {
            return invalid(tags::STEPS, format!("{terms} basis functions, more than {MOST_TERMS}"));
        }
        let sums: &[u8] = row_sums.view()?;
        same_length(tags::ROW_SUMS, "bytes of row sums", sums.len(), product(&[rows, terms, 4]))?;
        let row_sums = far_sums::decode(sums, terms);
        Ok(Self { terms, receiver_of_vertex: receivers.rows()?, groups, steps, row_sums, ..Self::default() })
    }

    fn from_plain(sections: &[RawSection], shape: &Shape<'_>) -> Result<Option<Self>> {
        let found = pick(sections, tags::ALL, Kind::Method)?;
        let Some([receivers, groups, nodes, masks, wide_masks, steps, row_sums, narrow_rows, wide_rows]) = found else {
            return Ok(None);
        };
        let mut field = Self::read_without_coefficients([receivers, groups, steps, row_sums], shape)?;
        far_functions::read(sections, &mut field)?;
        let count = field.groups.last().map_or(0, |g| g.coefficients_end as usize);
        let nodes: &[u8] = nodes.view()?;
        field.masks = masks.rows()?;
        same_length(tags::MASKS, "coefficients", field.masks.len(), count)?;
        field.wide_masks = wide_masks.rows()?;
        same_length(tags::WIDE_MASKS, "coefficients", field.wide_masks.len(), count)?;
        check_masks(&field.masks, &field.wide_masks, field.terms)?;
        let narrow_stored: &[[i8; LANES]] = narrow_rows.view()?;
        let wide_bytes: &[[u8; LANES]] = wide_rows.view()?;
        field.nodes = read_nodes(nodes, &field.groups, shape)?;
        let rows = (far_values::count(field.narrow_masks()), far_values::count(field.wide_masks.iter().copied()));
        same_length(tags::NARROW, "8-bit rows", narrow_stored.len(), rows.0)?;
        same_length(tags::WIDE, "planes of 16-bit rows", wide_bytes.len(), 2 * rows.1)?;
        field.narrow = by_coefficient(narrow_stored, field.narrow_masks());
        field.wide = by_coefficient(&from_planes(wide_bytes), field.wide_masks.iter().copied());
        Ok(Some(field))
    }
}

fn check_masks(masks: &[u16], wide_masks: &[u16], terms: usize) -> Result<()> {
    if terms > MOST_TERMS {
        return invalid(tags::STEPS, format!("{terms} basis functions, more than {MOST_TERMS}"));
    }
    let beyond = !((1u32 << terms) - 1) as u16;
    if let Some(i) = masks.iter().position(|&mask| mask == 0 || mask & beyond != 0) {
        return invalid(tags::MASKS, format!("mask {i} is {:x}, with {terms} functions", masks[i]));
    }
    match masks.iter().zip(wide_masks).position(|(kept, wide)| wide & !kept != 0) {
        Some(i) => invalid(tags::WIDE_MASKS, format!("mask {i} has functions that are not kept")),
        None => Ok(()),
    }
}

fn check_groups(groups: &[Group], shape: &Shape<'_>) -> Result<()> {
    let mut last = (0, 0);
    for (g, group) in groups.iter().enumerate() {
        let wrong = |what: String| invalid(tags::GROUPS, format!("group {g}: {what}"));
        if shape.samples(group.part).is_none() {
            return wrong(format!("there is no part {} with samples", group.part));
        }
        let rows = i64::from(group.rows_end) - last.0;
        if !(1..=LANES as i64).contains(&rows) {
            return wrong(format!("{rows} rows, not 1 to {LANES}"));
        }
        if i64::from(group.coefficients_end) < last.1 {
            return wrong("its coefficients end before they begin".into());
        }
        last = (group.rows_end.into(), group.coefficients_end.into());
    }
    addressable(tags::GROUPS, last.0.max(last.1) as usize)
}

/// Checks that each vertex has one receiver or none, and that every receiver has a vertex.
fn check_receivers(receiver_of_vertex: &[u32], receivers: usize, shape: &Shape<'_>) -> Result<()> {
    let tag = tags::RECEIVERS;
    same_length(tag, "vertices", receiver_of_vertex.len(), shape.vertices)?;
    if receivers > receiver_of_vertex.len() {
        return invalid(tag, format!("{receivers} receivers for {} vertices", receiver_of_vertex.len()));
    }
    let some = || receiver_of_vertex.iter().filter(|&&receiver| receiver != NO_RECEIVER);
    indices_below(tag, some().copied(), receivers)?;
    let mut used = vec![false; receivers];
    some().for_each(|&receiver| used[receiver as usize] = true);
    match used.iter().position(|used| !used) {
        Some(receiver) => invalid(tag, format!("no vertex has receiver {receiver}")),
        None => Ok(()),
    }
}

/// Checks that steps are positive and their largest multiples finite.
fn check_steps(steps: &[f32]) -> Result<()> {
    if steps.is_empty() {
        return invalid(tags::STEPS, "no basis functions");
    }
    match steps.iter().position(|step| !(*step > 0.0 && (*step * 32768.0).is_finite())) {
        Some(k) => invalid(tags::STEPS, format!("step {k} is {}: it must be above 0 and below 1e34", steps[k])),
        None => Ok(()),
    }
}

fn read_nodes(bytes: &[u8], groups: &[Group], shape: &Shape<'_>) -> Result<Vec<u32>> {
    let coefficients = groups.last().map_or(0, |group| group.coefficients_end as usize);
    if coefficients > bytes.len() {
        return invalid(tags::NODES, format!("{} bytes for {coefficients} nodes", bytes.len()));
    }
    let mut nodes = Vec::with_capacity(coefficients);
    let mut rest = bytes;
    for (group, (_, count)) in groups.iter().zip(group_sizes(groups)) {
        let mut last = shape.samples(group.part).map_or(0, |(first, _)| first);
        for _ in 0..count {
            let step = varints::take(&mut rest).and_then(|step| last.checked_add(step)?.checked_add(1));
            let Some(node) = step else {
                return invalid(tags::NODES, format!("node {} is not a varint that fits u32", nodes.len()));
            };
            nodes.push(node);
            last = node;
        }
    }
    if rest.is_empty() { Ok(nodes) } else { invalid(tags::NODES, format!("{} bytes after the last node", rest.len())) }
}

/// A product of lengths, saturating where it overflows.
fn product(factors: &[usize]) -> usize {
    factors.iter().fold(1, |product, factor| product.saturating_mul(*factor))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_transform_over_lanes_is_orthonormal_and_inverts() {
        let lanes: [f32; LANES] = std::array::from_fn(|i| ((7 * i * i + 3) % 23) as f32 - 11.0);
        let coefficients = transform_lanes(lanes);
        let energy = |values: [f32; LANES]| values.iter().map(|x| x * x).sum::<f32>();
        assert!((energy(coefficients) / energy(lanes) - 1.0).abs() < 1e-6);
        assert!((coefficients[0] - lanes.iter().sum::<f32>() / 4.0).abs() < 1e-5);
        let back = over_lanes(coefficients);
        assert!(lanes.iter().zip(back).all(|(a, b)| (a - b).abs() < 1e-5), "{back:?}");
        assert!(transform_lanes([3.0; LANES])[1..].iter().all(|d| *d == 0.0));
    }
}
