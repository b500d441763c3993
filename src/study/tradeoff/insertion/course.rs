//! What the hands do, and the clock on each step.

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
/// Where the needle goes in: through no plane of the lattice, beside the probe.
pub const ENTRY: [f64; 2] = [31.3, 20.9];
/// Simulated time of a step, s.
pub const STEP_S: f64 = 1e-3;
/// How far an instrument goes in a step, mm: 20 mm/s.
const ADVANCE_MM: f64 = 0.02;
/// Where the tip begins, mm.
const START_MM: f64 = -2.0;
/// How far the probe is moved sideways, towards the needle, mm.
const ASIDE_MM: f64 = 6.0;
/// Half the width of the band of nodes that the probe can touch, mm, and how far from the skin it begins.
const BAND_MM: [f64; 2] = [8.0, 10.0];

/// Needle in, the probe sideways towards it, needle out.
#[derive(Clone, Copy, Debug)]
pub struct Course {
    /// How deep the tip goes, mm.
    pub depth_mm: f64,
    /// Whether there is a probe.
    pub probe: bool,
}

/// What a step came to.
#[derive(Clone, Copy, Debug)]
pub struct Step {
    /// The least time that it took, ms.
    pub ms: f64,
    /// On the hand, N.
    pub force_n: Vector3<f64>,
    /// On the probe, N.
    pub probe_n: Vector3<f64>,
    /// The tip, mm.
    pub tip_mm: Point3<f64>,
    /// Whether a node was moved.
    pub remeshed: bool,
    /// Whether its iterations ended.
    pub converged: bool,
}

impl Course {
    /// Steps of the needle's way in, or out.
    fn way(&self) -> usize {
        ((self.depth_mm - START_MM) / ADVANCE_MM).round() as usize
    }

    /// The first step in which the probe moves.
    pub fn moved(&self) -> usize {
        self.way() + 1
    }

    /// Steps of the probe's way.
    fn aside(&self) -> usize {
        (ASIDE_MM / ADVANCE_MM).round() as usize
    }

    /// The first step in which the needle goes back.
    pub fn withdrawn(&self) -> usize {
        self.moved() + self.aside()
    }

    /// All of it.
    pub fn steps(&self) -> usize {
        self.withdrawn() + self.way()
    }

    /// Where the instruments are.
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

    /// Time at the end of a step, s.
    pub fn time_s(&self, step: usize) -> f64 {
        (step + 1) as f64 * STEP_S
    }

    /// Drives models along the course `passes` times, one after the other. `told` hears of the share that is done.
    ///
    /// # Errors
    /// [`InsertionStudyError::Step`].
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

/// One step by the clock.
///
/// # Errors
/// [`InsertionStudyError::Step`].
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

/// The block, with about so many nodes.
///
/// # Errors
/// [`InsertionStudyError`].
pub fn tissue(nodes: usize, needle: Box<dyn Needle>) -> Result<Setup, InsertionStudyError> {
    let mesh = TetMesh::over_box([0.0; 3], EXTENT, nodes)?;
    Ok(block::on_table(mesh, Material::new(10.0, 0.45)?, block::USUAL, needle))
}

/// A model that has read ahead what remeshing along the needle's way will read.
///
/// # Errors
/// [`InsertionStudyError::Setup`].
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

/// A probe along z under the face y = 0, which can touch every `every`-th ring of nodes along its axis.
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
