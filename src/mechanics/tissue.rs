//! Linear elastic tissue in tetrahedra: K u = f, with displacements in mm and forces in N.
//!
//! | module | contents |
//! |---|---|
//! | [`material`] | Young's modulus and Poisson's ratio by region |
//! | [`element`] | stiffness of one tetrahedron |
//! | [`dofs`] | free and prescribed degrees of freedom |
//! | [`assembly`] | sparse stiffness matrix |
//! | [`error`] | errors of linear tissue |
//! | [`factor`] | Cholesky factor of the stiffness, and solutions with their residual |
//! | [`rigid`] | rigid motions left free by the fixed nodes |
//! | [`symmetric`] | dense symmetric matrix in row panels, and its updates |
//! | [`compliance`] | access to entries and columns of K^-1 |
//! | [`inverse`] | dense inverse of the stiffness |
//! | [`columns`] | columns of the inverse, solved on demand |
//! | [`law`] | constitutive laws |
//! | [`nonlinear`] | strain-stiffening tissue in triangles and tetrahedra |
//! | [`problem`] | static problems: validation and solution |
//! | [`remesh`] | moves of reference nodes, and updates of the compliance |
//! | [`viscoelastic`] | fractional integrals and derivatives of a history |

pub mod assembly;
pub mod columns;
pub mod compliance;
pub mod dofs;
pub mod element;
pub mod error;
pub mod factor;
pub mod inverse;
pub mod knee;
pub mod law;
pub mod material;
pub mod nonlinear;
pub mod problem;
pub mod remesh;
pub mod rigid;
pub mod symmetric;
pub mod viscoelastic;

#[cfg(test)]
mod testing;
