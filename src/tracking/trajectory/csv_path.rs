//! Paths in CSV files: one timed pose per row.

use std::path::Path;

use nalgebra::{Matrix4, Vector3};

use super::{Interpolation, Key, Trajectory, check_time};
use crate::TrackingError;
use crate::pose::Pose;
use crate::world::World;
use insonify_base::csv::{COMMAS, line, other_separator};
use insonify_base::number;
use insonify_base::read;
use insonify_base::text::head;

/// Maximum length of a quoted name or cell, columns.
const FOUND: usize = 60;
const POSITION: [&str; 4] = ["time_s", "x_mm", "y_mm", "z_mm"];
const QUATERNION: [&str; 4] = ["qw", "qx", "qy", "qz"];
const DIRECTION: [&str; 3] = ["dx", "dy", "dz"];
const LATERAL: [&str; 3] = ["lx", "ly", "lz"];
const MATRIX: [&str; 16] = [
    "m00", "m01", "m02", "m03", "m10", "m11", "m12", "m13", "m20", "m21", "m22", "m23", "m30", "m31", "m32", "m33",
];

/// Accepted columns of a path, for error messages.
const EXPECTED: &str = "time_s with x_mm, y_mm, z_mm and either qw, qx, qy, qz or dx, dy, dz (and lx, ly, lz), or time_s with m00 to m33 row by row";

#[derive(Clone, Copy)]
enum Orientation {
    Quaternion,
    Direction,
    DirectionAndLateral,
    Matrix,
}

struct Columns {
    orientation: Orientation,
    /// Name and index of each used column.
    columns: Vec<(&'static str, usize)>,
    /// Those of parameters.
    parameters: Vec<(String, usize)>,
}

/// A column of a table of poses that states a parameter of each row.
#[derive(Clone, Debug, PartialEq)]
pub struct ParameterColumn {
    /// Name in the header.
    pub name: String,
    /// Cells, with their lines in the file.
    pub cells: Vec<(u64, String)>,
}

impl Trajectory {
    /// Reads a path from a CSV file with a header row. Columns, in any order: `time_s`, then either `x_mm`, `y_mm`,
    /// `z_mm` with a quaternion `qw`, `qx`, `qy`, `qz` or an axial direction `dx`, `dy`, `dz` (and a lateral hint `lx`,
    /// `ly`, `lz`), or a probe-to-world matrix `m00` to `m33`. World coordinates are mm in the axes of `world`. Without
    /// a hint each row is reached by the smallest rotation from the previous one. Lines that start with `#` are
    /// comments.
    pub fn from_csv(path: &Path, world: World, interpolation: Interpolation) -> Result<Self, TrackingError> {
        let unknown = |_: &str| Err(String::new());
        Self::from_csv_with(path, world, interpolation, &unknown).map(|(path, _)| path)
    }

    /// Reads a path as [`Trajectory::from_csv`] does, and beside it the columns that name a `parameter`: of other names
    /// the error says why they are none.
    pub fn from_csv_with(
        path: &Path,
        world: World,
        interpolation: Interpolation,
        parameter: &dyn Fn(&str) -> Result<(), String>,
    ) -> Result<(Self, Vec<ParameterColumn>), TrackingError> {
        let text = read::text(path, read::CSV).map_err(|source| TrackingError::read(path, source))?;
        Self::from_csv_reader(text.as_bytes(), path, world, interpolation, parameter)
    }

    /// Reads a path as [`Trajectory::from_csv_with`] does, from any source; `path` is the file name shown in errors.
    fn from_csv_reader(
        source: &[u8],
        path: &Path,
        world: World,
        interpolation: Interpolation,
        parameter: &dyn Fn(&str) -> Result<(), String>,
    ) -> Result<(Self, Vec<ParameterColumn>), TrackingError> {
        let mut reader = csv::ReaderBuilder::new()
            .trim(csv::Trim::All)
            .comment(Some(b'#'))
            .from_reader(source);
        let header = reader.headers().map_err(|error| table_error(path, source, error))?;
        if let Some(separator) = other_separator(header) {
            let cells = head(&header[0], FOUND);
            let text = format!(", line 1: found {separator} between the cells of `{cells}`; expected {COMMAS}");
            return Err(TrackingError::file(path, text));
        }
        let columns = Columns::from_header(header, path, parameter)?;
        let mut keys: Vec<Key> = Vec::new();
        let named = |(name, _): &(String, usize)| ParameterColumn {
            name: name.clone(),
            cells: Vec::new(),
        };
        let mut parameters: Vec<ParameterColumn> = columns.parameters.iter().map(named).collect();
        for (row, record) in reader.records().enumerate() {
            let record = record.map_err(|error| table_error(path, source, error))?;
            let line = line(source, record.position());
            let previous = keys.last();
            let (time_s, pose) = columns.read(&record, line, path, world, previous.map(|key| &key.pose))?;
            if check_time(row, time_s, previous.map(|key| key.time_s)).is_err() {
                let expected = match previous {
                    Some(key) if time_s <= key.time_s => format!("a time after {}", key.time_s),
                    _ => "seconds, of at most 1e9: take off the time of the first row".to_owned(),
                };
                let text = format!(", line {line}: `time_s` is {time_s}; expected {expected}");
                return Err(TrackingError::file(path, text));
            }
            keys.push(Key {
                time_s,
                pose,
                source: row,
            });
            for (column, (_, index)) in parameters.iter_mut().zip(&columns.parameters) {
                let cell = record.get(*index).unwrap_or_default();
                column.cells.push((line, cell.to_owned()));
            }
        }
        if keys.is_empty() {
            let text = ", line 1: no rows after the header; expected at least one pose";
            return Err(TrackingError::file(path, text));
        }
        let path = Self {
            keys,
            interpolation,
            skipped: Vec::new(),
            repeated: 0,
        };
        Ok((path, parameters))
    }
}

impl Columns {
    fn from_header(
        header: &csv::StringRecord,
        path: &Path,
        parameter: &dyn Fn(&str) -> Result<(), String>,
    ) -> Result<Self, TrackingError> {
        let problem = |column: &str, problem: &str| {
            let column = head(column, FOUND);
            TrackingError::file(
                path,
                format!(", line 1: column `{column}` is {problem}; expected {EXPECTED}"),
            )
        };
        let known = || {
            POSITION
                .iter()
                .chain(&QUATERNION)
                .chain(&DIRECTION)
                .chain(&LATERAL)
                .chain(&MATRIX)
        };
        let mut columns: Vec<(&'static str, usize)> = Vec::new();
        let mut parameters: Vec<(String, usize)> = Vec::new();
        for (column, name) in header.iter().enumerate() {
            let Some(&name) = known().find(|known| **known == name) else {
                if parameters.iter().any(|(other, _)| other == name) {
                    return Err(problem(name, "given twice"));
                }
                parameter(name).map_err(|why| problem(name, &format!("unknown{why}")))?;
                parameters.push((name.to_owned(), column));
                continue;
            };
            if columns.iter().any(|&(other, _)| other == name) {
                return Err(problem(name, "given twice"));
            }
            columns.push((name, column));
        }
        let has = |name: &str| columns.iter().any(|&(other, _)| other == name);
        let any = |names: &[&str]| names.iter().any(|name| has(name));
        // One column decides which others are needed. Any left over are refused: two ways to give a pose
        // could disagree.
        let (orientation, needed): (Orientation, Vec<&str>) = if any(&MATRIX) {
            (Orientation::Matrix, [&["time_s"][..], &MATRIX].concat())
        } else if any(&QUATERNION) {
            (Orientation::Quaternion, [&POSITION[..], &QUATERNION].concat())
        } else if any(&LATERAL) {
            (
                Orientation::DirectionAndLateral,
                [&POSITION[..], &DIRECTION, &LATERAL].concat(),
            )
        } else {
            (Orientation::Direction, [&POSITION[..], &DIRECTION].concat())
        };
        if let Some(missing) = needed.iter().find(|name| !has(name)) {
            return Err(problem(missing, "missing"));
        }
        match columns.iter().find(|(name, _)| !needed.contains(name)) {
            Some((name, _)) => Err(problem(name, "one too many for this way to give a pose")),
            None => Ok(Self {
                orientation,
                columns,
                parameters,
            }),
        }
    }

    fn read(
        &self,
        record: &csv::StringRecord,
        line: u64,
        path: &Path,
        world: World,
        previous: Option<&Pose>,
    ) -> Result<(f64, Pose), TrackingError> {
        let number = |column: &'static str| {
            let entry = self.columns.iter().find(|(name, _)| *name == column);
            let cell = entry.and_then(|&(_, index)| record.get(index)).unwrap_or_default();
            number::parsed(cell).ok_or_else(|| {
                let cell = head(cell, FOUND);
                let text = format!(", line {line}, column `{column}`: found `{cell}`; expected a finite number");
                TrackingError::file(path, text)
            })
        };
        let three = |names: [&'static str; 3]| -> Result<[f64; 3], TrackingError> {
            Ok([number(names[0])?, number(names[1])?, number(names[2])?])
        };
        let vector = |names| three(names).map(|stated| Vector3::from(world.vector(stated)));
        let time_s = number("time_s")?;
        let position = ["x_mm", "y_mm", "z_mm"];
        let pose = match self.orientation {
            Orientation::Quaternion => {
                let [qw, qx, qy, qz] = QUATERNION;
                let quaternion = [number(qw)?, number(qx)?, number(qy)?, number(qz)?];
                // A quaternion does not change axes as a vector does: the pose is made in the world of the
                // file, then carried over.
                Pose::from_quaternion(three(position)?.into(), quaternion).map(|pose| pose.in_lps(world))
            }
            Orientation::DirectionAndLateral => {
                Pose::from_direction(vector(position)?.into(), vector(DIRECTION)?, Some(vector(LATERAL)?))
            }
            Orientation::Direction => match previous {
                Some(previous) => previous.turned_to(vector(position)?.into(), vector(DIRECTION)?),
                None => Pose::from_direction(vector(position)?.into(), vector(DIRECTION)?, None),
            },
            Orientation::Matrix => {
                let mut matrix = Matrix4::zeros();
                for (entry, name) in MATRIX.into_iter().enumerate() {
                    matrix[(entry / 4, entry % 4)] = number(name)?;
                }
                Pose::from_matrix(&world.transform(matrix))
            }
        };
        pose.map(|pose| (time_s, pose))
            .map_err(|error| TrackingError::file(path, format!(", line {line}: {error}")))
    }
}

fn table_error(path: &Path, source: &[u8], error: csv::Error) -> TrackingError {
    let line = line(source, error.position());
    let fault = match error.kind() {
        csv::ErrorKind::UnequalLengths { expected_len, len, .. } => {
            format!("{len} cells; expected {expected_len}, as in the header")
        }
        _ => error.to_string(),
    };
    match error.into_kind() {
        csv::ErrorKind::Io(source) => TrackingError::read(path, source),
        _ => TrackingError::file(path, format!(", line {line}: {fault}")),
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;
    use proptest::prelude::*;

    use super::*;

    fn parse(text: &str) -> Result<Trajectory, TrackingError> {
        Trajectory::from_csv_reader(
            text.as_bytes(),
            Path::new("path.csv"),
            World::Lps,
            Interpolation::Linear,
            &|_| Err(String::new()),
        )
        .map(|(path, _)| path)
    }

    #[test]
    fn columns_beside_a_pose_are_parameters_of_its_row() {
        let text = "gain_db,time_s,x_mm,y_mm,z_mm,dx,dy,dz,curve\r\n# louder\n3,0,0,0,0,0,1,0,linear\r\n\r\n-1.5,1,0,0,0,0,1,0,\n";
        let known = |name: &str| match name {
            "gain_db" | "curve" => Ok(()),
            _ => Err("; did you mean `gain_db`?".to_owned()),
        };
        let read = |text: &str| {
            Trajectory::from_csv_reader(
                text.as_bytes(),
                Path::new("path.csv"),
                World::Lps,
                Interpolation::Linear,
                &known,
            )
        };
        let (path, columns) = read(text).expect(text);
        assert_eq!((path.keys().len(), columns.len()), (2, 2));
        assert_eq!(columns[0].cells, [(3, "3".to_owned()), (5, "-1.5".to_owned())]);
        assert_eq!((&*columns[1].name, &*columns[1].cells[1].1), ("curve", ""));
        for (header, words) in [
            ("gain_db,gain_db", "column `gain_db` is given twice"),
            (
                "gian_db",
                "column `gian_db` is unknown; did you mean `gain_db`?; expected time_s",
            ),
        ] {
            let error = read(&text.replacen("gain_db", header, 1))
                .expect_err(header)
                .to_string();
            assert!(error.contains(words), "{error}");
        }
    }

    #[test]
    fn semicolons_between_cells_are_told_as_such() {
        let error = parse("time_s;x_mm;y_mm;z_mm\n0;1,5;2;3\n")
            .expect_err("semicolons")
            .to_string();
        assert!(
            error.contains("line 1: found semicolons between the cells of `time_s;x_mm;y_mm;z_mm`; expected commas"),
            "{error}"
        );
    }

    #[test]
    fn all_ways_to_give_a_pose_agree() {
        let texts = [
            "\u{feff}time_s,x_mm,y_mm,z_mm,qw,qx,qy,qz\n# half a turn about y\n0.5, 1,2,3, 0,0,1,0\n",
            "z_mm,y_mm,x_mm,time_s,dx,dy,dz,lx,ly,lz\r\n3,2,1,0.5,0,1,0,-1,0,0\r\n",
            "time_s,m00,m01,m02,m03,m10,m11,m12,m13,m20,m21,m22,m23,m30,m31,m32,m33\n0.5,-1,0,0,1,0,1,0,2,0,0,-1,3,0,0,0,1",
        ];
        let poses = texts.map(|text| parse(text).expect(text));
        for path in &poses {
            assert_eq!(path.keys().len(), 1);
            assert_eq!(path.start_s(), 0.5);
            let difference = path.keys()[0].pose.probe_to_world() - poses[2].keys()[0].pose.probe_to_world();
            assert!(difference.amax() < 1e-12, "{difference}");
        }
        for text in texts {
            let (world, none) = (World::Ras, |_: &str| Err(String::new()));
            let path =
                Trajectory::from_csv_reader(text.as_bytes(), Path::new("x"), world, Interpolation::Linear, &none);
            let turned = poses[2].keys()[0].pose.in_lps(World::Ras);
            let difference = path.expect(text).0.keys()[0].pose.probe_to_world() - turned.probe_to_world();
            assert!(difference.amax() < 1e-12, "{difference}");
        }
    }

    #[test]
    fn errors_name_line_and_column() {
        let head = "time_s,x_mm,y_mm,z_mm,dx,dy,dz\n";
        let cases = [
            (
                format!("{head}0,0,0,0,0,1,0\n1,0,zero,0,0,1,0"),
                "line 3, column `y_mm`: found `zero`",
            ),
            (format!("{head}0,nan,0,0,0,1,0"), "line 2, column `x_mm`: found `nan`"),
            (format!("{head}0,0,0,0,0,1"), "line 2: 6 cells; expected 7"),
            (format!("{head}0,0,0,0,0,0,0"), "line 2: pose key `direction`"),
            (
                format!("{head}0,0,0,0,0,1,0\n0,0,0,0,0,1,0"),
                "line 3: `time_s` is 0; expected a time after 0",
            ),
            (
                format!("{head}1700000000000,0,0,0,0,1,0"),
                "line 2: `time_s` is 1700000000000; expected seconds, of at most 1e9",
            ),
            (head.to_owned(), "no rows"),
            (String::new(), "column `time_s` is missing"),
            ("time_s,x,y_mm".to_owned(), "column `x` is unknown"),
            ("time_s,time_s".to_owned(), "column `time_s` is given twice"),
            ("time_s,x_mm,y_mm,z_mm,qw,qx,qy\n".to_owned(), "column `qz` is missing"),
            (
                "time_s,x_mm,y_mm,z_mm,qw,qx,qy,qz,lx\n".to_owned(),
                "column `lx` is one too many",
            ),
            (
                "time_s,x_mm,y_mm,z_mm,qw,qx,qy,qz\n0,0,0,0,0,0,0,0".to_owned(),
                "line 2: quaternion",
            ),
        ];
        for (text, message) in cases {
            let error = parse(&text).expect_err(&text).to_string();
            assert!(
                error.contains(message) && error.contains("path.csv"),
                "{error}\nexpected {message}"
            );
        }
    }

    #[test]
    fn a_missing_file_is_named() {
        let error = Trajectory::from_csv(Path::new("/nowhere/sweep.csv"), World::Lps, Interpolation::Linear)
            .expect_err("missing");
        assert!(matches!(error, TrackingError::Read { .. }));
        assert!(error.to_string().contains("/nowhere/sweep.csv"));
    }

    proptest! {
        #[test]
        fn written_quaternions_read_back(w in 0.1..1.0f64, x in -1.0..1.0f64, y in -1.0..1.0f64, z in -1.0..1.0f64) {
            let n = (w * w + x * x + y * y + z * z).sqrt();
            let text = format!(
                "time_s,x_mm,y_mm,z_mm,qw,qx,qy,qz\n0,{x},{y},{z},{},{},{},{}\n", w / n, x / n, y / n, z / n,
            );
            let pose = parse(&text).expect("path").keys()[0].pose;
            prop_assert_eq!(pose.position_mm(), Point3::new(x, y, z));
            let rotation = pose.rotation();
            let dot = (rotation.w * w + rotation.i * x + rotation.j * y + rotation.k * z) / n;
            prop_assert!((dot.abs() - 1.0).abs() < 1e-9);
        }
    }
}
