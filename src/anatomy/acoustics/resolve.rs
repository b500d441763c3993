//! Assignment of tissues to the labels of a volume.

use super::{Preset, Tissue, TissueError, TissueOverride, TissueTable, numbering, presets};
use crate::volume::Label;
use insonify_base::document::plain;
use insonify_base::text;

/// Evidence for the tissue of a label.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// The label name is that of a tissue.
    Name,
    /// The label name is that of a class of a numbering.
    ClassName,
    /// A word in the label name.
    Word,
    /// The label value, in the numbering of this preset.
    Value(Preset),
    /// No evidence: the fallback tissue.
    Fallback,
}

impl Origin {
    /// Whether the tissue follows from a complete name.
    pub fn is_sure(self) -> bool {
        matches!(self, Self::Name | Self::ClassName)
    }
}

impl std::fmt::Display for Origin {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Name => f.write_str("name"),
            Self::ClassName => f.write_str("class name"),
            Self::Word => f.write_str("word"),
            Self::Value(preset) => write!(f, "{} value", preset.title()),
            Self::Fallback => f.write_str("fallback"),
        }
    }
}

/// Tissue of labels without evidence.
pub fn fallback() -> &'static Tissue {
    presets::get("soft_tissue").unwrap_or(&presets::all()[0])
}

/// Side of an organ, of the patient.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Side {
    Left,
    Right,
}

/// Side that a word of a name means.
fn side_of(word: &str) -> Option<Side> {
    match word {
        "left" | "lt" | "l" => Some(Side::Left),
        "right" | "rt" | "r" => Some(Side::Right),
        _ => None,
    }
}

/// Side in a normalised name, unless it names both or nothing else.
pub(crate) fn side(normalised: &str) -> Option<Side> {
    let mut sides = normalised.split('_').filter_map(side_of);
    let side = sides.next()?;
    (sides.all(|other| other == side) && !without_side(normalised).is_empty()).then_some(side)
}

/// A normalised name without the words of a side.
pub(crate) fn without_side(normalised: &str) -> String {
    let words: Vec<&str> = normalised.split('_').filter(|word| side_of(word).is_none()).collect();
    words.join("_")
}

fn by_class_name(normalised: &str) -> Option<&'static Tissue> {
    let bare = without_side(normalised);
    let same = |class: &&numbering::Class| {
        let name = class.name.to_lowercase();
        name == normalised || without_side(&name) == bare
    };
    numbering::all().find(same).map(|class| class.tissue)
}

fn by_keyword(normalised: &str) -> Option<&'static Tissue> {
    let has = |keyword: &str| {
        normalised.split('_').any(|word| match keyword.strip_suffix('*') {
            Some(stem) => word.starts_with(stem),
            None => word == keyword || word.strip_suffix('s') == Some(keyword),
        })
    };
    let word = numbering::words().iter().find(|word| has(&word.text))?;
    Some(word.tissue)
}

/// Tissue identified by a name alone, and the evidence.
pub fn known(name: &str) -> Option<(&'static Tissue, Origin)> {
    let name = plain(name);
    let tissue = |name: &str| presets::get(name).map(|tissue| (tissue, Origin::Name));
    tissue(&name)
        .or_else(|| by_class_name(&name).map(|tissue| (tissue, Origin::ClassName)))
        .or_else(|| tissue(&without_side(&name)))
        .or_else(|| by_keyword(&name).map(|tissue| (tissue, Origin::Word)))
}

fn by_name(name: &str, hint: Preset, of_file: bool) -> Option<&'static Tissue> {
    match hint {
        // Labels without voxels in the file are those of completion, named after their tissues.
        Preset::None if !of_file => presets::get(name),
        Preset::None => None,
        Preset::Phantom => presets::get(&plain(name)),
        _ => known(name).map(|(tissue, _)| tissue),
    }
}

fn shown(label: &Label) -> String {
    match &label.name {
        Some(name) => format!("{} (\"{name}\")", label.value),
        None => label.value.to_string(),
    }
}

/// Index of the override that claims each label.
fn claims(labels: &[Label], overrides: &[TissueOverride]) -> Result<Vec<Option<usize>>, TissueError> {
    labels
        .iter()
        .map(|label| {
            let name = label.name.as_deref().map(plain);
            let mut claiming = overrides.iter().enumerate().filter(|(_, tissue)| {
                tissue.labels.contains(&label.value)
                    || name.is_some() && tissue.label_names.iter().any(|claimed| Some(plain(claimed)) == name)
            });
            let first = claiming.next();
            match (first, claiming.next()) {
                (Some((_, first)), Some((_, second))) => Err(TissueError::ClaimedTwice {
                    label: shown(label),
                    first: first.name.clone(),
                    second: second.name.clone(),
                }),
                _ => Ok(first.map(|(position, _)| position)),
            }
        })
        .collect()
}

impl TissueTable {
    /// Assigns a tissue to each of `labels` (by label index; the first is the background).
    ///
    /// In this order: an override that claims the label by value or name; an override or preset of the same name; a
    /// class of a numbering of that name (case, spaces and side are ignored); a word such as "rib"; else soft tissue,
    /// with a warning. `hint` restricts this, except for the labels appended by completion. An override named as a
    /// preset changes that preset wherever it is used. Unnamed labels have been named before by
    /// [`segmentation::open`](crate::segmentation::open).
    ///
    /// Returns the table and the warnings: the assumptions, and which key of the scene overrides them.
    ///
    /// ```
    /// use insonify_anatomy::acoustics::{Preset, TissueTable};
    /// use insonify_anatomy::volume::Label;
    /// let label = |value, name: &str| Label { value, name: Some(name.into()), voxels: 1 };
    /// let labels = [label(0, "background"), label(7, "Right kidney")];
    /// let (table, warnings) = TissueTable::resolve(&labels, &[], Preset::Auto)?;
    /// assert_eq!(table.tissue(1).name, "kidney_cortex");
    /// assert!(warnings.is_empty());
    /// # Ok::<(), insonify_anatomy::acoustics::TissueError>(())
    /// ```
    pub fn resolve(
        labels: &[Label],
        overrides: &[TissueOverride],
        hint: Preset,
    ) -> Result<(Self, Vec<String>), TissueError> {
        let mut custom: Vec<Tissue> = Vec::with_capacity(overrides.len());
        for (index, written) in overrides.iter().enumerate() {
            if written.name.trim().is_empty() {
                return Err(TissueError::Unnamed { position: index + 1 });
            }
            if custom.iter().any(|tissue| tissue.name == written.name) {
                return Err(TissueError::Duplicate(written.name.clone()));
            }
            custom.push(written.apply()?);
        }
        let claims = claims(labels, overrides)?;
        let mut warnings = unmatched_claims(labels, overrides);
        warnings.extend(
            overrides
                .iter()
                .zip(&custom)
                .filter_map(|(stated, tissue)| stated.doubt(tissue)),
        );

        let mut table = Self {
            tissues: Vec::new(),
            of_label: Vec::with_capacity(labels.len()),
            ..Self::default()
        };
        if labels.is_empty() {
            table.tissues.push(presets::all()[0].clone());
        }
        let mut unknown = Vec::new();
        for (index, (label, claim)) in labels.iter().zip(&claims).enumerate() {
            let same_name = |name: &String| custom.iter().find(|tissue| plain(&tissue.name) == plain(name));
            let preset = match &label.name {
                // Unless it is claimed, the background stays outside the body, whatever its name suggests.
                _ if index == 0 => presets::all().first(),
                Some(name) => by_name(name, hint, label.voxels > 0),
                None => None,
            };
            let tissue = match (claim, label.name.as_ref().and_then(same_name)) {
                (Some(position), _) => &custom[*position],
                (None, Some(named)) if index > 0 => named,
                _ => {
                    // Unknown only here: a label that an override claims or names needs no warning.
                    let preset = preset.unwrap_or_else(|| {
                        unknown.push(shown(label));
                        fallback()
                    });
                    custom
                        .iter()
                        .find(|tissue| tissue.name == preset.name)
                        .unwrap_or(preset)
                }
            };
            table.push(tissue);
        }
        if !unknown.is_empty() {
            warnings.push(format!(
                "no tissue known for label{} {}; taken as soft_tissue; to choose, name the labels with --names FILE or \
                 volume.names, or write [[tissue]] with name and labels = [VALUE, ...]",
                if unknown.len() == 1 { "" } else { "s" },
                text::some_of(&unknown)
            ));
        }
        Ok((table, warnings))
    }

    /// Appends the tissue of the next label index; labels number at most 256, and tissues no more than labels.
    fn push(&mut self, tissue: &Tissue) {
        let known = self.tissues.iter().position(|known| known.name == tissue.name);
        let index = known.unwrap_or_else(|| {
            self.tissues.push(tissue.clone());
            self.tissues.len() - 1
        });
        self.of_label.push(index as u8);
    }
}

/// Warnings about claims that match no label of the volume.
fn unmatched_claims(labels: &[Label], overrides: &[TissueOverride]) -> Vec<String> {
    let mut warnings = Vec::new();
    let names: Vec<String> = labels
        .iter()
        .filter_map(|label| label.name.as_deref())
        .map(plain)
        .collect();
    for tissue in overrides {
        for value in &tissue.labels {
            if !labels.iter().any(|label| label.value == *value) {
                warnings.push(format!(
                    "tissue \"{}\": labels: the volume has no label {value}",
                    tissue.name
                ));
            }
        }
        for name in &tissue.label_names {
            if !names.contains(&plain(name)) {
                warnings.push(format!(
                    "tissue \"{}\": label_names: the volume has no label \"{name}\"",
                    tissue.name
                ));
            }
        }
    }
    warnings
}

#[cfg(test)]
mod tests;
