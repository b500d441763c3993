//! Points of a physical surface from files: CSV, points of 3D Slicer, surfaces of triangles.

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::Point3;
use serde::Deserialize;

use super::Landmark;
use crate::volume::VolumeError;
use insonify_base::csv::Csv;
use insonify_base::matrix::FARTHEST_MM;
use insonify_base::number;
use insonify_base::read;
use insonify_base::text::some_of;
use insonify_mesh::file::{SURFACES, SurfaceFile, Unit};

/// Lengths between which a surface can be one of a body, mm: an organ of a mouse, a man.
const LENGTHS_MM: [f64; 2] = [5.0, 5000.0];

/// Points of a surface.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SurfacePoints {
    /// Positions in the axes of the file, mm.
    pub points: Vec<Point3<f64>>,
    /// Whether the file states its axes as RAS (true) or LPS (false).
    pub is_ras: Option<bool>,
    /// Whether a file that states none is taken as RAS, by its kind.
    pub guessed_ras: bool,
    /// Kinds of markups of 3D Slicer that are left out, as their points are those of no surface.
    pub left_out: Vec<String>,
}

/// Kinds of markups whose points lie on what they mark.
const TOUCHING: [&str; 3] = ["Fiducial", "Curve", "ClosedCurve"];

/// Reads the points of a surface by the ending of its file: CSV with the columns `x_mm`, `y_mm`, `z_mm`, points of 3D
/// Slicer (`.fcsv`, `.mrk.json`), or a surface of triangles, whose coordinates are in the given unit.
///
/// # Errors
/// [`VolumeError`] if the file cannot be read, has another ending, or is too small or large for a body.
pub fn read(path: &Path, unit: Unit) -> Result<SurfacePoints, VolumeError> {
    let wrong = |found: String| VolumeError::new(format!("{}: {found}", path.display()));
    let ending = path
        .extension()
        .map(|ending| ending.to_string_lossy().to_ascii_lowercase());
    let surface = match ending.as_deref() {
        Some("csv") => SurfacePoints {
            points: csv(path)?,
            ..SurfacePoints::default()
        },
        Some("fcsv") => fcsv(&text(path)?).map_err(wrong)?,
        Some("json") => markups(&text(path)?).map_err(wrong)?,
        Some(ending) if SURFACES.contains(&ending) => {
            let file = SurfaceFile::read(path).map_err(|error| VolumeError::new(error.to_string()))?;
            plausible(file.longest_side(), Some(unit)).map_err(wrong)?;
            let in_mm = |point: &[f64; 3]| Point3::from(point.map(|x| x * unit.mm()));
            SurfacePoints {
                points: file.points.iter().map(in_mm).collect(),
                is_ras: file.is_ras,
                ..SurfacePoints::default()
            }
        }
        _ => {
            return Err(wrong(format!(
                "expected a surface as .csv, .fcsv, .mrk.json or .{}",
                SURFACES.join(", .")
            )));
        }
    };
    // Checked once for all formats: one point that is not finite would spoil every sum of the fit.
    let mut coordinates = surface.points.iter().flat_map(|point| point.iter());
    if !coordinates.all(|x| x.abs() <= FARTHEST_MM) {
        return Err(wrong("a coordinate is not finite or beyond 1e6 mm".to_owned()));
    }
    // Points, too, may be in metres. One alone has no length.
    if surface.points.len() > 1 {
        let [low, high] = super::bounds(surface.points.iter().copied());
        let longest_mm = (0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f64::max);
        plausible(longest_mm, None).map_err(wrong)?;
    }
    Ok(surface)
}

/// Refuses a surface whose length, in its own unit, is that of no body, and names the unit that would make it one.
/// `unit` is that of the user; `None` where nobody can state one: mm.
pub(crate) fn plausible(length: f64, unit: Option<Unit>) -> Result<(), String> {
    // Few files are in centimetres.
    const UNITS: [(&str, f64, Option<&str>); 4] = [
        ("mm", 1.0, Some("mm")),
        ("metres", 1000.0, Some("m")),
        ("centimetres", 10.0, Some("cm")),
        ("micrometres", 0.001, None),
    ];
    let fits = |length_mm: f64| (LENGTHS_MM[0]..=LENGTHS_MM[1]).contains(&length_mm);
    let length_mm = length * unit.unwrap_or_default().mm();
    if fits(length_mm) {
        return Ok(());
    }
    let [low, high] = LENGTHS_MM;
    let found = format!("the surface is {length_mm:.4} mm long, expected {low} to {high} mm");
    let fitting = UNITS.into_iter().find(|(_, mm, _)| fits(length * mm));
    Err(fitting.map_or(found.clone(), |(name, mm, flag)| {
        let remedy = match flag.filter(|_| unit.is_some()) {
            Some(flag) => format!("state the unit (`--unit {flag}`)"),
            None => "write it in mm".to_owned(),
        };
        format!("{found}; in {name} it is {:.4} mm long: {remedy}", length * mm)
    }))
}

fn text(path: &Path) -> Result<String, VolumeError> {
    read::text(path, read::TOML)
        .map_err(|source| VolumeError::new(format!("cannot read `{}`: {source}", path.display())))
}

/// Reads points of 3D Slicer's older format: `id,x,y,z` and more, axes in a comment.
fn fcsv(text: &str) -> Result<SurfacePoints, String> {
    let mut surface = SurfacePoints::default();
    let mut columns = vec!["id", "x", "y", "z"];
    for (number, line) in (1..).zip(text.lines()) {
        if let Some(comment) = line.trim().strip_prefix('#') {
            let Some((key, value)) = comment.split_once('=') else {
                continue;
            };
            match (key.trim(), value.trim()) {
                ("CoordinateSystem", stated) => {
                    surface.is_ras = Some(match stated {
                        "0" | "RAS" => true,
                        "1" | "LPS" => false,
                        _ => {
                            return Err(format!(
                                "line {number}: found the coordinate system {stated}, expected RAS or LPS"
                            ));
                        }
                    });
                }
                ("columns", names) => columns = names.split(',').map(str::trim).collect(),
                _ => {}
            }
            continue;
        }
        if line.trim().is_empty() {
            continue;
        }
        let fields: Vec<&str> = line.split(',').map(str::trim).collect();
        let number_of = |name: &str| {
            let column = columns.iter().position(|column| *column == name)?;
            number::parsed(fields.get(column)?)
        };
        let point = number_of("x").zip(number_of("y")).zip(number_of("z"));
        let ((x, y), z) =
            point.ok_or_else(|| format!("line {number}: found no numbers x, y and z, expected `id,x,y,z,...`"))?;
        surface.points.push(Point3::new(x, y, z));
    }
    // Files without the comment are of Slicer before 5, which wrote RAS.
    surface.guessed_ras = surface.is_ras.is_none();
    Ok(surface)
}

/// Points of 3D Slicer's newer format.
#[derive(Deserialize)]
struct Markups {
    markups: Vec<Markup>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Markup {
    #[serde(default, rename = "type")]
    kind: Option<String>,
    #[serde(default)]
    coordinate_system: Option<String>,
    #[serde(default)]
    coordinate_units: Option<serde_json::Value>,
    #[serde(default)]
    control_points: Vec<ControlPoint>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct ControlPoint {
    #[serde(default)]
    position: Option<[f64; 3]>,
    #[serde(default)]
    position_status: Option<String>,
}

fn markups(text: &str) -> Result<SurfacePoints, String> {
    const EXPECTED: &str = "expected points of 3D Slicer: `markups` with `controlPoints`";
    let file: Markups = serde_json::from_str(text).map_err(|error| format!("{error}; {EXPECTED}"))?;
    let mut surface = SurfacePoints::default();
    let mut axes = None;
    for markup in file.markups {
        if let Some(kind) = markup.kind.filter(|kind| !TOUCHING.contains(&kind.as_str())) {
            surface.left_out.push(kind);
            continue;
        }
        let is_ras = match markup.coordinate_system.as_deref() {
            Some("RAS" | "0") => Some(true),
            Some("LPS" | "1") => Some(false),
            None => None,
            Some(other) => return Err(format!("found the coordinate system {other}, expected RAS or LPS")),
        };
        let unit = match markup.coordinate_units {
            Some(serde_json::Value::Array(all)) => all.first().cloned(),
            unit => unit,
        };
        if let Some(unit) = unit.filter(|unit| unit != "mm") {
            return Err(format!("found coordinates in {unit}, expected mm"));
        }
        // Without a statement they are LPS, as such files are.
        let is_other = |other: bool| other != is_ras.unwrap_or(false);
        if axes.is_some_and(is_other) {
            return Err("found lists of points in LPS and in RAS, expected one for all".to_owned());
        }
        axes = Some(is_ras.unwrap_or(false));
        surface.is_ras = surface.is_ras.or(is_ras);
        let is_defined = |point: &ControlPoint| {
            point
                .position_status
                .as_deref()
                .is_none_or(|status| status == "defined")
        };
        let points = markup.control_points.iter().filter(|point| is_defined(point));
        surface
            .points
            .extend(points.filter_map(|point| point.position.map(Point3::from)));
    }
    match some_of(&surface.left_out) {
        kinds if surface.points.is_empty() && !kinds.is_empty() => Err(format!(
            "found markups of the kind {kinds} alone; {EXPECTED} of the kind {}",
            TOUCHING.join(", ")
        )),
        _ => Ok(surface),
    }
}

fn csv(path: &Path) -> Result<Vec<Point3<f64>>, VolumeError> {
    let table = Csv::open(path, &["x_mm", "y_mm", "z_mm"])?;
    let points = table
        .rows()
        .map(|row| row.numbers(["x_mm", "y_mm", "z_mm"]).map(Point3::from));
    Ok(points.collect::<Result<_, _>>()?)
}

/// Reads landmarks: CSV with the columns `name`, `volume_x_mm`, `volume_y_mm`, `volume_z_mm`, `surface_x_mm`,
/// `surface_y_mm`, `surface_z_mm`.
///
/// # Errors
/// [`VolumeError`] with the line, what was found and what was expected.
pub fn landmarks(path: &Path) -> Result<Vec<Landmark>, VolumeError> {
    const VOLUME: [&str; 3] = ["volume_x_mm", "volume_y_mm", "volume_z_mm"];
    const SURFACE: [&str; 3] = ["surface_x_mm", "surface_y_mm", "surface_z_mm"];
    let required: Vec<&str> = ["name"].into_iter().chain(VOLUME).chain(SURFACE).collect();
    let table = Csv::read(path, &required, &[])?;
    let mut seen = BTreeMap::new();
    let mut all = Vec::new();
    for row in table.rows() {
        let name = row.text("name").to_owned();
        if seen.insert(name.clone(), ()).is_some() {
            return Err(row.wrong("name", "each landmark once").into());
        }
        all.push(Landmark {
            name,
            volume_mm: row.numbers(VOLUME)?.into(),
            surface_mm: row.numbers(SURFACE)?.into(),
        });
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_of_slicer_have_their_axes() {
        let head = "# Markups fiducial file version = 5.0\n";
        let rows = "# columns = id,x,y,z,ow,ox\n0,1.5,-2,3,0,0\n\n1,4,5,6,0,0\n";
        let points = [Point3::new(1.5, -2.0, 3.0), Point3::new(4.0, 5.0, 6.0)];
        for (system, is_ras) in [
            ("# CoordinateSystem = LPS\n", Some(false)),
            ("# CoordinateSystem = 1\n", Some(false)),
            ("# CoordinateSystem = 0\n", Some(true)),
            ("", None),
        ] {
            let read = fcsv(&format!("{head}{system}{rows}")).expect(system);
            assert_eq!((&read.points[..], read.is_ras), (&points[..], is_ras), "{system}");
            assert_eq!(read.guessed_ras, is_ras.is_none(), "{system}");
        }
        let turned = fcsv("# columns = label,z,y,x\nF,3,-2,1.5\n").expect("columns");
        assert_eq!(turned.points, points[..1]);
        for (text, words) in [
            ("# CoordinateSystem = IJK\n", "line 1: found the coordinate system IJK"),
            ("0,1,two,3\n", "line 1: found no numbers"),
            ("0,1,inf,3\n", "line 1: found no numbers"),
        ] {
            assert!(fcsv(text).expect_err(text).contains(words));
        }
        let json = |system: &str, units: &str| {
            format!("{{\"@schema\": \"x\", \"markups\": [{{\"type\": \"Fiducial\", {system} {units} \"controlPoints\": [
                {{\"id\": \"0\", \"position\": [1.5, -2, 3]}}, {{\"position\": [9, 9, 9], \"positionStatus\": \"undefined\"}},
                {{\"position\": [4, 5, 6], \"positionStatus\": \"defined\"}}, {{\"id\": \"3\"}}]}}]}}")
        };
        for (system, is_ras) in [
            ("\"coordinateSystem\": \"LPS\",", Some(false)),
            ("\"coordinateSystem\": \"RAS\",", Some(true)),
            ("", None),
        ] {
            let read = markups(&json(system, "\"coordinateUnits\": [\"mm\"],")).expect(system);
            assert_eq!((&read.points[..], read.is_ras), (&points[..], is_ras), "{system}");
            assert!(!read.guessed_ras);
        }
        assert!(
            markups(&json("", "\"coordinateUnits\": \"um\","))
                .expect_err("unit")
                .contains("\"um\"")
        );
        let mixed = json("", "").replace(
            "\"markups\": [",
            "\"markups\": [{\"type\": \"ROI\", \"controlPoints\": [{\"position\": [0, 0, 0]}]}, ",
        );
        let read = markups(&mixed).expect("points and a region");
        assert_eq!(
            (&read.points[..], &read.left_out[..]),
            (&points[..], &["ROI".to_owned()][..])
        );
        assert!(markups("{\"other\": 1}").expect_err("json").contains("controlPoints"));
    }

    #[test]
    fn a_surface_of_no_body_is_refused_with_its_unit() {
        for (length, unit, remedy) in [
            (
                0.33,
                Unit::Mm,
                "0.3300 mm long, expected 5 to 5000 mm; in metres it is 330.0000 mm long: state the unit (`--unit m`)",
            ),
            (
                330_000.0,
                Unit::Mm,
                "in micrometres it is 330.0000 mm long: write it in mm",
            ),
            (
                330.0,
                Unit::M,
                "330000.0000 mm long, expected 5 to 5000 mm; in mm it is 330.0000 mm long: state the unit (`--unit mm`)",
            ),
        ] {
            let error = plausible(length, Some(unit)).expect_err(remedy);
            assert!(error.contains(remedy), "{error}");
        }
        for (length, unit) in [(6.0, Unit::Mm), (1900.0, Unit::Mm), (0.33, Unit::M), (33.0, Unit::Cm)] {
            assert_eq!(plausible(length, Some(unit)), Ok(()));
        }
        let error = plausible(0.33, None).expect_err("metres");
        assert!(
            error.ends_with("in metres it is 330.0000 mm long: write it in mm"),
            "{error}"
        );
    }
}
