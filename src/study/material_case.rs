//! Case files for material tests: one point of tissue in shear, under a history of stress or strain.
//!
//! [`CaseFile`] is the file as written; [`CaseFile::resolve`] checks it; [`MaterialCase::run`] follows the history (see
//! [`mechanics::tissue::viscoelastic::point`](insonify_mechanics::tissue::viscoelastic::point)). [`rheometer`] puts the
//! material through the measurements of Kobayashi et al. 2010. Errors point at the line.
//!
//! ```
//! use insonify_study::material_case::CaseFile;
//!
//! let text = r#"
//! law = "spring-pot"
//! order = 0.1
//! modulus_kpa = 0.4
//! [history]
//! control = "stress"
//! time_s = [0.0, 1.0, 10.0]
//! value = [0.05, 0.05, 0.05]
//! "#;
//! let report = CaseFile::parse(text, "creep.toml")?.resolve()?.run()?;
//! // 0.05 t^k / (0.4 Gamma(1.1)) at 10 s.
//! assert!((report.strain[2] - 0.125 * 10f64.powf(0.1) / 0.951350769866873).abs() < 1e-12);
//!
//! let error = CaseFile::parse(&text.replace("0.1\n", "1.1\n"), "creep.toml")?.resolve().unwrap_err();
//! assert_eq!(error.location(), Some(("creep.toml", 3)));
//! # Ok::<(), insonify::InputError>(())
//! ```

pub mod fit;
pub mod rheometer;

use std::fmt;
use std::sync::Arc;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use insonify_base::document::{self, InputError, Source, Version};
use insonify_base::range::parameters;
use insonify_base::table::{Cell, Table};
use insonify_mechanics::tissue::viscoelastic::HistoryError;
use insonify_mechanics::tissue::viscoelastic::point::{
    Control, Knee, Loading, Method, Point, Response, Rheology, Structure,
};
use insonify_report::plot::{Axis, Marker, Plot, Series};

/// Example case file with every key.
pub const EXAMPLE: &str = include_str!("../../assets/liver-creep.toml");

parameters! {
    /// A test of a material: one point in simple shear.
    pub struct CaseFile with required keys {
        /// Version of the format: 1, which is the default.
        version: Option<Version>;
        /// Constitutive law.
        law: Law;
        /// k of the spring-pot: 0 for a spring, 1 for a dashpot; about 0.1 for liver.
        order: f64, in 0..=1;
        /// Modulus G: of the spring-pot, kPa s^k; of the Zener body's branch, kPa.
        modulus_kpa: f64, above 0;
        /// Zener: modulus G_inf of the spring in parallel with the branch.
        modulus_inf_kpa: Option<f64>, in 0 "kPa";
        /// Zener: relaxation time of the spring-pot in the branch.
        tau_s: Option<f64>, above 0 "s";
        /// Shear strain at which the material begins to stiffen: 2/sqrt(3) of the relative strain in `solve` and
        /// `insert`. Default: no stiffening.
        #[serde(alias = "knee_strain")]
        knee_shear: Option<f64>;
        /// Stiffening coefficient a in G0 (1 + a (shear - knee_shear)^2). Requires `knee_shear`.
        stiffening: Option<f64>, in 0;
        /// Position of the stiffness relative to the memory; the two differ only beyond the knee.
        #[serde(default, alias = "structure")]
        memory: Structure;
        /// Quadrature of the history.
        #[serde(default)]
        rule: Method;
        /// Load history.
        history: Loading;
        /// Source text, for errors that point into it.
        #[serde(skip)]
        source: Option<Arc<Source>>;
    }
}

document::input_file!(CaseFile);

/// Constitutive law.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Law {
    /// Spring-pot: modulus_kpa d^k strain / dt^k = stress.
    SpringPot,
    /// A spring in parallel with a branch of a spring in series with a spring-pot.
    Zener,
}

impl CaseFile {
    /// Attaches the key concerned to an error.
    fn blame(&self, error: HistoryError) -> InputError {
        let key = match &error {
            HistoryError::Number(error) => match error.key.as_str() {
                // In a case file the knee refers to the shear strain.
                "knee_strain" => "knee_shear".to_owned(),
                key if key.starts_with("time_s") || key.starts_with("value") => format!("history.{key}"),
                key => key.to_owned(),
            },
            HistoryError::Lengths { .. } => "history.value".to_owned(),
            HistoryError::Overflow { .. } => "history.value".to_owned(),
            _ => "history.time_s".to_owned(),
        };
        InputError::new(error).at_key(key, self.source.as_ref())
    }
}

/// A material test with every number checked.
#[derive(Clone, Debug)]
pub struct MaterialCase {
    file: CaseFile,
    point: Point,
}

impl CaseFile {
    /// Checks every key and number.
    ///
    /// # Errors
    /// [`InputError`] with the key and its place in the file.
    pub fn resolve(self) -> Result<MaterialCase, InputError> {
        let point = Point {
            body: self.body()?,
            knee: self.knee()?,
            structure: self.memory,
        };
        let checked = point.check().and_then(|()| self.history.check());
        checked.map_err(|error| self.blame(error))?;
        Ok(MaterialCase { file: self, point })
    }

    fn body(&self) -> Result<Rheology, InputError> {
        let (order, modulus_kpa) = (self.order, self.modulus_kpa);
        match self.law {
            Law::SpringPot => {
                for (key, value) in [("modulus_inf_kpa", self.modulus_inf_kpa), ("tau_s", self.tau_s)] {
                    if value.is_some() {
                        let key_and_law = format!("`{key}` with `law = \"spring-pot\"`");
                        return Err(self.wrong_keys(key, key_and_law, "`law = \"zener\"`, to which it belongs"));
                    }
                }
                Ok(Rheology::SpringPot { order, modulus_kpa })
            }
            Law::Zener => {
                let need = |key: &str, value: Option<f64>, meaning: &str| {
                    value.ok_or_else(|| {
                        self.wrong_keys(
                            "law",
                            format!("`law = \"zener\"` without `{key}`"),
                            format!("`{key}`, {meaning}"),
                        )
                    })
                };
                Ok(Rheology::Zener {
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
            (None, None) => Ok(Knee::INFINITE),
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

impl MaterialCase {
    /// Notes about keys under old names.
    pub fn notes(&self) -> Vec<String> {
        self.file.source.iter().flat_map(|source| source.renamed()).collect()
    }

    /// Computes the response to the history.
    ///
    /// # Errors
    /// [`InputError`] if the rule does not apply to the history, or if stress or strain overflows.
    pub fn run(&self) -> Result<MaterialReport, InputError> {
        let response = self.point.respond(&self.file.history, self.file.rule);
        let response = response.map_err(|error| self.file.blame(error))?;
        Ok(MaterialReport::new(&self.file.history, response))
    }
}

/// Response of a material, as `insonify material --json` prints it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MaterialReport {
    /// Times of the history, s.
    pub time_s: Vec<f64>,
    /// Shear strain at those times.
    pub strain: Vec<f64>,
    /// Shear stress, kPa. `None` (`null`) where it is infinite: at a jump of strain, in a spring-pot.
    pub stress_kpa: Vec<Option<f64>>,
    /// Prescribed quantity.
    #[serde(skip)]
    pub control: Control,
    /// Number of substeps between two times.
    #[serde(skip)]
    pub substeps: usize,
    /// Relative change of the response when the steps were last halved, as a fraction of its largest value; `None` if
    /// they were not.
    #[serde(skip)]
    pub change: Option<f64>,
}

/// Estimated error above which a warning is given.
const MAX_CHANGE: f64 = 1e-3;
/// Maximum number of plot points drawn with markers.
const MAX_MARKED: usize = 60;

impl MaterialReport {
    fn new(loading: &Loading, response: Response) -> MaterialReport {
        MaterialReport {
            time_s: loading.time_s.clone(),
            strain: response.strain,
            stress_kpa: response.stress_kpa,
            control: loading.control,
            substeps: response.substeps,
            change: response.change,
        }
    }

    /// Warnings about the response.
    pub fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        if self.stress_kpa.contains(&None) {
            warnings.push("the stress at the start is infinite (null in JSON): a spring-pot cannot jump".to_owned());
        }
        match self.change {
            None => warnings.push("the history is too long to be refined: its own times are the steps".to_owned()),
            Some(change) if change > MAX_CHANGE => warnings.push(format!(
                "the answer still changed by {change:.1e} of its largest value when steps were last halved; another rule may do better"
            )),
            Some(_) => {}
        }
        warnings
    }

    /// Plot of the computed quantity against time.
    pub fn plot(&self) -> Plot {
        let pairs = |values: &mut dyn Iterator<Item = Option<f64>>| {
            let pairs = self.time_s.iter().zip(values);
            pairs.filter_map(|(time, value)| Some([*time, value?])).collect()
        };
        let (title, label, points) = match self.control {
            Control::Stress => {
                let points = pairs(&mut self.strain.iter().copied().map(Some));
                ("Strain under the given stress", "shear strain", points)
            }
            Control::Strain => {
                let points = pairs(&mut self.stress_kpa.iter().copied());
                ("Stress under the given strain", "shear stress, kPa", points)
            }
        };
        let mut series = Series::line(label, 0, points);
        if self.time_s.len() <= MAX_MARKED {
            series.marker = Marker::Disc;
        }
        Plot::new(title, Axis::linear("time, s"), Axis::linear(label), vec![series])
    }
}

impl fmt::Display for MaterialReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let rows = self.time_s.iter().zip(&self.strain).zip(&self.stress_kpa);
        let rows = rows.map(|((time, strain), stress)| {
            let stress = stress.map_or("infinite".to_owned(), |stress| format!("{stress:.6}"));
            [format!("{time:.6}"), format!("{strain:.6}"), stress]
        });
        let head = ["time s", "strain", "stress kPa"].map(Cell::number);
        f.write_str(&Table::new(head).with(rows).text(" ", &[14; 3]))?;
        write!(f, "\nsteps between two times {}", self.substeps)?;
        match self.change {
            Some(change) => write!(
                f,
                ", last halving changed the answer by {change:.1e} of its largest value"
            ),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests;
