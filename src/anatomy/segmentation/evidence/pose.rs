//! How a body lies in a file: the turn, size and place by which its organs lie where those of an adult do.

use nalgebra::{Matrix3, Matrix4, Rotation3, SVD, Vector3, Vector4};

use super::super::extent::Extents;
use super::Named;

/// Standard deviation of an organ's place, mm in an adult: twice that between the adults of the table.
const SPREAD_MM: f64 = 30.0;
/// Factor on that deviation for an organ that the edge of the scan cuts.
const CUT_SPREAD: f64 = 1.5;
/// Distance from which an organ is elsewhere, in standard deviations.
const ELSEWHERE: f64 = 3.0;
/// Least evidence of a place, so that one organ elsewhere does not outweigh all others.
const LEAST: f64 = -4.0;
/// Sizes of patients relative to an adult, from newborns to large adults, and the weight of an adult's size among the
/// squared distances of organs, mm^2.
const SIZES: [f64; 2] = [0.3, 1.35];
const SIZE_PRIOR_MM2: f64 = 3600.0;
/// Cost of an unlikely size, by the square of its logarithm.
const SIZE_COST: f64 = 2.0;
/// Costs of a body that is tilted from the axes of the file, and of one that is turned or mirrored.
const TILTED: f64 = -1.5;
const TURNED: f64 = -3.0;
/// Angle from which a body is turned rather than tilted, degrees.
const TILT_DEG: f64 = 45.0;
/// Norm of the difference below which two turns are the same.
const SAME_TURN: f64 = 1e-3;
/// Number of whole organs from which a turn is sought.
const TURN_ORGANS: usize = 5;
/// Rounds in which organs elsewhere lose weight.
const ROUNDS: usize = 8;
/// Evidence per direction of a place, and numbers of directions that size and position, and a turn, take to fit.
const DIRECTION: f64 = 1.0 / 3.0;
const FREE: f64 = 4.0;
const FREE_TURN: f64 = 3.0;

/// An organ's place in the table and in the file.
struct Landmark {
    label: usize,
    expected_mm: Vector3<f64>,
    any_height: bool,
    middle_mm: Vector3<f64>,
    /// Directions along which the edge of the scan cuts the organ.
    cut: Vec<Vector3<f64>>,
}

/// How a body lies in a file.
pub(super) struct Pose {
    /// Turn from the body's axes (left, back, up) to the file's; a reflection in a mirrored file.
    turn: Matrix3<f64>,
    size: f64,
    offset_mm: Vector3<f64>,
    /// Sum of the evidence; about the logarithm of a likelihood.
    pub score: f64,
    /// Organs with evidence of their place, and those elsewhere, with their distance, mm.
    pub sound: Vec<usize>,
    pub elsewhere: Vec<(usize, f64)>,
    /// Number of organs with a place.
    pub count: usize,
}

impl Pose {
    /// The likeliest pose of a body. Lengths of the file are too large by the factor `scale`.
    pub(super) fn of<'a>(named: impl Iterator<Item = &'a Named>, extents: &Extents, scale: f64) -> Self {
        let landmarks: Vec<Landmark> = named
            .filter_map(|named| {
                let place = named.place?;
                let extent = &extents.labels[named.label];
                let is_cut = |axis: &usize| {
                    let [first, last] = extent.voxels[*axis];
                    first == 0 || last + 1 == extents.size[*axis]
                };
                Some(Landmark {
                    label: named.label,
                    expected_mm: place.mm,
                    any_height: place.any_height,
                    middle_mm: extent.middle_mm / scale,
                    cut: (0..3).filter(is_cut).map(|axis| extents.directions[axis]).collect(),
                })
            })
            .collect();
        let straight = Self::fitted(Matrix3::identity(), &landmarks);
        let by_organs = [1.0, -1.0].into_iter().filter_map(|sign| turn(&landmarks, sign));
        by_organs
            .chain(along_grid(&extents.directions))
            .map(|turn| Self::fitted(turn, &landmarks))
            .filter(|turned| turned.score > 0.0)
            .fold(straight, |best, next| if next.score > best.score { next } else { best })
    }

    /// Finds size and place of a body of a turn. Organs elsewhere count little.
    fn fitted(turn: Matrix3<f64>, landmarks: &[Landmark]) -> Self {
        let mut pose = Self {
            turn,
            size: 1.0,
            offset_mm: Vector3::zeros(),
            score: 0.0,
            sound: Vec::new(),
            elsewhere: Vec::new(),
            count: landmarks.len(),
        };
        let mut weights = vec![1.0; landmarks.len()];
        let projectors: Vec<Matrix3<f64>> = landmarks.iter().map(|landmark| landmark.projector(&turn)).collect();
        for _ in 0..ROUNDS {
            pose.solve(landmarks, &projectors, &weights);
            for ((weight, landmark), projector) in weights.iter_mut().zip(landmarks).zip(&projectors) {
                let far = pose.deviation(landmark, projector);
                *weight = (1.0 + 0.5 * far * far).powi(-2);
            }
        }
        let is_straight = turn == Matrix3::identity();
        let free = FREE + if is_straight { 0.0 } else { FREE_TURN };
        pose.score = -SIZE_COST * pose.size.ln().powi(2) - DIRECTION * free;
        if !is_straight {
            pose.score += if pose.is_upright() { TILTED } else { TURNED };
        }
        for (landmark, projector) in landmarks.iter().zip(&projectors) {
            let far = pose.deviation(landmark, projector);
            let evidence = (DIRECTION * projector.trace() - 0.5 * far * far).max(LEAST);
            pose.score += evidence;
            if evidence > 0.0 {
                pose.sound.push(landmark.label);
            }
            if far > ELSEWHERE {
                pose.elsewhere
                    .push((landmark.label, pose.distance_mm(landmark, projector)));
            }
        }
        pose
    }

    /// Least squares of size and place.
    fn solve(&mut self, landmarks: &[Landmark], projectors: &[Matrix3<f64>], weights: &[f64]) {
        let mut normal = Matrix4::from_diagonal(&Vector4::new(1e-3, 1e-3, 1e-3, SIZE_PRIOR_MM2));
        let mut right = Vector4::new(0.0, 0.0, 0.0, SIZE_PRIOR_MM2);
        for ((landmark, projector), weight) in landmarks.iter().zip(projectors).zip(weights) {
            let place = projector * self.turn * landmark.expected_mm;
            let middle = projector * landmark.middle_mm;
            let columns = [0, 1, 2].map(|axis| projector.column(axis).into_owned());
            for row in 0..3 {
                for column in 0..3 {
                    normal[(row, column)] += weight * projector[(row, column)];
                }
                normal[(row, 3)] += weight * columns[row].dot(&place);
                normal[(3, row)] += weight * columns[row].dot(&place);
                right[row] += weight * columns[row].dot(&middle);
            }
            normal[(3, 3)] += weight * place.norm_squared();
            right[3] += weight * place.dot(&middle);
        }
        let Some(solution) = normal.lu().solve(&right) else {
            return;
        };
        self.size = solution[3].clamp(SIZES[0], SIZES[1]);
        let offset = right.xyz() - normal.fixed_view::<3, 1>(0, 3) * self.size;
        let block = normal.fixed_view::<3, 3>(0, 0).into_owned();
        self.offset_mm = block.lu().solve(&offset).unwrap_or(self.offset_mm);
    }

    fn distance_mm(&self, landmark: &Landmark, projector: &Matrix3<f64>) -> f64 {
        let expected = self.size * (self.turn * landmark.expected_mm) + self.offset_mm;
        (projector * (landmark.middle_mm - expected)).norm()
    }

    /// Size of the body by that of an adult; of few organs, that of an adult.
    pub(super) fn size(&self) -> f64 {
        if self.count < super::PLACED { 1.0 } else { self.size }
    }

    /// Distance in standard deviations.
    fn deviation(&self, landmark: &Landmark, projector: &Matrix3<f64>) -> f64 {
        let spread = if landmark.cut.is_empty() { 1.0 } else { CUT_SPREAD };
        self.distance_mm(landmark, projector) / (SPREAD_MM * spread * self.size)
    }

    pub(super) fn is_mirrored(&self) -> bool {
        self.turn.determinant() < 0.0
    }

    /// Axes of which one seems to be in the place of the other.
    pub(super) fn exchanged(&self) -> Option<&'static str> {
        const AXES: [([usize; 3], &str); 3] = [([1, 0, 2], "x and y"), ([2, 1, 0], "x and z"), ([0, 2, 1], "y and z")];
        let nearest = [0, 1, 2].map(|axis| self.turn.column(axis).iamax());
        let is_such = |(order, _): &&([usize; 3], &str)| self.is_mirrored() && *order == nearest;
        AXES.iter().find(is_such).map(|(_, axes)| *axes)
    }

    /// Angle between the axes of the body and those of the file; of a mirrored file, after it is mirrored back.
    pub(super) fn angle_deg(&self) -> f64 {
        let mirror = Matrix3::from_diagonal(&Vector3::new(if self.is_mirrored() { -1.0 } else { 1.0 }, 1.0, 1.0));
        Rotation3::from_matrix_unchecked(self.turn * mirror)
            .angle()
            .to_degrees()
    }

    /// Whether the body lies along the axes of the file, or nearly.
    pub(super) fn is_upright(&self) -> bool {
        !self.is_mirrored() && self.angle_deg() <= TILT_DEG
    }

    /// Turn from the file to the axes of the body; `None` if they are the same.
    pub(super) fn upright(&self) -> Option<Matrix3<f64>> {
        (self.turn != Matrix3::identity()).then(|| self.turn.transpose())
    }
}

impl Landmark {
    /// Projection onto the directions in which the organ's place is known.
    fn projector(&self, turn: &Matrix3<f64>) -> Matrix3<f64> {
        let height = self.any_height.then(|| turn.column(2).into_owned());
        let mut projector = Matrix3::identity();
        for direction in self.cut.iter().copied().chain(height) {
            let rest = projector * direction;
            if rest.norm() > 0.1 {
                let unit = rest.normalize();
                projector -= unit * unit.transpose();
            }
        }
        projector
    }
}

/// Turns by which the axes of a body lie along those of the grid, in which most scans are made.
fn along_grid(directions: &[Vector3<f64>; 3]) -> Vec<Matrix3<f64>> {
    const ORDERS: [[usize; 3]; 6] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
    let SVD { u, v_t, .. } = Matrix3::from_columns(directions).svd(true, true);
    let (Some(u), Some(v_t)) = (u, v_t) else {
        return Vec::new();
    };
    let grid = u * v_t;
    let turns = ORDERS.iter().flat_map(|order| {
        (0..8).map(move |signs| {
            let sign = |axis: usize| if signs >> axis & 1 == 0 { 1.0 } else { -1.0 };
            Matrix3::from_columns(&[0, 1, 2].map(|axis| grid.column(order[axis]) * sign(axis)))
        })
    });
    turns
        .filter(|turn| (turn - Matrix3::identity()).norm() > SAME_TURN)
        .collect()
}

/// Turn that brings the places of the table nearest to those of whole organs, with this determinant.
fn turn(landmarks: &[Landmark], sign: f64) -> Option<Matrix3<f64>> {
    let whole: Vec<&Landmark> = landmarks
        .iter()
        .filter(|landmark| landmark.cut.is_empty() && !landmark.any_height)
        .collect();
    if whole.len() < TURN_ORGANS {
        return None;
    }
    let mut weights = vec![1.0; whole.len()];
    let mut turn = Matrix3::identity();
    for _ in 0..ROUNDS {
        let total: f64 = weights.iter().sum();
        let mean = |of: fn(&Landmark) -> Vector3<f64>| {
            let sum = whole
                .iter()
                .zip(&weights)
                .map(|(landmark, weight)| of(landmark) * *weight);
            sum.sum::<Vector3<f64>>() / total
        };
        let [expected, middle] = [
            mean(|landmark| landmark.expected_mm),
            mean(|landmark| landmark.middle_mm),
        ];
        let (mut covariance, mut squares) = (Matrix3::zeros(), 0.0);
        for (landmark, weight) in whole.iter().zip(&weights) {
            let place = landmark.expected_mm - expected;
            covariance += (landmark.middle_mm - middle) * place.transpose() * *weight;
            squares += weight * place.norm_squared();
        }
        let SVD {
            u,
            v_t,
            singular_values,
            ..
        } = covariance.svd(true, true);
        let (u, v_t) = (u?, v_t?);
        let last = sign * (u * v_t).determinant().signum();
        let signs = Vector3::new(1.0, 1.0, last);
        turn = u * Matrix3::from_diagonal(&signs) * v_t;
        let size = (singular_values.dot(&signs) / squares).clamp(SIZES[0], SIZES[1]);
        for (weight, landmark) in weights.iter_mut().zip(&whole) {
            let expected = size * (turn * (landmark.expected_mm - expected)) + middle;
            let far = (landmark.middle_mm - expected).norm() / (SPREAD_MM * size);
            *weight = (1.0 + 0.5 * far * far).powi(-2);
        }
    }
    turn.iter().all(|value| value.is_finite()).then_some(turn)
}
