//! Registration of a label volume to a physical surface: a rigid and then a quadratic map from the world, the surface's
//! frame, to the volume's (Zhu et al. 2007, section 2.1, fit CT to a mannequin so).
//!
//! Both stages minimise the distances of mapped surface points from the skin of the volume along its normals (Y. Chen
//! and G. Medioni, Image and Vision Computing 10, 1992). The map leads from the world to the volume, so that slicing
//! needs no inverse.

pub mod markers;
mod resample;
pub mod skin;
pub mod surface;
impl fmt::Display for Registration {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (rigid, quadratic) = (&self.rigid, &self.quadratic);
        writeln!(
            f,
            "rigid:     RMS {:.2} mm without outliers, 95 % of all below {:.2} mm",
            rigid.rms_mm, rigid.p95_mm
        )?;
        writeln!(
            f,
            "quadratic: RMS {:.2} mm without outliers, 95 % of all below {:.2} mm, least Jacobian {:.2}",
            quadratic.rms_mm, quadratic.p95_mm, quadratic.jacobian_min
        )?;
        for landmark in &self.landmarks_mm {
            writeln!(
                f,
                "landmark {}: {:.2} mm rigid, {:.2} mm quadratic",
                landmark.name, landmark.rigid_mm, landmark.quadratic_mm
            )?;
        }
        if let Some(worst) = self.worst_target() {
            let mean = self.targets_mm.iter().map(|target| target.expected_mm).sum::<f64>();
            let mean = mean / self.targets_mm.len() as f64;
            writeln!(
                f,
                "expected error of organs: {mean:.2} mm on average, {:.2} mm at most ({})",
                worst.expected_mm, worst.name
            )?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;

use nalgebra::{
    DMatrix, DVector, Matrix3, Matrix4, Matrix6, Point3, Rotation3, SVector, UnitQuaternion, Vector3, Vector6,
};
use serde::{Deserialize, Serialize};
use std::fmt;

use super::volume::{LabelVolume, VolumeError};
use insonify_base::matrix::Rows;
pub use resample::resample;
use skin::{Foot, Skin};

/// Number of coefficients of each coordinate: 1, x, y, z, x2, y2, z2, xy, yz, zx.
const TERMS: usize = 10;
/// Maximum number of surface points used to fit; more are thinned evenly.
const MAX_POINTS: usize = 4000;
/// Least number of surface points.
const MIN_POINTS: usize = 30;
/// Share of the nearest points that the rigid stage uses.
const KEPT: f64 = 0.85;
/// Iterations of each stage, and the movement of the points that ends them, mm.
const RIGID_STEPS: usize = 100;
const QUADRATIC_STEPS: usize = 300;
const SETTLED_MM: f64 = 0.001;
/// Iterations with which each start of the rigid stage is tried.
const TRIAL_STEPS: usize = 15;
/// Expected size of the coefficients beyond the rigid map, mm: the displacement of a point on the surface of the body.
const BEND_MM: f64 = 5.0;
/// Distance within which distances of surface points from the skin are taken to err alike, mm: about that of one rib, or
/// one fold of skin, from the next.
const ALIKE_MM: f64 = 30.0;
/// Multiple of their accuracy from which landmarks pull no harder (P. J. Huber, Annals of Mathematical Statistics 35,
/// 1964).
const HUBER: f64 = 3.0;
/// Default accuracy of landmarks, mm: of a tracked stylus on a mark of the skin.
pub const LANDMARK_MM: f64 = 1.0;
/// Limit of Tukey's biweight, standard deviations (P. W. Holland and R. E. Welsch, Communications in Statistics 6,
/// 1977).
const BIWEIGHT: f64 = 4.685;
/// Least standard deviation of residuals, mm, far below that of any tracker.
const MIN_SPREAD_MM: f64 = 1e-4;
/// Spacing of the grid on which the Jacobian is checked, mm.
const CHECK_MM: f64 = 10.0;

/// A point known on both sides.
#[derive(Clone, Debug, PartialEq)]
pub struct Landmark {
    /// Name, unique in a table of landmarks.
    pub name: String,
    /// In the volume's frame, mm.
    pub volume_mm: Point3<f64>,
    /// In the surface's frame, mm.
    pub surface_mm: Point3<f64>,
}

/// A quadratic map from the world to the volume: volume = C q((world - centre) / scale).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Quadratic {
    /// Coefficients of x, y and z, mm, in the order 1, x, y, z, x2, y2, z2, xy, yz, zx.
    pub coefficients: [[f64; TERMS]; 3],
    /// Centre, world, mm.
    pub centre_mm: [f64; 3],
    /// Length by which offsets from the centre are divided, mm (above 0).
    pub scale_mm: f64,
}

fn terms(p: &Vector3<f64>) -> SVector<f64, TERMS> {
    let [x, y, z] = [p.x, p.y, p.z];
    SVector::from([1.0, x, y, z, x * x, y * y, z * z, x * y, y * z, z * x])
}

impl Rigid {
    fn rotation(&self) -> UnitQuaternion<f64> {
        let rotation = Rotation3::from_matrix_unchecked(self.matrix.0.fixed_view::<3, 3>(0, 0).into_owned());
        UnitQuaternion::from_rotation_matrix(&rotation)
    }

    /// Angle of the rotation, degrees.
    pub fn angle_deg(&self) -> f64 {
        self.rotation().angle().to_degrees()
    }

    /// Angle of the part of the rotation about the long axis of a body (z), degrees.
    pub fn turn_deg(&self) -> f64 {
        let rotation = self.rotation();
        2.0 * rotation.k.abs().atan2(rotation.w.abs()).to_degrees()
    }
}

impl Quadratic {
    /// A rigid map as a quadratic.
    fn rigid(matrix: &Matrix4<f64>, centre: Point3<f64>, scale_mm: f64) -> Self {
        let mut coefficients = [[0.0; TERMS]; 3];
        let origin = matrix.transform_point(&centre);
        for row in 0..3 {
            coefficients[row][0] = origin[row];
            for axis in 0..3 {
                coefficients[row][1 + axis] = matrix[(row, axis)] * scale_mm;
            }
        }
        Self {
            coefficients,
            centre_mm: centre.into(),
            scale_mm,
        }
    }

    fn scaled(&self, world: &Point3<f64>) -> Vector3<f64> {
        (world - Point3::from(self.centre_mm)) / self.scale_mm
    }

    /// Maps a point of the world to the volume, mm.
    pub fn map(&self, world: &Point3<f64>) -> Point3<f64> {
        let q = terms(&self.scaled(world));
        Point3::from(self.coefficients.map(|row| SVector::from(row).dot(&q)))
    }

    /// Derivative of the map.
    pub fn jacobian(&self, world: &Point3<f64>) -> Matrix3<f64> {
        let p = self.scaled(world);
        let mut jacobian = Matrix3::zeros();
        for (row, c) in self.coefficients.iter().enumerate() {
            jacobian[(row, 0)] = c[1] + 2.0 * c[4] * p.x + c[7] * p.y + c[9] * p.z;
            jacobian[(row, 1)] = c[2] + 2.0 * c[5] * p.y + c[7] * p.x + c[8] * p.z;
            jacobian[(row, 2)] = c[3] + 2.0 * c[6] * p.z + c[8] * p.y + c[9] * p.x;
        }
        jacobian / self.scale_mm
    }

    /// Point of the world that maps to a point of the volume, mm, by Newton's method from the inverse of the linear
    /// part; `None` if it does not converge.
    pub fn inverse(&self, volume: &Point3<f64>) -> Option<Point3<f64>> {
        let centre = Point3::from(self.centre_mm);
        let offset = volume - Point3::from(self.coefficients.map(|row| row[0]));
        let mut world = centre + self.jacobian(&centre).lu().solve(&offset)?;
        for _ in 0..50 {
            let step = self.jacobian(&world).lu().solve(&(self.map(&world) - volume))?;
            world -= step;
            if step.norm() < 1e-9 {
                return Some(world);
            }
        }
        None
    }

    /// Checks the numbers of a map from a file.
    ///
    /// # Errors
    /// [`VolumeError`] if a number is not finite, or the scale is not above 0.
    pub fn check(&self) -> Result<(), VolumeError> {
        let mut all = self.coefficients.iter().flatten().chain(&self.centre_mm);
        let finite = all.all(|number| number.abs() <= insonify_base::matrix::FARTHEST_MM);
        if finite && self.scale_mm > 0.0 && self.scale_mm <= insonify_base::matrix::FARTHEST_MM {
            Ok(())
        } else {
            Err(VolumeError::new(
                "a registration holds numbers beyond 1e6, or a scale that is not above 0",
            ))
        }
    }

    /// Least determinant of the Jacobian, 1 for a rigid map, over a box of the volume; an error with the place where it
    /// is not positive.
    ///
    /// # Errors
    /// [`VolumeError`] with a point of the world at which the map folds.
    pub(crate) fn least_jacobian(&self, corners: &[Point3<f64>], rigid: &Matrix4<f64>) -> Result<f64, VolumeError> {
        let back = insonify_base::matrix::inverse_rigid(rigid);
        let [low, high] = bounds(corners.iter().map(|corner| back.transform_point(corner)));
        let counts = [0, 1, 2].map(|axis| ((high[axis] - low[axis]) / CHECK_MM).ceil().clamp(1.0, 200.0) as usize);
        let mut least = f64::INFINITY;
        for k in 0..=counts[2] {
            for j in 0..=counts[1] {
                for i in 0..=counts[0] {
                    let index = [i, j, k];
                    let share = |axis: usize| index[axis] as f64 / counts[axis] as f64;
                    let point = Point3::from([0, 1, 2].map(|axis| low[axis] + (high[axis] - low[axis]) * share(axis)));
                    let jacobian = self.jacobian(&point).determinant();
                    least = least.min(jacobian);
                    if jacobian <= 0.0 {
                        let [x, y, z] = [point.x, point.y, point.z];
                        return Err(VolumeError::new(format!(
                            "the quadratic map folds the volume at ({x:.0}, {y:.0}, {z:.0}) mm of the world (Jacobian {jacobian:.3}); \
                             the surface determines it too little there: touch more points on all sides, or keep the rigid map"
                        )));
                    }
                }
            }
        }
        Ok(least)
    }
}

/// Least and largest coordinates of points.
pub fn bounds(points: impl Iterator<Item = Point3<f64>>) -> [[f64; 3]; 2] {
    let start = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
    points.fold(start, |[low, high], point| {
        [
            [0, 1, 2].map(|axis| low[axis].min(point[axis])),
            [0, 1, 2].map(|axis| high[axis].max(point[axis])),
        ]
    })
}

/// Corners of a volume's box, mm.
pub fn corners(volume: &LabelVolume) -> Vec<Point3<f64>> {
    let size = volume.size();
    let corner = |number: usize| {
        let index = [0, 1, 2].map(|axis| {
            if number >> axis & 1 == 0 {
                -0.5
            } else {
                size[axis] as f64 - 0.5
            }
        });
        volume.index_to_world().transform_point(&Point3::from(index))
    };
    (0..8).map(corner).collect()
}

/// Rigid stage of a registration.
#[derive(Clone, Debug, Serialize)]
pub struct Rigid {
    /// Transform from the world to the volume.
    pub matrix: Rows,
    /// Root mean square distance of surface points that are no outliers from the skin, mm.
    pub rms_mm: f64,
    /// Distance below which 95 % of all surface points lie, mm.
    pub p95_mm: f64,
}

/// Quadratic stage of a registration.
#[derive(Clone, Debug, Serialize)]
pub struct Fitted {
    /// Map from the world to the volume.
    #[serde(flatten)]
    pub map: Quadratic,
    /// Root mean square distance of surface points that are no outliers from the skin, for the degrees of freedom of
    /// the map, mm.
    pub rms_mm: f64,
    /// Distance below which 95 % of all surface points lie, mm.
    pub p95_mm: f64,
    /// Least determinant of the Jacobian on the volume.
    pub jacobian_min: f64,
}

/// Distance of a landmark after each stage.
#[derive(Clone, Debug, Serialize)]
pub struct LandmarkError {
    /// Name of the landmark.
    pub name: String,
    /// After the rigid stage, mm.
    pub rigid_mm: f64,
    /// After the quadratic stage, mm.
    pub quadratic_mm: f64,
}

/// Accuracy of a registration at a point of the volume.
#[derive(Clone, Debug, Serialize)]
pub struct TargetError {
    /// Name of what lies there.
    pub name: String,
    /// Expected distance (root mean square) between where the map puts the point and where it is, mm.
    pub expected_mm: f64,
}

/// Distance from a surface point within which skin counts as covered, mm.
const COVERED_MM: f64 = 10.0;

/// Registration of surface points to the skin of a volume, with its accuracy.
#[derive(Clone, Debug, Serialize)]
pub struct Registration {
    /// Rigid stage.
    pub rigid: Rigid,
    /// Quadratic stage.
    pub quadratic: Fitted,
    /// Share of the skin within 10 mm of a surface point, after the quadratic stage.
    pub covered: f64,
    /// Number of surface points beyond the end of the skin, such as the legs in a scan of a body that is cut at the
    /// hip; not used.
    pub beyond: usize,
    /// Distances of the landmarks.
    pub landmarks_mm: Vec<LandmarkError>,
    /// Expected errors of the targets.
    pub targets_mm: Vec<TargetError>,
    /// Surface points in the volume's frame after the quadratic stage, with their distances from the skin, mm.
    #[serde(skip)]
    pub mapped: Vec<(Point3<f64>, f64)>,
}

impl Registration {
    /// The target whose expected error is largest.
    pub fn worst_target(&self) -> Option<&TargetError> {
        let order = |a: &&TargetError, b: &&TargetError| a.expected_mm.total_cmp(&b.expected_mm);
        self.targets_mm.iter().max_by(order)
    }
}

/// Points that are known on both sides.
#[derive(Clone, Copy, Debug)]
pub struct Known<'a> {
    /// Pairs of points.
    pub landmarks: &'a [Landmark],
    /// Standard deviation of each coordinate of a pair's distance, mm (above 0).
    pub accuracy_mm: f64,
}

/// Registers surface points (world, mm) to the skin of a volume with the given corners. Expected errors are told for
/// `targets`, named points of the volume.
///
/// # Errors
/// [`VolumeError`] for too few points or landmarks, or where the quadratic map folds the volume.
pub fn register(
    surface: &[Point3<f64>],
    skin: &Skin,
    corners: &[Point3<f64>],
    known: Known<'_>,
    targets: &[(String, Point3<f64>)],
) -> Result<Registration, VolumeError> {
    let landmarks = known.landmarks;
    if surface.len() < MIN_POINTS {
        let text = format!(
            "{} surface points; expected at least {MIN_POINTS}, spread over the surface",
            surface.len()
        );
        return Err(VolumeError::new(text));
    }
    let thinned: Vec<Point3<f64>> = surface
        .iter()
        .step_by(1 + surface.len() / MAX_POINTS)
        .copied()
        .collect();
    let starts = match landmarks {
        [] => starts(&thinned, skin),
        _ => vec![kabsch(landmarks)?],
    };
    // A few steps tell the right start from those upside down; only the best is iterated to its end.
    let trials = starts
        .into_iter()
        .map(|start| rigid(&thinned, skin, start, TRIAL_STEPS));
    let best = trials.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(matrix, _)| matrix);
    let (matrix, _) = rigid(&thinned, skin, best.unwrap_or_else(Matrix4::identity), RIGID_STEPS);
    let fit = quadratic(&thinned, skin, &matrix, known);
    let map = &fit.map;
    let jacobian_min = map.least_jacobian(corners, &matrix)?;
    let distances = |points: &mut dyn Iterator<Item = Point3<f64>>| -> Vec<f64> {
        points.map(|point| skin.foot(&point).distance_mm()).collect()
    };
    let rigidly = distances(&mut surface.iter().map(|point| matrix.transform_point(point)));
    let mapped: Vec<Point3<f64>> = surface.iter().map(|point| map.map(point)).collect();
    let finally = distances(&mut mapped.iter().copied());
    let landmarks_mm = landmarks.iter().map(|landmark| LandmarkError {
        name: landmark.name.clone(),
        rigid_mm: (matrix.transform_point(&landmark.surface_mm) - landmark.volume_mm).norm(),
        quadratic_mm: (map.map(&landmark.surface_mm) - landmark.volume_mm).norm(),
    });
    let ([rigid_rms, rigid_p95], [rms_mm, p95_mm]) = (spread(&rigidly), spread(&finally));
    let count = thinned.len() as f64;
    // The map was fitted to these points: their distances are too small by the degrees of freedom it took.
    let rms_mm = rms_mm * (count / (count - fit.free).max(1.0)).sqrt();
    let targets_mm = targets.iter().map(|(name, target)| {
        let world = map.inverse(target);
        let world = world.unwrap_or_else(|| insonify_base::matrix::inverse_rigid(&matrix).transform_point(target));
        TargetError {
            name: name.clone(),
            expected_mm: fit.expected_mm(&world),
        }
    });
    let targets_mm = targets_mm.collect();
    Ok(Registration {
        rigid: Rigid {
            matrix: Rows(matrix),
            rms_mm: rigid_rms,
            p95_mm: rigid_p95,
        },
        covered: skin.covered(&mapped, COVERED_MM),
        beyond: mapped.iter().filter(|point| skin.foot(point).beyond).count(),
        landmarks_mm: landmarks_mm.collect(),
        targets_mm,
        quadratic: Fitted {
            map: fit.map,
            rms_mm,
            p95_mm,
            jacobian_min,
        },
        mapped: mapped.into_iter().zip(finally).collect(),
    })
}

/// Doubt of the unit of surface points (mm) that span about as much as the skin would in another unit, or so little of it
/// that they determine no map, and the value of `--unit` that would fit.
pub fn unit_doubt(surface: &[Point3<f64>], skin: &Skin) -> Option<(String, Option<&'static str>)> {
    /// Units by their length, mm, and value of `--unit`; deviation of the logarithm of the ratio that is the same body.
    const UNITS: [(&str, f64, Option<&str>); 3] = [
        ("centimetres", 10.0, Some("cm")),
        ("inches", 25.4, None),
        ("metres", 1000.0, Some("m")),
    ];
    const SAME: f64 = 0.2;
    /// Span of points below which they are a part of a body only in a larger unit, mm.
    const PART_MM: f64 = 40.0;
    if surface.len() < MIN_POINTS {
        return None;
    }
    let longest = |points: &[Point3<f64>]| {
        let [low, high] = bounds(points.iter().copied());
        (0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f64::max)
    };
    let [surface_mm, skin_mm] = [longest(surface), longest(skin.points())];
    let ratio = skin_mm / surface_mm;
    let whole = UNITS.into_iter().find(|(_, mm, _)| (ratio / mm).ln().abs() < SAME);
    let part = (surface_mm < PART_MM && ratio > UNITS[0].1).then_some(UNITS[0]);
    let (unit, mm, flag) = whole.or(part)?;
    let text = format!(
        "the surface is {surface_mm:.1} mm long beside a body of {skin_mm:.0} mm: in {unit} it would be {:.0} mm",
        surface_mm * mm
    );
    Some((text, flag))
}

/// RMS without outliers, and 95th percentile, of distances.
fn spread(distances: &[f64]) -> [f64; 2] {
    let mut sorted = distances.to_vec();
    sorted.sort_by(f64::total_cmp);
    let limit = BIWEIGHT * scale(&sorted);
    let kept: Vec<f64> = sorted.iter().copied().filter(|distance| *distance <= limit).collect();
    let rms = (kept.iter().map(|d| d * d).sum::<f64>() / kept.len().max(1) as f64).sqrt();
    [rms, sorted[(sorted.len() * 19 / 20).min(sorted.len() - 1)]]
}

/// Standard deviation of residuals from the median of their ascending absolute values.
fn scale(ascending: &[f64]) -> f64 {
    (1.4826 * ascending[ascending.len() / 2]).max(MIN_SPREAD_MM)
}

/// Rigid transform between landmarks (W. Kabsch, Acta Crystallographica A 32, 1976).
fn kabsch(landmarks: &[Landmark]) -> Result<Matrix4<f64>, VolumeError> {
    let n = landmarks.len() as f64;
    let mean = |position_mm: fn(&Landmark) -> Point3<f64>| {
        landmarks
            .iter()
            .map(|landmark| position_mm(landmark).coords)
            .sum::<Vector3<f64>>()
            / n
    };
    let (from, to) = (
        mean(|landmark| landmark.surface_mm),
        mean(|landmark| landmark.volume_mm),
    );
    let mut covariance = Matrix3::zeros();
    for landmark in landmarks {
        covariance += (landmark.volume_mm.coords - to) * (landmark.surface_mm.coords - from).transpose();
    }
    let svd = covariance.svd(true, true);
    let mut values: Vec<f64> = svd.singular_values.iter().copied().collect();
    values.sort_by(|a, b| b.total_cmp(a));
    let (Some(u), Some(v_t), true) = (svd.u, svd.v_t, landmarks.len() >= 3 && values[1] > 1.0) else {
        let text = format!(
            "{} landmarks; expected at least 3 that do not lie on a line",
            landmarks.len()
        );
        return Err(VolumeError::new(text));
    };
    let mut flip = Matrix3::identity();
    // The smallest singular value takes the sign that makes a rotation.
    let least = svd.singular_values.imin();
    flip[(least, least)] = (u * v_t).determinant().signum();
    let rotation = u * flip * v_t;
    Ok(placed(rotation, from, to))
}

fn placed(rotation: Matrix3<f64>, from: Vector3<f64>, to: Vector3<f64>) -> Matrix4<f64> {
    let mut matrix = rotation.to_homogeneous();
    matrix.fixed_view_mut::<3, 1>(0, 3).copy_from(&(to - rotation * from));
    matrix
}

/// Starts of the rigid stage: the axes of both frames, and the four ways in which the principal axes match.
fn starts(surface: &[Point3<f64>], skin: &Skin) -> Vec<Matrix4<f64>> {
    let axes = |points: &[Point3<f64>]| {
        let mean = points.iter().map(|point| point.coords).sum::<Vector3<f64>>() / points.len() as f64;
        let covariance: Matrix3<f64> = points
            .iter()
            .map(|point| (point.coords - mean) * (point.coords - mean).transpose())
            .sum();
        let eigen = covariance.symmetric_eigen();
        let mut order = [0, 1, 2];
        order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
        let [x, y] = [order[2], order[1]].map(|column| eigen.eigenvectors.column(column).into_owned());
        (mean, Matrix3::from_columns(&[x, y, x.cross(&y)]))
    };
    let ((from, of_surface), (to, of_skin)) = (axes(surface), axes(skin.points()));
    let signs = [[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]];
    let poses =
        signs.map(|[x, y]| of_skin * Matrix3::from_diagonal(&Vector3::new(x, y, x * y)) * of_surface.transpose());
    let all = std::iter::once(Matrix3::identity()).chain(poses);
    all.map(|rotation| placed(rotation, from, to)).collect()
}

/// Trimmed point-to-plane iteration; the transform with the mean square of the kept distances.
fn rigid(surface: &[Point3<f64>], skin: &Skin, start: Matrix4<f64>, steps: usize) -> (Matrix4<f64>, f64) {
    let mut matrix = start;
    let kept = (KEPT * surface.len() as f64) as usize;
    let mut error = f64::INFINITY;
    for _ in 0..steps {
        let mut pairs: Vec<(Point3<f64>, Foot)> = surface
            .iter()
            .map(|point| {
                let point = matrix.transform_point(point);
                (point, skin.foot(&point))
            })
            .collect();
        pairs.sort_by(|a, b| a.1.distance_mm().total_cmp(&b.1.distance_mm()));
        pairs.truncate(kept);
        error = pairs.iter().map(|pair| pair.1.distance_mm().powi(2)).sum::<f64>() / kept as f64;
        let centre = pairs.iter().map(|pair| pair.0.coords).sum::<Vector3<f64>>() / kept as f64;
        let (mut normal, mut gradient) = (Matrix6::zeros(), Vector6::zeros());
        for (point, foot) in &pairs {
            let n = foot.normal;
            let turn = (point.coords - centre).cross(&n);
            let row = Vector6::new(turn.x, turn.y, turn.z, n.x, n.y, n.z);
            normal += row * row.transpose();
            gradient += row * foot.height_mm;
        }
        // A surface of revolution leaves a turn open: the least change is taken.
        let Ok(step) = normal.svd(true, true).solve(&gradient, 1e-9 * kept as f64) else {
            break;
        };
        let rotation = Rotation3::new(-step.fixed_rows::<3>(0).into_owned());
        let turned = placed(*rotation.matrix(), centre, centre - step.fixed_rows::<3>(3));
        matrix = turned * matrix;
        let reach = pairs
            .iter()
            .map(|pair| (pair.0.coords - centre).norm())
            .fold(0.0, f64::max);
        if step.fixed_rows::<3>(0).norm() * reach + step.fixed_rows::<3>(3).norm() < SETTLED_MM {
            break;
        }
    }
    (matrix, error)
}

/// A fitted quadratic map.
struct QuadraticFit {
    map: Quadratic,
    /// Degrees of freedom that the prior leaves it.
    free: f64,
    /// Covariance of the coefficients, mm2.
    covariance: DMatrix<f64>,
}

impl QuadraticFit {
    /// Standard deviation of where a point of the world is mapped to, in space, mm.
    fn expected_mm(&self, world: &Point3<f64>) -> f64 {
        let q = terms(&self.map.scaled(world));
        let variance = |axis: usize| {
            let block = self.covariance.fixed_view::<TERMS, TERMS>(axis * TERMS, axis * TERMS);
            q.dot(&(block * q))
        };
        (0..3).map(variance).sum::<f64>().max(0.0).sqrt()
    }
}

/// Normal equations of the quadratic map: the square matrix and the right side.
#[derive(Clone)]
struct NormalEquations(DMatrix<f64>, DVector<f64>);

impl NormalEquations {
    fn zeros() -> Self {
        Self(DMatrix::zeros(3 * TERMS, 3 * TERMS), DVector::zeros(3 * TERMS))
    }

    /// Adds the distance of a point, with terms `q`, along a direction.
    fn add(&mut self, q: &SVector<f64, TERMS>, direction: &Vector3<f64>, distance_mm: f64, weight: f64) {
        let mut row = SVector::<f64, { 3 * TERMS }>::zeros();
        for axis in 0..3 {
            row.fixed_rows_mut::<TERMS>(axis * TERMS)
                .copy_from(&(q * direction[axis]));
        }
        self.0.ger(weight, &row, &row, 1.0);
        self.1.axpy(-weight * distance_mm, &row, 1.0);
    }

    /// Pulls a map towards a rigid one. Shifts are free.
    fn hold(&mut self, map: &Quadratic, rigid: &Quadratic, stiffness: f64) {
        for (axis, (row, start)) in map.coefficients.iter().zip(&rigid.coefficients).enumerate() {
            for term in 0..TERMS {
                let weight = if term == 0 { 1e-9 } else { stiffness };
                let unknown = axis * TERMS + term;
                self.0[(unknown, unknown)] += weight;
                self.1[unknown] -= weight * (row[term] - start[term]);
            }
        }
    }
}

/// Number of points for each cube of [`ALIKE_MM`] that has some: as many tell what one would, as far as the skin
/// deviates from a quadratic map.
fn alike(surface: &[Point3<f64>]) -> f64 {
    let cube = |point: &Point3<f64>| point.coords.map(|mm| (mm / ALIKE_MM).floor() as i64);
    let cubes: std::collections::BTreeSet<[i64; 3]> = surface.iter().map(|point| cube(point).into()).collect();
    surface.len() as f64 / cubes.len().max(1) as f64
}

/// Robust point-to-plane fit of the quadratic map, its second order and its strain held back by what is expected of
/// bodies, the less the smaller the residuals. Landmarks count as points in space with their accuracy.
fn quadratic(surface: &[Point3<f64>], skin: &Skin, rigid: &Matrix4<f64>, known: Known<'_>) -> QuadraticFit {
    let n = surface.len() as f64;
    let centre = Point3::from(surface.iter().map(|point| point.coords).sum::<Vector3<f64>>() / n);
    let radius = surface.iter().map(|point| (point - centre).norm()).fold(1.0, f64::max);
    let start = Quadratic::rigid(rigid, centre, radius);
    let alike = alike(surface);
    let mut fit = QuadraticFit {
        map: start.clone(),
        free: 0.0,
        covariance: DMatrix::identity(3 * TERMS, 3 * TERMS) * BEND_MM.powi(2),
    };
    let mut stiffness = n;
    for _ in 0..QUADRATIC_STEPS {
        let map = &fit.map;
        let pairs: Vec<_> = surface
            .iter()
            .map(|point| (terms(&map.scaled(point)), skin.foot(&map.map(point))))
            .filter(|(_, foot)| !foot.beyond)
            .collect();
        let mut sizes: Vec<f64> = pairs.iter().map(|(_, foot)| foot.distance_mm()).collect();
        sizes.sort_by(f64::total_cmp);
        if sizes.len() < MIN_POINTS {
            break;
        }
        // Of n points, n - free remain to estimate the noise.
        let n = sizes.len() as f64;
        let sigma = scale(&sizes) * (n / (n - fit.free).max(1.0)).sqrt();
        let mut of_surface = NormalEquations::zeros();
        for (q, foot) in &pairs {
            let weight = 1.0 - (foot.height_mm / (BIWEIGHT * sigma)).powi(2);
            if weight > 0.0 {
                of_surface.add(q, &foot.normal, foot.height_mm, weight * weight);
            }
        }
        // Points that err alike would outweigh any landmark by their number.
        let accuracy = alike * (sigma / known.accuracy_mm).powi(2);
        let mut of_landmarks = NormalEquations::zeros();
        for landmark in known.landmarks {
            let q = terms(&map.scaled(&landmark.surface_mm));
            let offset = map.map(&landmark.surface_mm) - landmark.volume_mm;
            let weight = accuracy * (HUBER * known.accuracy_mm / offset.norm()).min(1.0);
            for axis in 0..3 {
                of_landmarks.add(&q, &Vector3::ith(axis, 1.0), offset[axis], weight);
            }
        }
        // The map starts stiff and is freed by halves, so that early feet, which are far off, cannot bend it.
        let prior = (sigma / BEND_MM).powi(2);
        stiffness = (stiffness / 2.0).max(prior);
        let mut all = NormalEquations(&of_surface.0 + &of_landmarks.0, &of_surface.1 + &of_landmarks.1);
        all.hold(map, &start, stiffness);
        let NormalEquations(normal, right) = all;
        let Some(factor) = normal.cholesky() else { break };
        let step = factor.solve(&right);
        // Degrees of freedom that the prior leaves: the trace of the influence matrix.
        let inverse = factor.inverse();
        let bound = |unknown: usize| {
            if unknown.is_multiple_of(TERMS) {
                0.0
            } else {
                stiffness * inverse[(unknown, unknown)]
            }
        };
        fit.free = (0..3 * TERMS).map(|unknown| 1.0 - bound(unknown)).sum();
        for (axis, row) in fit.map.coefficients.iter_mut().enumerate() {
            for (term, coefficient) in row.iter_mut().enumerate() {
                *coefficient += step[axis * TERMS + term];
            }
        }
        let mut precision = NormalEquations((of_surface.0 + of_landmarks.0) / alike, right);
        precision.hold(&start, &start, prior);
        if let Some(factor) = precision.0.cholesky() {
            fit.covariance = factor.inverse() * sigma.powi(2);
        }
        if step.norm() < SETTLED_MM && stiffness <= prior {
            break;
        }
    }
    fit
}
