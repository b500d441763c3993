//! Strain-stiffening tissue in plane-strain triangles and in tetrahedra: K(U) U = F.
//!
//! The law is that of Y. Kobayashi et al., "Development of an integrated needle insertion system with image guidance
//! and deformation simulation", Computerized Medical Imaging and Graphics 34, 2010, sections 3.1.4 and 3.2: see
//! [`Stiffening`]. One implementation serves both dimensions ([`NonlinearBody`], with [`Sheet`] and [`Solid`] for
//! names). Strains are small, but for laws of finite strain ([`crate::tissue::law`]).
//!
//! Three schemes solve it, increment by increment ([`Scheme`]):
//!
//! - Euler steps of Kobayashi et al., K_t(U) dU = dF. With their scalar tangent they are exact only where strain grows
//!   in proportion; with the consistent tangent, or with the balance of forces corrected at each increment, they
//!   converge to the body's state as increments shrink.
//! - Modified Newton-Raphson of Kobayashi et al.: iterations with a reused factor of the scalar tangent, also across
//!   increments, until they converge too slowly.
//! - Newton-Raphson with the consistent tangent, the derivative of E(e_r) included, which converges quadratically: the
//!   reference for the others.
//!
//! The secant law does not follow from an energy: where tissue is compressed as well as sheared its tangent is not
//! symmetric, and Newton's equations are solved by GMRES, preconditioned with the factor of the tangent's symmetric
//! part. [`creep`] adds fractional viscosity.

mod anderson;
mod body;
pub mod creep;
mod gmres;
mod invariants;
mod predictor;
mod refactorisation;
mod simplex;
mod solver;
mod tangent;

pub use crate::tissue::dofs::NO_DOF;
pub use crate::tissue::law::Stiffening;
pub use body::{NonlinearBody, Sheet, Solid};
pub use invariants::{relative_strain, von_mises};
pub use solver::{Contact, Progress, Scheme, Slope, Solver, SolverOptions, Target};

use crate::tissue::element::DegenerateElement;
use crate::tissue::error::LinearError;
use crate::tissue::viscoelastic::HistoryError;
use creep::Creep;
use insonify_base::blame::Blame;

/// Why a nonlinear body cannot be made, or an increment of it not be solved. The solver is then unchanged.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NonlinearError {
    /// A body without elements.
    #[error("the body has no elements")]
    Empty,
    /// The number of materials is not that of the elements.
    #[error("{found} materials for {expected} elements")]
    Materials {
        /// Number of materials.
        found: usize,
        /// Number of elements.
        expected: usize,
    },
    /// An element names a node that does not exist.
    #[error("element {element} names node {node}, but there are only {nodes} nodes (numbered from 0)")]
    Node {
        /// Index of the element, from 0.
        element: usize,
        /// Node named.
        node: u32,
        /// Number of nodes of the body.
        nodes: usize,
    },
    /// An element has no usable area or volume.
    #[error("element {element}: {cause}")]
    Element {
        /// Index of the element, from 0.
        element: usize,
        /// Why its area or volume is unusable.
        cause: DegenerateElement,
    },
    /// The thickness of a plane body is not a finite number above 0.
    #[error("the thickness is {found} mm; expected a finite number above 0")]
    Thickness {
        /// Thickness found, mm.
        found: f64,
    },
    /// The largest unbalanced force, relative to the largest force, is above the tolerance.
    #[error(
        "forces do not balance after {iterations} iterations: the residual is {residual:.1e} of the largest force, expected at \
         most {tolerance:.0e}; take smaller increments, or more iterations"
    )]
    NotConverged {
        /// Number of iterations made.
        iterations: usize,
        /// Largest unbalanced force, relative to the largest force.
        residual: f64,
        /// Largest relative unbalanced force accepted.
        tolerance: f64,
    },
    /// Displacements or forces are not finite.
    #[error("displacements or forces are no finite numbers after {iterations} iterations; take smaller increments")]
    Overflow {
        /// Number of iterations made.
        iterations: usize,
    },
    /// An element is inverted or flat, where a law of finite strain has no stress.
    #[error(
        "element {element} is inverted or flat before forces balance, where its law of finite strain has no stress; take smaller \
         increments, or displacements that leave every element a volume"
    )]
    Inverted {
        /// Index of the element, from 0.
        element: usize,
    },
    /// Forces balance, but not stably.
    #[error(
        "forces balance after {iterations} iterations, but the tissue is not stable there: it folds or buckles; take smaller \
         increments or loads"
    )]
    Unstable {
        /// Number of iterations made.
        iterations: usize,
    },
    /// A list has the wrong length.
    #[error("{found} {what}; expected {expected}")]
    Length {
        /// What the list holds, or as what a number is given.
        what: &'static str,
        /// Length found, or the number of a degree of freedom that does not exist.
        found: usize,
        /// Length expected, or the number of degrees of freedom.
        expected: usize,
    },
    /// Value `at` of a list (`what`) is NaN or infinite.
    #[error("{what} {at} is {found}; expected a finite number")]
    NotFinite {
        /// What the list holds.
        what: &'static str,
        /// Index in the list, from 0.
        at: usize,
        /// Value found.
        found: f64,
    },
    /// The contact does not act on any free displacement.
    #[error("the contact touches nothing that can move")]
    DeadContact,
    /// The tangent has more entries than 32-bit indices can address.
    #[error("the tangent has too many entries for 32-bit indices")]
    TooLarge,
    /// The tangent cannot be factored.
    #[error(transparent)]
    Factor(#[from] LinearError),
    /// The history rejects the order, the rule or a step.
    #[error(transparent)]
    History(#[from] HistoryError),
    /// The body is already strained.
    #[error("the body is displaced; a history starts at rest")]
    Displaced,
    /// A law that is not a secant modulus times linear elasticity.
    #[error(
        "a law without a secant modulus, with memory or a scheme by Euler's method; expected linear tissue or one that stiffens above a knee \
         strain, or Newton's method"
    )]
    NoSecant,
}

impl Blame for NonlinearError {
    fn is_machine(&self) -> bool {
        matches!(self, NonlinearError::Factor(error) if error.is_machine())
    }
}

/// Numbering of `D` degrees of freedom per node, node by node, and of the free ones among them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Supports<const D: usize> {
    /// Number of each degree of freedom among the free ones; [`NO_DOF`] where prescribed.
    numbers: Vec<u32>,
    free: Vec<u32>,
    prescribed: Vec<u32>,
}

impl<const D: usize> Supports<D> {
    /// Numbers the degrees of freedom of `nodes` nodes, those in `prescribed` (node, axis) prescribed. Duplicates have
    /// no effect.
    ///
    /// # Panics
    /// If a node or an axis is out of range, or 32 bits cannot number all degrees of freedom.
    pub fn new(nodes: usize, prescribed: impl IntoIterator<Item = (u32, u8)>) -> Self {
        assert!(
            nodes < (u32::MAX / 4) as usize,
            "{nodes} nodes outnumber 32-bit degrees of freedom"
        );
        let mut numbers = vec![0; D * nodes];
        for (node, axis) in prescribed {
            assert!((axis as usize) < D, "axis {axis} in {D} dimensions");
            numbers[D * node as usize + axis as usize] = NO_DOF;
        }
        let (mut free, mut prescribed) = (Vec::with_capacity(numbers.len()), Vec::new());
        for (dof, number) in (0..).zip(&mut numbers) {
            if *number == NO_DOF {
                prescribed.push(dof);
            } else {
                *number = free.len() as u32;
                free.push(dof);
            }
        }
        Supports {
            numbers,
            free,
            prescribed,
        }
    }

    /// Number of nodes.
    pub fn nodes(&self) -> usize {
        self.numbers.len() / D
    }

    /// Number of all degrees of freedom, free or not.
    pub fn all(&self) -> usize {
        self.numbers.len()
    }

    /// Free degrees of freedom, ascending.
    pub fn free(&self) -> &[u32] {
        &self.free
    }

    /// Prescribed degrees of freedom, ascending.
    pub fn prescribed(&self) -> &[u32] {
        &self.prescribed
    }

    /// Number of a degree of freedom among the free ones, [`NO_DOF`] where it is prescribed.
    ///
    /// # Panics
    /// If `dof` is out of range.
    pub fn number(&self, dof: usize) -> u32 {
        self.numbers[dof]
    }

    /// Copies the free entries of a vector over all degrees of freedom.
    fn gather(&self, values: &[f64], free: &mut [f64]) {
        for (value, dof) in free.iter_mut().zip(&self.free) {
            *value = values[*dof as usize];
        }
    }
}

/// Body advanced in time; an elastic one ignores the time step.
#[derive(Clone, Debug)]
pub enum Structure<const D: usize, const N: usize> {
    /// Body without memory.
    Elastic(Box<Solver<D, N>>),
    /// Body with fractional viscosity.
    Viscous(Box<Creep<D, N>>),
}

impl<const D: usize, const N: usize> Structure<D, N> {
    /// Advances by `step_s` seconds to the loads, prescribed displacements (as in [`Target`]) and contact at the end of
    /// the step.
    ///
    /// # Errors
    /// [`NonlinearError`]; the body is then unchanged.
    pub fn step(
        &mut self,
        step_s: f64,
        loads: &[f64],
        prescribed: &[f64],
        contact: Option<&Contact>,
    ) -> Result<&Progress, NonlinearError> {
        match self {
            Structure::Elastic(solver) => Ok(solver.step(&Target {
                loads,
                prescribed,
                contact,
                offset: None,
            })?),
            Structure::Viscous(creep) => creep.step(step_s, loads, prescribed, contact),
        }
    }

    /// Exports the state as numbers, with the history of a viscous body. Cached data are recomputed, so that this body
    /// continues as one that [imports](Self::import_state) the state.
    ///
    /// # Errors
    /// [`NonlinearError`] where the stiffness cannot be factored.
    pub(crate) fn export_state(&mut self) -> Result<[Vec<f64>; 2], NonlinearError> {
        match self {
            Structure::Elastic(solver) => Ok([solver.export_state(false)?, Vec::new()]),
            Structure::Viscous(creep) => creep.export_state(),
        }
    }

    /// Imports the state of another body of this kind: the same steps then give the same bits.
    ///
    /// # Errors
    /// [`NonlinearError`] for numbers that do not fit such a body.
    pub(crate) fn import_state(&mut self, state: [&[f64]; 2]) -> Result<(), NonlinearError> {
        match self {
            Structure::Elastic(solver) => Ok(solver.import_state(state[0], false)?),
            Structure::Viscous(creep) => creep.import_state(state),
        }
    }

    /// Solver, with the body and its supports.
    pub fn solver(&self) -> &Solver<D, N> {
        match self {
            Structure::Elastic(solver) => solver,
            Structure::Viscous(creep) => creep.solver(),
        }
    }

    /// Displacements, mm.
    pub fn displacement(&self) -> &[f64] {
        self.solver().displacement()
    }

    /// Forces on all degrees of freedom, N: loads at free ones, loads plus reactions at prescribed ones.
    pub fn forces(&self) -> &[f64] {
        match self {
            Structure::Elastic(solver) => solver.forces(),
            Structure::Viscous(creep) => creep.forces(),
        }
    }

    /// Contact force along its direction, N.
    pub fn contact_force(&self) -> f64 {
        match self {
            Structure::Elastic(solver) => solver.contact_force(),
            Structure::Viscous(creep) => creep.contact_force(),
        }
    }
}
