//! Tolerances and rebuild policy of a remesher.

/// Tolerances and policies of a [`Remesher`](super::Remesher). The defaults suit tissue meshes of some thousand nodes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Smallest reciprocal condition of the capacitance matrix I + dK G; changes below it are refused. There an update
    /// loses more than ten of sixteen digits; moves within the mesh's own limit stay far above.
    pub reciprocal_limit: f64,
    /// Largest number of changes between samples of the errors (0: no samples). Every change is sampled at first and
    /// after a bad sample, then ever fewer.
    pub check_every: u64,
    /// Exact level: sampled backward error of C, or relative error of K^c against C, above which both are recomputed.
    pub exact_tolerance: f64,
    /// Level I in f64: largest residual. The inverse is rebuilt where a sample exceeds a tenth of it. See
    /// [`Remesher::residual`](super::Remesher::residual).
    pub residual_double: f64,
    /// Level I in f32: largest residual. The inverse is rebuilt where a sample exceeds a tenth of it.
    pub residual_single: f64,
    /// Exact level: whether to defer work not needed at once, the last product that completes C and due samples of
    /// errors, to [`Remesher::run_deferred`](super::Remesher::run_deferred), so that no step has to do it all. Work still pending at
    /// the next change is done then.
    pub deferred: bool,
    /// Largest Poisson's ratio at which levels I to III may use f32.
    pub single_poisson_limit: f64,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            reciprocal_limit: 1e-10,
            check_every: 16,
            exact_tolerance: 1e-12,
            residual_double: 1e-9,
            residual_single: 1e-2,
            deferred: false,
            single_poisson_limit: 0.49,
        }
    }
}
