//! Prediction of the next remesh, passed to the remesher in advance.

use nalgebra::Point3;

use super::FiniteOptions;
use super::contacts::Contacts;
use super::location::Tetrahedron;
use super::needle::PlacedNeedle;
use super::tip::Tip;
use super::tissue::Tissue;
use insonify_mesh::NO_ELEMENT;

/// Maximum number of elements searched: a node is made every few.
const MAX_ELEMENTS: usize = 16;
/// Tip travel after which the prediction is renewed, mm: the path bends.
const AGAIN_MM: f64 = 0.25;

/// Inputs of a prediction.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Inputs {
    mesh_step: u64,
    element: Option<u32>,
    /// Distance from the last node, in units of [`AGAIN_MM`].
    travel: i64,
    withdraws: bool,
}

/// The last prediction.
#[derive(Debug, Default)]
pub(super) struct Prediction {
    inputs: Option<Inputs>,
}

impl Prediction {
    /// Announces to the remesher the node that will be made next, or released if the needle `withdraws`.
    pub(crate) fn renew(
        &mut self,
        withdraws: bool,
        contacts: &Contacts,
        needle: &PlacedNeedle,
        tip: &Tip,
        tissue: &mut Tissue,
        options: &FiniteOptions,
    ) {
        let Some(last) = contacts.nodes.last() else { return };
        let inputs = Inputs {
            mesh_step: tissue.adaptation.mesh().step(),
            element: tip.element,
            travel: ((needle.line.length_mm() - last.arc) / AGAIN_MM) as i64,
            withdraws,
        };
        if self.inputs.replace(inputs) == Some(inputs) {
            return;
        }
        let node = if withdraws {
            Some(last.node)
        } else {
            next_corner(contacts, needle, tip, tissue, options)
        };
        if let Some(node) = node {
            tissue.adaptation.expect(node);
        }
    }
}

/// Returns the corner that will be moved for the next node, assuming that the path continues straight.
pub(super) fn next_corner(
    contacts: &Contacts,
    needle: &PlacedNeedle,
    tip: &Tip,
    tissue: &Tissue,
    options: &FiniteOptions,
) -> Option<u32> {
    let mut element = tip.element?;
    let last = contacts.nodes.last()?;
    let (mesh, spacing) = (tissue.adaptation.mesh(), options.spacing_mm);
    let forward = needle.tip().tangent.into_inner();
    let mut point = tip.reference;
    let mut travel = needle.line.length_mm() - last.arc;
    for _ in 0..MAX_ELEMENTS {
        let corners = mesh.elements()[element as usize];
        let tetrahedron = Tetrahedron::new(&corners.map(|node| Point3::from(mesh.nodes()[node as usize])))?;
        let (through, face) = tetrahedron.exit(&point, &forward)?;
        // As `wants_node` decides: one spacing behind the last node, outside the elements around it.
        if !corners.contains(&last.node) && travel + through >= spacing {
            let target = point + forward * (spacing - travel).max(0.0);
            return tissue.corner(element, target, &contacts.nodes, options.condition_limit, |_| true);
        }
        point += forward * through;
        travel += through;
        element = tissue.mesh.neighbours()[element as usize][face];
        if element == NO_ELEMENT {
            return None;
        }
    }
    None
}
