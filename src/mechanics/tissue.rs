//! Tissue as linear elastic tetrahedra: K u = f, with displacements in mm and forces in N.
//!
//! | module | what it holds |
//! |---|---|
//! | [`material`] | Young's modulus and Poisson's ratio, by region |
//! | [`element`] | the stiffness of one tetrahedron |
//! | [`dofs`] | which degrees of freedom are free and which prescribed |
//! | [`assembly`] | the sparse stiffness matrix |
//! | [`factor`] | its Cholesky factor, and solutions with their residual |
//! | [`rigid`] | the rigid motions that the fixed nodes leave |
//! | [`symmetric`] | a dense symmetric matrix in row panels, and its updates |
//! | [`compliance`] | entries and columns of K^-1, wherever they come from |
//! | [`inverse`] | the dense inverse of the stiffness |
//! | [`cache`] | the inverse on disk |
//! | [`columns`] | columns of the inverse, solved on demand |
//! | [`frames`] | the axes of a contact node |
//! | [`condensed`] | the compliance of the contact nodes |
//! | [`switching`] | forces or displacements prescribed at contacts |
//! | [`nonlinear`] | tissue that stiffens with strain, in triangles and tetrahedra |
//! | [`problem`] | a static problem, checked and solved |
//! | [`remesh`] | moves of reference nodes, and the compliance that follows them |
//! | [`viscoelastic`] | fractional integrals and derivatives of a history |

pub mod assembly;
pub mod cache;
pub mod columns;
pub mod compliance;
pub mod condensed;
pub mod dofs;
pub mod element;
pub mod factor;
pub mod frames;
pub mod inverse;
pub mod knee;
pub mod material;
pub mod nonlinear;
pub mod problem;
pub mod remesh;
pub mod rigid;
pub mod switching;
pub mod symmetric;
pub mod viscoelastic;

#[cfg(test)]
mod testing;
