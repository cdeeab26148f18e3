//! The basis of radial profiles: an edited material is projected on it with one dot product per function.

use serde::{Deserialize, Serialize};

use crate::asset::{RawSection, pick};
use crate::checks::{in_range, invalid, same_length};
use crate::error::Result;
use crate::types::{Codec, Kind};

/// Tags of the profile basis.
pub mod tags {
    use crate::types::Tag;

    /// Split radius, a record.
    pub const SPLIT: Tag = Tag::from_static("bas.rec");
    /// Nodes, f64.
    pub const NODES: Tag = Tag::from_static("bas.nod");
    /// Weights of the nodes, f64.
    pub const WEIGHTS: Tag = Tag::from_static("bas.wgt");
    /// Functions at the nodes, f32.
    pub const FUNCTIONS: Tag = Tag::from_static("bas.fun");

    /// All mandatory tags, in the order of the file.
    pub const ALL: [Tag; 4] = [SPLIT, NODES, WEIGHTS, FUNCTIONS];

    /// Totals of the functions, f64; only where coefficients must not be negative.
    pub const TOTALS: Tag = Tag::from_static("bas.tot");
}

/// Functions b_k(r) on shared nodes. The coefficients of a far profile f are `s_k = Sum_g weight_g f(r_g) b_k(r_g)`,
/// and `f(r) ~ Sum_k s_k b_k(r)`. Where there are totals s minimises `Sum_g weight_g (Sum_k s_k b_k(r_g) - f(r_g))^2`
/// instead, none of it negative and `Sum_k s_k total_k` the total of f up to the last node.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ProfileBasis {
    /// Split radius in mm: inside it a far profile is the even polynomial that continues R_d.
    pub split_mm: f64,
    /// Nodes r_g in mm, ascending; the last one is the largest distance that the basis serves.
    pub nodes_mm: Vec<f64>,
    /// Quadrature weights of the nodes, mm^4.
    pub weights_mm4: Vec<f64>,
    /// b_k(r_g), function after function, 1/mm^2.
    pub functions: Vec<f32>,
    /// Total of each function up to the last node, positive, without unit.
    pub totals: Option<Vec<f64>>,
}

/// Content of the record.
#[derive(Serialize, Deserialize)]
struct Record {
    split_mm: f64,
}

impl ProfileBasis {
    /// Number of functions K.
    pub fn terms(&self) -> usize {
        self.functions.len().checked_div(self.nodes_mm.len()).unwrap_or(0)
    }

    /// Checks every length, order and range that [`ProfileBasis::from_sections`] guarantees.
    ///
    /// # Errors
    /// [`crate::FormatError::Invalid`] with the tag of the section at fault.
    pub fn validate(&self) -> Result<()> {
        in_range(tags::SPLIT, "the split radius", &[self.split_mm], 0.0)?;
        let nodes = &self.nodes_mm;
        if nodes.is_empty() {
            return invalid(tags::NODES, "no nodes");
        }
        in_range(tags::NODES, "a node", nodes, 0.0)?;
        if let Some(i) = nodes.windows(2).position(|pair| pair[0] >= pair[1]) {
            return invalid(tags::NODES, format!("node {} does not lie beyond the one before it", i + 1));
        }
        same_length(tags::WEIGHTS, "nodes", self.weights_mm4.len(), nodes.len())?;
        in_range(tags::WEIGHTS, "a weight", &self.weights_mm4, f64::NEG_INFINITY)?;
        let values = self.functions.len();
        if values == 0 || !values.is_multiple_of(nodes.len()) {
            return invalid(
                tags::FUNCTIONS,
                format!("{values} values are not whole functions on {} nodes", nodes.len()),
            );
        }
        if let Some(i) = self.functions.iter().position(|x| !x.is_finite()) {
            return invalid(tags::FUNCTIONS, format!("value {i} is not finite"));
        }
        let Some(totals) = &self.totals else { return Ok(()) };
        same_length(tags::TOTALS, "functions", totals.len(), self.terms())?;
        match totals.iter().position(|total| !(*total > 0.0 && total.is_finite())) {
            Some(k) => invalid(tags::TOTALS, format!("total {k} is {}: it must be positive", totals[k])),
            None => Ok(()),
        }
    }

    /// The sections of a valid basis.
    ///
    /// # Errors
    /// [`crate::FormatError::Invalid`] as [`ProfileBasis::validate`].
    pub fn to_sections(&self) -> Result<Vec<RawSection>> {
        self.validate()?;
        let (kind, zstd) = (Kind::Method, Codec::Zstd);
        let mut sections = vec![
            RawSection::from_record(tags::SPLIT, kind, zstd, &Record { split_mm: self.split_mm })?,
            RawSection::from_rows(tags::NODES, kind, zstd, &self.nodes_mm),
            RawSection::from_rows(tags::WEIGHTS, kind, zstd, &self.weights_mm4),
            RawSection::from_rows(tags::FUNCTIONS, kind, zstd, &self.functions),
        ];
        if let Some(totals) = &self.totals {
            sections.push(RawSection::from_rows(tags::TOTALS, kind, zstd, totals));
        }
        Ok(sections)
    }

    /// Reads the basis among the sections of an asset; `None` where there is none. Other sections are ignored.
    ///
    /// # Errors
    /// [`crate::FormatError::MissingSection`] where only some exist, and any fault of their type or content.
    pub fn from_sections(sections: &[RawSection]) -> Result<Option<Self>> {
        let Some([split, nodes, weights, functions]) = pick(sections, tags::ALL, Kind::Method)? else {
            return Ok(None);
        };
        let basis = Self {
            split_mm: split.record::<Record>()?.split_mm,
            nodes_mm: nodes.rows()?,
            weights_mm4: weights.rows()?,
            functions: functions.rows()?,
            totals: match pick(sections, [tags::TOTALS], Kind::Method)? {
                Some([totals]) => Some(totals.rows()?),
                None => None,
            },
        };
        basis.validate()?;
        Ok(Some(basis))
    }
}
