//! Needles measured in CT: motion of the base from markers on a stage and a container, and the shape of the needle
//! (algorithm 1 and section II-D of Wang et al. 2023).
//!
//! The frame of the container has its origin in the surface of the tissue, x along the undeflected needle into it, and
//! y along the motion of the base. The origin of the stage is the base of the needle; at rest its axes are about those
//! of the container.

use std::path::Path;

use nalgebra::{Isometry3, Point3};

use insonify_anatomy::registration::markers::{self, BrightBody, Placement};
use insonify_anatomy::volume::{ScalarImage, VolumeError};
use insonify_base::csv::{Csv, CsvError};
use insonify_base::statistics::{mean, slope};

/// Columns of a marker design.
const COLUMNS: [&str; 5] = ["body", "diameter_mm", "x_mm", "y_mm", "z_mm"];
/// Bodies with markers.
const BODIES: [&str; 2] = ["container", "stage"];
/// Most sizes that an error lists.
const MAX_LISTED: usize = 24;
/// Largest ratio of the diameter of a marker found and that of the design.
const MAX_SIZE_RATIO: f64 = 1.5;
/// Least length of a needle, mm.
const MIN_NEEDLE_MM: f64 = 10.0;
/// Largest deflection of a needle that counts as unmoved: its centres of motion are noise, mm.
const MIN_DEFLECTION_MM: f64 = 0.5;
/// 95th percentile of the F distribution with 6 and 30 degrees of freedom, those of twelve markers.
const F_LIMIT: f64 = 2.42;

/// Markers of the container and of the stage in their own frames.
#[derive(Clone, Debug, PartialEq)]
pub struct Design {
    /// Centres by body (container, stage), mm.
    pub centres_mm: [Vec<Point3<f64>>; 2],
    /// Diameter by body, mm.
    pub diameters_mm: [f64; 2],
}

impl Design {
    /// Reads a table with the columns `body` (`container` or `stage`), `diameter_mm`, `x_mm`, `y_mm` and `z_mm`.
    ///
    /// # Errors
    /// [`CsvError`]; also if a body has fewer than four markers or markers of several sizes, or if the bodies have one
    /// size.
    pub fn read(path: &Path) -> Result<Self, CsvError> {
        let table = Csv::read(path, &COLUMNS, &[])?;
        let (mut centres_mm, mut diameters_mm) = ([Vec::new(), Vec::new()], [0.0; 2]);
        for row in table.rows() {
            let body = BODIES.iter().position(|name| *name == row.text("body"));
            let body = body.ok_or_else(|| row.wrong("body", "`container` or `stage`"))?;
            let diameter = row.number("diameter_mm")?;
            if centres_mm[body].is_empty() {
                diameters_mm[body] = diameter;
            }
            if diameter <= 0.0 || diameter != diameters_mm[body] {
                return Err(row.wrong("diameter_mm", "one diameter above 0 for all markers of a body"));
            }
            centres_mm[body].push(Point3::from(row.numbers(["x_mm", "y_mm", "z_mm"])?));
        }
        let contents = |text: String| CsvError::Contents {
            path: path.to_owned(),
            text,
        };
        for (name, centres) in BODIES.iter().zip(&centres_mm) {
            if centres.len() < 4 {
                let text = format!("found {} markers of the {name}; expected at least 4", centres.len());
                return Err(contents(text));
            }
        }
        // Nothing but their size tells the markers of one body from those of the other.
        let [container, stage] = diameters_mm;
        if container.max(stage) < MAX_SIZE_RATIO * container.min(stage) {
            return Err(contents(format!(
                "found markers of {container} mm on the container and of {stage} mm on the stage; expected sizes that differ by a factor of \
                 at least {MAX_SIZE_RATIO}"
            )));
        }
        Ok(Self {
            centres_mm,
            diameters_mm,
        })
    }
}

/// Grey values from which a voxel belongs to a marker, and to the needle.
#[derive(Clone, Copy, Debug)]
pub struct Thresholds {
    /// Threshold for markers.
    pub marker: f32,
    /// Threshold for the needle.
    pub needle: f32,
}

/// Placements of the bodies and the needle in one volume.
#[derive(Clone, Debug)]
pub struct Scan {
    /// Placements of the container and of the stage in the volume.
    pub placed: [Placement; 2],
    /// Transform from the stage to the container, mm.
    stage: Isometry3<f64>,
    /// Centres of the markers of the container in the volume, in the order of the design, mm; `None` for one that is
    /// missing.
    container_mm: Vec<Option<Point3<f64>>>,
    /// Centroids of the needle by slice across x, in the frame of the container, mm, along x.
    needle_mm: Vec<Point3<f64>>,
    /// Depth of the tip, mm.
    tip_mm: f64,
}

/// Finds markers and needle in a volume.
///
/// # Errors
/// [`VolumeError`] if markers do not match the design, or there is no needle.
pub fn scan(image: &ScalarImage, design: &Design, thresholds: &Thresholds) -> Result<Scan, VolumeError> {
    let bodies = markers::bodies(image, thresholds.marker)?;
    let placement = |body: usize| {
        let [size, other_size] = [design.diameters_mm[body], design.diameters_mm[1 - body]];
        let off = |bright: &BrightBody, size_mm: f64| (bright.diameter_mm / size_mm).ln().abs();
        let alike = |bright: &&BrightBody| {
            off(bright, size) < MAX_SIZE_RATIO.ln() && off(bright, size) < off(bright, other_size)
        };
        let centres: Vec<_> = bodies.iter().filter(alike).map(|bright| bright.centre_mm).collect();
        let named = |error| {
            let mut sizes: Vec<f64> = bodies.iter().map(|bright| bright.diameter_mm).collect();
            sizes.sort_by(f64::total_cmp);
            let listed: Vec<String> = sizes.iter().take(MAX_LISTED).map(|size| format!("{size:.2}")).collect();
            let more = if sizes.len() > MAX_LISTED { " and more" } else { "" };
            VolumeError::new(format!(
                "markers of the {}, {size} mm: {error}; of the {} bright bodies the diameters are {}{more} mm (another `--threshold` changes them)",
                BODIES[body],
                sizes.len(),
                listed.join(", ")
            ))
        };
        let placed = markers::place(&design.centres_mm[body], &centres).map_err(named)?;
        let matched = placed
            .matched
            .iter()
            .map(|marker| marker.map(|marker| centres[marker]))
            .collect();
        Ok::<(Placement, Vec<Option<Point3<f64>>>), VolumeError>((placed, matched))
    };
    let [(container, container_mm), (stage, _)] = [placement(0)?, placement(1)?];
    let placed = [container, stage];
    let to_container = placed[0].pose.inverse();
    let bright = if thresholds.needle == thresholds.marker {
        bodies
    } else {
        markers::bodies(image, thresholds.needle)?
    };
    let (needle_mm, tip_mm) = needle(image, &to_container, &bright)?;
    Ok(Scan {
        stage: to_container * placed[1].pose,
        placed,
        container_mm,
        needle_mm,
        tip_mm,
    })
}

/// Centroids of the longest body by slice along x, and the depth of its end; mm in the frame of the container.
fn needle(
    image: &ScalarImage,
    to_container: &Isometry3<f64>,
    bodies: &[BrightBody],
) -> Result<(Vec<Point3<f64>>, f64), VolumeError> {
    let moved = bodies.iter().map(|body| {
        body.voxels_mm
            .iter()
            .map(|voxel| to_container * voxel)
            .collect::<Vec<_>>()
    });
    let length = |voxels: &[Point3<f64>]| {
        let ends = voxels
            .iter()
            .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], voxel| {
                [low.min(voxel.x), high.max(voxel.x)]
            });
        (ends, ends[1] - ends[0])
    };
    let longest = moved
        .map(|voxels| (length(&voxels), voxels))
        .max_by(|a, b| a.0.1.total_cmp(&b.0.1));
    let Some((([first, last], length), voxels)) = longest.filter(|((_, length), _)| *length >= MIN_NEEDLE_MM) else {
        let text =
            format!("found no needle: no bright body is {MIN_NEEDLE_MM} mm long along the needle's axis of the design");
        return Err(VolumeError::new(text));
    };
    // Slices as thick as the voxels are along x.
    let along = to_container.inverse() * nalgebra::Vector3::x();
    let axis = |axis: usize| image.index_to_world.fixed_view::<3, 1>(0, axis).into_owned();
    let share = |index: &usize| axis(*index).normalize().dot(&along).abs();
    let nearest = [0, 1, 2]
        .into_iter()
        .max_by(|a, b| share(a).total_cmp(&share(b)))
        .unwrap_or(0);
    let slice_mm = axis(nearest).norm();
    let count = (length / slice_mm).round() as usize + 1;
    let mut sums = vec![(nalgebra::Vector3::zeros(), 0usize); count];
    for voxel in &voxels {
        let slice = ((voxel.x - first) / slice_mm).round() as usize;
        let (sum, count) = &mut sums[slice.min(count - 1)];
        *sum += voxel.coords;
        *count += 1;
    }
    let filled = sums.into_iter().filter(|(_, count)| *count > 0);
    let centroids = filled.map(|(sum, count)| Point3::from(sum / count as f64)).collect();
    // A voxel reaches the threshold from half full on: on average the needle ends half a slice beyond the centre of the
    // last.
    Ok((centroids, last + 0.5 * slice_mm))
}

/// A measured needle.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct MeasuredNeedle {
    /// Displacement of the base, mm.
    pub displacement_mm: f64,
    /// Slope of the base.
    pub slope: f64,
    /// Distance from the base to the entry, mm.
    pub control_distance_mm: f64,
    /// Depth of the tip, mm.
    pub inserted_mm: f64,
    /// Deflection of the tip, mm.
    pub tip_mm: f64,
    /// Remote centre of motion, mm below the entry; `None` for a base that has not turned.
    pub rcm_mm: Option<f64>,
    /// Centre of motion, mm below the entry.
    pub com_mm: Option<f64>,
    /// Root mean square distances of the markers (container, stage) from their design, mm.
    pub markers_rms_mm: [f64; 2],
    /// Number of matched markers (container, stage).
    pub markers: [usize; 2],
    /// Slope of the needle at rest: 0 if it is perpendicular to the surface.
    pub rest_slope: f64,
    /// Root mean square distance of the needle at rest from a line, mm.
    pub rest_rms_mm: f64,
    /// Shape: position and deflection, mm, from base to tip.
    #[serde(skip)]
    pub shape_mm: Vec<[f64; 2]>,
}

/// Whether the container has the same pose in two volumes: aligning its markers rigidly reduces their distances by no
/// more than chance allows (F test, 95 %).
fn lies_still(rest: &Scan, moved: &Scan) -> bool {
    let pairs = rest.container_mm.iter().zip(&moved.container_mm);
    let (from, to): (Vec<_>, Vec<_>) = pairs.filter_map(|(from, to)| from.zip(*to)).unzip();
    let count = from.len();
    let same: Vec<(usize, usize)> = (0..count).map(|marker| (marker, marker)).collect();
    let Some(pose) = markers::fitted(&from, &to, &same).filter(|_| count > 2) else {
        return false;
    };
    let squares = |pose: &Isometry3<f64>| -> f64 {
        let pairs = from.iter().zip(&to);
        pairs.map(|(from, to)| (pose * from - to).norm_squared()).sum()
    };
    let residual = squares(&pose) / (3 * count - 6) as f64;
    (squares(&Isometry3::identity()) - squares(&pose)) / 6.0 <= F_LIMIT * residual
}

/// Compares a moved needle with itself at rest. Where the container has the same pose in both volumes, its place at
/// rest counts for both, so that the errors of its markers cancel in the motion of the base.
///
/// # Errors
/// [`VolumeError`] if base and tip do not lie on either side of the entry.
pub fn measure(rest: &Scan, moved: &Scan) -> Result<MeasuredNeedle, VolumeError> {
    let to_rest = if lies_still(rest, moved) {
        rest.placed[0].pose.inverse() * moved.placed[0].pose
    } else {
        Isometry3::identity()
    };
    let stage = to_rest * moved.stage;
    let shift = stage.translation.vector - rest.stage.translation.vector;
    let turn = (stage.rotation * rest.stage.rotation.inverse()).to_rotation_matrix();
    let slope_of_base = turn[(1, 0)] / turn[(0, 0)];
    let control_distance_mm = -rest.stage.translation.x;
    let inserted_mm = rest.tip_mm;
    if control_distance_mm < 0.0 || inserted_mm <= 0.0 {
        return Err(VolumeError::new(format!(
            "found the base {control_distance_mm:.1} mm before and the tip {inserted_mm:.1} mm below the entry (x = 0 of the container); \
             expected one on either side"
        )));
    }
    let inside = |needle: &[Point3<f64>], to_rest: &Isometry3<f64>| -> Vec<[f64; 2]> {
        let points = needle.iter().map(|point| to_rest * point);
        let points = points.filter(|point| point.x >= -control_distance_mm);
        points.map(|point| [point.x, point.y]).collect()
    };
    // A needle is seldom perpendicular to the surface: deflections count from its line at rest.
    let line = inside(&rest.needle_mm, &Isometry3::identity());
    let [xs, ys] = [0, 1].map(|axis| line.iter().map(|point| point[axis]).collect::<Vec<_>>());
    let rest_slope = slope(&xs, &ys);
    let (x0, y0) = (mean(&xs), mean(&ys));
    let at_rest = |x: f64| y0 + rest_slope * (x - x0);
    let squares = xs.iter().zip(&ys).map(|(x, y)| (y - at_rest(*x)).powi(2));
    let rest_rms_mm = mean(&squares.collect::<Vec<_>>()).sqrt();
    let shape_mm: Vec<[f64; 2]> = inside(&moved.needle_mm, &to_rest)
        .into_iter()
        .map(|[x, y]| [x, y - at_rest(x)])
        .collect();
    let Some(&[_, tip_mm]) = shape_mm.last().filter(|_| shape_mm.len() > 1 && line.len() > 1) else {
        return Err(VolumeError::new("found no needle between the base and the tip"));
    };
    let turned = slope_of_base != 0.0 && shift.y.abs() >= MIN_DEFLECTION_MM;
    Ok(MeasuredNeedle {
        displacement_mm: shift.y,
        slope: slope_of_base,
        control_distance_mm,
        inserted_mm,
        tip_mm,
        rcm_mm: turned.then(|| -control_distance_mm - shift.y / slope_of_base),
        com_mm: crossing(&shape_mm),
        markers_rms_mm: [0, 1].map(|body| moved.placed[body].rms_mm),
        markers: [0, 1].map(|body| moved.placed[body].count()),
        rest_slope,
        rest_rms_mm,
        shape_mm,
    })
}

/// First crossing of a measured shape with the undeflected needle, mm below the entry; `None` if there is none, or if
/// the needle has not moved.
pub fn crossing(shape_mm: &[[f64; 2]]) -> Option<f64> {
    let largest = shape_mm.iter().fold(0.0, |most: f64, point| most.max(point[1].abs()));
    let inside: Vec<_> = shape_mm
        .iter()
        .filter(|point| point[0] >= 0.0 && largest >= MIN_DEFLECTION_MM)
        .collect();
    let pair = inside
        .windows(2)
        .find(|pair| pair[0][1] * pair[1][1] <= 0.0 && pair[0][1] != pair[1][1])?;
    let [[x0, u0], [x1, u1]] = [*pair[0], *pair[1]];
    Some(x0 - u0 * (x1 - x0) / (u1 - u0))
}

/// Markers on the container of synthetic scans, mm.
pub const SYNTHETIC_CONTAINER_MM: [[f64; 3]; 12] = [
    [0.0, -36.0, -24.0],
    [8.0, 34.0, -26.0],
    [20.0, -35.0, 22.0],
    [24.0, 36.0, 20.0],
    [33.0, -12.0, -27.0],
    [41.0, 33.0, -8.0],
    [46.0, -37.0, -5.0],
    [52.0, 14.0, 26.0],
    [58.0, -33.0, 25.0],
    [61.0, 37.0, 11.0],
    [15.0, 3.0, 27.0],
    [64.0, 8.0, -25.0],
];
/// Markers on their stage, mm.
pub const SYNTHETIC_STAGE_MM: [[f64; 3]; 7] = [
    [-14.0, -12.0, 10.0],
    [-13.0, 13.0, 12.0],
    [-2.0, -14.0, -11.0],
    [0.0, 12.0, -9.0],
    [4.0, -8.0, 13.0],
    [-9.0, 4.0, -14.0],
    [3.0, 15.0, 5.0],
];

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use insonify_base::random::normal;

    /// A scan without voxels of a container in a pose, whose markers are off by 0.2 mm (root mean square), and of a
    /// base moved along y, with markers off by 0.1 mm.
    fn seen(trial: i32, pose: &Isometry3<f64>, moved_mm: f64) -> Scan {
        let base = pose * Isometry3::translation(-40.0, moved_mm, 0.0);
        let off = |row: usize, mm: f64| {
            Vector3::from_fn(|axis, _| mm / 3f64.sqrt() * normal([trial, row as i32, axis as i32], [5, 6]))
        };
        let observed = |design: &[Point3<f64>], pose: &Isometry3<f64>, first: usize, mm: f64| -> Vec<Point3<f64>> {
            let marker = |(row, centre): (usize, &Point3<f64>)| pose * centre + off(first + row, mm);
            design.iter().enumerate().map(marker).collect()
        };
        let [container, stage] = [&SYNTHETIC_CONTAINER_MM[..], &SYNTHETIC_STAGE_MM[..]]
            .map(|design| design.iter().copied().map(Point3::from).collect::<Vec<_>>());
        let seen = [observed(&container, pose, 0, 0.2), observed(&stage, &base, 100, 0.1)];
        let placed = [
            markers::place(&container, &seen[0]).unwrap(),
            markers::place(&stage, &seen[1]).unwrap(),
        ];
        let to_container = placed[0].pose.inverse();
        let line = (-45..=60).map(|x| to_container * pose * Point3::new(f64::from(x), 0.0, 0.0));
        Scan {
            stage: to_container * placed[1].pose,
            container_mm: placed[0]
                .matched
                .iter()
                .map(|marker| marker.map(|marker| seen[0][marker]))
                .collect(),
            placed,
            needle_mm: line.collect(),
            tip_mm: 60.0,
        }
    }

    /// By least squares the base of a scan errs by 0.077 mm with the container and by 0.023 mm with the stage (standard
    /// deviations): the motion between two scans by 0.114 mm, or by 0.032 mm where the container lies still and counts
    /// once.
    #[test]
    fn the_errors_of_a_container_that_lies_still_cancel() {
        const TRIALS: i32 = 60;
        let pose = Isometry3::new(Vector3::new(20.0, -130.0, 700.0), Vector3::new(0.3, -1.2, 0.4));
        let elsewhere = Isometry3::translation(0.0, 5.0, -3.0) * pose;
        for (second, expected) in [(pose, 0.0325), (elsewhere, 0.114)] {
            let error = |trial: i32| {
                let [rest, moved] = [seen(2 * trial, &pose, 0.0), seen(2 * trial + 1, &second, 7.5)];
                measure(&rest, &moved).unwrap().displacement_mm - 7.5
            };
            let squares: Vec<f64> = (0..TRIALS).map(|trial| error(trial).powi(2)).collect();
            let ratio = mean(&squares).sqrt() / expected;
            assert!((0.7..1.4).contains(&ratio), "{ratio} of {expected} mm");
        }
    }
}
