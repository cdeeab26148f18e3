//! The thread that turns colours into coefficients: totals of some profiles need tables, which take too long for a
//! frame.

use super::answering::Answering;
use crate::error::Result;
use crate::medium::inversion::{Inversion, Reflector, Target, invert};
use crate::medium::material::OpticalProperties;

/// The task of a question.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Task {
    /// Find the colour of a medium.
    ColourOf(OpticalProperties),
    /// Find the medium of a colour.
    MediumOf(Target),
}

/// A question about a medium.
#[derive(Clone, Debug)]
pub(super) struct Question {
    /// Serial number of the question.
    pub(super) ticket: u64,
    pub(super) reflector: Reflector,
    pub(super) task: Task,
}

impl Question {
    /// The answer, computed at once.
    pub(super) fn answered(&self) -> Result<Inversion> {
        match &self.task {
            Task::ColourOf(properties) => Inversion::of_medium(&self.reflector, properties),
            Task::MediumOf(target) => invert(&self.reflector, target),
        }
    }
}

/// The answer to a question.
pub(super) struct Answer {
    pub(super) ticket: u64,
    pub(super) result: Result<Inversion>,
}

/// The thread that answers questions.
pub(super) type Colours = Answering<Question, Answer>;

/// Starts the thread; `wake` is called after every answer.
pub(super) fn start(wake: impl Fn() + Send + 'static) -> Result<Colours> {
    let answer = |question: Question| Answer { ticket: question.ticket, result: question.answered() };
    Answering::start("colours", move || answer, wake)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::sync::mpsc::channel;

    use glam::DVec3;

    use super::*;
    use crate::medium::fresnel::diffuse_transmittance;
    use crate::medium::inversion::Radius;
    use crate::medium::material::preset;

    #[test]
    fn the_newest_question_is_answered() {
        let (wake, woken) = channel();
        let colours = start(move || wake.send(()).unwrap_or_default()).unwrap();
        let medium = preset("marble").unwrap().properties();
        for ticket in 1..=50 {
            let colour = DVec3::splat(0.01 * ticket as f64);
            let task = match ticket {
                50 => Task::ColourOf(medium),
                _ => Task::MediumOf(Target::of_medium(&medium, Radius::MeanFreePath, colour, colour)),
            };
            colours.ask(Question { ticket, reflector: Reflector::default(), task });
        }
        let mut last = None;
        while last.as_ref().is_none_or(|answer: &Answer| answer.ticket < 50) {
            woken.recv().unwrap();
            last = colours.answer().or(last);
        }
        let inversion = last.unwrap().result.unwrap();
        assert_eq!(inversion.properties, medium);
        let published = diffuse_transmittance(1.5) * DVec3::new(0.83, 0.79, 0.75);
        assert!((inversion.achieved - published).abs().max_element() < 0.02);
    }
}
