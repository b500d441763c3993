//! Prediction of the next remesh, passed to the remesher in advance.

use nalgebra::Point3;

use super::Finite;
use super::place::Tetrahedron;
use crate::mechanics::mesh::NONE;

/// Maximum number of elements searched: a node is made every few.
const MOST_ELEMENTS: usize = 16;
/// Tip travel after which the prediction is renewed, mm: the path bends.
const AGAIN_MM: f64 = 0.25;

/// Inputs of a prediction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Outlook {
    mesh_step: u64,
    element: Option<u32>,
    /// Distance from the last node, in units of [`AGAIN_MM`].
    way: i64,
    withdraws: bool,
}

impl Finite {
    /// Announces to the remesher the node that will be made next, or released if the needle `withdraws`.
    pub(super) fn predict_remesh(&mut self, withdraws: bool) {
        let Some(last) = self.contacts.last() else { return };
        let outlook = Outlook {
            mesh_step: self.adaptation.mesh().step(),
            element: self.tip.element,
            way: ((self.line.length_mm() - last.arc) / AGAIN_MM) as i64,
            withdraws,
        };
        if self.outlook.replace(outlook) == Some(outlook) {
            return;
        }
        let node = if withdraws { Some(last.node) } else { self.next_corner() };
        if let Some(node) = node {
            self.adaptation.expect(node);
        }
    }

    /// Returns the corner that will be moved for the next node, assuming that the path continues straight.
    pub(super) fn next_corner(&self) -> Option<u32> {
        let mut element = self.tip.element?;
        let last = self.contacts.last()?;
        let (mesh, spacing) = (self.adaptation.mesh(), self.options.spacing_mm);
        let ahead = self.line.at(self.line.length_mm()).tangent.into_inner();
        let mut point = self.tip.reference;
        let mut way = self.line.length_mm() - last.arc;
        for _ in 0..MOST_ELEMENTS {
            let corners = mesh.elements()[element as usize];
            let tetrahedron = Tetrahedron::new(&corners.map(|node| Point3::from(mesh.nodes()[node as usize])))?;
            let (through, face) = tetrahedron.exit(&point, &ahead)?;
            if !corners.contains(&last.node) && way + through >= spacing {
                return self.corner(element, point + ahead * (spacing - way).max(0.0), |_| true);
            }
            point += ahead * through;
            way += through;
            element = self.mesh.neighbours()[element as usize][face];
            if element == NONE {
                return None;
            }
        }
        None
    }
}
