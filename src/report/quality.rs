//! Whether the errors of an asset are those that were asked for: one rule for whoever bakes and for whoever validates.

use super::inspection::PLAN;
use super::text::percent;
use crate::compress::ledger::Ledger;

/// What the errors of an asset miss of the relative error that was asked for. Where the asset was planned, its error was measured from
/// end to end, and the notes tell what it misses of all that was asked for; else the stages of its ledger count, those of environments
/// included where it has them.
pub(crate) fn missed_quality(notes: &[String], ledger: &Ledger, asked: f64) -> Option<String> {
    let mut plan = notes.iter().filter_map(|note| note.strip_prefix(PLAN)).peekable();
    if plan.peek().is_some() {
        let missed = plan.find_map(|sentence| sentence.strip_prefix("missed: "));
        return missed.map(|what| format!("the request is not met: {what}"));
    }
    let (near, all) = (ledger.total_rms_without_environment(), ledger.total_rms());
    let above = |errors: f64, under: &str| {
        let [errors, asked] = [errors, asked].map(percent);
        format!("errors of {errors} in all{under}, above the asked {asked}")
    };
    match (near > asked, all > asked) {
        (true, _) => Some(above(near, "")),
        (false, true) => Some(above(all, " under environments")),
        (false, false) => None,
    }
}

/// The error that an asset promises, RMS: where it was planned, what was asked of the whole or was found to be possible, as the notes tell
/// it; else what was asked, or the sum of its ledger where that is more.
pub(crate) fn promised_rms(notes: &[String], ledger: &Ledger, asked: f64) -> f64 {
    let planned = notes.iter().find_map(|note| note.strip_prefix(PLAN)?.strip_prefix("asked: "));
    let of_plan = planned.and_then(|sentence| {
        let words: Vec<&str> = sentence.split_whitespace().collect();
        let share = |three: &[&str]| match three {
            [number, "%", next] if next.starts_with("RMS") || *next == "is" => number.parse::<f64>().ok(),
            _ => None,
        };
        words.windows(3).filter_map(share).next_back()
    });
    of_plan.map_or_else(|| asked.max(ledger.total_rms()), |percent| percent / 100.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_planned_asset_promises_what_was_asked_of_the_whole() {
        let of = |note: &str| promised_rms(&[note.to_owned()], &Ledger::default(), 0.001);
        assert_eq!(of("plan: asked: at most 1.28 % RMS under all kinds of light"), 0.0128);
        let relaxed = "plan: asked: no error, so at most 1 % RMS, where the model's own error is 3 %; nothing reaches that under \
                       suns, 2.5 % is what does, 3 % in the dark part";
        assert_eq!(of(relaxed), 0.025);
        assert_eq!(of("1 component -> 1 part (auto)"), 0.001);
    }
}
