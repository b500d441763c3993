//! Contact node on the needle: arc length, stick-slip state, the tissue layers around the shaft, and their friction.
//!
//! Each contact carries the length of shaft from itself to the next one, or to the tip (Goksel et al. 2011, equation
//! 3), with the densities of the layers recorded there (Dehghan et al. 2008), over the current lengths between them on
//! the shaft: the sum over all contacts is the density over the embedded length in the deformed tissue. The cutting
//! force acts at the tip.

use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

use crate::insertion::Anatomy;
use crate::insertion::interaction::interaction;

/// Distance between samples of the regions along a path, mm.
pub(super) const SAMPLE_MM: f64 = 0.25;

/// Length of the path cut by the tip beyond a contact, within one region.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct CrossedLayer {
    /// `None` for tissue outside all regions.
    pub region: Option<i32>,
    /// Length of the layer, mm.
    pub length: f64,
}

/// A node on the needle.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Contact {
    pub node: u32,
    /// Position in the reference state, mm.
    pub reference: Point3<f64>,
    /// Distance of the line from the node, mm: after a change of the mesh the node lies elsewhere under the same force,
    /// and approaches the line as the needle moves on.
    #[serde(default)]
    pub aside: Vector3<f64>,
    /// Distance of the line from the node per force across it, mm/N: near the tip, where a needle that is withdrawn lets
    /// the tissue go.
    #[serde(default)]
    pub softness_mm_per_n: f64,
    /// Arc length from the base, mm.
    pub arc: f64,
    pub slider: Slider,
    /// Region between this contact and the next, or the tip.
    pub region: Option<i32>,
    /// Last change of the arc, per mm of advance of the base.
    pub drift: f64,
    /// Layers of the path from here to the next contact, or to the tip.
    pub layers: Vec<CrossedLayer>,
}

impl Contact {
    /// Extends the path by a length (mm) that the tip has advanced in a region.
    pub(super) fn lengthen(&mut self, region: Option<i32>, length: f64) {
        match self.layers.last_mut() {
            Some(last) if last.region == region => last.length += length,
            _ => self.layers.push(CrossedLayer { region, length }),
        }
    }

    /// Returns the length of the path from here to the next contact or the tip, mm.
    pub(super) fn path_mm(&self) -> f64 {
        self.layers.iter().map(|layer| layer.length).sum()
    }

    /// Shortens the path to at most `length` (mm), after the tip was withdrawn.
    pub(super) fn shorten(&mut self, length: f64) {
        let mut left = length.max(0.0);
        self.layers.retain_mut(|layer| {
            layer.length = layer.length.min(left);
            left -= layer.length;
            layer.length > 0.0
        });
    }
}

/// Sets the bounds of all contacts, base first, with the tip at arc `tip` (mm), behind which `cut_mm` are newly cut.
pub(super) fn set_friction_bounds(anatomy: &dyn Anatomy, contacts: &mut [Contact], tip: f64, cut_mm: f64) {
    for index in 0..contacts.len() {
        let end = contacts.get(index + 1).map_or(tip, |next| next.arc.min(tip));
        let contact = &mut contacts[index];
        let length = (end - contact.arc).max(0.0);
        let path = contact.path_mm();
        // Layers are lengths of the path in the tissue at rest; the needle between two contacts is longer or shorter,
        // and friction is per length of it.
        let undivided = [CrossedLayer {
            region: contact.region,
            length,
        }];
        let (layers, stretch) = if path > 0.0 {
            (&contact.layers[..], length / path)
        } else {
            (&undivided[..], 1.0)
        };
        let mut behind = tip - end + length;
        let (mut sliding, mut static_limits) = ([0.0; 2], [0.0; 2]);
        for layer in layers {
            let within = [behind - layer.length * stretch, behind];
            let interaction = interaction(anatomy, layer.region);
            for (direction, cut_mm) in [cut_mm, 0.0].into_iter().enumerate() {
                let force = interaction.shaft_n(within, cut_mm);
                sliding[direction] += force;
                static_limits[direction] += force * interaction.static_ratio;
            }
            behind = within[0];
        }
        contact.slider.sliding = [sliding[0], -sliding[1]];
        contact.slider.static_limits = [static_limits[0], -static_limits[1]];
    }
}

/// Stick-slip state along the shaft.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) enum State {
    /// The point keeps its place on the shaft.
    Stuck,
    /// The point is pushed along the shaft with the maximum force: towards the tip (1.0) while the needle advances, or
    /// back (-1.0).
    Slipping(f64),
}

/// A bounded force with its stick-slip state.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Slider {
    pub state: State,
    /// Bounds of the force on the tissue while it slips, towards the tip and back: [most, least], N.
    #[serde(skip)]
    pub sliding: [f64; 2],
    /// Bounds of the force on the tissue while it sticks: [most, least], N.
    #[serde(skip)]
    pub static_limits: [f64; 2],
}

/// Relative tolerance by which a force may exceed its bound.
const BOUND: f64 = 1e-11;
/// Slip in the direction of friction that counts as rounding of positions, mm.
const SLIP_TOLERANCE_MM: f64 = 1e-9;

impl Slider {
    pub(super) fn new(state: State) -> Slider {
        Slider {
            state,
            sliding: [0.0; 2],
            static_limits: [0.0; 2],
        }
    }

    pub(crate) fn is_stuck(&self) -> bool {
        self.state == State::Stuck
    }

    /// Sets the bounds for both states.
    pub(crate) fn set_bounds(&mut self, bounds: [f64; 2]) {
        (self.sliding, self.static_limits) = (bounds, bounds);
    }

    /// Returns the force on the tissue if it slips, N.
    pub(super) fn force(&self) -> Option<f64> {
        match self.state {
            State::Stuck => None,
            State::Slipping(direction) => Some(self.sliding[usize::from(direction < 0.0)]),
        }
    }

    /// Returns the state to change to where Coulomb's law is violated: a force (N) out of bounds, or a slip (mm, of the
    /// tissue towards the tip) in the direction of the friction that should resist it.
    pub(crate) fn violated(&self, force: f64, slip: f64) -> Option<State> {
        let [upper, lower] = self.static_limits;
        match self.state {
            State::Stuck if force > upper + BOUND * upper.abs() => Some(State::Slipping(1.0)),
            State::Stuck if force < lower - BOUND * lower.abs() => Some(State::Slipping(-1.0)),
            // Tissue pushed towards the tip must move towards the base; tissue without friction may move either way.
            State::Slipping(direction) if slip * direction > SLIP_TOLERANCE_MM && self.sliding != [0.0; 2] => {
                Some(State::Stuck)
            }
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::insertion::{Interaction, Peak};

    #[test]
    fn the_path_grows_and_shrinks_by_region() {
        let mut contact = Contact {
            node: 0,
            reference: Point3::origin(),
            aside: Vector3::zeros(),
            softness_mm_per_n: 0.0,
            arc: 0.0,
            slider: Slider::new(State::Stuck),
            region: Some(1),
            drift: 0.0,
            layers: Vec::new(),
        };
        contact.lengthen(Some(1), 2.0);
        contact.lengthen(Some(1), 1.0);
        contact.lengthen(Some(2), 4.0);
        let layer = |region, length| CrossedLayer {
            region: Some(region),
            length,
        };
        assert_eq!(contact.layers, [layer(1, 3.0), layer(2, 4.0)]);
        contact.shorten(5.0);
        assert_eq!(contact.layers, [layer(1, 3.0), layer(2, 2.0)]);
        contact.shorten(9.0);
        assert_eq!(contact.layers, [layer(1, 3.0), layer(2, 2.0)]);
        contact.shorten(1.0);
        assert_eq!(contact.layers, [layer(1, 1.0)]);
        contact.shorten(-1.0);
        assert_eq!(contact.layers, []);
    }

    fn contact(arc: f64, layers: &[(i32, f64)]) -> Contact {
        Contact {
            node: 0,
            reference: Point3::origin(),
            aside: Vector3::zeros(),
            softness_mm_per_n: 0.0,
            arc,
            slider: Slider::new(State::Stuck),
            region: Some(1),
            drift: 0.0,
            layers: layers
                .iter()
                .map(|&(region, length)| CrossedLayer {
                    region: Some(region),
                    length,
                })
                .collect(),
        }
    }

    /// Region 1 has friction only, region 2 also a peak, all others exert nothing.
    #[derive(Debug)]
    struct Two;

    impl Anatomy for Two {
        fn region(&self, _: &Point3<f64>) -> Option<i32> {
            None
        }

        fn interaction(&self, region: i32) -> Interaction {
            match region {
                1 => Interaction {
                    friction_n_per_mm: 0.02,
                    static_ratio: 1.5,
                    ..Interaction::default()
                },
                2 => Interaction {
                    friction_n_per_mm: 0.05,
                    peak: Some(Peak {
                        density_n_per_mm: 0.1,
                        width_mm: 6.0,
                    }),
                    ..Interaction::default()
                },
                _ => Interaction::default(),
            }
        }
    }

    fn near(a: f64, b: f64) -> bool {
        (a - b).abs() < 1e-14
    }

    #[test]
    fn forces_sum_to_the_density_over_the_embedded_length() {
        // 10 mm of region 1, stretched to 12 on the shaft; 4 of 1 and 4 of 2; 5 of 2 up to the tip.
        let mut contacts = [
            contact(100.0, &[(1, 10.0)]),
            contact(112.0, &[(1, 4.0), (2, 4.0)]),
            contact(120.0, &[(2, 5.0)]),
        ];
        set_friction_bounds(&Two, &mut contacts, 125.0, f64::INFINITY);
        let resting = [12.0 * 0.02, 4.0 * 0.02 + 4.0 * 0.05, 5.0 * 0.05];
        // One of the 6 mm of the peak lies before the last contact.
        let cutting = [12.0 * 0.02, 4.0 * 0.02 + 3.0 * 0.05 + 0.1, 5.0 * 0.1];
        for index in 0..3 {
            let slider = &contacts[index].slider;
            assert!(near(slider.sliding[0], cutting[index]) && near(slider.sliding[1], -resting[index]));
        }
        assert!(near(contacts[0].slider.static_limits[1], -1.5 * resting[0]));
        // A tip in a channel has no peak; an unknown region does nothing.
        set_friction_bounds(&Two, &mut contacts, 125.0, 0.0);
        assert!(near(contacts[1].slider.sliding[0], resting[1]));
        // 3 mm beyond the end of a channel.
        set_friction_bounds(&Two, &mut contacts, 125.0, 3.0);
        assert!(near(contacts[2].slider.sliding[0], 3.0 * 0.1 + 2.0 * 0.05));
        let mut alone = [contact(0.0, &[(7, 3.0)])];
        set_friction_bounds(&Two, &mut alone, 3.0, f64::INFINITY);
        assert!(near(alone[0].slider.sliding[0], 0.0));
    }

    /// The tip goes from region 1 into region 2: no length of shaft changes its density abruptly.
    #[test]
    fn the_force_is_continuous_across_a_boundary() {
        let force = |depth: f64| {
            let mut contacts = [contact(0.0, &[(1, depth.min(10.0)), (2, (depth - 10.0).max(0.0))])];
            set_friction_bounds(&Two, &mut contacts, depth, f64::INFINITY);
            contacts[0].slider.sliding[0]
        };
        assert!((force(10.0 + 1e-9) - force(10.0 - 1e-9)).abs() < 1e-9);
        assert!(near(force(13.0), 10.0 * 0.02 + 3.0 * 0.1) && near(force(20.0), 10.0 * 0.02 + 6.0 * 0.1 + 4.0 * 0.05));
    }

    #[test]
    fn the_law_of_coulomb() {
        let mut slider = Slider::new(State::Stuck);
        (slider.sliding, slider.static_limits) = ([2.0, -1.0], [3.0, -1.5]);
        let cases = [
            (2.9, None),
            (3.1, Some(State::Slipping(1.0))),
            (-1.4, None),
            (-1.6, Some(State::Slipping(-1.0))),
        ];
        for (force, state) in cases {
            assert_eq!(slider.violated(force, 7.0), state);
        }
        assert_eq!((slider.is_stuck(), slider.force()), (true, None));
        slider.state = State::Slipping(1.0);
        assert_eq!(slider.force(), Some(2.0));
        assert_eq!(
            (slider.violated(9.0, -0.1), slider.violated(9.0, 0.1)),
            (None, Some(State::Stuck))
        );
        slider.state = State::Slipping(-1.0);
        assert_eq!(slider.force(), Some(-1.0));
        assert_eq!(
            (slider.violated(9.0, 0.1), slider.violated(9.0, -0.1)),
            (None, Some(State::Stuck))
        );
        // Without friction it slips at the least force.
        let nothing = Slider::new(State::Stuck);
        assert_eq!(
            (nothing.violated(0.0, 0.0), nothing.violated(1e-300, 0.0)),
            (None, Some(State::Slipping(1.0)))
        );
    }
}
