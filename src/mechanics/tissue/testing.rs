//! Fixtures shared by several test modules.

use std::sync::Arc;

use super::assembly::Stiffness;
use super::dofs::Dofs;
use super::factor::Factor;
use super::material::Material;
use insonify_base::random::{pcg3d, unit};
use insonify_mesh::TetMesh;

/// Returns a value in -1..1 that depends only on the arguments.
pub(super) fn value(i: usize, j: usize, salt: u32) -> f64 {
    let [coarse, fine, _] = pcg3d([i as u32, j as u32, salt]).map(unit).map(f64::from);
    2.0 * coarse - 1.0 + 1e-8 * fine
}

/// Runs `work` on a dedicated thread pool.
pub(super) fn on_threads<R: Send>(threads: usize, work: impl FnOnce() -> R + Send) -> R {
    let pool = insonify_base::parallel::Pool::new(threads);
    pool.expect("a pool").install(work)
}

/// Block of soft tissue of 60 x 40 x 40 mm on a fixed floor, with perturbed inner nodes.
pub(super) struct Block {
    pub mesh: TetMesh,
    pub materials: Vec<Material>,
    pub dofs: Dofs,
    pub stiffness: Stiffness,
    pub factor: Arc<Factor>,
}

impl Block {
    pub(super) fn new(nodes: usize, poisson: f64) -> Self {
        let extent = [60.0, 40.0, 40.0];
        let regular = TetMesh::over_box([0.0; 3], extent, nodes).expect("a box");
        let inside = |p: &[f64; 3]| (0..3).all(|axis| p[axis] > 0.0 && p[axis] < extent[axis]);
        let shaken = regular.nodes().iter().enumerate().map(|(i, p)| {
            if inside(p) {
                std::array::from_fn(|axis| p[axis] + 0.5 * value(i, axis, 1))
            } else {
                *p
            }
        });
        let mesh = TetMesh::new(
            shaken.collect(),
            regular.elements().to_vec(),
            regular.regions().to_vec(),
        );
        let mesh = mesh.expect("a shaken box");
        let floor = mesh.nodes().iter().zip(0..).filter(|(p, _)| p[2] == 0.0);
        let dofs = Dofs::new(
            mesh.nodes().len(),
            floor.flat_map(|(_, node)| (0..3).map(move |axis| (node, axis))),
        );
        let materials = vec![Material::new(10.0, poisson).expect("a material"); mesh.elements().len()];
        let stiffness = Stiffness::assemble(&mesh, &materials, &dofs).expect("a stiffness");
        let factor = Arc::new(Factor::new(&stiffness).expect("a factor"));
        Self {
            mesh,
            materials,
            dofs,
            stiffness,
            factor,
        }
    }
}
