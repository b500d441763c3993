//! Contact node on the needle: arc length, stick-slip state, and the tissue layers around the shaft.

use nalgebra::Point3;
use serde::{Deserialize, Serialize};

use super::slider::Slider;

/// Length of the path cut by the tip beyond a contact, within one region.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Layer {
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
    /// Arc length from the base, mm.
    pub arc: f64,
    pub slider: Slider,
    /// Region between this contact and the next, or the tip.
    pub region: Option<i32>,
    /// Last change of the arc, per mm of advance of the base.
    pub drift: f64,
    /// Layers of the path from here to the next contact, or to the tip.
    pub layers: Vec<Layer>,
}

impl Contact {
    /// Extends the path by a length (mm) that the tip has advanced in a region.
    pub fn lengthen(&mut self, region: Option<i32>, length: f64) {
        match self.layers.last_mut() {
            Some(last) if last.region == region => last.length += length,
            _ => self.layers.push(Layer { region, length }),
        }
    }

    /// Returns the length of the path from here to the next contact or the tip, mm.
    pub fn laid(&self) -> f64 {
        self.layers.iter().map(|layer| layer.length).sum()
    }

    /// Shortens the path to at most `length` (mm), after the tip was withdrawn.
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
