//! Constraint switching by principal pivot exchanges. The tableau is K^c swept at D (J. H. Goodnight, "A tutorial on
//! the SWEEP operator", The American Statistician 33, 1979), which keeps it symmetric:
//!
//! ```text
//! M = [ -K_DD^-1          K_DD^-1 K_DF               ]      f_D = -(M x)_D,  u_F = (M x)_F
//!     [  K_FD K_DD^-1     K_FF - K_FD K_DD^-1 K_DF   ]      with x = (u_D, f_F)
//! ```
//!
//! Adding a degree of freedom to D, or removing one, takes O(delta^2) operations. Rounding errors accumulate in the
//! tableau, so two monitors guard it; where either exceeds its limit, the tableau is recomputed from K^c:
//!
//! - every exchange adds eps / (its pivot relative to the diagonal) to a sum, limited by [`DRIFT_LIMIT`];
//! - every solution is corrected once with its own residual, and the correction, an estimate of the relative error of
//!   the forces before it, is limited by [`CORRECTION_LIMIT`].

use faer::Mat;

use super::{Condensed, ConstraintSolver, ContactState, Prescribed, SwitchError, System, column, multiply};

/// Largest accumulated rounding, relative to the forces, before the tableau is recomputed.
const DRIFT_LIMIT: f64 = 1e-10;

/// Largest correction of a solution, relative to its largest force, before the tableau is recomputed.
const CORRECTION_LIMIT: f64 = 1e-10;

/// Constraint solver by exchanges in a tableau.
#[derive(Clone, Debug)]
pub struct Pivots {
    system: System,
    prescribed: Vec<Prescribed>,
    pub(super) tableau: Mat<f64>,
    /// Backup of the tableau while several exchanges are tried.
    spare: Mat<f64>,
    /// Pivot column of the current exchange.
    pivot: Vec<f64>,
    drift: f64,
    refreshes: usize,
    residual: Vec<f64>,
    correction: Vec<f64>,
}

impl Pivots {
    /// Creates a solver with all forces prescribed. `limit` is the smallest relative pivot, as
    /// [`PIVOT_LIMIT`](super::PIVOT_LIMIT).
    ///
    /// # Errors
    /// [`SwitchError::NotFinite`] when an entry of K^c is not finite.
    pub fn new(condensed: &Condensed, limit: f64) -> Result<Self, SwitchError> {
        Ok(Self::over(System::new(condensed, limit)?))
    }

    fn over(system: System) -> Self {
        let size = system.size();
        Self {
            prescribed: vec![Prescribed::Force; size],
            tableau: system.matrix.clone(),
            spare: Mat::new(),
            pivot: vec![0.0; size],
            drift: 0.0,
            refreshes: 0,
            residual: vec![0.0; size],
            correction: vec![0.0; size],
            system,
        }
    }

    /// Number of times that a monitor had the tableau recomputed.
    pub fn refreshes(&self) -> usize {
        self.refreshes
    }

    /// Adds a degree of freedom to D or removes it; a refusal changes nothing.
    fn exchange(&mut self, dof: usize) -> Result<(), SwitchError> {
        let joins = self.prescribed[dof] == Prescribed::Force;
        let entry = self.tableau[(dof, dof)];
        // Compliance of the degree of freedom with the rest of D fixed, in either direction.
        let pivot = if joins { entry } else { -1.0 / entry };
        if joins {
            self.system.check_pivot(dof, pivot)?;
        }
        self.drift += f64::EPSILON * (self.system.diagonal(dof) / pivot).abs();
        self.pivot.copy_from_slice(column(self.tableau.as_ref(), dof));
        let inverse = 1.0 / entry;
        let rows = &self.pivot;
        for (j, mut column) in self.tableau.as_mut().col_iter_mut().enumerate() {
            let factor = rows[j];
            let Some(column) = column.as_mut().try_as_col_major_mut() else {
                continue;
            };
            // Exactly symmetric: a product does not depend on the order of its two factors.
            let entries = column.as_slice_mut().iter_mut().zip(rows);
            entries.for_each(|(value, &row)| *value -= (row * factor) * inverse);
        }
        let sign = if joins { inverse } else { -inverse };
        for i in 0..self.pivot.len() {
            self.tableau[(i, dof)] = self.pivot[i] * sign;
            self.tableau[(dof, i)] = self.pivot[i] * sign;
        }
        self.tableau[(dof, dof)] = -inverse;
        self.prescribed[dof] = match joins {
            true => Prescribed::Displacement,
            false => Prescribed::Force,
        };
        Ok(())
    }

    /// Performs all exchanges that are needed.
    fn exchange_all(&mut self, changes: &[(usize, Prescribed)]) -> Result<(), SwitchError> {
        for &(dof, prescribed) in changes {
            if self.prescribed[dof] != prescribed {
                self.exchange(dof)?;
            }
        }
        Ok(())
    }

    /// Recomputes the tableau from K^c. Where rounding now refuses a pivot that passed before, the old tableau is kept;
    /// corrections of solutions still monitor it.
    fn refresh(&mut self) {
        let mut fresh = Self::over(self.system.clone());
        if fresh.exchange_all(&changes(&self.prescribed)).is_ok() {
            self.tableau = fresh.tableau;
        }
        self.drift = 0.0;
        self.refreshes += 1;
    }

    /// Computes forces and displacements, corrected once; returns the correction relative to the largest unknown force.
    fn corrected(&mut self, values: &[f64], state: &mut ContactState) -> f64 {
        let displaced = |dof: &usize| self.prescribed[*dof] == Prescribed::Displacement;
        let ContactState {
            force_n: force,
            displacement_mm: displacement,
        } = state;
        for vector in [&mut *force, &mut *displacement] {
            vector.clear();
            vector.resize(values.len(), 0.0);
        }
        multiply(self.tableau.as_ref(), values, displacement);
        for dof in 0..values.len() {
            force[dof] = if displaced(&dof) {
                -displacement[dof]
            } else {
                values[dof]
            };
        }
        self.system.multiply(force, displacement);
        self.residual.fill(0.0);
        for dof in (0..values.len()).filter(displaced) {
            self.residual[dof] = values[dof] - displacement[dof];
        }
        multiply(self.tableau.as_ref(), &self.residual, &mut self.correction);
        let [mut largest, mut change] = [0.0_f64; 2];
        for dof in 0..values.len() {
            if displaced(&dof) {
                largest = larger(largest, force[dof].abs());
                change = larger(change, self.correction[dof].abs());
                force[dof] -= self.correction[dof];
            }
        }
        self.system.multiply(force, displacement);
        for dof in (0..values.len()).filter(displaced) {
            displacement[dof] = values[dof];
        }
        if change == 0.0 { 0.0 } else { change / largest }
    }
}

/// Unlike `f64::max`, propagates NaN.
fn larger(a: f64, b: f64) -> f64 {
    if b > a || b.is_nan() { b } else { a }
}

/// Returns the prescribed displacements, as changes from all forces.
fn changes(prescribed: &[Prescribed]) -> Vec<(usize, Prescribed)> {
    let all = prescribed.iter().copied().enumerate();
    all.filter(|change| change.1 == Prescribed::Displacement).collect()
}

impl ConstraintSolver for Pivots {
    fn prescribed(&self) -> &[Prescribed] {
        &self.prescribed
    }

    fn switch(&mut self, changes: &[(usize, Prescribed)]) -> Result<(), SwitchError> {
        self.system.check_changes(changes)?;
        let before = (self.prescribed.clone(), self.drift);
        // A refused single exchange changes nothing.
        let several = changes.len() > 1;
        if several {
            self.spare.clone_from(&self.tableau);
        }
        if let Err(refusal) = self.exchange_all(changes) {
            (self.prescribed, self.drift) = before;
            if several {
                std::mem::swap(&mut self.tableau, &mut self.spare);
            }
            return Err(refusal);
        }
        if self.drift > DRIFT_LIMIT {
            self.refresh();
        }
        Ok(())
    }

    fn solve_into(&mut self, values: &[f64], state: &mut ContactState) -> Result<(), SwitchError> {
        self.system.check_values(values)?;
        let correction = self.corrected(values, state);
        if correction.is_nan() || correction > CORRECTION_LIMIT {
            self.refresh();
            self.corrected(values, state);
        }
        self.system.check_state(state)
    }
}
