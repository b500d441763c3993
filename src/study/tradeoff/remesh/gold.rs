//! Gold standard: solutions from a factor of the moved mesh, with iterative refinement.

use faer::{Mat, MatRef};

use super::StudyError;
use super::contender::Contender;
use super::subject::Subject;
use crate::mechanics::tissue::assembly::Stiffness;
use crate::mechanics::tissue::factor::Factor;
use crate::mechanics::tissue::remesh::AdaptedMesh;
use crate::study::stability::record::largest;

/// Number of compared columns of K^-1: half at the moved part of the mesh, half spread over all of it.
pub const SAMPLES: usize = 24;

/// Returns the magnitude of the resultant of a load, N.
fn resultant_n(load: &[f64]) -> f64 {
    let along = |axis: usize| load.iter().skip(axis).step_by(3).sum::<f64>();
    (0..3).map(|axis| along(axis).powi(2)).sum::<f64>().sqrt()
}

/// Reference solutions in one state of the mesh.
pub struct Gold {
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
    /// [`StudyError`] if the moved mesh cannot be solved.
    pub fn of_contacts(subject: &Subject, mesh: &AdaptedMesh) -> Result<Gold, StudyError> {
        Gold::new(subject, mesh, Vec::new())
    }

    /// Computes K^c, displacements under the load, and sampled columns of K^-1.
    ///
    /// # Errors
    /// [`StudyError`] if the moved mesh cannot be solved.
    pub fn with_samples(subject: &Subject, mesh: &AdaptedMesh) -> Result<Gold, StudyError> {
        let support: Vec<usize> = mesh.support().map(|dof| dof as usize).collect();
        let spread = |count: usize, of: usize| (0..count.min(of)).map(move |k| k * of / count.min(of));
        let mut samples: Vec<usize> = spread(SAMPLES / 2, support.len()).map(|at| support[at]).collect();
        samples.extend(spread(SAMPLES / 2, subject.size()));
        samples.sort_unstable();
        samples.dedup();
        Gold::new(subject, mesh, samples)
    }

    fn new(subject: &Subject, mesh: &AdaptedMesh, samples: Vec<usize>) -> Result<Gold, StudyError> {
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
                .for_each(|(to, from)| *to = *from);
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
    pub fn error_of_contacts(&self, found: MatRef<'_, f64>) -> f64 {
        relative(found, self.condensed.as_ref())
    }

    /// Returns whether columns of K^-1 were sampled.
    pub fn has_samples(&self) -> bool {
        !self.samples.is_empty()
    }

    /// Returns the relative errors of sampled columns of K^-1, of K^c and of displacements; the relative residual; and the largest error of
    /// displacements with the load scaled to a resultant of one newton, mm.
    ///
    /// # Errors
    /// [`StudyError`] if the contender fails.
    pub fn errors(&self, subject: &Subject, contender: &mut dyn Contender) -> Result<[f64; 5], StudyError> {
        let every: Vec<usize> = (0..subject.size()).collect();
        let columns = contender.block(&every, &self.samples)?;
        let forces = load(subject.contacts.len());
        let mut u = vec![0.0; subject.size()];
        contender.displacement(&forces, &mut u)?;
        let [found, expected] =
            [&u, &self.solution].map(|values| MatRef::from_column_major_slice(values, values.len(), 1));
        Ok([
            relative(columns.as_ref(), self.columns.as_ref()),
            self.error_of_contacts(contender.condensed()),
            relative(found, expected),
            self.residual(columns.as_ref()),
            largest(u.iter().zip(&self.solution).map(|(found, expected)| found - expected)) / resultant_n(&forces),
        ])
    }

    /// Returns the largest |K X e - e| / (|K| |X e|) over the samples, in infinity norms (J. L. Rigal and J. Gaches, "On the compatibility
    /// of a given solution with the data of a linear system", Journal of the ACM 14, 1967).
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

/// Returns |found - expected| / |expected| in the Frobenius norm.
fn relative(found: MatRef<'_, f64>, expected: MatRef<'_, f64>) -> f64 {
    (found - expected).norm_l2() / expected.norm_l2()
}
