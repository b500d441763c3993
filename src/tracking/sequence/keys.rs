//! Parsing of the keys of a PLUS sequence.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::Matrix4;

use super::TrackedTransform;
use insonify_base::number;
use insonify_base::text::some_of;

/// Key values of one frame.
#[derive(Clone, Debug, Default)]
pub(super) struct Frame {
    pub(super) timestamp: Option<f64>,
    pub(super) image_valid: Option<bool>,
    pub(super) transforms: BTreeMap<String, TrackedTransform>,
}

/// Key values of a file.
#[derive(Clone, Debug, Default)]
pub(super) struct Keys {
    pub(super) frames: BTreeMap<usize, Frame>,
    pub(super) orientation: Option<String>,
    pub(super) image_type: Option<String>,
    /// Kinds of the axes of the data, in lower case.
    pub(super) kinds: Vec<String>,
    pub(super) strays: usize,
    pub(super) warnings: Vec<String>,
}

/// Parses the keys of a header, in any order.
pub(super) fn parse(key_values: &[(String, String)]) -> Keys {
    let mut keys = Keys::default();
    let mut statuses: Vec<(usize, &str, bool)> = Vec::new();
    let mut unreadable = 0;
    let mut strays = BTreeSet::new();
    for (key, value) in key_values {
        let value = value.trim();
        match key.to_ascii_lowercase().replace(' ', "").as_str() {
            "ultrasoundimageorientation" => keys.orientation = Some(value.to_owned()),
            "ultrasoundimagetype" => keys.image_type = Some(value.to_owned()),
            "kinds" => keys.kinds = value.split_whitespace().map(str::to_ascii_lowercase).collect(),
            _ => {}
        }
        let Some((number, what)) = key.strip_prefix("Seq_Frame").and_then(|rest| rest.split_once('_')) else {
            continue;
        };
        let Ok(number) = number.parse::<usize>() else {
            keys.strays += 1;
            strays.insert(key.as_str());
            continue;
        };
        let frame = keys.frames.entry(number).or_default();
        let ok = value.eq_ignore_ascii_case("ok");
        match what {
            "Timestamp" => match number::parsed(value) {
                Some(seconds) => frame.timestamp = Some(seconds),
                None => unreadable += 1,
            },
            // NRRD sequences of PLUS shorten the key.
            "ImageStatus" | "Status" => frame.image_valid = Some(ok),
            "UnfilteredTimestamp" | "FrameNumber" => {}
            other => {
                // Slicer names transforms after their nodes, such as `LinearTransform_3`.
                let named = |suffix| other.strip_suffix(suffix).filter(|name| !name.is_empty());
                if let Some(name) = named("TransformStatus") {
                    statuses.push((number, name, ok));
                } else if let Some(name) = named("Transform") {
                    let matrix = matrix(value);
                    unreadable += usize::from(matrix.is_none());
                    let transform = TrackedTransform {
                        matrix: matrix.unwrap_or_else(Matrix4::identity),
                        valid: matrix.as_ref().is_some_and(is_affine),
                    };
                    frame.transforms.insert(name.to_owned(), transform);
                } else {
                    keys.strays += 1;
                    strays.insert(other);
                }
            }
        }
    }
    for (number, name, ok) in statuses {
        let known = keys
            .frames
            .get_mut(&number)
            .and_then(|frame| frame.transforms.get_mut(name));
        if let Some(transform) = known {
            transform.valid &= ok;
        }
    }
    if unreadable > 0 {
        keys.warnings.push(format!(
            "{unreadable} transforms or timestamps cannot be read as numbers: ignored"
        ));
    }
    if keys.strays > 0 {
        let strays: Vec<String> = strays.into_iter().map(str::to_owned).collect();
        keys.warnings.push(format!(
            "{} keys of frames are of no known kind and ignored: {}",
            keys.strays,
            some_of(&strays)
        ));
    }
    keys
}

/// Parses sixteen numbers, row by row.
fn matrix(text: &str) -> Option<Matrix4<f64>> {
    let numbers: Vec<f64> = text.split_whitespace().map(str::parse).collect::<Result<_, _>>().ok()?;
    (numbers.len() == 16).then(|| Matrix4::from_row_slice(&numbers))
}

fn is_affine(matrix: &Matrix4<f64>) -> bool {
    matrix.iter().all(|number| number.is_finite()) && (0..4).all(|n| matrix[(3, n)] == f64::from(u8::from(n == 3)))
}

/// Splits a name such as `ProbeToTracker` into its two coordinate systems.
pub fn ends(name: &str) -> Option<(&str, &str)> {
    name.match_indices("To").find_map(|(start, _)| {
        let (from, to) = (&name[..start], &name[start + 2..]);
        (!from.is_empty() && to.starts_with(char::is_uppercase)).then_some((from, to))
    })
}

// Orientation of stored ultrasound images: PLUS's `UltrasoundImageOrientation`.

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
    pub(super) fn to_mf<T: Copy>(self, stored: &[T], size: [usize; 2]) -> Vec<T> {
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
    fn names_split_at_their_to() {
        assert_eq!(ends("ProbeToTracker"), Some(("Probe", "Tracker")));
        assert_eq!(ends("ToolTipToTool"), Some(("ToolTip", "Tool")));
        assert_eq!(ends("StylusToTorso"), Some(("Stylus", "Torso")));
        assert_eq!(ends("Stylus"), None);
        assert_eq!(ends("Tool"), None);
        assert_eq!(ends("AutoTo"), None);
    }

    fn parsed(pairs: &[(&str, &str)]) -> Keys {
        parse(
            &pairs
                .iter()
                .map(|(key, value)| ((*key).to_owned(), (*value).to_owned()))
                .collect::<Vec<_>>(),
        )
    }

    const IDENTITY: &str = "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1";

    #[test]
    fn a_status_counts_wherever_it_stands() {
        for order in [[0, 1], [1, 0]] {
            let pairs = [
                ("Seq_Frame0000_AToBTransform", IDENTITY),
                ("Seq_Frame0000_AToBTransformStatus", "INVALID"),
            ];
            let keys = parsed(&order.map(|n| pairs[n]));
            assert!(!keys.frames[&0].transforms["AToB"].valid);
        }
        let keys = parsed(&[("Seq_Frame0000_AToBTransform", IDENTITY)]);
        assert!(keys.frames[&0].transforms["AToB"].valid);
    }

    #[test]
    fn broken_transforms_are_invalid_and_counted() {
        for broken in ["1 2 3", "a b c", "1 0 0 0 0 1 0 0 0 0 1 0 0 0 1 1", ""] {
            let keys = parsed(&[("Seq_Frame0000_AToBTransform", broken)]);
            assert!(!keys.frames[&0].transforms["AToB"].valid, "{broken:?}");
        }
        let keys = parsed(&[("Seq_Frame0000_AToBTransform", "1 2 3"), ("Seq_Framex_Y", "1")]);
        assert_eq!(keys.strays, 1);
        assert_eq!(keys.warnings.len(), 2);
        assert!(
            keys.warnings[1].ends_with("ignored: Seq_Framex_Y"),
            "{:?}",
            keys.warnings
        );
    }

    #[test]
    fn transforms_may_be_named_after_nodes() {
        let keys = parsed(&[
            ("Seq_Frame0000_LinearTransform_3Transform", IDENTITY),
            ("Seq_Frame0000_LinearTransform_3TransformStatus", "INVALID"),
            ("Seq_Frame0000_Transform", IDENTITY),
        ]);
        assert!(!keys.frames[&0].transforms["LinearTransform_3"].valid);
        assert_eq!((keys.frames[&0].transforms.len(), keys.strays), (1, 1));
    }

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
