//! Tissue layers along the line of a needle.

/// A layer of tissue along the line of the needle, behind a membrane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layer {
    /// Start of the layer from the entry, in the reference state, mm. The first begins at 0.
    pub from_mm: f64,
    /// Strength of its membrane, N (0 or more; 0: there is none).
    pub membrane_n: f64,
    /// Cutting force at the tip, N (0 or more).
    pub cutting_n: f64,
    /// Sliding friction per length of shaft, N/mm (0 or more).
    pub friction_n_per_mm: f64,
    /// Ratio of static to sliding friction (1 or more).
    pub static_ratio: f64,
}

/// Reason why the line of a needle cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum InvalidWay {
    /// The line does not enter the body.
    #[error("the entry {entry:?} lies outside the body")]
    Outside {
        /// The entry, mm.
        entry: Vec<f64>,
    },
    /// The direction has zero length or is not finite.
    #[error("the direction {found:?} is none; expected a vector with a length")]
    Direction {
        /// The rejected direction.
        found: Vec<f64>,
    },
    /// There are no layers, or the first does not begin at the entry.
    #[error("the first layer begins at {found:?} mm; expected 0")]
    First {
        /// Start of the first layer, if there is one.
        found: Option<f64>,
    },
    /// A layer begins before the one above, or a number is out of range.
    #[error("{what} of layer {layer} is {found}; expected {expected}")]
    Layer {
        /// Index of the layer, from 0.
        layer: usize,
        /// Name of the number.
        what: &'static str,
        /// The rejected value.
        found: f64,
        /// Permitted values.
        expected: &'static str,
    },
}

/// Checks layers, given in the order in which they are met.
pub(super) fn check(layers: &[Layer]) -> Result<(), InvalidWay> {
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
        let ratio = layer.static_ratio;
        if !(ratio.is_finite() && ratio >= 1.0) {
            return wrong("static_ratio", ratio, "a finite number, 1 or more");
        }
    }
    Ok(())
}
