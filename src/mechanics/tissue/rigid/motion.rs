//! Rigid motions and their description in words.

use std::fmt;

use nalgebra::{DMatrix, Vector3};

/// Infinitesimal rigid motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Motion {
    /// The same displacement everywhere.
    Translation {
        /// Unit direction of the displacement.
        direction: [f64; 3],
    },
    /// Rotation about a line, with or without an advance along it.
    Rotation {
        /// Point of the line nearest to the centre of the moving part, mm.
        point_mm: [f64; 3],
        /// Unit direction of the line.
        direction: [f64; 3],
        /// Advance along the line, mm per radian.
        advance_mm: f64,
    },
}

/// Largest coefficient of an orthonormal basis that counts as zero: the square root of the tolerance that separates
/// free motions from restrained ones.
const NOTHING: f64 = 1e-4;

/// Returns the simplest motions that span the columns of a matrix of six rows (translation, then rotation about
/// `centre` times `size`): along and about the axes where possible, and linearly independent.
///
/// Elimination with the rotations first leaves pure translations below and removes their directions from the rotations.
pub(crate) fn simplest(columns: DMatrix<f64>, centre: Vector3<f64>, size: f64) -> Vec<Motion> {
    const ORDER: [usize; 6] = [3, 4, 5, 0, 1, 2];
    let mut rows = columns.transpose();
    let mut rank = 0;
    for column in ORDER {
        let Some(pivot) =
            (rank..rows.nrows()).max_by(|a, b| rows[(*a, column)].abs().total_cmp(&rows[(*b, column)].abs()))
        else {
            break;
        };
        // What rounding left of a column without a pivot would show as a motion in the rows below.
        if rows[(pivot, column)].abs() < NOTHING {
            rows.column_mut(column).rows_range_mut(rank..).fill(0.0);
            continue;
        }
        rows.swap_rows(rank, pivot);
        let scaled = rows.row(rank) / rows[(rank, column)];
        rows.row_mut(rank).copy_from(&scaled);
        for row in (0..rows.nrows()).filter(|row| *row != rank) {
            let reduced = rows.row(row) - &scaled * rows[(row, column)];
            rows.row_mut(row).copy_from(&reduced);
        }
        rank += 1;
    }
    let motion = |row: usize| {
        let part = |first_column: usize| Vector3::from_fn(|axis, _| clean(rows[(row, first_column + axis)]));
        motion(part(0), part(3) / size, centre)
    };
    (0..rank).map(motion).collect()
}

fn clean(x: f64) -> f64 {
    if x.abs() < NOTHING { 0.0 } else { x }
}

fn motion(translation: Vector3<f64>, rotation: Vector3<f64>, centre: Vector3<f64>) -> Motion {
    let turn = rotation.norm();
    if turn == 0.0 {
        return Motion::Translation {
            direction: translation.normalize().into(),
        };
    }
    let direction = rotation / turn;
    Motion::Rotation {
        point_mm: (centre + rotation.cross(&translation) / turn.powi(2)).into(),
        direction: direction.into(),
        advance_mm: translation.dot(&direction) / turn,
    }
}

impl fmt::Display for Motion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Motion::Translation { direction } => write!(f, "translation along {}", Direction(*direction)),
            Motion::Rotation {
                point_mm: [x, y, z],
                direction,
                advance_mm,
            } => {
                let largest = [x, y, z].into_iter().fold(0.0, |a: f64, b| a.max(b.abs()));
                // Decimals for four digits of the largest coordinate.
                let decimals = (3.0 - largest.log10().floor()).clamp(0.0, 12.0) as usize;
                let number = |x: f64| {
                    let text = format!("{x:.decimals$}");
                    if text.trim_matches(['-', '0', '.']).is_empty() {
                        "0".to_owned()
                    } else {
                        text
                    }
                };
                let (x, y, z) = (number(*x), number(*y), number(*z));
                write!(
                    f,
                    "rotation about the line through ({x}, {y}, {z}) along {}",
                    Direction(*direction)
                )?;
                if advance_mm.abs() > NOTHING * largest {
                    write!(f, " while advancing {advance_mm:.3} mm a radian")
                } else {
                    Ok(())
                }
            }
        }
    }
}

/// Direction, written as an axis name where possible.
struct Direction([f64; 3]);

impl fmt::Display for Direction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y, z] = self.0;
        let axis = ["x", "y", "z"]
            .into_iter()
            .zip(self.0)
            .find(|(_, x)| x.abs() > 1.0 - NOTHING * NOTHING);
        match axis {
            Some((name, _)) => f.write_str(name),
            None => write!(f, "({:.3}, {:.3}, {:.3})", x + 0.0, y + 0.0, z + 0.0),
        }
    }
}
