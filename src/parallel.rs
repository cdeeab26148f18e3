//! Loops over slices and ranges, side by side, with results in order.
//!
//! Rayon's threads and its stealing of work do it. Its iterators are compiled anew for every loop that uses them, with all of their
//! splitting and waiting (some 2,600 lines of LLVM's language a loop, a fifth of the whole library), so that the loops here are cut into
//! pieces first, and the one loop over pieces is compiled once. Names are those of rayon's iterators.
//!
//! What comes out depends neither on the number of threads nor on how a loop was cut: results lie in order, and the error that is
//! returned is that of the first item that has one. Only a `reduce` has to be told an operation whose result grouping does not change.

use std::ops::Range;
use std::slice;
use std::sync::{Mutex, PoisonError};
use std::vec;

/// Pieces of a loop for each thread: enough that waiting for the last one costs a hundredth of the loop at most.
const PIECES: usize = 64;

/// What a loop runs over: items in order that can be cut in two.
pub trait Source: Sized + Send {
    /// The items of a piece, one after another.
    type Items: Iterator;

    /// How many items there are.
    fn count(&self) -> usize;

    /// The first `at` items, and the rest.
    fn split(self, at: usize) -> (Self, Self);

    /// The items in order.
    fn items(self) -> Self::Items;
}

macro_rules! source_of_range {
    ($($number:ty)*) => {
        $(impl Source for Range<$number> {
            type Items = Self;

            fn count(&self) -> usize {
                self.size_hint().0
            }

            fn split(self, at: usize) -> (Self, Self) {
                let middle = self.start + at as $number;
                (self.start..middle, middle..self.end)
            }

            fn items(self) -> Self {
                self
            }
        })*
    };
}

source_of_range!(i32 u32 u64 usize);

impl<'a, T: Sync> Source for &'a [T] {
    type Items = slice::Iter<'a, T>;

    fn count(&self) -> usize {
        self.len()
    }

    fn split(self, at: usize) -> (Self, Self) {
        self.split_at(at)
    }

    fn items(self) -> Self::Items {
        self.iter()
    }
}

impl<'a, T: Send> Source for &'a mut [T] {
    type Items = slice::IterMut<'a, T>;

    fn count(&self) -> usize {
        self.len()
    }

    fn split(self, at: usize) -> (Self, Self) {
        self.split_at_mut(at)
    }

    fn items(self) -> Self::Items {
        self.iter_mut()
    }
}

impl<T: Send> Source for Vec<T> {
    type Items = vec::IntoIter<T>;

    fn count(&self) -> usize {
        self.len()
    }

    fn split(mut self, at: usize) -> (Self, Self) {
        let rest = self.split_off(at);
        (self, rest)
    }

    fn items(self) -> Self::Items {
        self.into_iter()
    }
}

/// Runs of `size` items of a slice; the last may be shorter.
pub struct Chunks<S> {
    slice: S,
    size: usize,
}

impl<'a, T: Sync> Source for Chunks<&'a [T]> {
    type Items = slice::Chunks<'a, T>;

    fn count(&self) -> usize {
        self.slice.len().div_ceil(self.size)
    }

    fn split(self, at: usize) -> (Self, Self) {
        let (a, b) = self.slice.split_at((at * self.size).min(self.slice.len()));
        (Self { slice: a, ..self }, Self { slice: b, ..self })
    }

    fn items(self) -> Self::Items {
        self.slice.chunks(self.size)
    }
}

impl<'a, T: Send> Source for Chunks<&'a mut [T]> {
    type Items = slice::ChunksMut<'a, T>;

    fn count(&self) -> usize {
        self.slice.len().div_ceil(self.size)
    }

    fn split(self, at: usize) -> (Self, Self) {
        let Self { slice, size } = self;
        let cut = (at * size).min(slice.len());
        let (a, b) = slice.split_at_mut(cut);
        (Self { slice: a, size }, Self { slice: b, size })
    }

    fn items(self) -> Self::Items {
        self.slice.chunks_mut(self.size)
    }
}

/// Two sources side by side, as long as the shorter.
pub struct Zip<A, B>(A, B);

impl<A: Source, B: Source> Source for Zip<A, B> {
    type Items = std::iter::Zip<A::Items, B::Items>;

    fn count(&self) -> usize {
        self.0.count().min(self.1.count())
    }

    fn split(self, at: usize) -> (Self, Self) {
        let ((a, b), (c, d)) = (self.0.split(at), self.1.split(at));
        (Self(a, c), Self(b, d))
    }

    fn items(self) -> Self::Items {
        self.0.items().zip(self.1.items())
    }
}

/// A source with the index of each item.
pub struct Enumerate<S> {
    first: usize,
    source: S,
}

impl<S: Source> Source for Enumerate<S> {
    type Items = std::iter::Zip<Range<usize>, S::Items>;

    fn count(&self) -> usize {
        self.source.count()
    }

    fn split(self, at: usize) -> (Self, Self) {
        let (a, b) = self.source.split(at);
        (Self { first: self.first, source: a }, Self { first: self.first + at, source: b })
    }

    fn items(self) -> Self::Items {
        (self.first..self.first + self.source.count()).zip(self.source.items())
    }
}

/// What is done with the items of a piece before they are used.
pub trait Change<S: Source>: Sync {
    /// What an item becomes.
    type Item;

    /// The items of a piece, changed.
    fn changed(&self, source: S) -> impl Iterator<Item = Self::Item>;
}

/// Items as they are.
pub struct Unchanged;

impl<S: Source> Change<S> for Unchanged {
    type Item = <S::Items as Iterator>::Item;

    fn changed(&self, source: S) -> impl Iterator<Item = Self::Item> {
        source.items()
    }
}

/// One value of each item.
pub struct Map<C, F>(C, F);

impl<S: Source, C: Change<S>, T, F: Fn(C::Item) -> T + Sync> Change<S> for Map<C, F> {
    type Item = T;

    fn changed(&self, source: S) -> impl Iterator<Item = T> {
        self.0.changed(source).map(&self.1)
    }
}

/// One value of each item, with a state that items share.
pub struct MapInit<M, C, I, F> {
    change: C,
    init: I,
    f: F,
    /// States that no piece has at the moment.
    free: Mutex<Vec<M>>,
}

/// A state that goes back when a piece is done.
struct Lent<'a, M> {
    state: Option<M>,
    free: &'a Mutex<Vec<M>>,
}

impl<M> Drop for Lent<'_, M> {
    fn drop(&mut self) {
        self.free.lock().unwrap_or_else(PoisonError::into_inner).extend(self.state.take());
    }
}

impl<S: Source, M: Send, C: Change<S>, I: Fn() -> M + Sync, T, F: Fn(&mut M, C::Item) -> T + Sync> Change<S>
    for MapInit<M, C, I, F>
{
    type Item = T;

    fn changed(&self, source: S) -> impl Iterator<Item = T> {
        let state = self.free.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let mut lent = Lent { state, free: &self.free };
        self.change.changed(source).map(move |item| (self.f)(lent.state.get_or_insert_with(&self.init), item))
    }
}

/// Any number of values of each item.
pub struct FlatMap<C, F>(C, F);

impl<S: Source, C: Change<S>, T: IntoIterator, F: Fn(C::Item) -> T + Sync> Change<S> for FlatMap<C, F> {
    type Item = T::Item;

    fn changed(&self, source: S) -> impl Iterator<Item = T::Item> {
        self.0.changed(source).flat_map(&self.1)
    }
}

/// A loop that is to run side by side.
pub struct Parallel<S, C = Unchanged> {
    source: S,
    change: C,
    /// Fewest items of a piece.
    least: usize,
}

impl<S: Source> Parallel<S> {
    fn new(source: S) -> Self {
        Self { source, change: Unchanged, least: 1 }
    }

    /// Goes through another source beside this one, as far as the shorter goes.
    pub fn zip<O: IntoParallel>(self, other: O) -> Parallel<Zip<S, O::Source>> {
        Parallel { source: Zip(self.source, other.into_par_iter().source), change: Unchanged, least: self.least }
    }

    /// Gives each item its index.
    pub fn enumerate(self) -> Parallel<Enumerate<S>> {
        Parallel { source: Enumerate { first: 0, source: self.source }, change: Unchanged, least: self.least }
    }
}

impl<S: Source, C: Change<S>> Parallel<S, C> {
    /// Keeps together at least `least` items.
    #[must_use]
    pub fn with_min_len(self, least: usize) -> Self {
        Self { least: least.max(1), ..self }
    }

    fn then<D>(self, change: impl FnOnce(C) -> D) -> Parallel<S, D> {
        Parallel { source: self.source, change: change(self.change), least: self.least }
    }

    /// One value of each item.
    pub fn map<T, F: Fn(C::Item) -> T + Sync>(self, f: F) -> Parallel<S, Map<C, F>> {
        self.then(|change| Map(change, f))
    }

    /// One value of each item, with a state of the thread's own: memory, of which no result may depend on what other items left.
    pub fn map_init<M: Send, I: Fn() -> M + Sync, T, F: Fn(&mut M, C::Item) -> T + Sync>(
        self,
        init: I,
        f: F,
    ) -> Parallel<S, MapInit<M, C, I, F>> {
        self.then(|change| MapInit { change, init, f, free: Mutex::default() })
    }

    /// The values of those items that have one.
    pub fn filter_map<T, F: Fn(C::Item) -> Option<T> + Sync>(self, f: F) -> Parallel<S, FlatMap<C, F>> {
        self.then(|change| FlatMap(change, f))
    }

    /// All values of each item.
    pub fn flat_map_iter<T: IntoIterator, F: Fn(C::Item) -> T + Sync>(self, f: F) -> Parallel<S, FlatMap<C, F>> {
        self.then(|change| FlatMap(change, f))
    }

    /// What `work` makes of each piece, in order.
    fn pieces<R: Send>(self, work: impl Fn(&C, S) -> R + Sync) -> Vec<R> {
        let Self { source, change, least } = self;
        let pieces = (source.count() / least).clamp(1, PIECES * rayon::current_num_threads());
        if pieces == 1 {
            return vec![work(&change, source)];
        }
        let sources = cut(source, pieces);
        results(pieces, &|piece| take(&sources[piece]).map(|own| work(&change, own)))
    }

    /// Does something with each item.
    pub fn for_each(self, f: impl Fn(C::Item) + Sync) {
        self.pieces(|change, piece| change.changed(piece).for_each(&f));
    }

    /// Does something with each item, with a state of the thread's own, as in [`Self::map_init`].
    pub fn for_each_init<M: Send>(self, init: impl Fn() -> M + Sync, f: impl Fn(&mut M, C::Item) + Sync) {
        self.map_init(init, f).for_each(|()| ());
    }

    /// Whether `f` holds for all items.
    pub fn all(self, f: impl Fn(C::Item) -> bool + Sync) -> bool {
        self.pieces(|change, piece| change.changed(piece).all(&f)).into_iter().all(|all| all)
    }

    /// The items in order.
    pub fn collect<R: FromParallel<C::Item>>(self) -> R {
        R::of(self.pieces(|change, piece| R::of_piece(change.changed(piece))))
    }

    /// How many items there are after all changes.
    pub fn count(self) -> usize {
        self.pieces(|change, piece| change.changed(piece).count()).into_iter().sum()
    }

    /// The items under an operation that has to be associative, with `identity` as its neutral element.
    pub fn reduce(
        self,
        identity: impl Fn() -> C::Item + Sync,
        f: impl Fn(C::Item, C::Item) -> C::Item + Sync,
    ) -> C::Item
    where
        C::Item: Send,
    {
        self.pieces(|change, piece| change.changed(piece).fold(identity(), &f)).into_iter().fold(identity(), &f)
    }
}

/// Something that one thread puts in or takes out once.
type Slot<T> = Mutex<Option<T>>;

fn take<T>(slot: &Slot<T>) -> Option<T> {
    slot.lock().unwrap_or_else(PoisonError::into_inner).take()
}

/// A source in pieces of about equal length.
#[inline(never)]
fn cut<S: Source>(source: S, pieces: usize) -> Vec<Slot<S>> {
    let count = source.count();
    let mut slots: Vec<Slot<S>> = Vec::with_capacity(pieces);
    // From the end, so that a vector gives away its items without moving them more than once.
    let mut rest = source;
    for piece in (1..pieces).rev() {
        let (before, own) = rest.split(count * piece / pieces);
        slots.push(Mutex::new(Some(own)));
        rest = before;
    }
    slots.push(Mutex::new(Some(rest)));
    slots.reverse();
    slots
}

/// The results of all pieces in order. It is compiled once for each type of result, not for each loop.
#[inline(never)]
fn results<R: Send>(pieces: usize, work: &(dyn Fn(usize) -> Option<R> + Sync)) -> Vec<R> {
    let mut slots: Vec<Slot<R>> = Vec::with_capacity(pieces);
    slots.resize_with(pieces, Mutex::default);
    side_by_side(pieces, &|piece| {
        let made = work(piece);
        *slots[piece].lock().unwrap_or_else(PoisonError::into_inner) = made;
    });
    let mut results = Vec::with_capacity(pieces);
    for slot in &slots {
        if let Some(result) = take(slot) {
            results.push(result);
        }
    }
    results
}

/// The one loop that rayon runs.
fn side_by_side(count: usize, work: &(dyn Fn(usize) + Sync)) {
    use rayon::iter::{IndexedParallelIterator, IntoParallelIterator, ParallelIterator};
    IntoParallelIterator::into_par_iter(0..count).with_max_len(1).for_each(work);
}

/// What the items of a loop are collected into.
pub trait FromParallel<T>: Sized {
    /// What a piece gives.
    type Piece: Send;

    /// The items of a piece.
    fn of_piece(items: impl Iterator<Item = T>) -> Self::Piece;

    /// All pieces, in order.
    fn of(pieces: Vec<Self::Piece>) -> Self;
}

impl<T: Send> FromParallel<T> for Vec<T> {
    type Piece = Self;

    fn of_piece(items: impl Iterator<Item = T>) -> Self {
        items.collect()
    }

    fn of(mut pieces: Vec<Self>) -> Self {
        if pieces.len() == 1 {
            return pieces.swap_remove(0);
        }
        let mut count = 0;
        for piece in &pieces {
            count += piece.len();
        }
        let mut all = Self::with_capacity(count);
        for piece in &mut pieces {
            // Freed as soon as it is copied.
            all.append(&mut std::mem::take(piece));
        }
        all
    }
}

impl<T: Send, E: Send> FromParallel<Result<T, E>> for Result<Vec<T>, E> {
    type Piece = Self;

    fn of_piece(items: impl Iterator<Item = Result<T, E>>) -> Self {
        items.collect()
    }

    fn of(pieces: Vec<Self>) -> Self {
        let mut all = Vec::with_capacity(pieces.len());
        for piece in pieces {
            all.push(piece?);
        }
        Ok(Vec::of(all))
    }
}

impl<A: Send, B: Send> FromParallel<(A, B)> for (Vec<A>, Vec<B>) {
    type Piece = Self;

    fn of_piece(items: impl Iterator<Item = (A, B)>) -> Self {
        items.unzip()
    }

    fn of(pieces: Vec<Self>) -> Self {
        let (a, b): (Vec<_>, Vec<_>) = pieces.into_iter().unzip();
        (Vec::of(a), Vec::of(b))
    }
}

/// What a loop can run over.
pub trait IntoParallel {
    /// Its items.
    type Source: Source;

    /// A loop over the items.
    fn into_par_iter(self) -> Parallel<Self::Source>;
}

impl<S: Source> IntoParallel for S {
    type Source = S;

    fn into_par_iter(self) -> Parallel<S> {
        Parallel::new(self)
    }
}

impl<S: Source> IntoParallel for Parallel<S> {
    type Source = S;

    fn into_par_iter(self) -> Self {
        self
    }
}

impl<'a, T: Sync> IntoParallel for &'a Vec<T> {
    type Source = &'a [T];

    fn into_par_iter(self) -> Parallel<&'a [T]> {
        Parallel::new(self.as_slice())
    }
}

impl<'a, T: Send> IntoParallel for &'a mut Vec<T> {
    type Source = &'a mut [T];

    fn into_par_iter(self) -> Parallel<&'a mut [T]> {
        Parallel::new(self.as_mut_slice())
    }
}

/// Loops over slices.
pub trait ParallelSlice<T> {
    /// A loop over the items.
    fn par_iter(&self) -> Parallel<&[T]>
    where
        T: Sync;

    /// A loop over the items, to change them.
    fn par_iter_mut(&mut self) -> Parallel<&mut [T]>
    where
        T: Send;

    /// A loop over runs of `size` items, of which the last may be shorter.
    ///
    /// # Panics
    /// If `size` is 0.
    fn par_chunks(&self, size: usize) -> Parallel<Chunks<&[T]>>
    where
        T: Sync;

    /// A loop over runs of `size` items, to change them.
    ///
    /// # Panics
    /// If `size` is 0.
    fn par_chunks_mut(&mut self, size: usize) -> Parallel<Chunks<&mut [T]>>
    where
        T: Send;
}

impl<T> ParallelSlice<T> for [T] {
    fn par_iter(&self) -> Parallel<&[T]>
    where
        T: Sync,
    {
        Parallel::new(self)
    }

    fn par_iter_mut(&mut self) -> Parallel<&mut [T]>
    where
        T: Send,
    {
        Parallel::new(self)
    }

    fn par_chunks(&self, size: usize) -> Parallel<Chunks<&[T]>>
    where
        T: Sync,
    {
        assert!(size > 0, "chunks of no items");
        Parallel::new(Chunks { slice: self, size })
    }

    fn par_chunks_mut(&mut self, size: usize) -> Parallel<Chunks<&mut [T]>>
    where
        T: Send,
    {
        assert!(size > 0, "chunks of no items");
        Parallel::new(Chunks { slice: self, size })
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    fn on<R: Send>(threads: usize, work: impl Fn() -> R + Sync + Send) -> R {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(work)
    }

    #[test]
    fn loops_of_any_length_give_what_one_thread_does() {
        for count in (0..200).chain([1000, 12_345]) {
            let numbers: Vec<u32> = (0..count).collect();
            for threads in [1, 3] {
                on(threads, || {
                    let squares: Vec<u32> = numbers.par_iter().map(|x| x * x).collect();
                    assert_eq!(squares, numbers.iter().map(|x| x * x).collect::<Vec<_>>());
                    let odd: Vec<u32> = (0..count).into_par_iter().filter_map(|x| (x % 2 == 1).then_some(x)).collect();
                    assert_eq!(odd, (0..count).filter(|x| x % 2 == 1).collect::<Vec<_>>());
                    let twice: Vec<u32> = numbers.clone().into_par_iter().flat_map_iter(|x| [x, x]).collect();
                    assert_eq!(twice, numbers.iter().flat_map(|&x| [x, x]).collect::<Vec<_>>());
                    let sums: Vec<u32> = numbers.par_chunks(7).map(|run| run.iter().sum()).collect();
                    assert_eq!(sums, numbers.chunks(7).map(|run| run.iter().sum()).collect::<Vec<u32>>());
                    let mut out = vec![0; count as usize];
                    out.par_chunks_mut(3).zip(numbers.par_chunks(3)).enumerate().for_each(|(i, (out, run))| {
                        out.iter_mut().zip(run).for_each(|(out, x)| *out = x + i as u32);
                    });
                    assert!((0..).zip(&out).all(|(i, &x)| x == i + i / 3));
                    out.par_iter_mut().zip(&numbers).with_min_len(10).for_each(|(out, x)| *out = x + 1);
                    assert!(out.iter().zip(&numbers).all(|(out, x)| *out == x + 1));
                    assert_eq!(numbers.par_iter().copied_max(), numbers.iter().copied().max().unwrap_or(0));
                    assert_eq!(numbers.par_iter().all(|&x| x < count / 2), count == 0);
                    assert_eq!(numbers.par_iter().count(), count as usize);
                    assert_eq!((3..3 - count as i32).into_par_iter().count(), 0);
                });
            }
        }
    }

    impl Parallel<&[u32]> {
        fn copied_max(self) -> u32 {
            self.map(|&x| x).reduce(|| 0, u32::max)
        }
    }

    #[test]
    fn no_more_states_are_made_than_there_are_threads_and_none_serves_two_pieces_at_once() {
        let made = AtomicUsize::new(0);
        let seen = on(4, || {
            let init = || (made.fetch_add(1, Ordering::Relaxed), 0);
            let of = |state: &mut (usize, usize), i: usize| {
                state.1 += 1;
                (i, *state)
            };
            (0..1000usize).into_par_iter().map_init(init, of).collect::<Vec<_>>()
        });
        assert!((1..=4).contains(&made.into_inner()));
        assert!(seen.iter().enumerate().all(|(at, (i, _))| at == *i));
        // Each state counts on from item to item.
        let mut states: Vec<(usize, usize)> = seen.iter().map(|(_, state)| *state).collect();
        states.sort_unstable();
        states.dedup();
        assert_eq!(states.len(), 1000);
    }

    #[test]
    fn pieces_are_at_least_as_long_as_asked() {
        for (least, most) in [(100, 10), (1, 4 * PIECES), (2000, 1)] {
            let lengths = on(4, || {
                let loop_ = (0..1000usize).into_par_iter().with_min_len(least);
                loop_.pieces(|_, piece| piece.len())
            });
            assert!(lengths.len() == most && lengths.iter().all(|length| *length >= least.min(1000)), "{lengths:?}");
            assert_eq!(lengths.iter().sum::<usize>(), 1000);
        }
    }

    #[test]
    fn the_first_error_is_the_one_that_is_returned() {
        for threads in [1, 4] {
            let found: Result<Vec<u32>, u32> = on(threads, || {
                (0..10_000u32).into_par_iter().map(|x| if x % 3000 == 2999 { Err(x) } else { Ok(x) }).collect()
            });
            assert_eq!(found, Err(2999));
            let whole: Result<Vec<u32>, u32> = on(threads, || (0..10_000u32).into_par_iter().map(Ok).collect());
            assert_eq!(whole.unwrap().len(), 10_000);
        }
    }

    #[test]
    fn loops_lie_within_loops_and_all_of_their_work_is_done() {
        let table: Vec<Vec<usize>> =
            on(3, || (0..50usize).into_par_iter().map(|i| (0..i).into_par_iter().map(|j| i * j).collect()).collect());
        assert!(table.iter().enumerate().all(|(i, row)| *row == (0..i).map(|j| i * j).collect::<Vec<_>>()));
    }
}
