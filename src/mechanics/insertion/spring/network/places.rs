//! Point location in the tissue, and moves of nodes to other rest positions.

use nalgebra::Vector3;

use super::Network;
use crate::mechanics::insertion::spring::geometry::{self, Simplex};
use crate::mechanics::mesh::NONE;

/// Share of an element's volume at home below which a move is refused.
const FLATTEST: f64 = 0.02;
/// Number of elements that a walk to a point passes before all of them are tried.
const LONGEST_WALK: usize = 64;
/// Barycentric tolerance for a point inside an element.
const SLACK: f64 = 1e-9;

impl Network {
    /// Returns the current position of a node, mm.
    pub fn now(&self, node: u32) -> Vector3<f64> {
        self.reference[node as usize] + self.displacement[node as usize]
    }

    /// Returns the current corners of an element.
    pub fn corners(&self, element: u32) -> [Vector3<f64>; 4] {
        self.elements[element as usize].map(|node| self.now(node))
    }

    pub(super) fn at_rest(&self, element: u32) -> [Vector3<f64>; 4] {
        self.elements[element as usize].map(|node| self.reference[node as usize])
    }

    /// Returns the reference position of the point of an element with these coordinates.
    pub fn to_reference(&self, element: u32, coordinates: &[f64; 4]) -> Vector3<f64> {
        geometry::mix(coordinates, &self.at_rest(element))
    }

    /// Returns the length of the shortest edge, mm.
    pub fn shortest_edge_mm(&self) -> f64 {
        let lengths = self
            .topology
            .edges
            .iter()
            .map(|[a, b]| (self.home[*a as usize] - self.home[*b as usize]).norm());
        lengths.fold(f64::INFINITY, f64::min)
    }

    /// Counts the inverted elements around these nodes, each once.
    pub fn crushed(&self, nodes: impl Iterator<Item = u32> + Clone) -> usize {
        let about = |node: u32| self.around(node).iter().map(move |&element| (node, element));
        let inverted = nodes.clone().flat_map(about).filter(|&(node, element)| {
            // Counted at the node that comes first.
            let corners = self.elements[element as usize];
            let first = nodes.clone().find(|node| corners.contains(node));
            first == Some(node) && geometry::volume(&self.corners(element)) <= 0.0
        });
        inverted.count()
    }

    /// Returns the elements around a node.
    pub fn around(&self, node: u32) -> &[u32] {
        self.topology.elements_of_node.of(node)
    }

    /// Finds the element that contains a point now, and the point's coordinates there. Walks from `start`; where the walk
    /// fails (at the surface, or in a fold), takes the element that misses the point least, if it contains it.
    pub fn locate(&self, point: &Vector3<f64>, start: u32) -> Option<(u32, [f64; 4])> {
        let mut element = start;
        for _ in 0..LONGEST_WALK {
            let Some(simplex) = Simplex::new(&self.corners(element)) else {
                break;
            };
            let coordinates = simplex.coordinates(point);
            let (place, lowest) = geometry::least(&coordinates);
            if lowest >= -SLACK {
                return Some((element, coordinates));
            }
            element = self.neighbours[element as usize][place];
            if element == NONE {
                break;
            }
        }
        self.nearest(point, 0..self.elements.len() as u32, Self::corners)
    }

    /// Returns, among some elements, the one that contains a point most deeply, lowest number first.
    fn nearest(
        &self,
        point: &Vector3<f64>,
        among: impl Iterator<Item = u32>,
        corners: impl Fn(&Self, u32) -> [Vector3<f64>; 4],
    ) -> Option<(u32, [f64; 4])> {
        let mut found = None;
        let mut deepest = -SLACK;
        for element in among {
            let Some(simplex) = Simplex::new(&corners(self, element)) else {
                continue;
            };
            let coordinates = simplex.coordinates(point);
            let (_, lowest) = geometry::least(&coordinates);
            if lowest > deepest {
                deepest = lowest;
                found = Some((element, coordinates));
            }
        }
        found
    }

    /// Moves the reference position of a node so that the node is now at a point of one of its elements with these
    /// coordinates: its displacement becomes that of the tissue at the new position. Refused, without change, where an
    /// element would become inverted or flat.
    pub fn take_to(&mut self, node: u32, element: u32, coordinates: &[f64; 4], now: &Vector3<f64>) -> bool {
        let before = self.reference[node as usize];
        let to = self.to_reference(element, coordinates);
        let corners = self.elements[element as usize];
        let velocity = geometry::mix(coordinates, &corners.map(|corner| self.velocity[corner as usize]));
        self.reference[node as usize] = to;
        let sound = self.around(node).iter().all(|&element| {
            let home = self.elements[element as usize].map(|corner| self.home[corner as usize]);
            geometry::volume(&self.at_rest(element)) >= FLATTEST * geometry::volume(&home)
        });
        if !sound {
            self.reference[node as usize] = before;
            return false;
        }
        self.displacement[node as usize] = now - to;
        self.velocity[node as usize] = velocity;
        self.measure_about(node);
        true
    }

    /// Returns a node to its home position, with the displacement of the tissue there. The nodes moved after it must be
    /// home.
    pub fn send_home(&mut self, node: u32) {
        let home = self.home[node as usize];
        if self.reference[node as usize] == home {
            return;
        }
        let around = self.around(node).iter().copied();
        if let Some((element, coordinates)) = self.nearest(&home, around, Self::at_rest) {
            let corners = self.elements[element as usize];
            self.displacement[node as usize] =
                geometry::mix(&coordinates, &corners.map(|corner| self.displacement[corner as usize]));
            self.velocity[node as usize] =
                geometry::mix(&coordinates, &corners.map(|corner| self.velocity[corner as usize]));
        }
        self.reference[node as usize] = home;
        self.measure_about(node);
    }
}
