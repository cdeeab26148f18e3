//! Limits of time and memory above which work is not started, and the reasons given.

use super::Limits;

/// Factor on the limit up to which work is started, since predictions are rough.
pub const MARGIN: f64 = 1.25;

/// Factor on the limit at which a running bake is ended.
pub const KILL: f64 = 2.0;

/// The ways in which a command writes durations and sizes.
#[derive(Clone, Copy)]
pub struct Words {
    /// Text of a duration in seconds.
    pub duration: fn(f64) -> String,
    /// Text of a size in bytes.
    pub bytes: fn(u64) -> String,
}

impl Limits {
    /// The reason why work of this predicted duration is not started; none where it is started, or where nothing is
    /// known.
    pub fn too_long(&self, predicted_seconds: Option<f64>, words: Words) -> Option<String> {
        let predicted = predicted_seconds?;
        let say = words.duration;
        // What is not a number is over the limit.
        let fits = predicted <= MARGIN * self.seconds;
        (!fits).then(|| {
            format!("about {} predicted from the smaller sizes, {} allowed", say(predicted), say(self.seconds))
        })
    }

    /// The reason why a bake of this estimated memory is not started.
    pub fn too_large(&self, estimated_bytes: u64, words: Words) -> Option<String> {
        let say = words.bytes;
        (estimated_bytes > self.memory_bytes)
            .then(|| format!("about {} of memory estimated, {} allowed", say(estimated_bytes), say(self.memory_bytes)))
    }

    /// Duration at which a running bake is ended, s.
    pub fn kill_seconds(&self) -> f64 {
        KILL * self.seconds
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    const WORDS: Words = Words { duration: |s| format!("{s} s"), bytes: |b| format!("{b} B") };

    #[test]
    fn what_would_pass_a_limit_is_not_started_and_says_so() {
        let limits = Limits { seconds: 100.0, memory_bytes: 1000 };
        assert_eq!(limits.too_long(None, WORDS), None);
        assert_eq!(limits.too_long(Some(125.0), WORDS), None);
        let reason = limits.too_long(Some(126.0), WORDS).unwrap();
        assert!(reason.contains("126 s") && reason.contains("100 s"), "{reason}");
        assert!(
            limits.too_long(Some(f64::NAN), WORDS).is_some() && limits.too_long(Some(f64::INFINITY), WORDS).is_some()
        );
        assert_eq!(limits.too_large(1000, WORDS), None);
        let reason = limits.too_large(1001, WORDS).unwrap();
        assert!(reason.contains("1001 B") && reason.contains("1000 B"), "{reason}");
        assert_eq!(limits.kill_seconds(), 200.0);
    }
}
