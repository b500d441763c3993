//! Numberings of labels: the organ that a label value stands for in a public data set, and its tissue.
//!
//! A numbering is a file of `assets/labels` with the columns value, name and tissue, and a line of `numberings!`. An
//! organ that TotalSegmentator has too has its name there. A side is a word of the name, left or right.

use std::path::Path;
use std::sync::LazyLock;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Tissue, presets};
use insonify_base::csv::{Csv, CsvError, Row};
use insonify_base::document::plain;

/// A label of a numbering.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Class {
    /// Value in a label map.
    pub value: i64,
    /// Name.
    pub name: String,
    /// Its tissue, from [`presets::all`].
    pub tissue: &'static Tissue,
}

/// A word in the names of labels.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Word {
    /// The word; with a trailing `*`, the beginning of one.
    pub text: String,
    /// Tissue of the labels with the word, from [`presets::all`].
    pub tissue: &'static Tissue,
}

/// Rows of a file of `assets/labels`. A test reports the error of a malformed file; elsewhere it has no rows.
type Data<T> = LazyLock<Result<Vec<T>, CsvError>>;

/// Embeds a file of `assets/labels`, with its columns and the type of its rows.
macro_rules! data {
    ($file:expr, $columns:expr, $Row:ident) => {
        LazyLock::new(|| {
            let path = concat!("assets/labels/", $file);
            let text = include_str!(concat!("../../../assets/labels/", $file));
            rows(path, text, $columns, $Row::from_row)
        })
    };
}

/// Columns of a numbering.
const CLASS: &[&str] = &["value", "name", "tissue"];

static BODY: Data<Class> = data!("body.csv", CLASS, Class);
static WORDS: Data<Word> = data!("words.csv", &["word", "tissue"], Word);

/// Declares the numberings, the most common first: the title and the file of each.
macro_rules! numberings {
    ($($Name:ident = $title:literal in $file:literal;)+) => {
        /// Assignment of tissues to labels without an explicit one.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
        #[serde(rename_all = "snake_case")]
        pub enum Preset {
            /// By name, as a tissue, a class of a numbering or a word such as "rib"; for unnamed labels by value, in
            /// the numbering that fits the volumes of the labels.
            #[default]
            Auto,
            $(
                #[doc = concat!("Like `auto`, with unnamed labels by the values of ", $title, ".")]
                $Name,
            )+
            /// By exact names of built-in tissues, as phantoms have them.
            Phantom,
            /// None: only explicit tissues count, except for the labels of a body added by completion.
            None,
        }

        impl Preset {
            /// Presets that name labels by their values, the most common first.
            pub(crate) const NUMBERINGS: &[Self] = &[$(Self::$Name),+];

            /// Name of the data set of the numbering, or of the preset.
            pub fn title(self) -> &'static str {
                match self {
                    $(Self::$Name => $title,)+
                    Self::Auto => "auto",
                    Self::Phantom => "phantom",
                    Self::None => "none",
                }
            }

            /// Name of the numbering in scenes, and of its file without the ending; empty for a preset without one.
            pub(crate) fn stem(self) -> &'static str {
                match self {
                    $(Self::$Name => &$file[..$file.len() - ".csv".len()],)+
                    Self::Auto | Self::Phantom | Self::None => "",
                }
            }

            fn data(self) -> Result<&'static [Class], &'static CsvError> {
                match self {
                    $(Self::$Name => {
                        static CLASSES: Data<Class> = data!($file, CLASS, Class);
                        CLASSES.as_deref()
                    })+
                    Self::Auto | Self::Phantom | Self::None => Ok(&[]),
                }
            }
        }
    };
}

numberings! {
    TotalSegmentator = "TotalSegmentator" in "total_segmentator.csv";
    Btcv = "BTCV" in "btcv.csv";
    Amos = "AMOS" in "amos.csv";
    Flare21 = "FLARE21" in "flare21.csv";
    Flare22 = "FLARE22" in "flare22.csv";
    TotalMr = "TotalSegmentator total_mr" in "total_mr.csv";
    TotalV1 = "TotalSegmentator v1" in "total_v1.csv";
    Word = "WORD" in "word.csv";
    AbdomenAtlas = "AbdomenAtlas" in "abdomen_atlas.csv";
    Chaos = "CHAOS" in "chaos.csv";
    Learn2reg = "Learn2Reg MR-CT" in "learn2reg.csv";
    CtOrg = "CT-ORG" in "ct_org.csv";
    Synapse = "TransUNet" in "synapse.csv";
    Lits = "LiTS" in "lits.csv";
    Kits = "KiTS" in "kits.csv";
    LungVessels = "TotalSegmentator lung_vessels" in "lung_vessels.csv";
    LiverVessels = "TotalSegmentator liver_vessels" in "liver_vessels.csv";
}

impl Preset {
    /// Labels of the numbering; none for a preset without one.
    pub(crate) fn classes(self) -> &'static [Class] {
        self.data().unwrap_or_default()
    }

    /// Whether a file's name has the words of the numbering, such as `total_mr` or `flare22`.
    pub(crate) fn is_stated_by(self, name: &str) -> bool {
        let words = format!("_{}_", plain(name));
        let stem = self.stem();
        !stem.is_empty()
            && (words.contains(&format!("_{stem}_")) || words.contains(&format!("_{}_", stem.replace('_', ""))))
    }

    /// Organ of a label value; `None` for a value that the preset does not know. TotalSegmentator is taken to have the
    /// labels of `body`.
    pub fn organ(self, value: i64) -> Option<&'static str> {
        let body = match self {
            Self::TotalSegmentator => body(),
            _ => &[],
        };
        let mut classes = self.classes().iter().chain(body);
        classes
            .find(|class| class.value == value)
            .map(|class| class.name.as_str())
    }
}

/// Labels of the rest of a segmented body.
pub(crate) fn body() -> &'static [Class] {
    BODY.as_deref().unwrap_or_default()
}

/// Labels of all numberings and of [`body`], by precedence.
pub(crate) fn all() -> impl Iterator<Item = &'static Class> {
    Preset::NUMBERINGS
        .iter()
        .flat_map(|preset| preset.classes())
        .chain(body())
}

/// Words that determine the tissue of a label without an exact name, by precedence.
pub(crate) fn words() -> &'static [Word] {
    WORDS.as_deref().unwrap_or_default()
}

impl Class {
    fn from_row(row: Row) -> Result<Self, CsvError> {
        let value = row.count("value")?;
        Ok(Self {
            value: i64::try_from(value).map_err(|_| row.wrong("value", "the value of a label"))?,
            name: text(row, "name")?,
            tissue: tissue(row)?,
        })
    }
}

impl Word {
    fn from_row(row: Row) -> Result<Self, CsvError> {
        Ok(Self {
            text: text(row, "word")?,
            tissue: tissue(row)?,
        })
    }
}

fn rows<T>(
    path: &str,
    text: &str,
    columns: &[&str],
    from_row: impl Fn(Row) -> Result<T, CsvError>,
) -> Result<Vec<T>, CsvError> {
    Csv::parse(Path::new(path), text.as_bytes(), columns)?
        .rows()
        .map(from_row)
        .collect()
}

fn text(row: Row, column: &str) -> Result<String, CsvError> {
    match row.text(column) {
        "" => Err(row.wrong(column, "a name")),
        text => Ok(text.to_owned()),
    }
}

fn tissue(row: Row) -> Result<&'static Tissue, CsvError> {
    presets::get(row.text("tissue")).ok_or_else(|| row.wrong("tissue", "the name of a built-in tissue"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::acoustics::{TissueTable, known};
    use crate::volume::Label;

    #[test]
    fn files_are_well_formed_and_give_each_value_and_name_once() {
        assert_eq!(WORDS.as_ref().err().map(ToString::to_string), None);
        assert_eq!(BODY.as_ref().err().map(ToString::to_string), None);
        let with_body = Preset::TotalSegmentator
            .classes()
            .iter()
            .chain(body())
            .cloned()
            .collect();
        let mut tables = vec![with_body];
        for preset in Preset::NUMBERINGS {
            assert_eq!(preset.data().err().map(ToString::to_string), None);
            tables.push(preset.classes().to_vec());
        }
        for table in tables {
            assert!(!table.is_empty());
            for (index, class) in table.iter().enumerate() {
                assert!(class.value > 0, "{class:?}");
                // CHAOS has two values for each organ.
                let has_other_values = table.iter().any(|class| class.value == 252);
                let same =
                    |other: &&Class| other.value == class.value || (other.name == class.name && !has_other_values);
                assert_eq!(table[..index].iter().find(same), None, "also {class:?}");
            }
        }
    }

    #[test]
    fn the_page_of_files_names_all_numberings() {
        let page = insonify_testing::pages::root().join("docs/files.md");
        let text = std::fs::read_to_string(page).unwrap();
        let labels = text.split("\n## Labels\n").nth(1).unwrap();
        for preset in Preset::NUMBERINGS {
            for word in preset.title().split(' ') {
                assert!(labels.contains(word), "docs/files.md lacks {word}");
            }
        }
    }

    #[test]
    fn a_fault_in_a_file_is_reported_with_file_and_line() {
        let fault = |text| {
            rows("assets/labels/a.csv", text, CLASS, Class::from_row)
                .unwrap_err()
                .to_string()
        };
        for (text, words) in [
            (
                "# a\nvalue,name,tissue\n1,liver,liver\n2,spleen,splen\n",
                "line 4: found `splen` in column `tissue`",
            ),
            (
                "value,name,tissue\none,liver,liver\n",
                "line 2: found `one` in column `value`",
            ),
            ("value,name,tissue\n1,,liver\n", "line 2: found `` in column `name`"),
            ("value,name,tissue\n1,liver\n", "line 2: found 2 cells"),
            (
                "value,name\n1,liver\n",
                "line 1: found the header `value,name` without `tissue`",
            ),
        ] {
            let fault = fault(text);
            assert!(
                fault.starts_with("assets/labels/a.csv") && fault.contains(words),
                "{fault}"
            );
        }
    }

    #[test]
    fn classes_equal_the_published_list() {
        let text = include_str!("../../../tests/data/totalsegmentator_total_classes.csv");
        let listed: Vec<(i64, &str)> = text
            .lines()
            .skip(1)
            .filter_map(|line| line.split_once(','))
            .map(|(value, name)| (value.parse().unwrap(), name))
            .collect();
        let classes = Preset::TotalSegmentator.classes().iter();
        let ours: Vec<(i64, &str)> = classes.map(|class| (class.value, class.name.as_str())).collect();
        assert_eq!(ours, listed);
    }

    #[test]
    fn organs_bones_and_gas_are_told_apart() {
        let tissue = |name: &str| all().find(|class| class.name == name).unwrap().tissue;
        for name in ["liver", "spleen", "kidney_left", "pancreas", "prostate"] {
            assert!(tissue(name).soft_organ, "{name}");
        }
        for name in [
            "colon",
            "lung_upper_lobe_left",
            "autochthon_left",
            "urinary_bladder",
            "brain",
        ] {
            assert!(!tissue(name).soft_organ, "{name}");
        }
        for name in ["rib_left_1", "vertebrae_L5", "trachea", "skull", "hip_right"] {
            assert!(tissue(name).is_occluder(), "{name}");
        }
        for name in ["gallstone", "kidney stone 2", "Calcifications"] {
            let tissue = crate::acoustics::known(name).map(|(tissue, _)| tissue.name.as_ref());
            assert_eq!(tissue, Some("bone"), "{name}");
        }
    }

    #[test]
    fn labels_read_by_value_have_the_tissue_of_their_numbering() {
        for &preset in Preset::NUMBERINGS {
            let classes = preset.classes();
            let foreground = classes.iter().map(|class| Label {
                value: class.value,
                name: preset.organ(class.value).map(str::to_owned),
                voxels: 1,
            });
            let background = Label {
                value: 0,
                name: None,
                voxels: 1,
            };
            let labels: Vec<Label> = std::iter::once(background).chain(foreground).collect();
            let (table, warnings) = TissueTable::resolve(&labels, &[], preset).unwrap();
            assert!(warnings.is_empty(), "{warnings:?}");
            for (class, index) in classes.iter().zip(1..) {
                assert_eq!(table.tissue(index), class.tissue, "{}: {class:?}", preset.title());
                assert_eq!(known(&class.name).map(|(tissue, _)| tissue), Some(class.tissue));
            }
            let largest = classes.iter().map(|class| class.value).max().unwrap();
            for value in [-1, 0, largest + 1, i64::MIN, i64::MAX] {
                assert_eq!(preset.organ(value), None, "{}: {value}", preset.title());
            }
        }
        assert_eq!(Preset::TotalSegmentator.organ(204), Some("skin"));
        assert_eq!(Preset::Btcv.organ(204), None);
    }
}
