//! Tissue models of both kinds and needle motions shared by the contact cases.

use nalgebra::{Point3, Vector3};

use crate::mechanics::insertion::finite::{Finite, Setup};
use crate::mechanics::insertion::spring::{MassSpring, Parameters};
use crate::mechanics::insertion::{Anatomy, EventKind, Interaction, Model, Outcome, Snapshot, Tissue};
use crate::mechanics::tissue::material::Material;
use crate::study::block;
use crate::study::stability::record::{Record, Unexpected, largest};

/// Extent of the tissue block, mm.
pub const EXTENT: [f64; 3] = [60.0, 60.0, 80.0];
/// Edge length of the block's cells, mm.
pub const CELL_MM: f64 = 10.0;
/// Entry point of the needle, mm: off all planes between cells.
pub const ASIDE: [f64; 2] = [31.3, 28.9];
/// Simulated time of a step where it does not matter, s.
pub const STEP_S: f64 = 1e-3;

/// Returns a setup with a block of 60 x 60 x 80 mm at 10 kPa and a rigid needle.
pub fn tissue(interaction: Interaction) -> Result<Setup, Unexpected> {
    let mesh = block::plain(EXTENT, CELL_MM)?;
    Ok(block::on_table(
        mesh,
        Material::new(10.0, 0.45)?,
        interaction,
        block::rigid()?,
    ))
}

/// Creates the finite-element model of a setup.
pub fn build(setup: Setup) -> Result<Finite, Unexpected> {
    Ok(Finite::new(setup, |_, _| {})?)
}

/// Region 0 from z = 0 on and region 1 from `border` on.
#[derive(Debug)]
pub struct Layers {
    pub border: f64,
    pub of: [Interaction; 2],
}

impl Anatomy for Layers {
    fn region(&self, point_mm: &Point3<f64>) -> Option<i32> {
        (point_mm.z >= 0.0).then_some(i32::from(point_mm.z >= self.border))
    }

    fn interaction(&self, region: i32) -> Interaction {
        self.of[usize::from(region == 1)]
    }
}

/// Returns parameters for a cylinder of 20 mm about a path of 100 mm, with nodes every 6.7 mm and a rigid needle.
pub fn coarse() -> Parameters {
    Parameters {
        radius_mm: 20.0,
        rings: 3,
        layers: 15,
        ..Parameters::default()
    }
}

/// Creates the mass-spring model of a uniform tissue.
pub fn springs(parameters: Parameters, interaction: Interaction) -> Result<MassSpring, Unexpected> {
    let layers = Layers {
        border: f64::INFINITY,
        of: [interaction; 2],
    };
    Ok(MassSpring::new(parameters, Box::new(layers), block::rigid()?)?)
}

/// Steps a rigid needle to a depth.
pub fn go(model: &mut dyn Model, z: f64) -> Result<&Outcome, Unexpected> {
    Ok(model.step(&block::tip_at([ASIDE[0], ASIDE[1], z]), STEP_S)?)
}

/// Steps the needle from one depth to another, ending exactly there.
pub fn travel(
    model: &mut dyn Model,
    [from, to]: [f64; 2],
    step_mm: f64,
    mut tell: impl FnMut(&Outcome),
) -> Result<(), Unexpected> {
    let steps = ((to - from).abs() / step_mm).ceil() as usize;
    for step in 1..=steps {
        tell(go(model, from + (to - from) * step as f64 / steps as f64)?);
    }
    Ok(())
}

/// Returns the force that pushes the needle back out, N.
pub fn resistance(outcome: &Outcome) -> f64 {
    -outcome.on_hand.force_n.z
}

/// Counts of steps with errors in a run.
#[derive(Clone, Copy, Debug, Default)]
pub struct Watch {
    /// Number of steps with a value that is not finite.
    pub broken: usize,
    /// Number of steps that did not converge.
    pub unsettled: usize,
    /// Number of steps that did not converge without reporting an event.
    pub untold: usize,
}

impl Watch {
    /// Checks a step.
    pub fn see(&mut self, outcome: &Outcome) {
        let wrenches = std::iter::once(&outcome.on_hand).chain(&outcome.on_probe);
        let numbers = wrenches.flat_map(|wrench| wrench.force_n.iter().chain(wrench.torque_nmm.iter()));
        let others = [outcome.tip_deflection_mm, outcome.inserted_mm];
        let finite = numbers
            .chain(outcome.tip_mm.iter())
            .chain(&others)
            .all(|x| x.is_finite());
        let told = outcome.events.iter().any(|event| event.kind == EventKind::NotConverged);
        self.broken += usize::from(!finite);
        self.unsettled += usize::from(!outcome.converged);
        self.untold += usize::from(!outcome.converged && !told);
    }

    /// Records the counts.
    pub fn write(&self, record: &mut Record<'_>, of: &str) {
        record.zero(format!("steps with numbers that are none, {of}"), self.broken as f64);
        record.zero(
            format!("steps not converged and not reported, {of}"),
            self.untold as f64,
        );
        record.report(format!("steps not converged, {of}"), self.unsettled as f64);
    }
}

/// Returns the tissue as used for image synthesis.
pub fn image(model: &mut dyn Model) -> Tissue {
    let (mut snapshot, mut tissue) = (Snapshot::default(), Tissue::default());
    model.snapshot(&mut snapshot);
    model.imager().tissue(&snapshot, &mut tissue);
    tissue
}

/// Returns the largest displacement, mm; NaN if any is NaN.
pub fn displaced(tissue: &Tissue) -> f64 {
    let pairs = tissue.current.iter().zip(&tissue.reference);
    largest(pairs.map(|(to, from)| (Vector3::from(*to) - Vector3::from(*from)).norm()))
}
