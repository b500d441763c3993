//! Point location in the deformed tissue.

use std::sync::Arc;

use nalgebra::{Point3, Vector3};

use super::Finite;
use super::place::{Place, Tetrahedron};
use crate::mechanics::mesh::{NONE, TetMesh};

/// Maximum number of elements that a search passes: a substep passes a few.
const MOST_ELEMENTS: usize = 64;
/// Magnitude below which a negative coordinate counts as rounding.
const SLACK: f64 = 1e-10;
/// Maximum distance of a point outside the mesh, as a share of the height of the element there.
const BESIDE: f64 = 0.5;
/// Spacing of the search along the needle among inverted elements, mm.
const SEARCH_MM: f64 = 0.25;
/// Number of search positions to either side.
const SEARCHED: u32 = 80;
/// Bisections between two search positions, to 1e-6 mm.
const HALVINGS: u32 = 18;
/// Maximum number of iterations that map a point to the reference state when only the probe displaces the tissue.
const CARRIES: usize = 8;

impl Finite {
    /// Locates a tip that is in the body for the first time: only the probe displaces the tissue then.
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

    /// Locates a point in the original mesh; for one in the body but beside the mesh, in the element at the nearest face.
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
        self.locate_at_rest(point, nearest?.0)
    }

    /// Returns the position of a place in the reference state, mm.
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

    /// Returns an element with its current corners.
    fn deformed(&mut self, element: u32) -> Option<Tetrahedron> {
        let corners = self.mesh.elements()[element as usize];
        let places = corners.map(|node| {
            let displacement = self.displacement_of(node);
            Point3::from(self.adaptation.mesh().nodes()[node as usize]) + displacement
        });
        Tetrahedron::new(&places)
    }

    /// Walks from an element to the one that contains a point, in the deformed tissue. Returns `None` outside.
    pub(super) fn walk(&mut self, point: &Point3<f64>, from: u32) -> Option<Place> {
        let mesh = Arc::clone(&self.mesh);
        search(&mesh, point, from, |element| {
            let tetrahedron = self.deformed(element)?;
            self.outcome.crushed += usize::from(tetrahedron.volume <= 0.0);
            Some(tetrahedron)
        })
    }

    /// Locates the tip, searching from an element. Among inverted elements, which overlap others, returns the place nearest
    /// to the last one along the needle whose tissue is as far along the needle as the tip.
    pub(super) fn find(&mut self, tip: &Point3<f64>, from: u32) -> Option<Place> {
        let inverted = self.outcome.crushed;
        let found = self.walk(tip, from);
        if self.outcome.crushed == inverted {
            return found;
        }
        let tangent = self.line.at(self.line.length_mm()).tangent.into_inner();
        let last = self.tip.reference;
        let gap = |model: &mut Finite, along: f64| {
            let place = model.locate_at_rest(&(last + tangent * along), from)?;
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

    /// Walks from an element to the one that contains a point, in the reference state.
    pub(super) fn locate_at_rest(&self, point: &Point3<f64>, from: u32) -> Option<Place> {
        let nodes = self.adaptation.mesh().nodes();
        search(&self.mesh, point, from, |element| {
            let corners = self.mesh.elements()[element as usize];
            Tetrahedron::new(&corners.map(|node| Point3::from(nodes[node as usize])))
        })
    }
}

/// Walks from an element to the one that contains a point, each time through the face that the point lies farthest beyond,
/// among those with a neighbour. For a point slightly outside the mesh, returns extrapolated coordinates in the element at
/// the surface.
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
