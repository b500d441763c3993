//! Pieces of the needle's path for prefetching, and the note about the mesh along it.

use nalgebra::Point3;

use crate::mechanics::mesh::generate::{GenerateReport, NEAR_MM};
use crate::tracking::trajectory::Trajectory;

/// Minimum length of a piece of the path, mm: shorter ones are merged.
const PIECE_MM: f64 = 2.0;

/// Straight pieces of the tip's path, mm.
pub(super) fn pieces(tip: &Trajectory) -> Vec<[Point3<f64>; 2]> {
    let mut places = tip.keys().iter().map(|key| key.pose.position_mm());
    let Some(mut from) = places.next() else {
        return Vec::new();
    };
    let mut pieces = Vec::new();
    for to in places {
        if (to - from).norm() >= PIECE_MM {
            pieces.push([from, to]);
            from = to;
        }
    }
    pieces
}

/// Note about a generated mesh.
pub(super) fn in_words(report: &GenerateReport, along_path: bool) -> String {
    let GenerateReport { nodes, elements, .. } = report;
    let all = report.mislabelled_percent;
    let finer = if along_path {
        "finer along the needle's path"
    } else {
        "no finer along the needle's path"
    };
    match report.near_mislabelled_percent {
        None => format!(
            "mesh: {nodes} nodes, {elements} tetrahedra; {all:.0} % of the tissue lie in elements of another region"
        ),
        Some(near) => format!(
            "mesh: {nodes} nodes, {elements} tetrahedra, {finer}; {near:.0} % of the tissue within {NEAR_MM} mm of the path and \
             {all:.0} % of all tissue lie in elements of another region"
        ),
    }
}
