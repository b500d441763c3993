//! Loops on all threads of the current pool: the one that [`Pool::install`] runs a function in, or that of the process.
//!
//! A loop takes its closure by reference to a trait object, so that it is compiled once for each type of rows, not once
//! for each closure. Rows are halved from thread to thread as long as others are idle; no loop allocates memory but for
//! the results that it returns. Whatever depends on the order of rows is in their order, at any number of threads.

use std::cmp::Ordering;
use std::collections::LinkedList;
use std::io;
use std::ops::{Range, RangeFrom};
use std::sync::atomic::{AtomicUsize, Ordering as Memory};
use std::sync::{Mutex, PoisonError};

use rayon::slice::ParallelSliceMut;

/// Rows that a loop hands out one by one: items of a slice, runs of items ([`chunks`], [`chunks_mut`]), numbers of a
/// range, and tuples of such rows, which end with the shortest; `0..` numbers the others.
pub trait Rows: Send + Sized {
    /// What the closure of a loop gets.
    type Row;

    /// Number of rows.
    fn count(&self) -> usize;

    /// The rows before one, and those from it on.
    fn split_at(self, row: usize) -> (Self, Self);

    /// The first of the rows, which are then those after it.
    fn next(&mut self) -> Option<Self::Row>;

    /// Number of pieces into which the rows are cut even where no thread is idle.
    fn pieces(&self) -> usize {
        threads()
    }
}

impl<'a, T: Sync> Rows for &'a [T] {
    type Row = &'a T;

    fn count(&self) -> usize {
        self.len()
    }

    fn split_at(self, row: usize) -> (Self, Self) {
        <[T]>::split_at(self, row)
    }

    fn next(&mut self) -> Option<&'a T> {
        self.split_off_first()
    }
}

impl<'a, T: Send> Rows for &'a mut [T] {
    type Row = &'a mut T;

    fn count(&self) -> usize {
        self.len()
    }

    fn split_at(self, row: usize) -> (Self, Self) {
        self.split_at_mut(row)
    }

    fn next(&mut self) -> Option<&'a mut T> {
        self.split_off_first_mut()
    }
}

impl Rows for Range<usize> {
    type Row = usize;

    fn count(&self) -> usize {
        self.len()
    }

    fn split_at(self, row: usize) -> (Self, Self) {
        let middle = self.start + row;
        (self.start..middle, middle..self.end)
    }

    fn next(&mut self) -> Option<usize> {
        Iterator::next(self)
    }
}

/// Numbers of the rows beside it in a tuple.
impl Rows for RangeFrom<usize> {
    type Row = usize;

    fn count(&self) -> usize {
        usize::MAX - self.start
    }

    fn split_at(self, row: usize) -> (Self, Self) {
        (self.start.., self.start + row..)
    }

    fn next(&mut self) -> Option<usize> {
        Iterator::next(self)
    }
}

/// Runs of a slice: see [`chunks`].
#[derive(Debug)]
pub struct Chunks<'a, T> {
    items: &'a [T],
    size: usize,
}

/// Runs of `size` items; the last may have fewer.
///
/// # Panics
/// If `size` is 0.
pub fn chunks<T: Sync>(items: &[T], size: usize) -> Chunks<'_, T> {
    assert!(size > 0, "chunks of no items");
    Chunks { items, size }
}

impl<'a, T: Sync> Rows for Chunks<'a, T> {
    type Row = &'a [T];

    fn count(&self) -> usize {
        self.items.len().div_ceil(self.size)
    }

    fn split_at(self, row: usize) -> (Self, Self) {
        let (first, last) = self.items.split_at(self.items.len().min(row * self.size));
        (chunks(first, self.size), chunks(last, self.size))
    }

    fn next(&mut self) -> Option<&'a [T]> {
        // With nothing left an empty run splits off, and would forever.
        let size = self.size.min(self.items.len());
        self.items.split_off(..size).filter(|row| !row.is_empty())
    }
}

/// Mutable runs of a slice: see [`chunks_mut`].
#[derive(Debug)]
pub struct ChunksMut<'a, T> {
    items: &'a mut [T],
    size: usize,
}

/// Mutable runs of `size` items; the last may have fewer.
///
/// # Panics
/// If `size` is 0.
pub fn chunks_mut<T: Send>(items: &mut [T], size: usize) -> ChunksMut<'_, T> {
    assert!(size > 0, "chunks of no items");
    ChunksMut { items, size }
}

impl<'a, T: Send> Rows for ChunksMut<'a, T> {
    type Row = &'a mut [T];

    fn count(&self) -> usize {
        self.items.len().div_ceil(self.size)
    }

    fn split_at(self, row: usize) -> (Self, Self) {
        let middle = self.items.len().min(row * self.size);
        let (first, last) = self.items.split_at_mut(middle);
        (chunks_mut(first, self.size), chunks_mut(last, self.size))
    }

    fn next(&mut self) -> Option<&'a mut [T]> {
        // As in `Chunks`.
        let size = self.size.min(self.items.len());
        self.items.split_off_mut(..size).filter(|row| !row.is_empty())
    }
}

macro_rules! tuple {
    ($($rows:ident)+) => {
        #[allow(non_snake_case, reason = "rows are named by their types")]
        impl<$($rows: Rows),+> Rows for ($($rows,)+) {
            type Row = ($($rows::Row,)+);

            fn count(&self) -> usize {
                let ($($rows,)+) = self;
                usize::MAX$(.min($rows.count()))+
            }

            fn split_at(self, row: usize) -> (Self, Self) {
                let ($($rows,)+) = self;
                $(let $rows = $rows.split_at(row);)+
                (($($rows.0,)+), ($($rows.1,)+))
            }

            fn next(&mut self) -> Option<Self::Row> {
                let ($($rows,)+) = self;
                Some(($($rows.next()?,)+))
            }

            fn pieces(&self) -> usize {
                let ($($rows,)+) = self;
                0$(.max($rows.pieces()))+
            }
        }
    };
}

tuple!(A B);
tuple!(A B C);
tuple!(A B C D);

/// Rows handed out one by one: see [`tasks`].
#[derive(Debug)]
pub struct Tasks<R>(R);

/// Rows that are cut into single ones from the start: few, and of much and uneven work.
pub fn tasks<R: Rows>(rows: R) -> Tasks<R> {
    Tasks(rows)
}

impl<R: Rows> Rows for Tasks<R> {
    type Row = R::Row;

    fn count(&self) -> usize {
        self.0.count()
    }

    fn split_at(self, row: usize) -> (Self, Self) {
        let (first, last) = self.0.split_at(row);
        (Self(first), Self(last))
    }

    fn next(&mut self) -> Option<R::Row> {
        self.0.next()
    }

    fn pieces(&self) -> usize {
        self.count().max(threads())
    }
}

/// Calls `work` with each row.
pub fn for_each<R: Rows>(rows: R, work: &(dyn Fn(R::Row) + Sync)) {
    let piece = |mut rows: R| {
        while let Some(row) = rows.next() {
            work(row);
        }
    };
    divide(rows, &piece, |(), ()| ());
}

/// Calls `work` with each row and what `init` makes for each piece of the rows.
pub fn for_each_init<R: Rows, S>(rows: R, init: &(dyn Fn() -> S + Sync), work: &(dyn Fn(&mut S, R::Row) + Sync)) {
    let piece = |mut rows: R| {
        let mut scratch = init();
        while let Some(row) = rows.next() {
            work(&mut scratch, row);
        }
    };
    divide(rows, &piece, |(), ()| ());
}

/// Calls `work` with each row. Once a row has failed, later rows that have not begun are left out.
///
/// # Errors
/// The error of the first row that fails.
pub fn try_for_each<R: Rows, E: Send>(rows: R, work: &(dyn Fn(R::Row) -> Result<(), E> + Sync)) -> Result<(), E> {
    let first = FirstError::default();
    for_each((0.., rows), &|(index, row)| {
        first.unless_failed(index, || work(row));
    });
    first.unless_any(())
}

/// Results of `make` for each row.
pub fn map<R: Rows, T: Send>(rows: R, make: &(dyn Fn(R::Row) -> T + Sync)) -> Vec<T> {
    collect(rows, &|mut rows: R| {
        let mut results = Vec::with_capacity(rows.count());
        while let Some(row) = rows.next() {
            results.push(make(row));
        }
        results
    })
}

/// Those of the results of `make` for each row that are not `None`.
pub fn filter_map<R: Rows, T: Send>(rows: R, make: &(dyn Fn(R::Row) -> Option<T> + Sync)) -> Vec<T> {
    collect(rows, &|mut rows: R| {
        let mut results = Vec::new();
        while let Some(row) = rows.next() {
            results.extend(make(row));
        }
        results
    })
}

/// Results of `make` for each row. Once a row has failed, later rows that have not begun are left out.
///
/// # Errors
/// The error of the first row that fails.
pub fn try_map<R: Rows, T: Send, E: Send>(
    rows: R,
    make: &(dyn Fn(R::Row) -> Result<T, E> + Sync),
) -> Result<Vec<T>, E> {
    let first = FirstError::default();
    let results = filter_map((0.., rows), &|(index, row)| first.unless_failed(index, || make(row)));
    first.unless_any(results)
}

/// Sorts items; those that are equal keep their order.
pub fn sort_by<T: Send>(items: &mut [T], compare: impl Fn(&T, &T) -> Ordering + Sync) {
    items.par_sort_by(compare);
}

/// Number of threads of the current pool.
pub fn threads() -> usize {
    rayon::current_num_threads()
}

/// The result of `run` on a thread of the current pool, from which loops start sooner than from outside.
pub fn enter<T: Send>(run: impl FnOnce() -> T + Send) -> T {
    once(run, |run| rayon::scope(|_| run()))
}

/// The result of `run`, which `call` calls once as a trait object: the machinery of threads is compiled once, not for
/// each function.
fn once<T: Send>(run: impl FnOnce() -> T + Send, call: impl FnOnce(&mut (dyn FnMut() + Send))) -> T {
    // A trait object cannot be called by value: the function is taken out by the only call.
    let (mut run, mut result) = (Some(run), None);
    call(&mut || result = run.take().map(|run| run()));
    result.unwrap_or_else(|| unreachable!("the function has been called"))
}

/// Error of the first row that failed, with its number.
struct FirstError<E> {
    /// Number of the row; above all numbers without one.
    row: AtomicUsize,
    error: Mutex<Option<E>>,
}

impl<E> Default for FirstError<E> {
    fn default() -> Self {
        Self {
            row: AtomicUsize::new(usize::MAX),
            error: Mutex::new(None),
        }
    }
}

impl<E> FirstError<E> {
    /// The result of `work` for a row; `None` if it fails, or one before it has.
    fn unless_failed<T>(&self, row: usize, work: impl FnOnce() -> Result<T, E>) -> Option<T> {
        // An outdated number costs a row of work, no more: which error is kept is decided under the lock.
        if row > self.row.load(Memory::Relaxed) {
            return None;
        }
        let failed = match work() {
            Ok(result) => return Some(result),
            Err(failed) => failed,
        };
        let mut error = self.error.lock().unwrap_or_else(PoisonError::into_inner);
        if row < self.row.fetch_min(row, Memory::Relaxed) {
            *error = Some(failed);
        }
        None
    }

    fn unless_any<T>(self, result: T) -> Result<T, E> {
        match self.error.into_inner().unwrap_or_else(PoisonError::into_inner) {
            Some(error) => Err(error),
            None => Ok(result),
        }
    }
}

/// Lists of the pieces of rows, one after another.
fn collect<R: Rows, T: Send>(rows: R, piece: &(dyn Fn(R) -> Vec<T> + Sync)) -> Vec<T> {
    // Linked lists join in constant time at every merge; each result is copied once, at the end.
    let lists = |rows: R| LinkedList::from([piece(rows)]);
    let mut lists = divide(rows, &lists, |mut first, mut last| {
        first.append(&mut last);
        first
    });
    if lists.len() == 1 {
        return lists.pop_front().unwrap_or_default();
    }
    let mut joined = Vec::with_capacity(lists.iter().map(Vec::len).sum());
    for mut list in lists {
        joined.append(&mut list);
    }
    joined
}

/// Cuts rows into pieces, and merges the results of neighbours.
fn divide<R: Rows, A: Send>(rows: R, piece: &(dyn Fn(R) -> A + Sync), merge: fn(A, A) -> A) -> A {
    let pieces = rows.pieces();
    divide_into(rows, pieces, false, piece, merge)
}

/// Rows that another thread has taken are cut anew, as it may take them from one that is slow.
fn divide_into<R: Rows, A: Send>(
    rows: R,
    pieces: usize,
    taken: bool,
    piece: &(dyn Fn(R) -> A + Sync),
    merge: fn(A, A) -> A,
) -> A {
    let count = rows.count();
    if count < 2 || (pieces == 0 && !taken) {
        return piece(rows);
    }
    // A thread that takes rows was idle, and others may be: these rows are cut for all of them again.
    let least = if taken { threads() } else { 0 };
    let pieces = least.max(pieces / 2);
    let (first, last) = rows.split_at(count / 2);
    let (mut first, mut last) = (Some(first), Some(last));
    let (mut of_first, mut of_last) = (None, None);
    let half = |rows: R, taken| divide_into(rows, pieces, taken, piece, merge);
    join(
        &mut |taken| of_first = first.take().map(|rows| half(rows, taken)),
        &mut |taken| of_last = last.take().map(|rows| half(rows, taken)),
    );
    match (of_first, of_last) {
        (Some(first), Some(last)) => merge(first, last),
        _ => unreachable!("both halves have been worked on"),
    }
}

/// Runs two functions, each told whether another thread has taken it. Not generic, so that the machinery of threads is
/// compiled once.
fn join(first: &mut (dyn FnMut(bool) + Send), last: &mut (dyn FnMut(bool) + Send)) {
    rayon::join_context(|context| first(context.migrated()), |context| last(context.migrated()));
}

/// Threads of one's own.
#[derive(Debug)]
pub struct Pool(rayon::ThreadPool);

impl Pool {
    /// A pool of this many threads.
    ///
    /// # Errors
    /// Whatever keeps the system from starting them.
    pub fn new(threads: usize) -> io::Result<Self> {
        Self::started(threads, || ())
    }

    /// A pool of this many threads, each of which calls `start` first.
    ///
    /// # Errors
    /// As for [`Pool::new`].
    pub fn started(threads: usize, start: impl Fn() + Send + Sync + 'static) -> io::Result<Self> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads.max(1));
        let pool = pool.start_handler(move |_| start()).build();
        pool.map(Self).map_err(io::Error::other)
    }

    /// The result of `run` on a thread of the pool, which is the current one meanwhile.
    pub fn install<T: Send>(&self, run: impl FnOnce() -> T + Send) -> T {
        once(run, |run| self.0.install(run))
    }

    /// Calls `work` on each thread of the pool with its number, and `meanwhile` on this thread.
    pub fn broadcast<T>(&self, work: &(dyn Fn(usize) + Sync), meanwhile: impl FnOnce() -> T) -> T {
        self.0.in_place_scope(|scope| {
            scope.spawn_broadcast(move |_, context| work(context.index()));
            meanwhile()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Runs a test in pools of 1 and of 3 threads.
    fn in_pools(test: &(dyn Fn() + Sync)) {
        for count in [1, 3] {
            let pool = Pool::new(count).unwrap();
            pool.install(|| {
                assert_eq!(threads(), count);
                test();
            });
        }
    }

    const COUNTS: [usize; 6] = [0, 1, 2, 7, 64, 1000];

    #[test]
    fn every_row_once_with_its_number() {
        in_pools(&|| {
            for count in COUNTS {
                let mut visits = vec![(0, 0); count];
                for_each((0.., &mut visits[..]), &|(at, (visits, number))| {
                    *visits += 1;
                    *number = at;
                });
                assert!(visits.iter().copied().eq((0..count).map(|at| (1, at))), "{count}");
            }
        });
    }

    #[test]
    fn chunks_and_tuples_run_in_step() {
        in_pools(&|| {
            for count in COUNTS {
                let from: Vec<usize> = (0..count).collect();
                let (mut to, mut sums) = (vec![0; count], vec![0; count]);
                let rows = (0.., chunks(&from, 3), chunks_mut(&mut to, 3), &mut sums[..]);
                for_each(rows, &|(at, from, to, sum)| {
                    assert_eq!(from[0], 3 * at);
                    assert_eq!(from.len(), 3.min(count - 3 * at));
                    to.copy_from_slice(from);
                    *sum += from.iter().sum::<usize>();
                });
                assert_eq!(to, from);
                let expected = from.chunks(3).map(|from| from.iter().sum::<usize>());
                assert!(sums.into_iter().take(count.div_ceil(3)).eq(expected), "{count}");
            }
        });
    }

    #[test]
    fn tuples_end_with_the_shortest() {
        let (short, mut long) = ([1, 2, 3], [0; 8]);
        for_each((chunks_mut(&mut long, 2), &short[..]), &|(long, short)| {
            long.fill(*short)
        });
        assert_eq!(long, [1, 1, 2, 2, 3, 3, 0, 0]);
    }

    #[test]
    fn results_are_in_order() {
        in_pools(&|| {
            for count in COUNTS {
                let squares = map(0..count, &|at| at * at);
                assert!(squares.iter().copied().eq((0..count).map(|at| at * at)));
                assert_eq!(map(tasks(&squares[..]), &|square| *square), squares);
                let even = filter_map(&squares[..], &|&square| (square % 2 == 0).then_some(square));
                assert!(even.iter().eq(squares.iter().filter(|square| **square % 2 == 0)));
            }
        });
    }

    #[test]
    fn the_first_error_wins() {
        in_pools(&|| {
            for count in COUNTS {
                let bad = |at: usize| if at % 10 == 5 || at > 600 { Err(at) } else { Ok(at) };
                let expected: Result<Vec<_>, _> = (0..count).map(bad).collect();
                assert_eq!(try_map(0..count, &bad), expected);
                assert_eq!(try_for_each(0..count, &|at| bad(at).map(drop)), expected.map(drop));
            }
        });
    }

    #[test]
    fn scratch_is_of_the_piece() {
        in_pools(&|| {
            for count in COUNTS {
                let scratches = AtomicUsize::new(0);
                let init = || {
                    scratches.fetch_add(1, Memory::Relaxed);
                    Vec::new()
                };
                let mut sizes = vec![0; count];
                for_each_init(&mut sizes[..], &init, &|scratch, size| {
                    scratch.push(());
                    *size = scratch.len();
                });
                assert_eq!(
                    sizes.iter().filter(|size| **size == 1).count(),
                    scratches.into_inner().min(count)
                );
            }
        });
    }

    #[test]
    fn loops_within_loops_stay_in_their_pool() {
        in_pools(&|| {
            let count = threads();
            let inner = map(0..20, &|_| {
                map(0..20, &|_| (threads(), rayon::current_thread_index().is_some()))
            });
            assert!(inner.iter().flatten().all(|&found| found == (count, true)));
        });
        let pool = Pool::new(3).unwrap();
        assert_eq!(pool.install(|| enter(threads)), 3);
    }

    #[test]
    fn a_broadcast_calls_every_thread() {
        let pool = Pool::new(3).unwrap();
        let calls = [0; 3].map(AtomicUsize::new);
        let work = |thread: usize| {
            calls[thread].fetch_add(1, Memory::Relaxed);
        };
        assert_eq!(pool.broadcast(&work, || 5), 5);
        assert_eq!(calls.map(AtomicUsize::into_inner), [1; 3]);
    }

    #[test]
    fn equal_items_keep_their_order() {
        let mut items: Vec<_> = (0..10_000_u32).map(|at| (at * 7919 % 13, at)).collect();
        let mut expected = items.clone();
        expected.sort();
        sort_by(&mut items, |a, b| a.0.cmp(&b.0));
        assert_eq!(items, expected);
    }
}
