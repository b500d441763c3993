//! Masses and springs on the edges of the cylinder.
//!
//! A spring has the stiffness k = sum of E V / L^2 over the tetrahedra that share its edge (A. Van Gelder, "Approximate
//! simulation of elastic membranes by triangulated spring meshes", J. Graphics Tools 3, 1998, extended to three
//! dimensions). Where edge directions are evenly distributed this is an isotropic solid of Young's modulus E and, as in
//! all networks of central forces, Poisson's ratio 1/4: the energy density under a strain e is E / 2 times the sum over
//! a tetrahedron's six edges t of (t . e t)^2, whose mean over directions is that of a solid whose Lame parameters are
//! both 0.4 E.
//!
//! A spring responds to the displacements of its ends along its direction at rest, as the finite elements of this crate
//! do: the stiffness changes only where nodes are moved, so that the stable step is known, energy is a quadratic form,
//! and the only equilibrium without a load is the rest position. A node has a quarter of the mass of each of its
//! elements.
//!
//! The time integration is symplectic Euler: velocities from the previous forces, positions from the new velocities.
//! With the mode of highest frequency w, w^2 being bounded by L, and with springs damped by b times their stiffness, it
//! is stable for L (h^2 / 4 + b h / 2) < 1 (from the roots of its characteristic polynomial); undamped, h < 2 / w.
//! Damping by mass is integrated exactly, as if the force were constant in a step, and does not change that bound.

use std::sync::Arc;

use nalgebra::{Isometry3, Point3, Vector3};

use super::cylinder::{Cylinder, MassSpringParameters, Topology};
use super::geometry::{self, Simplex};
use insonify_mesh::NO_ELEMENT;

/// N/mm^2 per kPa.
const MEGAPASCAL: f64 = 1e-3;
/// Tonnes (N s^2/mm) per mm^3, per kg/m^3.
const TONNE_PER_MM3: f64 = 1e-12;
/// Share of the bound on the step that is used, as a margin for rounding.
const SAFETY: f64 = 0.95;

/// Share of an element's original volume below which a move is refused.
const FLATTEST: f64 = 0.02;
/// Number of elements that a search for a point passes before all of them are tried.
const LONGEST_SEARCH: usize = 64;
/// Barycentric tolerance for a point inside an element.
const SLACK: f64 = 1e-9;

/// Masses and springs.
#[derive(Clone, Debug)]
pub(super) struct Network {
    pub elements: Arc<[[u32; 4]]>,
    neighbours: Vec<[u32; 4]>,
    topology: Topology,
    pub fixed: Vec<bool>,
    /// Nodes of the mesh in its own frame, mm.
    in_cylinder: Vec<Vector3<f64>>,
    /// Young's modulus, N/mm^2.
    young: f64,
    /// Density, N s^2/mm^4.
    density: f64,
    /// Ratio of spring damping to stiffness, s.
    spring_damping: f64,
    /// Rate of damping by mass, 1/s.
    damping: f64,
    /// Rest positions before any node is moved, mm.
    pub original: Vec<Vector3<f64>>,
    /// Current rest positions, mm.
    pub reference: Vec<Vector3<f64>>,
    /// Displacements, mm.
    pub displacement: Vec<Vector3<f64>>,
    /// Velocities, mm/s.
    pub velocity: Vec<Vector3<f64>>,
    /// Forces, N.
    pub force: Vec<Vector3<f64>>,
    /// Displacement plus the contribution of damping, mm.
    strain: Vec<Vector3<f64>>,
    /// Masses, N s^2/mm.
    pub mass: Vec<f64>,
    /// Direction of each edge times the root of its stiffness.
    spring: Vec<Vector3<f64>>,
    /// Bound of each node's rows of M^-1 K, 1/s^2.
    bound: Vec<f64>,
    /// Longest stable step with every node at its original position, s. The mass of a node that is moved nearer to
    /// another is increased as a step of this length requires (see [`Network::moving_mass`]).
    pub limit_s: f64,
}

impl Network {
    /// Builds a network at rest, in the frame of the cylinder.
    pub(super) fn new(cylinder: Cylinder, parameters: &MassSpringParameters) -> Network {
        let in_cylinder: Vec<Vector3<f64>> = cylinder.mesh.nodes().iter().map(|&node| node.into()).collect();
        let count = in_cylinder.len();
        let topology = Topology::new(count, cylinder.mesh.elements());
        let zero = vec![Vector3::zeros(); count];
        let mut network = Network {
            elements: cylinder.mesh.elements().into(),
            neighbours: cylinder.mesh.neighbours().to_vec(),
            fixed: cylinder.fixed,
            young: parameters.young_kpa * MEGAPASCAL,
            density: parameters.density_kg_per_m3 * TONNE_PER_MM3,
            spring_damping: parameters.spring_damping_s,
            damping: parameters.damping_per_s,
            original: in_cylinder.clone(),
            reference: in_cylinder.clone(),
            in_cylinder,
            displacement: zero.clone(),
            velocity: zero.clone(),
            force: zero.clone(),
            strain: zero,
            mass: vec![0.0; count],
            spring: vec![Vector3::zeros(); topology.edges.len()],
            bound: vec![0.0; count],
            limit_s: 0.0,
            topology,
        };
        network.place(&Isometry3::identity());
        network
    }

    /// Moves the entire cylinder to another frame, at rest.
    pub(super) fn place(&mut self, frame: &Isometry3<f64>) {
        for (original, in_cylinder) in self.original.iter_mut().zip(&self.in_cylinder) {
            *original = (frame * Point3::from(*in_cylinder)).coords;
        }
        self.reference.copy_from_slice(&self.original);
        self.rest();
        self.measure_all();
        self.limit_s = self.stable_step();
    }

    /// Clears displacements and velocities.
    pub(super) fn rest(&mut self) {
        self.displacement.fill(Vector3::zeros());
        self.velocity.fill(Vector3::zeros());
    }

    /// Computes masses, springs and bounds of all nodes.
    pub(crate) fn measure_all(&mut self) {
        (0..self.mass.len() as u32).for_each(|node| self.measure_mass(node));
        (0..self.spring.len() as u32).for_each(|edge| self.measure_spring(edge));
        (0..self.mass.len() as u32).for_each(|node| self.measure_bound(node));
    }

    /// Computes masses, springs and bounds that depend on one node. Values that depend on no moved node are reproduced
    /// bit for bit.
    fn measure_about(&mut self, node: u32) {
        let around = self.topology.elements_of_node.get(node).len();
        for index in 0..around {
            let element = self.topology.elements_of_node.get(node)[index] as usize;
            self.elements[element]
                .into_iter()
                .for_each(|corner| self.measure_mass(corner));
            self.topology.edges_of_element[element]
                .into_iter()
                .for_each(|edge| self.measure_spring(edge));
        }
        for index in 0..around {
            let element = self.topology.elements_of_node.get(node)[index] as usize;
            self.elements[element]
                .into_iter()
                .for_each(|corner| self.measure_bound(corner));
        }
    }

    fn measure_mass(&mut self, node: u32) {
        let around = self.topology.elements_of_node.get(node).iter();
        let volume: f64 = around.map(|&element| geometry::volume(&self.at_rest(element))).sum();
        self.mass[node as usize] = 0.25 * self.density * volume;
    }

    fn measure_spring(&mut self, edge: u32) {
        let [a, b] = self.topology.edges[edge as usize];
        let direction = self.reference[b as usize] - self.reference[a as usize];
        let around = self.topology.elements_of_edge.get(edge).iter();
        let volume: f64 = around.map(|&element| geometry::volume(&self.at_rest(element))).sum();
        let squared = direction.norm_squared();
        let stiffness = self.young * volume / squared;
        self.spring[edge as usize] = direction * (stiffness / squared).sqrt();
    }

    /// Computes the largest absolute row sum of a node's three rows, over its mass (Gershgorin).
    fn measure_bound(&mut self, node: u32) {
        let mut rows = [Vector3::zeros(); 3];
        let mut others = Vector3::zeros();
        for &edge in self.topology.edges_of_node.get(node) {
            let spring = self.spring[edge as usize];
            for (axis, row) in rows.iter_mut().enumerate() {
                *row += spring * spring[axis];
            }
            let [a, b] = self.topology.edges[edge as usize];
            if !self.fixed[if a == node { b } else { a } as usize] {
                others += spring.abs() * spring.abs().sum();
            }
        }
        let row_sums = Vector3::from(rows.map(|row| row.abs().sum()));
        self.bound[node as usize] = if self.fixed[node as usize] {
            0.0
        } else {
            (row_sums + others).max() / self.mass[node as usize]
        };
    }

    /// Returns the longest step that is stable with every node's own mass, s.
    fn stable_step(&self) -> f64 {
        let bound = self.bound.iter().fold(0.0, |a: f64, &b| a.max(b));
        // The positive root of L (h^2 / 4 + b h / 2) = 1.
        let (b, root) = (self.spring_damping, bound.sqrt());
        SAFETY * 4.0 / (b * bound + root * (b * b * bound + 4.0).sqrt())
    }

    /// Returns the mass with which a node moves in a step of h: its own, or the mass that makes the step stable if that
    /// is larger.
    pub(crate) fn moving_mass(&self, node: u32, h: f64) -> f64 {
        let node = node as usize;
        let h = h / SAFETY;
        let stability = self.bound[node] * (0.25 * h * h + 0.5 * self.spring_damping * h);
        self.mass[node] * stability.max(1.0)
    }

    /// Returns the factors of a step of h on a velocity, and on the gain in velocity by a force, under damping by mass.
    fn decay(&self, h: f64) -> [f64; 2] {
        let lost = self.damping * h;
        let gained = if lost > 0.0 { -(-lost).exp_m1() / lost } else { 1.0 };
        [(-lost).exp(), gained]
    }

    /// Returns the displacement of a node by one newton in a step of h, mm/N.
    pub(super) fn reach(&self, node: u32, h: f64) -> f64 {
        let [_, gained] = self.decay(h);
        gained * h * h / self.moving_mass(node, h)
    }

    /// Computes the forces of the springs and their damping on the nodes.
    pub(crate) fn find_forces(&mut self) {
        let moving = self.displacement.iter().zip(&self.velocity);
        for (strain, (displacement, velocity)) in self.strain.iter_mut().zip(moving) {
            *strain = displacement + velocity * self.spring_damping;
        }
        self.force.fill(Vector3::zeros());
        for (spring, [a, b]) in self.spring.iter().zip(&self.topology.edges) {
            let [a, b] = [*a as usize, *b as usize];
            let force = spring * spring.dot(&(self.strain[b] - self.strain[a]));
            self.force[a] += force;
            self.force[b] -= force;
        }
    }

    /// Moves every node that is not fixed by the current forces.
    pub(super) fn advance(&mut self, h: f64) {
        let [left, gained] = self.decay(h);
        for node in 0..self.mass.len() {
            if !self.fixed[node] {
                let gain = gained * h / self.moving_mass(node as u32, h);
                self.velocity[node] = self.velocity[node] * left + self.force[node] * gain;
                self.displacement[node] += self.velocity[node] * h;
            }
        }
    }

    /// Returns the elastic and kinetic energy, N mm.
    pub(super) fn energy(&self) -> f64 {
        let springs = self.spring.iter().zip(&self.topology.edges);
        let elastic = springs.map(|(spring, [a, b])| {
            let stretch = self.displacement[*b as usize] - self.displacement[*a as usize];
            spring.dot(&stretch).powi(2)
        });
        let moving = self.mass.iter().zip(&self.velocity);
        let kinetic = moving.map(|(mass, velocity)| mass * velocity.norm_squared());
        0.5 * (elastic.sum::<f64>() + kinetic.sum::<f64>())
    }

    /// Returns the current position of a node, mm.
    pub(super) fn now(&self, node: u32) -> Vector3<f64> {
        self.reference[node as usize] + self.displacement[node as usize]
    }

    /// Returns the current corners of an element.
    pub(super) fn corners(&self, element: u32) -> [Vector3<f64>; 4] {
        self.elements[element as usize].map(|node| self.now(node))
    }

    fn at_rest(&self, element: u32) -> [Vector3<f64>; 4] {
        self.elements[element as usize].map(|node| self.reference[node as usize])
    }

    /// Returns the reference position of the point of an element with these coordinates.
    pub(super) fn to_reference(&self, element: u32, coordinates: &[f64; 4]) -> Vector3<f64> {
        geometry::mix(coordinates, &self.at_rest(element))
    }

    /// Returns the length of the shortest edge, mm.
    pub(crate) fn shortest_edge_mm(&self) -> f64 {
        let lengths = self
            .topology
            .edges
            .iter()
            .map(|[a, b]| (self.original[*a as usize] - self.original[*b as usize]).norm());
        lengths.fold(f64::INFINITY, f64::min)
    }

    /// Counts the inverted elements around these nodes, each once.
    pub(super) fn crushed(&self, nodes: impl Iterator<Item = u32> + Clone) -> usize {
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
    pub(super) fn around(&self, node: u32) -> &[u32] {
        self.topology.elements_of_node.get(node)
    }

    /// Finds the element that contains a point now, and the point's coordinates there. Steps from `start` from element
    /// to element; where that fails (at the surface, or in a fold), takes the element that misses the point least, if
    /// it contains it.
    pub(super) fn locate(&self, point: &Vector3<f64>, start: u32) -> Option<(u32, [f64; 4])> {
        let mut element = start;
        for _ in 0..LONGEST_SEARCH {
            let Some(simplex) = Simplex::new(&self.corners(element)) else {
                break;
            };
            let coordinates = simplex.coordinates(point);
            let (lowest_corner, lowest) = geometry::least(&coordinates);
            if lowest >= -SLACK {
                return Some((element, coordinates));
            }
            element = self.neighbours[element as usize][lowest_corner];
            if element == NO_ELEMENT {
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
        let mut inside = None;
        let mut deepest = -SLACK;
        for element in among {
            let Some(simplex) = Simplex::new(&corners(self, element)) else {
                continue;
            };
            let coordinates = simplex.coordinates(point);
            let (_, lowest) = geometry::least(&coordinates);
            if lowest > deepest {
                deepest = lowest;
                inside = Some((element, coordinates));
            }
        }
        inside
    }

    /// Moves the reference position of a node so that the node is now at a point of one of its elements with these
    /// coordinates: its displacement becomes that of the tissue at the new position. Refused, without change, where an
    /// element would become inverted or flat.
    pub(crate) fn take_to(&mut self, node: u32, element: u32, coordinates: &[f64; 4], now: &Vector3<f64>) -> bool {
        let before = self.reference[node as usize];
        let position = self.to_reference(element, coordinates);
        let corners = self.elements[element as usize];
        let velocity = geometry::mix(coordinates, &corners.map(|corner| self.velocity[corner as usize]));
        self.reference[node as usize] = position;
        let sound = self.around(node).iter().all(|&element| {
            let original = self.elements[element as usize].map(|corner| self.original[corner as usize]);
            geometry::volume(&self.at_rest(element)) >= FLATTEST * geometry::volume(&original)
        });
        if !sound {
            self.reference[node as usize] = before;
            return false;
        }
        self.displacement[node as usize] = now - position;
        self.velocity[node as usize] = velocity;
        self.measure_about(node);
        true
    }

    /// Returns a node to its original position, with the displacement of the tissue there. The nodes moved after it
    /// must be back already.
    pub(super) fn restore(&mut self, node: u32) {
        let original = self.original[node as usize];
        if self.reference[node as usize] == original {
            return;
        }
        let around = self.around(node).iter().copied();
        if let Some((element, coordinates)) = self.nearest(&original, around, Self::at_rest) {
            let corners = self.elements[element as usize];
            self.displacement[node as usize] =
                geometry::mix(&coordinates, &corners.map(|corner| self.displacement[corner as usize]));
            self.velocity[node as usize] =
                geometry::mix(&coordinates, &corners.map(|corner| self.velocity[corner as usize]));
        }
        self.reference[node as usize] = original;
        self.measure_about(node);
    }
}
