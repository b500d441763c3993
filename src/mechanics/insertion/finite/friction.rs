//! The forces that tissue can put on each contact along the shaft.
//!
//! Friction is a force for each length of shaft, summed from a contact to the next one (Goksel et al. 2011, equation 3),
//! over the lengths that lie between them on the shaft now: the sum over all contacts is the density over the whole embedded
//! length in the deformed tissue. What is needed to cut acts at the tip.

use std::collections::BTreeMap;

use super::contact::Contact;
use crate::mechanics::insertion::Interaction;

/// What each region does to the needle. A region without an entry does nothing.
#[derive(Clone, Debug, Default)]
pub(super) struct Interactions(BTreeMap<i32, Interaction>);

impl Interactions {
    pub fn new(list: &[(i32, Interaction)]) -> Interactions {
        Interactions(list.iter().copied().collect())
    }

    pub fn of(&self, region: i32) -> Interaction {
        self.0.get(&region).copied().unwrap_or_default()
    }

    /// Friction of a contact's length of shaft: sliding, and held.
    fn friction(&self, contact: &Contact, length: f64) -> [f64; 2] {
        let path = contact.laid();
        let mean = |density: &dyn Fn(Interaction) -> f64| {
            if path > 0.0 {
                let sum: f64 = contact
                    .layers
                    .iter()
                    .map(|layer| layer.length * density(self.of(layer.region)))
                    .sum();
                sum / path
            } else {
                density(self.of(contact.region))
            }
        };
        [
            length * mean(&|it| it.friction_n_per_mm),
            length * mean(&|it| it.friction_n_per_mm * it.static_ratio),
        ]
    }

    /// Sets the bounds of all contacts, base first, with the tip at arc `tip` (mm) in `region`.
    pub fn bound(&self, contacts: &mut [Contact], tip: f64, region: Option<i32>) {
        let ahead = region.map(|region| self.of(region)).unwrap_or_default();
        for at in 0..contacts.len() {
            let end = contacts.get(at + 1).map_or(tip, |next| next.arc.min(tip));
            let contact = &mut contacts[at];
            let length = (end - contact.arc).max(0.0);
            let [sliding, holding] = self.friction(contact, length);
            // The share of the peak near the tip that falls on this length.
            let peak = ahead.peak.map_or(0.0, |peak| {
                let overlap = end - contact.arc.max(tip - peak.width_mm);
                peak.density_n_per_mm * overlap.clamp(0.0, length)
            });
            contact.slider.sliding = [sliding + peak, -sliding];
            contact.slider.holding = [holding + peak, -holding];
        }
    }

    /// What cutting at the tip takes, N: while it goes on, and before, where a surface withstands more until it breaks.
    pub fn cutting(&self, region: Option<i32>, surface: Option<f64>) -> [f64; 2] {
        let cutting = region.map_or(0.0, |region| self.of(region).cutting_n);
        [cutting, surface.unwrap_or(cutting)]
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;
    use crate::mechanics::insertion::Peak;
    use crate::mechanics::insertion::finite::contact::Layer;
    use crate::mechanics::insertion::finite::slider::{Slider, State};

    fn contact(arc: f64, layers: &[(i32, f64)]) -> Contact {
        Contact {
            node: 0,
            reference: Point3::origin(),
            arc,
            slider: Slider::new(State::Stuck),
            region: 1,
            drift: 0.0,
            layers: layers
                .iter()
                .map(|&(region, length)| Layer { region, length })
                .collect(),
        }
    }

    #[test]
    fn friction_sums_to_the_density_over_the_embedded_length() {
        let soft = Interaction {
            friction_n_per_mm: 0.02,
            static_ratio: 1.5,
            ..Interaction::default()
        };
        let hard = Interaction {
            friction_n_per_mm: 0.05,
            cutting_n: 0.7,
            peak: Some(Peak {
                density_n_per_mm: 0.1,
                width_mm: 6.0,
            }),
            ..Interaction::default()
        };
        let interactions = Interactions::new(&[(1, soft), (2, hard)]);
        // 10 mm of region 1, stretched to 12 on the shaft; 4 of 1 and 4 of 2; 5 of 2 up to the tip.
        let mut contacts = [
            contact(100.0, &[(1, 10.0)]),
            contact(112.0, &[(1, 4.0), (2, 4.0)]),
            contact(120.0, &[(2, 5.0)]),
        ];
        interactions.bound(&mut contacts, 125.0, Some(2));
        let near = |a: f64, b: f64| (a - b).abs() < 1e-15;
        let friction = [12.0 * 0.02, 4.0 * 0.02 + 4.0 * 0.05, 5.0 * 0.05];
        // One of the six millimetres of the peak lies before the last contact.
        let peak = [0.0, 0.1, 0.5];
        for at in 0..3 {
            let slider = &contacts[at].slider;
            assert!(near(slider.sliding[0], friction[at] + peak[at]) && near(slider.sliding[1], -friction[at]));
        }
        assert!(near(contacts[0].slider.holding[1], -1.5 * friction[0]));
        // Outside there is no peak; an unknown region does nothing.
        interactions.bound(&mut contacts, 125.0, None);
        assert!(near(contacts[1].slider.sliding[0], friction[1]));
        let mut alone = [contact(0.0, &[(7, 3.0)])];
        interactions.bound(&mut alone, 3.0, Some(7));
        assert!(near(alone[0].slider.sliding[0], 0.0));

        assert_eq!(interactions.cutting(Some(2), Some(9.0)), [0.7, 9.0]);
        assert_eq!(
            (interactions.cutting(Some(2), None), interactions.cutting(None, None)),
            ([0.7; 2], [0.0; 2])
        );
    }
}
