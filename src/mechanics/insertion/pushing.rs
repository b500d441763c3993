//! Straight needle that pushes, punctures and cuts stiffening tissue.
//!
//! Y. Kobayashi et al., "Development of an integrated needle insertion system with image guidance and deformation
//! simulation", Computerized Medical Imaging and Graphics 34, 2010, section 4.3.2 and figure 12: the force of the
//! tissue is not constant; the needle first pushes it, with a force that rises faster than its travel, and then
//! punctures abruptly. Their simulation ends at the first puncture; this one continues.
//!
//! The needle moves along a straight line through the body, in the reference state too. Along the line there is a list
//! of [`PathLayer`]s, each behind a membrane. At a membrane the tip *pushes*: the point of the body there is held at
//! the tip. When the force exceeds the strength of the membrane it is punctured, and the tip *cuts*: it is where the
//! deformed tissue meets it under the cutting force, and the shaft behind drags the surrounding tissue along by
//! friction per mm of tissue, near the tip with the density of its `peak`. Then the next membrane is reached. The model is quasi-static, without inertia.
//!
//! A needle that stops or turns back is *held* by its friction: tissue along the shaft moves with it as one, each piece
//! under its share of the force. When the force reaches the outward friction, the needle slides out through the channel
//! that it has cut; when it reaches its earlier inward value, cutting continues as before. In the channel there is
//! nothing to cut. Whether the needle is held is decided at the end of a step, so that a force may exceed its bound by
//! the change in one step.
//!
//! The force at the tip acts on a patch of tissue of a stated radius, as a flat rigid punch would: at a point the tissue
//! would give way the more, the smaller its elements are.
//!
//! The position of the tip in the tissue follows from the displacements of the previous step: steps should be small
//! against the elements.

mod line;
mod slide;

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::insertion::InvalidSetup;
use crate::insertion::interaction::shaft_n;
use crate::tissue::nonlinear::{Contact, NonlinearBody, NonlinearError, Structure};
pub use line::{Crossing, PathLayer, crossings};
use line::{Line, check};
pub(super) use slide::At;

/// Phase of the tip.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Phase {
    /// The tip touches nothing: it is outside, or in a channel that is cut already.
    #[default]
    Free,
    /// The tip pushes the membrane of this layer.
    Pushing(usize),
    /// The tip cuts through this layer.
    Cutting(usize),
    /// The needle has stopped or turned back, and tissue moves with it.
    Held,
}

/// Outcome of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pushed {
    /// Force on the needle against its direction, N.
    pub force_n: f64,
    /// Part of the force that acts at the tip, N.
    pub tip_n: f64,
    /// Depth of the tip in the tissue, in the reference state, mm.
    pub depth_mm: f64,
    /// Current phase of the tip.
    pub phase: Phase,
    /// Layer whose membrane was punctured in this step.
    pub punctured: Option<usize>,
}

/// A body with a needle on a line through it.
#[derive(Clone, Debug)]
pub struct Pushing<const D: usize, const N: usize> {
    structure: Structure<D, N>,
    /// Radius of the patch of tissue that bears the force at the tip, mm; 0: a point.
    patch_mm: f64,
    line: Line<D>,
    layers: Vec<PathLayer>,
    state: At,
    loads: Vec<f64>,
    prescribed: Vec<f64>,
}

impl<const D: usize, const N: usize> Pushing<D, N> {
    /// Builds a needle whose tip is at `entry` (mm, on the surface of the body) and which moves along `direction`,
    /// through `layers`. Its tip acts at a point. Prescribed displacements of the body stay 0.
    ///
    /// # Errors
    /// [`InvalidSetup`], with the invalid number.
    pub fn new(
        structure: Structure<D, N>,
        entry: [f64; D],
        direction: [f64; D],
        layers: Vec<PathLayer>,
    ) -> Result<Self, InvalidSetup> {
        let mut needle = Pushing::away(structure, 0.0);
        needle.aim(entry, direction, layers)?;
        Ok(needle)
    }

    /// Builds a body without a needle until it is [aimed](Self::aim). The force at its tip acts on a patch of the radius
    /// `patch_mm`, or at a point where that is 0.
    pub fn away(structure: Structure<D, N>, patch_mm: f64) -> Self {
        let supports = structure.solver().supports();
        Pushing {
            patch_mm,
            line: Line::empty(),
            layers: Vec::new(),
            state: At::default(),
            loads: vec![0.0; supports.all()],
            prescribed: vec![0.0; supports.prescribed().len()],
            structure,
        }
    }

    /// Moves the needle to another entry, as [`new`](Self::new) does. The tissue continues from its current state; what
    /// was cut has healed.
    ///
    /// # Errors
    /// [`InvalidSetup`]; the needle is then unchanged.
    pub fn aim(&mut self, entry: [f64; D], direction: [f64; D], layers: Vec<PathLayer>) -> Result<(), InvalidSetup> {
        check(&layers)?;
        self.line = Line::new(self.body(), entry, direction, self.patch_mm)?;
        self.layers = layers;
        self.state = At::before();
        Ok(())
    }

    /// Removes the needle from all tissue, until it is aimed again.
    pub fn withdraw(&mut self) {
        (self.line, self.state) = (Line::empty(), At::default());
        self.layers.clear();
    }

    /// Returns the body in its reference state.
    pub fn body(&self) -> &Arc<NonlinearBody<D, N>> {
        self.structure.solver().body()
    }

    /// Returns the body with its state.
    pub fn structure(&self) -> &Structure<D, N> {
        &self.structure
    }

    /// Returns the elements on the line of the needle.
    pub fn elements(&self) -> &[u32] {
        self.line.elements()
    }

    /// Returns the phase of the tip.
    pub fn phase(&self) -> Phase {
        self.state.phase
    }

    /// Returns the depth of the tip in the tissue, in the reference state, mm.
    pub fn depth_mm(&self) -> f64 {
        self.state.depth_mm
    }

    /// Returns the depth of the tissue that is now at the tip, in the reference state, mm. A held needle takes along
    /// the mean of the tissue at its shaft: the tissue at its tip may pass it, or lag behind.
    pub fn tip_depth_mm(&self) -> f64 {
        match self.state.phase {
            Phase::Held => self.depth_at(self.state.travel_mm, [0.0, self.line.length()]),
            _ => self.state.depth_mm,
        }
    }

    /// Returns whether the needle is outside and touches no tissue.
    pub fn is_outside(&self) -> bool {
        self.state.phase == Phase::Free && self.state.depth_mm == 0.0
    }

    /// Returns the number of shaft points in tissue.
    pub fn pieces(&self) -> usize {
        self.line.pieces(self.state.depth_mm).count()
    }

    /// Returns the forces of the shaft on the tissue along its direction, N, each between two places, mm beyond the
    /// entry.
    pub fn shaft(&self) -> impl Iterator<Item = ([f64; 2], f64)> + '_ {
        let depth = self.state.depth_mm;
        let sliding = || {
            self.frictions(depth, self.state.newly_cut_mm())
                .map(|(_, force, _)| force)
        };
        let total_n: f64 = sliding().sum();
        let share = if total_n > 0.0 {
            self.state.shaft_n / total_n
        } else {
            0.0
        };
        let pieces = self
            .line
            .pieces(depth)
            .map(|(_, from, to)| [self.place(from), self.place(to)]);
        pieces.zip(sliding()).map(move |(ends, force)| (ends, force * share))
    }

    /// Returns whether the tip has come out on the far side.
    pub fn is_through(&self) -> bool {
        self.state.intact == Phase::Free && self.state.depth_mm > 0.0 && self.state.depth_mm >= self.state.cut_mm
    }

    /// Returns the layer of the tip, not one whose membrane is intact; `None` outside.
    pub fn tip_layer(&self) -> Option<usize> {
        let state = &self.state;
        match (state.phase, state.intact) {
            (Phase::Cutting(layer), _) => Some(layer),
            (Phase::Pushing(layer), _) => layer.checked_sub(1),
            _ if self.is_outside() || self.is_through() => None,
            (_, Phase::Pushing(layer)) if state.depth_mm >= state.cut_mm => layer.checked_sub(1),
            _ => self.layers.iter().rposition(|layer| layer.from_mm <= state.depth_mm),
        }
    }

    /// Returns the pieces of the shaft down to a depth, as [`frictions`] does.
    fn frictions(&self, depth_mm: f64, cut_mm: f64) -> impl Iterator<Item = (&Contact, f64, f64)> {
        frictions(&self.line, &self.layers, depth_mm, cut_mm)
    }

    /// Returns the displacement along the line of the tissue at a depth, mm.
    pub fn along(&self, depth_mm: f64) -> f64 {
        self.line
            .contact(self.body(), depth_mm, 0.0)
            .along(self.structure.displacement())
    }

    /// Returns the state of the needle and of the body, as [`Structure::export_state`] does.
    ///
    /// # Errors
    /// [`NonlinearError`] where the stiffness cannot be factored.
    pub(super) fn export_state(&mut self) -> Result<(At, [Vec<f64>; 2]), NonlinearError> {
        Ok((self.state, self.structure.export_state()?))
    }

    /// Returns the state of the needle.
    pub(super) fn at(&self) -> At {
        self.state
    }

    /// Restores the state of the needle on the line at which it is aimed.
    pub(super) fn put_at(&mut self, state: At) {
        self.state = state;
    }

    /// Restores a state of a needle with the same aim.
    ///
    /// # Errors
    /// [`NonlinearError`] for numbers that do not fit the body.
    pub(super) fn import_state(&mut self, state: At, body_state: [&[f64]; 2]) -> Result<(), NonlinearError> {
        self.structure.import_state(body_state)?;
        self.state = state;
        Ok(())
    }

    /// Moves the tip to `travel_mm` beyond the entry (below 0: before it), in `step_s` seconds.
    ///
    /// # Errors
    /// [`NonlinearError`]; the needle is then unchanged.
    pub fn step(&mut self, travel_mm: f64, step_s: f64) -> Result<Pushed, NonlinearError> {
        let mut next = self.advance(travel_mm);
        let contact = match next.phase {
            Phase::Held => Some(self.held(&next, travel_mm - self.state.travel_mm)),
            Phase::Pushing(_) => Some(self.line.tip(self.body(), next.depth_mm, travel_mm - next.depth_mm)),
            Phase::Free | Phase::Cutting(_) => None,
        };
        self.loads.fill(0.0);
        (next.tip_n, next.shaft_n) = (0.0, 0.0);
        // A needle that tissue holds has static friction, which follows from the motion: its force is that of the
        // contact.
        if next.phase != Phase::Held {
            let sign = if next.outward { -1.0 } else { 1.0 };
            for (point, force, _) in frictions(&self.line, &self.layers, next.depth_mm, next.newly_cut_mm()) {
                next.shaft_n += sign * force;
                point.add(sign * force, &mut self.loads);
            }
        }
        if let Phase::Cutting(layer) = next.phase {
            next.tip_n = self.layers[layer].cutting_n;
            self.line
                .tip(self.body(), next.depth_mm, 0.0)
                .add(next.tip_n, &mut self.loads);
        }
        self.structure
            .step(step_s, &self.loads, &self.prescribed, contact.as_ref())?;
        let mut pushed = Pushed {
            force_n: 0.0,
            tip_n: 0.0,
            depth_mm: next.depth_mm,
            phase: next.phase,
            punctured: None,
        };
        match next.phase {
            Phase::Pushing(layer) => {
                next.tip_n = self.structure.contact_force();
                if next.tip_n > self.layers[layer].membrane_n {
                    pushed.punctured = Some(layer);
                    next.phase = Phase::Cutting(layer);
                    next.intact = next.phase;
                } else if next.tip_n < 0.0 {
                    // The tip cannot pull: a point under tension is released in the next step.
                    next.phase = Phase::Free;
                }
            }
            Phase::Held => self.share(&mut next),
            Phase::Free | Phase::Cutting(_) => {}
        }
        (pushed.force_n, pushed.tip_n) = (next.tip_n + next.shaft_n, next.tip_n);
        self.state = next;
        Ok(pushed)
    }
}

/// Returns the pieces of the shaft down to a depth: their points, sliding friction, and static friction, N. Of the last
/// `cut_mm`, the part near the tip has the density of the peak.
fn frictions<'a, const D: usize>(
    line: &'a Line<D>,
    layers: &'a [PathLayer],
    depth_mm: f64,
    cut_mm: f64,
) -> impl Iterator<Item = (&'a Contact, f64, f64)> {
    line.pieces(depth_mm).filter_map(move |(point, from, to)| {
        let middle = 0.5 * (from + to);
        let layer = layers.iter().rfind(|layer| layer.from_mm <= middle)?;
        let behind_mm = [depth_mm - to, depth_mm - from];
        let force = shaft_n(layer.friction_n_per_mm, layer.peak, behind_mm, cut_mm);
        Some((point, force, layer.static_ratio * force))
    })
}

#[cfg(test)]
mod tests;
