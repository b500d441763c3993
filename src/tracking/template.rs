//! Needle templates: plates with rows and columns of guiding holes.

use nalgebra::{Point3, Unit, Vector3};

use insonify_base::blame::Blame;
use insonify_base::document::nearest;

/// A plate with rows and columns of holes, perpendicular to the needles that it guides.
///
/// ```
/// use insonify_tracking::template::Template;
/// use nalgebra::{Point3, Vector3};
///
/// let names = |letters: &str| letters.chars().map(String::from).collect();
/// let template = Template {
///     origin_mm: Point3::origin(),
///     steps_mm: [Vector3::x() * 5.0, Vector3::y() * 5.0],
///     direction: Vector3::z_axis(),
///     columns: names("ABC"),
///     rows: names("123"),
/// };
/// assert_eq!(template.hole("C2"), Ok(Point3::new(10.0, 5.0, 0.0)));
/// let unknown = template.hole("D2").unwrap_err();
/// assert_eq!(unknown.expected, "a hole of the template, A1 to C3");
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Template {
    /// Position of the hole of the first column and row, mm.
    pub origin_mm: Point3<f64>,
    /// Steps from column to column and from row to row, mm.
    pub steps_mm: [Vector3<f64>; 2],
    /// Direction of needles.
    pub direction: Unit<Vector3<f64>>,
    /// Names of the columns.
    pub columns: Vec<String>,
    /// Names of the rows.
    pub rows: Vec<String>,
}

/// A hole name that the template does not have.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the hole is \"{found}\"; expected {expected}")]
pub struct UnknownHole {
    /// Name given.
    pub found: String,
    /// Available holes.
    pub expected: String,
    /// A hole with a similar name.
    pub meant: Option<String>,
}

impl Blame for UnknownHole {}

impl Template {
    /// Centre of a hole by its name: that of its column followed by that of its row.
    ///
    /// # Errors
    /// [`UnknownHole`] if the template has no such hole.
    pub fn hole(&self, name: &str) -> Result<Point3<f64>, UnknownHole> {
        let mut splits = self.columns.iter().enumerate().filter_map(|(column, title)| {
            let row = name.strip_prefix(title.as_str())?;
            Some([column, self.rows.iter().position(|title| title == row)?])
        });
        match splits.next_back() {
            Some([column, row]) => {
                Ok(self.origin_mm + self.steps_mm[0] * column as f64 + self.steps_mm[1] * row as f64)
            }
            None => Err(self.unknown(name)),
        }
    }

    fn unknown(&self, name: &str) -> UnknownHole {
        let of_column = |column: &String| self.rows.iter().map(move |row| format!("{column}{row}")).collect();
        let names: Vec<String> = self.columns.iter().flat_map::<Vec<_>, _>(of_column).collect();
        UnknownHole {
            found: name.to_owned(),
            expected: match (names.first(), names.last()) {
                (Some(first), Some(last)) => format!("a hole of the template, {first} to {last}"),
                _ => "a hole of the template".to_owned(),
            },
            meant: nearest(name, names.iter().map(String::as_str)).map(str::to_owned),
        }
    }
}
