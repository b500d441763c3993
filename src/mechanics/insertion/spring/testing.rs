//! Needles, bodies and motions for the tests.

use nalgebra::{Isometry3, Point3, Translation3};

use super::{Anatomy, MassSpring, MassSpringParameters};
use crate::insertion::{Instruments, Interaction, Model, Outcome};
use crate::needle::{CentreLine, Entry, Load, Needle, Row};

/// A rigid needle.
#[derive(Debug)]
pub(crate) struct Stiff(pub f64);

impl Needle for Stiff {
    fn length_mm(&self) -> f64 {
        self.0
    }

    fn radius_mm(&self) -> f64 {
        0.64
    }

    fn is_flexible(&self) -> bool {
        false
    }

    fn place(&mut self, base: &Isometry3<f64>, _: Option<&Entry>, _: &[Load], _: &[Load], line: &mut CentreLine) {
        let point = |z: f64| base * Point3::new(0.0, 0.0, z);
        line.set([(0.0, point(0.0)), (self.0, point(self.0))]);
    }

    fn linearise(&mut self, _: &CentreLine, _: &[Load], _: &[Row], _: &mut [f64], _: &mut [f64]) -> usize {
        0
    }
}

/// A needle that bends like a clamped beam, for small deflections, in closed form.
#[derive(Debug)]
pub(super) struct Beam {
    pub length_mm: f64,
    /// Bending stiffness, N mm^2.
    pub ei: f64,
}

impl Beam {
    /// Returns the deflection (mm/N) at one arc under a unit force at another.
    fn yielding(&self, arc_mm: f64, load_arc_mm: f64) -> f64 {
        let (near, far) = (arc_mm.min(load_arc_mm), arc_mm.max(load_arc_mm));
        near * near * (3.0 * far - near) / (6.0 * self.ei)
    }
}

impl Needle for Beam {
    fn length_mm(&self) -> f64 {
        self.length_mm
    }

    fn radius_mm(&self) -> f64 {
        0.64
    }

    fn is_flexible(&self) -> bool {
        true
    }

    fn place(&mut self, base: &Isometry3<f64>, _: Option<&Entry>, _: &[Load], loads: &[Load], line: &mut CentreLine) {
        let direction = base * nalgebra::Vector3::z();
        line.set((0..=30).map(|node| {
            let arc = self.length_mm * node as f64 / 30.0;
            let mut point = base * Point3::new(0.0, 0.0, arc);
            for load in loads {
                let across = load.force_n - direction * direction.dot(&load.force_n);
                point += across * self.yielding(arc, load.arc_mm);
            }
            (arc, point)
        }));
    }

    fn linearise(&mut self, _: &CentreLine, _: &[Load], rows: &[Row], drift: &mut [f64], out: &mut [f64]) -> usize {
        drift.fill(0.0);
        for (i, a) in rows.iter().enumerate() {
            for (j, b) in rows.iter().enumerate() {
                out[j * rows.len() + i] += a.direction.dot(&b.direction) * self.yielding(a.arc_mm, b.arc_mm);
            }
        }
        0
    }
}

/// A layered body below z = 0: region i from `at[i]` (mm) on.
#[derive(Clone, Debug)]
pub(super) struct Layers {
    pub starts_mm: Vec<f64>,
    pub interactions: Vec<Interaction>,
}

impl Layers {
    pub(super) fn one(interaction: Interaction) -> Layers {
        Layers {
            starts_mm: vec![0.0],
            interactions: vec![interaction],
        }
    }
}

impl Anatomy for Layers {
    fn region(&self, point_mm: &Point3<f64>) -> Option<i32> {
        let above = self.starts_mm.iter().filter(|&&start| start <= point_mm.z).count();
        above.checked_sub(1).map(|region| region as i32)
    }

    fn interaction(&self, region: i32) -> Interaction {
        self.interactions[region as usize]
    }
}

/// Returns the interaction of typical soft tissue.
pub(super) fn soft() -> Interaction {
    Interaction {
        friction_n_per_mm: 0.01,
        cutting_n: 0.5,
        ..Interaction::default()
    }
}

/// Returns a coarse cylinder: 20 mm around a path of 100 mm, nodes every 6.7 mm.
pub(super) fn coarse() -> MassSpringParameters {
    MassSpringParameters {
        radius_mm: 20.0,
        rings: 3,
        layers: Some(15),
        ..MassSpringParameters::default()
    }
}

/// Returns a model with a needle of 150 mm.
pub(super) fn model(parameters: MassSpringParameters, anatomy: Layers) -> MassSpring {
    MassSpring::new(parameters, Box::new(anatomy), Box::new(Stiff(150.0))).unwrap()
}

/// Returns the instruments for a tip position of a needle of 150 mm along z.
pub(super) fn tip_at(x: f64, y: f64, z: f64) -> Instruments {
    Instruments {
        base: Translation3::new(x, y, z - 150.0).into(),
        probe: None,
        guide: None,
        deposit: false,
    }
}

/// Moves the tip along z from one depth to another at a speed (mm/s) in steps of `dt_s`, passing each outcome to
/// `tell`.
pub(super) fn drive(
    model: &mut MassSpring,
    [from, to]: [f64; 2],
    speed: f64,
    dt_s: f64,
    mut tell: impl FnMut(&Outcome),
) {
    let steps = ((to - from).abs() / (speed * dt_s)).round() as usize;
    for step in 1..=steps {
        let z = from + (to - from) * step as f64 / steps as f64;
        tell(model.step(&tip_at(0.3, 0.2, z), dt_s).unwrap());
    }
}
