//! Calibration of an image to the marker on the probe, from pixels of known points and wires.
//!
//! A pixel (u, v) lies at a point of the tracker's frame, or on a straight wire in it; its distance from there is the
//! residual. The image is a plane with two pixel sizes: eight parameters, fitted by the Gauss-Newton method from the
//! affine solution. Wires in the shape of an N need no other treatment (N. Pagoulatos et al., Ultrasound in Medicine &
//! Biology 27, 2001, intersect them first).

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector, Matrix3, Matrix4, Rotation3, SVector, Vector3};
use serde::Serialize;

use super::poses::{MarkerPose, Poses};
use super::{Residual, TRUNCATED, kept, trimmed};
use crate::TrackingError;
use crate::plus::Wire;
use crate::sequence::{GreyImage, Sequence};
use insonify_base::matrix::Rows;

/// Parameters: rotation, two pixel sizes, position.
const PARAMETERS: usize = 8;
/// Least ratio of singular values of the affine problem.
const DETERMINED: f64 = 1e-4;
/// Gauss-Newton steps; they converge within a few.
const STEPS: usize = 50;
/// Relative change that ends them.
const SETTLED: f64 = 1e-12;
/// Radius about the predicted pixel in which a wire's echo is sought, and about the brightest pixel over which its
/// centre is taken, mm.
const SEARCH_MM: f64 = 2.5;
const ECHO_MM: f64 = 2.0;
/// Least grey level of an echo, a quarter of the range.
const ECHO_GREY: u8 = 64;
/// Rounds of prediction and search.
const ROUNDS: usize = 4;
/// Distance of a known point from the image plane up to which it is visible, mm.
const SLICE_MM: f64 = 2.0;

/// Place of a pixel in the tracker's frame, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Feature {
    /// A point.
    Point(Vector3<f64>),
    /// A straight line: a point on it, and its unit direction.
    Line(Vector3<f64>, Vector3<f64>),
}

impl Feature {
    /// A wire of a phantom, placed by a transform from the phantom to the tracker.
    ///
    /// # Errors
    /// [`TrackingError`] if its ends coincide.
    pub fn wire(wire: &Wire, phantom_to_tracker: &Matrix4<f64>) -> Result<Self, TrackingError> {
        let [front, back] = wire.ends_mm.map(|end| {
            let end = Vector3::from(end).push(1.0);
            (phantom_to_tracker * end).xyz()
        });
        let direction = (back - front).try_normalize(1e-6);
        let direction = direction.ok_or_else(|| TrackingError::new(format!("wire `{}` has no length", wire.name)))?;
        Ok(Self::Line(front, direction))
    }

    fn origin(&self) -> Vector3<f64> {
        match self {
            Self::Point(point) | Self::Line(point, _) => *point,
        }
    }

    /// Projection of differences onto those that count.
    fn across(&self) -> Matrix3<f64> {
        match self {
            Self::Point(_) => Matrix3::identity(),
            Self::Line(_, along) => Matrix3::identity() - along * along.transpose(),
        }
    }

    /// Number of independent equations.
    fn equations(&self) -> usize {
        match self {
            Self::Point(_) => 3,
            Self::Line(..) => 2,
        }
    }
}

/// Pixel of a known feature.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pixel {
    /// Frame of the sequence, from 0.
    pub frame: usize,
    /// Column and row in orientation MF.
    pub at: [f64; 2],
    /// Position, mm.
    pub feature: Feature,
}

/// Calibration of an image.
#[derive(Clone, Debug, Serialize)]
pub struct ImageCalibration {
    /// Transform from pixels (column, row, plane) to the marker on the probe, mm.
    pub image_to_probe: Rows,
    /// Width and height of a pixel, mm.
    pub pixel_mm: [f64; 2],
    /// Mean column and row of the pixels.
    pub mean_px: [f64; 2],
    /// Standard deviations of the position of the mean pixel, mm.
    pub std_mm: [f64; 3],
    /// Standard deviations of the rotation about the marker's axes, degrees.
    pub std_deg: [f64; 3],
    /// Angle between the axes of the affine solution, degrees: 90 for consistent pixels.
    pub axes_apart_deg: f64,
    /// Root mean square of the distances of used pixels from their points and wires, mm.
    pub rms_mm: f64,
    /// Largest of these distances, mm.
    pub max_mm: f64,
    /// Number of used pixels.
    pub used: usize,
    /// Number of pixels in frames without a valid pose.
    pub skipped: usize,
    /// Number of pixels left out as outliers.
    pub trimmed: usize,
    /// Residuals of all pixels.
    #[serde(skip)]
    pub residuals: Vec<Residual>,
}

/// Plane of pixels: unit axes, pixel sizes, position of the mean pixel.
#[derive(Clone, Copy)]
struct Plane {
    axes: Matrix3<f64>,
    pixel_mm: [f64; 2],
    centre: Vector3<f64>,
}

impl Plane {
    fn beyond(&self, [u, v]: [f64; 2]) -> Vector3<f64> {
        self.axes.column(0) * (self.pixel_mm[0] * u) + self.axes.column(1) * (self.pixel_mm[1] * v)
    }

    fn image_to_probe(&self, [u, v]: [f64; 2]) -> Matrix4<f64> {
        let mut matrix = Matrix4::identity();
        let plane_mm = (self.pixel_mm[0] * self.pixel_mm[1]).sqrt();
        for (axis, mm) in [self.pixel_mm[0], self.pixel_mm[1], plane_mm].into_iter().enumerate() {
            matrix
                .fixed_view_mut::<3, 1>(0, axis)
                .copy_from(&(self.axes.column(axis) * mm));
        }
        let origin = self.centre - self.beyond([u, v]);
        matrix.fixed_view_mut::<3, 1>(0, 3).copy_from(&origin);
        matrix
    }
}

/// A pixel with the pose of its frame.
type Seen<'a> = (&'a Pixel, &'a MarkerPose);

/// Result of one fit: the plane, the standard deviations of rotation and position, and the angle of the affine axes,
/// rad.
type Fit = (Plane, [Vector3<f64>; 2], f64);

/// Calibrates an image from pixels, leaving out outliers.
///
/// # Errors
/// [`TrackingError`] if the pixels do not determine the plane of the image.
pub fn calibrate(pixels: &[Pixel], poses: &Poses) -> Result<ImageCalibration, TrackingError> {
    let seen: Vec<Seen<'_>> = pixels
        .iter()
        .filter_map(|pixel| Some((pixel, poses.get(pixel.frame)?)))
        .collect();
    let count = seen.len() as f64;
    let mean = [0, 1].map(|axis| seen.iter().map(|(pixel, _)| pixel.at[axis]).sum::<f64>() / count);
    // About their mean the pixels separate the turn of the plane from its shift, and both deviations hold where the
    // pixels lie.
    let fit_of_kept = trimmed(seen.len(), |used| {
        let kept: Vec<Seen<'_>> = kept(&seen, used).copied().collect();
        let fit = fit(&kept, mean)?;
        let distance_mm = |observation: &Seen<'_>| residual(observation, &fit.0, mean).norm();
        Ok((fit, seen.iter().map(distance_mm).collect()))
    })?;
    let (plane, [turn, shift], angle) = fit_of_kept.fitted;
    let used = fit_of_kept.count();
    Ok(ImageCalibration {
        image_to_probe: Rows(plane.image_to_probe(mean)),
        pixel_mm: plane.pixel_mm,
        mean_px: mean,
        std_mm: shift.into(),
        std_deg: turn.map(f64::to_degrees).into(),
        axes_apart_deg: angle.to_degrees(),
        rms_mm: fit_of_kept.rms(),
        max_mm: fit_of_kept.max(),
        used,
        skipped: pixels.len() - seen.len(),
        trimmed: seen.len() - used,
        residuals: fit_of_kept.residuals(|index| seen[index].0.frame),
    })
}

fn beyond((pixel, _): &Seen<'_>, mean: [f64; 2]) -> [f64; 2] {
    [pixel.at[0] - mean[0], pixel.at[1] - mean[1]]
}

fn residual(seen: &Seen<'_>, plane: &Plane, mean: [f64; 2]) -> Vector3<f64> {
    let (pixel, pose) = seen;
    let position = pose.rotation * (plane.beyond(beyond(seen, mean)) + plane.centre) + pose.position;
    pixel.feature.across() * (position - pixel.feature.origin())
}

fn fit(seen: &[Seen<'_>], mean: [f64; 2]) -> Result<Fit, TrackingError> {
    let equations: usize = seen.iter().map(|(pixel, _)| pixel.feature.equations()).sum();
    if equations < PARAMETERS + 1 {
        return Err(TrackingError::new(format!(
            "found {} usable pixels; expected at least 3 known points or 5 pixels on wires, in frames with valid poses and, where wires are sought, \
             in whole images (not cropped ones)",
            seen.len()
        )));
    }
    let (mut plane, axes_angle) = affine(seen, mean)?;
    // Gauss-Newton on turn (0-2), pixel sides (3, 4) and centre (5-7). The axes stay perpendicular, which the affine
    // start does not demand. Three rows for a wire, too: its projection has rank two, so that the way along it costs
    // nothing.
    let rows = 3 * seen.len();
    let mut normal = nalgebra::SMatrix::<f64, PARAMETERS, PARAMETERS>::zeros();
    let mut squares = 0.0;
    // Gradients of the pixels of each frame.
    let mut gradients = BTreeMap::<usize, SVector<f64, PARAMETERS>>::new();
    for _ in 0..STEPS {
        let mut jacobian = DMatrix::<f64>::zeros(rows, PARAMETERS);
        let mut right = DVector::zeros(rows);
        for (index, observation) in seen.iter().enumerate() {
            let [u, v] = beyond(observation, mean);
            let before = observation.0.feature.across() * observation.1.rotation;
            let mut put = |column, value: Vector3<f64>| {
                jacobian
                    .fixed_view_mut::<3, 1>(3 * index, column)
                    .copy_from(&(before * value));
            };
            let arm = plane.beyond([u, v]);
            for axis in 0..3 {
                let unit = Vector3::ith(axis, 1.0);
                put(axis, unit.cross(&arm));
                put(5 + axis, unit);
            }
            put(3, plane.axes.column(0) * u);
            put(4, plane.axes.column(1) * v);
            right
                .fixed_rows_mut::<3>(3 * index)
                .copy_from(&residual(observation, &plane, mean));
        }
        squares = right.norm_squared();
        gradients.clear();
        for (index, (pixel, _)) in seen.iter().enumerate() {
            let gradient = jacobian.rows(3 * index, 3).tr_mul(&right.rows(3 * index, 3));
            *gradients.entry(pixel.frame).or_default() += gradient.fixed_rows::<PARAMETERS>(0);
        }
        normal.copy_from(&(jacobian.transpose() * &jacobian));
        let gradient: SVector<f64, PARAMETERS> =
            (jacobian.transpose() * right).fixed_rows::<PARAMETERS>(0).into_owned();
        let Some(step) = normal.cholesky().map(|factor| factor.solve(&gradient)) else {
            return Err(undetermined());
        };
        // Turns are composed, not added, so that the axes stay perpendicular. A turn by -step undoes the residual.
        let turn = Rotation3::new(-step.fixed_rows::<3>(0).into_owned());
        plane.axes = turn.matrix() * plane.axes;
        plane.pixel_mm[0] -= step[3];
        plane.pixel_mm[1] -= step[4];
        plane.centre -= step.fixed_rows::<3>(5).into_owned();
        if step.norm() < SETTLED * (1.0 + plane.centre.norm()) {
            break;
        }
    }
    // Squares and normal matrix are those before the last step, which no longer moves anything.
    let inverse = normal.try_inverse().ok_or_else(undetermined)?;
    let variance = squares / (TRUNCATED * (equations - PARAMETERS) as f64);
    let independent = inverse.diagonal() * variance;
    // Pixels of one frame share the error of its pose: the sandwich of the sums by frame (K.-Y. Liang and S. L. Zeger,
    // Biometrika 73, 1986). Of few frames it is too small.
    let frames = gradients.len() as f64;
    let sums: nalgebra::SMatrix<f64, PARAMETERS, PARAMETERS> =
        gradients.values().map(|sum| sum * sum.transpose()).sum();
    let few = frames / (frames - PARAMETERS as f64 / 2.0).max(1.0);
    let by_frame = (inverse * sums * inverse).diagonal() * (few / TRUNCATED);
    let spread = independent.zip_map(&by_frame, |one, other| one.max(other).sqrt());
    let part = |from| spread.fixed_rows::<3>(from).into_owned();
    Ok((plane, [part(0), part(5)], axes_angle))
}

fn undetermined() -> TrackingError {
    TrackingError::new(
        "the pixels do not determine the plane of the image; expected points or wires apart from each other in columns, rows and depth, \
         or more frames from other sides",
    )
}

/// Affine plane as a starting point, squared up, and the angle between its axes, rad.
fn affine(seen: &[Seen<'_>], mean: [f64; 2]) -> Result<(Plane, f64), TrackingError> {
    // Pixels in units that make the columns of the problem alike.
    let reach = seen
        .iter()
        .flat_map(|observation| beyond(observation, mean))
        .fold(1.0, |largest: f64, x| largest.max(x.abs()));
    let mut a = DMatrix::zeros(3 * seen.len(), 9);
    let mut b = DVector::zeros(3 * seen.len());
    for (index, observation) in seen.iter().enumerate() {
        let across = observation.0.feature.across();
        let before = across * observation.1.rotation;
        let [u, v] = beyond(observation, mean).map(|x| x / reach);
        for (column, factor) in [u, v, 1.0].into_iter().enumerate() {
            a.fixed_view_mut::<3, 3>(3 * index, 3 * column)
                .copy_from(&(before * factor));
        }
        let away = across * (observation.0.feature.origin() - observation.1.position);
        b.fixed_rows_mut::<3>(3 * index).copy_from(&away);
    }
    let svd = a.svd(true, true);
    if svd.singular_values.min() < DETERMINED * svd.singular_values.max() {
        return Err(undetermined());
    }
    let solved = svd.solve(&b, 0.0).map_err(TrackingError::new)?;
    let part = |from: usize| solved.fixed_rows::<3>(from).into_owned();
    let (columns, rows) = (part(0) / reach, part(3) / reach);
    let angle = columns.angle(&rows);
    let pixel_mm = [columns.norm(), rows.norm()];
    let (Some(x), Some(y)) = (columns.try_normalize(1e-12), rows.try_normalize(1e-12)) else {
        return Err(undetermined());
    };
    let (Some(sum), Some(difference)) = ((x + y).try_normalize(1e-6), (x - y).try_normalize(1e-6)) else {
        return Err(undetermined());
    };
    // The nearest perpendicular pair: both axes turn by the same angle.
    let [x, y] = [(sum + difference).normalize(), (sum - difference).normalize()];
    let axes = Matrix3::from_columns(&[x, y, x.cross(&y)]);
    Ok((
        Plane {
            axes,
            pixel_mm,
            centre: part(6),
        },
        angle,
    ))
}

/// Pixel at which a feature is seen; `None` where it does not meet the image plane.
fn project(image_to_probe: &Matrix4<f64>, pose: &MarkerPose, feature: &Feature) -> Option<[f64; 2]> {
    let part = |column| image_to_probe.fixed_view::<3, 1>(0, column).into_owned();
    let (columns, rows, origin): (Vector3<f64>, Vector3<f64>, Vector3<f64>) = (part(0), part(1), part(3));
    let normal = columns.cross(&rows).try_normalize(1e-12)?;
    let back = pose.rotation.transpose();
    let point = back * (feature.origin() - pose.position) - origin;
    let height = point.dot(&normal);
    let point = match feature {
        Feature::Point(_) => (height.abs() < SLICE_MM).then_some(point - normal * height)?,
        Feature::Line(_, along) => {
            let along = back * along;
            let steep = along.dot(&normal);
            (steep.abs() > 0.1).then(|| point - along * (height / steep))?
        }
    };
    let solve = Matrix3::from_columns(&[columns, rows, normal]).try_inverse()?;
    let pixel = solve * point;
    Some([pixel.x, pixel.y])
}

/// Centre of the brightest echo near a pixel, as the centroid of the grey levels above half of the maximum.
fn echo(image: &GreyImage, near: [f64; 2], pixel_mm: [f64; 2]) -> Option<[f64; 2]> {
    let size = [image.width, image.height];
    let window = |centre: [f64; 2], radius_mm: f64| {
        let range = [0, 1].map(|axis| {
            let reach = radius_mm / pixel_mm[axis];
            let low = (centre[axis] - reach).ceil().max(0.0) as usize;
            let high = ((centre[axis] + reach).floor() + 1.0).clamp(0.0, size[axis] as f64) as usize;
            low..high
        });
        let [columns, rows] = range;
        rows.flat_map(move |row| columns.clone().map(move |column| (column, row)))
    };
    let grey = |(column, row): (usize, usize)| image.pixels[row * size[0] + column];
    // Of equally bright pixels the first.
    let brightest = window(near, SEARCH_MM).fold(None, |best: Option<(usize, usize)>, pixel| match best {
        Some(known) if grey(known) >= grey(pixel) => best,
        _ => Some(pixel),
    })?;
    let peak = grey(brightest);
    if peak < ECHO_GREY {
        return None;
    }
    let mut sums = [0.0; 3];
    for pixel in window([brightest.0 as f64, brightest.1 as f64], ECHO_MM) {
        let weight = f64::from(grey(pixel)) - f64::from(peak) / 2.0;
        if weight > 0.0 {
            sums[0] += weight;
            sums[1] += weight * pixel.0 as f64;
            sums[2] += weight * pixel.1 as f64;
        }
    }
    Some([sums[1] / sums[0], sums[2] / sums[0]])
}

/// Follows features through the images of a sequence: each is searched for near the pixel that the current calibration
/// predicts, and the calibration is refitted, a few times.
///
/// # Errors
/// The errors of [`calibrate`].
pub fn follow(
    sequence: &Sequence,
    poses: &Poses,
    features: &[Feature],
    start: &Matrix4<f64>,
) -> Result<ImageCalibration, TrackingError> {
    let images: Vec<Option<GreyImage>> = (0..sequence.frames.len()).map(|frame| sequence.image(frame)).collect();
    let mut image_to_probe = *start;
    let mut calibration = None;
    for _ in 0..ROUNDS {
        let size = |axis| image_to_probe.fixed_view::<3, 1>(0, axis).norm();
        let pixel_mm = [size(0), size(1)];
        let mut pixels = Vec::new();
        for pose in &poses.poses {
            let Some(image) = images.get(pose.frame).and_then(Option::as_ref) else {
                continue;
            };
            pixels.extend(features.iter().filter_map(|feature| {
                let near = project(&image_to_probe, pose, feature)?;
                let pixel = echo(image, near, pixel_mm)?;
                Some(Pixel {
                    frame: pose.frame,
                    at: pixel,
                    feature: *feature,
                })
            }));
        }
        let next = calibrate(&pixels, poses)?;
        image_to_probe = next.image_to_probe.0;
        calibration = Some(next);
    }
    calibration.ok_or_else(undetermined)
}
