//! Subjects of the remeshing study and their gold standard.

use std::sync::Arc;

use faer::{Mat, MatRef};

use super::RemeshOptions;
use super::contender::Contender;
use crate::StudyError;
use crate::stability::record::largest;
use insonify::Error;
use insonify_base::random::{hash3, seed_words, unit};
use insonify_mechanics::tissue::assembly::Stiffness;
use insonify_mechanics::tissue::dofs::{Dofs, NO_DOF};
use insonify_mechanics::tissue::factor::Factor;
use insonify_mechanics::tissue::material::Material;
use insonify_mechanics::tissue::remesh::corner::best_corner;
use insonify_mechanics::tissue::remesh::{AdaptedMesh, Change};
use insonify_mechanics::tissue::rigid;
use insonify_mesh::locator::{Locator, NO_ELEMENT};
use insonify_mesh::{InvalidMesh, TetMesh};

/// Number of nodes in contact: half of them with the needle, if it has moved that many, the others around its entry.
const CONTACTS: usize = 20;
/// Least number of moves in a track.
pub(crate) const MIN_MOVES: usize = 3;
/// Share of the extent along z whose nodes are fixed.
const FIXED: f64 = 0.02;
/// Extent share and least node share for a mesh with fewer fixed nodes, such as a round organ: supported by a few nodes
/// it would rotate almost freely, and its compliance would be that of the supports.
const FIXED_OF_ROUND: f64 = 0.1;
const MIN_FIXED: f64 = 0.03;
/// Entry and final tip position of the needle, as shares of the mesh's bounding box.
const LINE: [[f64; 3]; 2] = [[0.43, 0.46, 1.0], [0.57, 0.53, 0.12]];
/// Extents of the generated mesh, mm.
const BOX_MM: [f64; 3] = [120.0, 100.0, 80.0];
/// Random displacement of its inner nodes, as a share of the lattice spacing.
const SHAKEN: f64 = 0.12;

/// Supported mesh with the moves of one insertion.
pub(crate) struct Subject {
    /// Mesh with every node at its base position.
    pub mesh: AdaptedMesh,
    /// Factor of the stiffness at the base.
    pub factor: Arc<Factor>,
    /// Degrees of freedom in contact.
    pub contacts: Vec<usize>,
    /// Nodes and their target positions (mm), in order.
    track: Vec<(u32, [f64; 3])>,
}

/// Generates a block of about `nodes` nodes, with inner nodes perturbed so that no two elements are equal.
///
/// # Errors
/// [`InvalidMesh`] if the result is not a valid mesh.
pub(crate) fn generated(nodes: usize) -> Result<TetMesh, InvalidMesh> {
    let regular = TetMesh::over_box([0.0; 3], BOX_MM, nodes)?;
    let edge = (BOX_MM.iter().product::<f64>() / regular.nodes().len() as f64).cbrt();
    let shaken = regular.nodes().iter().zip(0..).map(|(position, node)| {
        let words = hash3([node, 0, 0], seed_words(1));
        std::array::from_fn(|axis| {
            let inside = position[axis] > 0.0 && position[axis] < BOX_MM[axis];
            let shift = SHAKEN * edge * (2.0 * f64::from(unit(words[axis])) - 1.0);
            position[axis] + if inside { shift } else { 0.0 }
        })
    });
    TetMesh::new(
        shaken.collect(),
        regular.elements().to_vec(),
        regular.regions().to_vec(),
    )
}

/// Returns the degrees of freedom of a mesh with its lowest nodes along z fixed: those in the lowest 2 % of its height
/// or, if these are less than 3 % of all nodes, those in the lowest 10 % and at least 3 % of all.
pub(crate) fn supports(mesh: &TetMesh) -> Dofs {
    let mut heights: Vec<f64> = mesh.nodes().iter().map(|node| node[2]).collect();
    heights.sort_by(f64::total_cmp);
    let least = heights[(MIN_FIXED * heights.len() as f64) as usize];
    let [narrow, wide] = [FIXED, FIXED_OF_ROUND].map(|share| point_in_extents(mesh, [0.0, 0.0, share])[2]);
    let floor = if least <= narrow { narrow } else { wide.max(least) };
    let fixed_nodes = mesh
        .nodes()
        .iter()
        .zip(0..)
        .filter(|(position, _)| position[2] <= floor);
    Dofs::new(
        mesh.nodes().len(),
        fixed_nodes.flat_map(|(_, node)| [0, 1, 2].map(|axis| (node, axis))),
    )
}

/// Returns the point at the given shares of a mesh's extents, mm.
fn point_in_extents(mesh: &TetMesh, share: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|axis| {
        let coordinates = || mesh.nodes().iter().map(|node| node[axis]);
        let (low, high) = (
            coordinates().fold(f64::INFINITY, f64::min),
            coordinates().fold(f64::NEG_INFINITY, f64::max),
        );
        low + share[axis] * (high - low)
    })
}

impl Subject {
    /// Fixes the lowest nodes along z, assigns one material, and determines the corners moved by a needle that goes
    /// down through the middle.
    ///
    /// # Errors
    /// [`Error`] if the mesh is unsuitable or its stiffness cannot be factorised.
    pub(crate) fn new(mesh: &TetMesh, options: &RemeshOptions) -> Result<Subject, Error> {
        let dofs = supports(mesh);
        rigid::check(mesh, &dofs)?;
        let material = Material::new(options.young_kpa, options.poisson)?;
        let adapted = AdaptedMesh::new(mesh, &vec![material; mesh.elements().len()], &dofs)?;
        let factor = Arc::new(Factor::new(adapted.stiffness())?);
        let [entry, tip] = LINE.map(|share| point_in_extents(mesh, share));
        let around = nearest_free(&adapted, entry, CONTACTS / 2)?;
        let track = track(mesh, adapted.clone(), [entry, tip], &around, options.moves)?;
        let with_needle = track.len().min(CONTACTS - around.len());
        let touched = (0..with_needle).map(|k| track[k * track.len() / with_needle].0);
        let nodes: Vec<u32> = around.iter().copied().chain(touched).collect();
        let contacts = nodes
            .iter()
            .flat_map(|node| adapted.dofs().of(*node))
            .map(|dof| dof as usize);
        Ok(Subject {
            contacts: contacts.collect(),
            mesh: adapted,
            factor,
            track,
        })
    }

    /// Returns the number of nodes.
    pub(crate) fn nodes(&self) -> usize {
        self.mesh.nodes().len()
    }

    /// Returns the number of fixed nodes.
    pub(crate) fn fixed(&self) -> usize {
        self.nodes() - self.size() / 3
    }

    /// Returns the number of free degrees of freedom.
    pub(crate) fn size(&self) -> usize {
        self.mesh.dofs().free()
    }

    /// Returns the number of updates until the needle is fully inserted for the first time.
    pub(crate) fn inserted(&self) -> usize {
        self.track.len()
    }

    /// Returns the mean number of degrees of freedom around a moved node (s).
    pub(crate) fn rank(&self) -> f64 {
        let free = |node: &u32| self.mesh.dofs().of(*node).iter().filter(|dof| **dof != NO_DOF).count();
        let ranks = self
            .track
            .iter()
            .map(|(node, _)| self.mesh.neighbours(*node).iter().map(free).sum::<usize>());
        ranks.sum::<usize>() as f64 / self.track.len() as f64
    }

    /// Makes the change that follows `done` changes: the next inward move, or the undoing of the last one.
    ///
    /// # Errors
    /// [`RemeshError`](insonify_mechanics::tissue::remesh::RemeshError), which would indicate a fault of the mesh, as
    /// all moves have been tried before.
    pub(crate) fn step(&self, mesh: &mut AdaptedMesh, done: usize) -> Result<Change, Error> {
        let (length, position) = (self.track.len(), done % (2 * self.track.len()));
        let moves = mesh.moves().len();
        if position < length {
            let (node, position_mm) = self.track[position];
            return Ok(mesh.move_node(node, position_mm)?);
        }
        mesh.undo()?.ok_or_else(|| few_moves(moves))
    }
}

/// Error if the needle's line crosses too few elements with a movable corner.
fn few_moves(moves: usize) -> Error {
    StudyError::refused(format!(
        "only {moves} corners can be moved along the needle's line, {MIN_MOVES} expected: the mesh is too coarse, or lies beside \
         the line down through the middle of its box"
    ))
}

/// Returns the free nodes nearest to a point.
fn nearest_free(mesh: &AdaptedMesh, point: [f64; 3], count: usize) -> Result<Vec<u32>, Error> {
    let distance = |node: u32| -> f64 {
        let position = mesh.nodes()[node as usize];
        (0..3).map(|axis| (position[axis] - point[axis]).powi(2)).sum()
    };
    let mut free: Vec<u32> = (0..mesh.nodes().len() as u32)
        .filter(|node| !mesh.dofs().of(*node).contains(&NO_DOF))
        .collect();
    if free.len() < 2 * count {
        return Err(StudyError::refused(format!(
            "the mesh has {} free nodes beside the needle, {} expected as contacts; take a finer mesh",
            free.len(),
            2 * count
        )));
    }
    free.sort_by(|a, b| distance(*a).total_cmp(&distance(*b)).then(a.cmp(b)));
    free.truncate(count);
    Ok(free)
}

/// Returns the moves of a needle along a line.
fn track(
    base: &TetMesh,
    mut mesh: AdaptedMesh,
    [entry, target]: [[f64; 3]; 2],
    loaded: &[u32],
    max_moves: usize,
) -> Result<Vec<(u32, [f64; 3])>, Error> {
    let mut locator = Locator::<f64>::new(base);
    let mut track: Vec<(u32, [f64; 3])> = Vec::new();
    let mut previous = NO_ELEMENT;
    // Fine enough to skip few elements.
    let steps = (20.0 * (base.nodes().len() as f64).cbrt()) as usize;
    for step in 1..=steps {
        let share = step as f64 / steps as f64;
        let tip: [f64; 3] = std::array::from_fn(|axis| entry[axis] + share * (target[axis] - entry[axis]));
        let element = locator.locate(tip, previous).element;
        if element == NO_ELEMENT || element == previous || track.len() >= max_moves {
            continue;
        }
        previous = element;
        let is_taken = |node| loaded.contains(&node) || track.iter().any(|(moved, _)| *moved == node);
        let Ok(corner) = best_corner(&mesh, element, tip, is_taken) else {
            continue;
        };
        mesh.move_node(corner.node, tip)?;
        locator.update(mesh.nodes())?;
        track.push((corner.node, tip));
    }
    match track.len() {
        moves if moves < MIN_MOVES => Err(few_moves(moves)),
        _ => Ok(track),
    }
}

/// Number of compared columns of K^-1: half at the moved part of the mesh, half spread over all of it.
pub(crate) const SAMPLES: usize = 24;

/// Returns the magnitude of the resultant of a load, N.
fn resultant_n(load: &[f64]) -> f64 {
    let sum = |axis: usize| load.iter().skip(axis).step_by(3).sum::<f64>();
    (0..3).map(|axis| sum(axis).powi(2)).sum::<f64>().sqrt()
}

/// Reference solutions in one state of the mesh.
pub(crate) struct Gold {
    stiffness: Stiffness,
    condensed: Mat<f64>,
    samples: Vec<usize>,
    columns: Mat<f64>,
    solution: Vec<f64>,
}

/// Returns the fixed load, N: a force on each contact degree of freedom, of both signs, so that there is no symmetry.
fn load(contacts: usize) -> Vec<f64> {
    (0..contacts)
        .map(|k| [0.3, -0.2, -1.0][k % 3] * (1.0 + k as f64 / contacts as f64))
        .collect()
}

impl Gold {
    /// Computes K^c only.
    ///
    /// # Errors
    /// [`Error`] if the moved mesh cannot be solved.
    pub(crate) fn of_contacts(subject: &Subject, mesh: &AdaptedMesh) -> Result<Gold, Error> {
        Gold::new(subject, mesh, Vec::new())
    }

    /// Computes K^c, displacements under the load, and sampled columns of K^-1.
    ///
    /// # Errors
    /// [`Error`] if the moved mesh cannot be solved.
    pub(crate) fn with_samples(subject: &Subject, mesh: &AdaptedMesh) -> Result<Gold, Error> {
        let support: Vec<usize> = mesh.support().map(|dof| dof as usize).collect();
        let spread = |count: usize, available: usize| {
            (0..count.min(available)).map(move |k| k * available / count.min(available))
        };
        let mut samples: Vec<usize> = spread(SAMPLES / 2, support.len()).map(|index| support[index]).collect();
        samples.extend(spread(SAMPLES / 2, subject.size()));
        samples.sort_unstable();
        samples.dedup();
        Gold::new(subject, mesh, samples)
    }

    fn new(subject: &Subject, mesh: &AdaptedMesh, samples: Vec<usize>) -> Result<Gold, Error> {
        // Assembled anew at the present nodes, and solved with refinement: the truth must be free of what
        // updates accumulate, and better than levels in f64, which err by little more than rounding.
        let stiffness = mesh.stiffness().at_nodes(mesh.nodes())?;
        let factor = Factor::new(&stiffness)?;
        let size = subject.size();
        let column = |dof: usize| {
            let mut unit = vec![0.0; size];
            unit[dof] = 1.0;
            factor.solve_refined(&stiffness, &unit).0
        };
        let contacts = &subject.contacts;
        let mut condensed = Mat::zeros(contacts.len(), contacts.len());
        for (j, &dof) in contacts.iter().enumerate() {
            let values = column(dof);
            contacts
                .iter()
                .enumerate()
                .for_each(|(i, row)| condensed[(i, j)] = values[*row]);
        }
        let mut columns = Mat::zeros(size, samples.len());
        for (j, &dof) in samples.iter().enumerate() {
            let values = column(dof);
            columns
                .col_mut(j)
                .iter_mut()
                .zip(&values)
                .for_each(|(target, source)| *target = *source);
        }
        let mut forces = vec![0.0; size];
        contacts
            .iter()
            .zip(load(contacts.len()))
            .for_each(|(dof, force)| forces[*dof] = force);
        let (solution, _) = factor.solve_refined(&stiffness, &forces);
        Ok(Gold {
            stiffness,
            condensed,
            samples,
            columns,
            solution,
        })
    }

    /// Returns the relative error of K^c in the Frobenius norm.
    pub(crate) fn error_of_contacts(&self, condensed: MatRef<'_, f64>) -> f64 {
        relative(condensed, self.condensed.as_ref())
    }

    /// Returns whether columns of K^-1 were sampled.
    pub(crate) fn has_samples(&self) -> bool {
        !self.samples.is_empty()
    }

    /// Returns the relative errors of sampled columns of K^-1, of K^c and of displacements; the relative residual; and
    /// the largest error of displacements with the load scaled to a resultant of one newton, mm.
    ///
    /// # Errors
    /// [`Error`] if the contender fails.
    pub(crate) fn errors(&self, subject: &Subject, contender: &mut dyn Contender) -> Result<[f64; 5], Error> {
        let rows: Vec<usize> = (0..subject.size()).collect();
        let columns = contender.block(&rows, &self.samples)?;
        let forces = load(subject.contacts.len());
        let mut u = vec![0.0; subject.size()];
        contender.displacement(&forces, &mut u)?;
        let [displacement, expected] =
            [&u, &self.solution].map(|values| MatRef::from_column_major_slice(values, values.len(), 1));
        Ok([
            relative(columns.as_ref(), self.columns.as_ref()),
            self.error_of_contacts(contender.condensed()),
            relative(displacement, expected),
            self.residual(columns.as_ref()),
            largest(u.iter().zip(&self.solution).map(|(u, expected)| u - expected)) / resultant_n(&forces),
        ])
    }

    /// Returns the largest |K X e - e| / (|K| |X e|) over the samples, in infinity norms (J. L. Rigal and J. Gaches,
    /// "On the compatibility of a given solution with the data of a linear system", Journal of the ACM 14, 1967).
    fn residual(&self, columns: MatRef<'_, f64>) -> f64 {
        let mut product = vec![0.0; columns.nrows()];
        let mut worst = 0.0f64;
        for (column, &dof) in columns.col_iter().zip(&self.samples) {
            let values: Vec<f64> = column.iter().copied().collect();
            self.stiffness.multiply(&values, &mut product);
            product[dof] -= 1.0;
            let scale = self.stiffness.norm_inf() * largest(values.iter().copied());
            for value in &product {
                // Not `max`, which ignores NaN.
                let value = value.abs() / scale;
                if value.is_nan() || value > worst {
                    worst = value;
                }
            }
            if worst.is_nan() {
                break;
            }
        }
        worst
    }
}

/// Returns |values - expected| / |expected| in the Frobenius norm.
fn relative(values: MatRef<'_, f64>, expected: MatRef<'_, f64>) -> f64 {
    let square = |entry: &dyn Fn(usize, usize) -> f64| -> f64 {
        let columns = (0..expected.ncols()).flat_map(|j| (0..expected.nrows()).map(move |i| (i, j)));
        columns.map(|(i, j)| entry(i, j).powi(2)).sum()
    };
    (square(&|i, j| values[(i, j)] - expected[(i, j)]) / square(&|i, j| expected[(i, j)])).sqrt()
}
