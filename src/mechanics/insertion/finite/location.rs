//! Point location in the deformed tissue.

use std::sync::Arc;

use nalgebra::{Matrix3, Point3, Vector3};
use serde::{Deserialize, Serialize};

use super::tissue::Tissue;
use crate::insertion::Anatomy;
use crate::insertion::living::Living;
use crate::needle::CentreLine;
use insonify_mesh::{NO_ELEMENT, TetMesh};

/// Maximum number of elements that a search passes: a substep passes a few.
const MAX_ELEMENTS: usize = 64;
/// Magnitude below which a negative coordinate counts as rounding.
const SLACK: f64 = 1e-10;
/// Maximum distance of a point outside the mesh, as a share of the height of the element there.
const BESIDE: f64 = 4.0;
/// Spacing of the search along the needle among inverted elements, mm.
const SEARCH_MM: f64 = 0.25;
/// Number of search positions to either side.
const SEARCHED: u32 = 80;
/// Bisections between two search positions, to 1e-6 mm.
const HALVINGS: u32 = 18;
/// Maximum number of iterations that map a point to the reference state when only the probe displaces the tissue.
const ENTRY_ITERATIONS: usize = 8;

/// A point in an element, by barycentric coordinates.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Place {
    pub element: u32,
    pub bary: [f64; 4],
}

impl Place {
    /// Returns the shares of the corners in a force at the point: those of the nearest point in the element.
    pub(super) fn shares(&self) -> [f64; 4] {
        let shares = self.bary.map(|share| share.max(0.0));
        let sum: f64 = shares.iter().sum();
        shares.map(|share| share / sum)
    }

    /// Returns whether the point is in its element rather than extrapolated beside the mesh.
    pub(super) fn is_inside(&self) -> bool {
        self.bary.iter().all(|share| *share >= -1e-9)
    }
}

/// An element with its current corners.
pub(super) struct Tetrahedron {
    origin: Point3<f64>,
    /// Gradients of the barycentric coordinates 1 to 3 as rows, 1/mm.
    gradients: Matrix3<f64>,
    pub volume: f64,
}

impl Tetrahedron {
    /// Returns `None` for an element without volume.
    pub(super) fn new(corners: &[Point3<f64>; 4]) -> Option<Tetrahedron> {
        let edges = Matrix3::from_columns(&[1, 2, 3].map(|corner: usize| corners[corner] - corners[0]));
        let volume = edges.determinant() / 6.0;
        let gradients = edges.try_inverse()?;
        gradients.iter().all(|x| x.is_finite()).then_some(Tetrahedron {
            origin: corners[0],
            gradients,
            volume,
        })
    }

    pub(super) fn bary(&self, p: &Point3<f64>) -> [f64; 4] {
        let [a, b, c] = (self.gradients * (p - self.origin)).into();
        [1.0 - (a + b + c), a, b, c]
    }

    /// Returns the derivatives of the barycentric coordinates along a direction, 1/mm.
    pub(super) fn rates(&self, direction: &Vector3<f64>) -> [f64; 4] {
        let [a, b, c] = (self.gradients * direction).into();
        [-(a + b + c), a, b, c]
    }

    /// Returns the distance (mm) at which a ray from inside leaves, and the corner opposite the face that it leaves
    /// through.
    pub(super) fn exit(&self, from: &Point3<f64>, direction: &Vector3<f64>) -> Option<(f64, usize)> {
        let (bary, rates) = (self.bary(from), self.rates(direction));
        let leaves = (0..4).filter(|corner| rates[*corner] < 0.0);
        let distances = leaves.map(|corner| ((bary[corner] / -rates[corner]).max(0.0), corner));
        distances.min_by(|a, b| a.0.total_cmp(&b.0))
    }
}

impl Tissue {
    /// Locates a tip that is in the body for the first time: only the probe and its own motion displace the tissue then.
    pub(super) fn enter(&mut self, anatomy: &dyn Anatomy, tip: &Point3<f64>) -> Option<Place> {
        if self.probe.is_none() && self.living.is_none() {
            return self.place_at_rest(anatomy, tip, NO_ELEMENT);
        }
        let own = self.own_near(tip);
        let mut place = self.place_at_rest(anatomy, &(tip - own), NO_ELEMENT)?;
        for _ in 0..ENTRY_ITERATIONS {
            let point = tip - self.displacement_at(&place, &Vector3::zeros());
            let next = self.place_at_rest(anatomy, &point, place.element)?;
            let shift = self.point_at(&next) - self.point_at(&place);
            place = next;
            if shift.norm() < SLACK {
                break;
            }
        }
        self.search(tip, &Vector3::zeros(), place.element)
    }

    /// Returns the displacement of the surface nearest to a point by the tissue's own motion, mm.
    fn own_near(&self, point: &Point3<f64>) -> Vector3<f64> {
        let shifts = self.surface.iter().map(|(element, centre)| {
            let shift = self.own(centre, *element, Living::displacement);
            ((centre + shift - point).norm_squared(), shift)
        });
        let nearest = shifts.min_by(|a, b| a.0.total_cmp(&b.0));
        nearest.map_or_else(Vector3::zeros, |(_, shift)| shift)
    }

    /// Locates a point in the original mesh; for one in the body but beside the mesh, in the element at the nearest
    /// face.
    fn place_at_rest(&self, anatomy: &dyn Anatomy, point: &Point3<f64>, from: u32) -> Option<Place> {
        let hit = self.locator.locate((*point).into(), from);
        if hit.element != NO_ELEMENT {
            let (element, bary) = (hit.element, hit.bary);
            return Some(Place { element, bary });
        }
        anatomy.region(point)?;
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

    /// Returns where the tissue at a place lies without the dent along the needle's `tangent`, mm.
    pub(super) fn lies(&mut self, place: &Place, tangent: &Vector3<f64>) -> Point3<f64> {
        self.point_at(place) + self.displacement_at(place, tangent)
    }

    fn displacement_at(&mut self, place: &Place, tangent: &Vector3<f64>) -> Vector3<f64> {
        let corners = self.mesh.elements()[place.element as usize];
        let terms = corners.into_iter().zip(place.bary);
        terms
            .map(|(node, weight)| self.displacement_without_dent(node, tangent) * weight)
            .sum()
    }

    /// Returns an element with its corners where they lie without the dent.
    fn deformed(&mut self, element: u32, tangent: &Vector3<f64>) -> Option<Tetrahedron> {
        let corners = self.mesh.elements()[element as usize];
        let places = corners.map(|node| {
            let displacement = self.displacement_without_dent(node, tangent);
            Point3::from(self.adaptation.mesh().nodes()[node as usize]) + displacement
        });
        Tetrahedron::new(&places)
    }

    /// Locates a point in the tissue as it lies without the dent, searching from an element. Returns `None` outside.
    fn search(&mut self, point: &Point3<f64>, tangent: &Vector3<f64>, from: u32) -> Option<Place> {
        let mesh = Arc::clone(&self.mesh);
        search(&mesh, point, from, |element| {
            let tetrahedron = self.deformed(element, tangent)?;
            self.crushed += usize::from(tetrahedron.volume <= 0.0);
            Some(tetrahedron)
        })
    }

    /// Locates the tip of a needle that dents the tissue there by `dent_mm`, searching from an element. Among inverted
    /// elements, which overlap others, returns the place nearest to `last` (reference state) along the needle whose
    /// tissue is as far along the needle as the tip.
    pub(super) fn locate_tip(
        &mut self,
        line: &CentreLine,
        dent_mm: f64,
        last: Point3<f64>,
        from: u32,
    ) -> Option<Place> {
        let tangent = line.point_at_arc(line.length_mm()).tangent.into_inner();
        let (tip, inverted) = (line.tip() - tangent * dent_mm, self.crushed);
        let place = self.search(&tip, &tangent, from);
        let inside = self.element_inside(place.as_ref(), &last);
        let place = inside.and_then(|from| self.search(&tip, &tangent, from)).or(place);
        if self.crushed == inverted {
            return place;
        }
        // Inverted elements overlap: the place found may be far from where the tip has come from. Instead, the tissue
        // along the needle's way is bracketed where it passes the tip, and bisected.
        let gap = |tissue: &mut Tissue, distance_mm: f64| {
            let place = tissue.locate_at_rest(&(last + tangent * distance_mm), from)?;
            Some((tangent.dot(&(tip - tissue.lies(&place, &tangent))), place))
        };
        let forward = gap(self, 0.0)?.0.signum();
        let passed = |gap: f64| gap * forward <= 0.0;
        let places = (1..=SEARCHED).map(|step| f64::from(step) * SEARCH_MM * forward);
        let beyond =
            |tissue: &mut Tissue, distance_mm: f64| gap(tissue, distance_mm).is_none_or(|(gap, _)| passed(gap));
        let (mut near, mut far) = (0.0, places.into_iter().find(|distance_mm| beyond(self, *distance_mm))?);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (near + far);
            *(if beyond(self, middle) { &mut far } else { &mut near }) = middle;
        }
        gap(self, near).map(|(_, place)| place)
    }

    /// Locates a point in the reference state, searching from an element.
    pub(super) fn locate_at_rest(&self, point: &Point3<f64>, from: u32) -> Option<Place> {
        let nodes = self.adaptation.mesh().nodes();
        let search_from = |from| {
            search(&self.mesh, point, from, |element| {
                let corners = self.mesh.elements()[element as usize];
                Tetrahedron::new(&corners.map(|node| Point3::from(nodes[node as usize])))
            })
        };
        let place = search_from(from);
        let inside = self.element_inside(place.as_ref(), point);
        inside.and_then(search_from).or(place)
    }

    /// Returns the element of the original mesh near which a search that has ended beside the mesh starts again: the way
    /// of a search does not lead around a notch of the surface.
    fn element_inside(&self, place: Option<&Place>, near: &Point3<f64>) -> Option<u32> {
        let is_beside = place.is_none_or(|place| !place.is_inside());
        let hit = is_beside.then(|| self.locator.locate((*near).into(), NO_ELEMENT));
        hit.map(|hit| hit.element).filter(|element| *element != NO_ELEMENT)
    }
}

/// Steps from an element to the one that contains a point, each time through the face that the point lies farthest
/// beyond, among those with a neighbour. For a point slightly outside the mesh, returns extrapolated coordinates in the
/// element at the surface.
fn search(
    mesh: &TetMesh,
    point: &Point3<f64>,
    from: u32,
    mut tetrahedron: impl FnMut(u32) -> Option<Tetrahedron>,
) -> Option<Place> {
    let (mut element, mut before) = (from, NO_ELEMENT);
    for _ in 0..MAX_ELEMENTS {
        let bary = tetrahedron(element)?.bary(point);
        let mut corners = [0, 1, 2, 3];
        corners.sort_by(|a: &usize, b| bary[*a].total_cmp(&bary[*b]));
        let neighbours = mesh.neighbours()[element as usize];
        let beyond = corners.into_iter().take_while(|corner| bary[*corner] < -SLACK);
        let next = beyond
            .map(|corner| neighbours[corner])
            .find(|next| ![NO_ELEMENT, before].contains(next));
        match next {
            Some(next) => (element, before) = (next, element),
            None => return (bary[corners[0]] >= -BESIDE).then_some(Place { element, bary }),
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coordinates_and_exits_of_a_corner_of_a_cube() {
        let corners = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 2.0]].map(Point3::from);
        let tetrahedron = Tetrahedron::new(&corners).unwrap();
        assert!((tetrahedron.volume - 8.0 / 6.0).abs() < 1e-15);
        assert_eq!(tetrahedron.bary(&Point3::new(0.5, 0.5, 0.5)), [0.25; 4]);
        let (distance, face) = tetrahedron.exit(&Point3::new(0.5, 0.5, 0.5), &Vector3::x()).unwrap();
        assert_eq!((distance, face), (0.5, 0));
        let (distance, face) = tetrahedron.exit(&Point3::new(0.5, 0.5, 0.5), &-Vector3::y()).unwrap();
        assert_eq!((distance, face), (0.5, 2));
        let flat = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [1.0, 1.0, 0.0]].map(Point3::from);
        assert!(Tetrahedron::new(&flat).is_none());
    }
}
