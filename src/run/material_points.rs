//! Points that move with the tissue: seeds, targets, entries and reported points.

use nalgebra::{Matrix3, Point3, Vector3};

use insonify_imaging::synth::NeedleShaft;
use insonify_mechanics::insertion::Tissue;

/// Tolerance by which a seed may lie outside its element: it lies on the surface, or a face has moved by rounding.
const SLACK: f64 = 1e-6;

/// Current positions of points of the tissue, computed from the elements around them.
#[derive(Clone, Debug, Default)]
pub struct MaterialPoints {
    /// Direction in which each seed was deposited.
    pub along: Vec<Vector3<f64>>,
    /// Element that last contained each seed.
    last_elements: Vec<usize>,
}

impl MaterialPoints {
    /// Places seeds, given in the reference state (mm), in the deformed tissue. One that is in no element stays.
    pub fn place(
        &mut self,
        seeds: &[Point3<f64>],
        elements: &[[u32; 4]],
        tissue: &Tissue,
        into: &mut Vec<NeedleShaft>,
    ) {
        into.clear();
        self.last_elements.resize(seeds.len(), 0);
        for ((seed, direction), last_element) in seeds.iter().zip(&self.along).zip(&mut self.last_elements) {
            into.push(match find(last_element, elements, tissue, seed) {
                None => NeedleShaft::seed(*seed, direction),
                Some((position, rotation)) => NeedleShaft::seed(position, &(rotation * direction)),
            });
        }
    }

    /// Current position of a point of the reference state, mm; `slot` numbers the points that are followed. A point
    /// outside the mesh moves with the nearest node.
    pub fn point(&mut self, slot: usize, at_rest: &Point3<f64>, elements: &[[u32; 4]], tissue: &Tissue) -> Point3<f64> {
        if self.last_elements.len() <= slot {
            self.last_elements.resize(slot + 1, 0);
        }
        if let Some((position, _)) = find(&mut self.last_elements[slot], elements, tissue, at_rest) {
            return position;
        }
        let distance = |node: &[f64; 3]| (Point3::from(*node) - at_rest).norm_squared();
        let pairs = tissue.reference.iter().zip(&tissue.current);
        let nearest = pairs.min_by(|a, b| distance(a.0).total_cmp(&distance(b.0)));
        nearest.map_or(*at_rest, |(then, now)| {
            at_rest + (Point3::from(*now) - Point3::from(*then))
        })
    }
}

/// Finds a point in the element that last contained it, or in any other: its position and the rotation there.
fn find(
    last_element: &mut usize,
    elements: &[[u32; 4]],
    tissue: &Tissue,
    point: &Point3<f64>,
) -> Option<(Point3<f64>, Matrix3<f64>)> {
    let candidates = std::iter::once(*last_element).chain(0..elements.len());
    let (element, position) = candidates
        .filter(|element| *element < elements.len())
        .find_map(|element| Some((element, inside(&elements[element], tissue, point)?)))?;
    *last_element = element;
    Some(position)
}

/// Maps a point of the reference state to the deformed element, with the rotation of directions there; `None`
/// outside the element.
fn inside(corners: &[u32; 4], tissue: &Tissue, point: &Point3<f64>) -> Option<(Point3<f64>, Matrix3<f64>)> {
    let edges = |nodes: &[[f64; 3]]| -> Option<(Point3<f64>, Matrix3<f64>)> {
        let node = |corner: usize| nodes.get(corners[corner] as usize).map(|node| Point3::from(*node));
        let origin = node(0)?;
        Some((
            origin,
            Matrix3::from_columns(&[node(1)? - origin, node(2)? - origin, node(3)? - origin]),
        ))
    };
    let (origin, at_rest) = edges(&tissue.reference)?;
    let back = at_rest.try_inverse()?;
    let shares = back * (point - origin);
    let is_inside = shares.iter().all(|share| *share >= -SLACK) && shares.sum() <= 1.0 + SLACK;
    if !is_inside {
        return None;
    }
    let (origin, now) = edges(&tissue.current)?;
    let turned = now * back;
    // A flattened element has no defined direction.
    let turned = if turned.iter().all(|x| x.is_finite()) && turned.determinant() != 0.0 {
        turned
    } else {
        Matrix3::identity()
    };
    Some((origin + now * shares, turned))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seeds_go_with_the_element_around_them() {
        let reference = vec![[0.0; 3], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0], [0.0, 0.0, 4.0]];
        // Rotated by 90 degrees about z and translated.
        let current = reference.iter().map(|[x, y, z]| [10.0 - y, *x, *z]).collect();
        let tissue = Tissue {
            reference,
            current,
            ..Tissue::default()
        };
        let mut carried = MaterialPoints {
            along: vec![Vector3::x(); 2],
            ..MaterialPoints::default()
        };
        let mut shafts = Vec::new();
        let seeds = [Point3::new(1.0, 0.5, 0.25), Point3::new(9.0, 9.0, 9.0)];
        carried.place(&seeds, &[[0, 1, 2, 3]], &tissue, &mut shafts);
        let middle = |shaft: &NeedleShaft| nalgebra::center(&shaft.nodes[0], &shaft.nodes[1]);
        assert!((middle(&shafts[0]) - Point3::new(9.5, 1.0, 0.25)).norm() < 1e-12);
        let direction = (shafts[0].nodes[1] - shafts[0].nodes[0]).normalize();
        assert!((direction - Vector3::y()).norm() < 1e-12);
        assert!((middle(&shafts[1]) - seeds[1]).norm() < 1e-12, "outside it stays");
    }
}
