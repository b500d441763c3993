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
/// The farthest that a point may lie outside the mesh, as a share of the height of the element there.
const BESIDE: f64 = 0.5;
/// Length between places that are looked at along the needle among inverted elements, mm,
const SEARCH_MM: f64 = 0.25;
/// how many there are to either side,
const SEARCHED: u32 = 80;
/// and halvings between two of them, to 1e-6 mm.
const HALVINGS: u32 = 18;
/// Iterations that carry a point back to the reference state when only the probe displaces the tissue.
const CARRIES: usize = 8;

impl Finite {
    /// Where the tip is when it is in the body for the first time: only the probe displaces the tissue then.
    pub(super) fn enter(&mut self, tip: &Point3<f64>) -> Option<Place> {
        if self.press.is_none() {
            return self.place_at_rest(tip, NONE);
        }
        let mut place = self.place_at_rest(tip, NONE)?;
        for _ in 0..CARRIES {
            let point = tip - self.displacement_at(&place);
            let next = self.place_at_rest(&point, place.element)?;
            let shift = self.point_at(&next) - self.point_at(&place);
            place = next;
            if shift.norm() < SLACK {
                break;
            }
        }
        self.walk(tip, place.element)
    }

    /// The place of a point in the mesh as it was made; of one in the body but beside the mesh, that of the element at the nearest face.
    fn place_at_rest(&self, point: &Point3<f64>, from: u32) -> Option<Place> {
        let hit = self.locator.locate((*point).into(), from);
        if hit.element != NONE {
            let (element, bary) = (hit.element, hit.bary);
            return Some(Place { element, bary });
        }
        self.anatomy.region(point)?;
        let distance = |centre: &Point3<f64>| (centre - point).norm_squared();
        let nearest = self
            .surface
            .iter()
            .min_by(|a, b| distance(&a.1).total_cmp(&distance(&b.1)));
        self.walk_at_rest(point, nearest?.0)
    }

    /// A place in the reference state, mm.
    pub(super) fn point_at(&self, place: &Place) -> Point3<f64> {
        self.adaptation.mesh().point(place.element, place.bary).into()
    }

    fn displacement_at(&mut self, place: &Place) -> Vector3<f64> {
        let corners = self.mesh.elements()[place.element as usize];
        let terms = corners.into_iter().zip(place.bary);
        terms.map(|(node, weight)| self.displacement_of(node) * weight).sum()
    }

    pub(super) fn displacement_of(&mut self, node: u32) -> Vector3<f64> {
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

    /// The place of the tip, searched from an element. Among inverted elements, which lie over others, it is the place nearest to the last
    /// one along the needle whose tissue is as far along the needle as the tip.
    pub(super) fn find(&mut self, tip: &Point3<f64>, from: u32) -> Option<Place> {
        let inverted = self.outcome.crushed;
        let found = self.walk(tip, from);
        if self.outcome.crushed == inverted {
            return found;
        }
        let tangent = self.line.at(self.line.length_mm()).tangent.into_inner();
        let last = self.tip.reference;
        let gap = |model: &mut Finite, along: f64| {
            let place = model.walk_at_rest(&(last + tangent * along), from)?;
            let lies = model.point_at(&place) + model.displacement_at(&place);
            Some((tangent.dot(&(tip - lies)), place))
        };
        let forward = gap(self, 0.0)?.0.signum();
        let passed = |gap: f64| gap * forward <= 0.0;
        let places = (1..=SEARCHED).map(|step| f64::from(step) * SEARCH_MM * forward);
        let beyond = |model: &mut Finite, along: f64| gap(model, along).is_none_or(|(gap, _)| passed(gap));
        let (mut near, mut far) = (0.0, places.into_iter().find(|along| beyond(self, *along))?);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (near + far);
            *(if beyond(self, middle) { &mut far } else { &mut near }) = middle;
        }
        gap(self, near).map(|(_, place)| place)
    }

    /// The same in the reference state.
    pub(super) fn walk_at_rest(&self, point: &Point3<f64>, from: u32) -> Option<Place> {
        let nodes = self.adaptation.mesh().nodes();
        search(&self.mesh, point, from, |element| {
            let corners = self.mesh.elements()[element as usize];
            Tetrahedron::new(&corners.map(|node| Point3::from(nodes[node as usize])))
        })
    }
}

/// Goes from an element to the one that holds a point, each time through the face that the point lies farthest beyond, of those that lead
/// on. A point a little outside the mesh gets coordinates in the element at the surface, which extend what that knows.
fn search(
    mesh: &TetMesh,
    point: &Point3<f64>,
    from: u32,
    mut at: impl FnMut(u32) -> Option<Tetrahedron>,
) -> Option<Place> {
    let (mut element, mut before) = (from, NONE);
    for _ in 0..MOST_ELEMENTS {
        let bary = at(element)?.bary(point);
        let mut corners = [0, 1, 2, 3];
        corners.sort_by(|a: &usize, b| bary[*a].total_cmp(&bary[*b]));
        let neighbours = mesh.neighbours()[element as usize];
        let ahead = corners.into_iter().take_while(|corner| bary[*corner] < -SLACK);
        let next = ahead
            .map(|corner| neighbours[corner])
            .find(|next| ![NONE, before].contains(next));
        match next {
            Some(next) => (element, before) = (next, element),
            None => return (bary[corners[0]] >= -BESIDE).then_some(Place { element, bary }),
        }
    }
    None
}
