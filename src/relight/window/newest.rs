//! A mailbox for one item, where one that was not taken is replaced, and a thread that answers what is put there.

use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;

use crate::error::{Error, Result};

/// A mailbox between a thread that changes a state and one that works on it.
struct Newest<T> {
    slot: Mutex<Slot<T>>,
    changed: Condvar,
}

struct Slot<T> {
    value: Option<T>,
    closed: bool,
}

impl<T> Default for Newest<T> {
    fn default() -> Self {
        Self { slot: Mutex::new(Slot { value: None, closed: false }), changed: Condvar::new() }
    }
}

impl<T> Newest<T> {
    fn lock(&self) -> MutexGuard<'_, Slot<T>> {
        self.slot.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Posts a state; replaces one that was not taken.
    fn post(&self, value: T) {
        self.lock().value = Some(value);
        self.changed.notify_one();
    }

    /// Ends [`Self::take`] for good.
    fn close(&self) {
        self.lock().closed = true;
        self.changed.notify_all();
    }

    /// Waits for a state; none once the mailbox is closed.
    fn take(&self) -> Option<T> {
        let mut slot = self.lock();
        loop {
            if slot.closed {
                return None;
            }
            match slot.value.take() {
                Some(value) => return Some(value),
                None => slot = self.changed.wait(slot).unwrap_or_else(PoisonError::into_inner),
            }
        }
    }

    /// Returns whether a state is waiting.
    fn is_waiting(&self) -> bool {
        self.lock().value.is_some()
    }
}

/// Starts a thread with a name.
///
/// # Errors
/// The system starts none (exit 4).
pub(super) fn spawn(name: &str, work: impl FnOnce() + Send + 'static) -> Result<JoinHandle<()>> {
    let spawned = std::thread::Builder::new().name(name.to_owned()).spawn(work);
    spawned.map_err(|e| Error::runtime(format!("the thread `{name}` could not be started: {e}")))
}

/// A thread that always takes the newest question, so that whoever asks never waits, and its mailboxes.
pub(super) struct Answering<Q, A> {
    asked: Arc<Newest<Q>>,
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
        let asked: Arc<Newest<Q>> = Arc::default();
        let (sender, answers) = channel();
        let mailbox = Arc::clone(&asked);
        let work = move || {
            let mut answer = prepare();
            while let Some(question) = mailbox.take() {
                if sender.send(answer(question)).is_err() {
                    break;
                }
                wake();
            }
        };
        Ok(Self { thread: Some(spawn(name, work)?), asked, answers })
    }

    pub(super) fn ask(&self, question: Q) {
        self.asked.post(question);
    }

    pub(super) fn answer(&self) -> Option<A> {
        self.answers.try_recv().ok()
    }

    /// Returns whether a question is still waiting.
    pub(super) fn is_behind(&self) -> bool {
        self.asked.is_waiting()
    }

    /// Ends the thread after its current question, without waiting for it.
    pub(super) fn retire(&self) {
        self.asked.close();
    }

    pub(super) fn has_ended(&self) -> bool {
        self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }
}

/// Ends the thread after its current question.
impl<Q, A> Drop for Answering<Q, A> {
    fn drop(&mut self) {
        self.asked.close();
        if let Some(thread) = self.thread.take() {
            // A thread that panicked has said so.
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_newest_state_is_taken() {
        let mailbox = Newest::default();
        (0..10).for_each(|i| mailbox.post(i));
        assert!(mailbox.is_waiting());
        assert_eq!(mailbox.take(), Some(9));
        assert!(!mailbox.is_waiting());
        mailbox.close();
        assert_eq!(mailbox.take(), None);
    }

    #[test]
    fn a_worker_sees_the_last_state_in_order_and_ends() {
        let mailbox = Arc::new(Newest::default());
        let (sender, receiver) = channel();
        let worker = {
            let mailbox = Arc::clone(&mailbox);
            std::thread::spawn(move || {
                while let Some(value) = mailbox.take() {
                    let _ = sender.send(value);
                }
            })
        };
        for i in 0..1000 {
            mailbox.post(i);
        }
        let mut seen = Vec::new();
        while seen.last() != Some(&999) {
            match receiver.recv() {
                Ok(value) => seen.push(value),
                Err(_) => break,
            }
        }
        mailbox.close();
        assert!(worker.join().is_ok());
        assert!(seen.is_sorted() && seen.last() == Some(&999));
    }
}
