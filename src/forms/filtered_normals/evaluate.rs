//! Filtered normals at run time: the filter of each channel from the ladder, local lighting with it.

use std::sync::{Arc, OnceLock};

use glam::DVec3;
use translux_format::Budget;
use translux_format::filtered_normals::{self as stored, Numbers};

use super::light::{Entrance, Lit, Lookers};
use super::points::{Points, STEPS_OF_OCTAVE, TOLERANCE};
use super::response::{Ladder, dipoles, response};
use super::settings::{Bleeding, Filter, FilteredNormals, Length, Response, Sum};
use crate::asset::Asset;
use crate::compress::ledger::Ledger;
use crate::error::{Error, Result};
use crate::evaluate::{Capabilities, Cost, Evaluator, MaterialEdit, ProfileEdit, SourceFields};
use crate::forms::gathered::GatheredEvaluator;
use crate::geometry::bvh::Bvh;
use crate::geometry::laplacian::Laplacian;
use crate::light::{Light, refuse_fields};
use crate::medium::material::Medium;
use crate::medium::profile::Profile;
use crate::parallel::*;
use crate::progress::{Progress, Silent};
use crate::scene::Scene;
use crate::transport::irradiance::LightSampling;

/// Vertices that errors are measured on.
pub(super) const MEASURED: usize = 2048;

/// The edits that every asset allows.
pub(super) const EDITS: Capabilities =
    Capabilities { material: MaterialEdit::Any, profile: ProfileEdit::None, source_fields: SourceFields::None };

/// Name in ledgers.
pub(super) const STAGE: &str = "filtered normals";

/// Points that are lit together.
const CHUNK: usize = 512;

/// Points with their filtered normals, decoded from the ladder.
#[derive(Clone, Default)]
pub(super) struct Dressed {
    pub(super) at: Vec<DVec3>,
    pub(super) normals: Vec<DVec3>,
    pub(super) medium: Vec<u32>,
    pub(super) open: Vec<f64>,
    /// Columns of each rung of each point.
    fields: Vec<f32>,
    columns: usize,
}

impl Dressed {
    fn new(points: &Points, asset: &stored::FilteredNormals) -> Self {
        let (columns, own) = (asset.columns(), usize::from(asset.numbers.columns));
        let mut dressed = Self {
            at: points.receivers.positions.clone(),
            normals: points.normals.clone(),
            medium: points.medium.clone(),
            open: vec![0.0; points.len()],
            fields: vec![0.0; points.len() * columns],
            columns,
        };
        for (row, r) in points.order.iter().map(|r| *r as usize).enumerate() {
            dressed.open[r] = f64::from(asset.openness[row]) / 255.0;
            for column in 0..columns {
                let code = f64::from(asset.codes[row * columns + column]);
                let value = match column % own {
                    3 => (code / STEPS_OF_OCTAVE).exp2(),
                    _ => code * asset.numbers.step,
                };
                dressed.fields[r * columns + column] = value as f32;
            }
        }
        dressed
    }

    /// Some of the points.
    pub(super) fn only(&self, indices: &[u32]) -> Self {
        let pick = |i: &u32| *i as usize;
        let row = |i: usize| &self.fields[i * self.columns..(i + 1) * self.columns];
        Self {
            at: indices.iter().map(|i| self.at[pick(i)]).collect(),
            normals: indices.iter().map(|i| self.normals[pick(i)]).collect(),
            medium: indices.iter().map(|i| self.medium[pick(i)]).collect(),
            open: indices.iter().map(|i| self.open[pick(i)]).collect(),
            fields: indices.iter().flat_map(|i| row(pick(i))).copied().collect(),
            columns: self.columns,
        }
    }

    /// The filtered normal of a point.
    fn filtered(&self, point: usize, channel: &Channel) -> DVec3 {
        let row = &self.fields[point * self.columns..(point + 1) * self.columns];
        match channel {
            Channel::Sum(coefficients) => {
                let rungs = row.chunks_exact(3).zip(&coefficients[1..]);
                rungs.fold(coefficients[0] * self.normals[point], |sum, (v, c)| {
                    sum + *c * DVec3::new(v[0].into(), v[1].into(), v[2].into())
                })
            }
            Channel::Between { rung, share, alpha, sum } => {
                let of = |rung: usize| {
                    let v = &row[rung * 4..rung * 4 + 4];
                    (DVec3::new(v[0].into(), v[1].into(), v[2].into()), f64::from(v[3]))
                };
                let ((a, za), (b, zb)) = (of(*rung), of(*rung + 1));
                let mean = a.lerp(b, *share);
                let weight = za.powf(1.0 - share) * zb.powf(*share);
                match sum {
                    Sum::Plain => (*alpha * self.normals[point] + weight * mean) / (alpha + weight),
                    Sum::Mean => *alpha * self.normals[point] + (1.0 - alpha) * mean,
                }
            }
        }
    }
}

/// The filter of a channel over the ladder.
pub(super) enum Channel {
    /// Coefficients of the normal itself and of every rung.
    Sum(Vec<f64>),
    /// Between a rung and the next.
    Between { rung: usize, share: f64, alpha: f64, sum: Sum },
}

/// Filters, total reflectances and entrance of a medium.
pub(super) struct MediumFilter {
    channels: [Channel; 3],
    totals: DVec3,
    entrance: Entrance,
}

/// Maker of the filters of media, from the settings.
pub(super) struct Filters {
    form: FilteredNormals,
    ladder: Ladder,
    widths: Vec<f64>,
}

impl Filters {
    /// The filters of a medium, for an alpha and a factor of the width.
    pub(super) fn of(&self, medium: &Medium, (alpha, width): (f64, f64)) -> MediumFilter {
        let dipoles = dipoles(medium);
        let channels = dipoles.each_ref().map(|dipole| match self.form.filter {
            Filter::Geometric { sum, .. } => {
                let sigma = match self.form.response {
                    Response::Exponential(Some(sigma)) => sigma,
                    _ => dipole.sigma_tr_per_mm,
                };
                let (rung, share) = between(&self.widths, width / sigma);
                Channel::Between { rung, share, alpha, sum }
            }
            _ => {
                let of = |lambda: f64| response(self.form.response, dipole, lambda);
                Channel::Sum(self.ladder.coefficients(alpha, width, of).0)
            }
        });
        let totals = DVec3::from_array(dipoles.map(|d| d.total()));
        MediumFilter { channels, totals, entrance: Entrance::new(medium.properties.eta_inside_over_outside) }
    }
}

/// The rung before a width and the share of the next, by logarithms; widths descend.
fn between(widths: &[f64], width: f64) -> (usize, f64) {
    let last = widths.len().saturating_sub(2);
    let rung = widths.iter().skip(1).position(|w| *w <= width).unwrap_or(last).min(last);
    match widths.get(rung..rung + 2) {
        Some([a, b]) if width > 0.0 => (rung, ((a / width).ln() / (a / b).ln()).clamp(0.0, 1.0)),
        _ => (rung, 1.0),
    }
}

/// Radiosity of some points.
pub(super) fn local_lighting(dressed: &Dressed, filters: &[MediumFilter], length: Length, lit: &Lit) -> Vec<DVec3> {
    let mut out = vec![DVec3::ZERO; dressed.at.len()];
    out.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, out)| {
        for (i, out) in out.iter_mut().enumerate() {
            let point = chunk * CHUNK + i;
            let Some(medium) = filters.get(dressed.medium[point] as usize) else { continue };
            for (c, channel) in medium.channels.iter().enumerate() {
                let filtered = dressed.filtered(point, channel);
                let unit = filtered.normalize_or(dressed.normals[point]);
                let (factor, spread) = match length {
                    Length::Unit => (1.0, 1.0),
                    Length::Kept => (filtered.length(), 1.0),
                    Length::Spread => (1.0, filtered.length().min(1.0)),
                };
                let e = lit.irradiance(point, dressed.at[point], (unit, spread), dressed.open[point], &medium.entrance);
                out[c] = medium.totals[c] * factor * e[c];
            }
        }
    });
    out
}

/// Evaluator of filtered normals, with the lights in force.
pub(super) struct FilteredNormalsEvaluator {
    pub(super) form: FilteredNormals,
    pub(super) scene: Scene,
    bvh: OnceLock<Bvh>,
    pub(super) points: Points,
    pub(super) dressed: Dressed,
    pub(super) numbers: Numbers,
    pub(super) filters: Filters,
    of_media: Vec<MediumFilter>,
    laplacian: OnceLock<Laplacian>,
    lights: Vec<Light>,
    lit: Option<Lit>,
    pub(super) truth: Option<Box<GatheredEvaluator>>,
}

pub(super) fn open(form: &FilteredNormals, asset: &Arc<Asset>) -> Result<Box<dyn Evaluator>> {
    let points = Points::new(&asset.scene);
    let input = |e: translux_format::FormatError| Error::input(e.to_string());
    let fields = stored::FilteredNormals::from_sections(&asset.sections, &points.earlier(), Budget::default())
        .map_err(input)?
        .ok_or_else(|| Error::input("an asset without its filtered normals (section fln.fld); bake it again"))?;
    Ok(Box::new(FilteredNormalsEvaluator::new(form, &asset.scene, points, &fields)?))
}

impl FilteredNormalsEvaluator {
    pub(super) fn new(
        form: &FilteredNormals,
        scene: &Scene,
        points: Points,
        fields: &stored::FilteredNormals,
    ) -> Result<Self> {
        let expected = if matches!(form.filter, Filter::Geometric { .. }) { 4 } else { 3 };
        let descend = fields.numbers.rungs.windows(2).all(|w| w[0] > w[1]);
        if fields.numbers.columns != expected || fields.numbers.rungs.len() < 2 || !descend {
            return Err(Error::input(
                "the rungs of the filtered normals (section fln.rec) are not those of its filter",
            ));
        }
        let dressed = Dressed::new(&points, fields);
        let widths = fields.numbers.rungs.clone();
        let filters = Filters { form: *form, ladder: Ladder::new(&widths), widths };
        let mut made = Self {
            form: *form,
            scene: scene.clone(),
            bvh: OnceLock::new(),
            points,
            dressed,
            numbers: fields.numbers.clone(),
            filters,
            of_media: Vec::new(),
            laplacian: OnceLock::new(),
            lights: Vec::new(),
            lit: None,
            truth: None,
        };
        made.refilter();
        Ok(made)
    }

    /// The filters of the media in force.
    pub(super) fn refilter(&mut self) {
        let shape = (self.numbers.alpha, self.numbers.width);
        self.of_media = self.scene.media.iter().map(|medium| self.filters.of(medium, shape)).collect();
    }

    pub(super) fn bvh(&self) -> &Bvh {
        self.bvh.get_or_init(|| Bvh::new(&self.scene.mesh))
    }

    pub(super) fn lookers<'a>(&self, dressed: &'a Dressed) -> Lookers<'a> {
        let (origin_mm, shadows) = (self.scene.mesh.origin_mm, self.form.shadows);
        Lookers { at: &dressed.at, normals: &dressed.normals, open: &dressed.open, origin_mm, shadows }
    }

    fn lit(&self, lights: &[Light]) -> Result<Lit> {
        match self.form.bleeding {
            Bleeding::Off => Lit::new(self.lookers(&self.dressed), self.bvh(), lights),
            Bleeding::Irradiance => Ok(Lit::default()),
        }
    }

    /// Radiosity of the points under some lights.
    pub(super) fn under(&self, lights: &[Light], lit: &Lit) -> Result<Vec<DVec3>> {
        match self.form.bleeding {
            Bleeding::Off => Ok(local_lighting(&self.dressed, &self.of_media, self.form.length, lit)),
            Bleeding::Irradiance => self.bled(lights),
        }
    }

    pub(super) fn radiosity_under(&self, lights: &[Light]) -> Result<Vec<DVec3>> {
        self.under(lights, &self.lit(lights)?)
    }

    /// The irradiance under the geometric normals, through the filter.
    fn bled(&self, lights: &[Light]) -> Result<Vec<DVec3>> {
        refuse_fields(lights)?;
        let etas: Vec<f64> = self.scene.media.iter().map(|m| m.properties.eta_inside_over_outside).collect();
        let scene = (&self.scene, self.bvh());
        let irradiance = self.points.irradiance(scene, lights, &etas, LightSampling::FAST, &Silent)?;
        let laplacian = self.laplacian.get_or_init(|| self.points.laplacian());
        let own: Vec<[f64; 3]> = laplacian.at_nodes(&irradiance).iter().map(|e| e.to_array()).collect();
        let medium = laplacian.at_nodes(&self.points.medium);
        let mut sums = vec![DVec3::ZERO; own.len()];
        let mut values = own.clone();
        // From narrow to wide, and the irradiance itself first.
        for rung in (0..=self.numbers.rungs.len()).rev() {
            if let Some(width) = self.numbers.rungs.get(rung) {
                laplacian.diffused(width * width, &own, &mut values, TOLERANCE);
            }
            let place = if rung == self.numbers.rungs.len() { 0 } else { rung + 1 };
            for ((sum, value), medium) in sums.iter_mut().zip(&values).zip(&medium) {
                let Some(filter) = self.of_media.get(*medium as usize) else { continue };
                for c in 0..3 {
                    if let Channel::Sum(coefficients) = &filter.channels[c] {
                        sum[c] += filter.totals[c] * coefficients[place] * value[c];
                    }
                }
            }
        }
        // A vertex without area has its own irradiance and no others'.
        let mut all = laplacian.at_vertices(&sums, DVec3::ZERO);
        for (r, value) in all.iter_mut().enumerate().filter(|(r, _)| self.points.areas[*r] == 0.0) {
            let totals = self.of_media.get(self.points.medium[r] as usize).map_or(DVec3::ZERO, |m| m.totals);
            *value = totals * irradiance[r];
        }
        // The ladder undershoots by the error of its response where all is dark.
        all.iter_mut().for_each(|b| *b = b.max(DVec3::ZERO));
        Ok(all)
    }
}

impl Evaluator for FilteredNormalsEvaluator {
    fn capabilities(&self) -> Capabilities {
        EDITS
    }

    fn cost(&self) -> Cost {
        let of_point = 2 * size_of::<DVec3>() + size_of::<f64>() + size_of::<u32>();
        Cost {
            samples: self.numbers.samples as usize,
            receivers: self.points.len(),
            resident_bytes: size_of_val(self.dressed.fields.as_slice())
                + of_point * self.points.len()
                + size_of_val(self.points.receivers.of_vertex.as_slice()),
        }
    }

    fn scene(&self) -> &Scene {
        &self.scene
    }

    fn bvh(&self) -> &Bvh {
        Self::bvh(self)
    }

    fn set_lights(&mut self, lights: Vec<Light>, _: &dyn Progress) -> Result<()> {
        refuse_fields(&lights)?;
        self.lit = Some(self.lit(&lights)?);
        self.lights = lights;
        Ok(())
    }

    fn set_media(&mut self, media: Vec<Medium>) -> Result<()> {
        if media.len() != self.scene.media.len() {
            let (given, there) = (media.len(), self.scene.media.len());
            return Err(Error::command_line(format!("{given} materials for the {there} media of the asset")));
        }
        if let Some(truth) = &mut self.truth {
            truth.set_media(media.clone())?;
        }
        self.scene.media = media;
        self.refilter();
        Ok(())
    }

    fn radiosity(&mut self, _: &dyn Progress) -> Result<Vec<DVec3>> {
        let values = match &self.lit {
            Some(lit) => self.under(&self.lights, lit)?,
            None => vec![DVec3::ZERO; self.points.len()],
        };
        Ok(self.points.receivers.expand(&values))
    }

    fn measured_error(&mut self, unseen: &[Light], progress: &dyn Progress) -> Result<Ledger> {
        let together = [self.lights.clone()];
        let each = unseen.iter().map(|light| vec![light.clone()]);
        let sets: Vec<Vec<Light>> = together.into_iter().chain(each).collect();
        let error = self.error_under(&sets, MEASURED, progress)?;
        let mut ledger = Ledger::default();
        ledger.add(STAGE, error, "against exact sums over samples, the worst of these lights and of probe lights");
        Ok(ledger)
    }

    fn all_pairs(&mut self, progress: &dyn Progress) -> Result<Vec<DVec3>> {
        let lights = self.lights.clone();
        let truth = self.truth();
        truth.set_lights(lights, progress)?;
        truth.all_pairs(progress)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn widths_are_found_between_rungs() {
        let widths = [8.0, 4.0, 2.0, 1.0];
        for (width, rung, share) in
            [(8.0, 0, 0.0), (9.0, 0, 0.0), (4.0, 0, 1.0), (2.0, 1, 1.0), (1.0, 2, 1.0), (0.1, 2, 1.0)]
        {
            let (found, at) = between(&widths, width);
            assert_eq!((found, at), (rung, share), "{width}");
        }
        let (rung, share) = between(&widths, 8f64.sqrt());
        assert!(rung == 1 && (share - 0.5).abs() < 1e-12);
        assert_eq!(between(&widths, f64::INFINITY), (0, 0.0));
    }
}
