//! What a remesher tolerates, and when it computes anew.

/// Limits and habits of a [`Remesher`](super::Remesher). The defaults suit tissue meshes of some thousand nodes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// A change is refused where the reciprocal condition of its capacitance matrix I + dK G is below this. An update then
    /// loses more than ten of sixteen digits; moves within the mesh's own limit stay far above.
    pub reciprocal_limit: f64,
    /// Errors are sampled at least every so many changes (0: never): at every change at first and after a sample that was off,
    /// and then ever less often up to this.
    pub check_every: u64,
    /// Exact level: it is computed anew where the sampled backward error of C, or the relative error of K^c against C, is
    /// larger.
    pub exact_tolerance: f64,
    /// Level I in f64: the residual that is kept to. The inverse is rebuilt where a sample passes a tenth of it. See
    /// [`Remesher::residual`](super::Remesher::residual).
    pub residual_double: f64,
    /// The same in f32.
    pub residual_single: f64,
    /// Exact level: always compute anew, never update. For comparison: it costs O(|S|^3).
    pub rebuild_always: bool,
    /// Exact level: what a change does not need at once, the last product that completes C and samples of errors that fall due, is
    /// left to [`Remesher::tend`](super::Remesher::tend), so that no step has to do it all. Whatever is still left when the next
    /// change comes is done then.
    pub tended: bool,
    /// The largest Poisson's ratio at which levels I to III may work in f32.
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
            rebuild_always: false,
            tended: false,
            single_poisson_limit: 0.49,
        }
    }
}
