//! The deformed tissue: its adapted mesh, the probe that presses it, and the forces of the last solution.

use std::sync::Arc;

use faer::MatMut;
use nalgebra::{Isometry3, Point3, Vector3};

use super::contact::Contact;
use super::contacts::Contacts;
use super::farthest;
use super::location::Place;
use super::probe::ProbeNodes;
use super::reduced::Reduced;
use super::tip::Tip;
use crate::insertion::living::Living;
use crate::insertion::{Field, Snapshot};
use crate::tissue::dofs::NO_DOF;
use crate::tissue::remesh::corner::best_corner;
use crate::tissue::remesh::{Adaptation, RemeshError};
use insonify_mesh::{Locator, TetMesh};

/// Tissue with the forces on it. Buffers are kept from step to step, to avoid allocation.
pub(super) struct Tissue {
    /// The mesh at rest.
    pub mesh: Arc<TetMesh>,
    pub locator: Arc<Locator<f64>>,
    /// Elements at the surface faces at rest, with the face centres (mm).
    pub surface: Vec<(u32, Point3<f64>)>,
    /// Whether each node is on the surface.
    pub on_surface: Vec<bool>,
    pub adaptation: Adaptation,
    pub probe: Option<ProbeNodes>,
    /// Motion of the tissue itself.
    pub living: Option<Living>,
    /// Displacement by it at the needle's contacts and at the tip, mm.
    pub own: Vec<Vector3<f64>>,
    /// Counter of changes to the contacts or the mesh.
    pub version: u64,
    nearby: Nearby,
    /// Forces by degree of freedom that displace the nodes, N: all, and all but that at the tip.
    carried: [Vec<(usize, f64)>; 2],
    /// Forces by degree of freedom on all contacts, N: all, and without that at the tip.
    contact_forces: [Vec<f64>; 2],
    has_tip_force: bool,
    /// Forces on the tissue at the needle's contacts and at the tip, where the mesh is loaded by a share, N.
    pub loads: Vec<Vector3<f64>>,
    dofs: Vec<usize>,
    /// Number of nodes moved in this step.
    pub remeshes: usize,
    /// Number of inverted elements found in this step.
    pub crushed: usize,
}

impl Tissue {
    pub(super) fn new(
        mesh: Arc<TetMesh>,
        locator: Arc<Locator<f64>>,
        adaptation: Adaptation,
        probe: Option<ProbeNodes>,
    ) -> Tissue {
        let mut on_surface = vec![false; mesh.nodes().len()];
        let mut surface = Vec::new();
        for face in mesh.surface() {
            let corners = face.nodes.map(|node| Point3::from(mesh.nodes()[node as usize]));
            let centre = corners.iter().map(|corner| corner.coords).sum::<Vector3<f64>>() / 3.0;
            surface.push((face.element, Point3::from(centre)));
            face.nodes.iter().for_each(|node| on_surface[*node as usize] = true);
        }
        let mut tissue = Tissue {
            mesh,
            locator,
            surface,
            on_surface,
            adaptation,
            probe,
            living: None,
            own: Vec::new(),
            version: 0,
            nearby: Nearby::default(),
            carried: Default::default(),
            contact_forces: Default::default(),
            has_tip_force: false,
            loads: Vec::new(),
            dofs: Vec::new(),
            remeshes: 0,
            crushed: 0,
        };
        tissue.register_contacts(&[], &[]);
        tissue
    }

    /// Returns whether no axis of a node is fixed.
    pub(super) fn is_free(&self, node: u32) -> bool {
        !self.adaptation.mesh().dofs().of(node).contains(&NO_DOF)
    }

    /// Returns the index of a node in the compliance.
    pub(super) fn index_of(&self, node: u32, needle: &[Contact], corners: &[u32]) -> Option<usize> {
        system_nodes(self.probe.as_ref(), needle, corners).position(|listed| listed == node)
    }

    /// Passes the contacts to the remesher: those of the probe, those of the needle, corners at the tip.
    pub(super) fn register_contacts(&mut self, needle: &[Contact], corners: &[u32]) {
        self.dofs.clear();
        let mesh = self.adaptation.mesh();
        let nodes = system_nodes(self.probe.as_ref(), needle, corners);
        let dofs = nodes.flat_map(|node| mesh.dofs().of(node)).map(|dof| dof as usize);
        self.dofs.extend(dofs);
        let dofs = &self.dofs;
        if let Err(error) = self.adaptation.with_fallback(|_, remesher| remesher.set_contacts(dofs)) {
            unreachable!("contacts are free nodes, each once: {error}");
        }
        self.version += 1;
    }

    /// Gathers the forces of a solution by degree of freedom on all contacts: those of the probe, then those of the
    /// needle.
    pub(super) fn take_forces(&mut self, solved: &Reduced, contacts: &Contacts, tip: &Tip) {
        let nodes = contacts.nodes.len();
        self.loads.clone_from(&contacts.forces);
        let row = tip.force.row().filter(|_| contacts.has_others[0]);
        let at_tip = row.map(|_| contacts.forces[nodes] * solved.tip_share());
        self.has_tip_force = at_tip.is_some();
        let probes = self.probe.as_ref().map_or(0, |probe| probe.nodes().len());
        // Last those of all, which stay in `loads`.
        for (without, at_tip) in [(true, at_tip.map(|_| Vector3::zeros())), (false, at_tip)] {
            if let Some(force) = at_tip {
                self.loads[nodes] = force;
            }
            let forces = &mut self.contact_forces[usize::from(without)];
            forces.clear();
            forces.resize(3 * probes, 0.0);
            for (row, force) in solved.probe_forces(&self.loads) {
                for axis in 0..3 {
                    forces[3 * row.contact + axis] += force * row.direction[axis];
                }
            }
            let needle = self.loads.iter().take(nodes);
            forces.extend(needle.flat_map(|force| [force.x, force.y, force.z]));
            forces.resize(forces.len() + 3 * tip.corners.len(), 0.0);
            // The force at the tip acts on the nodes around it, by the shares that gave its compliance.
            if let (Some(row), Some(force)) = (row, at_tip) {
                for (node, share) in row.shares.into_iter().filter(|(_, share)| *share != 0.0) {
                    (0..3).for_each(|axis| forces[3 * node + axis] += share * force[axis]);
                }
            }
        }
        self.carried.iter_mut().for_each(Vec::clear);
        self.nearby.renew();
    }

    /// Ensures that the forces by degree of freedom that displace the nodes are known; `without` that at the tip.
    fn carry(&mut self, without: bool) {
        let set = usize::from(without);
        if !self.carried[set].is_empty() {
            return;
        }
        let remesher = self.adaptation.parts().1;
        if remesher
            .equivalent_forces(&self.contact_forces[set], &mut self.carried[set])
            .is_err()
        {
            unreachable!("one force a contact");
        }
    }

    /// Moves the probe. Returns how far, mm.
    pub(super) fn press(&mut self, pose: Option<&Isometry3<f64>>) -> f64 {
        let Some(probe) = &mut self.probe else { return 0.0 };
        let motion_mm = match (&probe.pose, pose) {
            (Some(before), Some(pose)) => farthest(before, pose, probe.length_mm()),
            (None, None) => 0.0,
            _ => f64::INFINITY,
        };
        if let Some(living) = &self.living {
            let nodes = self.adaptation.mesh().nodes();
            probe.lie(|node| Point3::from(nodes[node as usize]) + living.displacement(node, nodes[node as usize]));
        }
        let condensed = self.adaptation.remesher().condensed();
        if probe.move_to(pose, condensed, &self.contact_forces[0]) {
            self.version += 1;
        }
        motion_mm
    }

    /// Forgets all that was derived from a compliance that may now differ in every entry.
    pub(super) fn forget_compliance(&mut self) {
        self.version += 1;
        self.nearby = Nearby::default();
    }

    /// Returns the sum over the corners of the element at a place at rest of what the tissue's own motion gives for each,
    /// by their weights there; zero without such a motion.
    pub(super) fn own(
        &self,
        at_rest: &Point3<f64>,
        element: u32,
        of_node: impl Fn(&Living, u32, [f64; 3]) -> Vector3<f64>,
    ) -> Vector3<f64> {
        let Some(living) = &self.living else {
            return Vector3::zeros();
        };
        let (element, bary) = self
            .locate_at_rest(at_rest, element)
            .map_or((element, [0.25; 4]), |Place { element, bary }| (element, bary));
        let corners = self.mesh.elements()[element as usize].into_iter().zip(bary);
        let nodes = self.adaptation.mesh().nodes();
        corners
            .map(|(node, weight)| of_node(living, node, nodes[node as usize]) * weight)
            .sum()
    }

    /// Finds the displacements by the tissue's own motion at the contacts and at the tip.
    pub(super) fn find_own(&mut self, contacts: &Contacts, tip: &Tip) {
        let Some(living) = &self.living else { return };
        self.own.clear();
        let nodes = contacts.nodes.iter();
        self.own
            .extend(nodes.map(|contact| living.displacement(contact.node, contact.reference.into())));
        if let (Some(element), false) = (tip.element, tip.force.is_on_bone()) {
            let at_tip = self.own(&tip.reference, element, Living::displacement);
            self.own.push(at_tip);
        }
    }

    /// Returns the displacement of a node by its own motion and under the forces of the last solution, mm.
    pub(super) fn displacement_of(&mut self, node: u32) -> Vector3<f64> {
        self.displacement(node, false)
    }

    /// Returns such a displacement, less that by the force at the tip along
    /// the needle's `tangent`, mm. Across the needle that force and those of the nodes on it hold each other.
    pub(super) fn displacement_without_dent(&mut self, node: u32, tangent: &Vector3<f64>) -> Vector3<f64> {
        let all = self.displacement(node, false);
        if !self.has_tip_force {
            return all;
        }
        let dent = all - self.displacement(node, true);
        all - tangent * tangent.dot(&dent)
    }

    fn displacement(&mut self, node: u32, without: bool) -> Vector3<f64> {
        let forced = self.forced_displacement(node, without);
        let reference = self.adaptation.mesh().nodes()[node as usize];
        let living = self.living.as_ref();
        living.map_or(forced, |living| forced + living.displacement(node, reference))
    }

    fn forced_displacement(&mut self, node: u32, without: bool) -> Vector3<f64> {
        let dofs = self.adaptation.mesh().dofs().of(node);
        if dofs == [NO_DOF; 3] {
            return Vector3::zeros();
        }
        // In most steps all nodes asked for are contacts: the compliance between those is at hand, while to carry the
        // forces costs a product with a matrix of the size of the support.
        if let Some(row) = self.dofs.iter().position(|dof| *dof == dofs[0] as usize) {
            let condensed = self.adaptation.remesher().condensed();
            let forces = &self.contact_forces[usize::from(without)];
            return Vector3::from_fn(|axis, _| {
                let entries = condensed.row(row + axis);
                entries.iter().zip(forces).map(|(entry, force)| entry * force).sum()
            });
        }
        self.carry(without);
        let displacement = self
            .nearby
            .displacement(&mut self.adaptation, &self.carried, without, self.version, node);
        match displacement {
            Ok(displacement) => displacement.into(),
            Err(error) => unreachable!("rows and columns are free degrees of freedom: {error}"),
        }
    }

    /// Moves a node to a point of the reference state, if that spoils no element.
    pub(super) fn move_node(&mut self, node: u32, to: Point3<f64>) -> bool {
        let moved = self.adaptation.move_node(node, to.into()).is_ok();
        self.remeshes += usize::from(moved);
        moved
    }

    /// Returns the best corner of an element to move to a point of the reference state, or `None` if none fits: one
    /// that is permitted and on neither needle nor probe, up to a limit of the Jacobian condition.
    pub(super) fn corner(
        &self,
        element: u32,
        to: Point3<f64>,
        needle: &[Contact],
        condition_limit: f64,
        may: impl Fn(u32) -> bool,
    ) -> Option<u32> {
        let is_taken = |node: u32| {
            let on_needle = needle.iter().any(|contact| contact.node == node);
            let on_probe = self.probe.as_ref().is_some_and(|probe| probe.nodes().contains(&node));
            on_needle || on_probe || !may(node)
        };
        let corner = best_corner(self.adaptation.mesh(), element, to.into(), is_taken).ok()?;
        (corner.condition <= condition_limit).then_some(corner.node)
    }

    /// Prefetches the compliance columns of the nodes within `aside_mm` of a path.
    pub(super) fn prefetch(&mut self, from: &Point3<f64>, direction: &Vector3<f64>, length_mm: f64, aside_mm: f64) {
        let Some(direction) = direction.try_normalize(0.0) else {
            return;
        };
        let mesh = self.adaptation.mesh();
        let mut wanted = vec![false; mesh.nodes().len()];
        for corners in mesh.elements() {
            // Spheres around the elements are enough: a column too many costs a solve, one too few a wait at the step
            // that needs it.
            let places = corners.map(|node| Point3::from(mesh.nodes()[node as usize]));
            let middle =
                Point3::from((places[0].coords + places[1].coords + places[2].coords + places[3].coords) / 4.0);
            let size = places.iter().map(|place| (place - middle).norm()).fold(0.0, f64::max);
            let distance_mm = (middle - from).dot(&direction).clamp(0.0, length_mm);
            if (middle - (from + direction * distance_mm)).norm() <= size + aside_mm {
                for corner in corners {
                    // A remesh changes the stiffness of all elements around the node that it moves, and so of their
                    // nodes.
                    mesh.neighbours(*corner)
                        .iter()
                        .for_each(|node| wanted[*node as usize] = true);
                }
            }
        }
        let nodes = (0..wanted.len() as u32).filter(|node| wanted[*node as usize]);
        let dofs: Vec<usize> = nodes
            .flat_map(|node| mesh.dofs().of(node))
            .filter(|dof| *dof != NO_DOF)
            .map(|dof| dof as usize)
            .collect();
        if let Err(error) = self.adaptation.parts().1.prefetch(&dofs) {
            unreachable!("free degrees of freedom: {error}");
        }
    }

    /// Returns the nodes away from their positions at rest, with their current reference positions.
    pub(super) fn moved(&self) -> Vec<(u32, [f64; 3])> {
        let mesh = self.adaptation.mesh();
        let away = mesh.away().iter();
        away.map(|node| (*node, mesh.nodes()[*node as usize])).collect()
    }

    /// Writes the moved nodes and what determines the displacements.
    pub(super) fn write_snapshot(&mut self, into: &mut Snapshot) {
        into.moved.clear();
        let mesh = self.adaptation.mesh();
        into.moved
            .extend(mesh.away().iter().map(|node| (*node, mesh.nodes()[*node as usize])));
        if self.adaptation.remesher().uses_base_compliance() {
            if !matches!(into.field, Field::BaseForces(_)) {
                into.field = Field::BaseForces(Vec::new());
            }
            self.carry(false);
            if let Field::BaseForces(forces) = &mut into.field {
                forces.clear();
                forces.extend(self.carried[0].iter().map(|(dof, force)| (*dof as u32, *force)));
            }
            return;
        }
        let mut displacement = vec![0.0; mesh.dofs().free()];
        let mut nodes = vec![[0.0; 3]; mesh.nodes().len()];
        let forces = &self.contact_forces[0];
        if let Err(error) = self
            .adaptation
            .with_fallback(|_, remesher| remesher.displacement(forces, &mut displacement))
        {
            unreachable!("one force a contact, one displacement a degree of freedom: {error}");
        }
        self.adaptation.mesh().dofs().scatter(&displacement, &mut nodes);
        into.field = Field::Displacement(nodes);
    }
}

/// Nodes of the compliance in order: probe, needle, corners at the tip.
fn system_nodes<'a>(
    probe: Option<&'a ProbeNodes>,
    needle: &'a [Contact],
    corners: &'a [u32],
) -> impl Iterator<Item = u32> + 'a {
    let probe = probe.into_iter().flat_map(|probe| probe.nodes().iter().copied());
    let needle = needle.iter().map(|contact| contact.node);
    probe.chain(needle).chain(corners.iter().copied())
}

/// State for which entries of the carrier were read.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Key {
    mesh_step: u64,
    contacts: u64,
}

/// A node whose carrier rows were read.
#[derive(Clone, Copy, Debug)]
struct Near {
    node: u32,
    /// Displacements under the current forces, all and all but that at the tip, once computed for them, mm.
    displacement: [Option<[f64; 3]>; 2],
}

/// Cache of displacements of the nodes that the tip passes.
#[derive(Debug, Default)]
struct Nearby {
    key: Option<Key>,
    nodes: Vec<Near>,
    /// Degrees of freedom on which the carried forces act.
    columns: Vec<usize>,
    /// Entries of the carrier, three rows per node.
    rows: Vec<f64>,
}

impl Nearby {
    /// Discards the displacements, after the carried forces have changed.
    pub(crate) fn renew(&mut self) {
        self.nodes.iter_mut().for_each(|near| near.displacement = [None; 2]);
    }

    /// Returns the displacement of a node under the carried forces, or under those `without` that at the tip, mm.
    /// `contacts` is a counter that changes whenever the contacts do.
    pub(crate) fn displacement(
        &mut self,
        adaptation: &mut Adaptation,
        carried: &[Vec<(usize, f64)>; 2],
        without: bool,
        contacts: u64,
        node: u32,
    ) -> Result<[f64; 3], RemeshError> {
        let set = usize::from(without);
        let carried = &carried[set];
        let index = match self.nodes.iter().position(|near| near.node == node) {
            Some(index) if self.holds(adaptation, carried, contacts) => index,
            _ => self.read(adaptation, carried, contacts, node)?,
        };
        if let Some(displacement) = self.nodes[index].displacement[set] {
            return Ok(displacement);
        }
        let columns = self.columns.len();
        let displacement = [0, 1, 2].map(|axis| {
            let row = &self.rows[(3 * index + axis) * columns..][..columns];
            row.iter().zip(carried).map(|(entry, (_, force))| entry * force).sum()
        });
        self.nodes[index].displacement[set] = Some(displacement);
        Ok(displacement)
    }

    /// Returns whether the entries that were read are still valid.
    fn holds(&self, adaptation: &Adaptation, carried: &[(usize, f64)], contacts: u64) -> bool {
        let mesh_step = adaptation.mesh().step();
        self.key == Some(Key { mesh_step, contacts }) && self.columns.iter().eq(carried.iter().map(|(dof, _)| dof))
    }

    /// Reads the rows of a node and returns its index.
    fn read(
        &mut self,
        adaptation: &mut Adaptation,
        carried: &[(usize, f64)],
        contacts: u64,
        node: u32,
    ) -> Result<usize, RemeshError> {
        if !self.holds(adaptation, carried, contacts) {
            self.nodes.clear();
            self.rows.clear();
            self.columns.clear();
            self.columns.extend(carried.iter().map(|(dof, _)| *dof));
            let mesh_step = adaptation.mesh().step();
            self.key = Some(Key { mesh_step, contacts });
        }
        let (index, columns) = (self.nodes.len(), self.columns.len());
        self.rows.truncate(3 * index * columns);
        self.rows.resize(3 * (index + 1) * columns, 0.0);
        let rows = self.rows[3 * index * columns..].chunks_exact_mut(columns.max(1));
        let dofs = adaptation.mesh().dofs().of(node);
        // Fixed degrees of freedom keep zeros.
        for (row, dof) in rows.zip(dofs).filter(|(_, dof)| *dof != NO_DOF) {
            adaptation.with_fallback(|_, remesher| {
                let out = MatMut::from_row_major_slice_mut(row, 1, columns);
                remesher.force_compliance_into(&[dof as usize], &self.columns, out)
            })?;
        }
        self.nodes.push(Near {
            node,
            displacement: [None; 2],
        });
        Ok(index)
    }
}
