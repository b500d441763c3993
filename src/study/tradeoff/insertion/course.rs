//! Motion of the instruments, and timing of the steps.

use std::time::Instant;

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use super::InsertionStudyError;
use crate::mechanics::insertion::finite::{Finite, Setup};
use crate::mechanics::insertion::{Instruments, Model, ProbeContact};
use crate::mechanics::mesh::TetMesh;
use crate::mechanics::needle::Needle;
use crate::mechanics::tissue::material::Material;
use crate::study::block;

/// Extent of the block of tissue, mm.
pub const EXTENT: [f64; 3] = [60.0, 60.0, 90.0];
/// Entry point of the needle, mm: off all lattice planes, beside the probe.
pub const ENTRY: [f64; 2] = [31.3, 20.9];
/// Simulated time of a step, s.
pub const STEP_S: f64 = 1e-3;
/// Travel of an instrument per step, mm: 20 mm/s.
const ADVANCE_MM: f64 = 0.02;
/// Initial depth of the tip, mm.
const START_MM: f64 = -2.0;
/// Sideways travel of the probe, towards the needle, mm.
const ASIDE_MM: f64 = 6.0;
/// Half-width of the band of nodes that the probe can touch, and its distance from the skin, mm.
const BAND_MM: [f64; 2] = [8.0, 10.0];

/// Course of an insertion: needle in, probe sideways towards it, needle out.
#[derive(Clone, Copy, Debug)]
pub struct Course {
    /// Final depth of the tip, mm.
    pub depth_mm: f64,
    /// Whether a probe is present.
    pub probe: bool,
}

/// Result of a step.
#[derive(Clone, Copy, Debug)]
pub struct Step {
    /// Minimum time over the passes, ms.
    pub ms: f64,
    /// Force on the hand, N.
    pub force_n: Vector3<f64>,
    /// Force on the probe, N.
    pub probe_n: Vector3<f64>,
    /// Tip position, mm.
    pub tip_mm: Point3<f64>,
    /// Whether a node was moved.
    pub remeshed: bool,
    /// Whether the iterations converged.
    pub converged: bool,
}

impl Course {
    /// Returns the number of steps of the insertion, and equally of the withdrawal.
    fn way(&self) -> usize {
        ((self.depth_mm - START_MM) / ADVANCE_MM).round() as usize
    }

    /// Returns the first step in which the probe moves.
    pub fn moved(&self) -> usize {
        self.way() + 1
    }

    /// Returns the number of steps of the probe's motion.
    fn aside(&self) -> usize {
        (ASIDE_MM / ADVANCE_MM).round() as usize
    }

    /// Returns the first step of the withdrawal.
    pub fn withdrawn(&self) -> usize {
        self.moved() + self.aside()
    }

    /// Returns the total number of steps.
    pub fn steps(&self) -> usize {
        self.withdrawn() + self.way()
    }

    /// Returns the poses of the instruments at a step.
    fn instruments(&self, step: usize) -> Instruments {
        let along = |steps: usize, of: usize, way: f64| way * steps.min(of) as f64 / of as f64;
        let (way, length) = (self.way(), self.depth_mm - START_MM);
        let back = along(step.saturating_sub(self.withdrawn() - 1), way, length);
        let depth = START_MM + along(step, way, length) - back;
        let aside = along(step.saturating_sub(self.moved() - 1), self.aside(), ASIDE_MM);
        Instruments {
            probe: self.probe.then(|| probe_at(aside)),
            ..block::guided([ENTRY[0], ENTRY[1], depth])
        }
    }

    /// Returns the time at the end of a step, s.
    pub fn time_s(&self, step: usize) -> f64 {
        (step + 1) as f64 * STEP_S
    }

    /// Drives the models along the course `passes` times, in turn. `told` receives the completed fraction.
    ///
    /// # Errors
    /// [`InsertionStudyError::Step`] if a step cannot be computed.
    pub fn drive(
        &self,
        models: &mut [Finite],
        passes: usize,
        mut told: impl FnMut(f64),
    ) -> Result<Vec<Vec<Step>>, InsertionStudyError> {
        let mut traces = vec![Vec::with_capacity(self.steps()); models.len()];
        let count = models.len();
        let runs = (passes * count) as f64;
        for pass in 0..passes {
            for (at, (model, trace)) in models.iter_mut().zip(&mut traces).enumerate() {
                told((pass * count + at) as f64 / runs);
                for step in 0..self.steps() {
                    let now = timed(model, &self.instruments(step))?;
                    match pass {
                        0 => trace.push(now),
                        _ => trace[step].ms = trace[step].ms.min(now.ms),
                    }
                }
            }
        }
        Ok(traces)
    }
}

/// Computes and times one step.
///
/// # Errors
/// [`InsertionStudyError::Step`] if the step cannot be computed.
pub fn timed(model: &mut dyn Model, instruments: &Instruments) -> Result<Step, InsertionStudyError> {
    let start = Instant::now();
    let outcome = model.step(instruments, STEP_S)?;
    let ms = start.elapsed().as_secs_f64() * 1e3;
    Ok(Step {
        ms,
        force_n: outcome.on_hand.force_n,
        probe_n: outcome.on_probe.map_or_else(Vector3::zeros, |wrench| wrench.force_n),
        tip_mm: outcome.tip_mm,
        remeshed: outcome.remeshes > 0,
        converged: outcome.converged,
    })
}

/// Creates the block with approximately the given number of nodes.
///
/// # Errors
/// [`InsertionStudyError`] if the mesh or the material is invalid.
pub fn tissue(nodes: usize, needle: Box<dyn Needle>) -> Result<Setup, InsertionStudyError> {
    let mesh = TetMesh::over_box([0.0; 3], EXTENT, nodes)?;
    Ok(block::on_table(mesh, Material::new(10.0, 0.45)?, block::USUAL, needle))
}

/// Creates a model with the data for remeshing along the needle's path prefetched.
///
/// # Errors
/// [`InsertionStudyError::Setup`] if the setup is invalid.
pub fn model(setup: Setup) -> Result<Finite, InsertionStudyError> {
    let mut finite = Finite::new(setup, |_, _| {})?;
    finite.prefetch(&Point3::new(ENTRY[0], ENTRY[1], 0.0), &Vector3::z(), EXTENT[2], 5.0);
    Ok(finite)
}

fn probe_at(aside: f64) -> Isometry3<f64> {
    Isometry3::from_parts(
        Translation3::new(0.5 * EXTENT[0], aside - 10.0, EXTENT[2] - 5.0),
        UnitQuaternion::identity(),
    )
}

/// Creates a probe along z under the face y = 0 that can touch every `every`-th ring of nodes along its axis.
pub fn probe(mesh: &TetMesh, every: usize) -> ProbeContact {
    let [width, from] = BAND_MM;
    let to = EXTENT[2] - 5.0;
    let in_band = |p: &[f64; 3]| p[1] == 0.0 && (p[0] - 0.5 * EXTENT[0]).abs() < width && (from..to).contains(&p[2]);
    let band = (0..).zip(mesh.nodes()).filter(|(_, p)| in_band(p));
    let mut probe = ProbeContact {
        nominal: probe_at(0.0),
        length_mm: EXTENT[2],
        candidates: band.map(|(node, _)| node).collect(),
        driven_at_mm: None,
    };
    probe.thin(mesh.nodes(), every);
    probe
}
