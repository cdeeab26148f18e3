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
