//! Values in buckets by a small number.

/// Values in buckets; those of one bucket are in the order in which they came until they are sorted.
pub(super) struct Buckets<T> {
    /// Bucket `i` holds `values[start[i]..start[i + 1]]`.
    start: Vec<u32>,
    values: Vec<T>,
}

impl<T: Copy + Default + Ord> Buckets<T> {
    /// `count` buckets of the values that `all` gives with the numbers of their buckets, the same each time.
    pub(super) fn new<I: Iterator<Item = (u32, T)>>(count: usize, all: impl Fn() -> I) -> Self {
        let mut start = vec![0u32; count + 1];
        all().for_each(|(bucket, _)| start[bucket as usize + 1] += 1);
        for i in 1..start.len() {
            start[i] += start[i - 1];
        }
        let mut next = start.clone();
        let mut values = vec![T::default(); start[count] as usize];
        for (bucket, value) in all() {
            let slot = &mut next[bucket as usize];
            values[*slot as usize] = value;
            *slot += 1;
        }
        Self { start, values }
    }

    /// Sorts the values of each bucket.
    pub(super) fn sorted(mut self) -> Self {
        for ends in self.start.windows(2) {
            self.values[ends[0] as usize..ends[1] as usize].sort_unstable();
        }
        self
    }

    /// Number of buckets.
    pub(super) fn len(&self) -> usize {
        self.start.len() - 1
    }

    /// Values of one bucket.
    pub(super) fn bucket(&self, index: usize) -> &[T] {
        &self.values[self.start[index] as usize..self.start[index + 1] as usize]
    }

    /// All buckets.
    pub(super) fn all(&self) -> impl Iterator<Item = &[T]> {
        (0..self.len()).map(|index| self.bucket(index))
    }
}
