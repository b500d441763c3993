//! Euler-Bernoulli beam on a hyperelastic foundation: a needle in tissue whose base is moved sideways (Wang et al. 2023,
//! sections II-A and III).
//!
//! The needle lies along x: its base at `-control_distance_mm`, the point of entry at 0, its tip at the inserted depth. Its
//! deflection u (mm, across the needle) obeys
//!
//! ```text
//! E I u'''' = -F,    F = k(lambda) u {1 - gamma sin^2(atan u')},    k = dS/d lambda,    lambda = (t0 - |u|)/t0
//! ```
//!
//! with displacement and slope prescribed at the base, or displacement alone (the base then turns freely, without moment),
//! and neither moment nor force at the tip. F is zero outside the tissue, k the tangent modulus of the layer's material in
//! compression, t0 the initial length of the tissue, gamma the friction of the layer. The equation of Wang et al. has F
//! without a sign; here F points along u, so that it pushes the needle back.
//!
//! | file | contents |
//! |---|---|
//! | [`material`] | hyperelastic materials in compression: stress, tangent modulus and its rate |
//! | [`problem`] | needle, layers and elements, validated |
//! | `foundation` | reaction and its derivatives over an element |
//! | `sweep` | the linear equations of one Newton step, from tip to base and back |
//! | `newton` | Newton's method with a line search and load steps |
//! | [`shape`] | solution: deflection, reaction, centres of motion |
//! | [`inverse`] | base motion for a given tip or a given centre of motion |
//! | [`fit`] | materials from measured stretch and stress |

mod error;
pub mod fit;
mod foundation;
pub mod inverse;
pub mod material;
mod newton;
pub mod problem;
pub mod shape;
mod sweep;

pub use error::BeamError;
pub use material::{Compression, Material};
pub use newton::FoundationBeam;
pub use problem::{Base, Layer, Problem, bending_stiffness_nmm2};
pub use shape::Shape;
