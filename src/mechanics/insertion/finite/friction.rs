//! The forces that tissue can put on each contact along the shaft.
//!
//! Friction is a force for each length of shaft, summed from a contact to the next one (haptic simulator paper, equation 3),
//! over the lengths that lie between them on the shaft now: the sum over all contacts is the density over the whole embedded
//! length in the deformed tissue. The last contact carries what is needed to cut at the tip, which acts only against an advance.
//!
//! A node that has just been made at the tip does not carry that force at once: tissue must be pushed ahead first. Until it does,
//! the node behind, which carried it before, keeps the rest, so that the hand feels no jump.

use std::collections::BTreeMap;

use super::contact::{Contact, State};
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
        let path: f64 = contact.layers.iter().map(|layer| layer.length).sum();
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

    /// Sets the limits of all contacts, base first, with the tip at arc `tip` (mm) in `region`. `taken` is what a last contact that
    /// sticks pushes with already, N.
    pub fn set_limits(&self, contacts: &mut [Contact], tip: f64, region: Option<i32>, taken: f64) {
        let ahead = region.map(|region| self.of(region)).unwrap_or_default();
        let sticks = contacts.last().is_some_and(|last| last.state == State::Stuck);
        let rest = if sticks {
            ahead.cutting_n - taken.clamp(0.0, ahead.cutting_n)
        } else {
            0.0
        };
        let last = contacts.len().saturating_sub(1);
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
            let cutting = match last - at {
                0 => ahead.cutting_n,
                1 => rest,
                _ => 0.0,
            };
            contact.sliding = [sliding + peak + cutting, sliding];
            contact.holding = [holding + peak + cutting, holding];
            if let Some(surface) = contact.surface {
                contact.holding[0] = contact.holding[0].max(surface);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;
    use crate::mechanics::insertion::Peak;
    use crate::mechanics::insertion::finite::contact::Layer;

    fn contact(arc: f64, layers: &[(i32, f64)]) -> Contact {
        Contact {
            node: 0,
            reference: Point3::origin(),
            arc,
            state: State::Stuck,
            surface: None,
            region: 1,
            drift: 0.0,
            layers: layers
                .iter()
                .map(|&(region, length)| Layer { region, length })
                .collect(),
            sliding: [0.0; 2],
            holding: [0.0; 2],
        }
    }

    #[test]
    fn friction_sums_to_the_density_over_the_embedded_length() {
        let soft = Interaction {
            friction_n_per_mm: 0.02,
            static_ratio: 1.5,
            cutting_n: 0.3,
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
        interactions.set_limits(&mut contacts, 125.0, Some(2), 9.0);
        let friction = [12.0 * 0.02, 4.0 * 0.02 + 4.0 * 0.05, 5.0 * 0.05];
        for (contact, friction) in contacts.iter().zip(friction) {
            assert!((contact.sliding[1] - friction).abs() < 1e-15);
        }
        // One of the six millimetres of the peak lies before the last contact; only the last cuts.
        assert!((contacts[0].sliding[0] - friction[0]).abs() < 1e-15);
        assert!((contacts[1].sliding[0] - friction[1] - 0.1).abs() < 1e-15);
        assert!((contacts[2].sliding[0] - friction[2] - 0.5 - 0.7).abs() < 1e-15);
        assert!((contacts[0].holding[1] - 1.5 * friction[0]).abs() < 1e-15);
        // A surface withstands more while it holds, but only against an advance.
        contacts[2].surface = Some(9.0);
        interactions.set_limits(&mut contacts, 125.0, Some(2), 9.0);
        assert_eq!(contacts[2].holding[0], 9.0);
        assert!((contacts[2].holding[1] - friction[2]).abs() < 1e-15);
        // Outside, nothing is cut; an unknown region does nothing.
        interactions.set_limits(&mut contacts, 125.0, None, 0.0);
        assert!((contacts[1].sliding[0] - friction[1]).abs() < 1e-15);
        // What the last one does not push with yet, the one before it does.
        contacts[2].surface = None;
        interactions.set_limits(&mut contacts, 125.0, Some(2), 0.3);
        assert!((contacts[1].sliding[0] - friction[1] - 0.1 - 0.4).abs() < 1e-15);
        contacts[2].state = State::Slipping(1.0);
        interactions.set_limits(&mut contacts, 125.0, Some(2), 0.3);
        assert!((contacts[1].sliding[0] - friction[1] - 0.1).abs() < 1e-15);
        let mut alone = [contact(0.0, &[(7, 3.0)])];
        interactions.set_limits(&mut alone, 3.0, Some(7), 0.0);
        assert_eq!(alone[0].sliding, [0.0; 2]);
    }
}
