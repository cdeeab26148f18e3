//! The cheapest candidate that is expected to meet a request.
//!
//! In this order: the limits that are asked for hold; the file is the smallest that meets the error; among files up to a quarter larger,
//! the one that a person waits least for, who bakes once and turns the light a hundred times. Where nothing is said of time, a new light
//! may take a second and a bake ten minutes, as long as anything meets the error in that time.

use super::candidates::Candidate;
use super::record::{Attempt, Considered, Left};
use super::request::Request;
use super::truth::Sampling;
use crate::error::Result;
use crate::report::text::{megabytes, percent, significant};

/// A file may be so much larger than the smallest for the sake of less waiting.
const BAND: f64 = 1.25;

/// New lights for each bake.
const RELIGHTS: f64 = 100.0;

/// Share of the asked error that a choice aims at, and the share from which on a bake is no use: forecasts are not exact. At 0.8 igea_8k in
/// skin1 was baked in vain, whose samples are half as far off again under the verdict's lamps.
const AIM: f64 = 0.72;
const HOPELESS: f64 = 1.25;

/// What has been learnt of a family: measured over expected.
#[derive(Clone, Copy)]
struct Learnt {
    rms: f64,
    dark: f64,
    bytes: f64,
}

/// How strict a choice is.
#[derive(Clone, Copy)]
struct Strictness {
    /// Share of the asked error.
    share: f64,
    /// Whether what nobody asked for counts: the time of a new light and of a bake that a person waits.
    patience: bool,
}

/// From the strictest on.
const STEPS: [Strictness; 6] = [
    Strictness { share: AIM, patience: true },
    Strictness { share: AIM, patience: false },
    Strictness { share: 1.0, patience: true },
    Strictness { share: 1.0, patience: false },
    Strictness { share: HOPELESS, patience: true },
    Strictness { share: HOPELESS, patience: false },
];

/// Chooses among candidates, and learns from those that were baked.
pub(super) struct Choice<'a> {
    all: &'a [Candidate],
    request: Request,
    learnt: Vec<Learnt>,
    /// What has been learnt of what samples add to the RMS, the same in all families: stages are tuned, so that what is more than expected
    /// comes from samples where there are any.
    of_samples: f64,
    /// Samples of the asset with the most of those that were baked and missed.
    missed_with: usize,
    tried: Vec<bool>,
}

impl<'a> Choice<'a> {
    pub(super) fn new(all: &'a [Candidate], request: &Request, families: usize) -> Self {
        let learnt = vec![Learnt { rms: 1.0, dark: 1.0, bytes: 1.0 }; families];
        Self { all, request: request.clone(), learnt, of_samples: 1.0, missed_with: 0, tried: vec![false; all.len()] }
    }

    /// The next candidate to bake; none where nothing is expected to meet the request. Before anything was baked, an error that nobody
    /// asked for grows until something reaches it.
    pub(super) fn next(&mut self, considered: &mut [Considered], sampling: &mut Sampling) -> Result<Option<usize>> {
        loop {
            let found = self.next_for_request(considered, sampling)?;
            let untouched = !self.tried.contains(&true);
            match self.request.relaxed(0.0).filter(|_| found.is_none() && untouched) {
                Some(larger) => self.request.max_rms = larger,
                None => return Ok(found),
            }
        }
    }

    /// The error that is asked for, or what stands for it.
    pub(super) fn max_rms(&self) -> f64 {
        self.request.max_rms
    }

    fn next_for_request(&mut self, considered: &mut [Considered], sampling: &mut Sampling) -> Result<Option<usize>> {
        for step in STEPS {
            if let Some(index) = self.cheapest(step, considered, sampling)? {
                self.tried[index] = true;
                let entry = &mut considered[self.all[index].entry];
                (entry.left, entry.why) = (None, "chosen".to_owned());
                return Ok(Some(index));
            }
        }
        Ok(None)
    }

    fn cheapest(
        &self,
        step: Strictness,
        considered: &mut [Considered],
        sampling: &mut Sampling,
    ) -> Result<Option<usize>> {
        let mut open: Vec<usize> = Vec::new();
        for index in (0..self.all.len()).filter(|&index| !self.tried[index]) {
            let entry = &mut considered[self.all[index].entry];
            match self.beyond_limits(index, step.patience) {
                Some((left, why)) => (entry.left, entry.why) = (Some(left), why),
                None => open.push(index),
            }
        }
        open.sort_by(|&a, &b| self.bytes(a).total_cmp(&self.bytes(b)));
        let mut best: Option<(f64, usize)> = None;
        let mut most = f64::INFINITY;
        for index in open {
            if self.bytes(index) > most {
                break;
            }
            let waiting = self.waiting(index);
            if best.is_some_and(|(least, _)| waiting >= least)
                || !self.is_exact(index, step.share, considered, sampling)?
            {
                continue;
            }
            if best.is_none() {
                most = BAND * self.bytes(index);
            }
            let entry = &mut considered[self.all[index].entry];
            (entry.left, entry.why) = (Some(Left::Costlier), "costs more than what was chosen".to_owned());
            best = Some((waiting, index));
        }
        Ok(best.map(|(_, index)| index))
    }

    /// Expected size of the file.
    fn bytes(&self, index: usize) -> f64 {
        let candidate = &self.all[index];
        candidate.file_bytes + (self.learnt[candidate.family].bytes - 1.0) * candidate.forecast.bytes
    }

    /// Expected seconds that a person waits.
    fn waiting(&self, index: usize) -> f64 {
        let forecast = &self.all[index].forecast;
        forecast.bake_s + 1e-3 * RELIGHTS * forecast.slowest_relight_ms(&self.request.for_lights)
    }

    /// The limit of size or time that a candidate is expected to exceed, in words.
    fn beyond_limits(&self, index: usize, patience: bool) -> Option<(Left, String)> {
        let (candidate, request) = (&self.all[index], &self.request);
        let bytes = candidate.forecast.bytes * self.learnt[candidate.family].bytes;
        let per_vertex = bytes / candidate.vertices.max(1) as f64;
        if let Some(most) = request.max_bytes_per_vertex.filter(|most| per_vertex > *most) {
            let [found, most] = [per_vertex, most].map(significant);
            return Some((Left::Size, format!("about {found} bytes/vertex are expected, and {most} allowed")));
        }
        if let Some(most) = request.max_bytes.filter(|most| self.bytes(index) > *most as f64) {
            let [found, most] = [self.bytes(index) as u64, most].map(megabytes);
            return Some((Left::Size, format!("about {found} are expected, and {most} allowed")));
        }
        let (relight_ms, bake_s) =
            (candidate.forecast.slowest_relight_ms(&request.for_lights), candidate.forecast.bake_s);
        if (patience || request.max_relight_ms.is_some()) && relight_ms > request.relight_ms() {
            let [found, most] = [relight_ms, request.relight_ms()].map(significant);
            return Some((Left::Relight, format!("a new light is expected to take {found} ms, more than {most} ms")));
        }
        if (patience || request.max_bake_s.is_some()) && bake_s > request.bake_s() {
            let [found, most] = [bake_s, request.bake_s()].map(significant);
            return Some((Left::Bake, format!("the bake is expected to take {found} s, more than {most} s")));
        }
        None
    }

    /// Expected RMS and dark error. Samples and stages err independently.
    pub(super) fn expected(&self, candidate: &Candidate, sampling: &mut Sampling) -> Result<(f64, f64)> {
        let of_samples =
            candidate.forecast.erring_samples().map(|samples| sampling.error(samples)).transpose()?.unwrap_or_default();
        let learnt = self.learnt[candidate.family];
        let stages = candidate.forecast.rms;
        Ok((
            learnt.rms * (self.of_samples * of_samples.rms).hypot(stages),
            learnt.dark * (of_samples.dark + candidate.forecast.dark_over_rms * stages),
        ))
    }

    fn is_exact(
        &self,
        index: usize,
        share: f64,
        considered: &mut [Considered],
        sampling: &mut Sampling,
    ) -> Result<bool> {
        let (candidate, request) = (&self.all[index], &self.request);
        // What as many samples cost has been measured: nothing is left to luck.
        let is_known = candidate.forecast.erring_samples().is_some_and(|samples| samples <= self.missed_with);
        let share = if is_known { share.min(1.0) } else { share };
        let entry = &mut considered[candidate.entry];
        let mut set = |rms: Option<f64>, why: String| {
            if let Some(expected) = &mut entry.expected {
                expected.rms = rms.or(expected.rms);
            }
            (entry.left, entry.why) = (Some(Left::Error), why);
        };
        let too_large = |found: f64, most: f64, what: &str| {
            let [found, aim, most] = [found, share * most, most].map(percent);
            format!("{found}{what} expected, more than {aim} of the {most} asked for")
        };
        // Its own stages alone may be too much; samples need no measurement then.
        let stages = self.learnt[candidate.family].rms * candidate.forecast.rms;
        if stages > share * request.max_rms {
            set(None, too_large(stages, request.max_rms, " RMS of its stages alone"));
            return Ok(false);
        }
        let sharp = candidate
            .forecast
            .erring_samples()
            .map(|samples| sampling.error_under_sharp_lights(samples))
            .transpose()?;
        let learnt = self.learnt[candidate.family];
        let of_samples = self.of_samples * sharp.unwrap_or_default().rms;
        let sharp = learnt.rms * of_samples.hypot(candidate.forecast.rms);
        if sharp > share * request.max_rms {
            set(Some(sharp), too_large(sharp, request.max_rms, " RMS"));
            return Ok(false);
        }
        let (rms, dark) = self.expected(candidate, sampling)?;
        if rms > share * request.max_rms {
            set(Some(rms), too_large(rms, request.max_rms, " RMS"));
            return Ok(false);
        }
        if let Some(most) = request.max_dark.filter(|most| dark > share * most) {
            set(Some(rms), too_large(dark, most, " in the dark part"));
            return Ok(false);
        }
        set(Some(rms), String::new());
        Ok(true)
    }

    /// Takes note of what came of a candidate.
    pub(super) fn learn(
        &mut self,
        candidate: &Candidate,
        attempt: &Attempt,
        considered: &mut [Considered],
        sampling: &mut Sampling,
    ) -> Result<()> {
        let (rms, dark) = self.expected(candidate, sampling)?;
        let of_samples =
            candidate.forecast.erring_samples().map(|samples| sampling.error(samples)).transpose()?.map(|e| e.rms);
        let ratio = |measured: f64, expected: f64| if expected > 0.0 { measured / expected } else { 1.0 };
        let learnt = &mut self.learnt[candidate.family];
        // Only for the worse: what was better than expected may have been lucky.
        let more = ratio(attempt.error.rms, rms).max(1.0);
        match of_samples {
            Some(of_samples) if of_samples > 0.0 => {
                let beyond = (attempt.error.rms / learnt.rms).powi(2) - candidate.forecast.rms.powi(2);
                self.of_samples = self.of_samples.max(beyond.max(0.0).sqrt() / of_samples);
            }
            _ => learnt.rms *= more,
        }
        learnt.dark *= ratio(attempt.error.dark, dark).max(1.0);
        let bytes = attempt.bytes_per_vertex * candidate.vertices.max(1) as f64;
        learnt.bytes = ratio(bytes, candidate.forecast.bytes);
        if !attempt.misses.is_empty() {
            self.missed_with = self.missed_with.max(candidate.forecast.erring_samples().unwrap_or(0));
            let entry = &mut considered[candidate.entry];
            (entry.left, entry.why) =
                (Some(Left::Missed), format!("was baked, and missed: {}", attempt.misses.join("; ")));
        }
        Ok(())
    }

    /// What would meet the request where nothing does, or which request could be met.
    pub(super) fn would_meet(&self, considered: &[Considered], sampling: &mut Sampling) -> Result<String> {
        let request = &self.request;
        let mut found: Vec<(usize, f64, bool)> = Vec::with_capacity(self.all.len());
        for index in 0..self.all.len() {
            let (rms, dark) = self.expected(&self.all[index], sampling)?;
            let exact = rms <= request.max_rms && request.max_dark.is_none_or(|most| dark <= most);
            found.push((index, rms, exact));
        }
        let smallest =
            found.iter().filter(|(_, _, exact)| *exact).min_by(|a, b| self.bytes(a.0).total_cmp(&self.bytes(b.0)));
        let within = |index: usize| self.beyond_limits(index, false).is_none();
        let most_exact = found.iter().filter(|(index, ..)| within(*index)).min_by(|a, b| a.1.total_cmp(&b.1));
        let mut ways = Vec::new();
        if let Some((index, ..)) = smallest.filter(|(index, ..)| !within(*index)) {
            let candidate = &self.all[*index];
            let per_vertex =
                candidate.forecast.bytes * self.learnt[candidate.family].bytes / candidate.vertices.max(1) as f64;
            ways.push(format!(
                "{}, expected at {} ({} bytes/vertex), {} ms for a new light and a bake of {} s",
                considered[candidate.entry].name(),
                megabytes(self.bytes(*index) as u64),
                significant(per_vertex),
                significant(candidate.forecast.slowest_relight_ms(&request.for_lights)),
                significant(candidate.forecast.bake_s),
            ));
        }
        if let Some((index, rms, _)) = most_exact {
            let asked = percent(rms / AIM);
            ways.push(format!(
                "--max-rms {} with {}",
                asked.replace(' ', ""),
                considered[self.all[*index].entry].name()
            ));
        }
        Ok(if ways.is_empty() {
            "nothing that this program bakes serves these lights and edits within these limits; ask for fewer"
                .to_owned()
        } else {
            ways.join("; or ")
        })
    }
}
