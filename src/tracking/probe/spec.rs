//! Probe table of a scene file: flat, so that an unknown key is an error on its own line.

use std::borrow::Cow;
use std::fmt;
use std::sync::LazyLock;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema, schema_for};
use serde::de::{self, MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use serde_json::{Map, Value, json};

use super::aperture::Aperture;
use super::kind::Numbers;
use super::{Probe, ProbeKind, ProbeShape};
use crate::TrackingError;
use insonify_base::range::{Ranges, parameters};

/// Default number of scanlines.
pub(super) const DEFAULT_LINES: u32 = 256;
/// Default number of samples along a scanline.
pub(super) const DEFAULT_SAMPLES: u32 = 512;

/// Placement of the pixels of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum GridSpec {
    /// The complete sector in `width` by `height` square pixels.
    #[default]
    Fitted,
    /// The pixels of the recording that moves the probe, by its size (or that in its PLUS configuration) and its
    /// calibration.
    Recorded,
}

parameters! {
    /// Pixels of the frame.
    #[derive(Copy)]
    pub struct ImageSpec {
        /// Placement of the pixels. Default `fitted`.
        grid: GridSpec;
        /// Columns. With `recorded`, `width` and `height` are those of the recording, without `margin`.
        width: u32 = 640, in 1..=16384;
        /// Rows.
        height: u32 = 480, in 1..=16384;
        /// Fraction of the image left free on each side of the sector.
        margin: f64 = 0.02, in 0..=0.45;
        /// Grey level outside the sector (0 to 255). Default 0.
        fill: u8;
    }
}

/// A probe as written in a file: one table of the keys below and those of its kind. `Probe::try_from` validates it.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ProbeSpec {
    /// Kind of probe. Default: that of the PLUS configuration of a recording, or of the usual probe of the volume.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub kind: Option<ProbeKind>,
    /// Numbers of the kind's own keys.
    #[serde(flatten, serialize_with = "as_map")]
    pub shape: Numbers,
    /// Keys of every kind.
    #[serde(flatten)]
    pub sampling: Sampling,
    /// Aperture, pulse and lens.
    #[serde(flatten)]
    pub aperture: Aperture,
}

parameters! {
    /// Keys of every kind of probe.
    #[derive(Copy)]
    pub struct Sampling {
        /// Length of every scanline, mm. Default: that of the PLUS configuration of a recording, or of the usual probe
        /// of the kind, or, without a kind, of the volume.
        #[serde(skip_serializing_if = "Option::is_none")]
        depth_mm: Option<f64>, in 0.1..=1000;
        /// Centre frequency, MHz. Default: that of the kind.
        #[serde(skip_serializing_if = "Option::is_none")]
        frequency_mhz: Option<f64>, in 0.1..=100;
        /// Number of scanlines. Default 256.
        #[serde(skip_serializing_if = "Option::is_none")]
        lines: Option<u32>, in 1..=8192;
        /// Number of samples along each scanline. Default 512.
        #[serde(skip_serializing_if = "Option::is_none")]
        samples: Option<u32>, in 1..=16384;
    }
}

/// Keys of all kinds, and those of every kind, in the order of a table.
fn keys() -> &'static [&'static str] {
    static KEYS: LazyLock<Vec<&'static str>> = LazyLock::new(|| {
        let mut keys = vec!["kind"];
        for key in ProbeKind::ALL.iter().flat_map(|kind| kind.keys()) {
            if !keys.contains(&key) {
                keys.push(key);
            }
        }
        keys.extend(Sampling::KEYS.iter().chain(Aperture::KEYS));
        keys
    });
    &KEYS
}

impl ProbeSpec {
    /// A number of the kind's own table, if it is stated.
    pub fn number(&self, key: &str) -> Option<f64> {
        let number = self.shape.iter().find(|(name, _)| *name == key);
        number.map(|(_, value)| *value)
    }

    /// Sets a number of the kind's own table.
    pub(crate) fn set(&mut self, key: &'static str, value: Option<f64>) {
        self.shape.retain(|(name, _)| *name != key);
        self.shape.extend(value.map(|value| (key, value)));
        self.shape
            .sort_by_key(|(name, _)| keys().iter().position(|key| key == name));
    }

    /// Returns this table with open keys taken from another table, and those keys with their values.
    pub fn filled_from(mut self, other: &Self) -> (Self, Vec<String>) {
        fn fill<T: Copy + fmt::Display>(key: &str, open: &mut Option<T>, from: Option<T>, filled: &mut Vec<String>) {
            if let (None, Some(value)) = (&open, from) {
                filled.push(format!("{key} = {value}"));
                *open = from;
            }
        }
        let mut filled = Vec::new();
        fill("kind", &mut self.kind, other.kind, &mut filled);
        for &(key, value) in &other.shape {
            if self.number(key).is_none() {
                filled.push(format!("{key} = {value}"));
                self.set(key, Some(value));
            }
        }
        fill(
            "depth_mm",
            &mut self.sampling.depth_mm,
            other.sampling.depth_mm,
            &mut filled,
        );
        fill("lines", &mut self.sampling.lines, other.sampling.lines, &mut filled);
        (self, filled)
    }

    fn shape(&self, kind: ProbeKind) -> Result<ProbeShape, TrackingError> {
        let keys = kind.keys();
        if let Some(key) = keys.iter().find(|key| self.number(key).is_none()) {
            return Err(missing(key, kind));
        }
        if let Some((key, _)) = self.shape.iter().find(|(key, _)| !keys.contains(key)) {
            let text = format!("probe key `{key}` has no meaning for a {kind} probe; remove it");
            return Err(TrackingError::at(key, text));
        }
        let shape = (kind.facts().read)(&self.shape);
        shape.map_err(|error| TrackingError::new(format!("probe: {error}")))
    }
}

fn missing(key: &'static str, kind: ProbeKind) -> TrackingError {
    TrackingError::at(key, format!("probe key `{key}` is missing; a {kind} probe needs it"))
}

impl TryFrom<ProbeSpec> for Probe {
    type Error = TrackingError;

    fn try_from(spec: ProbeSpec) -> Result<Self, TrackingError> {
        let kind = spec.kind.ok_or_else(|| {
            let names: Vec<&str> = ProbeKind::ALL.iter().map(|kind| kind.name()).collect();
            let (last, first) = names.split_last().expect("kinds");
            let text = format!("probe key `kind` is missing; expected {} or {last}", first.join(", "));
            TrackingError::at("kind", text)
        })?;
        let Sampling {
            depth_mm,
            frequency_mhz,
            lines,
            samples,
        } = spec.sampling;
        let probe = Self {
            shape: spec.shape(kind)?,
            depth_mm: depth_mm.ok_or_else(|| missing("depth_mm", kind))?,
            frequency_mhz: frequency_mhz.unwrap_or(kind.usual_frequency_mhz()),
            lines: lines.unwrap_or(DEFAULT_LINES),
            samples: samples.unwrap_or(DEFAULT_SAMPLES),
            aperture: spec.aperture,
        };
        probe.validate()?;
        Ok(probe)
    }
}

impl From<Probe> for ProbeSpec {
    fn from(probe: Probe) -> Self {
        Self {
            kind: Some(probe.shape.kind()),
            shape: probe.shape.numbers(),
            sampling: Sampling {
                depth_mm: Some(probe.depth_mm),
                frequency_mhz: Some(probe.frequency_mhz),
                lines: Some(probe.lines),
                samples: Some(probe.samples),
            },
            aperture: probe.aperture,
        }
    }
}

fn as_map<S: Serializer>(numbers: &Numbers, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map(numbers.iter().copied())
}

impl<'de> Deserialize<'de> for ProbeSpec {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_map(Table)
    }
}

/// A key of the table.
struct Key(&'static str);

impl<'de> Deserialize<'de> for Key {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let name = String::deserialize(deserializer)?;
        let key = keys().iter().find(|key| **key == name);
        key.map(|key| Self(key))
            .ok_or_else(|| de::Error::unknown_field(&name, keys()))
    }
}

struct Table;

impl<'de> Visitor<'de> for Table {
    type Value = ProbeSpec;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a table of a probe")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut table: A) -> Result<ProbeSpec, A::Error> {
        let mut spec = ProbeSpec::default();
        let mut stated = Vec::new();
        while let Some(Key(key)) = table.next_key()? {
            if stated.contains(&key) {
                return Err(de::Error::duplicate_field(key));
            }
            stated.push(key);
            let (sampling, aperture) = (&mut spec.sampling, &mut spec.aperture);
            match key {
                "kind" => spec.kind = table.next_value()?,
                "depth_mm" => sampling.depth_mm = table.next_value()?,
                "frequency_mhz" => sampling.frequency_mhz = table.next_value()?,
                "lines" => sampling.lines = table.next_value()?,
                "samples" => sampling.samples = table.next_value()?,
                "bandwidth" => aperture.bandwidth = table.next_value()?,
                "aperture_mm" => aperture.aperture_mm = table.next_value()?,
                "transmit_focus_mm" => aperture.transmit_focus_mm = table.next_value()?,
                "transmit_f_number" => aperture.transmit_f_number = table.next_value()?,
                "receive_f_number" => aperture.receive_f_number = table.next_value()?,
                "apodisation" => aperture.apodisation = table.next_value()?,
                "height_mm" => aperture.height_mm = table.next_value()?,
                "lens_focus_mm" => aperture.lens_focus_mm = table.next_value()?,
                _ => spec.set(key, table.next_value()?),
            }
        }
        Ok(spec)
    }
}

impl Serialize for ProbeKind {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}

impl<'de> Deserialize<'de> for ProbeKind {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        static NAMES: LazyLock<Vec<&'static str>> =
            LazyLock::new(|| ProbeKind::ALL.iter().map(|kind| kind.name()).collect());
        let name = String::deserialize(deserializer)?;
        let kind = Self::ALL.iter().find(|kind| kind.name() == name);
        kind.copied().ok_or_else(|| de::Error::unknown_variant(&name, &NAMES))
    }
}

impl fmt::Display for ProbeKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl JsonSchema for ProbeKind {
    fn schema_name() -> Cow<'static, str> {
        "ProbeKind".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        let variants = ProbeKind::ALL.iter().map(|kind| {
            let (what, keys) = (kind.described().0, kind.keys().join("` and `"));
            let description = format!(
                "{what} Takes `{keys}`. Usual frequency: {} MHz.",
                kind.usual_frequency_mhz()
            );
            json!({ "const": kind.name(), "type": "string", "description": description })
        });
        json_schema!({ "description": "Kind of probe.", "oneOf": variants.collect::<Vec<_>>() })
    }
}

impl JsonSchema for ProbeSpec {
    fn schema_name() -> Cow<'static, str> {
        "ProbeSpec".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let mut properties = Map::new();
        let mut kind = generator.subschema_for::<Option<ProbeKind>>().to_value();
        kind["description"] =
            "Kind of probe. Default: that of the PLUS configuration of a recording, or of the usual probe of the volume.".into();
        properties.insert("kind".into(), kind);
        for kind in ProbeKind::ALL {
            for (key, of_kind) in kind.described().1 {
                let text = of_kind["description"].as_str().unwrap_or_default().replace("\n\n", " ");
                let text = format!("{kind}: {text}");
                let all = properties
                    .entry(key)
                    .or_insert_with(|| json!({ "type": ["number", "null"], "format": "double" }));
                all["description"] = match all["description"].as_str() {
                    Some(others) => format!("{others}\n{text}").into(),
                    None => text.into(),
                };
                // The widest range of the kinds that have the key.
                for (bound, wider) in [("minimum", f64::min as fn(f64, f64) -> f64), ("maximum", f64::max)] {
                    if let Some(value) = of_kind[bound].as_f64() {
                        all[bound] = all[bound].as_f64().map_or(value, |other| wider(other, value)).into();
                    }
                }
            }
        }
        let cases = ProbeKind::ALL.iter().map(|kind| {
            let of_kind = kind.described().1;
            let then = properties.keys().filter(|key| *key != "kind");
            let then = then.map(|key| (key.clone(), of_kind.get(key).cloned().unwrap_or(Value::Bool(false))));
            json!({
                "if": { "properties": { "kind": { "const": kind.name() } }, "required": ["kind"] },
                "then": { "properties": then.collect::<Map<_, _>>() },
            })
        });
        let cases: Vec<Value> = cases.collect();
        for table in [schema_for!(Sampling), schema_for!(Aperture)] {
            properties.extend(table.to_value()["properties"].as_object().cloned().unwrap_or_default());
        }
        json_schema!({
            "description": "A probe: the keys of its kind, and those of every kind.",
            "type": "object",
            "additionalProperties": false,
            "properties": properties,
            "allOf": cases,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::one_of_each;
    use super::*;

    #[test]
    fn every_kind_survives_toml_and_json() {
        for probe in one_of_each() {
            let text = toml::to_string(&probe).expect("toml");
            assert_eq!(toml::from_str::<Probe>(&text).expect("toml"), probe, "{text}");
            let text = serde_json::to_string(&probe).expect("json");
            assert_eq!(serde_json::from_str::<Probe>(&text).expect("json"), probe, "{text}");
            assert!(text.contains(&format!("\"{}\"", probe.shape.kind())), "{text}");
        }
    }

    #[test]
    fn a_short_table_takes_the_defaults_of_its_kind() {
        let probe: Probe = toml::from_str("kind = \"phased\"\nangle_deg = 80\ndepth_mm = 160").expect("probe");
        assert_eq!(
            (probe.lines, probe.samples, probe.frequency_mhz),
            (DEFAULT_LINES, DEFAULT_SAMPLES, 2.5)
        );
    }

    #[test]
    fn unknown_missing_and_superfluous_keys_are_named() {
        let cases = [
            ("kind = \"phased\"\nangle_deg = 80\ndepth_mm = 160\ndepht = 3", "depht"),
            (
                "kind = \"curvilinear\"\nangle_deg = 80\ndepth_mm = 160",
                "`radius_mm` is missing",
            ),
            (
                "kind = \"phased\"\nangle_deg = 80\ndepth_mm = 160\nwidth_mm = 3",
                "`width_mm` has no meaning for a phased probe",
            ),
            (
                "kind = \"phased\"\nangle_deg = 0\ndepth_mm = 160",
                "`angle_deg` is 0; expected 1 to 120",
            ),
            ("kind = \"sector\"\nangle_deg = 9\ndepth_mm = 160", "sector"),
            ("angle_deg = 9\ndepth_mm = 160", "`kind` is missing"),
            ("kind = \"phased\"\nangle_deg = 9", "`depth_mm` is missing"),
        ];
        for (text, message) in cases {
            let error = toml::from_str::<Probe>(text).expect_err(text).to_string();
            assert!(error.contains(message), "{error}");
        }
    }
}
