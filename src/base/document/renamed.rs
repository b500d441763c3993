//! Renamed keys whose old names are still accepted.

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::Source;

/// Table of a key (empty: none), its old name and its new name. The types read the old names as aliases.
const RENAMED: &[[&str; 3]] = &[
    ["", "nonlinear", "solver"],
    ["", "region", "region_array"],
    ["", "structure", "memory"],
    ["", "viscoelastic", "viscosity"],
    ["", "knee_strain", "knee_shear"],
    ["load", "force_n", "node_force_n"],
    ["tissue", "cutting_force_n", "cutting_n"],
    ["tissue", "needle_friction_n_mm", "friction_n_per_mm"],
    ["viscosity", "law", "memory"],
];

/// Current name of a renamed key of a table.
pub(super) fn now(table: &str, key: &str) -> Option<&'static str> {
    let row = RENAMED.iter().find(|[owner, old, _]| (*owner, *old) == (table, key));
    row.map(|[.., new]| *new)
}

/// Whether a known key is the old name of another known one.
pub(super) fn is_old(key: &str, known: &[String]) -> bool {
    let stands_for = |[_, old, new]: &[&str; 3]| *old == key && known.iter().any(|known| known == new);
    RENAMED.iter().any(stands_for)
}

impl Source {
    /// Notes about keys under old names, in the order of the text.
    pub fn renamed(&self) -> Vec<String> {
        let mut old_keys = Vec::new();
        if let Ok(root) = self.document() {
            within("", &root, &mut old_keys);
        }
        old_keys.sort_unstable();
        let note = |(offset, old, new): (usize, String, &str)| {
            let place = match self.setting_at(offset) {
                Some(setting) => setting.option().to_owned(),
                None => format!("{}, line {}", self.name, self.line(offset)),
            };
            format!("{place}: `{old}` is now called `{new}`")
        };
        old_keys.into_iter().map(note).collect()
    }
}

/// Adds the keys of a table and those below it that have old names, each with its offset and its name now.
fn collect(name: &str, table: &DeTable<'_>, old_keys: &mut Vec<(usize, String, &'static str)>) {
    for (key, value) in table {
        let new = now(name, key.get_ref());
        if let Some(new) = new {
            old_keys.push((key.span().start, key.get_ref().to_string(), new));
        }
        // The tables below go by the new name, as the list of renamed keys does.
        within(new.unwrap_or(key.get_ref()), value, old_keys);
    }
}

fn within(name: &str, value: &Spanned<DeValue<'_>>, old_keys: &mut Vec<(usize, String, &'static str)>) {
    match value.get_ref() {
        DeValue::Table(table) => collect(name, table, old_keys),
        DeValue::Array(list) => list.iter().for_each(|value| within(name, value, old_keys)),
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn old_names_are_noted_where_they_stand() {
        let text = "region = \"organ\"\n[[load]]\nforce_n = [0, 0, 1]\n[[fix]]\nregion = 3\n[scene]\ntissue = [{ cutting_force_n = 1 }]\n[viscoelastic]\nlaw = \"rate\"\n";
        let expected = [
            "p.toml, line 1: `region` is now called `region_array`",
            "p.toml, line 3: `force_n` is now called `node_force_n`",
            "p.toml, line 7: `cutting_force_n` is now called `cutting_n`",
            "p.toml, line 8: `viscoelastic` is now called `viscosity`",
            "p.toml, line 9: `law` is now called `memory`",
        ];
        let source = Source::new("p.toml", text, &[]);
        assert_eq!(source.renamed(), expected);
        assert_eq!(
            source.find("viscosity.memory").map(|span| &text[span]),
            Some("\"rate\"")
        );
    }
}
