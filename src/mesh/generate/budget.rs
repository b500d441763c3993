//! Node budget: the initial lattice, and the extent of its refinement.

use super::assign::{self, Limits};
use super::bisection::{Bisection, Lattice};
use super::contents::Sampler;
use super::draft::Draft;
use super::path::Path;
use super::refine::{End, Refinement};
use super::tissue::Tissue;
use super::{GenerateError, GenerateOptions, Generated, MAX_NODES, ROUNDS, finish, fit, smooth};

/// Nodes of the result for each of the lattice: room for interfaces to be refined twice over while the bulk stays
/// coarse.
const REFINEMENT: f64 = 12.0;
/// Least width of a cell as a share of the others: thinner tissue lies in a wider cell, with space beside it.
const NARROWEST: f64 = 0.4;
/// Share of the budget that may be spent on the lattice so that thin tissue fills its cells.
const THIN: f64 = 0.6;
/// Share of the budget that is the first target: the last steps move a few nodes across the surface.
const FIRST_AIM: f64 = 0.985;
/// Number of times that the target is lowered while the result exceeds the budget, and the additional factor on it.
const AIMS: usize = 8;
const MARGIN: f64 = 0.99;
/// Relative shortfall of the node count from the target that is accepted.
const SHORTFALL: f64 = 0.01;
/// Maximum number of refinements for one target.
const TRIES: usize = 12;
/// Maximum target of the refinement, as a multiple of the wanted nodes: where tissue is thinner than the elements,
/// fewer of them are kept than refinement counts.
const OVERSHOOT: usize = 3;

/// Maximum number of nodes tried in search of a budget that works.
const MAX_TRIED: usize = MAX_NODES / 64;
/// Work after which that search ends, some seconds.
pub(super) const MAX_SEARCH: u64 = 100_000_000;

/// Rejects tissue so thin that elements of its thickness could not fill it with the largest number of nodes tried.
pub(super) fn check_thickness(tissue: &Tissue) -> Result<(), GenerateError> {
    let cell = (tissue.thickness / NARROWEST).powi(3);
    let volume: f64 = tissue.volumes.iter().sum();
    if volume <= MAX_TRIED as f64 * cell {
        Ok(())
    } else {
        Err(GenerateError::TooThin { nodes: MAX_TRIED })
    }
}

/// Returns the lattice over a box of tissue whose low corner is the origin: cells as close to cubes as fill it exactly,
/// except for a box far thinner than a cell, which lies in the middle of one layer.
fn lattice(extent: [f64; 3], nodes: usize) -> Lattice {
    let points = nodes as f64 / REFINEMENT;
    let cells = |edge: f64| extent.map(|length| (length / edge).round().max(1.0));
    let count = |edge: f64| cells(edge).iter().map(|n| n + 1.0).product::<f64>();
    let longest = extent.iter().fold(0.0f64, |a, b| a.max(*b));
    // The count falls as the edge grows: bisect between too many and the fewest.
    let (mut fine, mut coarse) = (longest / points.max(1.0), longest);
    for _ in 0..40 {
        let middle = 0.5 * (fine + coarse);
        if count(middle) > points {
            fine = middle;
        } else {
            coarse = middle;
        }
    }
    // Thin tissue justifies a finer lattice, since elements cannot be flat.
    let thinnest = extent.iter().fold(f64::INFINITY, |a, b| a.min(*b));
    let fitting = coarse.min(thinnest / NARROWEST);
    let edge = if count(fitting) <= THIN * nodes as f64 {
        fitting
    } else {
        coarse
    };
    let cells = cells(edge);
    let (mut low, mut edges) = ([0.0; 3], [0.0; 3]);
    for axis in 0..3 {
        edges[axis] = extent[axis] / cells[axis];
        if edges[axis] < 0.999 * NARROWEST * edge {
            edges[axis] = edge;
            low[axis] = 0.5 * (extent[axis] - edge);
        }
    }
    Lattice {
        cells: cells.map(|n| n as usize),
        low,
        edges,
    }
}

/// Generates a mesh of at most `nodes` nodes, or `None` if none is that small or the sampler's work is spent.
pub(super) fn within(
    tissue: &Tissue,
    sampler: &Sampler,
    nodes: usize,
    options: &GenerateOptions,
    progress: &mut dyn FnMut(f32),
) -> Result<Option<Generated>, GenerateError> {
    let limits = Limits::new(options.min_dihedral_deg);
    let path = Path::new(options, nodes, tissue);
    let mut aim = (FIRST_AIM * nodes as f64).ceil() as usize;
    for _ in 0..AIMS {
        let Some(mut draft) = refined(tissue, sampler, nodes, aim, options, &path, progress)? else {
            return Ok(None);
        };
        for round in 0..ROUNDS {
            if sampler.is_spent() {
                return Ok(None);
            }
            fit::fit(&mut draft, tissue, &limits);
            smooth::relax(&mut draft);
            draft.sample(tissue, sampler);
            if round + 1 == ROUNDS {
                assign::settle(&mut draft, tissue, &limits);
            } else {
                assign::prefer(&mut draft, tissue, &limits);
            }
            progress(0.4 + 0.6 * (round + 1) as f32 / ROUNDS as f32);
        }
        let kept = draft.kept_nodes();
        if kept == 0 {
            return Ok(None);
        }
        if kept <= nodes {
            return finish::finish(&draft, tissue, &path, sampler).map(Some);
        }
        // Fitting and assigning change which nodes are kept; their number goes about with the aim.
        let fitting = MARGIN * aim as f64 * nodes as f64 / kept as f64;
        aim = (fitting as usize).min(aim.saturating_sub(1));
    }
    Ok(None)
}

/// Refines a mesh until `aim` nodes belong to tissue, and assigns its elements; `None` if no element is kept.
fn refined(
    tissue: &Tissue,
    sampler: &Sampler,
    nodes: usize,
    aim: usize,
    options: &GenerateOptions,
    path: &Path,
    progress: &mut dyn FnMut(f32),
) -> Result<Option<Draft>, GenerateError> {
    let limits = &Limits::new(options.min_dihedral_deg);
    let max_edge = options.max_edge_mm.unwrap_or(f64::INFINITY);
    let start = || {
        Refinement::new(
            Bisection::new(&lattice(tissue.extent, nodes)),
            tissue,
            sampler,
            path,
            max_edge,
        )
    };
    let mut refinement = start();
    let mut target = aim;
    let mut best: Option<Draft> = None;
    for _ in 0..TRIES {
        if refinement.nodes() > target {
            refinement = start();
        }
        let end = refinement.refine(target, tissue, sampler, &mut |nodes| {
            progress(0.3 * nodes as f32 / target.max(1) as f32);
        });
        if sampler.is_spent() {
            return Ok(None);
        }
        if refinement.is_overlong() {
            let max_edge_mm = max_edge;
            return Err(GenerateError::LongEdges { max_edge_mm, nodes });
        }
        let mut draft = Draft::new(&refinement.mesh, tissue, sampler)?;
        assign::prefer(&mut draft, tissue, limits);
        if 2 * draft.kept_nodes() < aim {
            // Tissue thinner than the elements: only its volume includes it.
            assign::settle(&mut draft, tissue, limits);
        }
        let kept = draft.kept_nodes();
        if kept <= aim {
            if best.as_ref().is_none_or(|best| best.kept_nodes() < kept) {
                best = Some(draft);
            }
            if end == End::Pure || kept as f64 >= (1.0 - SHORTFALL) * aim as f64 {
                break;
            }
        }
        let next = target as f64 * (aim as f64 / kept.max(1) as f64).clamp(0.25, 2.0);
        target = if kept > aim {
            (next as usize).min(target.saturating_sub(1))
        } else {
            (next as usize).max(target + 1)
        };
        if target < 4 || target > OVERSHOOT * aim {
            break;
        }
    }
    progress(0.4);
    Ok(best.filter(|draft| draft.kept_nodes() > 0))
}

/// Returns the error for too few `nodes`, with the least number that works: found by doubling, then bisection while
/// work is left.
pub(super) fn shortage(
    tissue: &Tissue,
    sampler: &Sampler,
    nodes: usize,
    options: &GenerateOptions,
) -> Result<GenerateError, GenerateError> {
    let works = |nodes: usize| within(tissue, sampler, nodes, options, &mut |_| {}).map(|draft| draft.is_some());
    let (mut short, mut enough) = (nodes, nodes.max(4));
    sampler.limit(MAX_SEARCH);
    while !works(enough)? {
        if enough > MAX_TRIED || sampler.is_spent() {
            return Ok(GenerateError::TooThin { nodes: enough });
        }
        short = enough;
        enough *= 2;
    }
    while enough - short > 1 + enough / 16 && !sampler.is_spent() {
        let middle = short + (enough - short) / 2;
        if works(middle)? {
            enough = middle;
        } else {
            short = middle;
        }
    }
    Ok(GenerateError::TooFewNodes { nodes, least: enough })
}
