//! Keys of a file that are set from outside, such as by options of the command.

use toml::Spanned;
use toml::de::{DeArray, DeString, DeTable, DeValue};

use super::renamed::now;
use super::typed::{Mismatch, parsed};
use crate::text::clipped;

/// Key that may name a file in place of a table; keys below it are then set in that file.
const NAMES_A_FILE: &str = "scene";
/// Maximum columns of an option in errors.
const SHOWN: usize = 80;

/// A key of a file with the value that replaces whatever the file says of it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Setting {
    /// Parts of the key; a number is the place in a list, from 0.
    path: Vec<String>,
    /// Value in TOML.
    value: String,
    /// Keys of the table that stay. `None` replaces the key; else it is removed but for them.
    kept: Option<&'static [&'static str]>,
    /// The option that sets the key, as errors name it; empty: they name none.
    option: String,
}

impl Setting {
    /// Parses `KEY=VALUE`: a dotted key, and a value in TOML; a value that is none is a text. `option` is what errors
    /// name as the place.
    ///
    /// # Errors
    /// The fault, for the user.
    pub fn parse(assignment: &str, option: &str) -> Result<Self, String> {
        const EXPECTED: &str = "expected KEY=VALUE, such as effects.tone.gain_db=6";
        let (key, value) = assignment.split_once('=').ok_or(EXPECTED)?;
        let (key, value) = (key.trim(), value.trim());
        let path = parts(key).ok_or_else(|| format!("`{key}` is not a key; {EXPECTED}"))?;
        if value.is_empty() {
            return Err(format!("no value; {EXPECTED}; \"\" in quotes is an empty text"));
        }
        let value = match DeValue::parse(value) {
            Ok(_) => value.to_owned(),
            Err(error) if value.starts_with(['[', '{', '"', '\'']) => {
                return Err(format!(
                    "the value is not TOML: {}",
                    error.message().trim_end().replace('\n', "; ")
                ));
            }
            Err(_) => toml::Value::from(value).to_string(),
        };
        Ok(Self {
            path,
            value,
            kept: None,
            option: clipped(option, SHOWN),
        })
    }

    /// Sets a key to a value; errors name no place.
    pub fn new(key: &str, value: impl Into<toml::Value>) -> Self {
        Self {
            path: key.split('.').map(str::to_owned).collect(),
            value: value.into().to_string(),
            kept: None,
            option: String::new(),
        }
    }

    /// Removes a key, or all of its table but some keys.
    pub fn removal(key: &str, kept: &'static [&'static str]) -> Self {
        Self {
            kept: Some(kept),
            ..Self::new(key, false)
        }
    }

    /// The option that sets the key.
    pub(super) fn option(&self) -> &str {
        &self.option
    }

    /// Whether it gives this key a value.
    pub fn states(&self, key: &str) -> bool {
        self.kept.is_none() && self.path.join(".") == key
    }

    /// Whether the key is this one, or lies below it or above.
    pub fn concerns(&self, key: &str) -> bool {
        self.path.iter().zip(key.split('.')).all(|(part, other)| part == other)
    }

    /// The value, if it is a text.
    pub fn text(&self) -> Option<String> {
        let value = DeValue::parse(&self.value).ok()?;
        value.get_ref().as_str().map(str::to_owned)
    }

    /// The setting as a line of TOML.
    pub fn line(&self) -> String {
        let is_bare = |c: char| c.is_ascii_alphanumeric() || "_-".contains(c);
        let quoted = |part: &String| {
            if !part.is_empty() && part.chars().all(is_bare) {
                part.clone()
            } else {
                serde_json::Value::from(part.as_str()).to_string()
            }
        };
        let key: Vec<String> = self.path.iter().map(quoted).collect();
        format!("{} = {}", key.join("."), self.value)
    }

    /// The same of the file that the key `scene` names, if it lies below that key.
    pub fn within_scene(&self) -> Option<Self> {
        let (first, path) = self.path.split_first().filter(|(_, path)| !path.is_empty())?;
        (first == NAMES_A_FILE).then(|| Self {
            path: path.to_vec(),
            ..self.clone()
        })
    }

    /// Puts the setting into a document; `line` is its line, behind the blanks that give it its place.
    pub(super) fn put<'i>(&self, line: &'i str, root: &mut Spanned<DeValue<'i>>) -> Result<(), Mismatch> {
        let names_a_file = |table: &DeTable<'_>| table.get(NAMES_A_FILE).is_some_and(|scene| scene.get_ref().is_str());
        if self.within_scene().is_some() && root.get_ref().as_table().is_some_and(names_a_file) {
            return Ok(());
        }
        let mut value = parsed(line)?;
        let mut path = Vec::with_capacity(self.path.len());
        for _ in &self.path {
            let DeValue::Table(table) = value.into_inner() else {
                return Ok(());
            };
            let Some((key, inner)) = table.into_iter().next() else {
                return Ok(());
            };
            path.push(key);
            value = inner;
        }
        match self.kept {
            None => set(root, "", &path, value),
            Some(kept) => {
                remove(root, &path, kept);
                Ok(())
            }
        }
    }
}

/// Parts of a dotted key of TOML, in which `list[2].key` is `list.2.key`.
fn parts(key: &str) -> Option<Vec<String>> {
    let key = key.replace('[', ".").replace(']', "");
    let line = format!("{key} = 0");
    let mut value = parsed(&line).ok().filter(|_| !key.contains(['\n', '#']))?.into_inner();
    let mut path = Vec::new();
    while let DeValue::Table(table) = value {
        let (key, inner) = table.into_iter().next()?;
        path.push(key.into_inner().into_owned());
        value = inner.into_inner();
    }
    Some(path)
}

/// Sets what lies at a path below a value; `name` is the key of the value.
fn set<'i>(
    value: &mut Spanned<DeValue<'i>>,
    name: &str,
    path: &[Spanned<DeString<'i>>],
    new: Spanned<DeValue<'i>>,
) -> Result<(), Mismatch> {
    let Some((key, rest)) = path.split_first() else {
        *value = new;
        return Ok(());
    };
    let step = key.get_ref().as_ref();
    let nothing = || Spanned::new(key.span(), DeValue::Boolean(false));
    match value.get_mut() {
        // A list may be written as a single table.
        DeValue::Table(table) if step == "0" && !table.is_empty() => set(value, name, rest, new),
        DeValue::Table(table) => {
            let is_same =
                |known: &str| known == step || now(name, known) == Some(step) || now(name, step) == Some(known);
            let known = table.keys().find(|known| is_same(known.get_ref()));
            let known = known.map_or_else(|| key.clone(), Clone::clone);
            let mut inner = table.remove(&known).unwrap_or_else(nothing);
            let set = set(&mut inner, step, rest, new);
            // Under its own name where the whole value is new: an error then points at the setting.
            table.insert(if rest.is_empty() { key.clone() } else { known }, inner);
            set
        }
        DeValue::Array(list) => {
            let count = list.len();
            let Some(index) = step.parse().ok().filter(|index: &usize| *index <= count) else {
                return Err(Mismatch {
                    message: format!(
                        "found `{step}` in a list of {count}; expected its place from 0, or {count} to add to it"
                    ),
                    span: Some(key.span()),
                });
            };
            if index == count {
                list.push(nothing());
            }
            let elements: &mut [_] = list;
            set(&mut elements[index], name, rest, new)
        }
        _ => {
            let is_place = step.parse::<usize>().is_ok();
            let list = is_place.then(|| DeValue::Array(DeArray::new()));
            let empty = list.unwrap_or_else(|| DeValue::Table(DeTable::new()));
            *value = Spanned::new(key.span(), empty);
            set(value, name, path, new)
        }
    }
}

/// Removes a key of a table, or all of the key's own table but some keys.
fn remove<'i>(value: &mut Spanned<DeValue<'i>>, path: &[Spanned<DeString<'i>>], kept: &[&str]) {
    let (DeValue::Table(table), Some((key, rest))) = (value.get_mut(), path.split_first()) else {
        return;
    };
    match (table.get_mut(key), rest) {
        (Some(inner), [_, ..]) => remove(inner, rest, kept),
        (Some(inner), []) => match inner.get_mut() {
            DeValue::Table(inner) if !kept.is_empty() => {
                let stays = |key: &str| kept.contains(&key);
                let all = std::mem::take(inner).into_iter();
                *inner = all.filter(|(key, _)| stays(key.get_ref())).collect();
            }
            _ => {
                table.remove(key);
            }
        },
        (None, _) => {}
    }
}

#[cfg(test)]
mod tests {
    use schemars::JsonSchema;
    use serde::Deserialize;

    use super::*;
    use crate::document::{InputError, parse};

    #[derive(Debug, Default, Deserialize, JsonSchema, PartialEq)]
    #[serde(deny_unknown_fields)]
    struct File {
        seed: Option<u64>,
        name: Option<String>,
        tone: Option<Tone>,
        #[serde(default)]
        tissue: Vec<Tone>,
        law: Option<Law>,
        scene: Option<String>,
    }

    #[derive(Debug, Default, Deserialize, JsonSchema, PartialEq)]
    #[serde(deny_unknown_fields)]
    struct Tone {
        gain_db: Option<f64>,
        points: Option<Vec<[f64; 2]>>,
        #[serde(alias = "cutting_force_n")]
        cutting_n: Option<f64>,
    }

    #[derive(Debug, Deserialize, JsonSchema, PartialEq)]
    #[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
    enum Law {
        Neo { rate: f64 },
    }

    fn read(text: &str, assignments: &[&str]) -> Result<File, InputError> {
        let setting = |text: &&str| Setting::parse(text, &format!("--set {text}")).expect(text);
        let settings: Vec<Setting> = assignments.iter().map(setting).collect();
        parse(text, "f.toml", &settings).map(|(file, _)| file)
    }

    #[test]
    fn a_setting_is_the_same_key_written_in_the_file() {
        for (text, settings, expected) in [
            ("", &["seed=3"][..], "seed = 3"),
            ("seed = 1\n# end", &["seed = 3"], "seed = 3"),
            ("seed = 1", &["seed=2", "seed=3"], "seed = 3"),
            ("", &["name=kidney right.nii"], "name = \"kidney right.nii\""),
            ("", &["name=a=b"], "name = \"a=b\""),
            ("", &["name='5'"], "name = \"5\""),
            ("name = 'x'\n", &["tone.gain_db=-6"], "name = 'x'\ntone.gain_db = -6"),
            (
                "[tone]\ngain_db = 1\npoints = [[0, 1]]",
                &["tone.gain_db=2"],
                "tone = { gain_db = 2, points = [[0, 1]] }",
            ),
            (
                "tone = { gain_db = 1 }",
                &["tone.points=[[1, 2]]"],
                "[tone]\ngain_db = 1\npoints = [[1, 2]]",
            ),
            ("tone.gain_db = 1", &["tone={points=[]}"], "[tone]\npoints = []"),
            (
                "tone.points = [[0, 1], [2, 3]]",
                &["tone.points.1.0=7"],
                "tone.points = [[0, 1], [7, 3]]",
            ),
            (
                "[[tissue]]\ngain_db = 1\n[[tissue]]",
                &["tissue.1.gain_db=2"],
                "tissue = [{ gain_db = 1 }, { gain_db = 2 }]",
            ),
            (
                "[[tissue]]\ngain_db = 1",
                &["tissue[1].gain_db=2"],
                "tissue = [{ gain_db = 1 }, { gain_db = 2 }]",
            ),
            (
                "",
                &["tissue.0.gain_db=1", "tissue.0.cutting_n=2"],
                "tissue = [{ gain_db = 1, cutting_n = 2 }]",
            ),
            (
                "[[tissue]]\ncutting_force_n = 1",
                &["tissue.0.cutting_n=2"],
                "tissue = [{ cutting_n = 2 }]",
            ),
            (
                "[[tissue]]\ncutting_n = 1",
                &["tissue.0.cutting_force_n=2"],
                "tissue = [{ cutting_n = 2 }]",
            ),
            (
                "law = { kind = 'neo', rate = 1 }",
                &["law.rate=2"],
                "law = { kind = 'neo', rate = 2 }",
            ),
            ("scene = 'sweep'", &["scene.seed=2"], "scene = 'sweep'"),
        ] {
            let [set, written] = [read(text, settings), read(expected, &[])].map(|file| file.expect(text));
            assert_eq!(set, written, "{text} {settings:?}");
        }
    }

    #[test]
    fn errors_of_settings_name_the_option() {
        for (text, setting, expected, help) in [
            (
                "seed = 1",
                "seed=x",
                "found string \"x\", expected an integer of 0 or more (--set seed=x)",
                None,
            ),
            (
                "[tone]\ngain_db = 1",
                "tone.gian_db=1",
                "unknown key `gian_db` (--set tone.gian_db=1)",
                Some("did you mean `gain_db`?"),
            ),
            (
                "",
                "tonne.gain_db=1",
                "unknown key `tonne` (--set tonne.gain_db=1)",
                Some("did you mean `tone`?"),
            ),
            (
                "",
                "tone=[1]",
                "`tone`: found a list, expected a table (--set tone=[1])",
                None,
            ),
            (
                "",
                "tissue.1.gain_db=1",
                "found `1` in a list of 0; expected its place from 0, or 0 to add to it (--set tissue.1.gain_db=1)",
                None,
            ),
            (
                "tissue = [{}]",
                "tissue.2.gain_db=1",
                "found `2` in a list of 1; expected its place from 0, or 1 to add to it (--set tissue.2.gain_db=1)",
                None,
            ),
            (
                "tissue = [{}]",
                "tissue.liver=1",
                "found `liver` in a list of 1; expected its place from 0, or 1 to add to it (--set tissue.liver=1)",
                None,
            ),
            (
                "seed = 1",
                "seed.deep=1",
                "found a table, expected an integer of 0 or more (--set seed.deep=1)",
                None,
            ),
            (
                "[law]\nkind = 'neo'\nrate = 1",
                "law.rate=fast",
                "found string \"fast\", expected a number (--set law.rate=fast)",
                None,
            ),
        ] {
            let error = read(text, &["name=first", setting]).expect_err(setting);
            assert_eq!((error.to_string().as_str(), error.help()), (expected, help));
            assert_eq!(error.location(), None);
        }
        // What is wrong in the file stays there.
        let error = read("seed = 1\nname = 2", &["seed=3"]).expect_err("a wrong file");
        assert_eq!(error.location(), Some(("f.toml", 2)));
    }

    #[test]
    fn what_is_no_assignment_is_refused() {
        for wrong in [
            "seed", "=3", "seed=", "a b=3", "a..b=3", "a#b=3", "[x]\ny=3", "a={x", "a=[1", "a='b", "a=\"b",
        ] {
            assert!(Setting::parse(wrong, "").is_err(), "{wrong}");
        }
    }

    #[test]
    fn removed_keys_are_gone_but_for_those_that_stay() {
        let kept = |setting| {
            parse::<File>("name = 'x'\n[tone]\ngain_db = 1\npoints = []", "f", &[setting])
                .expect("a file")
                .0
        };
        assert_eq!(
            kept(Setting::removal("tone.gain_db", &[]))
                .tone
                .expect("a table")
                .gain_db,
            None
        );
        assert_eq!(kept(Setting::removal("tone", &[])).tone, None);
        let tone = kept(Setting::removal("tone", &["gain_db"])).tone.expect("a table");
        assert_eq!((tone.gain_db, tone.points), (Some(1.0), None));
    }
}
