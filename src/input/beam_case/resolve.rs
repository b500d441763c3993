//! Resolution of a case file to a beam, and its shape.

use super::file::{CaseFile, LayerSpec, ModelName};
use crate::base::document::InvalidFile;
use crate::base::range::OutOfRange;
use crate::input::{Cause, InputError};
use crate::mechanics::needle::beam::inverse::{self, Wanted};
use crate::mechanics::needle::beam::{
    Base, BeamError, FoundationBeam, Layer, Material, Problem, Shape, bending_stiffness_nmm2,
};

/// A case with all numbers in their ranges.
#[derive(Clone, Debug)]
pub struct Case {
    file: CaseFile,
    /// Needle and tissue.
    pub problem: Problem,
    /// Motion of the base.
    pub base: Base,
}

impl LayerSpec {
    /// Returns the material, or the key that is missing (`false`) or superfluous (`true`).
    fn material(&self) -> Result<Material, (&'static str, bool)> {
        let given = [
            ("mu_kpa", self.mu_kpa),
            ("alpha", self.alpha),
            ("c10_kpa", self.c10_kpa),
            ("c01_kpa", self.c01_kpa),
            ("c20_kpa", self.c20_kpa),
        ];
        let keys = self.model.keys();
        if let Some((key, _)) = given.iter().find(|(key, value)| value.is_some() && !keys.contains(key)) {
            return Err((key, true));
        }
        let number = |key: &'static str| {
            let value = given
                .iter()
                .find(|(name, _)| *name == key)
                .and_then(|(_, value)| *value);
            value.ok_or((key, false))
        };
        Ok(match self.model {
            ModelName::Ogden => Material::Ogden {
                mu_kpa: number("mu_kpa")?,
                alpha: number("alpha")?,
            },
            ModelName::NeoHookean => Material::NeoHookean {
                mu_kpa: number("mu_kpa")?,
            },
            ModelName::MooneyRivlin => Material::MooneyRivlin {
                c10_kpa: number("c10_kpa")?,
                c01_kpa: number("c01_kpa")?,
            },
            ModelName::Yeoh => Material::Yeoh {
                c10_kpa: number("c10_kpa")?,
                c20_kpa: number("c20_kpa")?,
            },
        })
    }
}

impl ModelName {
    fn name(self) -> &'static str {
        match self {
            ModelName::Ogden => "ogden",
            ModelName::NeoHookean => "neo-hookean",
            ModelName::MooneyRivlin => "mooney-rivlin",
            ModelName::Yeoh => "yeoh",
        }
    }

    /// Keys of the parameters of a model.
    fn keys(self) -> &'static [&'static str] {
        match self {
            ModelName::Ogden => &["mu_kpa", "alpha"],
            ModelName::NeoHookean => &["mu_kpa"],
            ModelName::MooneyRivlin => &["c10_kpa", "c01_kpa"],
            ModelName::Yeoh => &["c10_kpa", "c20_kpa"],
        }
    }
}

impl CaseFile {
    /// Checks every number.
    ///
    /// # Errors
    /// [`InputError`] with the key and its place in the file.
    pub fn resolve(self) -> Result<Case, InputError> {
        let within = |key: &str, found: f64, [low, high]: [f64; 2], unit: &str| {
            let expected = format!("{low} to {high} {unit}");
            match (low..=high).contains(&found) {
                true => Ok(found),
                false => Err(self.fault(key, InvalidFile::number(found, expected))),
            }
        };
        let young_gpa = within("needle.young_gpa", self.needle.young_gpa, [1e-3, 1e4], "GPa")?;
        let diameter_mm = within("needle.diameter_mm", self.needle.diameter_mm, [0.01, 10.0], "mm")?;
        let displacement_mm = within("base.displacement_mm", self.base.displacement_mm, [-1e6, 1e6], "mm")?;
        let slope = self
            .base
            .slope
            .map(|slope| within("base.slope", slope, [-1e6, 1e6], ""));
        let layers = self.layers()?;
        let sum = layers.iter().map(|layer| layer.thickness_mm).sum();
        let problem = Problem {
            bending_nmm2: bending_stiffness_nmm2(young_gpa, diameter_mm),
            control_distance_mm: self.base.control_distance_mm,
            inserted_mm: self.needle.inserted_mm.unwrap_or(sum),
            layers,
            element_mm: self.mesh.element_mm,
        };
        problem.check().map_err(|error| {
            let table = match error.key.as_str() {
                "control_distance_mm" => "base",
                "element_mm" => "mesh",
                _ => "needle",
            };
            self.number(format!("{table}.{}", error.key), error)
        })?;
        let base = Base {
            displacement_mm,
            slope: slope.transpose()?,
        };
        Ok(Case {
            problem,
            base,
            file: self,
        })
    }

    fn layers(&self) -> Result<Vec<Layer>, InputError> {
        if self.layer.is_empty() {
            return Err(self.wrong_keys("layer", "no `[[layer]]`", "at least one"));
        }
        let layer = |(at, spec): (usize, &LayerSpec)| {
            let key = |key: &str| format!("layer[{at}].{key}");
            let material = spec.material().map_err(|(name, too_much)| {
                let keys = spec.model.keys().join("` and `");
                let expected = format!("`{keys}` with `model = \"{}\"`", spec.model.name());
                let found = if too_much {
                    format!("`{name}`")
                } else {
                    format!("no `{name}`")
                };
                self.wrong_keys(key(name), found, expected)
            })?;
            let layer = Layer {
                thickness_mm: spec.thickness_mm,
                material,
                compression: spec.compression,
                initial_length_mm: spec.initial_length_mm,
                friction: spec.friction,
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

impl Case {
    /// Solves for the shape of the needle.
    ///
    /// # Errors
    /// [`InputError`] if no shape is found.
    pub fn solve(&self) -> Result<Shape, InputError> {
        self.beam()?.solve(&self.base).map_err(|error| self.blame(error))
    }

    /// Discretisation error: largest difference (mm) between `shape` and that with elements of half the length. `None` if the
    /// latter cannot be computed.
    pub fn element_error_mm(&self, shape: &Shape) -> Option<f64> {
        let mut finer = self.problem.clone();
        finer.element_mm /= 2.0;
        let finer = FoundationBeam::new(&finer).ok()?.solve(&self.base).ok()?;
        let apart = shape
            .points
            .iter()
            .map(|point| (point.u_mm - finer.at(point.x_mm)[0]).abs());
        Some(apart.fold(0.0, f64::max))
    }

    /// Finds the base motion for a wanted result, and the resulting shape of the needle.
    ///
    /// # Errors
    /// [`InputError`] if there is none.
    pub fn find(&self, wanted: &Wanted) -> Result<(Base, Shape), InputError> {
        inverse::find(&mut self.beam()?, wanted).map_err(|error| self.blame(error))
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
            _ => "base".to_owned(),
        };
        self.file.fault(key, Cause::Beam(error))
    }
}
