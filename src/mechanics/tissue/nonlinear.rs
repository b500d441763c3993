//! Strain-stiffening tissue in plane-strain triangles and in tetrahedra: K(U) U = F.
//!
//! The law is that of Y. Kobayashi et al., "Development of an integrated needle insertion system with image guidance and
//! deformation simulation", Computerized Medical Imaging and Graphics 34, 2010, sections 3.1.4 and 3.2: see [`Stiffening`].
//! One implementation serves both dimensions ([`Body`], with [`Sheet`] and [`Solid`] for names). Strains are small.
//!
//! Three schemes solve it, increment by increment ([`Scheme`]):
//!
//! - Euler steps of Kobayashi et al., K_t(U) dU = dF. With their scalar tangent they are exact only where strain grows
//!   in proportion; with the consistent tangent, or with the balance of forces corrected at each increment, they
//!   converge to the body's state as increments shrink.
//! - Modified Newton-Raphson of Kobayashi et al.: iterations with a kept factor of the scalar tangent, also across
//!   increments, until they converge too slowly.
//! - Newton-Raphson with the consistent tangent, the derivative of E(e_r) included, which converges quadratically: the
//!   reference for the others.
//!
//! The secant law does not follow from an energy: where tissue is compressed as well as sheared its tangent is not symmetric,
//! and Newton's equations are solved by GMRES, preconditioned with the factor of the tangent's symmetric part.
//! [`creep`] adds fractional viscosity.

mod anderson;
mod body;
pub mod creep;
mod error;
mod gmres;
mod law;
mod predictor;
mod refactorisation;
mod simplex;
mod solver;
mod structure;
mod supports;
mod tangent;

pub use body::{Body, Sheet, Solid};
pub use error::NonlinearError;
#[cfg(feature = "internals")]
pub use law::relative_strain;
pub use law::{Stiffening, von_mises};
#[cfg(feature = "internals")]
pub use solver::Target;
pub use solver::{Contact, Options, Progress, Scheme, Slope, Solver};
pub use structure::Structure;
pub use supports::Supports;
