//! Threads that answer the newest of their questions.

use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::thread::JoinHandle;

use crate::error::{Error, Result};

/// Starts a thread with a name.
///
/// # Errors
/// The system starts none (exit 4).
pub(super) fn spawn(name: &str, work: impl FnOnce() + Send + 'static) -> Result<JoinHandle<()>> {
    let spawned = std::thread::Builder::new().name(name.to_owned()).spawn(work);
    spawned.map_err(|e| Error::runtime(format!("the thread `{name}` could not be started: {e}")))
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
        let (questions, asked) = channel();
        let (sender, answers) = channel();
        let work = move || {
            let mut answer = prepare();
            while let Some(question) = newest(&asked) {
                if sender.send(answer(question)).is_err() {
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

/// Waits for a question and takes the newest one; none once nobody asks any more.
fn newest<Q>(asked: &Receiver<Q>) -> Option<Q> {
    let mut question = asked.recv().ok()?;
    loop {
        match asked.try_recv() {
            Ok(newer) => question = newer,
            Err(TryRecvError::Empty) => return Some(question),
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
        assert_eq!(newest(&asked), Some(9));
        sender.send(10).unwrap();
        drop(sender);
        assert_eq!(newest(&asked), None);
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
