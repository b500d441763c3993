//! A node on the needle: where along the shaft, whether it sticks, and the friction of the tissue around it.

use nalgebra::Point3;
use serde::{Deserialize, Serialize};

use super::slider::Slider;

/// A length of the path that the tip has cut behind a contact, in one region.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Layer {
    /// None of tissue that is in no region.
    pub region: Option<i32>,
    /// mm.
    pub length: f64,
}

/// A node on the needle.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Contact {
    pub node: u32,
    /// Its place in the reference state, mm.
    pub reference: Point3<f64>,
    /// Its place along the shaft, mm from the base.
    pub arc: f64,
    pub slider: Slider,
    /// The region in front.
    pub region: Option<i32>,
    /// How its place along the shaft changed last, for each mm that the base went on.
    pub drift: f64,
    /// The path from here to the next contact, or to the tip.
    pub layers: Vec<Layer>,
}

impl Contact {
    /// The tip has gone on by a length (mm) in a region.
    pub fn lengthen(&mut self, region: Option<i32>, length: f64) {
        match self.layers.last_mut() {
            Some(last) if last.region == region => last.length += length,
            _ => self.layers.push(Layer { region, length }),
        }
    }

    /// Length of the path in front, mm.
    pub fn laid(&self) -> f64 {
        self.layers.iter().map(|layer| layer.length).sum()
    }

    /// The tip has come back: no more than `length` (mm) of the path is in front.
    pub fn shorten(&mut self, length: f64) {
        let mut left = length.max(0.0);
        self.layers.retain_mut(|layer| {
            layer.length = layer.length.min(left);
            left -= layer.length;
            layer.length > 0.0
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mechanics::insertion::finite::slider::State;

    #[test]
    fn the_path_grows_and_shrinks_by_region() {
        let mut contact = Contact {
            node: 0,
            reference: Point3::origin(),
            arc: 0.0,
            slider: Slider::new(State::Stuck),
            region: Some(1),
            drift: 0.0,
            layers: Vec::new(),
        };
        contact.lengthen(Some(1), 2.0);
        contact.lengthen(Some(1), 1.0);
        contact.lengthen(Some(2), 4.0);
        let layer = |region, length| Layer {
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
}
