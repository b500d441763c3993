//! Probe contact: the nodes that touch the probe, and their prescribed displacements.

use faer::MatRef;
use nalgebra::{Isometry3, Point3, Vector3};

use super::reduced::ProbeRow;
use crate::insertion::{ProbeContact, pointed};

/// A probe with its candidate nodes. Nodes beside the cylinder keep their positions across its axis from when the
/// tissue was at rest, and slide along it without friction.
#[derive(Debug)]
pub(super) struct ProbeNodes {
    contact: ProbeContact,
    /// Positions of the candidates in the probe frame when the tissue is at rest, mm.
    nominal: Vec<Point3<f64>>,
    /// Positions of the candidates in the world where no instrument displaces the tissue, mm.
    at_rest: Vec<Point3<f64>>,
    /// Current positions of the candidates, mm.
    places: Vec<Point3<f64>>,
    rows: Vec<ProbeRow>,
    touching: Vec<bool>,
    pub pose: Option<Isometry3<f64>>,
}

impl ProbeNodes {
    pub(super) fn new(contact: ProbeContact, nodes: &[[f64; 3]]) -> ProbeNodes {
        let at_rest: Vec<_> = contact
            .candidates
            .iter()
            .map(|node| Point3::from(nodes[*node as usize]))
            .collect();
        ProbeNodes {
            nominal: at_rest
                .iter()
                .map(|position| contact.nominal.inverse_transform_point(position))
                .collect(),
            places: at_rest.clone(),
            touching: vec![false; at_rest.len()],
            rows: Vec::new(),
            at_rest,
            contact,
            pose: None,
        }
    }

    pub(super) fn nodes(&self) -> &[u32] {
        &self.contact.candidates
    }

    /// Sets where the candidates lie without instruments, mm.
    pub(super) fn lie(&mut self, place: impl Fn(u32) -> Point3<f64>) {
        let candidates = self.contact.candidates.iter();
        self.at_rest
            .iter_mut()
            .zip(candidates)
            .for_each(|(at_rest, node)| *at_rest = place(*node));
    }

    pub(super) fn length_mm(&self) -> f64 {
        self.contact.length_mm
    }

    pub(super) fn rows(&self) -> &[ProbeRow] {
        &self.rows
    }

    /// Returns the number of nodes in contact.
    pub(super) fn touching(&self) -> usize {
        self.rows.len() / 2
    }

    /// Returns, for each candidate, whether it is in contact.
    pub(crate) fn touching_list(&self) -> &[bool] {
        &self.touching
    }

    /// Restores a pose of the probe with the candidates in contact.
    pub(super) fn restore(&mut self, pose: Option<Isometry3<f64>>, touching: &[bool]) {
        self.pose = pose;
        self.touching.copy_from_slice(touching);
        let directions = pose.map(|pose| self.directions(&pose));
        self.constrain(directions);
    }

    fn directions(&self, pose: &Isometry3<f64>) -> [Vector3<f64>; 2] {
        let frame = self.frame(pose);
        [frame.rotation * Vector3::x(), frame.rotation * Vector3::y()]
    }

    /// Writes the constraint rows of the candidates in contact.
    fn constrain(&mut self, directions: Option<[Vector3<f64>; 2]>) {
        self.rows.clear();
        let touching = (0..self.touching.len()).filter(|candidate| self.touching[*candidate]);
        let rows = touching.flat_map(|contact| {
            let directions = directions.into_iter().flatten();
            directions.map(move |direction| ProbeRow { contact, direction })
        });
        self.rows.extend(rows);
    }

    /// Returns the position of a candidate when the probe last moved, mm.
    pub(super) fn place(&self, candidate: usize) -> Point3<f64> {
        self.places[candidate]
    }

    /// Returns the frame that constrains the nodes: it follows the axis of the probe, but does not roll with it.
    fn frame(&self, pose: &Isometry3<f64>) -> Isometry3<f64> {
        let turned = pointed(&self.contact.nominal.rotation, &(pose.rotation * Vector3::z()));
        Isometry3::from_parts(pose.translation, turned)
    }

    /// Moves the probe, or removes it. Returns whether the constrained rows have changed.
    pub(crate) fn move_to(
        &mut self,
        pose: Option<&Isometry3<f64>>,
        condensed: MatRef<'_, f64>,
        forces: &[f64],
    ) -> bool {
        self.find_places(condensed, forces);
        self.pose = pose.copied();
        let frame = pose.map(|pose| self.frame(pose));
        let mut changed = false;
        for (candidate, touching) in self.touching.iter_mut().enumerate() {
            let touches = frame.is_some_and(|frame| {
                let behind = -frame.inverse_transform_point(&self.places[candidate]).z;
                (0.0..=self.contact.length_mm).contains(&behind)
            });
            changed |= touches != *touching;
            *touching = touches;
        }
        let directions = pose.map(|pose| self.directions(pose));
        if let (Some(directions), Some(row)) = (directions, self.rows.first()) {
            changed |= row.direction != directions[0] || self.rows[1].direction != directions[1];
        }
        if changed {
            self.constrain(directions);
        }
        changed
    }

    /// Returns the displacements that the probe prescribes along its rows, mm.
    pub(super) fn displacements(&self) -> impl Iterator<Item = f64> + '_ {
        let frame = self.pose.map(|pose| self.frame(&pose)).unwrap_or_default();
        self.rows.iter().map(move |row| {
            let target = frame * self.nominal[row.contact];
            row.direction.dot(&(target - self.at_rest[row.contact]))
        })
    }

    /// Computes the positions of the candidates under the forces of the last solution on all contacts.
    fn find_places(&mut self, condensed: MatRef<'_, f64>, forces: &[f64]) {
        self.places.clone_from(&self.at_rest);
        for (column, force) in forces.iter().enumerate().filter(|(_, force)| **force != 0.0) {
            for (candidate, position) in self.places.iter_mut().enumerate() {
                (0..3).for_each(|axis| position[axis] += condensed[(3 * candidate + axis, column)] * force);
            }
        }
    }
}
