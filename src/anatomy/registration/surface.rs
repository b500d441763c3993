//! Points of a physical surface from files: CSV, STL, PLY.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use nalgebra::Point3;
use ply_rs_bw::parser::Parser;
use ply_rs_bw::ply::{DefaultElement, Property};

use super::Landmark;
use crate::volume::VolumeError;
use insonify_base::csv::Csv;
use insonify_base::read;

/// Reads the vertices of a surface by the ending of its file: CSV with the columns `x_mm`, `y_mm`, `z_mm`, STL, or PLY (mm).
///
/// # Errors
/// [`VolumeError`] if the file cannot be read, or has another ending.
pub fn read(path: &Path) -> Result<Vec<Point3<f64>>, VolumeError> {
    let wrong = |found: String| VolumeError::new(format!("{}: {found}", path.display()));
    let ending = path.extension().map(|ending| ending.to_ascii_lowercase());
    let points: Vec<Point3<f64>> = match ending.as_ref().and_then(|ending| ending.to_str()) {
        Some("csv") => csv(path)?,
        Some("stl") => {
            let mut file = BufReader::new(open(path)?);
            let mesh = stl_io::read_stl(&mut file).map_err(|error| wrong(format!("no STL surface: {error}")))?;
            mesh.vertices
                .iter()
                .map(|vertex| Point3::from(vertex.0.map(f64::from)))
                .collect()
        }
        Some("ply") => {
            let mut file = BufReader::new(open(path)?);
            let parser = Parser::<DefaultElement>::new();
            let ply = parser
                .read_ply(&mut file)
                .map_err(|error| wrong(format!("no PLY surface: {error}")))?;
            let vertices = ply.payload.get("vertex").map(Vec::as_slice).unwrap_or_default();
            let points: Option<Vec<Point3<f64>>> = vertices.iter().map(vertex).collect();
            points.ok_or_else(|| wrong("PLY vertices without numbers x, y and z".to_owned()))?
        }
        _ => return Err(wrong("expected a surface as .csv, .stl or .ply".to_owned())),
    };
    // Checked once for all formats: one point that is not finite would spoil every sum of the fit.
    if points
        .iter()
        .flat_map(|point| point.iter())
        .all(|x| x.abs() <= insonify_base::matrix::FARTHEST_MM)
    {
        Ok(points)
    } else {
        Err(wrong("a coordinate is not finite or beyond 1e6 mm".to_owned()))
    }
}

fn open(path: &Path) -> Result<File, VolumeError> {
    read::open(path).map_err(|source| VolumeError::new(format!("cannot read `{}`: {source}", path.display())))
}

fn csv(path: &Path) -> Result<Vec<Point3<f64>>, VolumeError> {
    let table = Csv::open(path, &["x_mm", "y_mm", "z_mm"])?;
    let points = table
        .rows()
        .map(|row| row.numbers(["x_mm", "y_mm", "z_mm"]).map(Point3::from));
    Ok(points.collect::<Result<_, _>>()?)
}

fn vertex(element: &DefaultElement) -> Option<Point3<f64>> {
    let number = |key: &str| match element.get(key)? {
        Property::Float(x) => Some(f64::from(*x)),
        Property::Double(x) => Some(*x),
        Property::Int(x) => Some(f64::from(*x)),
        Property::Short(x) => Some(f64::from(*x)),
        _ => None,
    };
    Some(Point3::new(number("x")?, number("y")?, number("z")?))
}

/// Reads landmarks: CSV with the columns `name`, `volume_x_mm`, `volume_y_mm`, `volume_z_mm`, `surface_x_mm`, `surface_y_mm`, `surface_z_mm`.
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
