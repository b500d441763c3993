//! XML label table of Connectome Workbench (Caret) and TotalSegmentator in a NIfTI header extension.

use std::collections::BTreeMap;
use std::fmt::Write;

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
        None => text
            .replace("&lt;", "<")
            .replace("&gt;", ">")
            .replace("&quot;", "\"")
            .replace("&apos;", "'")
            .replace("&amp;", "&"),
    }
}

/// Label table as XML, for writing.
pub(crate) fn table<'a>(names: impl Iterator<Item = (i64, &'a str)>) -> String {
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
