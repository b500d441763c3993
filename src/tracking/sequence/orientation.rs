//! Orientation of stored ultrasound images: PLUS's `UltrasoundImageOrientation`.

/// Directions of the columns and rows of a stored image. The default is MF: columns towards the marked side, rows away
/// from the transducer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Orientation {
    /// Whether columns run along depth and rows across, as raw scan lines are stored.
    pub transposed: bool,
    /// Whether the lateral axis runs towards the unmarked side.
    pub towards_unmarked: bool,
    /// Whether the depth axis runs towards the transducer.
    pub towards_near: bool,
}

impl Orientation {
    /// Parses a name such as `MF`, `UNA` or `FM`: the direction of columns, then that of rows (Marked or Unmarked, Far
    /// or Near), then optionally that of planes (Ascending or Descending), which is ignored for a single plane.
    pub fn parse(name: &str) -> Option<Self> {
        let mut letters = name.chars();
        let (columns, rows) = (letters.next()?, letters.next()?);
        if !matches!((letters.next(), letters.next()), (None | Some('A' | 'D'), None)) {
            return None;
        }
        let (transposed, lateral, depth) = match (columns, rows) {
            ('M' | 'U', 'F' | 'N') => (false, columns, rows),
            ('F' | 'N', 'M' | 'U') => (true, rows, columns),
            _ => return None,
        };
        Some(Self {
            transposed,
            towards_unmarked: lateral == 'U',
            towards_near: depth == 'N',
        })
    }

    /// Swaps values of columns and rows as needed for MF.
    pub(super) fn turned<T>(self, [width, height]: [T; 2]) -> [T; 2] {
        if self.transposed {
            [height, width]
        } else {
            [width, height]
        }
    }

    /// Reorders the pixels of a stored image to MF.
    pub(super) fn to_mf(self, stored: &[u8], size: [usize; 2]) -> Vec<u8> {
        if self == Self::default() {
            return stored.to_vec();
        }
        let [width, height] = self.turned(size);
        let mut pixels = Vec::with_capacity(stored.len());
        for row in 0..height {
            let depth = if self.towards_near { height - 1 - row } else { row };
            for column in 0..width {
                let lateral = if self.towards_unmarked {
                    width - 1 - column
                } else {
                    column
                };
                let (x, y) = if self.transposed {
                    (depth, lateral)
                } else {
                    (lateral, depth)
                };
                pixels.push(stored[x + size[0] * y]);
            }
        }
        pixels
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_orientation_turns_to_mf() {
        // In MF: a row towards the marked side is 1 2 3, the row below it 4 5 6.
        let expected = [1, 2, 3, 4, 5, 6];
        for (name, size, stored) in [
            ("MF", [3, 2], [1, 2, 3, 4, 5, 6]),
            ("MFA", [3, 2], [1, 2, 3, 4, 5, 6]),
            ("UF", [3, 2], [3, 2, 1, 6, 5, 4]),
            ("MN", [3, 2], [4, 5, 6, 1, 2, 3]),
            ("UND", [3, 2], [6, 5, 4, 3, 2, 1]),
            ("FM", [2, 3], [1, 4, 2, 5, 3, 6]),
            ("NM", [2, 3], [4, 1, 5, 2, 6, 3]),
            ("FU", [2, 3], [3, 6, 2, 5, 1, 4]),
            ("NU", [2, 3], [6, 3, 5, 2, 4, 1]),
        ] {
            let orientation = Orientation::parse(name).unwrap();
            assert_eq!(orientation.turned(size), [3, 2], "{name}");
            assert_eq!(orientation.to_mf(&stored, size), expected, "{name}");
        }
        for name in ["XX", "", "M", "MM", "MFX", "MFAA", "FN"] {
            assert_eq!(Orientation::parse(name), None, "{name}");
        }
    }
}
