//! How increments are solved, and what one took.

/// Which tangent an Euler step takes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Slope {
    /// Kobayashi et al.'s: element stiffness times 1 + a (e_r - e0)^2 + 2 a (e_r - e0) e_r.
    #[default]
    Scalar,
    /// The derivative of the law.
    Consistent,
}

/// How an increment is solved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Scheme {
    /// One solve with the tangent at its start; what is out of balance is told, not iterated upon.
    Euler {
        /// The tangent.
        slope: Slope,
        /// Whether what the last increments left out of balance is added to this one; Kobayashi et al.'s is not. With an offset of
        /// displacements it always is.
        corrected: bool,
    },
    /// Iterations with a factor of the scalar tangent that is kept as long as it serves.
    Modified {
        /// Iterations that the next is improved by (Anderson's acceleration): 0 for the plain method, which is Kobayashi et al.'s.
        memory: usize,
    },
    /// Iterations with the consistent tangent, factored at each.
    #[default]
    Newton,
}

impl Scheme {
    /// Modified Newton-Raphson with the memory that it gains most by.
    pub const MODIFIED: Scheme = Scheme::Modified { memory: 6 };
}

/// When an increment is solved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// How.
    pub scheme: Scheme,
    /// The largest force out of balance over the largest force at a node so far. Default 1e-9.
    pub tolerance: f64,
    /// Iterations of an increment at most. Default 60; full Newton needs no more than ten where modified needs all.
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

/// What an increment took.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Progress {
    /// Iterations: changes of the displacements.
    pub iterations: usize,
    /// Factorisations among them.
    pub factorisations: usize,
    /// Largest force out of balance over the largest force at a node, before each iteration and at the end.
    pub residuals: Vec<f64>,
}

impl Progress {
    /// The residual at the end.
    pub fn residual(&self) -> f64 {
        self.residuals.last().copied().unwrap_or(0.0)
    }
}
