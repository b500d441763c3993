//! Case files for the identification of force parameters and Young's moduli from a measured insertion (Dehghan et al.
//! 2008, section "Parameter identification method").
//!
//! [`CaseFile`] is the file as written; [`CaseFile::resolve`] reads its scenario and checks it. Errors point at the
//! line.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use nalgebra::{Isometry3, Point3, Translation3, Unit, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use insonify::input::scenario::{self, Scenario, ScenarioFile};
use insonify_base::document::{self, InputError, InvalidFile, Names, RegionName, Source, Version, nearest};
use insonify_base::range::parameters;
use insonify_mechanics::tissue::law::LawSpec;
use insonify_mechanics::tissue::material::Material;

/// Example case file with every key.
pub const EXAMPLE: &str = include_str!("../../assets/identification.toml");

/// A measured insertion, and the scenario that is to reproduce it. Paths are relative to the folder of the file.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CaseFile {
    /// Version of the format: 1, which is the default.
    pub version: Option<Version>,
    /// Scenario: mesh or volume, fixed nodes, straight line of the needle, probe. The name of one that comes with the
    /// program, or the path of one (linear finite elements).
    pub scenario: String,
    /// Measured force.
    pub force: ForceSpec,
    /// Measured displacement of the tissue; required unless every Young's modulus is known.
    pub motion: Option<MotionSpec>,
    /// Poisson's ratios (0 to below 0.5): an identification for each, with all layers of that ratio. Default: one, with
    /// those of the scenario.
    #[serde(default)]
    pub poisson: Vec<f64>,
    /// Quantity that is minimised. Default `points`.
    #[serde(default)]
    pub cost: Cost,
    /// Law of the tissue whose displacements are compared; Young's moduli and Poisson's ratios are those at small strain.
    /// Default: linear elasticity.
    pub law: Option<LawSpec>,
    /// Weight W of the displacements measured in each region of the force, two regions a layer (0 or more, not all 0).
    /// Default 1 while a layer is punctured, 4 behind.
    pub weights: Option<Vec<f64>>,
    /// Layers whose Young's modulus is known, or where its search starts.
    #[serde(default)]
    pub layer: Vec<LayerSpec>,
    /// Source text, for errors that point into it.
    #[serde(skip)]
    source: Option<Arc<Source>>,
}

document::input_file!(CaseFile);

/// Measured force.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ForceSpec {
    /// CSV file with the columns `tip_mm` (tip depth below the surface at rest) and `force_n` (positive while the
    /// needle is pushed in); or a table `steps.csv` of `insonify insert`.
    pub file: PathBuf,
}

/// Measured displacement of the tissue.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MotionSpec {
    /// CSV file: the table of `insonify motion`, or of `insonify rf --truth`; or the columns `tip_mm`, `node` or
    /// `x_mm,y_mm,z_mm` (at rest), and `ux_mm`, `uy_mm`, `uz_mm` (some of them; empty cells are not measured).
    pub file: PathBuf,
    /// With frames: CSV file with the columns `frame` and `tip_mm`. Default: frames at the rate of the scenario, during
    /// its motion of the needle.
    pub frames: Option<PathBuf>,
}

/// Cost function.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Cost {
    /// Sum of the squared errors of all displacements (Dehghan et al. 2008, equation 1).
    #[default]
    Points,
    /// Squared error of the mean displacement (Dehghan et al. 2007).
    Mean,
}

parameters! {
    /// A layer.
    pub struct LayerSpec with required keys {
        /// Region: its name, a part of its name, or its number.
        region: RegionName;
        /// Young's modulus. Default: that of the scenario.
        young_kpa: Option<f64>, above 0 "kPa";
        /// Whether the modulus is known; otherwise the search starts there. Default false.
        #[serde(default)]
        known: bool;
    }
}

/// Distance between samples along the needle's line, mm.
const STEP_MM: f64 = 0.05;
/// Largest distance of a straight path from its line, mm.
const MAX_OFF_LINE_MM: f64 = 0.01;
/// Shortest layer, mm.
const MIN_LAYER_MM: f64 = 0.5;

/// A case with its scenario made.
#[derive(Clone, Debug)]
pub struct IdentificationCase {
    file: CaseFile,
    /// Scenario whose parameters are identified.
    pub scenario: Scenario,
    /// Text of the scenario, and the folder of its paths.
    pub text: (String, PathBuf),
    /// Entry of the needle's line into the tissue at rest, mm.
    pub entry: Point3<f64>,
    /// Direction of the needle.
    pub direction: Unit<Vector3<f64>>,
    /// Base of the needle when its tip is at the entry.
    base: Isometry3<f64>,
    /// Way of the tip beyond the entry on the scenario's path, mm.
    pub deepest_mm: f64,
    /// Layers in the order in which the needle meets them.
    pub layers: Vec<Crossed>,
    /// Table of forces.
    pub force: PathBuf,
    /// Table of displacements, and that of frames.
    pub motion: Option<MotionSpec>,
    /// Poisson's ratios of the identifications; `None`: those of the scenario.
    pub poisson: Vec<Option<f64>>,
    /// Cost function.
    pub cost: Cost,
    /// Law of the tissue; `None` if it is linear.
    pub law: Option<LawSpec>,
}

/// A layer on the needle's line.
#[derive(Clone, Debug, PartialEq)]
pub struct Crossed {
    /// Number of its region.
    pub region: i32,
    /// Name of the region.
    pub name: String,
    /// Depth along the line at which it begins, mm.
    pub begins_mm: f64,
    /// Material at the start of the search.
    pub material: Material,
    /// Whether Young's modulus is known.
    pub known: bool,
}

impl CaseFile {
    /// Reads the scenario and checks every key. `progress` receives the completed fraction of mesh generation.
    ///
    /// # Errors
    /// [`InputError`] with the key and its place in the file.
    pub fn resolve(self, folder: &Path, progress: &mut dyn FnMut(f32)) -> Result<IdentificationCase, InputError> {
        let (scenario, text) = self.scenario(folder, progress)?;
        let (entry, direction, base, deepest_mm) = self.line(&scenario)?;
        let layers = self.layers(&scenario, &entry, &direction, deepest_mm)?;
        for (index, ratio) in self.poisson.iter().enumerate() {
            if !(0.0..0.5).contains(ratio) {
                let wrong = InvalidFile::number(*ratio, "0 to below 0.5");
                return Err(self.fault(format!("poisson[{index}]"), wrong));
            }
        }
        if let Some(law) = &self.law {
            law.law(layers[0].material)
                .map_err(|error| self.fault(format!("law.{}", error.key), error))?;
        }
        let weights = self.weights.iter().flatten();
        if weights.clone().any(|weight| !(weight.is_finite() && *weight >= 0.0)) {
            let wrong = "a weight that is negative or not finite";
            return Err(self.wrong_keys("weights", wrong, "numbers of 0 or more"));
        }
        // The cost would be 0 at every modulus.
        if self.weights.is_some() && weights.sum::<f64>() <= 0.0 {
            return Err(self.wrong_keys("weights", "weights of 0 alone", "a weight above 0"));
        }
        if let Some(weights) = self
            .weights
            .as_ref()
            .filter(|weights| weights.len() != 2 * layers.len())
        {
            let count = format!("{} weights", weights.len());
            let expected = format!("{}, two for each of {} layers", 2 * layers.len(), layers.len());
            return Err(self.wrong_keys("weights", count, expected));
        }
        // The force is matched anew at every modulus: it cannot tell one from another, displacements can.
        if self.motion.is_none() && layers.iter().any(|layer| !layer.known) {
            let expected = "a table `[motion]`, or `known = true` and `young_kpa` for every layer";
            return Err(self.wrong_keys("motion", "no displacements", expected));
        }
        let poisson = if self.poisson.is_empty() {
            vec![None]
        } else {
            self.poisson.iter().copied().map(Some).collect()
        };
        let path = |path: &Path| folder.join(path);
        Ok(IdentificationCase {
            scenario,
            text,
            entry,
            direction,
            base,
            deepest_mm,
            layers,
            force: path(&self.force.file),
            motion: self.motion.as_ref().map(|motion| MotionSpec {
                file: path(&motion.file),
                frames: motion.frames.as_deref().map(path),
            }),
            poisson,
            cost: self.cost,
            law: self.law.clone().filter(|law| !matches!(law, LawSpec::Linear(_))),
            file: self,
        })
    }

    fn scenario(
        &self,
        folder: &Path,
        progress: &mut dyn FnMut(f32),
    ) -> Result<(Scenario, (String, PathBuf)), InputError> {
        let name = &self.scenario;
        let path = folder.join(name);
        let example = scenario::EXAMPLES.iter().find(|(example, _)| example == name);
        let (text, source_name, base) = match example {
            Some((example, text)) if !path.is_file() => ((*text).to_owned(), (*example).to_owned(), folder.to_owned()),
            // A bare word that is no file is a misspelt example, not a missing path.
            _ if path.extension().is_none() && !path.exists() => {
                let names: Vec<&str> = scenario::EXAMPLES.iter().map(|(name, _)| *name).collect();
                let help = nearest(name, names.iter().copied()).map(|meant| format!("did you mean \"{meant}\"?"));
                let expected = format!("one of {}, or the path of a scenario", names.join(", "));
                return Err(self
                    .fault("scenario", InvalidFile::name(name, &expected))
                    .with_help(help));
            }
            _ => {
                let text = document::read(&path)
                    .map_err(|error: InputError| error.at_key("scenario", self.source.as_ref()))?;
                let base = path.parent().unwrap_or(Path::new("")).to_owned();
                (text, path.display().to_string(), base)
            }
        };
        let scenario = ScenarioFile::parse(&text, &source_name)?.resolve(&base, progress)?;
        if !scenario.file.tissue.model.is_remeshed() {
            let wrong = "a scenario whose tissue is not of linear finite elements";
            return Err(self.wrong_keys("scenario", wrong, "`tissue.model = \"finite-element\"`"));
        }
        Ok((scenario, (text, base)))
    }

    /// Entry and direction of the needle's line, the base of the needle there, and the largest depth of its tip, mm.
    fn line(&self, scenario: &Scenario) -> Result<(Point3<f64>, Unit<Vector3<f64>>, Isometry3<f64>, f64), InputError> {
        let keys = scenario.needle_tip().keys();
        let first_pose = &keys[0].pose;
        let (start, direction) = (first_pose.position_mm(), first_pose.axial());
        let mut length = 0.0_f64;
        for key in keys {
            let offset = key.pose.position_mm() - start;
            let along_mm = offset.dot(&direction);
            let off_line_mm = (offset - direction.into_inner() * along_mm).norm();
            let turned = key.pose.axial().angle(&direction);
            if off_line_mm > MAX_OFF_LINE_MM || turned > 1e-4 {
                let bend = format!("a needle that leaves its line at {} s", key.time_s);
                return Err(self.wrong_keys("scenario", bend, "a scenario whose needle moves along its own axis"));
            }
            length = length.max(along_mm);
        }
        let point = |distance: f64| start + direction.into_inner() * distance;
        let steps = (length / STEP_MM) as usize;
        let first_inside = (0..steps).find(|step| scenario.anatomy.region(&point(*step as f64 * STEP_MM)).is_some());
        let distance = match first_inside {
            Some(0) => {
                let wrong = "a needle that begins in the tissue";
                return Err(self.wrong_keys("scenario", wrong, "a scenario whose needle begins outside"));
            }
            // The surface lies between this sample and the one before.
            Some(step) => (step as f64 - 0.5) * STEP_MM,
            None => {
                let wrong = "a needle that does not enter the tissue";
                return Err(self.wrong_keys("scenario", wrong, "a scenario whose needle goes in"));
            }
        };
        let base = Translation3::from(direction.into_inner() * distance) * scenario.needle.base(first_pose);
        Ok((point(distance), direction, base, length - distance))
    }

    /// Regions on the needle's line in the order in which it meets them, each with the depth at which it begins, mm.
    fn crossings(
        &self,
        scenario: &Scenario,
        entry: &Point3<f64>,
        direction: &Vector3<f64>,
        deepest_mm: f64,
    ) -> Result<Vec<(i32, f64)>, InputError> {
        let mut crossed: Vec<(i32, f64)> = Vec::new();
        for step in 1..=(deepest_mm / STEP_MM) as usize {
            let depth = (step as f64 - 0.5) * STEP_MM;
            let Some(region) = scenario.anatomy.region(&(entry + direction * depth)) else {
                let gap = format!("a gap in the tissue on the needle's line, {depth:.1} mm deep");
                return Err(self.wrong_keys("scenario", gap, "a line that stays in the tissue"));
            };
            if crossed.last().is_some_and(|layer| layer.0 == region) {
                continue;
            }
            // A sliver between two regions is due to the voxels: it belongs to the next.
            if crossed.last().is_some_and(|layer| depth - layer.1 < MIN_LAYER_MM) {
                crossed.pop();
            }
            if crossed.last().is_none_or(|layer| layer.0 != region) {
                crossed.push((region, if crossed.is_empty() { 0.0 } else { depth - 0.5 * STEP_MM }));
            }
        }
        Ok(crossed)
    }

    fn layers(
        &self,
        scenario: &Scenario,
        entry: &Point3<f64>,
        direction: &Vector3<f64>,
        deepest_mm: f64,
    ) -> Result<Vec<Crossed>, InputError> {
        let crossed = self.crossings(scenario, entry, direction, deepest_mm)?;
        let mut layers = Vec::new();
        for (index, (region, begins_mm)) in crossed.iter().enumerate() {
            if crossed[..index].iter().any(|(before, _)| before == region) {
                let repeated = format!("a needle that meets {} twice", scenario.region_name(*region));
                return Err(self.wrong_keys("scenario", repeated, "a region for each layer on the line"));
            }
            let Some(material) = scenario.linear_material(*region) else {
                let wrong = format!(
                    "{} on the needle's line without an element",
                    scenario.region_name(*region)
                );
                return Err(self.wrong_keys("scenario", wrong, "a finer mesh (`tissue.nodes`)"));
            };
            layers.push(Crossed {
                region: *region,
                name: scenario.region_name(*region).to_owned(),
                begins_mm: *begins_mm,
                material,
                known: false,
            });
        }
        self.apply_layer_tables(scenario, &mut layers)?;
        Ok(layers)
    }

    /// Applies the tables `[[layer]]`.
    fn apply_layer_tables(&self, scenario: &Scenario, layers: &mut [Crossed]) -> Result<(), InputError> {
        let names = scenario.region_names.iter();
        let names = Names::new(names.map(|(region, name)| (*region, i64::from(*region), vec![name.clone()])));
        let mut stated_regions = Vec::new();
        for (index, spec) in self.layer.iter().enumerate() {
            let key = |key: &str| format!("layer[{index}].{key}");
            let regions = names.find(&spec.region).map_err(|error| {
                let help = error.help();
                self.fault(key("region"), error).with_help(help)
            })?;
            let Some(layer) = layers.iter_mut().find(|layer| regions.contains(&layer.region)) else {
                let region = format!("{}, which is not on the needle's line", spec.region);
                return Err(self.wrong_keys(key("region"), region, "a layer that the needle crosses"));
            };
            if stated_regions.contains(&layer.region) {
                let repeated = format!("a second table for {}", layer.name);
                return Err(self.wrong_keys(key("region"), repeated, "one for each layer"));
            }
            stated_regions.push(layer.region);
            let young_kpa = spec.young_kpa.unwrap_or(layer.material.young_kpa());
            layer.material = Material::new(young_kpa, layer.material.poisson())
                .map_err(|error| self.fault(key(&error.key.clone()), error))?;
            layer.known = spec.known;
        }
        Ok(())
    }
}

impl IdentificationCase {
    /// Base of the needle with its tip at a depth along the line, mm; negative outside the tissue.
    pub(crate) fn base_at(&self, depth_mm: f64) -> Isometry3<f64> {
        Translation3::from(self.direction.into_inner() * depth_mm) * self.base
    }

    /// Weights of the regions of the force, two a layer.
    pub fn weights(&self) -> Vec<f64> {
        let default_weights = || (0..2 * self.layers.len()).map(|index| if index % 2 == 0 { 1.0 } else { 4.0 });
        self.file.weights.clone().unwrap_or_else(|| default_weights().collect())
    }
}
