//! Parameters of single frames: columns of a table of poses, and ranges from which they are drawn.
//!
//! A frame with parameters is the only frame of a scene that has their values in place of its own.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

use super::check::Framing;
use super::file::{PoseTable, SceneFile};
use super::target::Body;
use crate::effects::EffectsTable;
use crate::synth::tables::{FrameSettings, Settings};
use insonify_anatomy::acoustics::{TissueOverride, TissueTable, presets};
use insonify_anatomy::volume::LabelVolume;
use insonify_base::blame::Blame;
use insonify_base::document::{self, InputError, InvalidFile, nearest};
use insonify_base::note::Notes;
use insonify_base::random::{hash3, seed_words};
use insonify_base::text::head;
use insonify_tracking::TrackingError;
use insonify_tracking::plus::PlusConfig;
use insonify_tracking::pose::Pose;
use insonify_tracking::probe::{ImageSpec, ProbeSpec};
use insonify_tracking::trajectory::ParameterColumn;

/// Parameters of a frame: paths of keys of the scene, and their values.
pub type Parameters = BTreeMap<String, Value>;

/// Tables of a scene whose keys may differ from frame to frame: those for which the anatomy need not be opened again.
#[derive(Default, Serialize, Deserialize, JsonSchema)]
struct OfFrames {
    seed: u64,
    probe: Option<ProbeSpec>,
    pose: Option<PoseTable>,
    image: Option<ImageSpec>,
    tissue: Vec<TissueOverride>,
    effects: Option<EffectsTable>,
}

/// Keys of these that all frames share: a run has frames of one size, and a tissue keeps its labels.
const SHARED: [&str; 6] = [
    "image.width",
    "image.height",
    "image.grid",
    "tissue[].name",
    "tissue[].labels",
    "tissue[].label_names",
];

/// Largest number of places of a probe that are kept.
const MAX_PLACED: usize = 1000;

/// The list of tissues, as a path has it.
const TISSUE: &str = "tissue[].";

/// Ranges that parameters of frames are drawn from, by key.
///
/// ```toml
/// [randomise]
/// seed = 7
/// gain_db = { uniform = [-6, 6] }
/// depth_mm = { integer = [90, 160] }
/// frequency_mhz = { choice = [2.5, 3.5, 5.0] }
/// liver.attenuation_db_cm_mhz = { log_uniform = [0.3, 1.0] }
/// ```
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Randomise(Map<String, Value>);

impl JsonSchema for Randomise {
    fn schema_name() -> Cow<'static, str> {
        "Randomise".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let range = generator.subschema_for::<Range>().to_value();
        let ranges = generator.subschema_for::<Ranges>().to_value();
        json_schema!({
            "description": "Ranges that parameters of frames are drawn from, by key: `gain_db` or `effects.tone.gain_db`, `liver.echogenicity_db`.",
            "type": "object",
            "properties": {
                "seed": { "type": "integer", "minimum": 0, "description": "Seed of the draws. Default: that of the scene." }
            },
            "additionalProperties": { "anyOf": [range, ranges] },
        })
    }
}

/// Ranges by the last parts of their keys.
struct Ranges;

impl JsonSchema for Ranges {
    fn schema_name() -> Cow<'static, str> {
        "Ranges".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let range = generator.subschema_for::<Range>().to_value();
        let deeper = json!({ "type": "object", "additionalProperties": range });
        // A list is that of a misspelt range, of which the scene says more.
        let misspelt = json!({ "type": "array" });
        json_schema!({ "type": "object", "additionalProperties": { "anyOf": [range, deeper, misspelt] } })
    }
}

/// A range of a parameter: one of these keys.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
enum Range {
    /// Numbers from the first up to the second, all equally likely.
    Uniform([f64; 2]),
    /// Numbers from the first up to the second, both above 0, whose logarithms are equally likely.
    LogUniform([f64; 2]),
    /// Whole numbers from the first to the second.
    Integer([i64; 2]),
    /// One of these values.
    Choice(Vec<Value>),
}

impl Range {
    /// Its fault, and what is expected.
    fn fault(&self) -> Option<(String, &'static str)> {
        let pair = |[low, high]: [f64; 2]| format!("{low} and {high}");
        match self {
            Self::Uniform([low, high]) if !(low.is_finite() && high.is_finite() && low <= high) => {
                Some((pair([*low, *high]), "two finite numbers, the lower first"))
            }
            Self::LogUniform([low, high]) if !(*low > 0.0 && high.is_finite() && low <= high) => {
                Some((pair([*low, *high]), "two numbers above 0, the lower first"))
            }
            Self::Integer([low, high]) if low > high => {
                Some((format!("{low} and {high}"), "two whole numbers, the lower first"))
            }
            Self::Choice(values) if values.is_empty() => Some(("no values".to_owned(), "at least one")),
            _ => None,
        }
    }

    /// Values that are within the bounds of a key if all of the range are.
    fn extremes(&self) -> Vec<Value> {
        match self {
            Self::Uniform(ends) | Self::LogUniform(ends) => ends.map(Value::from).to_vec(),
            Self::Integer(ends) => ends.map(Value::from).to_vec(),
            Self::Choice(values) => values.clone(),
        }
    }

    /// The value at a share of the range, from 0 to below 1.
    fn at(&self, share: f64) -> Value {
        match self {
            Self::Uniform([low, high]) => (low + (high - low) * share).into(),
            Self::LogUniform([low, high]) => (low * libm::pow(high / low, share)).clamp(*low, *high).into(),
            Self::Integer([low, high]) => {
                let count = (i128::from(*high) - i128::from(*low) + 1) as f64;
                let step = (share * count) as i128;
                ((i128::from(*low) + step).min(i128::from(*high)) as i64).into()
            }
            Self::Choice(values) => values[(share * values.len() as f64) as usize].clone(),
        }
    }
}

/// Bits of a drawn number: those of a double.
const BITS: u32 = 53;

/// A number of [`BITS`] bits that depends on seed, key and frame alone.
fn drawn(seed: u64, key: &str, frame: u64) -> u64 {
    let hash = blake3::hash(key.as_bytes());
    let word = |start: usize| {
        hash.as_bytes()[start..start + 4]
            .iter()
            .fold(0, |word, byte| word << 8 | i32::from(*byte))
    };
    let [a, b, _] = hash3([word(0), word(4), word(8)], seed_words(seed));
    let [high, low, _] = hash3([frame as i32, (frame >> 32) as i32, 0], [a, b]);
    (u64::from(high) << 32 | u64::from(low)) >> (64 - BITS)
}

/// Origin of the values of a parameter.
#[derive(Clone, Debug)]
enum Source {
    /// One a row of the table of poses.
    Column(Vec<Value>),
    /// A range, drawn from with a seed.
    Range(Range, u64),
    /// A seed of each frame, drawn with a seed: the upper half. The lower one stays, and with it the solid textures,
    /// which take as long to make as many frames.
    Seeds(u64),
}

/// A parameter that differs from frame to frame.
#[derive(Clone, Debug)]
struct Parameter {
    /// Path of its key, such as `effects.tone.gain_db` or `tissue.liver.echogenicity_db`.
    path: String,
    source: Source,
}

/// Parameters by frame of a scene.
#[derive(Clone, Debug)]
pub(super) struct Variation {
    /// The scene's file, with its volume.
    file: SceneFile,
    /// Its tables whose keys may differ.
    tables: Value,
    parameters: Vec<Parameter>,
    plus: Option<PlusConfig>,
    /// Rows of the table of poses, if it has columns of parameters.
    rows: Option<usize>,
    /// Whether the probe stands still, placed by the scene.
    is_placed: bool,
    /// Doubts about values that frames may have.
    pub doubts: Vec<String>,
    /// Poses of the probe by what each was placed by, and the depths chosen for its target.
    placed: Arc<Mutex<BTreeMap<String, (Pose, f64)>>>,
}

impl SceneFile {
    /// Path of the key that a name means: a path, or its last parts.
    ///
    /// # Errors
    /// Reason why there is none.
    pub(super) fn parameter(&self, name: &str) -> Result<String, String> {
        let paths = document::paths::<OfFrames>();
        let paths: Vec<&str> = paths
            .iter()
            .map(String::as_str)
            .filter(|path| !SHARED.contains(path))
            .collect();
        let name = name.trim();
        if paths.contains(&name) && !name.contains("[]") {
            return Ok(name.to_owned());
        }
        let ends = |path: &&&str| path.strip_suffix(name).is_some_and(|before| before.ends_with('.'));
        let meant: Vec<&str> = paths.iter().filter(ends).copied().collect();
        if let [path] = meant[..]
            && !path.starts_with(TISSUE)
        {
            return Ok(path.to_owned());
        }
        // Of a tissue: `liver.attenuation_db_cm_mhz`.
        let of_tissue = name.strip_prefix("tissue.").unwrap_or(name).rsplit_once('.');
        let of_tissue = of_tissue.filter(|(_, key)| paths.iter().any(|path| path.strip_prefix(TISSUE) == Some(key)));
        let mut tissues = self
            .tissue
            .iter()
            .map(|tissue| tissue.name.as_str())
            .collect::<Vec<_>>();
        tissues.extend(presets::all().iter().map(|tissue| tissue.name.as_ref()));
        if let Some((tissue, key)) = of_tissue {
            if tissues.contains(&tissue) {
                return Ok(format!("tissue.{tissue}.{key}"));
            }
            let meant =
                nearest(tissue, tissues.iter().copied()).map(|meant| format!("; did you mean `{meant}.{key}`?"));
            return Err(meant.unwrap_or_else(|| "; expected the name of a tissue".to_owned()));
        }
        match meant[..] {
            [_] => Err(format!("; expected the tissue before it, as in `liver.{name}`")),
            [] => {
                let last = |path: &&str| path.rsplit('.').next().map(str::to_owned);
                let last: Vec<String> = paths.iter().filter_map(last).collect();
                let known = paths.iter().copied().chain(last.iter().map(String::as_str));
                let meant = nearest(name, known).map(|meant| format!("; did you mean `{meant}`?"));
                Err(meant.unwrap_or_else(|| "; expected a key of [probe], [effects], [pose] or a tissue".to_owned()))
            }
            _ => Err(format!(", as it could be {}", meant.join(" or "))),
        }
    }

    /// Parameters by frame: `columns` of the table of poses, and `[randomise]`. `None` if there are neither.
    pub(super) fn variation(
        &self,
        columns: &[ParameterColumn],
        plus: Option<PlusConfig>,
        is_placed: bool,
    ) -> Result<Option<Variation>, InputError> {
        let randomise = self.randomise.as_ref();
        if columns.is_empty() && randomise.is_none() {
            return Ok(None);
        }
        if self.quality.is_some() {
            let found = "`[quality]`, whose settings depend on the machine, beside parameters by frame";
            return Err(self.wrong_keys("quality", found, "one of them"));
        }
        let tables = OfFrames {
            seed: self.seed,
            probe: self.probe.clone(),
            pose: self.pose.clone(),
            image: self.image,
            tissue: self.tissue.clone(),
            effects: self.effects.clone(),
        };
        let tables = serde_json::to_value(tables).map_err(|error| self.unstated("randomise", &error))?;
        let mut variation = Variation {
            file: Self {
                randomise: None,
                ..self.clone()
            },
            tables,
            parameters: Vec::new(),
            plus,
            rows: columns.first().map(|column| column.cells.len()),
            is_placed,
            doubts: Vec::new(),
            placed: Arc::default(),
        };
        for column in columns {
            self.add_column(&mut variation, column)?;
        }
        if let Some(Randomise(ranges)) = randomise {
            let seed = match ranges.get("seed") {
                None => self.seed,
                Some(seed) => seed.as_u64().ok_or_else(|| {
                    let expected = "a whole number of 0 or more, the seed of the draws: that of each frame is drawn";
                    self.wrong_keys("randomise.seed", seed.to_string(), expected)
                })?,
            };
            for (name, value) in ranges.iter().filter(|(name, _)| *name != "seed") {
                self.add_ranges(&mut variation, name, value, seed)?;
            }
            if variation.parameters.iter().all(|parameter| parameter.path != "seed") {
                let source = Source::Seeds(seed);
                let path = "seed".to_owned();
                variation.parameters.push(Parameter { path, source });
            }
        }
        Ok(Some(variation))
    }

    fn unstated(&self, key: &str, error: &dyn std::fmt::Display) -> InputError {
        self.fault(key, InvalidFile::Unknown(error.to_string()))
    }

    /// Checks a parameter, by values that are within bounds if all are, and adds it.
    fn add(
        &self,
        variation: &mut Variation,
        parameter: Parameter,
        extremes: &[Value],
        fault: &dyn Fn(usize, String) -> InputError,
    ) -> Result<(), InputError> {
        let path = &parameter.path;
        if !variation.is_placed && path.starts_with("pose.") {
            let wrong = format!("`{path}` of a probe that moves; expected a pose in each row");
            return Err(fault(0, wrong));
        }
        if variation.parameters.iter().any(|other| other.path == *path) {
            return Err(fault(0, format!("`{path}` twice; expected one column or range of it")));
        }
        let mut settings = self.source.iter().flat_map(|source| source.settings());
        if settings.any(|setting| setting.states(path)) {
            let why = format!(
                "`{path}` differs from frame to frame, and an option states it for all; expected one of the two"
            );
            return Err(fault(0, why));
        }
        let mut doubts = Vec::new();
        if path.starts_with("effects.needle.") && self.needle.is_none() {
            doubts.push(format!("`{path}` changes nothing: the scene has no needle"));
        }
        let mut has_textures = false;
        for (index, value) in extremes.iter().enumerate() {
            let alone = Parameters::from([(path.clone(), value.clone())]);
            let checked = variation.with(&alone).and_then(|file| {
                let framing = file.framing(variation.plus.as_ref(), &mut Notes::default(), &mut doubts)?;
                has_textures |= framing.effects.texture.is_some();
                for tissue in &file.tissue {
                    let changed = tissue.apply().map_err(InputError::new)?;
                    doubts.extend(tissue.doubt(&changed));
                }
                Ok(())
            });
            checked.map_err(|error| fault(index, error.cause().to_string()))?;
        }
        let lower = |value: &Value| value.as_u64().map(|seed| seed & u64::from(u32::MAX));
        if path == "seed" && has_textures && extremes.iter().any(|value| lower(value) != lower(&extremes[0])) {
            doubts.push(
                "solid textures are made anew for each frame, which takes many times as long as the frame: they follow from \
                 the lower 32 bits of `seed` (seeds that are multiples of 4294967296 change grain and noise alone)"
                    .to_owned(),
            );
        }
        variation.doubts.append(&mut doubts);
        variation.parameters.push(parameter);
        Ok(())
    }

    fn add_column(&self, variation: &mut Variation, column: &ParameterColumn) -> Result<(), InputError> {
        let csv = self
            .motion
            .as_ref()
            .and_then(|motion| motion.csv.clone())
            .unwrap_or_default();
        let refused = |line: u64, why: String| {
            let text = format!(", line {line}, column `{}`: {why}", column.name);
            self.fault("motion.csv", TrackingError::file(&csv, text))
        };
        let path = self.parameter(&column.name).map_err(|why| refused(1, why))?;
        let mut values = Vec::with_capacity(column.cells.len());
        for (line, cell) in &column.cells {
            let number = |number: f64| number.is_finite().then(|| Value::from(number));
            let value = match (cell.parse::<i64>(), cell.parse::<f64>()) {
                (Ok(whole), _) => Some(whole.into()),
                (_, Ok(float)) => number(float),
                _ if cell.is_empty() => None,
                _ => Some(cell.parse::<bool>().map_or_else(|_| cell.as_str().into(), Value::from)),
            };
            let value = value.ok_or_else(|| {
                let found = head(cell, 60);
                refused(*line, format!("found `{found}`; expected a value of `{path}`"))
            })?;
            values.push(value);
        }
        // The least and the largest number, and each other value once.
        let number = |row: &usize| values[*row].as_f64();
        let rows = || (0..values.len()).filter(|row| values[*row].is_number());
        let order = |a: &usize, b: &usize| number(a).unwrap_or(0.0).total_cmp(&number(b).unwrap_or(0.0));
        let mut tried: Vec<usize> = rows().min_by(order).into_iter().chain(rows().max_by(order)).collect();
        for row in (0..values.len()).filter(|row| !values[*row].is_number()) {
            if !tried.iter().any(|other| values[*other] == values[row]) {
                tried.push(row);
            }
        }
        let extremes: Vec<Value> = tried.iter().map(|row| values[*row].clone()).collect();
        let source = Source::Column(values);
        let at_line = |index: usize, why| refused(tried.get(index).map_or(1, |row| column.cells[*row].0), why);
        self.add(variation, Parameter { path, source }, &extremes, &at_line)
    }

    /// Adds the range of a key, or those of a table of keys whose first parts are `name`.
    fn add_ranges(&self, variation: &mut Variation, name: &str, value: &Value, seed: u64) -> Result<(), InputError> {
        const KINDS: [&str; 4] = ["uniform", "log_uniform", "integer", "choice"];
        let key = format!("randomise.{name}");
        let wrong = |found: String, expected: &str| Err(self.wrong_keys(&key, found, expected));
        let table = value.as_object().filter(|table| !table.is_empty());
        let Some(table) = table else {
            return wrong(head(&value.to_string(), 60), "a range such as `{ uniform = [-6, 6] }`");
        };
        if table.values().all(Value::is_object) {
            for (inner, value) in table {
                self.add_ranges(variation, &format!("{name}.{inner}"), value, seed)?;
            }
            return Ok(());
        }
        if let (1, Some(kind)) = (table.len(), table.keys().find(|kind| !KINDS.contains(&kind.as_str()))) {
            let meant = nearest(kind, KINDS).map(|meant| format!("did you mean `{meant}`?"));
            let expected = format!("one of {}", KINDS.join(", "));
            return Err(self.wrong_keys(&key, format!("`{kind}`"), expected).with_help(meant));
        }
        let range: Range = match serde_json::from_value(value.clone()) {
            Ok(range) => range,
            Err(_) => {
                let expected = "one of uniform, log_uniform and integer with two numbers, or choice with a list";
                return wrong(head(&value.to_string(), 60), expected);
            }
        };
        if let Some((found, expected)) = range.fault() {
            return wrong(found, expected);
        }
        let path = self.parameter(name).map_err(|why| {
            self.fault(
                &key,
                InvalidFile::Unknown(format!("`{name}` is no parameter of a frame{why}")),
            )
        })?;
        let extremes = range.extremes();
        let source = Source::Range(range, seed);
        let at_key = |_, why| self.fault(&key, InvalidFile::Unknown(why));
        self.add(variation, Parameter { path, source }, &extremes, &at_key)
    }
}

impl Variation {
    /// Parameters of frame `frame` of `frames`.
    pub(super) fn parameters(&self, frame: usize, frames: usize) -> Result<Parameters, InputError> {
        if let Some(rows) = self.rows.filter(|rows| *rows != frames) {
            let found = format!("{rows} rows of parameters for {frames} frames");
            return Err(self.file.wrong_keys("motion.csv", found, "one a frame"));
        }
        let frame = frame as u64;
        let value = |parameter: &Parameter| match &parameter.source {
            Source::Column(values) => values[frame as usize].clone(),
            Source::Range(range, seed) => {
                range.at(drawn(*seed, &parameter.path, frame) as f64 / 2f64.powi(BITS as i32))
            }
            Source::Seeds(seed) => {
                let upper = drawn(*seed, &parameter.path, frame) >> (BITS - 31);
                (upper << 32 | self.file.seed & u64::from(u32::MAX)).into()
            }
        };
        Ok(self
            .parameters
            .iter()
            .map(|parameter| (parameter.path.clone(), value(parameter)))
            .collect())
    }

    /// Warnings about parameters of tissues that the volume does not have.
    pub(super) fn absent_tissues(&self, volume: &LabelVolume, tissues: &TissueTable) -> Vec<String> {
        let name = |parameter: &Parameter| {
            parameter
                .path
                .strip_prefix("tissue.")?
                .split_once('.')
                .map(|(name, _)| name.to_owned())
        };
        let is_there = |name: &str| {
            let labels = (0..=u8::MAX).take(volume.labels().len());
            labels.into_iter().any(|label| tissues.tissue(label).name == name)
        };
        let names = self.parameters.iter().filter_map(name).filter(|name| !is_there(name));
        names
            .map(|name| format!("parameters of the tissue \"{name}\" change nothing: no label of the volume is of it"))
            .collect()
    }

    /// The scene's file with values of parameters in place of its own.
    fn with(&self, parameters: &Parameters) -> Result<SceneFile, InputError> {
        let mut tables = self.tables.clone();
        for (path, value) in parameters {
            let wrong = |why: String| InputError::new(InvalidFile::Unknown(why));
            *place(&mut tables, path).map_err(wrong)? = value.clone();
        }
        let read = serde_json::from_value(tables);
        let OfFrames {
            seed,
            probe,
            pose,
            image,
            tissue,
            effects,
        } = read.map_err(|error| InputError::new(InvalidFile::Unknown(plain(&error.to_string()))))?;
        Ok(SceneFile {
            seed,
            probe,
            pose,
            image,
            tissue,
            effects,
            ..self.file.clone()
        })
    }

    /// Settings of a frame with these parameters, from those that all frames share, and the pose of a probe that the
    /// scene places.
    pub(super) fn frame(
        &self,
        parameters: &Parameters,
        volume: &LabelVolume,
        (shared, tissues): (&Settings, &Arc<TissueTable>),
        check: impl FnOnce(&SceneFile) -> Result<(), InputError>,
    ) -> Result<(FrameSettings, Option<Pose>), InputError> {
        let file = self.with(parameters)?;
        let mut framing = file.framing(self.plus.as_ref(), &mut Notes::default(), &mut Vec::new())?;
        check(&file)?;
        let mut warnings = Vec::new();
        let retissued = parameters.keys().any(|path| path.starts_with("tissue."));
        let tissues = if retissued {
            let preset = file.volume()?.preset.unwrap_or_default();
            let (new, _) = TissueTable::resolve(volume.labels(), &file.tissue, preset)
                .map_err(|error| file.fault("tissue", error))?;
            let TissueTable { inwards, along, .. } = (**tissues).clone();
            Arc::new(TissueTable { inwards, along, ..new })
        } else {
            Arc::clone(tissues)
        };
        let image = match shared.image.placed {
            // The grid of a recording stays.
            Some(_) => crate::synth::tables::ImageSize {
                fill: framing.image.fill,
                ..shared.image
            },
            None => framing.image,
        };
        let pose = if self.is_placed {
            let body = Body {
                volume,
                tissues: &tissues,
            };
            Some(self.pose(&file, &body, &mut framing, &mut warnings)?)
        } else {
            None
        };
        let settings = Settings {
            seed: file.seed,
            probe: framing.probe,
            image,
            effects: framing.effects,
            has_needle: shared.has_needle,
            layers: shared.layers.clone(),
        };
        let own = FrameSettings {
            settings,
            tissues,
            warnings,
        };
        Ok((own, pose))
    }

    /// Pose of a probe that stands still. Placing one on the skin takes longer than a frame: it is placed again only if
    /// what it is placed by changes.
    fn pose(
        &self,
        file: &SceneFile,
        body: &Body<'_>,
        framing: &mut Framing,
        warnings: &mut Vec<String>,
    ) -> Result<Pose, InputError> {
        let shape = (framing.probe.shape.kind(), framing.probe.shape.numbers());
        let depth = (framing.probe.depth_mm, framing.open_depth);
        let by = document::word(&(&file.pose, shape, depth, body.placing()));
        // Not locked while a probe is placed: frames are set up side by side.
        let placed = || self.placed.lock().unwrap_or_else(PoisonError::into_inner);
        let known = placed().get(&by).copied();
        if let Some((pose, depth_mm)) = known {
            framing.probe.depth_mm = depth_mm;
            return Ok(pose);
        }
        let (mut notes, mut doubts) = (Notes::default(), Vec::new());
        let pose = file.fixed_pose(body, framing, &mut notes, &mut doubts)?;
        if framing.open_depth {
            file.deepen(body, &pose, framing, &mut notes)?;
        }
        // A doubtful place is told of every frame.
        if doubts.is_empty() {
            let mut placed = placed();
            if placed.len() >= MAX_PLACED {
                placed.clear();
            }
            placed.insert(by, (pose, framing.probe.depth_mm));
        }
        warnings.append(&mut doubts);
        Ok(pose)
    }
}

/// A message of serde without the terms of Rust.
fn plain(message: &str) -> String {
    let words = [
        ("invalid type: ", "found "),
        ("invalid value: ", "found "),
        ("expected u32", "expected a whole number"),
        ("expected u64", "expected a whole number"),
        ("expected f64", "expected a number"),
        ("expected struct ", "expected a table of "),
    ];
    words
        .iter()
        .fold(message.to_owned(), |text, (rust, plain)| text.replace(rust, plain))
}

/// An error of a frame's parameters, with these.
pub(super) fn of_frame(error: InputError, frame: usize, parameters: &Parameters) -> InputError {
    if error.is_machine() {
        return error;
    }
    let parameters: Vec<String> = parameters
        .iter()
        .map(|(path, value)| format!("{path} = {value}"))
        .collect();
    let text = format!("frame {frame} ({}): {error}", parameters.join(", "));
    InputError::new(InvalidFile::Unknown(text))
}

/// Place of a key in the tables of a file; tables on the way are made.
fn place<'a>(tables: &'a mut Value, path: &str) -> Result<&'a mut Value, String> {
    let (mut value, mut rest) = (tables, path);
    if let Some(of_tissue) = path.strip_prefix("tissue.") {
        let (name, key) = of_tissue.rsplit_once('.').unwrap_or((of_tissue, ""));
        let list = value["tissue"].as_array_mut().ok_or("the tissues are no list")?;
        let known = list.iter().position(|tissue| tissue["name"] == name);
        let index = known.unwrap_or_else(|| {
            list.push(json!({ "name": name }));
            list.len() - 1
        });
        (value, rest) = (&mut list[index], key);
    }
    for key in rest.split('.') {
        match value {
            Value::Null | Value::Bool(true) => *value = json!({}),
            Value::Bool(false) => return Err(format!("`{path}` of an effect that the scene leaves out")),
            _ => {}
        }
        let table = value
            .as_object_mut()
            .ok_or_else(|| format!("`{path}` leads through a value"))?;
        value = table.entry(key).or_insert(Value::Null);
    }
    Ok(value)
}
