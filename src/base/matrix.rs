//! Matrix notation in files, and rigid transforms.

use std::borrow::Cow;
use std::fmt;

use nalgebra::{Matrix3, Matrix4, Vector3};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{Deserializer, SeqAccess, Visitor};
use serde::{Deserialize, Serialize, Serializer};

/// A 4 x 4 transform on column vectors as written in a file: four rows of four numbers, sixteen numbers row by row, or
/// a string of sixteen numbers as PLUS writes them. The numbers are not validated: see [`rigid`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rows(pub Matrix4<f64>);

/// Largest error of a rotation's entries that is corrected: tracked rotations are orthonormal to a few 1e-4
/// (`Prostate10_tracker` of PlusLibData: 3e-4), rounded ones to a few 1e-3.
const RIGID_TOLERANCE: f64 = 5e-3;

/// Error of the products of a rotation's columns that is left as it is: that of rounding.
const ROUNDING: f64 = 1e-14;

/// Largest translation of a rigid transform along an axis, mm: a kilometre, so that later products cannot overflow.
pub const FARTHEST_MM: f64 = 1e6;

/// Checks that a matrix is an affine transform: finite, with the last row 0, 0, 0, 1. The error says what is wrong.
pub fn affine(matrix: &Matrix4<f64>) -> Result<(), String> {
    for row in 0..4 {
        for column in 0..4 {
            let entry = matrix[(row, column)];
            if !entry.is_finite() {
                return Err(format!(
                    "row {row}, column {column} is {entry}; expected a finite number"
                ));
            }
        }
    }
    let last = [0, 1, 2, 3].map(|column| matrix[(3, column)]);
    let expected = [0.0, 0.0, 0.0, 1.0];
    if last
        .iter()
        .zip(expected)
        .any(|(entry, expected)| (entry - expected).abs() > 1e-6)
    {
        let last_column = [0, 1, 2, 3].map(|row| matrix[(row, 3)]);
        let hint = if last_column == expected {
            ": is the matrix transposed (row-major?), its translation in the last row"
        } else {
            ""
        };
        return Err(format!("the last row is {last:?}; expected [0, 0, 0, 1]{hint}"));
    }
    Ok(())
}

/// Returns the rigid transform nearest to a matrix: its 3 x 3 part is replaced by the rotation of its polar
/// decomposition, unless it is a rotation to within rounding. An error, which says what is wrong, if that changes an
/// entry by more than 0.005. Poses in files and in calls are checked by this function. It allocates only for an error.
pub fn rigid(matrix: &Matrix4<f64>) -> Result<Matrix4<f64>, String> {
    affine(matrix)?;
    let position = Vector3::from([0, 1, 2].map(|row| matrix[(row, 3)]));
    if position.amax() > FARTHEST_MM {
        let position = <[f64; 3]>::from(position);
        return Err(format!(
            "the position {position:?} mm is farther than 1e6 mm from the origin"
        ));
    }
    let axes = matrix.fixed_view::<3, 3>(0, 0).into_owned();
    let rotation = nearest_rotation(&axes)?;
    let mut rigid = rotation.to_homogeneous();
    rigid.fixed_view_mut::<3, 1>(0, 3).copy_from(&position);
    Ok(rigid)
}

fn nearest_rotation(axes: &Matrix3<f64>) -> Result<Matrix3<f64>, String> {
    if (axes.transpose() * axes - Matrix3::identity()).amax() <= ROUNDING && axes.determinant() > 0.0 {
        return Ok(*axes);
    }
    let deviates = |deviation: f64| {
        format!(
            "the axes are off a rotation by {deviation:.2e}; expected at most 5e-3 (is there a scale or a shear in it?)"
        )
    };
    if axes.amax() > 1.0 + RIGID_TOLERANCE {
        return Err(deviates(axes.amax() - 1.0));
    }
    let determinant = axes.determinant();
    let svd = axes.svd(true, true);
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else {
        return Err(deviates(1.0));
    };
    let orthogonal = u * v_t;
    let deviation = (axes - orthogonal).amax();
    if deviation > RIGID_TOLERANCE {
        Err(deviates(deviation))
    } else if determinant < 0.0 {
        Err(format!(
            "the axes are left-handed (determinant {determinant}); expected a rotation, so flip one axis"
        ))
    } else {
        Ok(orthogonal)
    }
}

/// Inverse of a rigid transform.
pub fn inverse_rigid(matrix: &Matrix4<f64>) -> Matrix4<f64> {
    let back = matrix.fixed_view::<3, 3>(0, 0).transpose();
    let position = -(back * matrix.fixed_view::<3, 1>(0, 3));
    let mut inverse = back.to_homogeneous();
    inverse.fixed_view_mut::<3, 1>(0, 3).copy_from(&position);
    inverse
}

impl Rows {
    /// Creates a transform from sixteen numbers, row by row; `None` for any other count.
    fn from_numbers(numbers: &[f64]) -> Option<Self> {
        (numbers.len() == 16).then(|| Self(Matrix4::from_row_slice(numbers)))
    }

    /// Parses sixteen numbers separated by white space, row by row. The error describes what was found instead.
    pub fn parse(text: &str) -> Result<Self, String> {
        let numbers = text
            .split_whitespace()
            .map(|word| word.parse().map_err(|_| format!("`{word}` in place of a number")))
            .collect::<Result<Vec<f64>, String>>()?;
        Self::from_numbers(&numbers).ok_or_else(|| format!("{} numbers in place of 16", numbers.len()))
    }

    /// Returns the four rows.
    pub fn rows(&self) -> [[f64; 4]; 4] {
        [0, 1, 2, 3].map(|row| [0, 1, 2, 3].map(|column| self.0[(row, column)]))
    }
}

impl Serialize for Rows {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.rows().serialize(serializer)
    }
}

const WANTED: &str = "a 4 x 4 transform: 4 rows of 4 numbers, or 16 numbers row by row";

struct RowsVisitor;

/// An entry of a list: a number, or a row.
#[derive(Deserialize)]
#[serde(untagged, expecting = "expected a number or a row of 4 numbers")]
enum Entry {
    Number(f64),
    Row([f64; 4]),
}

impl<'de> Visitor<'de> for RowsVisitor {
    type Value = Rows;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(WANTED)
    }

    fn visit_str<E: serde::de::Error>(self, text: &str) -> Result<Rows, E> {
        Rows::parse(text).map_err(|found| E::custom(format!("found {found}; expected {WANTED}")))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Rows, A::Error> {
        let mut numbers = Vec::with_capacity(16);
        while let Some(entry) = list.next_element()? {
            match entry {
                Entry::Number(number) => numbers.push(number),
                Entry::Row(row) => numbers.extend(row),
            }
            if numbers.len() > 16 {
                break;
            }
        }
        Rows::from_numbers(&numbers).ok_or_else(|| serde::de::Error::invalid_length(numbers.len(), &WANTED))
    }
}

impl<'de> Deserialize<'de> for Rows {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(RowsVisitor)
    }
}

impl JsonSchema for Rows {
    fn schema_name() -> Cow<'static, str> {
        "Transform".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        let row = json_schema!({ "type": "array", "items": { "type": "number" }, "minItems": 4, "maxItems": 4 });
        json_schema!({
            "description": WANTED,
            "anyOf": [
                { "type": "array", "items": row, "minItems": 4, "maxItems": 4 },
                { "type": "array", "items": { "type": "number" }, "minItems": 16, "maxItems": 16 },
                { "type": "string" },
            ],
        })
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Rotation3, Vector3};
    use proptest::prelude::*;

    use super::*;

    #[derive(Debug, Deserialize)]
    struct Holder {
        matrix: Rows,
    }

    #[test]
    fn all_spellings_mean_the_same() {
        let texts = [
            "matrix = [[1, 0, 0, 5], [0, 1, 0, 6.5], [0, 0, 1, -7], [0, 0, 0, 1]]",
            "matrix = [1, 0, 0, 5, 0, 1, 0, 6.5, 0, 0, 1, -7, 0, 0, 0, 1]",
            "matrix = '1 0 0 5  0 1 0 65e-001\n 0 0 1 -7 0 0 0 1'",
        ];
        for text in texts {
            let text = text.replace('\n', " ");
            let matrix = toml::from_str::<Holder>(&text).expect("matrix").matrix.0;
            assert_eq!(
                matrix,
                Matrix4::new_translation(&Vector3::new(5.0, 6.5, -7.0)),
                "{text}"
            );
        }
    }

    #[test]
    fn wrong_counts_and_words_are_named() {
        let cases = [
            ("matrix = [1, 2, 3]", "length 3"),
            ("matrix = '1 2 x'", "`x` in place of a number"),
            ("matrix = '1 2'", "2 numbers in place of 16"),
            ("matrix = [[1, 2], [3, 4]]", "row of 4 numbers"),
            ("matrix = 3", "4 x 4 transform"),
        ];
        for (text, message) in cases {
            let error = toml::from_str::<Holder>(text).expect_err(text).to_string();
            assert!(error.contains(message), "{error}");
        }
    }

    #[test]
    fn matrices_that_are_not_rigid_are_refused_with_the_reason() {
        let turn = Rotation3::from_euler_angles(0.3, -0.4, 1.1).to_homogeneous();
        let with = |row, column, value| {
            let mut matrix = turn;
            matrix[(row, column)] = value;
            matrix
        };
        let refused = |matrix: &Matrix4<f64>, reason: &str| {
            let error = rigid(matrix).expect_err(reason);
            assert!(error.contains(reason), "{error}");
        };
        refused(
            &with(1, 2, f64::NAN),
            "row 1, column 2 is NaN; expected a finite number",
        );
        refused(&with(0, 3, f64::INFINITY), "row 0, column 3 is inf");
        refused(&with(3, 0, 0.1), "the last row is");
        refused(&with(0, 3, 2e6), "farther than 1e6 mm");
        refused(&(turn.scale(0.085)), "the last row is");
        let shifted = with(1, 3, 40.0).transpose();
        refused(
            &shifted,
            "[0.0, 40.0, 0.0, 1.0]; expected [0, 0, 0, 1]: is the matrix transposed (row-major?)",
        );
        refused(&Matrix4::zeros(), "the last row is");
        let scaled = Matrix4::new_nonuniform_scaling(&Vector3::new(1.0, 0.9, 1.0)) * turn;
        refused(&scaled, "off a rotation by");
        let huge = Matrix4::new_scaling(1e300);
        refused(&huge, "off a rotation by");
        let mirrored = Matrix4::new_nonuniform_scaling(&Vector3::new(-1.0, 1.0, 1.0)) * turn;
        refused(&mirrored, "left-handed");
        let flat = Matrix4::new_nonuniform_scaling(&Vector3::new(0.0, 1.0, 1.0));
        refused(&flat, "off a rotation by");
    }

    proptest! {
        #[test]
        fn nearly_rigid_matrices_become_rigid(
            angles in prop::array::uniform3(-3.0..3.0f64),
            noise in prop::array::uniform9(-1e-3..1e-3f64),
            position in prop::array::uniform3(-500.0..500.0f64),
        ) {
            let mut matrix = Rotation3::from_euler_angles(angles[0], angles[1], angles[2]).to_homogeneous();
            for (i, noise) in noise.into_iter().enumerate() {
                matrix[(i / 3, i % 3)] += noise;
            }
            for row in 0..3 {
                matrix[(row, 3)] = position[row];
            }
            let rigid = rigid(&matrix).expect("rigid");
            let axes = rigid.fixed_view::<3, 3>(0, 0);
            prop_assert!((axes.transpose() * axes - Matrix3::identity()).amax() < 1e-12);
            prop_assert!((axes.determinant() - 1.0).abs() < 1e-12);
            prop_assert!((rigid - matrix).amax() < 3e-3);
            prop_assert!((inverse_rigid(&rigid) * rigid - Matrix4::identity()).amax() < 1e-9);
        }

        #[test]
        fn rigid_matrices_stay_as_they_are(angles in prop::array::uniform3(-3.0..3.0f64)) {
            let matrix = Rotation3::from_euler_angles(angles[0], angles[1], angles[2]).to_homogeneous();
            prop_assert!((rigid(&matrix).expect("rigid") - matrix).amax() < 1e-13);
        }
    }
}
