//! A mailbox for one item: a worker takes the newest state, and a state that was not taken is replaced.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

/// A mailbox between a thread that changes a state and one that works on it.
#[derive(Debug)]
pub struct Newest<T> {
    slot: Mutex<Slot<T>>,
    changed: Condvar,
}

#[derive(Debug)]
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
    pub fn post(&self, value: T) {
        self.lock().value = Some(value);
        self.changed.notify_one();
    }

    /// Ends [`Self::take`] for good.
    pub fn close(&self) {
        self.lock().closed = true;
        self.changed.notify_all();
    }

    /// Waits for a state; none once the mailbox is closed.
    pub fn take(&self) -> Option<T> {
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

    /// Takes a state if there is one.
    pub fn try_take(&self) -> Option<T> {
        self.lock().value.take()
    }

    /// Returns whether a state is waiting.
    pub fn is_waiting(&self) -> bool {
        self.lock().value.is_some()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;

    #[test]
    fn only_the_newest_state_is_taken() {
        let mailbox = Newest::default();
        assert_eq!(mailbox.try_take(), None);
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
        let (sender, receiver) = std::sync::mpsc::channel();
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
