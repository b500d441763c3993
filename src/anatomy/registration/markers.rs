//! Markers in a volume of grey values: bright bodies by threshold, and their registration to a design of which some may
//! be missing.
//!
//! Wang et al. 2023 (section II-D) repeat the iterative closest point method from random rotations until markers and
//! design match one to one. Here every triangle of markers is tried on every triangle of the design with the same
//! sides, so that the result does not depend on chance: the rigid transform (Kabsch) that brings most markers within a
//! tolerance wins.

use nalgebra::{Isometry3, Matrix4, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::{Landmark, kabsch};
use crate::volume::{ScalarImage, VolumeError};

/// Maximum share of the voxels of a volume in bright bodies: more is a threshold within the tissue.
const MAX_BRIGHT: f64 = 0.02;
/// Maximum number of markers found that are matched.
const MAX_FOUND: usize = 60;
/// Distance of a marker from its place in the design up to which it counts, mm.
pub const TOLERANCE_MM: f64 = 1.0;
/// Minimum number of markers that must match.
const MIN_MATCHED: usize = 4;
/// Angle (rad) between two placements of the design that are different.
const DIFFERENT: f64 = 0.1;

/// A connected set of bright voxels.
#[derive(Clone, Debug, PartialEq)]
pub struct BrightBody {
    /// Centres of its voxels, world, mm.
    pub voxels_mm: Vec<Point3<f64>>,
    /// Mean of these.
    pub centre_mm: Point3<f64>,
    /// Diameter of a sphere of its volume, mm.
    pub diameter_mm: f64,
}

/// Placement of a design.
#[derive(Clone, Debug, PartialEq)]
pub struct Placement {
    /// Transform from the design to the world, mm.
    pub pose: Isometry3<f64>,
    /// Marker found for each marker of the design.
    pub matched: Vec<Option<usize>>,
    /// Root mean square of the distances of matched markers from their places, mm.
    pub rms_mm: f64,
}

impl Placement {
    /// Number of matched markers.
    pub fn count(&self) -> usize {
        self.matched.iter().flatten().count()
    }
}

/// Finds the connected sets of voxels (by faces, edges and corners) of at least a grey value, in the order of their
/// first voxels.
///
/// # Errors
/// [`VolumeError`] if so much is bright that the threshold lies within the tissue.
pub fn bodies(image: &ScalarImage, threshold: f32) -> Result<Vec<BrightBody>, VolumeError> {
    let bright = |voxel: &usize| image.data[*voxel] >= threshold;
    let bright: Vec<usize> = (0..image.data.len()).filter(bright).collect();
    let share = bright.len() as f64 / image.data.len().max(1) as f64;
    if share > MAX_BRIGHT {
        let percent = 100.0 * share;
        return Err(VolumeError::new(format!(
            "{percent:.1} % of the voxels reach the threshold of {threshold}: found more than metal; expected at most {} %, so a \
             higher threshold",
            100.0 * MAX_BRIGHT
        )));
    }
    let [columns, rows, slices] = image.size;
    let mut seen = vec![false; bright.len()];
    let voxel_mm3 = image.index_to_world.fixed_view::<3, 3>(0, 0).determinant().abs();
    let mut bodies = Vec::new();
    for start in 0..bright.len() {
        if std::mem::replace(&mut seen[start], true) {
            continue;
        }
        let (mut open, mut voxels_mm) = (vec![start], Vec::new());
        while let Some(member) = open.pop() {
            let flat = bright[member];
            let index = [flat % columns, flat / columns % rows, flat / columns / rows];
            let position = Point3::from(index.map(|i| i as f64));
            voxels_mm.push(image.index_to_world.transform_point(&position));
            let near = |i: usize, count: usize| i.saturating_sub(1)..(i + 2).min(count);
            for z in near(index[2], slices) {
                for y in near(index[1], rows) {
                    for x in near(index[0], columns) {
                        // Bright voxels are few and ascending: a search needs no mask of the volume.
                        let Ok(next) = bright.binary_search(&((z * rows + y) * columns + x)) else {
                            continue;
                        };
                        if !std::mem::replace(&mut seen[next], true) {
                            open.push(next);
                        }
                    }
                }
            }
        }
        let sum: Vector3<f64> = voxels_mm.iter().map(|voxel| voxel.coords).sum();
        let volume = voxel_mm3 * voxels_mm.len() as f64;
        bodies.push(BrightBody {
            centre_mm: Point3::from(sum / voxels_mm.len() as f64),
            diameter_mm: (6.0 * volume / std::f64::consts::PI).cbrt(),
            voxels_mm,
        });
    }
    Ok(bodies)
}

/// Registers a design (mm) to the markers found (world, mm). Markers may be missing, and others found.
///
/// # Errors
/// [`VolumeError`] if fewer than four markers, or not more than half of the design, match one to one, or if the design
/// fits in more than one way.
pub fn place(design: &[Point3<f64>], markers: &[Point3<f64>]) -> Result<Placement, VolumeError> {
    let needed = MIN_MATCHED.max(design.len() / 2 + 1);
    let few = |count: usize| {
        let total = design.len();
        let (seen, limit) = (markers.len(), TOLERANCE_MM);
        VolumeError::new(format!(
            "{count} of {total} markers match the design within {limit} mm, of {seen} found of their size; expected at least {needed}"
        ))
    };
    if markers.len() < needed || markers.len() > MAX_FOUND {
        return Err(few(0));
    }
    let mut best: Vec<Placement> = Vec::new();
    for triangle in triangles(design, markers) {
        let Some(placement) = settled(design, markers, &triangle) else {
            continue;
        };
        let count = best.first().map_or(0, Placement::count);
        if placement.count() > count {
            best.clear();
        }
        // Many triangles settle on the same assignment; only different ones can make the placement ambiguous.
        if placement.count() >= count && !best.iter().any(|other| other.matched == placement.matched) {
            best.push(placement);
        }
    }
    best.sort_by(|a, b| a.rms_mm.total_cmp(&b.rms_mm));
    let Some(first) = best.first().filter(|first| first.count() >= needed) else {
        return Err(few(best.first().map_or(0, Placement::count)));
    };
    // As many matches in another orientation, with an error not clearly larger: noise would decide.
    let turned = |other: &Placement| first.pose.rotation.angle_to(&other.pose.rotation) > DIFFERENT;
    let other = best
        .iter()
        .find(|other| turned(other) && other.rms_mm < 0.5 * (first.rms_mm + TOLERANCE_MM));
    match other {
        None => Ok(first.clone()),
        Some(other) => Err(VolumeError::new(format!(
            "{} markers match the design in two ways, by {:.2} and {:.2} mm: expected a design without symmetry",
            first.count(),
            first.rms_mm,
            other.rms_mm
        ))),
    }
}

/// Pairs of markers (design, found) whose triangles have the same sides within twice the tolerance.
fn triangles(design: &[Point3<f64>], markers: &[Point3<f64>]) -> Vec<[(usize, usize); 3]> {
    let same = |a: (usize, usize), b: (usize, usize)| {
        let lengths = [(design[a.0] - design[b.0]).norm(), (markers[a.1] - markers[b.1]).norm()];
        (lengths[0] - lengths[1]).abs() <= 2.0 * TOLERANCE_MM
    };
    let mut all = Vec::new();
    for i in 0..markers.len() {
        for j in i + 1..markers.len() {
            for a in 0..design.len() {
                for b in (0..design.len()).filter(|b| *b != a && same((a, i), (*b, j))) {
                    for k in j + 1..markers.len() {
                        let fits = |c: &usize| *c != a && *c != b && same((a, i), (*c, k)) && same((b, j), (*c, k));
                        all.extend((0..design.len()).filter(fits).map(|c| [(a, i), (b, j), (c, k)]));
                    }
                }
            }
        }
    }
    all
}

/// Fits the pose to pairs, matches all markers by it, and repeats both until the pairs stay.
fn settled(design: &[Point3<f64>], markers: &[Point3<f64>], pairs: &[(usize, usize)]) -> Option<Placement> {
    let mut pairs = pairs.to_vec();
    for _ in 0..10 {
        let pose = fitted(design, markers, &pairs)?;
        let matched = matched(design, markers, &pose);
        let new_pairs: Vec<(usize, usize)> = matched
            .iter()
            .enumerate()
            .filter_map(|(a, i)| Some((a, (*i)?)))
            .collect();
        if new_pairs.len() < MIN_MATCHED {
            return None;
        }
        if new_pairs == pairs {
            let squares = new_pairs
                .iter()
                .map(|(a, i)| (pose * design[*a] - markers[*i]).norm_squared());
            let rms_mm = (squares.sum::<f64>() / new_pairs.len() as f64).sqrt();
            return Some(Placement { pose, matched, rms_mm });
        }
        pairs = new_pairs;
    }
    None
}

/// Rigid transform from the design to the world by paired markers; `None` if they lie on a line.
pub fn fitted(design: &[Point3<f64>], markers: &[Point3<f64>], pairs: &[(usize, usize)]) -> Option<Isometry3<f64>> {
    let landmark = |(a, i): &(usize, usize)| Landmark {
        name: String::new(),
        volume_mm: markers[*i],
        surface_mm: design[*a],
    };
    let matrix: Matrix4<f64> = kabsch(&pairs.iter().map(landmark).collect::<Vec<_>>()).ok()?;
    let rotation = Rotation3::from_matrix_unchecked(matrix.fixed_view::<3, 3>(0, 0).into_owned());
    let shift = Translation3::from(matrix.fixed_view::<3, 1>(0, 3).into_owned());
    Some(Isometry3::from_parts(
        shift,
        UnitQuaternion::from_rotation_matrix(&rotation),
    ))
}

/// Marker found nearest to each of the design, one to one, within the tolerance.
fn matched(design: &[Point3<f64>], markers: &[Point3<f64>], pose: &Isometry3<f64>) -> Vec<Option<usize>> {
    let distance = |a: usize, i: usize| (pose * design[a] - markers[i]).norm();
    let nearest = |a: usize| {
        let near = (0..markers.len()).min_by(|i, j| distance(a, *i).total_cmp(&distance(a, *j)))?;
        (distance(a, near) <= TOLERANCE_MM).then_some(near)
    };
    let mut matched: Vec<Option<usize>> = (0..design.len()).map(nearest).collect();
    for a in 0..design.len() {
        let rival = |b: usize| b != a && matched[b] == matched[a];
        let closer = |b: usize, i: usize| (distance(b, i), b) < (distance(a, i), a);
        if let Some(i) = matched[a]
            && (0..design.len()).any(|b| rival(b) && closer(b, i))
        {
            matched[a] = None;
        }
    }
    matched
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix4;

    use super::*;

    fn design() -> Vec<Point3<f64>> {
        let places = [
            [0.0, -40.0, -30.0],
            [10.0, 38.0, -28.0],
            [35.0, -36.0, 25.0],
            [50.0, 41.0, 12.0],
            [62.0, -20.0, -31.0],
            [70.0, 15.0, 29.0],
            [22.0, 5.0, -33.0],
        ];
        places.map(Point3::from).to_vec()
    }

    fn pose() -> Isometry3<f64> {
        Isometry3::new(Vector3::new(12.0, -250.0, 900.0), Vector3::new(1.9, -0.4, 0.3))
    }

    /// The points of a design as they are found, in reverse order.
    fn found(design: &[Point3<f64>]) -> Vec<Point3<f64>> {
        design.iter().rev().map(|point| pose() * point).collect()
    }

    #[test]
    fn markers_are_placed_exactly_whatever_is_missing_or_beside() {
        let design = design();
        for left_out in [None, Some(0), Some(4)] {
            let mut found = found(&design);
            left_out.map(|at| found.remove(at));
            found.insert(1, pose() * Point3::new(40.0, 0.0, 0.0));
            let placement = place(&design, &found).expect("a placement");
            assert_eq!(placement.count(), design.len() - usize::from(left_out.is_some()));
            assert!(placement.rms_mm < 1e-9, "{}", placement.rms_mm);
            let apart = (placement.pose.inverse() * pose()).to_matrix() - Matrix4::identity();
            assert!(apart.amax() < 1e-9, "{apart}");
            for (at, matched) in placement.matched.iter().enumerate() {
                let Some(matched) = matched else { continue };
                assert!((found[*matched] - pose() * design[at]).norm() < 1e-9);
            }
        }
    }

    /// If two markers of the design are beside the only one found, the nearer has it.
    #[test]
    fn a_marker_is_matched_once() {
        let mut design = design();
        let found = found(&design);
        design.insert(0, design[0] + Vector3::new(0.7, 0.0, 0.0));
        let placement = place(&design, &found).expect("a placement");
        assert_eq!((placement.count(), placement.matched[0]), (7, None));
        assert!(placement.rms_mm < 1e-9, "{}", placement.rms_mm);
    }

    /// Neither a mirror image nor half of the markers is taken for the design.
    #[test]
    fn what_does_not_match_is_refused() {
        let design = design();
        let mirrored: Vec<_> = design.iter().map(|p| Point3::new(-p.x, p.y, p.z)).collect();
        for (found, words) in [
            (Vec::new(), "0 of 7"),
            (found(&design)[..3].to_vec(), "of 3 found"),
            (found(&mirrored), "of 7 markers match"),
        ] {
            let error = place(&design, &found).expect_err(words).to_string();
            assert!(error.contains(words) && error.contains("at least 4"), "{error}");
        }
    }

    #[test]
    fn a_symmetric_design_is_refused() {
        let square = [[10.0, 10.0], [-10.0, 10.0], [-10.0, -10.0], [10.0, -10.0]];
        let square: Vec<_> = square.iter().map(|[x, y]| Point3::new(*x, *y, 0.0)).collect();
        let error = place(&square, &found(&square)).expect_err("ambiguous").to_string();
        assert!(error.contains("without symmetry"), "{error}");
    }

    #[test]
    fn bodies_have_centres_and_diameters() {
        let size = [40, 30, 30];
        let mut image = ScalarImage {
            size,
            spacing_mm: [0.5; 3],
            index_to_world: Matrix4::new_translation(&Vector3::new(-3.0, 7.0, 1.0)) * Matrix4::new_scaling(0.5),
            data: vec![0.0; size.iter().product()],
        };
        // Balls of 4 and 2 mm about voxels; the second lies in a corner.
        for (centre, radius) in [([12usize, 14, 15], 4.0), ([38, 1, 1], 2.0)] {
            for (at, value) in image.data.iter_mut().enumerate() {
                let index = [at % 40, at / 40 % 30, at / 1200];
                let away = [0, 1, 2].map(|axis| index[axis] as f64 - centre[axis] as f64);
                if Vector3::from(away).norm() <= radius {
                    *value = 3000.0;
                }
            }
        }
        let found = bodies(&image, 1500.0).expect("bodies");
        assert_eq!(found.len(), 2);
        let ball = found
            .iter()
            .max_by(|a, b| a.diameter_mm.total_cmp(&b.diameter_mm))
            .expect("a ball");
        assert!(
            (ball.centre_mm - Point3::new(3.0, 14.0, 8.5)).norm() < 1e-9,
            "{}",
            ball.centre_mm
        );
        // Voxels on the boundary count whole.
        assert!((ball.diameter_mm - 4.0).abs() < 0.2, "{}", ball.diameter_mm);
        let error = bodies(&image, -1.0).expect_err("too low").to_string();
        assert!(error.contains("higher threshold"), "{error}");
    }
}
