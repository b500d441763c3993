//! Prefetch of the compliance columns that remeshing along a path will read.

use nalgebra::{Point3, Vector3};

use super::Finite;
use crate::mechanics::mesh::NONE;

impl Finite {
    /// Prefetches the columns of the nodes within `aside_mm` of a path.
    pub(super) fn fetch_along(&mut self, from: &Point3<f64>, direction: &Vector3<f64>, length_mm: f64, aside_mm: f64) {
        let Some(direction) = direction.try_normalize(0.0) else {
            return;
        };
        let mesh = self.adaptation.mesh();
        let mut wanted = vec![false; mesh.nodes().len()];
        for corners in mesh.elements() {
            let places = corners.map(|node| Point3::from(mesh.nodes()[node as usize]));
            let middle =
                Point3::from((places[0].coords + places[1].coords + places[2].coords + places[3].coords) / 4.0);
            let size = places.iter().map(|place| (place - middle).norm()).fold(0.0, f64::max);
            let along = (middle - from).dot(&direction).clamp(0.0, length_mm);
            if (middle - (from + direction * along)).norm() <= size + aside_mm {
                for corner in corners {
                    mesh.neighbours(*corner)
                        .iter()
                        .for_each(|node| wanted[*node as usize] = true);
                }
            }
        }
        let nodes = (0..wanted.len() as u32).filter(|node| wanted[*node as usize]);
        let dofs: Vec<usize> = nodes
            .flat_map(|node| mesh.dofs().of(node))
            .filter(|dof| *dof != NONE)
            .map(|dof| dof as usize)
            .collect();
        if let Err(error) = self.adaptation.parts().1.prefetch(&dofs) {
            unreachable!("free degrees of freedom: {error}");
        }
    }
}
