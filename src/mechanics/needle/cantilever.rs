//! Flexible needle as a cantilever beam.

#[cfg(test)]
mod tests;

use faer::Mat;
use nalgebra::Isometry3;

use super::chain::Chain;
use super::jointed::{Jointed, Resistance};
use super::shaft::check;
use super::{Bevel, CentreLine, Entry, InvalidNeedleModel, Load, Needle, Row, Shaft, Stiffness};
use crate::mechanics::ldl::Ldl;

/// Default length of an element, mm.
pub const ELEMENT_MM: f64 = 5.0;

/// Maximum number of elements of a needle.
const MAX_ELEMENTS: f64 = 1000.0;

/// A needle as an Euler-Bernoulli beam in space: Hermite cubic elements, each in a frame that moves with its chord.
///
/// An element of length `h` bends by the moments at its ends, `a1 = -(h/6EI) (2 M1 + M2)` and `a2 = (h/6EI) (M1 + 2 M2)`,
/// the angles of its ends relative to its chord. Moments follow from the loads beyond, with their levers on the bent shaft.
/// So at a node the chords turn by `(h/6EI) (M_before + 4 M + M_beyond)`, at the base by `(h/6EI) (2 M + M_beyond)`: nodes
/// lie exactly where beam theory has them for any `h`, as long as forces act at nodes. Between nodes the shaft is its chord,
/// on which forces there act: that omits at most `F h^3/(48 EI)`, 0.0004 mm for 1 N and 5 mm. (Springs, whose joints are the
/// midpoint rule of the same integrals, are off by `h^2/(4 L^2)` of the deflection.)
///
/// Rotations of the beam may be large: frames are carried along, levers are those of the bent needle, and lengths are
/// preserved. Within an element the chord is as long as the arc, which is off by `a^2/10` of it for ends that turn by `a`; a
/// node turns by at most 45 degrees. There is no torsion, as in the other models. For a needle on a hyperelastic foundation
/// of its own see [`beam`](super::beam); here tissue acts through the loads.
#[derive(Clone, Debug)]
pub struct Cantilever {
    jointed: Jointed,
}

impl Cantilever {
    /// Builds a needle of equal elements about `element_mm` long (above 0, at most the needle, at most 1000 elements).
    ///
    /// # Errors
    /// [`InvalidNeedleModel`].
    pub fn new(
        shaft: Shaft,
        stiffness: Stiffness,
        element_mm: f64,
        bevel: Option<Bevel>,
    ) -> Result<Self, InvalidNeedleModel> {
        shaft.check()?;
        stiffness.check()?;
        bevel.map_or(Ok(()), |bevel| bevel.check(&shaft))?;
        let length = shaft.length_mm;
        let elements = (length / element_mm).round();
        let holds = element_mm <= length && (1.0..=MAX_ELEMENTS).contains(&elements);
        let expected = "above 0, at most the length of the needle, at least a thousandth of it";
        check("element_mm", element_mm, holds, expected)?;
        let part = length / elements;
        // The base is a joint too: it is clamped, but the first chord turns relative to it.
        let nodes: Vec<f64> = (0..elements as usize).map(|node| part * node as f64).collect();
        let resistance = inverse(nodes.len(), part / (6.0 * stiffness.bending_nmm2()));
        let chain = Chain::new(length, &nodes, bevel.as_ref());
        Ok(Self {
            jointed: Jointed::new(chain, shaft.radius_mm, Resistance::Coupled(resistance)),
        })
    }
}

/// Returns the inverse of the rotations of the chords by moments at the nodes: `compliance` times 2 and 1 at the base, and
/// 1, 4, 1 beyond.
fn inverse(nodes: usize, compliance: f64) -> Vec<f64> {
    let mut ldl = Ldl::default();
    ldl.start(nodes);
    for node in 0..nodes {
        *ldl.entry(node, node) = compliance * if node == 0 { 2.0 } else { 4.0 };
        if node > 0 {
            *ldl.entry(node, node - 1) = compliance;
        }
    }
    ldl.factor();
    let mut inverse = vec![0.0; nodes * nodes];
    (0..nodes).for_each(|node| inverse[node * nodes + node] = 1.0);
    ldl.solve_rows(&mut inverse, nodes);
    inverse
}

impl Needle for Cantilever {
    fn length_mm(&self) -> f64 {
        self.jointed.length_mm()
    }

    fn radius_mm(&self) -> f64 {
        self.jointed.radius_mm()
    }

    fn is_flexible(&self) -> bool {
        true
    }

    fn place(
        &mut self,
        base: &Isometry3<f64>,
        _entry: Option<&Entry>,
        about: &[Load],
        loads: &[Load],
        line: &mut CentreLine,
    ) {
        self.jointed.place(base, about, loads, line);
    }

    fn linearise(
        &mut self,
        line: &CentreLine,
        loads: &[Load],
        rows: &[Row],
        drift: &mut [f64],
        out: &mut Mat<f64>,
    ) -> usize {
        self.jointed.linearise(line, loads, rows, drift, out)
    }
}
