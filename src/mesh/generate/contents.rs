//! Contents of an element: the tissue at a regular lattice of points inside it.

use std::sync::atomic::{AtomicU64, Ordering};

use super::six_volumes;
use super::tissue::{OUTSIDE, Tissue};

/// Order of the smallest lattice: 10 points per element.
const MIN_ORDER: usize = 2;
/// Order of the largest lattice: 1,330 points per element.
const MAX_ORDER: usize = 18;
/// Work on an element in addition to its points, in points.
const WORK: u64 = 100;
/// Points per voxel volume of the element, between these bounds.
const DENSITY: f64 = 0.5;

/// Volumes of the classes in one element.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Contents {
    /// Volume of the element, mm^3.
    pub volume: f64,
    /// Classes and their volumes in it (mm^3), ascending by class, none empty.
    pub parts: Vec<(u8, f64)>,
}

impl Contents {
    /// Returns the volume of a class in the element, mm^3.
    pub(super) fn volume_of(&self, class: u8) -> f64 {
        self.parts
            .iter()
            .find(|part| part.0 == class)
            .map_or(0.0, |part| part.1)
    }

    /// Returns the volume of all tissue in the element, mm^3.
    pub(super) fn tissue(&self) -> f64 {
        self.volume - self.volume_of(OUTSIDE)
    }

    /// Returns the outside if that is half of the volume or more, else the class with the largest volume; of ties the
    /// lowest.
    pub(super) fn majority(&self) -> u8 {
        let mut best = (OUTSIDE, 0.0);
        if 2.0 * self.volume_of(OUTSIDE) < self.volume {
            for &part in self.parts.iter().filter(|part| part.0 != OUTSIDE) {
                if part.1 > best.1 {
                    best = part;
                }
            }
        }
        best.0
    }

    /// Returns the volume that is not of the majority class, mm^3.
    pub(crate) fn impurity(&self) -> f64 {
        self.volume - self.volume_of(self.majority())
    }
}

/// Sample points by order `n`: barycentric coordinates `(a + 1/4) / (n + 1)` for whole `a` that add up to `n`.
pub(super) struct Sampler {
    lattices: Vec<Vec<[f64; 4]>>,
    work: AtomicU64,
    limit: AtomicU64,
}

impl Sampler {
    pub(super) fn new() -> Self {
        let lattice = |n: usize| {
            let scale = 1.0 / (n + 1) as f64;
            let mut points = Vec::new();
            for a in 0..=n {
                for b in 0..=n - a {
                    for c in 0..=n - a - b {
                        points.push([a, b, c, n - a - b - c].map(|x| (x as f64 + 0.25) * scale));
                    }
                }
            }
            points
        };
        Sampler {
            lattices: (MIN_ORDER..=MAX_ORDER).map(lattice).collect(),
            work: AtomicU64::new(0),
            limit: AtomicU64::new(u64::MAX),
        }
    }

    /// Limits the work from here on.
    pub(super) fn limit(&self, more: u64) {
        self.limit.store(self.work().saturating_add(more), Ordering::Relaxed);
    }

    /// Returns whether the limit is reached.
    pub(crate) fn is_spent(&self) -> bool {
        self.work() >= self.limit.load(Ordering::Relaxed)
    }

    /// Returns the work so far: the number of points, and [`WORK`] for each element.
    pub(super) fn work(&self) -> u64 {
        self.work.load(Ordering::Relaxed)
    }

    /// Returns the points for an element of this volume (mm^3), in barycentric coordinates.
    pub(super) fn lattice(&self, tissue: &Tissue, volume: f64) -> &[[f64; 4]] {
        let wanted = DENSITY * volume / tissue.voxel_mm3;
        let last = &self.lattices[self.lattices.len() - 1];
        let fitting = self.lattices.iter().find(|lattice| lattice.len() as f64 >= wanted);
        fitting.unwrap_or(last)
    }

    /// Returns the contents of the element with these corners.
    pub(super) fn contents(&self, tissue: &Tissue, corners: &[[f64; 3]; 4]) -> Contents {
        let volume = six_volumes(corners).abs() / 6.0;
        let lattice = self.lattice(tissue, volume);
        self.work.fetch_add(lattice.len() as u64 + WORK, Ordering::Relaxed);
        let indices = corners.map(|corner| tissue.index_of(corner));
        let mut counts = [0u16; 256];
        for w in lattice {
            let index = [0, 1, 2].map(|axis| {
                w[0] * indices[0][axis] + w[1] * indices[1][axis] + w[2] * indices[2][axis] + w[3] * indices[3][axis]
            });
            counts[usize::from(tissue.class_at_index(index))] += 1;
        }
        let share = volume / lattice.len() as f64;
        let parts = (0..tissue.regions.len())
            .filter(|class| counts[*class] > 0)
            .map(|class| (class as u8, f64::from(counts[class]) * share))
            .collect();
        Contents { volume, parts }
    }
}
