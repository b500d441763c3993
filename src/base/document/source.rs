//! The text that a file was read from, and the places of its keys.

use std::ops::Range;

use schemars::JsonSchema;
use serde::de::DeserializeOwned;
use toml::Spanned;
use toml::de::DeValue;

use super::renamed::now;
use super::setting::Setting;
use super::typed::{self, Mismatch, parsed};

/// Text of a file and its name in errors, and keys set in it. Places are bytes of the text and of the settings after
/// it, each a line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Source {
    /// Name of the file as shown in errors; empty if there is none.
    pub(super) name: String,
    /// Complete text of the file.
    pub text: String,
    /// Each with its line of TOML behind as many blanks as bytes stand before it.
    settings: Vec<(Setting, String)>,
}

impl Source {
    pub(super) fn new(name: &str, text: &str, settings: &[Setting]) -> Self {
        let mut end = text.len();
        let placed = settings.iter().map(|setting| {
            let line = " ".repeat(end + 1) + &setting.line();
            end = line.len();
            (setting.clone(), line)
        });
        Self {
            name: name.to_owned(),
            text: text.to_owned(),
            settings: placed.collect(),
        }
    }

    /// Whether there is a file, and not settings alone.
    pub fn is_file(&self) -> bool {
        !self.name.is_empty()
    }

    /// Whether the file itself, without settings, has a key such as `scene.effects`.
    pub fn states(&self, path: &str) -> bool {
        let root = self.text.parse().map(toml::Value::Table).ok();
        root.is_some_and(|root| path.split('.').try_fold(&root, |value, key| value.get(key)).is_some())
    }

    /// The settings.
    pub fn settings(&self) -> impl Iterator<Item = &Setting> {
        self.settings.iter().map(|(setting, _)| setting)
    }

    /// The setting at a place.
    pub(super) fn setting_at(&self, byte: usize) -> Option<&Setting> {
        let behind = self.settings.iter().find(|(_, line)| byte <= line.len());
        behind.filter(|_| byte > self.text.len()).map(|(setting, _)| setting)
    }

    /// The text as TOML, with the settings.
    pub(super) fn document(&self) -> Result<Spanned<DeValue<'_>>, Mismatch> {
        let mut root = parsed(&self.text)?;
        for (setting, line) in &self.settings {
            setting.put(line, &mut root)?;
        }
        Ok(root)
    }

    /// Place of the setting that makes a readable file unreadable: serde knows none within a table of a kind.
    pub(super) fn culprit<T: DeserializeOwned + JsonSchema + 'static>(
        &self,
        settings: &[Setting],
    ) -> Option<Range<usize>> {
        let is_read = |count| typed::read::<T>(&Self::new(&self.name, &self.text, &settings[..count])).is_ok();
        let count = (0..settings.len()).find(|count| is_read(*count) && !is_read(count + 1))?;
        let (setting, line) = &self.settings[count];
        Some(line.len() - setting.line().len()..line.len())
    }

    /// Line that contains a byte, from 1.
    pub fn line(&self, byte: usize) -> usize {
        let before = &self.text.as_bytes()[..byte.min(self.text.len())];
        1 + before.iter().filter(|&&b| b == b'\n').count()
    }

    /// Line of the value at a key path, from 1, if it is written.
    pub fn line_of(&self, path: &str) -> Option<usize> {
        let start = self.find(path)?.start;
        self.setting_at(start).is_none().then(|| self.line(start))
    }

    /// Position of the value at a key path such as `tissue[2].young_kpa`; if it is not written, that of the innermost
    /// table around it.
    pub(super) fn find(&self, path: &str) -> Option<Range<usize>> {
        let root = self.document().ok()?;
        let (mut table, mut list, mut innermost, mut name) = (root.get_ref().as_table(), None, None, "");
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
                (None, Some(list)) => number.and_then(|index| <[_]>::get(list, index)),
                (None, None) => None,
            };
            let Some(value) = value else { break };
            // The name of a list is that of its tables, by which their keys may have been renamed.
            if number.is_none() {
                name = step;
            }
            innermost = Some(value.span());
            table = value.get_ref().as_table();
            list = value.get_ref().as_array().map(|list| &list[..]);
        }
        innermost
    }

    /// Position of a key in the table that an error points at; a tagged table is pointed at as a unit, by its header or
    /// its braces.
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
        let root = self.document().ok()?;
        let mut values = root.get_ref().as_table()?.values();
        values.find_map(|value| search(value, table, name))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "seed = 4\n[effects.tone]\ngain_db = 3 # loud\ntgc_points = [[0, 1], [2, 30]]\n\n[[tissue]]\nname = \"a\"\n[[tissue]]\nname = \"b\"\n";

    fn shown(path: &str) -> Option<&'static str> {
        Source::new("x", TEXT, &[]).find(path).map(|span| &TEXT[span])
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
