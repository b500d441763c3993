//! Segments of a `.seg.nrrd` of 3D Slicer: names by layer and value.

use std::collections::BTreeMap;

/// A segment.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Segment {
    pub(crate) name: Option<String>,
    /// Value within its layer; 1 if not stated.
    pub(crate) value: Option<i64>,
    /// Layer; 0 if not stated.
    pub(crate) layer: usize,
}

/// Parses the segments among the keys of a file, in file order, by layer and value. If two share both, the first
/// counts.
pub(crate) fn from_keys(key_values: &[(String, String)]) -> BTreeMap<(usize, i64), Option<String>> {
    let mut by_number: BTreeMap<usize, Segment> = BTreeMap::new();
    for (key, value) in key_values {
        let Some((number, what)) = key.strip_prefix("Segment").and_then(|rest| rest.split_once('_')) else {
            continue;
        };
        let Ok(number) = number.parse() else {
            continue;
        };
        let segment = by_number.entry(number).or_default();
        match what {
            "Name" => segment.name = Some(value.clone()),
            "ID" if segment.name.is_none() => segment.name = Some(value.clone()),
            "LabelValue" => segment.value = value.trim().parse().ok(),
            "Layer" => segment.layer = value.trim().parse().unwrap_or(0),
            _ => {}
        }
    }
    let mut segments = BTreeMap::new();
    for segment in by_number.into_values() {
        let value = segment.value.unwrap_or(1);
        segments.entry((segment.layer, value)).or_insert(segment.name);
    }
    segments
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_become_segments() {
        let keys = [
            ("Segment0_ID", "Segment_1"),
            ("Segment0_Name", "ribs: all"),
            ("Segment0_LabelValue", "7"),
            ("Segment1_ID", "only_id"),
            ("Segment1_Layer", "2"),
            ("Segmentation_Foo", "x"),
            ("Segment2_Layer", "2"),
        ];
        let read = from_keys(&keys.map(|(key, value)| (key.to_owned(), value.to_owned())));
        let expected = [
            ((0, 7), Some("ribs: all".to_owned())),
            ((2, 1), Some("only_id".to_owned())),
        ];
        assert_eq!(read, BTreeMap::from(expected));
    }
}
