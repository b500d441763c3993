//! Resolution of a case file to a material and its history.

use super::file::{CaseFile, Law};
use super::report::Report;
use crate::input::InputError;
use crate::mechanics::tissue::viscoelastic::HistoryError;
use crate::mechanics::tissue::viscoelastic::point::{Body, Knee, Point};

/// A material test with every number checked.
#[derive(Clone, Debug)]
pub struct Case {
    file: CaseFile,
    point: Point,
}

impl CaseFile {
    /// Checks every key and number.
    ///
    /// # Errors
    /// [`InputError`] with the key and its place in the file.
    pub fn resolve(self) -> Result<Case, InputError> {
        let point = Point {
            body: self.body()?,
            knee: self.knee()?,
            structure: self.memory,
        };
        let checked = point.check().and_then(|()| self.history.check());
        checked.map_err(|error| self.blame(error))?;
        Ok(Case { file: self, point })
    }

    fn body(&self) -> Result<Body, InputError> {
        let (order, modulus_kpa) = (self.order, self.modulus_kpa);
        match self.law {
            Law::SpringPot => {
                for (key, value) in [("modulus_inf_kpa", self.modulus_inf_kpa), ("tau_s", self.tau_s)] {
                    if value.is_some() {
                        let found = format!("`{key}` with `law = \"spring-pot\"`");
                        return Err(self.wrong_keys(key, found, "`law = \"zener\"`, to which it belongs"));
                    }
                }
                Ok(Body::SpringPot { order, modulus_kpa })
            }
            Law::Zener => {
                let need = |key: &str, value: Option<f64>, what: &str| {
                    value.ok_or_else(|| {
                        self.wrong_keys(
                            "law",
                            format!("`law = \"zener\"` without `{key}`"),
                            format!("`{key}`, {what}"),
                        )
                    })
                };
                Ok(Body::Zener {
                    order,
                    modulus_kpa,
                    modulus_inf_kpa: need("modulus_inf_kpa", self.modulus_inf_kpa, "the modulus that stays, kPa")?,
                    tau_s: need("tau_s", self.tau_s, "the time of the branch, s")?,
                })
            }
        }
    }

    fn knee(&self) -> Result<Knee, InputError> {
        match (self.knee_shear, self.stiffening) {
            (None, None) => Ok(Knee::NONE),
            (Some(strain), Some(stiffening)) => Ok(Knee { strain, stiffening }),
            (Some(_), None) => Err(self.wrong_keys(
                "knee_shear",
                "`knee_shear` without `stiffening`",
                "both, or neither for a material that never stiffens",
            )),
            (None, Some(_)) => Err(self.wrong_keys(
                "stiffening",
                "`stiffening` without `knee_shear`",
                "both, or neither for a material that never stiffens",
            )),
        }
    }
}

impl Case {
    /// Returns the material.
    pub fn point(&self) -> &Point {
        &self.point
    }

    /// Notes about keys under old names.
    pub fn notes(&self) -> Vec<String> {
        self.file.source.iter().flat_map(|source| source.renamed()).collect()
    }

    /// Computes the response to the history.
    ///
    /// # Errors
    /// [`InputError`] if the rule does not apply to the history, or if stress or strain overflows.
    pub fn run(&self) -> Result<Report, InputError> {
        let response = self.point.respond(&self.file.history, self.file.rule);
        let response = response.map_err(|error| self.blame(error))?;
        Ok(Report::new(&self.file.history, response))
    }

    /// Attaches the key concerned to an error.
    pub(super) fn blame(&self, error: HistoryError) -> InputError {
        self.file.blame(error)
    }
}
