//! Fusion of passes into shared GPU dispatches.
//!
//! A pass follows another in the same invocation, or in the same workgroup behind a barrier, where it uses what the
//! other wrote at its own sample or on its own scanline ([`Use`]). Passes that need nothing of each other run side by
//! side in workgroups of their own.

use crate::effects::buffers::Buffer;
use crate::effects::pass::{Grid, Pass, Use};

/// Largest number of buffers of a dispatch; devices are opened for as many, where they can bind them.
pub const MAX_BUFFERS: usize = 32;

/// A pass with the buffers that are bound to it in a frame.
#[derive(Clone)]
pub struct Bound {
    /// Declaration of the pass.
    pub pass: &'static Pass,
    /// Its buffers, in the order of its bindings.
    pub buffers: Vec<(&'static Buffer, Use)>,
}

/// Passes that run in sequence in each workgroup, by their number in the frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Sequence {
    /// Numbers of the passes, in order.
    pub passes: Vec<usize>,
    /// Whether a workgroup has a complete scanline or row of pixels, with a barrier between passes.
    pub by_line: bool,
}

/// Sequences that one dispatch runs side by side.
pub type Fused = Vec<Sequence>;

/// How far a pass reaches for what another wrote.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Reach {
    Own,
    Line,
    Any,
}

fn reach(how: Use) -> Reach {
    match how {
        Use::ReadOwn | Use::WriteOwn => Reach::Own,
        Use::ReadLine | Use::WriteLine => Reach::Line,
        Use::Read | Use::Write => Reach::Any,
    }
}

/// Reach between two passes: the widest over the buffers that both use and one writes; `None` if they are independent.
fn between(a: &Bound, b: &Bound) -> Option<Reach> {
    let pairs = a.buffers.iter().flat_map(|x| b.buffers.iter().map(move |y| (x, y)));
    pairs
        .filter(|((x, used), (y, other_use))| x == y && (used.writes() || other_use.writes()))
        .map(|((_, used), (_, other_use))| reach(*used).max(reach(*other_use)))
        .max()
}

/// Whether two passes use a buffer that one of them writes, at different samples of a scanline.
#[cfg(feature = "gpu")]
pub(crate) fn depend_along_scanline(a: &Bound, b: &Bound) -> bool {
    between(a, b).is_some_and(|reach| reach > Reach::Own)
}

/// Grids whose samples and scanlines are the same.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Domain {
    Beam,
    Fine,
    Looks,
    FineLooks,
    Image,
    Alone,
}

fn domain(grid: Grid) -> Domain {
    match grid {
        Grid::Samples | Grid::Scanlines => Domain::Beam,
        Grid::FineSamples(_) => Domain::Fine,
        Grid::Pixels | Grid::Words => Domain::Image,
        Grid::Looks(_) => Domain::Looks,
        Grid::FineLooks(_) => Domain::FineLooks,
        Grid::Workgroups(_) | Grid::Shared(_) => Domain::Alone,
    }
}

/// Number of different buffers of some passes.
fn buffers<'a>(passes: &[Bound], numbers: impl IntoIterator<Item = &'a usize>) -> usize {
    let mut all: Vec<&Buffer> = Vec::new();
    for (buffer, _) in numbers.into_iter().flat_map(|&number| &passes[number].buffers) {
        if !all.contains(buffer) {
            all.push(buffer);
        }
    }
    all.len()
}

/// Dispatches of a frame, in order, each binding at most `limit` buffers.
pub fn fuse(passes: &[Bound], limit: usize) -> Vec<Fused> {
    let mut sequences: Vec<Sequence> = Vec::new();
    for (number, pass) in passes.iter().enumerate() {
        let needed = domain(pass.pass.grid);
        let domain_of = |sequence: &Sequence| domain(passes[sequence.passes[0]].pass.grid);
        let widest = |sequence: &Sequence| {
            sequence
                .passes
                .iter()
                .filter_map(|&other| between(&passes[other], pass))
                .max()
        };
        let fits = |sequence: &Sequence| {
            needed != Domain::Alone
                && domain_of(sequence) == needed
                && widest(sequence) < Some(Reach::Any)
                && buffers(passes, sequence.passes.iter().chain([&number])) <= limit
        };
        // Behind all that it needs; in the last of these if it fits.
        let last = sequences.iter().rposition(|sequence| widest(sequence).is_some());
        let first = last.map_or(0, |last| if fits(&sequences[last]) { last } else { last + 1 });
        let by_line = matches!(pass.pass.grid, Grid::Scanlines);
        match (first..sequences.len()).find(|&joined| fits(&sequences[joined])) {
            Some(joined) => {
                let by_line = by_line || widest(&sequences[joined]) == Some(Reach::Line);
                sequences[joined].passes.push(number);
                sequences[joined].by_line |= by_line;
            }
            None => sequences.insert(
                first,
                Sequence {
                    passes: vec![number],
                    by_line,
                },
            ),
        }
    }
    side_by_side(passes, sequences, limit)
}

/// Joins neighbouring sequences that need nothing of each other and have workgroups of the same size.
fn side_by_side(passes: &[Bound], sequences: Vec<Sequence>, limit: usize) -> Vec<Fused> {
    let joins =
        |sequence: &Sequence| sequence.by_line || matches!(passes[sequence.passes[0]].pass.grid, Grid::Workgroups(_));
    let mut fused: Vec<Fused> = Vec::new();
    for sequence in sequences {
        let independent = |other: &Sequence| {
            joins(other)
                && !(other.passes.iter()).any(|&a| {
                    sequence
                        .passes
                        .iter()
                        .any(|&b| between(&passes[a], &passes[b]).is_some())
                })
        };
        match fused.last_mut() {
            Some(last)
                if joins(&sequence)
                    && last.iter().all(independent)
                    && buffers(passes, last.iter().chain([&sequence]).flat_map(|other| &other.passes)) <= limit =>
            {
                last.push(sequence);
            }
            _ => fused.push(vec![sequence]),
        }
    }
    fused
}
