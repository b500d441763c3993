//! From points to places in the tissue as it lies now.

use std::sync::Arc;

use nalgebra::{Point3, Vector3};

use super::Finite;
use super::place::{Place, Tetrahedron};
use crate::mechanics::mesh::{NONE, TetMesh};

/// Elements that a search goes through at most: a part of a step passes a few.
const MOST_ELEMENTS: usize = 64;
/// A coordinate this far below zero is rounding.
const SLACK: f64 = 1e-10;
/// Iterations that carry a point back to the reference state when only the probe displaces the tissue.
const CARRIES: usize = 8;

impl Finite {
    /// Where the tip is when it is in the body for the first time: only the probe displaces the tissue then.
    pub(super) fn enter(&mut self, tip: &Point3<f64>) -> Option<Place> {
        let mut point = *tip;
        let mut element = NONE;
        for _ in 0..CARRIES {
            let hit = self.locator.locate(point.into(), element);
            if hit.element == NONE {
                return None;
            }
            element = hit.element;
            if self.press.is_none() {
                return Some(Place {
                    element,
                    bary: hit.bary,
                });
            }
            let displacement = self.displacement_at(&Place {
                element,
                bary: hit.bary,
            });
            let next = tip - displacement;
            if (next - point).norm() < SLACK {
                break;
            }
            point = next;
        }
        self.walk(tip, element)
    }

    fn displacement_at(&mut self, place: &Place) -> Vector3<f64> {
        let corners = self.mesh.elements()[place.element as usize];
        let terms = corners.into_iter().zip(place.bary);
        terms.map(|(node, weight)| self.displacement_of(node) * weight).sum()
    }

    fn displacement_of(&mut self, node: u32) -> Vector3<f64> {
        let displacement = self
            .nearby
            .displacement(&mut self.adaptation, &self.carried, self.version, node);
        match displacement {
            Ok(displacement) => displacement.into(),
            Err(error) => unreachable!("rows and columns are free degrees of freedom: {error}"),
        }
    }

    /// The element as it lies now.
    fn deformed(&mut self, element: u32) -> Option<Tetrahedron> {
        let corners = self.mesh.elements()[element as usize];
        let places = corners.map(|node| {
            let displacement = self.displacement_of(node);
            Point3::from(self.adaptation.mesh().nodes()[node as usize]) + displacement
        });
        Tetrahedron::new(&places)
    }

    /// From an element to the one that holds a point, in the tissue as it lies now. None outside.
    pub(super) fn walk(&mut self, point: &Point3<f64>, from: u32) -> Option<Place> {
        let mesh = Arc::clone(&self.mesh);
        search(&mesh, point, from, |element| {
            let tetrahedron = self.deformed(element)?;
            self.outcome.crushed += usize::from(tetrahedron.volume <= 0.0);
            Some(tetrahedron)
        })
    }

    /// The same in the reference state.
    pub(super) fn walk_at_rest(&self, point: &Point3<f64>, from: u32) -> Option<Place> {
        let nodes = self.adaptation.mesh().nodes();
        search(&self.mesh, point, from, |element| {
            let corners = self.mesh.elements()[element as usize];
            Tetrahedron::new(&corners.map(|node| Point3::from(nodes[node as usize])))
        })
    }

    /// Back along a direction to where the tissue begins, or that of some regions: the place there, the corner opposite the border, and
    /// how far (mm).
    pub(super) fn back_through(
        &mut self,
        place: &Place,
        from: &Point3<f64>,
        direction: &Vector3<f64>,
        within: impl Fn(i32) -> bool,
    ) -> Option<(Place, usize, f64)> {
        let mut element = place.element;
        let mut point = *from;
        let mut way = 0.0;
        for _ in 0..MOST_ELEMENTS {
            let tetrahedron = self.deformed(element)?;
            let (distance, corner) = tetrahedron.exit(&point, direction)?;
            way += distance;
            point += direction * distance;
            let next = self.mesh.neighbours()[element as usize][corner];
            if next == NONE || !within(self.mesh.regions()[next as usize]) {
                let mut bary = tetrahedron.bary(&point);
                bary[corner] = 0.0;
                let sum: f64 = bary.iter().sum();
                return Some((
                    Place {
                        element,
                        bary: bary.map(|b| b / sum),
                    },
                    corner,
                    way,
                ));
            }
            element = next;
        }
        None
    }
}

/// Goes from an element to the one that holds a point, each time through the face that the point lies farthest beyond.
fn search(
    mesh: &TetMesh,
    point: &Point3<f64>,
    from: u32,
    mut at: impl FnMut(u32) -> Option<Tetrahedron>,
) -> Option<Place> {
    let mut element = from;
    for _ in 0..MOST_ELEMENTS {
        match next(&at(element)?.bary(point)) {
            Ok(bary) => return Some(Place { element, bary }),
            Err(corner) => element = mesh.neighbours()[element as usize][corner],
        }
        if element == NONE {
            return None;
        }
    }
    None
}

/// The coordinates, if they are those of a point inside, or else the corner whose opposite face the point lies farthest beyond.
fn next(bary: &[f64; 4]) -> Result<[f64; 4], usize> {
    let (mut corner, mut least) = (0, bary[0]);
    for (at, &value) in bary.iter().enumerate().skip(1) {
        if value < least {
            (corner, least) = (at, value);
        }
    }
    if least >= -SLACK { Ok(*bary) } else { Err(corner) }
}
