//! Solver options, and the convergence record of an increment.

/// Tangent of an Euler step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Slope {
    /// Kobayashi et al.'s tangent: element stiffness times 1 + a (e_r - e0)^2 + 2 a (e_r - e0) e_r.
    #[default]
    Scalar,
    /// The derivative of the law.
    Consistent,
}

/// Solution scheme of an increment.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Scheme {
    /// One solve with the tangent at the start; the remaining imbalance is reported, not iterated on.
    Euler {
        /// Tangent of the step.
        slope: Slope,
        /// Whether to add the imbalance of earlier increments to this one, which Kobayashi et al. do not. With an
        /// offset of displacements it is always added.
        corrected: bool,
    },
    /// Iterations with a factor of the scalar tangent that is kept while it converges.
    Modified {
        /// Number of iterations used in Anderson's acceleration; 0 for the plain method of Kobayashi et al.
        memory: usize,
    },
    /// Iterations with the consistent tangent, factored in each.
    #[default]
    Newton,
}

impl Scheme {
    /// Modified Newton-Raphson with the most effective memory.
    pub const MODIFIED: Scheme = Scheme::Modified { memory: 6 };
}

/// Options of a solver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Solution scheme.
    pub scheme: Scheme,
    /// Largest unbalanced force relative to the largest nodal force so far. Default 1e-9.
    pub tolerance: f64,
    /// Largest number of iterations in an increment. Default 60; full Newton needs no more than ten where modified
    /// needs all.
    pub iterations: usize,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            scheme: Scheme::default(),
            tolerance: 1e-9,
            iterations: 60,
        }
    }
}

/// Convergence record of an increment.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Progress {
    /// Number of iterations (changes of the displacements).
    pub iterations: usize,
    /// Number of factorisations.
    pub factorisations: usize,
    /// Largest unbalanced force relative to the largest nodal force, before each iteration and at the end.
    pub residuals: Vec<f64>,
}

impl Progress {
    /// Residual at the end.
    pub fn residual(&self) -> f64 {
        self.residuals.last().copied().unwrap_or(0.0)
    }
}
