//! A needle that pushes before it punctures, in tissue that stiffens.
//!
//! Y. Kobayashi et al., "Development of an integrated needle insertion system with image guidance and deformation simulation",
//! Computerized Medical Imaging and Graphics 34, 2010, section 4.3.2 and figure 12: the tissue does not answer with a constant
//! force; the needle first pushes it, with a force that rises faster than its way, and then punctures at once. Their simulation ends
//! at the first puncture; this one goes on.
//!
//! The needle goes straight along a line through the body, in the reference state too. What it meets there is a list of
//! [`Layer`]s, each behind a membrane. At a membrane the tip *pushes*: the point of the body there is held at the tip. When the
//! force of that passes what the membrane bears it is punctured, and the tip *cuts*: it is where the deformed tissue has come to
//! it, under the force of cutting, and the shaft behind drags along what it passed by friction, for each mm of tissue. Then the
//! next membrane is reached. All is quasi-static: inertia has no part.
//!
//! Where the tip is in the tissue is taken from the displacements of the step before: steps should be small against the elements.

mod line;

use std::sync::Arc;

use crate::mechanics::tissue::nonlinear::creep::CreepError;
use crate::mechanics::tissue::nonlinear::{Body, Contact, Structure};
use line::Line;

/// Tissue along the needle's way, behind a membrane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layer {
    /// Where it begins, in the reference state, from the entry on, mm. The first begins at 0.
    pub from_mm: f64,
    /// Force that its membrane bears, N (0 or more; 0: there is none).
    pub membrane_n: f64,
    /// Force that cuts it at the tip, N (0 or more).
    pub cutting_n: f64,
    /// Friction of the shaft, N for each mm of it (0 or more).
    pub friction_n_per_mm: f64,
}

/// Why a needle's way is none.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum InvalidWay {
    /// The line does not enter the body.
    #[error("the entry {entry:?} lies outside the body")]
    Outside {
        /// The entry, mm.
        entry: Vec<f64>,
    },
    /// The direction has no length, or is no number.
    #[error("the direction {found:?} is none; expected a vector with a length")]
    Direction {
        /// As given.
        found: Vec<f64>,
    },
    /// There are no layers, or the first does not begin at the entry.
    #[error("the first layer begins at {found:?} mm; expected 0")]
    First {
        /// Where it begins, if there is one.
        found: Option<f64>,
    },
    /// A layer begins before the one above, or a force is negative.
    #[error("{what} of layer {layer} is {found}; expected {expected}")]
    Layer {
        /// Which, from 0.
        layer: usize,
        /// Which of its numbers.
        what: &'static str,
        /// As given.
        found: f64,
        /// What it must be.
        expected: &'static str,
    },
}

/// What the tip does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// It is not in touch yet, or no more.
    Free,
    /// It pushes the membrane of this layer.
    Pushing(usize),
    /// It cuts through this layer.
    Cutting(usize),
}

/// What a step comes to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pushed {
    /// Force on the needle against its way, N.
    pub force_n: f64,
    /// What of it acts at the tip, N.
    pub tip_n: f64,
    /// How deep the tip is in the tissue, in the reference state, mm.
    pub depth_mm: f64,
    /// What the tip does now.
    pub phase: Phase,
    /// The layer whose membrane was punctured in this step.
    pub punctured: Option<usize>,
}

/// A body with a needle on its way through.
#[derive(Clone, Debug)]
pub struct Pushing<const D: usize, const N: usize> {
    structure: Structure<D, N>,
    line: Line<D>,
    layers: Vec<Layer>,
    phase: Phase,
    depth_mm: f64,
    loads: Vec<f64>,
    prescribed: Vec<f64>,
    /// The point that the tip touches; none while it is free or cuts.
    contact: Option<Contact>,
}

impl<const D: usize, const N: usize> Pushing<D, N> {
    /// A needle whose tip is at `entry` (mm, on the surface of the body) and which will go along `direction`, through `layers`.
    /// Prescribed displacements of the body stay 0.
    ///
    /// # Errors
    /// [`InvalidWay`], with the number that is wrong.
    pub fn new(
        structure: Structure<D, N>,
        entry: [f64; D],
        direction: [f64; D],
        layers: Vec<Layer>,
    ) -> Result<Self, InvalidWay> {
        check(&layers)?;
        let solver = structure.solver();
        let (all, held) = (solver.supports().all(), solver.supports().prescribed().len());
        Ok(Pushing {
            line: Line::new(solver.body(), entry, direction)?,
            layers,
            phase: Phase::Free,
            depth_mm: 0.0,
            loads: vec![0.0; all],
            prescribed: vec![0.0; held],
            contact: None,
            structure,
        })
    }

    /// The body.
    pub fn body(&self) -> &Arc<Body<D, N>> {
        self.structure.solver().body()
    }

    /// The body with its state.
    pub fn structure(&self) -> &Structure<D, N> {
        &self.structure
    }

    /// How far tissue at a depth on the needle's way is displaced along it, mm.
    pub fn along(&self, depth_mm: f64) -> f64 {
        self.line
            .contact(self.body(), depth_mm, 0.0)
            .along(self.structure.displacement())
    }

    /// Moves the tip to `travel_mm` beyond the entry (below 0: before it), in `step_s` seconds.
    ///
    /// # Errors
    /// [`CreepError`]; the needle is then as before.
    pub fn step(&mut self, travel_mm: f64, step_s: f64) -> Result<Pushed, CreepError> {
        let (phase, depth_mm) = self.advance(travel_mm);
        self.contact = match phase {
            Phase::Pushing(_) => Some(self.line.contact(self.body(), depth_mm, travel_mm - depth_mm)),
            Phase::Free | Phase::Cutting(_) => None,
        };
        self.loads.fill(0.0);
        let mut shaft_n = 0.0;
        let layer_of = |depth: f64| {
            self.layers
                .iter()
                .rposition(|layer| layer.from_mm <= depth)
                .unwrap_or(0)
        };
        for (point, from, to) in self.line.pieces(depth_mm) {
            let force = self.layers[layer_of(0.5 * (from + to))].friction_n_per_mm * (to - from);
            shaft_n += force;
            point.add(force, &mut self.loads);
        }
        let mut tip_n = 0.0;
        if let Phase::Cutting(layer) = phase {
            tip_n = self.layers[layer].cutting_n;
            self.line
                .contact(self.body(), depth_mm, 0.0)
                .add(tip_n, &mut self.loads);
        }
        self.structure
            .step(step_s, &self.loads, &self.prescribed, self.contact.as_ref())?;
        (self.phase, self.depth_mm) = (phase, depth_mm);
        let mut punctured = None;
        if let Phase::Pushing(layer) = phase {
            tip_n = self.structure.contact_force();
            if tip_n > self.layers[layer].membrane_n {
                punctured = Some(layer);
                self.phase = Phase::Cutting(layer);
            } else if tip_n < 0.0 {
                // A needle does not pull: what holds the point back lets it go in the next step.
                self.phase = Phase::Free;
            }
        }
        Ok(Pushed {
            force_n: tip_n + shaft_n,
            tip_n,
            depth_mm,
            phase,
            punctured,
        })
    }

    /// What the tip does when it goes on to `travel_mm`, and how deep it comes, the tissue displaced as it is.
    fn advance(&self, travel_mm: f64) -> (Phase, f64) {
        let place = |depth: f64| depth + self.along(depth);
        match self.phase {
            Phase::Pushing(layer) => (Phase::Pushing(layer), self.depth_mm),
            Phase::Free if place(self.depth_mm) < travel_mm => {
                let layer = self
                    .layers
                    .iter()
                    .rposition(|layer| layer.from_mm <= self.depth_mm)
                    .unwrap_or(0);
                (Phase::Pushing(layer), self.depth_mm)
            }
            Phase::Free => (Phase::Free, self.depth_mm),
            Phase::Cutting(layer) => {
                let next = self.layers.get(layer + 1).map_or(f64::INFINITY, |layer| layer.from_mm);
                let end = next.min(self.line.length());
                if place(end) <= travel_mm {
                    return if end < next {
                        (Phase::Free, end)
                    } else {
                        self.entered(layer + 1, end)
                    };
                }
                // Cut tissue stays cut: the tip is not above where it was.
                let (mut low, mut high) = (self.depth_mm, end);
                for _ in 0..60 {
                    let middle = 0.5 * (low + high);
                    if place(middle) < travel_mm {
                        low = middle
                    } else {
                        high = middle
                    }
                }
                (Phase::Cutting(layer), low)
            }
        }
    }

    /// A layer is reached: its membrane is pushed, if it has one.
    fn entered(&self, layer: usize, depth: f64) -> (Phase, f64) {
        if self.layers[layer].membrane_n > 0.0 {
            (Phase::Pushing(layer), depth)
        } else {
            (Phase::Cutting(layer), depth)
        }
    }
}

fn check(layers: &[Layer]) -> Result<(), InvalidWay> {
    if layers.first().is_none_or(|layer| layer.from_mm != 0.0) {
        return Err(InvalidWay::First {
            found: layers.first().map(|layer| layer.from_mm),
        });
    }
    for (at, layer) in layers.iter().enumerate() {
        let wrong = |what, found, expected| {
            Err(InvalidWay::Layer {
                layer: at,
                what,
                found,
                expected,
            })
        };
        let above = at
            .checked_sub(1)
            .map_or(f64::NEG_INFINITY, |above| layers[above].from_mm);
        if !(layer.from_mm.is_finite() && layer.from_mm > above) {
            return wrong("from_mm", layer.from_mm, "more than that of the layer above");
        }
        let forces = [
            ("membrane_n", layer.membrane_n),
            ("cutting_n", layer.cutting_n),
            ("friction_n_per_mm", layer.friction_n_per_mm),
        ];
        for (what, found) in forces {
            if !(found.is_finite() && found >= 0.0) {
                return wrong(what, found, "a finite number, 0 or more");
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
