//! Force parameters and Young's moduli of tissue layers from the force on a needle and the displacement of the tissue
//! around it in one insertion (Dehghan et al. 2008, section "Parameter identification method").
//!
//! In an inner loop the force parameters are adjusted until the simulated force has the slopes and widths of the
//! measured one; in an outer loop Nelder and Mead's method seeks the moduli whose displacements are nearest to the
//! measured ones.

mod data;
pub(super) mod force;
mod report;
mod simulate;
#[cfg(test)]
mod tests;

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicUsize, Ordering};

use nalgebra::{Point3, Vector3};
use serde::Serialize;

use crate::StudyError;
use crate::identification::{Cost, Crossed, IdentificationCase};
use crate::search::nelder_mead;
use data::{MeasuredMotion, Measurements, thinned};
pub use force::Piecewise;
use insonify::Error;
use insonify_base::{parallel, statistics};
use insonify_mechanics::tissue::law::LawSpec;
pub use simulate::LayerParameters;
use simulate::{SimulatedInsertion, Simulator};

/// Largest relative change of a force parameter at which the inner loop ends.
const SETTLED: f64 = 2e-3;
/// Most simulations in the inner loop.
const MAX_INNER: usize = 12;
/// Step of the first simplex in the logarithm of a modulus.
const LOG_STEP: f64 = 0.3;
/// Standard deviation of the cost over a simplex that ends the outer loop, of a cost that is 1 for tissue at rest.
const TOLERANCE: f64 = 5e-6;
/// Most iterations of the outer loop.
const MAX_OUTER: u64 = 40;
/// Largest factor between a modulus and the start of its search.
const MAX_MODULUS_FACTOR: f64 = 30.0;
/// Relative change of each modulus by which a minimum is tested.
const PERTURBATION: f64 = 0.05;
/// Least force density of a layer, N/mm.
const MIN_DENSITY_N_PER_MM: f64 = 1e-6;
/// Least width of the peak of a layer, mm.
const MIN_WIDTH_MM: f64 = 0.1;
/// Residual of the force in the inner loop, as a share of the largest force, above which it is reported.
const MISFIT: f64 = 0.05;
/// The same over the residual of the piecewise model, above which the measured force has what no parameter makes, and
/// its least size as a share of the largest force.
const WORSE: (f64, f64) = (3.0, 0.01);
/// Offset of a load cell that is told, as a share of the largest force.
const OFFSET: f64 = 2e-3;
/// Expected number of simulations of an identification, for the progress.
const EXPECTED_RUNS: usize = 150;

/// Identifications of one measured insertion.
#[derive(Clone, Debug, Serialize)]
pub struct Identification {
    /// Offset of the load cell, the mean force before the tissue, which is taken off, N; `None` without such a force.
    pub offset_n: Option<f64>,
    /// Drift of the load cell, its mean force after the needle is out again less the offset, which is taken off evenly over
    /// the rows, N; `None` without such forces.
    pub drift_n: Option<f64>,
    /// Piecewise-linear model of the measured force.
    pub force_model: Piecewise,
    /// Law of the tissue whose displacements are compared; `None` if it is linear.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub law: Option<LawSpec>,
    /// Result for each Poisson's ratio.
    #[serde(rename = "found")]
    pub results: Vec<Identified>,
    #[serde(skip)]
    data: Measurements,
    #[serde(skip)]
    case: IdentificationCase,
}

/// Identified parameters, and how well they reproduce the measurement.
#[derive(Clone, Debug, Serialize)]
pub struct Identified {
    /// Poisson's ratio of all layers, if the case states it.
    pub poisson: Option<f64>,
    /// Parameters of each layer.
    pub layers: Vec<LayerParameters>,
    /// Errors of the simulated force.
    pub force: ForceErrors,
    /// Errors of the simulated displacements; `None` without measured ones.
    pub motion: Option<MotionErrors>,
    /// Cost at moduli beside those found, each changed by 5 %.
    pub beside: Vec<Sensitivity>,
    /// Number of simulated insertions.
    pub insertions: usize,
    /// Limits of the result, in words.
    pub notes: Vec<String>,
    #[serde(skip)]
    course: SimulatedInsertion,
}

/// Errors of a simulated force.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct ForceErrors {
    /// Root mean square of the difference from the measured force, N.
    pub rms_n: f64,
    /// Largest difference from the measured force, N.
    pub largest_n: f64,
}

/// Errors of simulated displacements over the depth of the needle.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct MotionErrors {
    /// Cost, 1 for tissue that does not move.
    pub cost: f64,
    /// Largest magnitude of the mean error over all points at a depth, mm.
    pub largest_mean_mm: f64,
    /// Largest standard deviation of the error over all points at a depth, mm.
    pub largest_sd_mm: f64,
    /// Number of points.
    pub points: usize,
    /// Number of depths.
    pub depths: usize,
}

/// Cost with one modulus changed.
#[derive(Clone, Debug, Serialize)]
pub struct Sensitivity {
    /// Name of the region.
    pub region_name: String,
    /// Factor of its Young's modulus.
    pub factor: f64,
    /// Cost over that of the moduli found.
    pub cost_ratio: f64,
}

/// Identifies the parameters of a case. `progress` receives an estimate of the completed fraction after each
/// simulation, and may say stop.
///
/// # Errors
/// [`Error`] for tables that cannot be used, and for parameters with which no insertion can be simulated.
pub fn identify(
    case: IdentificationCase,
    progress: &(dyn Fn(f64) -> ControlFlow<()> + Sync),
) -> Result<Identification, Error> {
    let data = Measurements::read(&case)?;
    let model = data.model(&case)?;
    let runs = AtomicUsize::new(0);
    let expected = (EXPECTED_RUNS * case.poisson.len()) as f64;
    let count_run = || {
        let done = runs.fetch_add(1, Ordering::Relaxed) as f64;
        StudyError::unless_stopped(progress(done / (done + 0.5 * expected).max(expected)))
    };
    let identify = |poisson: &Option<f64>| Search::new(&case, &data, &model, *poisson, &count_run).find();
    let results = parallel::try_map(&case.poisson[..], &identify)?;
    Ok(Identification {
        offset_n: data.offset_n,
        drift_n: data.drift_n,
        force_model: model,
        law: case.law.clone(),
        results,
        data,
        case,
    })
}

/// Identifies layers with the mesh of `case` from an insertion simulated in that of `made` with the parameters of its
/// scenario: force, and displacements of `points` along directions, at every twentieth of the depth.
///
/// # Errors
/// [`Error`] as [`identify`].
pub(super) fn identify_simulated(
    truth: &IdentificationCase,
    case: &IdentificationCase,
    points: Vec<(Point3<f64>, Vector3<f64>)>,
) -> Result<Identified, Error> {
    let layers = simulated_layers(truth);
    let mut motion = MeasuredMotion {
        points,
        depths_mm: (1..=20).map(|step| truth.deepest_mm * f64::from(step) / 20.0).collect(),
        measured_mm: Vec::new(),
    };
    let course = Simulator::new(truth, Some(&motion), truth.deepest_mm).run(&layers, true)?;
    motion.measured_mm = course.moved_mm;
    let data = Measurements {
        force: thinned(&course.force),
        offset_n: Some(0.0),
        drift_n: None,
        motion: Some(motion),
    };
    let model = data.model(case)?;
    Search::new(case, &data, &model, None, &|| Ok(())).find()
}

/// Parameters that the scenario of a case states for its layers.
fn simulated_layers(truth: &IdentificationCase) -> Vec<LayerParameters> {
    let layer = |layer: &Crossed| {
        let interaction = truth.scenario.anatomy.interaction(layer.region);
        let material = truth.scenario.linear_material(layer.region).unwrap_or(layer.material);
        LayerParameters {
            region: layer.region,
            region_name: layer.name.clone(),
            young_kpa: material.young_kpa(),
            young_known: true,
            poisson: material.poisson(),
            peak_n_per_mm: interaction.peak.map_or(0.0, |peak| peak.density_n_per_mm),
            shaft_n_per_mm: interaction.friction_n_per_mm,
            width_mm: interaction.peak.map_or(MIN_WIDTH_MM, |peak| peak.width_mm),
        }
    };
    truth.layers.iter().map(layer).collect()
}

struct Search<'a> {
    case: &'a IdentificationCase,
    data: &'a Measurements,
    model: &'a Piecewise,
    poisson: Option<f64>,
    simulator: Simulator<'a>,
    weights: Vec<f64>,
    on_run: &'a (dyn Fn() -> Result<(), Error> + Sync),
    /// Largest relative change of a force parameter in the last pass of the inner loop.
    last_change: f64,
    notes: Vec<String>,
}

impl<'a> Search<'a> {
    fn new(
        case: &'a IdentificationCase,
        data: &'a Measurements,
        model: &'a Piecewise,
        poisson: Option<f64>,
        on_run: &'a (dyn Fn() -> Result<(), Error> + Sync),
    ) -> Self {
        Self {
            case,
            data,
            model,
            poisson,
            simulator: Simulator::new(case, data.motion.as_ref(), model.end_mm),
            weights: case.weights(),
            on_run,
            last_change: 0.0,
            notes: Vec::new(),
        }
    }

    /// Layers with the moduli of the start, and force parameters from slopes and widths of the measured force.
    fn start(&self) -> Vec<LayerParameters> {
        let layers = self.case.layers.iter().enumerate();
        let slope = |region: usize| self.model.slopes_n_per_mm[region].max(MIN_DENSITY_N_PER_MM);
        let layer = |(index, layer): (usize, &Crossed)| LayerParameters {
            region: layer.region,
            region_name: layer.name.clone(),
            young_kpa: layer.material.young_kpa(),
            young_known: layer.known,
            poisson: self.poisson.unwrap_or(layer.material.poisson()),
            peak_n_per_mm: slope(2 * index),
            shaft_n_per_mm: slope(2 * index + 1),
            width_mm: self.model.width(2 * index).max(MIN_WIDTH_MM),
        };
        layers.map(layer).collect()
    }

    fn simulate(&mut self, layers: &[LayerParameters], observed: bool) -> Result<SimulatedInsertion, Error> {
        (self.on_run)()?;
        self.simulator.run(layers, observed)
    }

    /// Adjusts the force parameters until the simulated force has the slopes and widths of the measured one; of all
    /// simulations the nearest to its model counts. The last one also has the displacements.
    fn match_forces(&mut self, layers: &mut Vec<LayerParameters>) -> Result<SimulatedInsertion, Error> {
        let mut best = (f64::INFINITY, layers.clone());
        for _ in 0..MAX_INNER {
            let course = self.simulate(layers, false)?;
            let error = |point: &[f64; 2]| (self.model.at(point[0]) - point[1]).powi(2);
            let squares: f64 = course.force.iter().map(error).sum();
            if squares < best.0 {
                best = (squares, layers.clone());
            }
            let Some(simulated) = self.model.refined(&thinned(&course.force)) else {
                break;
            };
            self.last_change = self.adjust(layers, &simulated);
            if self.last_change < SETTLED {
                break;
            }
        }
        layers.clone_from(&best.1);
        self.simulate(layers, true)
    }

    /// Adjusts the force parameters by what a simulated force lacks. Returns the largest relative change.
    fn adjust(&self, layers: &mut [LayerParameters], simulated: &Piecewise) -> f64 {
        let mut change = 0.0_f64;
        for (index, layer) in layers.iter_mut().enumerate() {
            // A density adds all but itself to a slope. Ratios of slopes would not settle where the slope of region 3
            // lacks the peak that the tip leaves behind in the layer before.
            let lack = |region: usize| self.model.slopes_n_per_mm[region] - simulated.slopes_n_per_mm[region];
            let ratio = self.model.width(2 * index) / simulated.width(2 * index).max(MIN_WIDTH_MM);
            for (parameter, new) in [
                (&mut layer.peak_n_per_mm, lack(2 * index)),
                (&mut layer.shaft_n_per_mm, lack(2 * index + 1)),
            ]
            .map(|(parameter, lack)| {
                let new = (*parameter + lack).max(MIN_DENSITY_N_PER_MM);
                (parameter, new)
            }) {
                change = change.max((new / *parameter - 1.0).abs());
                *parameter = new;
            }
            let width = (layer.width_mm * ratio.clamp(0.5, 2.0)).max(MIN_WIDTH_MM);
            change = change.max((width / layer.width_mm - 1.0).abs());
            layer.width_mm = width;
        }
        change
    }

    fn find(mut self) -> Result<Identified, Error> {
        let (data, mut layers) = (self.data, self.start());
        let unknown: Vec<usize> = (0..layers.len()).filter(|index| !layers[*index].young_known).collect();
        if let (Some(motion), false) = (&data.motion, unknown.is_empty()) {
            self.seek_moduli(motion, &mut layers, &unknown)?;
        }
        let course = self.match_forces(&mut layers)?;
        let sensitivities = match &data.motion {
            Some(motion) => self.sensitivities(motion, &layers, &unknown, self.cost(motion, &course))?,
            None => Vec::new(),
        };
        Ok(self.conclude(layers, course, sensitivities))
    }

    /// The outer loop: sets the moduli of the `unknown` layers to those whose displacements are nearest to the measured
    /// ones.
    fn seek_moduli(
        &mut self,
        motion: &MeasuredMotion,
        layers: &mut Vec<LayerParameters>,
        unknown: &[usize],
    ) -> Result<(), Error> {
        // Logarithms keep moduli positive and their steps relative.
        let start: Vec<f64> = unknown.iter().map(|index| layers[*index].young_kpa.ln()).collect();
        let limit = MAX_MODULUS_FACTOR.ln();
        let set_young = |layers: &mut [LayerParameters], logs: &[f64]| {
            let pairs = unknown.iter().zip(logs);
            pairs.for_each(|(index, log)| layers[*index].young_kpa = log.exp());
        };
        self.match_forces(layers)?;
        let mut trial = layers.clone();
        let cost = |logs: &[f64]| {
            let excess = logs.iter().zip(&start);
            let excess: f64 = excess.map(|(log, start)| ((log - start).abs() - limit).max(0.0)).sum();
            // A slope above every cost (which is 1 for tissue at rest) leads back without a simulation.
            if excess > 0.0 {
                return Ok(1e3 * (1.0 + excess));
            }
            // Every evaluation starts from the same forces, so that the cost is a function of the moduli alone.
            trial.clone_from(layers);
            set_young(&mut trial, logs);
            let course = self.match_forces(&mut trial)?;
            Ok::<f64, Error>(self.cost(motion, &course))
        };
        let minimum = nelder_mead(&start, &vec![LOG_STEP; start.len()], TOLERANCE, MAX_OUTER, cost)?;
        set_young(layers, &minimum.point);
        let mut pairs = minimum.point.iter().zip(&start);
        if pairs.any(|(log, start)| (log - start).abs() > 0.98 * limit) {
            self.notes.push(format!(
                "a modulus reached the limit of the search, a factor of {MAX_MODULUS_FACTOR} from its starting value: no minimum was found"
            ));
        }
        Ok(())
    }

    /// Cost with each unknown modulus changed to both sides, over the `least`.
    fn sensitivities(
        &mut self,
        motion: &MeasuredMotion,
        layers: &[LayerParameters],
        unknown: &[usize],
        least: f64,
    ) -> Result<Vec<Sensitivity>, Error> {
        let mut sensitivities = Vec::new();
        for index in unknown {
            for factor in [1.0 - PERTURBATION, 1.0 + PERTURBATION] {
                let mut changed = layers.to_vec();
                changed[*index].young_kpa *= factor;
                let course = self.match_forces(&mut changed)?;
                sensitivities.push(Sensitivity {
                    region_name: changed[*index].region_name.clone(),
                    factor,
                    cost_ratio: self.cost(motion, &course) / least,
                });
            }
        }
        Ok(sensitivities)
    }

    fn conclude(
        mut self,
        layers: Vec<LayerParameters>,
        course: SimulatedInsertion,
        sensitivities: Vec<Sensitivity>,
    ) -> Identified {
        let force = force_errors(&course, &self.data.force);
        let largest = self.data.force.iter().map(|point| point[1]).fold(0.0, f64::max);
        if force.rms_n > MISFIT * largest {
            self.notes.push(format!(
                "the simulated force differs from the measured one by {:.1} % of its largest value (root mean square): this law of force does not fit",
                100.0 * force.rms_n / largest
            ));
        }
        match self.data.offset_n {
            None => self.notes.push(
                "no force before the tissue (5 rows, 0.5 mm and more): an offset of the load cell is not known, and would change widths and densities"
                    .to_owned(),
            ),
            Some(offset) if offset.abs() > OFFSET * largest => self.notes.push(format!(
                "the load cell reads {offset:.4} N before the tissue: this offset was taken off"
            )),
            Some(_) => {}
        }
        if let Some(drift) = self.data.drift_n.filter(|drift| drift.abs() > OFFSET * largest) {
            self.notes.push(format!(
                "the load cell reads {drift:.4} N more after the needle is out again than before the tissue: this drift was taken off, evenly over \
                 the rows"
            ));
        }
        if force.rms_n > (WORSE.0 * self.model.rms_n).max(WORSE.1 * largest) {
            self.notes.push(format!(
                "the simulated force is off by {:.3} N, the piecewise model of the measured one by {:.3} N (root mean square): an offset, a drift or \
                 a shift of depth would do that",
                force.rms_n, self.model.rms_n
            ));
        }
        if self.last_change >= SETTLED {
            self.notes.push(format!(
                "the force parameters did not settle: the last of {MAX_INNER} simulations changed one by {:.1} %",
                100.0 * self.last_change
            ));
        }
        // A neighbour that costs no more shows that the search ended somewhere else than at a minimum.
        for sensitivity in sensitivities.iter().filter(|sensitivity| sensitivity.cost_ratio <= 1.0) {
            self.notes.push(format!(
                "no minimum: the cost falls where Young's modulus of {} changes by {:+.0} %",
                sensitivity.region_name,
                100.0 * (sensitivity.factor - 1.0)
            ));
        }
        if course.unsettled > 0 {
            self.notes.push(format!(
                "{} steps of the simulated insertion did not converge",
                course.unsettled
            ));
        }
        Identified {
            poisson: self.poisson,
            layers,
            force,
            motion: self
                .data
                .motion
                .as_ref()
                .map(|motion| self.motion_errors(motion, &course)),
            beside: sensitivities,
            insertions: self.simulator.runs,
            notes: self.notes,
            course,
        }
    }

    /// Weighted squares of the errors over those of the displacements (Dehghan et al. 2008, equation 1, as its text
    /// describes it).
    fn cost(&self, motion: &MeasuredMotion, course: &SimulatedInsertion) -> f64 {
        let (mut errors, mut sizes) = (0.0, 0.0);
        for ((depth, simulated), measured) in motion.depths_mm.iter().zip(&course.moved_mm).zip(&motion.measured_mm) {
            let weight = self.weights[self.model.region(*depth)];
            let pairs = || {
                let pairs = simulated.iter().zip(measured);
                pairs.filter(|(simulated, measured)| simulated.is_finite() && measured.is_finite())
            };
            let [error, size] = match self.case.cost {
                Cost::Points => pairs().fold([0.0; 2], |[error, size], (simulated, measured)| {
                    [error + (simulated - measured).powi(2), size + measured * measured]
                }),
                // Means first, then squares: errors of single points cancel, and only the motion of the depth as a
                // whole counts.
                Cost::Mean => {
                    let count = pairs().count().max(1) as f64;
                    let mean = pairs().fold([0.0; 2], |[error, size], (simulated, measured)| {
                        [error + (simulated - measured) / count, size + measured / count]
                    });
                    mean.map(|mean| mean * mean)
                }
            };
            errors += weight * error;
            sizes += weight * size;
        }
        errors / sizes.max(f64::MIN_POSITIVE)
    }

    fn motion_errors(&self, motion: &MeasuredMotion, course: &SimulatedInsertion) -> MotionErrors {
        let by_depth = errors_by_depth(motion, course);
        let largest = |error: fn(&[f64; 3]) -> f64| by_depth.iter().map(error).fold(0.0, f64::max);
        MotionErrors {
            cost: self.cost(motion, course),
            largest_mean_mm: largest(|row| row[1].abs()),
            largest_sd_mm: largest(|row| row[2]),
            points: motion.points.len(),
            depths: motion.depths_mm.len(),
        }
    }
}

/// Depth of the tip, and mean and standard deviation of the error over all points there, mm.
fn errors_by_depth(motion: &MeasuredMotion, course: &SimulatedInsertion) -> Vec<[f64; 3]> {
    let rows = motion.depths_mm.iter().zip(&course.moved_mm).zip(&motion.measured_mm);
    let row = |((depth, simulated), measured): ((&f64, &Vec<f64>), &Vec<f64>)| {
        let errors = simulated
            .iter()
            .zip(measured)
            .map(|(simulated, measured)| simulated - measured);
        let errors: Vec<f64> = errors.filter(|error| error.is_finite()).collect();
        (!errors.is_empty()).then(|| [*depth, statistics::mean(&errors), statistics::std(&errors)])
    };
    rows.filter_map(row).collect()
}

fn force_errors(course: &SimulatedInsertion, measured: &[[f64; 2]]) -> ForceErrors {
    let error = |point: &[f64; 2]| (force_at(course, point[0]) - point[1]).abs();
    let squares: f64 = measured.iter().map(|point| error(point).powi(2)).sum();
    ForceErrors {
        rms_n: (squares / measured.len().max(1) as f64).sqrt(),
        largest_n: measured.iter().map(error).fold(0.0, f64::max),
    }
}

/// Simulated force at a depth (mm), N: linear between steps, 0 at the surface.
fn force_at(course: &SimulatedInsertion, depth: f64) -> f64 {
    let after = course.force.partition_point(|point| point[0] < depth);
    let [end, force] = course.force[after.min(course.force.len() - 1)];
    let [start, before] = after.checked_sub(1).map_or([0.0; 2], |row| course.force[row]);
    if end <= start {
        return force;
    }
    before + (force - before) * ((depth - start) / (end - start)).clamp(0.0, 1.0)
}
