//! Source text of a file, and the position of keys in it.

use std::ops::Range;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::renamed::now;

/// Text of a file and its name in errors.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Source {
    name: String,
    text: String,
}

impl Source {
    pub(super) fn new(name: &str, text: &str) -> Self {
        Self {
            name: name.to_owned(),
            text: text.to_owned(),
        }
    }

    /// Name of the file as shown in errors.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Text of the file.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Line that contains a byte, from 1.
    pub fn line(&self, byte: usize) -> usize {
        let before = &self.text.as_bytes()[..byte.min(self.text.len())];
        1 + before.iter().filter(|&&b| b == b'\n').count()
    }

    /// Position of the value at a key path such as `tissue[2].young_kpa`; if it is not written, that of the innermost
    /// table around it.
    pub(super) fn find(&self, path: &str) -> Option<Range<usize>> {
        let root = DeTable::parse(&self.text).ok()?;
        let (mut table, mut list, mut found, mut name) = (Some(root.get_ref()), None, None, "");
        for step in path.split(['.', '[', ']']).filter(|step| !step.is_empty()) {
            let number = step.parse::<usize>().ok();
            // A list may be written as a single table.
            if table.is_some() && number == Some(0) {
                continue;
            }
            let value: Option<&Spanned<DeValue<'_>>> = match (table, list) {
                (Some(table), _) => table
                    .iter()
                    .find(|(key, _)| key.get_ref() == step || now(name, key.get_ref()) == Some(step))
                    .map(|(_, value)| value),
                (None, Some(list)) => number.and_then(|at| <[_]>::get(list, at)),
                (None, None) => None,
            };
            let Some(value) = value else { break };
            if number.is_none() {
                name = step;
            }
            found = Some(value.span());
            table = value.get_ref().as_table();
            list = value.get_ref().as_array().map(|list| &list[..]);
        }
        found
    }

    /// Position of a key in the table that an error points at; a tagged table is pointed at as a unit, by its header or its
    /// braces.
    pub(super) fn find_key(&self, table: &Range<usize>, name: &str) -> Option<Range<usize>> {
        fn search(value: &Spanned<DeValue<'_>>, table: &Range<usize>, name: &str) -> Option<Range<usize>> {
            match value.get_ref() {
                DeValue::Table(inner) if value.span() == *table => {
                    inner.keys().find(|key| key.get_ref() == name).map(Spanned::span)
                }
                DeValue::Table(inner) => inner.values().find_map(|value| search(value, table, name)),
                DeValue::Array(list) => list.iter().find_map(|value| search(value, table, name)),
                _ => None,
            }
        }
        let root = DeTable::parse(&self.text).ok()?;
        root.get_ref().values().find_map(|value| search(value, table, name))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "seed = 4\n[effects.tone]\ngain_db = 3 # loud\ntgc_points = [[0, 1], [2, 30]]\n\n[[tissue]]\nname = \"a\"\n[[tissue]]\nname = \"b\"\n";

    fn shown(path: &str) -> Option<&'static str> {
        Source::new("x", TEXT).find(path).map(|span| &TEXT[span])
    }

    #[test]
    fn paths_lead_to_values() {
        assert_eq!(shown("seed"), Some("4"));
        assert_eq!(shown("effects.tone.gain_db"), Some("3"));
        assert_eq!(shown("effects.tone.tgc_points[1][1]"), Some("30"));
        assert_eq!(shown("tissue[1].name"), Some("\"b\""));
        assert_eq!(shown("nothing"), None);
    }

    #[test]
    fn a_key_that_is_not_written_leads_to_its_table() {
        assert_eq!(shown("effects.tone.gamma"), Some("[effects.tone]"));
        assert_eq!(shown("tissue[0].young_kpa"), Some("[[tissue]]"));
        assert_eq!(shown("effects.tone.gain_db.deeper"), Some("3"));
    }
}
