//! The tip: which element it is in, when it becomes a node, what it meets, and when nodes come off.

use nalgebra::{Isometry3, Point3, Vector3};
use serde::{Deserialize, Serialize};

use super::contact::{Contact, State};
use super::place::{Place, Tetrahedron};
use super::{EventKind, Finite};
use crate::mechanics::insertion::Bone;
use crate::mechanics::mesh::NONE;
use crate::mechanics::needle::{CentreLine, Entry};
use crate::mechanics::tissue::remesh::corner::best_corner;

/// Elements that a search goes through at most: a part of a step passes a few.
const MOST_ELEMENTS: usize = 64;
/// A coordinate this far below zero is rounding.
const SLACK: f64 = 1e-10;
/// Iterations that carry a point back to the reference state when only the probe displaces the tissue.
const CARRIES: usize = 8;

/// Where the tip is.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Tip {
    /// The effective base: where the hand has it, or behind, with the tip at bone.
    pub base: Option<Isometry3<f64>>,
    /// The element it is in, and its region.
    element: Option<(u32, i32)>,
    /// In the reference state, mm.
    reference: Point3<f64>,
    /// Where no corner fitted, mm: it is not tried again there.
    refused: Option<Point3<f64>>,
    bone: Option<Met>,
}

/// Bone that the tip has met.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Met {
    at: Point3<f64>,
    stiffness_n_per_mm: f64,
    penetration_mm: f64,
    /// How far the needle stays behind the hand, mm.
    behind: f64,
}

impl Tip {
    pub fn region(&self) -> Option<i32> {
        self.element.map(|(_, region)| region)
    }

    pub fn in_bone(&self) -> bool {
        self.bone.is_some()
    }

    /// The base that a hand which has it here can bring about.
    pub fn held(&self, base: &Isometry3<f64>) -> Isometry3<f64> {
        let behind = self.bone.map_or(0.0, |bone| bone.behind);
        let mut held = *base;
        held.translation.vector -= base.rotation * Vector3::z() * behind;
        held
    }

    /// What bone does to the tip, N: it grows with how far the hand would have the tip in it.
    pub fn bone_force(&self, line: &CentreLine) -> Vector3<f64> {
        let Some(bone) = self.bone else { return Vector3::zeros() };
        let tangent = line.at(line.length_mm()).tangent;
        let depth = tangent.dot(&(line.tip() - bone.at)) + bone.behind;
        tangent.into_inner() * (-bone.stiffness_n_per_mm * depth.max(0.0))
    }
}

impl Finite {
    /// Takes off the nodes that the tip has come back past. Whether there were any.
    pub(super) fn release(&mut self) -> bool {
        let length = self.line.length_mm();
        let mut released = false;
        while self.contacts.last().is_some_and(|contact| contact.arc > length) {
            let Some(contact) = self.contacts.pop() else { break };
            self.forces.pop();
            self.memory.starts.pop();
            if self.adaptation.restore(contact.node).is_err() {
                self.note(EventKind::NotRemeshed, self.line.tip(), None);
            }
            self.outcome.remeshes += 1;
            released = true;
        }
        if released {
            self.name_contacts();
            if self.contacts.is_empty() {
                self.entry = None;
                self.tip.element = None;
                self.note(EventKind::Out, self.line.tip(), None);
            }
        }
        released
    }

    /// Follows the tip through the tissue. Whether a node was moved to it.
    pub(super) fn advance(&mut self) -> bool {
        self.break_surfaces();
        let tip = self.line.tip();
        let found = match (self.contacts.is_empty(), self.tip.element) {
            (true, _) => self.enter(&tip),
            (false, Some((element, _))) => self.walk(&tip, element),
            (false, None) => None,
        };
        let Some(place) = found else { return false };
        let reference = Point3::from(self.adaptation.mesh().point(place.element, place.bary));
        let region = self.mesh.regions()[place.element as usize];
        let before = self.tip.region();
        self.tip.element = Some((place.element, region));
        self.tip.reference = reference;
        if self.contacts.is_empty() {
            return self.pierce(&place, &tip);
        }
        self.lay_path(region);
        let mut surface = None;
        if before != Some(region) {
            self.note(EventKind::Region, tip, Some(region));
            let ahead = self.interactions.of(region);
            surface = (ahead.puncture_n > ahead.cutting_n).then_some(ahead.puncture_n);
        }
        if let Some(bone) = self.interactions.of(region).bone {
            self.meet(&bone, &tip, region);
            return false;
        }
        if self.wants_node(&place, surface.is_some()) {
            self.remesh(&place, surface, region)
        } else {
            false
        }
    }

    /// The path in front of the last node grows, or shrinks.
    fn lay_path(&mut self, region: i32) {
        let length = self.line.length_mm();
        let Some(last) = self.contacts.last_mut() else { return };
        let ahead = length - last.arc;
        let laid: f64 = last.layers.iter().map(|layer| layer.length).sum();
        if ahead > laid {
            last.lengthen(region, ahead - laid)
        } else {
            last.shorten(ahead)
        }
    }

    /// Whether the tip has left the elements around the last node, or a surface stands before it, and is far enough from it.
    fn wants_node(&self, place: &Place, surface: bool) -> bool {
        let Some(last) = self.contacts.last() else { return false };
        let corners = self.mesh.elements()[place.element as usize];
        let apart = self.line.length_mm() - last.arc;
        let elsewhere = !corners.contains(&last.node) || surface;
        let tried = self
            .tip
            .refused
            .is_some_and(|refused| (refused - self.tip.reference).norm() < self.options.spacing_mm / 4.0);
        elsewhere && apart >= self.options.spacing_mm && !tried
    }

    /// Moves a corner to the tip.
    fn remesh(&mut self, place: &Place, surface: Option<f64>, region: i32) -> bool {
        let tip = self.tip.reference;
        let moved = self.move_corner(place.element, tip, |_| true);
        let Some(node) = moved else {
            self.tip.refused = Some(tip);
            self.note(EventKind::NotRemeshed, self.line.tip(), Some(region));
            return false;
        };
        let state = match (surface, self.contacts.last()) {
            (None, Some(last)) => last.state,
            _ => State::Stuck,
        };
        self.add_contact(node, self.line.length_mm(), state, surface, region);
        true
    }

    /// Makes the best of some corners a node at a point of the reference state. Which; none if none fits.
    fn move_corner(&mut self, element: u32, to: Point3<f64>, may: impl Fn(u32) -> bool) -> Option<u32> {
        let (contacts, press) = (&self.contacts, &self.press);
        let taken = |node: u32| {
            let on_needle = contacts.iter().any(|contact| contact.node == node);
            let on_probe = press.as_ref().is_some_and(|press| press.nodes().contains(&node));
            on_needle || on_probe || !may(node)
        };
        let corner = best_corner(self.adaptation.mesh(), element, to.into(), taken).ok()?;
        if corner.condition > self.options.condition_limit {
            return None;
        }
        self.adaptation.move_node(corner.node, to.into()).ok()?;
        self.outcome.remeshes += 1;
        Some(corner.node)
    }

    fn add_contact(&mut self, node: u32, arc: f64, state: State, surface: Option<f64>, region: i32) {
        self.contacts.push(Contact {
            node,
            reference: Point3::from(self.adaptation.mesh().nodes()[node as usize]),
            arc,
            state,
            surface,
            region,
            drift: -1.0,
            layers: Vec::new(),
            sliding: [0.0; 2],
            holding: [0.0; 2],
        });
        self.forces.push(Vector3::zeros());
        self.memory.starts.push(arc);
        self.tip.refused = None;
        self.name_contacts();
    }

    /// Names the contacts to the remesher: those of the probe, then those of the needle.
    pub(super) fn name_contacts(&mut self) {
        let dofs = &mut self.memory.dofs;
        dofs.clear();
        let (mesh, remesher) = self.adaptation.parts();
        let probe = self.press.iter().flat_map(|press| press.nodes());
        let nodes = probe.copied().chain(self.contacts.iter().map(|contact| contact.node));
        dofs.extend(nodes.flat_map(|node| mesh.dofs().of(node)).map(|dof| dof as usize));
        if let Err(error) = remesher.set_contacts(dofs) {
            unreachable!("contacts are free nodes, each once: {error}");
        }
        self.version += 1;
    }

    /// The tip goes through the skin: the first node, on the surface where the needle crosses it.
    fn pierce(&mut self, place: &Place, tip: &Point3<f64>) -> bool {
        let tangent = self.line.at(self.line.length_mm()).tangent;
        let Some((skin, face, depth)) = self.back_to_surface(place, tip, &-tangent.into_inner()) else {
            return false;
        };
        let point = tip - tangent.into_inner() * depth;
        let region = self.mesh.regions()[skin.element as usize];
        let ahead = self.interactions.of(region);
        let at = Point3::from(self.adaptation.mesh().point(skin.element, skin.bary));
        let inner = self.mesh.elements()[skin.element as usize][face];
        let length = self.line.length_mm();
        let on_surface = self
            .move_corner(skin.element, at, |node| node != inner)
            .map(|node| (node, length - depth));
        // Where no corner of the face can be moved along it, the tip becomes a node inside.
        let made = on_surface.or_else(|| {
            let node = self.move_corner(place.element, self.tip.reference, |_| true)?;
            Some((node, length))
        });
        let Some((node, arc)) = made else {
            self.note(EventKind::NotRemeshed, *tip, Some(region));
            self.tip.element = None;
            return false;
        };
        self.note(EventKind::Skin, point, Some(region));
        self.entry = Some(Entry {
            point_mm: point,
            direction: tangent,
        });
        let surface = (ahead.puncture_n > ahead.cutting_n).then_some(ahead.puncture_n);
        self.add_contact(node, arc, State::Stuck, surface, region);
        if let Some(bone) = ahead.bone {
            self.meet(&bone, &point, region);
        }
        true
    }

    fn meet(&mut self, bone: &Bone, at: &Point3<f64>, region: i32) {
        if self.tip.bone.is_none() {
            self.tip.bone = Some(Met {
                at: *at,
                stiffness_n_per_mm: bone.stiffness_n_per_mm,
                penetration_mm: bone.penetration_mm,
                behind: 0.0,
            });
            self.note(EventKind::Bone, *at, Some(region));
        }
    }

    /// Keeps the tip from going deeper into bone than it may, and forgets bone that it has left. Whether the base is elsewhere now.
    pub(super) fn hold_at_bone(&mut self) -> bool {
        let Some(bone) = &mut self.tip.bone else { return false };
        let tangent = self.line.at(self.line.length_mm()).tangent;
        let asked = tangent.dot(&(self.line.tip() - bone.at)) + bone.behind;
        let behind = (asked - bone.penetration_mm).max(0.0);
        let moved = behind != bone.behind;
        bone.behind = behind;
        if asked < 0.0 {
            self.tip.bone = None;
        }
        moved
    }

    /// Where the tip is when it is in the body for the first time: only the probe displaces the tissue then.
    fn enter(&mut self, tip: &Point3<f64>) -> Option<Place> {
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
        self.gather(place.element);
        let corners = self.mesh.elements()[place.element as usize];
        let terms = corners.iter().zip(place.bary);
        terms
            .map(|(node, weight)| Vector3::from(self.nearby.of(*node).unwrap_or_default()) * weight)
            .sum()
    }

    fn gather(&mut self, element: u32) {
        let gathered = self
            .nearby
            .gather(&mut self.adaptation, &self.carried, element, self.version);
        if let Err(error) = gathered {
            unreachable!("rows and columns are free degrees of freedom: {error}");
        }
    }

    /// The element as it lies now.
    fn deformed(&mut self, element: u32) -> Option<Tetrahedron> {
        let corners = self.mesh.elements()[element as usize];
        if corners.iter().any(|node| self.nearby.of(*node).is_none()) {
            self.gather(element);
        }
        let nodes = self.adaptation.mesh().nodes();
        let place = |node: u32| {
            let displacement = self.nearby.of(node).unwrap_or_default();
            Point3::from(nodes[node as usize]) + Vector3::from(displacement)
        };
        Tetrahedron::new(&corners.map(place))
    }

    /// From an element to the one that holds a point, in the tissue as it lies now. None outside.
    fn walk(&mut self, point: &Point3<f64>, from: u32) -> Option<Place> {
        self.gather(from);
        let mut element = from;
        for _ in 0..MOST_ELEMENTS {
            let tetrahedron = self.deformed(element)?;
            if tetrahedron.volume <= 0.0 {
                self.outcome.crushed += 1;
            }
            let bary = tetrahedron.bary(point);
            let (corner, least) = (0..4).map(|at| (at, bary[at])).min_by(|a, b| a.1.total_cmp(&b.1))?;
            if least >= -SLACK {
                return Some(Place { element, bary });
            }
            element = self.mesh.neighbours()[element as usize][corner];
            if element == NONE {
                return None;
            }
        }
        None
    }

    /// Back along a direction to where the tissue begins: the place there, the corner opposite the surface, and how far (mm).
    fn back_to_surface(
        &mut self,
        place: &Place,
        from: &Point3<f64>,
        direction: &Vector3<f64>,
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
            if next == NONE {
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

    /// Leaves a seed at the tip, if it is in tissue.
    pub(super) fn deposit(&mut self) {
        let Some((_, region)) = self.tip.element.filter(|_| !self.contacts.is_empty()) else {
            return;
        };
        self.seeds.push(self.tip.reference);
        self.note(EventKind::Seed, self.line.tip(), Some(region));
    }

    /// Reads ahead the columns of the nodes around a path.
    pub(super) fn fetch_along(&mut self, from: &Point3<f64>, direction: &Vector3<f64>, length_mm: f64) {
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
            if (middle - (from + direction * along)).norm() <= size {
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
