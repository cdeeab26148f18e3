//! Threads that answer the newest of their questions.

use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, TryRecvError, channel};
use std::thread::JoinHandle;
use std::time::Duration;

use crate::error::{Error, Result};

/// Starts a thread with a name.
///
/// # Errors
/// The system starts none (exit 4).
pub(super) fn spawn(name: &str, work: impl FnOnce() + Send + 'static) -> Result<JoinHandle<()>> {
    let spawned = std::thread::Builder::new().name(name.to_owned()).spawn(work);
    spawned.map_err(|e| Error::runtime(format!("the thread `{name}` could not be started: {e}")))
}

/// After so long without a question there is time for other things.
const PAUSE: Duration = Duration::from_millis(100);

/// What a thread is asked.
pub(super) enum Asked<Q> {
    Question(Q),
    /// Nobody has asked for a while.
    Nothing,
}

/// Whether there is something to do while nobody asks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Rest {
    Over,
    More,
}

/// A thread that always takes the newest question, so that whoever asks never waits.
pub(super) struct Answering<Q, A> {
    /// None once the thread is to end.
    questions: Option<Sender<Q>>,
    answers: Receiver<A>,
    thread: Option<JoinHandle<()>>,
}

impl<Q: Send + 'static, A: Send + 'static> Answering<Q, A> {
    /// Starts the thread, where `prepare` makes what answers; `wake` is called after every answer.
    ///
    /// # Errors
    /// As [`spawn`].
    pub(super) fn start<F: FnMut(Q) -> A>(
        name: &str,
        prepare: impl FnOnce() -> F + Send + 'static,
        wake: impl Fn() + Send + 'static,
    ) -> Result<Self> {
        let prepare = move || {
            let mut answer = prepare();
            move |asked: Asked<Q>| match asked {
                Asked::Question(question) => (Some(answer(question)), Rest::Over),
                Asked::Nothing => (None, Rest::Over),
            }
        };
        Self::start_restless(name, prepare, wake)
    }

    /// Starts a thread that also has something to do while nobody asks: what answers is called again after a pause as long as it
    /// says so, and may have a better answer to the last question.
    ///
    /// # Errors
    /// As [`spawn`].
    pub(super) fn start_restless<F: FnMut(Asked<Q>) -> (Option<A>, Rest)>(
        name: &str,
        prepare: impl FnOnce() -> F + Send + 'static,
        wake: impl Fn() + Send + 'static,
    ) -> Result<Self> {
        let (questions, asked) = channel();
        let (sender, answers) = channel();
        let work = move || {
            let (mut answer, mut rest) = (prepare(), Rest::Over);
            while let Some(asked) = newest(&asked, rest) {
                let (said, more) = answer(asked);
                rest = more;
                let Some(said) = said else { continue };
                if sender.send(said).is_err() {
                    break;
                }
                wake();
            }
        };
        Ok(Self { thread: Some(spawn(name, work)?), questions: Some(questions), answers })
    }

    pub(super) fn ask(&self, question: Q) {
        if let Some(questions) = &self.questions {
            // A thread that panicked has said so.
            let _ = questions.send(question);
        }
    }

    pub(super) fn answer(&self) -> Option<A> {
        self.answers.try_recv().ok()
    }

    /// Ends the thread after its current question, without waiting for it.
    pub(super) fn retire(&mut self) {
        self.questions = None;
    }

    pub(super) fn has_ended(&self) -> bool {
        self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }
}

/// Waits for a question and takes the newest one, or says after a pause that there is none; none once nobody asks any more.
fn newest<Q>(asked: &Receiver<Q>, rest: Rest) -> Option<Asked<Q>> {
    let mut question = match rest {
        Rest::Over => asked.recv().ok()?,
        Rest::More => match asked.recv_timeout(PAUSE) {
            Ok(question) => question,
            Err(RecvTimeoutError::Timeout) => return Some(Asked::Nothing),
            Err(RecvTimeoutError::Disconnected) => return None,
        },
    };
    loop {
        match asked.try_recv() {
            Ok(newer) => question = newer,
            Err(TryRecvError::Empty) => return Some(Asked::Question(question)),
            Err(TryRecvError::Disconnected) => return None,
        }
    }
}

/// Ends the thread after its current question.
impl<Q, A> Drop for Answering<Q, A> {
    fn drop(&mut self) {
        self.questions = None;
        if let Some(thread) = self.thread.take() {
            // A thread that panicked has said so.
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn only_the_newest_question_is_taken_and_none_after_the_end() {
        let (sender, asked) = channel();
        (0..10).for_each(|i| sender.send(i).unwrap());
        assert!(matches!(newest(&asked, Rest::Over), Some(Asked::Question(9))));
        assert!(matches!(newest(&asked, Rest::More), Some(Asked::Nothing)));
        sender.send(10).unwrap();
        drop(sender);
        assert!(newest(&asked, Rest::Over).is_none());
    }

    #[test]
    fn a_thread_with_more_to_do_is_called_again_until_it_has_not() {
        let prepare = || {
            let mut left = 0;
            move |asked: Asked<i32>| {
                left = if let Asked::Question(question) = asked { question } else { left - 1 };
                (Some(left), if left > 0 { Rest::More } else { Rest::Over })
            }
        };
        let thread = Answering::start_restless("test", prepare, || {}).unwrap();
        thread.ask(2);
        let said: Vec<i32> = (0..3).map(|_| thread.answers.recv().unwrap()).collect();
        assert_eq!(said, [2, 1, 0]);
        assert!(thread.answers.recv_timeout(3 * PAUSE).is_err());
    }

    #[test]
    fn the_last_question_is_answered_in_order_and_the_thread_ends() {
        let mut thread = Answering::start("test", || |question: i32| question, || {}).unwrap();
        (0..1000).for_each(|i| thread.ask(i));
        let mut seen = Vec::new();
        while seen.last() != Some(&999) {
            seen.push(thread.answers.recv().unwrap());
        }
        assert!(seen.is_sorted());
        thread.retire();
        assert!(thread.thread.take().unwrap().join().is_ok());
    }
}
