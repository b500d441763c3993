//! Names of labels in files: as user-defined keys `LabelName_<value>`, as segments of 3D Slicer, as groups of MITK, and
//! as a table in XML.

use std::collections::BTreeMap;
use std::fmt::Write;

use crate::acoustics::known;
use insonify_base::text::unescape;
use serde_json::Value;

const PREFIX: &str = "LabelName_";

/// Key of the name of a label value.
pub(super) fn key(value: i64) -> String {
    format!("{PREFIX}{value}")
}

/// Parses the label names among the keys of a file.
pub(super) fn from_keys(key_values: &[(String, String)]) -> BTreeMap<i64, String> {
    key_values
        .iter()
        .filter_map(|(key, name)| Some((key.strip_prefix(PREFIX)?.parse().ok()?, name.clone())))
        .collect()
}

// Segments of a `.seg.nrrd` of 3D Slicer: names by layer and value.

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Segment {
    pub name: Option<String>,
    /// Value within its layer; 1 if not stated.
    pub value: Option<i64>,
    /// Layer; 0 if not stated.
    pub layer: usize,
    /// What a code of its terminology says that it is.
    pub code: Option<String>,
}

/// Name of a segment: what its code says where its own name is that of no tissue.
pub(super) fn coded(name: Option<String>, code: Option<String>) -> Option<String> {
    let is_known = |name: &String| known(name).is_some();
    let code = code.filter(|code| is_known(code) || name.is_none());
    match code {
        Some(code) if !name.as_ref().is_some_and(is_known) => Some(code),
        _ => name,
    }
}

/// Type and side in the tags of a segment of 3D Slicer: context, category, type and its modifier, each of scheme, value
/// and meaning. Segments of no stated type are of the type tissue.
fn terminology(tags: &str) -> Option<String> {
    const TISSUE: &str = "85756007";
    let (_, entry) = tags.split_once("TerminologyEntry:")?;
    let entry = entry.split('|').next()?;
    let mut codes = entry.split('~').skip(2).map(|code| code.splitn(3, '^').skip(1));
    let mut kind = codes.next()?;
    let (value, meaning) = (kind.next()?, kind.next()?);
    let side = codes
        .next()
        .and_then(|mut modifier| modifier.nth(1))
        .unwrap_or_default();
    let text = format!("{side} {meaning}").trim().to_owned();
    (value != TISSUE && !meaning.is_empty()).then_some(text)
}

/// Parses the segments among the keys of a file by layer and value, those of 3D Slicer in file order. If two share
/// both, the first counts.
pub(super) fn segments(key_values: &[(String, String)]) -> BTreeMap<(usize, i64), Option<String>> {
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
            "Tags" => segment.code = terminology(value),
            "Layer" => segment.layer = value.trim().parse().unwrap_or(0),
            _ => {}
        }
    }
    let mut by_place = groups(key_values);
    for segment in by_number.into_values() {
        let value = segment.value.unwrap_or(1);
        let name = segment.name.filter(|name| !name.trim().is_empty());
        by_place
            .entry((segment.layer, value))
            .or_insert_with(|| coded(name, segment.code));
    }
    by_place
}

/// Key of the groups of labels in a segmentation of MITK, as JSON: a list with one entry a layer, each with its
/// `labels`.
const GROUPS: &str = "org.mitk.multilabel.segmentation.labelgroups";

/// Beginning of the key of one label in older segmentations of MITK, as XML; the layer and a count follow.
const LABEL: &str = "org.mitk.label_";

/// Parses the labels of MITK among the keys of a file, by layer and value.
fn groups(key_values: &[(String, String)]) -> BTreeMap<(usize, i64), Option<String>> {
    let mut by_place = BTreeMap::new();
    for (key, text) in key_values {
        if key == GROUPS {
            let groups = serde_json::from_str::<Vec<Value>>(text).unwrap_or_default();
            for (layer, group) in groups.iter().enumerate() {
                for label in group["labels"].as_array().into_iter().flatten() {
                    if let Some(value) = label["value"].as_i64() {
                        by_place.insert((layer, value), label["name"].as_str().map(str::to_owned));
                    }
                }
            }
        } else if let Some((layer, _)) = key.strip_prefix(LABEL).and_then(|rest| rest.split_once('_'))
            && let Ok(layer) = layer.parse()
            && let Some(Ok(value)) = property(text, "value").map(|value| value.parse())
        {
            by_place.insert((layer, value), property(text, "name"));
        }
    }
    by_place
}

/// Value of a property in the XML of a label of MITK: `<property key="name" ..><string value="Liver"/>`.
fn property(xml: &str, key: &str) -> Option<String> {
    let (_, rest) = xml.split_once(&format!("key=\"{key}\""))?;
    let (_, rest) = rest.split_once(" value=\"")?;
    let (value, _) = rest.split_once('"')?;
    Some(unescape(value))
}

// XML label table of Connectome Workbench (Caret) and TotalSegmentator in a NIfTI header extension.

/// Extension code of Caret's XML (`nifti1_io.h`: `NIFTI_ECODE_CARET`).
pub(crate) const EXTENSION_CODE: i32 = 30;

/// Names by label value: the text of every `<Label Key="..">`.
pub(crate) fn label_names(xml: &str) -> BTreeMap<i64, String> {
    let mut names = BTreeMap::new();
    let mut rest = xml;
    while let Some(start) = rest.find("<Label ") {
        rest = &rest[start + "<Label ".len()..];
        let Some((attributes, after)) = rest.split_once('>') else {
            break;
        };
        if attributes.ends_with('/') {
            rest = after;
            continue;
        }
        let Some((text, after)) = after.split_once("</Label>") else {
            break;
        };
        let key = attributes
            .split_once("Key=\"")
            .and_then(|(_, value)| value.split_once('"'))
            .and_then(|(value, _)| value.trim().parse().ok());
        let name = plain(text.trim());
        if let (Some(key), false) = (key, name.is_empty()) {
            names.insert(key, name);
        }
        rest = after;
    }
    names
}

/// Text content without CDATA wrapping, or with its entities resolved.
fn plain(text: &str) -> String {
    match text
        .strip_prefix("<![CDATA[")
        .and_then(|inner| inner.strip_suffix("]]>"))
    {
        Some(inner) => inner.replace("]]]]><![CDATA[>", "]]>"),
        None => unescape(text),
    }
}

/// Label table as XML, for writing.
pub(super) fn table<'a>(names: impl Iterator<Item = (i64, &'a str)>) -> String {
    let mut xml = String::from(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<CaretExtension>\n<VolumeInformation Index=\"0\">\n<LabelTable>\n",
    );
    for (value, name) in names {
        let name = name.replace("]]>", "]]]]><![CDATA[>");
        // Writing to a string cannot fail.
        let _ = writeln!(
            xml,
            "<Label Key=\"{value}\" Red=\"1\" Green=\"1\" Blue=\"1\" Alpha=\"1\"><![CDATA[{name}]]></Label>"
        );
    }
    xml.push_str(
        "</LabelTable>\n<VolumeType><![CDATA[Label]]></VolumeType>\n</VolumeInformation>\n</CaretExtension>\n",
    );
    xml
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
        let read = segments(&keys.map(|(key, value)| (key.to_owned(), value.to_owned())));
        let expected = [
            ((0, 7), Some("ribs: all".to_owned())),
            ((2, 1), Some("only_id".to_owned())),
        ];
        assert_eq!(read, BTreeMap::from(expected));
    }

    #[test]
    fn a_code_names_what_its_own_name_does_not() {
        let tags = |code: &str, side: &str| {
            format!(
                "Segmentation.Status:completed|TerminologyEntry:list~SCT^123037004^Anatomical Structure~SCT^{code}~{side}~~^^~^^|"
            )
        };
        let kidney = tags("64033007^Kidney", "SCT^7771000^Left");
        for (name, tags, expected) in [
            ("Segment_1", tags("10200004^Liver", "^^"), "Liver"),
            ("Niere links", kidney.clone(), "Left Kidney"),
            // Near misses: a known name, the code of all segments, and one of no tissue.
            ("spleen", kidney, "spleen"),
            ("Segment_1", tags("85756007^Tissue", "^^"), "Segment_1"),
            ("Segment_1", tags("1^Thing", "^^"), "Segment_1"),
        ] {
            let keys = [
                ("Segment0_Name".to_owned(), name.to_owned()),
                ("Segment0_Tags".to_owned(), tags),
            ];
            assert_eq!(segments(&keys)[&(0, 1)].as_deref(), Some(expected), "{name}");
        }
    }

    #[test]
    fn groups_of_mitk_become_segments() {
        let json = r#"[{"name": "organs", "labels": [{"name": "Liver", "value": 1, "visible": true}, {"value": 3}]}, {"name": "empty"},
            {"labels": null}, {"labels": [{"name": "Tumor", "value": 4}, {"name": "no value"}]}]"#;
        let read = |json: &str| segments(&[(GROUPS.to_owned(), json.to_owned())]);
        let expected = [
            ((0, 1), Some("Liver".to_owned())),
            ((0, 3), None),
            ((3, 4), Some("Tumor".to_owned())),
        ];
        assert_eq!(read(json), BTreeMap::from(expected));
        let label = |name: &str, value: u8| {
            format!(
                "<?xml version=\"1.0\"?><Label><property key=\"name\" type=\"StringProperty\"><string value=\"{name}\"/></property>\
                 <property key=\"value\" type=\"UIntProperty\"><unsigned value=\"{value}\"/></property></Label>"
            )
        };
        let older = [
            ("000_00000", label("Exterior", 0)),
            ("001_00001", label("Gall &amp; duct", 7)),
            ("x", label("no layer", 1)),
        ];
        let older = segments(&older.map(|(key, text)| (format!("{LABEL}{key}"), text)));
        let expected = [((0, 0), "Exterior"), ((1, 7), "Gall & duct")].map(|(key, name)| (key, Some(name.to_owned())));
        assert_eq!(older, BTreeMap::from(expected));
        assert!(read("[{").is_empty() && read("{\"labels\": 1}").is_empty());
    }

    #[test]
    fn names_come_back_from_the_table() {
        let names = [(1, "liver"), (-4, "a < b & \"c\""), (9, "odd ]]> name")];
        let read = label_names(&table(names.into_iter()));
        assert_eq!(
            read,
            BTreeMap::from(names.map(|(value, name)| (value, name.to_owned())))
        );
    }

    #[test]
    fn entities_and_broken_tables() {
        assert_eq!(label_names("<Label Key=\"2\">a &amp;lt; b</Label>")[&2], "a &lt; b");
        assert!(label_names("<Label Key=\"2\"").is_empty());
        assert!(label_names("<Label Key=\"two\">x</Label>").is_empty());
        assert!(label_names("<Label Key=\"2\">no end").is_empty());
    }
}
