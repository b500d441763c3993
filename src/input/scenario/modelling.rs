//! Tissue model settings: model, level of remeshing, precision, device.

use super::file::ScenarioFile;
use super::resolve::Timing;
use super::tissue::{ColumnsName, DeviceName, TissueModel};
use insonify_base::document::InputError;
use insonify_gpu::{AdapterChoice, Gpu, Needs};
use insonify_mechanics::tissue::remesh::{Level, Precision};

/// Tissue model settings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Modelling {
    /// Tissue model.
    pub model: TissueModel,
    /// Level of remeshing (finite elements).
    pub level: Level,
    /// Precision of the dense inverse (finite elements).
    pub precision: Precision,
    /// Source of the compliance columns (finite elements).
    pub columns: ColumnsName,
    /// Minimum distance between nodes on the needle, mm (finite elements).
    pub contact_spacing_mm: f64,
}

impl ScenarioFile {
    /// Tissue model settings, checked against each other, with defaults for those not stated.
    pub(crate) fn modelling(&self) -> Result<Modelling, InputError> {
        let spec = &self.tissue;
        let level = spec.level.unwrap_or_default();
        let is_on_gpu = self.is_on_gpu();
        let usual = if is_on_gpu {
            Precision::Single
        } else {
            Precision::Double
        };
        let precision = spec.precision.unwrap_or(usual);
        let usual = match level {
            Level::Exact => ColumnsName::OnDemand,
            _ => ColumnsName::Dense,
        };
        let columns = spec.columns.unwrap_or(usual);
        if is_on_gpu && level == Level::Exact {
            let key = if spec.level.is_some() {
                "tissue.level"
            } else {
                "tissue.device"
            };
            let found = "the exact level on a GPU, which does not support it";
            return Err(self.wrong_keys(key, found, "`level` I, II, III or IV, or `device = \"cpu\"`"));
        }
        if is_on_gpu && precision == Precision::Double {
            let expected = "`f32`, or `device = \"cpu\"`";
            return Err(self.wrong_keys(
                "tissue.precision",
                "f64 on a GPU, which keeps the inverse in f32",
                expected,
            ));
        }
        let changes_to_dense = self.run.change.iter().any(|change| change.level != Level::Exact);
        if level == Level::Exact && precision == Precision::Single && !changes_to_dense {
            return Err(self.wrong_keys("tissue.precision", "f32 at the exact level", "`f64`, or another level"));
        }
        if level != Level::Exact && columns == ColumnsName::OnDemand {
            let found = format!("columns on demand at level {level}, which keeps a dense inverse");
            return Err(self.wrong_keys("tissue.columns", found, "`dense`, or the exact level"));
        }
        if spec.model != TissueModel::FiniteElement && !self.run.change.is_empty() {
            let found = "a change of level of a model that has none";
            return Err(self.wrong_keys("run.change", found, "`tissue.model = \"finite-element\"`"));
        }
        self.of_kind("tissue", spec, spec.model)?;
        Ok(Modelling {
            contact_spacing_mm: spec.contact_spacing_mm.unwrap_or(1.0),
            model: spec.model,
            level,
            precision,
            columns,
        })
    }

    /// Whether a GPU is requested. Models other than finite elements refuse it themselves.
    fn is_on_gpu(&self) -> bool {
        self.tissue.device == Some(DeviceName::Gpu) && self.tissue.model == TissueModel::FiniteElement
    }

    /// Opens the GPU, if requested.
    pub(crate) fn gpu(&self) -> Result<Option<Gpu>, InputError> {
        if !self.is_on_gpu() {
            return Ok(None);
        }
        let choice = self.adapter.clone().unwrap_or_else(|| AdapterChoice::from_flag(None));
        let gpu = Gpu::open(&choice, &Needs::default());
        gpu.map(Some).map_err(|error| self.fault("tissue.device", error))
    }

    /// Times of changes of the level, and the new levels.
    pub(crate) fn changes(&self, timing: &Timing) -> Result<Vec<(f64, Level)>, InputError> {
        let mut changes: Vec<(f64, Level)> = Vec::new();
        for (at, change) in self.run.change.iter().enumerate() {
            let key = format!("run.change[{at}].at_s");
            let at_s = self.number(
                key.as_str(),
                change.at_s,
                |at_s| self.during(timing, at_s),
                "a time within the run, s",
            )?;
            if let Some((before, _)) = changes
                .last()
                .filter(|(before, _)| timing.step_at(*before) >= timing.step_at(at_s))
            {
                let found = format!("a change at {at_s} s after one at {before} s");
                return Err(self.wrong_keys(key, found, "ascending times, in a step each"));
            }
            changes.push((at_s, change.level));
        }
        Ok(changes)
    }
}
