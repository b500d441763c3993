//! Stack of shaft nodes, which stay on the needle and slide along it against friction.
//!
//! In a step of h a node moves as if the needle were not there; the force between them brings it back to the needle.
//! Across the shaft its miss is removed entirely. Along the shaft the force is limited by friction: a force F moves a
//! node of mass m by about F h^2 / m in that step, so that a node which friction can keep in place on the shaft sticks,
//! and any other is moved back by as much as friction can. This is Coulomb's law at the end of the step, within its
//! bound by construction and never a source of energy, however long the step.
//!
//! Only forces across the needle bend it: the effect of an axial force on a bent shaft (a column under load) is
//! omitted, since a long needle with hardly any lateral support would buckle under less than it takes to push it in.
//!
//! For a flexible needle, the lateral forces f on it and the deflections that they cause are consistent at the end of
//! the step: with r the distances by which the nodes would miss the shaft under the previous forces, C the needle's
//! flexibility and D the diagonal of h^2 / m, (C + D) f = r + C f_before. So a soft needle in stiff tissue is as stable
//! as a stiff needle in soft tissue.

use nalgebra::{Unit, Vector3};
use serde::{Deserialize, Serialize};

use super::network::Network;
use crate::insertion::Interaction;
use crate::ldl::Ldl;
use crate::needle::{CentreLine, Load, Needle, Row, across};

/// Difference below which two arcs are equal, mm.
pub(super) const SAME_ARC_MM: f64 = 1e-9;

/// A node on the shaft.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Contact {
    pub node: u32,
    /// Arc length from the base, mm.
    pub arc: f64,
    /// Whether the node sticks to the shaft.
    pub stuck: bool,
    /// Region of the node.
    pub region: Option<i32>,
    /// Distance (mm) to the start of another region on the shaft before the next contact, and that region.
    pub beyond: Option<(f64, Option<i32>)>,
    /// Force on the needle, N.
    pub force: Vector3<f64>,
    /// Component of `force` across the shaft, N.
    pub side: Vector3<f64>,
}

/// Motion of the needle, and limits of its force on the last node.
#[derive(Clone, Copy, Debug)]
pub(super) struct Travel {
    pub advancing: bool,
    /// Whether the tip holds no node, so that nodes sliding to it come off.
    pub open: bool,
    /// If the last node is the tip node: the maximum force with which the tip can push it, N.
    pub push: Option<f64>,
}

/// The stack, base first.
#[derive(Clone, Debug)]
pub(super) struct Contacts {
    pub stack: Vec<Contact>,
    before: Vec<Vector3<f64>>,
    tangents: Vec<Unit<Vector3<f64>>>,
    misses: Vec<Vector3<f64>>,
    rows: Vec<Row>,
    /// Response of the needle along `rows`, column by column, mm/N.
    flexibility: Vec<f64>,
    drift: Vec<f64>,
    system: Ldl,
    across: Vec<f64>,
}

impl Contacts {
    pub(super) fn new(capacity: usize) -> Contacts {
        Contacts {
            stack: Vec::with_capacity(capacity),
            before: Vec::with_capacity(capacity),
            tangents: Vec::with_capacity(capacity),
            misses: Vec::with_capacity(capacity),
            rows: Vec::with_capacity(2 * capacity),
            flexibility: Vec::new(),
            drift: Vec::with_capacity(2 * capacity),
            system: Ldl::default(),
            across: Vec::with_capacity(2 * capacity),
        }
    }

    /// Records the positions of the nodes before the tissue moves.
    pub(crate) fn remember(&mut self, network: &Network) {
        self.before.clear();
        let displacements = self
            .stack
            .iter()
            .map(|contact| network.displacement[contact.node as usize]);
        self.before.extend(displacements);
    }

    /// Writes the loads that bend the needle.
    pub(super) fn loads(&self, into: &mut Vec<Load>) {
        into.clear();
        into.extend(self.stack.iter().map(|contact| Load {
            arc_mm: contact.arc,
            force_n: contact.side,
        }));
    }

    /// Returns sliding and holding force of one contact, N: of the shaft from its node to the next, each length by its
    /// own region.
    fn friction(
        &self,
        index: usize,
        tip: f64,
        advancing: bool,
        interaction: impl Fn(Option<i32>) -> Interaction,
    ) -> [f64; 2] {
        let contact = &self.stack[index];
        let from = contact.arc.clamp(0.0, tip);
        let to = self.stack.get(index + 1).map_or(tip, |next| next.arc.clamp(from, tip));
        let border = contact.beyond.map_or(to, |(length, _)| to.min(from + length));
        let cut_mm = if advancing { f64::INFINITY } else { 0.0 };
        let mut forces = [0.0; 2];
        for (region, [from, to]) in [
            (Some(contact.region), [from, border]),
            (contact.beyond.map(|(_, region)| region), [border, to]),
        ] {
            let Some(region) = region else { continue };
            let layer = interaction(region);
            let sliding = layer.shaft_n([tip - to, tip - from], cut_mm);
            forces[0] += sliding;
            forces[1] += sliding * layer.static_ratio;
        }
        forces
    }

    /// Brings the nodes back to the shaft, which lies on `line` under the previous forces. Returns whether the tip node
    /// has slipped back from the tip.
    pub(super) fn solve(
        &mut self,
        network: &mut Network,
        h: f64,
        line: &CentreLine,
        needle: &mut dyn Needle,
        travel: Travel,
        interaction: impl Fn(Option<i32>) -> Interaction,
    ) -> bool {
        self.tangents.clear();
        self.misses.clear();
        let mut cut = false;
        for index in 0..self.stack.len() {
            let contact = self.stack[index];
            let on_shaft = line.point_at_arc(contact.arc);
            let miss = network.now(contact.node) - on_shaft.point_mm.coords;
            let along_mm = miss.dot(&on_shaft.tangent);
            let tip = line.length_mm();
            let [sliding, holding] = self.friction(index, tip, travel.advancing, &interaction);
            let friction = if contact.stuck { holding } else { sliding };
            let is_last = index + 1 == self.stack.len();
            let tip_node = is_last && travel.push.is_some();
            let push = travel.push.filter(|_| is_last).unwrap_or(0.0);
            // What a force of 1 N moves the node by in this step: friction keeps a node whose miss it can undo.
            let reach = network.reach(contact.node, h);
            let kept = if along_mm < 0.0 { friction + push } else { friction };
            let stuck = along_mm.abs() <= kept * reach;
            let mut slip = if stuck {
                0.0
            } else {
                along_mm - along_mm.signum() * (if along_mm < 0.0 { sliding + push } else { sliding }) * reach
            };
            if along_mm * slip < 0.0 {
                // Static friction exceeds the sliding friction that would turn it back.
                slip = 0.0;
            }
            if !travel.open {
                slip = slip.min((tip - contact.arc).max(0.0));
            }
            cut |= tip_node && slip < 0.0;
            let contact = &mut self.stack[index];
            contact.stuck = slip == 0.0;
            contact.arc += slip;
            self.tangents.push(on_shaft.tangent);
            // The rest is corrected.
            self.misses.push(miss - on_shaft.tangent.into_inner() * slip);
        }
        if needle.is_flexible() && !self.stack.is_empty() {
            self.bend(network, h, line, needle);
        }
        for (index, contact) in self.stack.iter_mut().enumerate() {
            let node = contact.node as usize;
            let back = self.misses[index];
            let tangent = &self.tangents[index];
            contact.force = back / network.reach(contact.node, h);
            contact.side = contact.force - tangent.into_inner() * tangent.dot(&contact.force);
            network.displacement[node] -= back;
            network.velocity[node] = (network.displacement[node] - self.before[index]) / h;
        }
        cut
    }

    /// Lets the needle bend: subtracts its motion towards the nodes from their misses.
    fn bend(&mut self, network: &Network, h: f64, line: &CentreLine, needle: &mut dyn Needle) {
        self.rows.clear();
        for (contact, tangent) in self.stack.iter().zip(&self.tangents) {
            for direction in across(tangent) {
                self.rows.push(Row {
                    arc_mm: contact.arc.clamp(0.0, line.length_mm()),
                    direction,
                });
            }
        }
        let count = self.rows.len();
        self.flexibility.clear();
        self.flexibility.resize(count * count, 0.0);
        self.drift.resize(count, 0.0);
        needle.linearise(line, &[], &self.rows, &mut self.drift, &mut self.flexibility);
        self.system.start(count);
        self.across.clear();
        for row in 0..count {
            let contact = &self.stack[row / 2];
            let yielding = network.reach(contact.node, h);
            let mut right = self.misses[row / 2].dot(&self.rows[row].direction);
            // The line lies under the previous forces: only their change moves it, so their motion is added
            // back.
            for column in 0..count {
                let before = self.stack[column / 2].side.dot(&self.rows[column].direction);
                right += self.flexibility[column * count + row] * before;
            }
            self.across.push(right);
            for column in 0..=row {
                *self.system.entry(row, column) = self.flexibility[column * count + row];
            }
            *self.system.entry(row, row) += yielding;
        }
        self.system.factor();
        self.system.solve(&mut self.across);
        for (row, force) in self.across.iter().enumerate() {
            let contact = &self.stack[row / 2];
            let yielding = network.reach(contact.node, h);
            let direction = self.rows[row].direction;
            // Across the shaft only the node's share of the gap is left: the needle bends by the rest.
            let miss = self.misses[row / 2].dot(&direction);
            self.misses[row / 2] += direction * (force * yielding - miss);
        }
    }
}
