//! Calibration of tracked instruments by least squares: the point that a marker's motion leaves fixed, directions in
//! the marker's frame, and the plane of an image ([`points`]).
//!
//! Rotations R and positions t take the marker's frame to the tracker's. A tip p that rests at c fulfils R p + t = c in
//! every pose (Z. Yaniv, "Which pivot calibration?", Proc. SPIE 9415, 2015, algebraic one-step method).

pub mod points;
pub mod poses;
#[cfg(test)]
mod tests;

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use serde::Serialize;

use super::TrackingError;
use insonify_base::statistics::median;
use poses::{MarkerPose, Poses};

/// Deviation from the median above which a residual counts as an outlier, standard deviations as estimated from the
/// median absolute deviation: beyond 3 of the noise for norms of three-dimensional errors.
const OUTLIER: f64 = 2.5;
/// Standard deviations per median absolute deviation of normally distributed values.
const PER_MAD: f64 = 1.4826;
/// Variance of normally distributed errors that the limit for outliers leaves of the whole: 0.953 in three directions,
/// 0.927 in two.
const TRUNCATED: f64 = 0.94;
/// Least spread of residuals, mm: that of rounding in files.
const ROUNDING: f64 = 1e-6;
/// Maximum number of trimming passes; they settle within a few.
const PASSES: usize = 20;
/// Least rotation of a pivot calibration across any axis, degrees RMS: ten times the noise of optical trackers.
const PIVOT_DEG: f64 = 3.0;
/// Least rotation of a spin calibration about the axis, degrees RMS.
const SPIN_DEG: f64 = 10.0;
/// Largest wobble of the axis of a spin calibration, degrees RMS.
const WOBBLE_DEG: f64 = 5.0;
/// Least number of items left by the removal of outliers: of fewer, the spread is not known.
const FEWEST: usize = 6;
/// Largest angle between an estimated direction and the given ones, degrees RMS.
const DIRECTION_DEG: f64 = 20.0;

/// Residual of one pose or pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Residual {
    /// Frame or row of the input, from 0.
    pub frame: usize,
    /// Distance, mm, or angle, degrees.
    pub value: f64,
    /// Whether the result was fitted to it.
    pub used: bool,
}

/// Fixed point of a marker's motion.
#[derive(Clone, Debug, Serialize)]
pub struct Pivot {
    /// The point in the marker's frame, mm.
    pub point_mm: [f64; 3],
    /// The point in the tracker's frame, mm.
    pub pivot_mm: [f64; 3],
    /// Standard deviations of `point_mm`, mm.
    pub std_mm: [f64; 3],
    /// Root mean square of the residuals of the used poses, mm.
    pub rms_mm: f64,
    /// Largest residual of the used poses, mm.
    pub max_mm: f64,
    /// Number of used poses.
    pub used: usize,
    /// Number of frames without a valid pose.
    pub skipped: usize,
    /// Number of poses left out as outliers.
    pub trimmed: usize,
    /// Residuals of all poses.
    #[serde(skip)]
    pub residuals: Vec<Residual>,
}

/// Direction in a marker's frame.
#[derive(Clone, Debug, Serialize)]
pub struct Direction {
    /// Unit vector.
    pub direction: [f64; 3],
    /// Root mean square of the angles between the direction in each pose and the given or mean one, degrees; from two
    /// pivots the standard deviation of the direction.
    pub rms_deg: f64,
    /// Number of used poses.
    pub used: usize,
    /// Number of poses left out as outliers.
    pub trimmed: usize,
    /// Residuals of all poses.
    #[serde(skip)]
    pub residuals: Vec<Residual>,
}

/// Result of a trimmed fit.
struct Trimmed<T> {
    fitted: T,
    /// Residuals of all items.
    residuals: Vec<f64>,
    /// Whether each item was used.
    used: Vec<bool>,
}

impl<T> Trimmed<T> {
    fn rms(&self) -> f64 {
        let squares: Vec<f64> = self.kept().map(|r| r * r).collect();
        (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
    }

    fn max(&self) -> f64 {
        self.kept().fold(0.0, f64::max)
    }

    fn kept(&self) -> impl Iterator<Item = f64> {
        let both = self.residuals.iter().zip(&self.used);
        both.filter(|(_, used)| **used).map(|(r, _)| *r)
    }

    fn count(&self) -> usize {
        self.used.iter().filter(|used| **used).count()
    }

    fn of_directions(&self, direction: Vector3<f64>, frame: impl Fn(usize) -> usize) -> Direction {
        let residuals = self.residuals(frame).into_iter().map(|residual| Residual {
            value: residual.value.to_degrees(),
            ..residual
        });
        Direction {
            direction: direction.into(),
            rms_deg: self.rms().to_degrees(),
            used: self.count(),
            trimmed: self.used.len() - self.count(),
            residuals: residuals.collect(),
        }
    }

    fn residuals(&self, frame: impl Fn(usize) -> usize) -> Vec<Residual> {
        let both = self.residuals.iter().zip(&self.used).enumerate();
        both.map(|(index, (&value, &used))| Residual {
            frame: frame(index),
            value,
            used,
        })
        .collect()
    }
}

/// Fits to all items, then repeatedly to those whose residual is no outlier, until the choice stays.
fn trimmed<T>(
    count: usize,
    fit: impl Fn(&[bool]) -> Result<(T, Vec<f64>), TrackingError>,
) -> Result<Trimmed<T>, TrackingError> {
    let mut used = vec![true; count];
    let (mut fitted, mut residuals) = fit(&used)?;
    for _ in 0..PASSES {
        let middle = median(residuals.clone()).unwrap_or_default();
        let deviations = residuals.iter().map(|r| (r - middle).abs()).collect();
        let spread = PER_MAD * median(deviations).unwrap_or_default();
        let limit = middle + OUTLIER * spread.max(ROUNDING);
        let next: Vec<bool> = residuals.iter().map(|r| *r <= limit).collect();
        if next == used || next.iter().filter(|used| **used).count() < FEWEST {
            break;
        }
        used = next;
        (fitted, residuals) = fit(&used)?;
    }
    Ok(Trimmed {
        fitted,
        residuals,
        used,
    })
}

/// Finds the point that stays in place in all poses, leaving out outliers.
///
/// # Errors
/// [`TrackingError`] for fewer than 4 poses, or where the rotations do not span two axes.
pub fn pivot(poses: &Poses) -> Result<Pivot, TrackingError> {
    let all = &poses.poses;
    if all.len() < 4 {
        return Err(TrackingError::new(format!(
            "found {} valid poses; expected at least 4, in which the marker turns about its resting tip",
            all.len()
        )));
    }
    let fit = trimmed(all.len(), |used| fit_pivot(all, used))?;
    let (point, pivot, std) = fit.fitted;
    let used = fit.count();
    Ok(Pivot {
        point_mm: point.into(),
        pivot_mm: pivot.into(),
        std_mm: std.into(),
        rms_mm: fit.rms(),
        max_mm: fit.max(),
        used,
        skipped: poses.skipped,
        trimmed: all.len() - used,
        residuals: fit.residuals(|index| all[index].frame),
    })
}

/// Point, pivot and standard deviations of the point, with the residuals of all poses.
#[expect(clippy::type_complexity, reason = "three vectors and the residuals")]
fn fit_pivot(
    all: &[MarkerPose],
    used: &[bool],
) -> Result<((Vector3<f64>, Vector3<f64>, Vector3<f64>), Vec<f64>), TrackingError> {
    let kept: Vec<&MarkerPose> = kept(all, used).collect();
    let n = kept.len();
    let rotation = kept.iter().map(|pose| pose.rotation).sum::<Matrix3<f64>>() / n as f64;
    let position = kept.iter().map(|pose| pose.position).sum::<Vector3<f64>>() / n as f64;
    // The pivot eliminated: (R - mean R) p = mean t - t.
    let mut a = DMatrix::zeros(3 * n, 3);
    let mut b = DVector::zeros(3 * n);
    for (index, pose) in kept.iter().enumerate() {
        a.fixed_view_mut::<3, 3>(3 * index, 0)
            .copy_from(&(pose.rotation - rotation));
        b.fixed_rows_mut::<3>(3 * index).copy_from(&(position - pose.position));
    }
    let qr = a.qr();
    let r: Matrix3<f64> = qr.r().fixed_view::<3, 3>(0, 0).into_owned();
    let svd = r.svd(true, true);
    let span_deg = (svd.singular_values.min() / (n as f64).sqrt()).to_degrees();
    if span_deg < PIVOT_DEG || n < 4 {
        return Err(TrackingError::new(format!(
            "the marker turns by {span_deg:.2} degrees (RMS over {n} poses) across the axis about which it turns most; \
             expected at least {PIVOT_DEG}: tilt it to all sides about its resting tip"
        )));
    }
    let right = qr.q().transpose() * b;
    let right = right.fixed_rows::<3>(0).into_owned();
    let point = svd.solve(&right, 0.0).map_err(TrackingError::new)?;
    let pivot = rotation * point + position;
    let distance_mm = |pose: &MarkerPose| (pose.rotation * point + pose.position - pivot).norm();
    let squares: f64 = kept.iter().map(|pose| distance_mm(pose).powi(2)).sum();
    let variance = squares / (TRUNCATED * (3 * n - 6) as f64);
    let inverse = r.try_inverse().unwrap_or_default();
    let std = (inverse * inverse.transpose())
        .diagonal()
        .map(|v| (variance * v).sqrt());
    Ok(((point, pivot, std), all.iter().map(distance_mm).collect()))
}

/// The items that are used.
fn kept<'a, T>(all: &'a [T], used: &'a [bool]) -> impl Iterator<Item = &'a T> {
    all.iter().zip(used).filter(|(_, used)| **used).map(|(item, _)| item)
}

/// Finds the direction of the marker's frame that is held along known directions of the tracker's frame, the maximum of
/// the mean cosine, leaving out outliers.
///
/// # Errors
/// [`TrackingError`] if there is no pose, or if the directions contradict one another by more than 20 degrees.
pub fn held_direction(poses: &[(&MarkerPose, Vector3<f64>)]) -> Result<Direction, TrackingError> {
    let fit = trimmed(poses.len(), |used| {
        let along = kept(poses, used).map(|(pose, along)| pose.rotation.transpose() * along.normalize());
        let Some(direction) = along.sum::<Vector3<f64>>().try_normalize(1e-9) else {
            return Err(TrackingError::new("the poses and directions leave no mean direction"));
        };
        let angle = |(pose, along): &(&MarkerPose, Vector3<f64>)| (pose.rotation * direction).angle(along);
        Ok((direction, poses.iter().map(angle).collect()))
    })?;
    let direction = fit.of_directions(fit.fitted, |index| poses[index].0.frame);
    if direction.rms_deg > DIRECTION_DEG {
        Err(TrackingError::new(format!(
            "the direction differs from those given by {:.1} degrees RMS; expected at most {DIRECTION_DEG}: are they in the \
             frame that the transform leads to?",
            direction.rms_deg
        )))
    } else {
        Ok(direction)
    }
}

/// Direction from `hub` to `tip`, two points of an axis found by pivoting.
///
/// # Errors
/// [`TrackingError`] if the points are too close for their accuracy.
pub fn direction_between(hub: &Pivot, tip: &Pivot) -> Result<Direction, TrackingError> {
    let [from, to] = [hub, tip].map(|pivot| Vector3::from(pivot.point_mm));
    let distance_mm = (to - from).norm();
    let variance = |pivot: &Pivot| Vector3::from(pivot.std_mm).norm_squared() / 3.0;
    let rms_deg = ((variance(hub) + variance(tip)).sqrt() * 2_f64.sqrt() / distance_mm).to_degrees();
    if rms_deg.is_nan() || rms_deg > DIRECTION_DEG {
        return Err(TrackingError::new(format!(
            "the two points are {distance_mm:.2} mm apart, too close for a direction at their accuracy; expected points far apart on the shaft"
        )));
    }
    Ok(Direction {
        direction: ((to - from) / distance_mm).into(),
        rms_deg,
        used: hub.used + tip.used,
        trimmed: hub.trimmed + tip.trimmed,
        residuals: Vec::new(),
    })
}

/// Finds the axis about which an instrument is turned in place, leaving out outliers: the direction d with the least
/// change between poses, the smallest eigenvector of the sum of (I - Ri' Rj)' (I - Ri' Rj) over all pairs. Its sense is
/// that of `toward`, a vector of the marker's frame.
///
/// # Errors
/// [`TrackingError`] if the instrument turns by too little, or about no single axis.
pub fn spin(poses: &Poses, toward: &Vector3<f64>) -> Result<Direction, TrackingError> {
    let all = &poses.poses;
    // The axis, and how far poses turn across and wobble about it, degrees RMS.
    let fit = trimmed(all.len(), |used| {
        let n = used.iter().filter(|used| **used).count().max(1) as f64;
        // The sum over pairs is 2 (n^2 I - S' S) with S the sum of the rotations.
        let mean = kept(all, used).map(|pose| pose.rotation).sum::<Matrix3<f64>>() / n;
        let eigen = (Matrix3::identity() - mean.transpose() * mean).symmetric_eigen();
        let mut order = [0, 1, 2];
        order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
        let [wobble_deg, turn_deg] = [0, 1].map(|at| eigen.eigenvalues[order[at]].max(0.0).sqrt().to_degrees());
        let axis: Vector3<f64> = eigen.eigenvectors.column(order[0]).into_owned();
        let axis = if axis.dot(toward) < 0.0 { -axis } else { axis };
        let middle = (mean * axis).normalize();
        let angles = all.iter().map(|pose| (pose.rotation * axis).angle(&middle));
        Ok(((axis, wobble_deg, turn_deg), angles.collect()))
    })?;
    let (axis, wobble_deg, turn_deg) = fit.fitted;
    if turn_deg < SPIN_DEG {
        return Err(TrackingError::new(format!(
            "the instrument turns by {turn_deg:.1} degrees (RMS over {} poses) about its axis; expected at least {SPIN_DEG}",
            fit.count()
        )));
    }
    if wobble_deg > WOBBLE_DEG {
        return Err(TrackingError::new(format!(
            "no axis stays in place: the nearest one to it wobbles by {wobble_deg:.1} degrees (RMS); expected at most {WOBBLE_DEG}: \
             turn the instrument about itself in place"
        )));
    }
    Ok(fit.of_directions(axis, |index| all[index].frame))
}
