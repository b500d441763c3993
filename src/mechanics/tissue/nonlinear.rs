//! Tissue that stiffens with strain, in triangles of plane strain and in tetrahedra: K(U) U = F.
//!
//! The law is that of Y. Kobayashi et al., "Development of an integrated needle insertion system with image guidance and
//! deformation simulation", Computerized Medical Imaging and Graphics 34, 2010, sections 3.1.4 and 3.2: see [`Stiffening`].
//! One implementation serves both dimensions ([`Body`], with [`Sheet`] and [`Solid`] for names). Strains are small.
//!
//! Three schemes solve it, increment by increment ([`Scheme`]):
//!
//! - Euler steps, Kobayashi et al.'s, K_t(U) dU = dF. With Kobayashi et al.'s scalar tangent they follow the body exactly only where strain
//!   grows in proportion; with the consistent tangent, or with the balance of forces put right at each increment, they come to
//!   the body's state with the length of the increments.
//! - Modified Newton-Raphson, Kobayashi et al.'s: iterations with a factor of the scalar tangent that is kept, over increments too,
//!   until they come closer too slowly.
//! - Newton-Raphson with the consistent tangent, the derivative of E(e_r) included, which converges quadratically: what the
//!   others are measured against.
//!
//! The secant law does not follow from an energy: where tissue is compressed as well as sheared its tangent is not symmetric,
//! and Newton's equations are solved by GMRES, preconditioned with the factor of the tangent's symmetric part.
//! [`creep`] adds fractional viscosity.

mod anderson;
mod body;
pub mod creep;
mod error;
mod foresight;
mod gmres;
mod law;
mod simplex;
mod solver;
mod structure;
mod supports;
mod tangent;
mod upkeep;

pub use super::knee::{InvalidStiffening, Knee};
pub use body::{Body, InvalidBody, Sheet, Solid};
pub use error::NonlinearError;
pub use law::{RELATIVE_IN_SHEAR, Stiffening, relative_strain};
pub use solver::{Contact, Options, Progress, Scheme, Slope, Solver, Target};
pub use structure::Structure;
pub use supports::Supports;
