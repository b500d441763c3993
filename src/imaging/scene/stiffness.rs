//! Linear elements on a mesh: values of which a part is prescribed at some nodes, continued to all others.
//!
//! With one value a node this solves Laplace's equation, with three the displacement of linear elastic tissue at rest.

use nalgebra::{Matrix1, Matrix3, SMatrix, SVector, Vector3};

use insonify_mesh::TetMesh;

/// Energy of the residual, over that of the prescribed values, at which a system is solved.
const TOLERANCE: f64 = 1e-16;
const MAX_ITERATIONS: usize = 5000;

/// Stiffness of a mesh at `N` values a node.
pub(super) struct Stiffness<const N: usize> {
    /// Edges from the node of lower number to the other and the stiffness between them with the sign changed, in one
    /// order, so that sums are the same on all machines.
    pub edges: Vec<([u32; 2], SMatrix<f64, N, N>)>,
    /// Sum of those of all edges at each node.
    diagonal: Vec<SMatrix<f64, N, N>>,
}

impl Stiffness<1> {
    /// That of Laplace's equation.
    pub(super) fn laplace(mesh: &TetMesh) -> Self {
        Self::new(mesh, |_, a, b| Matrix1::new(a.dot(b)))
    }
}

impl Stiffness<3> {
    /// That of isotropic linear elastic tissue; `moduli` are Young's modulus (kPa) and Poisson's ratio of each element.
    /// Forces are in mN where displacements are in mm.
    pub(super) fn elastic(mesh: &TetMesh, moduli: &[[f64; 2]]) -> Self {
        Self::new(mesh, |element, a, b| {
            let [young, poisson] = moduli[element];
            let shear = 0.5 * young / (1.0 + poisson);
            let lambda = 2.0 * shear * poisson / (1.0 - 2.0 * poisson);
            a * b.transpose() * lambda + (b * a.transpose() + Matrix3::identity() * a.dot(b)) * shear
        })
    }
}

impl<const N: usize> Stiffness<N> {
    /// `density` returns the stiffness per volume between two nodes of an element, from the gradients of their shape
    /// functions (1/mm).
    fn new(mesh: &TetMesh, density: impl Fn(usize, &Vector3<f64>, &Vector3<f64>) -> SMatrix<f64, N, N>) -> Self {
        let mut edges = Vec::with_capacity(6 * mesh.elements().len());
        for (element, corners) in mesh.elements().iter().enumerate() {
            let [origin, a, b, c] = corners.map(|node| Vector3::from(mesh.nodes()[node as usize]));
            let sides = Matrix3::from_columns(&[a - origin, b - origin, c - origin]);
            let Some(inverse) = sides.try_inverse() else { continue };
            let volume_mm3 = sides.determinant().abs() / 6.0;
            let [a, b, c] = [0, 1, 2].map(|row| inverse.row(row).transpose());
            let gradients = [-(a + b + c), a, b, c];
            for first in 0..4 {
                for second in first + 1..4 {
                    let [low, high] = if corners[first] < corners[second] {
                        [first, second]
                    } else {
                        [second, first]
                    };
                    let weight = density(element, &gradients[low], &gradients[high]) * -volume_mm3;
                    edges.push(([corners[low], corners[high]], weight));
                }
            }
        }
        edges.sort_by_key(|(edge, _)| *edge);
        edges.dedup_by(|next, kept| {
            let is_same = next.0 == kept.0;
            if is_same {
                kept.1 += next.1;
            }
            is_same
        });
        let mut diagonal = vec![SMatrix::zeros(); mesh.nodes().len()];
        for ([a, b], weight) in &edges {
            diagonal[*a as usize] += weight;
            diagonal[*b as usize] += weight.transpose();
        }
        Self { edges, diagonal }
    }

    /// Forces at all nodes that hold them at `values`.
    pub(super) fn forces(&self, values: &[SVector<f64, N>], out: &mut Vec<SVector<f64, N>>) {
        out.clear();
        out.extend(self.diagonal.iter().zip(values).map(|(weight, value)| weight * value));
        for (edge, weight) in &self.edges {
            let [a, b] = edge.map(|node| node as usize);
            out[a] -= weight * values[b];
            out[b] -= weight.tr_mul(&values[a]);
        }
    }

    /// Continues values to all nodes by conjugate gradients. `free` projects those of each node onto what is not
    /// prescribed; the rest of them is. Nodes that no prescribed one is joined to keep theirs.
    pub(super) fn solve(&self, free: &[SMatrix<f64, N, N>], values: &mut [SVector<f64, N>]) {
        let dot = |a: &[SVector<f64, N>], b: &[SVector<f64, N>]| a.iter().zip(b).map(|(a, b)| a.dot(b)).sum::<f64>();
        let inverses: Vec<SMatrix<f64, N, N>> = self
            .diagonal
            .iter()
            .zip(free)
            .map(|(weight, free)| free * weight.try_inverse().unwrap_or_else(SMatrix::zeros) * free)
            .collect();
        let scaled = |residual: &[SVector<f64, N>]| -> Vec<SVector<f64, N>> {
            inverses
                .iter()
                .zip(residual)
                .map(|(inverse, part)| inverse * part)
                .collect()
        };
        let prescribed = values.iter().zip(free).map(|(value, free)| value - free * value);
        let energies = prescribed
            .zip(&self.diagonal)
            .map(|(value, weight)| value.dot(&(weight * value)));
        let limit = TOLERANCE * energies.sum::<f64>();
        let mut image = Vec::new();
        self.forces(values, &mut image);
        let mut residual: Vec<SVector<f64, N>> = image.iter().map(|force| -force).collect();
        let mut direction = scaled(&residual);
        let mut energy = dot(&residual, &direction);
        for _ in 0..MAX_ITERATIONS {
            if energy <= limit {
                break;
            }
            self.forces(&direction, &mut image);
            let step = energy / dot(&direction, &image);
            for node in 0..values.len() {
                values[node] += direction[node] * step;
                residual[node] -= image[node] * step;
            }
            let next = scaled(&residual);
            let next_energy = dot(&residual, &next);
            for (direction, next) in direction.iter_mut().zip(&next) {
                *direction = next + *direction * (next_energy / energy);
            }
            energy = next_energy;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Between a plane at rest and one that moves, values are linear; without any that are prescribed they stay.
    #[test]
    fn values_are_harmonic_between_what_is_prescribed() {
        let mesh = TetMesh::lattice([3, 3, 12], &nalgebra::Matrix4::new_scaling(60.0)).expect("a mesh");
        let laplace = Stiffness::laplace(&mesh);
        let is_end = |node: &[f64; 3]| node[2] == 0.0 || node[2] == 60.0;
        let free: Vec<Matrix1<f64>> = mesh
            .nodes()
            .iter()
            .map(|node| Matrix1::new(f64::from(u8::from(!is_end(node)))))
            .collect();
        let at = |node: &[f64; 3]| Matrix1::new(if is_end(node) { node[2] / 3.0 } else { 0.0 });
        let mut values: Vec<Matrix1<f64>> = mesh.nodes().iter().map(at).collect();
        laplace.solve(&free, &mut values);
        for (node, value) in mesh.nodes().iter().zip(&values) {
            assert!((value.x - node[2] / 3.0).abs() < 1e-5, "{node:?}: {value}");
        }
        let mut still = vec![Matrix1::zeros(); mesh.nodes().len()];
        laplace.solve(&vec![Matrix1::identity(); mesh.nodes().len()], &mut still);
        assert!(still.iter().all(|value| value.x == 0.0));
    }
    /// A column pressed between planes is a bar: F = E A d / h.
    #[test]
    fn a_column_is_a_bar() {
        let (young, poisson) = (10.0, 0.3);
        let extent = Vector3::new(20.0, 30.0, 40.0);
        let mesh = TetMesh::lattice([4, 6, 8], &nalgebra::Matrix4::new_nonuniform_scaling(&extent)).expect("a mesh");
        let stiffness = Stiffness::elastic(&mesh, &vec![[young, poisson]; mesh.elements().len()]);
        // Three planes of symmetry, and one that comes 2 mm nearer.
        let is_held = |[x, y, z]: &[f64; 3]| Vector3::new(*x == 0.0, *y == 0.0, *z == 0.0 || *z == extent.z);
        let free = |node: &[f64; 3]| Matrix3::from_diagonal(&is_held(node).map(|held| f64::from(u8::from(!held))));
        let free: Vec<_> = mesh.nodes().iter().map(free).collect();
        let at = |node: &[f64; 3]| Vector3::new(0.0, 0.0, if node[2] == extent.z { -2.0 } else { 0.0 });
        let mut values: Vec<_> = mesh.nodes().iter().map(at).collect();
        stiffness.solve(&free, &mut values);
        let mut forces = Vec::new();
        stiffness.forces(&values, &mut forces);
        let on_plane = mesh.nodes().iter().zip(&forces).filter(|(node, _)| node[2] == extent.z);
        let force_mn: f64 = on_plane.map(|(_, force)| -force.z).sum();
        let expected_mn = young * extent.x * extent.y * 2.0 / extent.z;
        assert!(
            (force_mn / expected_mn - 1.0).abs() < 1e-6,
            "{force_mn} mN for {expected_mn}"
        );
        for ([x, ..], value) in mesh.nodes().iter().zip(&values) {
            assert!((value.x - poisson * x * 2.0 / extent.z).abs() < 1e-6);
        }
    }
}
