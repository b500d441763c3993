//! Case files for a needle whose base is moved: needle, base, elements and tissue layers in one TOML file.
//!
//! [`CaseFile`] is the file as written; [`CaseFile::resolve`] checks it; [`BeamCase::solve`] bends the needle (see
//! [`mechanics::needle::beam`](insonify_mechanics::needle::beam)) and [`BeamCase::find`] finds the base motion for what
//! is wanted. Errors point at the line. [`points`] reads measured stretch and stress.
//!
//! ```
//! use insonify_study::beam_case::{self, CaseFile};
//!
//! let case = CaseFile::parse(beam_case::EXAMPLE, "beam.toml")?.resolve()?;
//! assert_eq!(case.solve()?.rcm_mm(), Some(17.5));
//!
//! let error = CaseFile::parse(&beam_case::EXAMPLE.replace("slope", "slop"), "beam.toml").unwrap_err();
//! assert_eq!(error.location(), Some(("beam.toml", 15)));
//! # Ok::<(), insonify::InputError>(())
//! ```

pub mod points;
mod report;

pub use report::{BeamReport, Node, plot};

use std::sync::Arc;

use schemars::JsonSchema;
use serde::Deserialize;

use insonify_base::document::{self, InputError, InvalidFile, Source, Version};
use insonify_base::kinds::KeyedKind;
use insonify_base::range::{Kind, OutOfRange};
use insonify_mechanics::needle::beam::inverse::{self, Wanted};
use insonify_mechanics::needle::beam::spec::{BaseSpec, LayerTable, MeshSpec, NeedleSpec};
use insonify_mechanics::needle::beam::{
    Base, BeamError, BeamLayer, FoundationBeam, Problem, Shape, bending_stiffness_nmm2,
};

/// Example case file with every key.
pub const EXAMPLE: &str = include_str!("../../assets/beam.toml");

/// A needle in layers of tissue whose base is moved sideways. It lies along x, from the base (before 0) through the
/// entry (0) to the tip; u is its lateral deflection.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CaseFile {
    /// Version of the format: 1, which is the default.
    pub version: Option<Version>,
    /// The needle.
    pub needle: NeedleSpec,
    /// Motion of the base.
    pub base: BaseSpec,
    /// Discretisation of the needle.
    #[serde(default)]
    pub mesh: MeshSpec,
    /// Tissue layers, starting at the entry.
    #[serde(default)]
    pub layer: Vec<LayerTable>,
    /// Source text, for errors that point into it.
    #[serde(skip)]
    source: Option<Arc<Source>>,
}

document::input_file!(CaseFile, in_ranges);

/// A case with all numbers in their ranges.
#[derive(Clone, Debug)]
pub struct BeamCase {
    file: CaseFile,
    /// Needle and tissue.
    pub problem: Problem,
    /// Motion of the base.
    pub base: Base,
    /// Measured shape: position along the undeflected needle and deflection, mm, from base to tip; empty if not
    /// measured.
    pub measured_mm: Vec<[f64; 2]>,
}

impl CaseFile {
    /// Checks every number.
    ///
    /// # Errors
    /// [`InputError`] with the key and its place in the file.
    pub fn resolve(self) -> Result<BeamCase, InputError> {
        self.in_ranges("base", &self.base)?;
        self.in_ranges("needle", &self.needle)?;
        if self.base.slope.is_some() && self.base.pivot_mm.is_some() {
            let found = "`pivot_mm` of a base whose `slope` is prescribed";
            return Err(self.wrong_keys(
                "base.pivot_mm",
                found,
                "one of them: only a base that rotates freely has an axis",
            ));
        }
        let layers = self.layers()?;
        let sum = layers.iter().map(|layer| layer.thickness_mm).sum();
        let problem = Problem {
            bending_nmm2: self.bending_nmm2()?,
            control_distance_mm: self.base.control_distance_mm,
            pivot_mm: self.base.pivot_mm.unwrap_or(0.0),
            inserted_mm: self.needle.inserted_mm.unwrap_or(sum),
            layers,
            element_mm: self.mesh.element_mm,
        };
        // The problem knows only its own keys; whoever reads the file needs
        // the table in which the number stands.
        problem.check().map_err(|error| {
            let table = match error.key.as_str() {
                "control_distance_mm" | "pivot_mm" => "base",
                "element_mm" => "mesh",
                _ => "needle",
            };
            self.number(format!("{table}.{}", error.key), error)
        })?;
        let base = Base {
            displacement_mm: self.base.displacement_mm,
            slope: self.base.slope,
        };
        let measured_mm = self.measured_mm()?;
        Ok(BeamCase {
            problem,
            base,
            measured_mm,
            file: self,
        })
    }

    /// Bending stiffness, given or of a rod or tube.
    fn bending_nmm2(&self) -> Result<f64, InputError> {
        let needle = &self.needle;
        let section = [
            ("young_gpa", needle.young_gpa),
            ("diameter_mm", needle.diameter_mm),
            ("inner_diameter_mm", needle.inner_diameter_mm),
        ];
        if let Some(stiffness) = needle.bending_stiffness_nmm2 {
            let beside = section.iter().find(|(_, given)| given.is_some());
            return match beside {
                None => Ok(stiffness),
                Some((key, _)) => {
                    let found = format!("`{key}` beside `bending_stiffness_nmm2`");
                    let expected = "one of them: the stiffness follows from modulus and diameters";
                    Err(self.wrong_keys(format!("needle.{key}"), found, expected))
                }
            };
        }
        let (Some(young_gpa), Some(outer_mm)) = (needle.young_gpa, needle.diameter_mm) else {
            let missing = if needle.young_gpa.is_none() {
                "young_gpa"
            } else {
                "diameter_mm"
            };
            let expected = "`young_gpa` and `diameter_mm`, or `bending_stiffness_nmm2`";
            return Err(self.wrong_keys(format!("needle.{missing}"), format!("no `{missing}`"), expected));
        };
        let inner_mm = needle.inner_diameter_mm.unwrap_or(0.0);
        if !(0.0..outer_mm).contains(&inner_mm) {
            let expected = format!("0 to below the outer diameter, {outer_mm} mm");
            return Err(self.fault("needle.inner_diameter_mm", InvalidFile::number(inner_mm, expected)));
        }
        Ok(bending_stiffness_nmm2(young_gpa, outer_mm) - bending_stiffness_nmm2(young_gpa, inner_mm))
    }

    /// Measured shape: finite, with rising positions.
    fn measured_mm(&self) -> Result<Vec<[f64; 2]>, InputError> {
        let measured = self.needle.measured_mm.clone().unwrap_or_default();
        let finite = measured.iter().flatten().all(|x| x.abs() <= 1e6);
        let rising = measured.windows(2).all(|pair| pair[0][0] < pair[1][0]);
        if finite && rising && measured.len() != 1 {
            Ok(measured)
        } else {
            Err(self.wrong_keys(
                "needle.measured_mm",
                format!("{} pairs that do not describe a shape", measured.len()),
                "at least two pairs of position and deflection, mm, positions rising",
            ))
        }
    }

    fn layers(&self) -> Result<Vec<BeamLayer>, InputError> {
        if self.layer.is_empty() {
            return Err(self.wrong_keys("layer", "no `[[layer]]`", "at least one"));
        }
        let layer = |(index, spec): (usize, &LayerTable)| {
            let key = |key: &str| format!("layer[{index}].{key}");
            spec.check_kind().map_err(|error| self.number(key(&error.key), error))?;
            if let Some(missing) = spec.unstated() {
                let keys = spec.model.keys().join("` and `");
                let expected = format!("`{keys}` with {}", spec.model.stated_as());
                return Err(self.wrong_keys(key(missing), format!("no `{missing}`"), expected));
            }
            let material = spec.keys().map_err(|error| self.number(key(&error.key), error))?;
            let layer = BeamLayer {
                thickness_mm: spec.thickness_mm,
                material,
                compression: spec.compression,
                initial_length_mm: spec.initial_length_mm,
                friction: spec.friction,
                least_ratio: spec.min_compression_ratio,
            };
            layer.check().map_err(|error| self.number(key(&error.key), error))?;
            Ok(layer)
        };
        self.layer.iter().enumerate().map(layer).collect()
    }

    fn number(&self, key: String, error: OutOfRange) -> InputError {
        let OutOfRange { found, expected, .. } = error;
        self.fault(key, InvalidFile::keys(found, expected))
    }
}

impl BeamCase {
    /// Solves for the shape of the needle.
    ///
    /// # Errors
    /// [`InputError`] if no shape is found.
    pub fn solve(&self) -> Result<Shape, InputError> {
        self.beam()?.solve(&self.base).map_err(|error| self.blame(error))
    }

    /// Discretisation error: largest difference (mm) between `shape` and that with elements of half the length. `None`
    /// if the latter cannot be computed.
    pub fn element_error_mm(&self, shape: &Shape) -> Option<f64> {
        let mut finer = self.problem.clone();
        finer.element_mm /= 2.0;
        let finer = FoundationBeam::new(&finer).ok()?.solve(&self.base).ok()?;
        let differences = shape
            .points
            .iter()
            .map(|point| (point.u_mm - finer.at(point.x_mm)[0]).abs());
        Some(differences.fold(0.0, f64::max))
    }

    /// Finds the base motion for a wanted result, and the resulting shape of the needle.
    ///
    /// # Errors
    /// [`InputError`] if there is none, or if a layer is compressed beyond its limit.
    pub fn find(&self, wanted: &Wanted) -> Result<(Base, Shape), InputError> {
        inverse::find(&mut self.beam()?, wanted).map_err(|error| self.blame(error))
    }

    /// Finds the base motion for a wanted result, and the resulting shape, even if a layer is compressed beyond its
    /// limit.
    ///
    /// # Errors
    /// [`InputError`] if there is none.
    pub fn reach(&self, wanted: &Wanted) -> Result<(Base, Shape), InputError> {
        inverse::reach(&mut self.beam()?, wanted).map_err(|error| self.blame(error))
    }

    /// Text of this case with a measured base motion, its lengths (control distance and inserted depth, mm) and the
    /// measured shape in place of its own. The last layer is made as thick as the needle needs.
    ///
    /// # Errors
    /// [`InputError`] if the result is no valid case.
    pub fn with_measured(
        &self,
        base: &Base,
        lengths_mm: [f64; 2],
        shape_mm: &[[f64; 2]],
    ) -> Result<String, InputError> {
        let failed = |error: &dyn std::fmt::Display| self.file.wrong_keys("needle", error.to_string(), "a case");
        // The user's own text is changed, so that keys without a part in the measurement stay as they are.
        let source = self.file.source.as_ref();
        let mut table: toml::Table = source
            .map_or("", |source| &source.text)
            .parse()
            .map_err(|error: toml::de::Error| failed(&error.message()))?;
        let rounded = |x: f64| toml::Value::Float((x * 1e5).round() / 1e5);
        let mut part = |name: &str, values: Vec<(&str, toml::Value)>, without: &[&str]| {
            let entry = table.entry(name).or_insert_with(|| toml::Table::new().into());
            if let Some(entries) = entry.as_table_mut() {
                without.iter().for_each(|key| drop(entries.remove(*key)));
                entries.extend(values.into_iter().map(|(key, value)| (key.to_owned(), value)));
            }
        };
        let shape = shape_mm
            .iter()
            .map(|pair| toml::Value::Array(pair.map(rounded).to_vec()));
        let inserted = rounded(lengths_mm[1]);
        part(
            "needle",
            vec![
                ("inserted_mm", inserted.clone()),
                ("measured_mm", shape.collect::<Vec<_>>().into()),
            ],
            &[],
        );
        let mut motion = vec![
            ("control_distance_mm", rounded(lengths_mm[0])),
            ("displacement_mm", rounded(base.displacement_mm)),
        ];
        motion.extend(base.slope.map(|slope| ("slope", rounded(slope))));
        part("base", motion, &["slope", "pivot_mm"]);
        let above: f64 = self.problem.layers.iter().map(|layer| layer.thickness_mm).sum();
        let lacking = inserted.as_float().unwrap_or(0.0) - above;
        let layers = table.get_mut("layer").and_then(toml::Value::as_array_mut);
        let last = layers
            .and_then(|layers| layers.last_mut())
            .and_then(toml::Value::as_table_mut);
        if let (Some(last), Some(layer), true) = (last, self.problem.layers.last(), lacking > 0.0) {
            last.insert("thickness_mm".to_owned(), (layer.thickness_mm + lacking).into());
        }
        let text = toml::to_string(&table).map_err(|error| failed(&error))?;
        CaseFile::parse(&text, "the measured case")?.resolve()?;
        Ok(text)
    }

    fn beam(&self) -> Result<FoundationBeam, InputError> {
        let key = |error: &OutOfRange| format!("needle.{}", error.key);
        FoundationBeam::new(&self.problem).map_err(|error| self.file.number(key(&error), error))
    }

    fn blame(&self, error: BeamError) -> InputError {
        let key = match &error {
            BeamError::Crushed { depth_mm, .. } => {
                let mut depth = 0.0;
                let layers = self.problem.layers.iter().position(|layer| {
                    depth += layer.thickness_mm;
                    *depth_mm < depth
                });
                format!("layer[{}].initial_length_mm", layers.unwrap_or(0))
            }
            BeamError::Compressed { layer, .. } => format!("layer[{}].min_compression_ratio", layer - 1),
            _ => "base".to_owned(),
        };
        self.file.fault(key, error)
    }
}

#[cfg(test)]
mod tests;
