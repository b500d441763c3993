//! True motion of a synthesised sequence, against which estimators are tested.

use nalgebra::{Matrix4, Point3, Vector3};

use super::scatterers::RfSynthesizer;
use insonify_base::matrix::inverse_rigid;
use insonify_mesh::TetMesh;
use insonify_mesh::locator::{Locator, NO_ELEMENT};

/// A point of the tissue that is followed.
#[derive(Clone, Copy, Debug)]
pub struct Followed {
    /// Line, from 0.
    pub line: usize,
    /// Window along the line, from 0.
    pub window: usize,
    /// Depth along the line in the first frame, mm.
    pub depth_mm: f64,
    /// In the reference state, world, mm.
    rest: Point3<f64>,
    /// In the first frame, probe frame, mm.
    first: Point3<f64>,
}

/// Points of the first frame at some depths (mm) of each line.
pub fn windows(
    synthesizer: &RfSynthesizer,
    mesh: Option<&TetMesh>,
    probe_to_world: &Matrix4<f64>,
    depths_mm: &[f64],
) -> Vec<Followed> {
    let grid = synthesizer.grid();
    let [reference, current] = synthesizer.nodes();
    let locator = mesh.map(|mesh| {
        let mut locator = Locator::<f64>::new(mesh);
        // Positions were checked by the synthesizer.
        let _ = locator.update_states(Some(current), Some(reference));
        locator
    });
    let followed = |line: usize, window: usize| {
        let depth_mm = depths_mm[window];
        let ray = grid.rays()[line];
        let [x, y] = [0, 1].map(|axis| ray.origin[axis] + depth_mm * ray.direction[axis]);
        let first = Point3::new(x, y, 0.0);
        let now: [f64; 3] = probe_to_world.transform_point(&first).into();
        let rest = locator.as_ref().and_then(|locator| {
            let element = locator.locate(now, NO_ELEMENT).element;
            (element != NO_ELEMENT).then(|| locator.to_reference(element, now))
        });
        Followed {
            line,
            window,
            depth_mm,
            rest: rest.unwrap_or(now).into(),
            first,
        }
    };
    let lines = 0..grid.lines();
    lines
        .flat_map(|line| (0..depths_mm.len()).map(move |window| (line, window)))
        .map(|(line, window)| followed(line, window))
        .collect()
}

impl Followed {
    /// Motion since the first frame, um: away from the probe along the line, towards the marked side, and along the
    /// normal of the image.
    pub fn motion_um(&self, synthesizer: &RfSynthesizer, probe_to_world: &Matrix4<f64>) -> [f64; 3] {
        let now = inverse_rigid(probe_to_world).transform_point(&synthesizer.carry(&self.rest));
        let ray = synthesizer.grid().rays()[self.line];
        along(&ray.direction, &(now - self.first))
    }
}

/// Motion of each mesh node from the reference state, um: along the middle line, towards the marked side, and along the
/// normal of the image.
pub fn nodes<'a>(synthesizer: &'a RfSynthesizer, probe_to_world: &Matrix4<f64>) -> impl Iterator<Item = [f64; 3]> + 'a {
    let [reference, current] = synthesizer.nodes();
    let to_probe = inverse_rigid(probe_to_world);
    let pairs = reference.iter().zip(current);
    pairs.map(move |(then, now)| {
        along(
            &[0.0, 1.0],
            &to_probe.transform_vector(&(Point3::from(*now) - Point3::from(*then))),
        )
    })
}

fn along([x, y]: &[f64; 2], moved: &Vector3<f64>) -> [f64; 3] {
    [moved.x * x + moved.y * y, moved.x * y - moved.y * x, moved.z].map(|mm| mm * 1e3)
}
