//! Body of nonlinear triangles or tetrahedra: its forces and their derivatives.

use nalgebra::{DMatrix, Vector3};

use super::invariants::{relative_strain, von_mises};
use super::simplex::{Simplex, orientation};
use super::tangent::Kind;
use crate::tissue::law::{AnyLaw, Stiffening, Tensor};
use crate::tissue::nonlinear::NonlinearError;
use insonify_mesh::TetMesh;
use insonify_mesh::vector::dot;

/// Newtons per square millimetre in one kilopascal.
const NEWTON_PER_MM2: f64 = 1e-3;

/// Mesh of simplices in its reference state, with one material per element. Vectors over it have `D` entries per node.
#[derive(Clone, Debug)]
pub struct NonlinearBody<const D: usize, const N: usize> {
    nodes: Vec<[f64; D]>,
    elements: Vec<[u32; N]>,
    cells: Vec<Cell<D, N>>,
    has_secants: bool,
}

/// Body of triangles in plane strain.
pub type Sheet = NonlinearBody<2, 3>;

/// Body of tetrahedra.
pub type Solid = NonlinearBody<3, 4>;

#[derive(Clone, Copy, Debug)]
pub(super) struct Cell<const D: usize, const N: usize> {
    pub shape: Simplex<D, N>,
    /// Lame parameters at small strain times the volume, N mm.
    pub lambda: f64,
    pub mu: f64,
    law: CellLaw,
}

/// Law of an element. Secant laws have forms of their own, as they need no moduli.
#[derive(Clone, Copy, Debug)]
enum CellLaw {
    Secant(Stiffening),
    Finite {
        law: AnyLaw,
        /// Volume, N mm for each kPa.
        weight: f64,
        /// Index of its gradient and moduli in [`Responses`].
        index: u32,
    },
}

/// Derivative of the first Piola-Kirchhoff stress with respect to the displacement gradient, times the volume, N mm.
pub(super) type Moduli<const D: usize> = [[[[f64; D]; D]; D]; D];

/// Responses of all elements.
#[derive(Clone, Debug)]
pub(super) struct Responses<const D: usize> {
    pub cells: Vec<Response<D>>,
    /// Displacement gradients of the elements whose law has no secant.
    gradients: Vec<[[f64; D]; D]>,
    /// Their moduli, where [`NonlinearBody::linearise`] has computed them.
    moduli: Vec<Moduli<D>>,
}

impl<const D: usize> Responses<D> {
    /// Moduli of an element whose law has no secant.
    ///
    /// # Panics
    /// For such an element before [`NonlinearBody::linearise`].
    pub(super) fn moduli_of<const N: usize>(&self, cell: &Cell<D, N>) -> Option<&Moduli<D>> {
        match cell.law {
            CellLaw::Secant(_) => None,
            CellLaw::Finite { index, .. } => Some(&self.moduli[index as usize]),
        }
    }

    /// Copies what [`NonlinearBody::respond`] computes.
    pub(super) fn take(&mut self, source: &Self) {
        self.cells.copy_from_slice(&source.cells);
        self.gradients.copy_from_slice(&source.gradients);
    }
}

/// Response of an element at a state, from which its tangent is formed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Response<const D: usize> {
    /// Secant modulus over E0.
    pub secant: f64,
    /// Tangent modulus of Kobayashi et al. over E0.
    pub scalar: f64,
    /// Stress of the unstiffened element times volume times the slope of the secant, N mm.
    pub rise: [[f64; D]; D],
    /// Derivative of the relative strain with respect to the strain.
    pub normal: [[f64; D]; D],
}

impl Sheet {
    /// Creates a sheet of `thickness_mm` without strain across it, from `triangles` with their corners anticlockwise
    /// and one of `laws` each. Forces on its nodes are those on the full thickness.
    ///
    /// # Errors
    /// [`NonlinearError`] for unusable elements or thickness, or a wrong number of `laws`.
    pub fn plane_strain(
        nodes: Vec<[f64; 2]>,
        triangles: Vec<[u32; 3]>,
        laws: &[impl Copy + Into<AnyLaw>],
        thickness_mm: f64,
    ) -> Result<Sheet, NonlinearError> {
        if !(thickness_mm.is_finite() && thickness_mm > 0.0) {
            return Err(NonlinearError::Thickness { found: thickness_mm });
        }
        NonlinearBody::of(nodes, triangles, laws, thickness_mm)
    }
}

impl Sheet {
    /// Returns the von Mises stress of each triangle, kPa, from displacements (mm) and the stress in the plane. The
    /// stress across the plane of a secant law is Poisson's ratio times the sum of the two normal stresses, at any
    /// secant modulus and rate.
    ///
    /// # Panics
    /// If there is not one entry per degree of freedom.
    pub fn von_mises_kpa(&self, displacement: &[f64], stress_kpa: &[[[f64; 2]; 2]]) -> Vec<f64> {
        let elements = self.elements.iter().zip(&self.cells).zip(stress_kpa);
        let whole = |((corners, cell), [[xx, xy], [yx, yy]]): ((&[u32; 3], &Cell<2, 3>), &[[f64; 2]; 2])| {
            let zz = match cell.law {
                CellLaw::Secant(law) => law.material().poisson() * (xx + yy),
                CellLaw::Finite { law, .. } => {
                    let corners = corners.map(|node| vector(displacement, node));
                    cauchy_kpa(&law, &embedded(&cell.shape.gradient(&corners)))[(2, 2)]
                }
            };
            von_mises(&[[*xx, *xy, 0.0], [*yx, *yy, 0.0], [0.0, 0.0, zz]])
        };
        elements.map(whole).collect()
    }
}

impl Solid {
    /// Creates the body of a mesh, with one of `laws` per element.
    ///
    /// # Errors
    /// [`NonlinearError`] for unusable elements, or a wrong number of `laws`.
    pub fn tetrahedra(mesh: &TetMesh, laws: &[impl Copy + Into<AnyLaw>]) -> Result<Solid, NonlinearError> {
        NonlinearBody::of(mesh.nodes().to_vec(), mesh.elements().to_vec(), laws, 1.0)
    }
}

impl<const D: usize, const N: usize> NonlinearBody<D, N> {
    /// Creates a body from nodes (mm), elements and one of `laws` per element, times a thickness: mm in plane strain, 1
    /// in three dimensions.
    ///
    /// # Errors
    /// [`NonlinearError`] for unusable elements, or a wrong number of `laws`.
    pub fn of(
        nodes: Vec<[f64; D]>,
        elements: Vec<[u32; N]>,
        laws: &[impl Copy + Into<AnyLaw>],
        thickness: f64,
    ) -> Result<Self, NonlinearError> {
        let laws: Vec<AnyLaw> = laws.iter().map(|law| (*law).into()).collect();
        Self::new(nodes, elements, &laws, thickness)
    }

    fn new(
        nodes: Vec<[f64; D]>,
        elements: Vec<[u32; N]>,
        laws: &[AnyLaw],
        thickness: f64,
    ) -> Result<Self, NonlinearError> {
        if elements.is_empty() {
            return Err(NonlinearError::Empty);
        }
        if laws.len() != elements.len() {
            return Err(NonlinearError::Materials {
                found: laws.len(),
                expected: elements.len(),
            });
        }
        let mut finite = 0;
        let cell = |(element, (corners, law)): (usize, (&[u32; N], &AnyLaw))| {
            let count = nodes.len();
            if let Some(&node) = corners.iter().find(|node| **node as usize >= count) {
                return Err(NonlinearError::Node {
                    element,
                    node,
                    nodes: count,
                });
            }
            let shape = Simplex::of(&corners.map(|node| nodes[node as usize]));
            let shape = shape.map_err(|cause| NonlinearError::Element { element, cause })?;
            let weight = NEWTON_PER_MM2 * shape.measure * thickness;
            let [lambda, mu] = law.at_rest().lame_kpa().map(|kpa| kpa * weight);
            // Secant laws need no moduli, which are large: only other elements have a place for them.
            let law = match law.as_secant() {
                Some(secant) => CellLaw::Secant(secant),
                None => {
                    finite += 1;
                    CellLaw::Finite {
                        law: *law,
                        weight,
                        index: finite - 1,
                    }
                }
            };
            Ok(Cell { shape, lambda, mu, law })
        };
        let cells = elements
            .iter()
            .zip(laws)
            .enumerate()
            .map(cell)
            .collect::<Result<_, NonlinearError>>()?;
        Ok(NonlinearBody {
            nodes,
            elements,
            cells,
            has_secants: finite == 0,
        })
    }

    /// Node positions in the reference state, mm.
    pub fn nodes(&self) -> &[[f64; D]] {
        &self.nodes
    }

    /// Node indices of the elements.
    pub fn elements(&self) -> &[[u32; N]] {
        &self.elements
    }

    pub(super) fn cells(&self) -> &[Cell<D, N>] {
        &self.cells
    }

    /// Whether every law is a secant modulus times linear elasticity.
    pub(super) fn has_secants(&self) -> bool {
        self.has_secants
    }

    /// Responses of the body at rest.
    pub(super) fn at_rest(&self) -> Responses<D> {
        let finite = self
            .cells
            .iter()
            .filter(|cell| matches!(cell.law, CellLaw::Finite { .. }));
        Responses {
            cells: vec![Response::REST; self.cells.len()],
            gradients: vec![[[0.0; D]; D]; finite.count()],
            moduli: Vec::new(),
        }
    }

    /// Computes the moduli of the elements whose law has no secant.
    pub(super) fn linearise(&self, responses: &mut Responses<D>) {
        let Responses { gradients, moduli, .. } = responses;
        moduli.clear();
        moduli.extend(self.cells.iter().filter_map(|cell| match cell.law {
            CellLaw::Secant(_) => None,
            CellLaw::Finite { law, weight, index } => {
                Some(moduli_at(&law, &embedded(&gradients[index as usize]), weight))
            }
        }));
    }

    /// Makes the moduli positive definite, with the magnitudes of their eigenvalues.
    pub(super) fn make_definite(&self, responses: &mut Responses<D>) {
        for cell in &self.cells {
            if let CellLaw::Finite { index, .. } = cell.law {
                make_definite(&mut responses.moduli[index as usize], LEAST_STIFFNESS * cell.mu);
            }
        }
    }

    /// An element that is inverted or flat under these displacements (mm), if one is.
    pub(super) fn inverted(&self, displacement: &[f64]) -> Option<usize> {
        (0..self.elements.len()).find(|element| self.is_inverted(*element, displacement))
    }

    /// Whether an element is inverted or flat under these displacements (mm).
    ///
    /// # Panics
    /// If the element does not exist.
    pub fn is_inverted(&self, element: usize, displacement: &[f64]) -> bool {
        let corner = |node: u32| {
            let node = node as usize;
            std::array::from_fn(|axis| self.nodes[node][axis] + displacement[D * node + axis])
        };
        orientation::<D, N>(&self.elements[element].map(corner)) <= 0.0
    }

    /// Returns the barycentric coordinates of a point (mm) in an element of the reference state.
    ///
    /// # Panics
    /// If the element does not exist.
    pub fn barycentric(&self, element: usize, point: &[f64; D]) -> [f64; N] {
        let corner = self.nodes[self.elements[element][0] as usize];
        let offset: [f64; D] = std::array::from_fn(|axis| point[axis] - corner[axis]);
        let mut weights = self.cells[element]
            .shape
            .gradients
            .map(|gradient| dot(gradient, offset));
        weights[0] += 1.0;
        weights
    }

    /// Returns the edge of the cube, or square, of which an element is a part as those of a lattice are, mm.
    pub(crate) fn cell_mm(&self, element: usize) -> f64 {
        let place = |node: u32| Vector3::from_fn(|axis, _| self.nodes[node as usize].get(axis).copied().unwrap_or(0.0));
        let corners = &self.elements[element];
        let side = |corner: usize| place(corners[corner]) - place(corners[0]);
        let across = side(1).cross(&side(2));
        if D == 2 {
            across.norm().sqrt()
        } else {
            across.dot(&side(N - 1)).abs().cbrt()
        }
    }

    /// Returns the relative strain of each element under displacements (mm).
    ///
    /// # Panics
    /// If there is not one entry per degree of freedom.
    pub fn relative_strains(&self, displacement: &[f64]) -> Vec<f64> {
        let strain = |(corners, cell): (&[u32; N], &Cell<D, N>)| {
            let moved = corners.map(|node| vector(displacement, node));
            relative_strain(&cell.shape.strain(&moved)).0
        };
        self.elements.iter().zip(&self.cells).map(strain).collect()
    }

    /// Returns the strain of each element under displacements (mm).
    ///
    /// # Panics
    /// If there is not one entry per degree of freedom.
    pub fn strains(&self, displacement: &[f64]) -> Vec<[[f64; D]; D]> {
        let strain = |(corners, cell): (&[u32; N], &Cell<D, N>)| {
            let moved = corners.map(|node| vector(displacement, node));
            cell.shape.strain(&moved)
        };
        self.elements.iter().zip(&self.cells).map(strain).collect()
    }

    /// Returns the Cauchy stress of each element, kPa; of a secant law E(e_r) of the strain under `displacement` times
    /// D epsilon(`strained`). For an elastic body `strained` equals `displacement`; for a viscous one it holds the
    /// rates (see [`super::creep`]).
    ///
    /// # Panics
    /// If there is not one entry per degree of freedom.
    pub fn stresses_kpa(&self, displacement: &[f64], strained: &[f64]) -> Vec<[[f64; D]; D]> {
        let stress = |(corners, cell): (&[u32; N], &Cell<D, N>)| {
            let [state, rate] = [displacement, strained].map(|values| corners.map(|node| vector(values, node)));
            match cell.law {
                CellLaw::Secant(law) => {
                    let secant = law.secant(relative_strain(&cell.shape.strain(&state)).0);
                    let [lambda, mu] = law.material().lame_kpa().map(|kpa| kpa * secant);
                    stress(lambda, mu, &cell.shape.strain(&rate))
                }
                CellLaw::Finite { law, .. } => {
                    let stress = cauchy_kpa(&law, &embedded(&cell.shape.gradient(&state)));
                    std::array::from_fn(|i| std::array::from_fn(|j| stress[(i, j)]))
                }
            }
        };
        self.elements.iter().zip(&self.cells).map(stress).collect()
    }

    /// Rounding of the forces of elements whose law has no secant, N: of a turned body without stress they are nothing
    /// else.
    pub(super) fn rounding_n(&self) -> f64 {
        let finite = self
            .cells
            .iter()
            .filter(|cell| matches!(cell.law, CellLaw::Finite { .. }));
        let unit_forces = finite.map(|cell| {
            let steepest = cell
                .shape
                .gradients
                .iter()
                .flatten()
                .fold(0.0, |a: f64, x| a.max(x.abs()));
            (cell.lambda + 2.0 * cell.mu) * steepest
        });
        ROUNDINGS * f64::EPSILON * unit_forces.fold(0.0, f64::max)
    }

    /// Largest change of an entry of the displacement gradient in elements whose law has no secant, for a change of
    /// displacement.
    pub(super) fn largest_finite_change(&self, change: &[f64]) -> f64 {
        let elements = self.elements.iter().zip(&self.cells);
        let finite = elements.filter(|(_, cell)| matches!(cell.law, CellLaw::Finite { .. }));
        let largest = finite.map(|(corners, cell)| {
            let gradient = cell.shape.gradient(&corners.map(|node| vector(change, node)));
            gradient.iter().flatten().fold(0.0, |a: f64, x| a.max(x.abs()))
        });
        largest.fold(0.0, f64::max)
    }

    /// Computes the forces that balance displacements `u`, and the response of each element: stress is E(e_r(u)) D
    /// epsilon(u - `offset`). Without an offset the body is elastic; with one, its stress is that of a rate (see
    /// [`super::creep`]).
    pub(super) fn respond(&self, u: &[f64], offset: Option<&[f64]>, forces: &mut [f64], responses: &mut Responses<D>) {
        forces.fill(0.0);
        let Responses { cells, gradients, .. } = responses;
        for ((corners, cell), response) in self.elements.iter().zip(&self.cells).zip(cells) {
            let moved = corners.map(|node| vector(u, node));
            let secant_law = match cell.law {
                CellLaw::Secant(law) => law,
                CellLaw::Finite { law, weight, index } => {
                    let gradient = cell.shape.gradient(&moved);
                    gradients[index as usize] = gradient;
                    let stress = law.stress_kpa(&embedded(&gradient)) * weight;
                    let stress = std::array::from_fn(|i| std::array::from_fn(|j| stress[(i, j)]));
                    add(forces, corners, &cell.shape.divergence(&stress));
                    continue;
                }
            };
            let strain = cell.shape.strain(&moved);
            let (relative, deviator) = relative_strain(&strain);
            let strained = match offset {
                None => strain,
                Some(offset) => {
                    let at_rest: [[f64; D]; N] = corners.map(|node| vector(offset, node));
                    let change = std::array::from_fn(|a| std::array::from_fn(|axis| moved[a][axis] - at_rest[a][axis]));
                    cell.shape.strain(&change)
                }
            };
            let stress = cell.stress(&strained);
            let (secant, slope) = (secant_law.secant(relative), secant_law.slope(relative));
            // Without strain nothing stiffens, and the direction is arbitrary.
            let direction = if relative > 0.0 { 1.5 / relative } else { 0.0 };
            *response = Response {
                secant,
                scalar: secant + slope * relative,
                rise: stress.map(|row| row.map(|x| slope * x)),
                normal: deviator.map(|row| row.map(|x| direction * x)),
            };
            add(
                forces,
                corners,
                &cell.shape.divergence(&stress.map(|row| row.map(|x| secant * x))),
            );
        }
    }

    /// Multiplies a tangent by a change of displacement.
    pub(super) fn product(&self, kind: Kind, responses: &Responses<D>, change: &[f64], product: &mut [f64]) {
        match kind {
            Kind::Scalar => self.scalar(responses, change, product),
            Kind::Consistent => self.consistent(responses, change, product),
        }
    }

    /// Multiplies the consistent tangent by a change of displacement: stress changes by E(e_r) D d epsilon, and by the
    /// change of E along D epsilon; of laws without a secant by their moduli.
    pub(super) fn consistent(&self, responses: &Responses<D>, change: &[f64], product: &mut [f64]) {
        product.fill(0.0);
        for ((corners, cell), response) in self.elements.iter().zip(&self.cells).zip(&responses.cells) {
            let changed = corners.map(|node| vector(change, node));
            if let Some(moduli) = responses.moduli_of(cell) {
                let stress = contracted(moduli, &cell.shape.gradient(&changed));
                add(product, corners, &cell.shape.divergence(&stress));
                continue;
            }
            let strain = cell.shape.strain(&changed);
            let relative: f64 = (0..D).map(|i| dot(response.normal[i], strain[i])).sum();
            let stress = cell.stress(&strain);
            let stress = std::array::from_fn(|i| {
                std::array::from_fn(|j| response.secant * stress[i][j] + relative * response.rise[i][j])
            });
            add(product, corners, &cell.shape.divergence(&stress));
        }
    }

    /// Multiplies Kobayashi et al.'s tangent by a change of displacement; of laws without a secant their moduli.
    pub(super) fn scalar(&self, responses: &Responses<D>, change: &[f64], product: &mut [f64]) {
        product.fill(0.0);
        for ((corners, cell), response) in self.elements.iter().zip(&self.cells).zip(&responses.cells) {
            let change = corners.map(|node| vector(change, node));
            let stress = match responses.moduli_of(cell) {
                Some(moduli) => contracted(moduli, &cell.shape.gradient(&change)),
                None => cell
                    .stress(&cell.shape.strain(&change))
                    .map(|row| row.map(|x| response.scalar * x)),
            };
            add(product, corners, &cell.shape.divergence(&stress));
        }
    }
}

impl<const D: usize> Response<D> {
    /// Response of an unstrained element.
    pub(super) const REST: Self = Response {
        secant: 1.0,
        scalar: 1.0,
        rise: [[0.0; D]; D],
        normal: [[0.0; D]; D],
    };
}

impl<const D: usize, const N: usize> Cell<D, N> {
    /// Stress below the knee times volume, N mm.
    #[inline]
    fn stress(&self, strain: &[[f64; D]; D]) -> [[f64; D]; D] {
        stress(self.lambda, self.mu, strain)
    }
}

/// Computes lambda tr(strain) I + 2 mu strain.
#[inline]
fn stress<const D: usize>(lambda: f64, mu: f64, strain: &[[f64; D]; D]) -> [[f64; D]; D] {
    let pressure = lambda * (0..D).map(|i| strain[i][i]).sum::<f64>();
    std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            let shear = 2.0 * mu * strain[i][j];
            if i == j { shear + pressure } else { shear }
        })
    })
}

/// A displacement gradient in three dimensions: in plane strain nothing changes across the plane.
fn embedded<const D: usize>(gradient: &[[f64; D]; D]) -> Tensor {
    Tensor::from_fn(|i, j| if i < D && j < D { gradient[i][j] } else { 0.0 })
}

/// Cauchy stress, P F^T / J.
fn cauchy_kpa(law: &AnyLaw, gradient: &Tensor) -> Tensor {
    let f = Tensor::identity() + gradient;
    law.stress_kpa(gradient) * f.transpose() / f.determinant()
}

/// Roundings of a nodal force: one for each of the elements around a node, and as many again in their strains.
const ROUNDINGS: f64 = 64.0;

/// Least eigenvalue of moduli that are made definite, relative to the shear modulus.
const LEAST_STIFFNESS: f64 = 1e-3;

/// Change of the stress by a change of the displacement gradient.
fn contracted<const D: usize>(moduli: &Moduli<D>, gradient: &[[f64; D]; D]) -> [[f64; D]; D] {
    let entry = |rows: &[[f64; D]; D]| (0..D).map(|k| dot(rows[k], gradient[k])).sum::<f64>();
    moduli.map(|row| row.map(|rows| entry(&rows)))
}

/// Replaces the eigenvalues of moduli by their magnitudes, at least `least`.
fn make_definite<const D: usize>(moduli: &mut Moduli<D>, least: f64) {
    let size = D * D;
    let matrix = DMatrix::from_fn(size, size, |row, column| {
        moduli[row / D][row % D][column / D][column % D]
    });
    let mut eigen = matrix.symmetric_eigen();
    eigen.eigenvalues.apply(|value| *value = value.abs().max(least));
    let definite = eigen.recompose();
    for row in 0..size {
        for column in 0..size {
            moduli[row / D][row % D][column / D][column % D] = definite[(row, column)];
        }
    }
}

fn moduli_at<const D: usize>(law: &AnyLaw, gradient: &Tensor, weight: f64) -> Moduli<D> {
    let moduli = law.moduli_kpa(gradient) * weight;
    let entry = |i, j, k, l| moduli[(3 * i + j, 3 * k + l)];
    use std::array::from_fn;
    from_fn(|i| from_fn(|j| from_fn(|k| from_fn(|l| entry(i, j, k, l)))))
}

#[inline]
pub(super) fn vector<const D: usize>(values: &[f64], node: u32) -> [f64; D] {
    let first_dof = D * node as usize;
    std::array::from_fn(|axis| values[first_dof + axis])
}

#[inline]
fn add<const D: usize, const N: usize>(sums: &mut [f64], corners: &[u32; N], forces: &[[f64; D]; N]) {
    for (node, force) in corners.iter().zip(forces) {
        let first_dof = D * *node as usize;
        sums[first_dof..first_dof + D]
            .iter_mut()
            .zip(force)
            .for_each(|(sum, force)| *sum += force);
    }
}
