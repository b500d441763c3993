//! Path along which elements are finer, and the share of mislabelled tissue near it.

use nalgebra::Vector3;

use super::contents::Sampler;
use super::draft::Draft;
use super::tissue::{OUTSIDE, Tissue};
use super::{GRADING_MM, GenerateOptions, NEAR_MM, PATH_EDGE_MM};

/// Step length in the search of a segment for tissue, as a share of a voxel's edge.
const STEP: f64 = 0.5;
/// Maximum number of search steps of a segment.
const MAX_STEPS: f64 = 1e5;

/// Straight segments within tissue, in its frame, mm.
pub(super) struct Path {
    segments: Vec<[Vector3<f64>; 2]>,
    is_graded: bool,
    /// Target length of the longest edge of an element near the path, mm.
    pub edge_mm: f64,
}

impl Path {
    /// Trims each segment to its first and last points in tissue; each once, in either direction.
    pub(super) fn new(options: &GenerateOptions, nodes: usize, tissue: &Tissue) -> Self {
        let mut segments: Vec<[Vector3<f64>; 2]> = Vec::new();
        for ends in options.path {
            let [a, b] = ends.map(|end| tissue.to_frame(end));
            let steps = (b - a).norm() / (STEP * tissue.voxel_mm3.cbrt());
            let steps = steps.ceil().clamp(1.0, MAX_STEPS) as u32;
            let point = |step: u32| a + (b - a) * (f64::from(step) / f64::from(steps));
            let in_tissue = |step: &u32| tissue.class_at(point(*step).into()) != OUTSIDE;
            let Some(first) = (0..=steps).find(in_tissue) else {
                continue;
            };
            let last = (first..=steps).rev().find(in_tissue).unwrap_or(first);
            let segment = [point(first), point(last)];
            let is_known = |[a, b]: &[Vector3<f64>; 2]| *a == segment[0] && *b == segment[1];
            let reversed = |[a, b]: &[Vector3<f64>; 2]| *b == segment[0] && *a == segment[1];
            if !segments.iter().any(|other| is_known(other) || reversed(other)) {
                segments.push(segment);
            }
        }
        // The diagonal of a cell of a uniform mesh: along the path it is no coarser.
        let even = (tissue.volumes.iter().sum::<f64>() / nodes as f64).cbrt() * 3f64.sqrt();
        Path {
            is_graded: options.along_path && !segments.is_empty(),
            edge_mm: PATH_EDGE_MM.min(even),
            segments,
        }
    }

    /// Returns the permitted edge length of an element with these corners relative to that on the path: 1 or more;
    /// `None` where no path grades the mesh.
    pub(crate) fn grade(&self, corners: &[[f64; 3]; 4]) -> Option<f64> {
        let (middle, radius) = ball(corners);
        let away = || (self.distance(&middle) - radius).max(0.0);
        self.is_graded.then(|| 1.0 + away() / GRADING_MM)
    }

    /// Returns the distance of a point in the frame from the path, mm; infinite where the path meets no tissue.
    fn distance(&self, point: &Vector3<f64>) -> f64 {
        let to = |[a, b]: &[Vector3<f64>; 2]| {
            let along = b - a;
            let share = (point - a).dot(&along) / along.norm_squared();
            // NaN where the segment is a point.
            let share = if share.is_nan() { 0.0 } else { share.clamp(0.0, 1.0) };
            (point - a - share * along).norm()
        };
        self.segments.iter().map(to).fold(f64::INFINITY, f64::min)
    }

    /// Returns the volume within [`NEAR_MM`] that has the wrong region, lies outside the tissue or is missing, as a
    /// share of that of the tissue there, per cent; `None` where there is no tissue.
    pub(super) fn mislabelled_percent(&self, draft: &Draft, tissue: &Tissue, sampler: &Sampler) -> Option<f64> {
        let (mut wrong, mut all) = (0.0, 0.0);
        for element in 0..draft.elements.len() as u32 {
            let corners = draft.corners(element);
            let (middle, radius) = ball(&corners);
            if self.distance(&middle) - radius > NEAR_MM {
                continue;
            }
            let lattice = sampler.lattice(tissue, draft.contents[element as usize].volume);
            let share = draft.contents[element as usize].volume / lattice.len() as f64;
            let class = draft.classes[element as usize];
            let corners = corners.map(Vector3::from);
            for w in lattice {
                let point = w[0] * corners[0] + w[1] * corners[1] + w[2] * corners[2] + w[3] * corners[3];
                if self.distance(&point) <= NEAR_MM {
                    let true_class = tissue.class_at(point.into());
                    all += if true_class == OUTSIDE { 0.0 } else { share };
                    wrong += if true_class == class { 0.0 } else { share };
                }
            }
        }
        (all > 0.0).then(|| 100.0 * wrong / all)
    }
}

/// Returns a ball around an element: its centroid and the distance of the farthest corner.
fn ball(corners: &[[f64; 3]; 4]) -> (Vector3<f64>, f64) {
    let corners = corners.map(Vector3::from);
    let middle = corners.iter().sum::<Vector3<f64>>() / 4.0;
    let radius = corners
        .iter()
        .map(|corner| (corner - middle).norm())
        .fold(0.0, f64::max);
    (middle, radius)
}
