//! Measured forces and displacements, read from tables.

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::{Point3, Vector3};

use super::force::Piecewise;
use crate::identification::IdentificationCase;
use insonify::Error;
use insonify_base::csv::{Csv, CsvError};
use insonify_base::statistics::percentile;
use insonify_mesh::{Locator, NO_ELEMENT};
use insonify_tracking::probe::BeamGrid;

/// Way back that ends the first push, mm.
const RETREAT_MM: f64 = 0.5;
/// Most points of a curve of force; more are averaged.
const MAX_POINTS: usize = 300;
/// Largest distance between neighbouring forces as a share of the curve.
const MAX_GAP_SHARE: f64 = 0.05;
/// Distance of the tip before the tissue from which on the force is that of the load cell alone, mm, and fewest rows of
/// it.
const BEFORE_MM: f64 = 0.5;
const MIN_BEFORE: usize = 5;
/// Most depths at which displacements are compared.
const MAX_DEPTHS: usize = 40;
/// Correlation below which a window is not used.
const MIN_CORRELATION: f64 = 0.8;
/// Side of the cells whose windows are one displacement, their median, mm.
const CELL_MM: f64 = 4.0;
/// Fewest windows that correlate in a cell, as a share of all.
const MIN_CORRELATED_SHARE: f64 = 0.5;

/// Measurements of the first push of a needle.
#[derive(Clone, Debug)]
pub(super) struct Measurements {
    /// Depth of the tip (mm, rising) and force less its offset (N).
    pub force: Vec<[f64; 2]>,
    /// Offset of the load cell, N; `None` without a force before the tissue.
    pub offset_n: Option<f64>,
    /// Force after the needle has come out again less the offset, N: the drift of the load cell. `None` without either.
    pub drift_n: Option<f64>,
    /// Measured displacements.
    pub motion: Option<MeasuredMotion>,
}

/// Displacements over the depth of the needle.
#[derive(Clone, Debug)]
pub(super) struct MeasuredMotion {
    /// Points at rest, and the directions along which their displacement is measured.
    pub points: Vec<(Point3<f64>, Vector3<f64>)>,
    /// Depths of the tip, mm, rising.
    pub depths_mm: Vec<f64>,
    /// At each depth the displacement of each point, mm; NaN where it is not measured.
    pub measured_mm: Vec<Vec<f64>>,
}

fn unusable(path: &Path, text: String) -> Error {
    CsvError::Contents {
        path: path.to_owned(),
        text,
    }
    .into()
}

/// Rows of the first push, in which the tip is in the tissue and deeper than ever before.
fn first_push(depths: &[f64]) -> Vec<usize> {
    let mut deepest = 0.0;
    let mut rows = Vec::new();
    for (row, depth) in depths.iter().enumerate() {
        if deepest > 0.0 && *depth < deepest - RETREAT_MM {
            break;
        }
        if *depth > deepest + 1e-9 {
            deepest = *depth;
            rows.push(row);
        }
    }
    rows
}

impl Measurements {
    /// Reads the tables of a case.
    ///
    /// # Errors
    /// [`Error`] with the table and what it lacks.
    pub(super) fn read(case: &IdentificationCase) -> Result<Self, Error> {
        let (force, offset_n, drift_n) = forces(case)?;
        let end = force.last().map_or(0.0, |row| row[0]);
        if let Some(layer) = case.layers.iter().find(|layer| layer.begins_mm >= end) {
            let text = format!(
                "found forces up to a depth of {end:.1} mm; {} on the needle's line begins at {:.1} mm",
                layer.name, layer.begins_mm
            );
            return Err(unusable(&case.force, text));
        }
        let motion = match &case.motion {
            None => None,
            Some(spec) => Some(MeasuredMotion::read(case, &spec.file, spec.frames.as_deref(), end)?),
        };
        Ok(Self {
            force,
            offset_n,
            drift_n,
            motion,
        })
    }

    /// Piecewise-linear model of the force, two regions a layer.
    ///
    /// # Errors
    /// [`Error`] if the force does not have these regions.
    pub(super) fn model(&self, case: &IdentificationCase) -> Result<Piecewise, Error> {
        let regions = 2 * case.layers.len();
        let expected = format!(
            "{regions} regions with a rising force, two for each of {} layers",
            case.layers.len()
        );
        let Some(model) = Piecewise::fit(&self.force, regions) else {
            let text = format!(
                "found {} forces of the first push; expected enough for {expected}",
                self.force.len()
            );
            return Err(unusable(&case.force, text));
        };
        match model.doubt(&self.force) {
            Some(doubt) => Err(unusable(&case.force, format!("found {doubt}; expected {expected}"))),
            None => Ok(model),
        }
    }
}

/// Means of row number and force (N) over the rows in which the tip is clear of the tissue, of rows from an end of the
/// table on; `None` if these are too few.
fn outside<'a>(rows: impl Iterator<Item = (usize, &'a [f64; 2])>) -> Option<(f64, f64)> {
    let clear: Vec<(usize, f64)> = rows
        .take_while(|(_, row)| row[0] <= 0.0)
        .filter(|(_, row)| row[0] <= -BEFORE_MM)
        .map(|(index, row)| (index, row[1]))
        .collect();
    let count = clear.len() as f64;
    let sums = clear
        .iter()
        .fold((0.0, 0.0), |(index, force), row| (index + row.0 as f64, force + row.1));
    (clear.len() >= MIN_BEFORE).then(|| (sums.0 / count, sums.1 / count))
}

/// The curve of the first push less offset and drift of the load cell, and these two.
fn forces(case: &IdentificationCase) -> Result<(Vec<[f64; 2]>, Option<f64>, Option<f64>), Error> {
    let path = &case.force;
    let table = Csv::open(path, &[])?;
    let tip = ["measured_tip_x_mm", "measured_tip_y_mm", "measured_tip_z_mm"];
    let is_steps = tip.iter().all(|name| table.has(name)) && table.has("base_force_z_n");
    let is_curve = table.has("tip_mm") && table.has("force_n");
    if !is_steps && !is_curve {
        let text = "found other columns; expected tip_mm,force_n, or a table of steps of `insonify insert`";
        return Err(unusable(path, text.to_owned()));
    }
    let mut rows = Vec::new();
    for row in table.rows() {
        rows.push(if is_steps {
            let offset = Point3::from(row.numbers(tip)?) - case.entry;
            [offset.dot(&case.direction), -row.number("base_force_z_n")?]
        } else {
            row.numbers(["tip_mm", "force_n"])?
        });
    }
    let depths: Vec<f64> = rows.iter().map(|row| row[0]).collect();
    let before = outside(rows.iter().enumerate());
    let after = outside(rows.iter().enumerate().rev());
    // What the load cell reads without a force: a drift is even over the rows.
    let (offset_n, drift_n) = (
        before.map(|(_, force)| force),
        before.zip(after).map(|(a, b)| b.1 - a.1),
    );
    let zero = |index: usize| match (before, after) {
        (Some((first, offset)), Some((last, end))) if last > first => {
            offset + (end - offset) * (index as f64 - first) / (last - first)
        }
        _ => offset_n.unwrap_or(0.0),
    };
    let push: Vec<[f64; 2]> = first_push(&depths)
        .into_iter()
        .map(|index| [rows[index][0], rows[index][1] - zero(index)])
        .collect();
    let Some(end) = push.last().map(|row| row[0]) else {
        return Err(unusable(
            path,
            "found no tip in the tissue; expected depths above 0 mm".to_owned(),
        ));
    };
    if end > case.deepest_mm + RETREAT_MM {
        let text = format!(
            "found a tip {end:.1} mm deep; the path of the scenario's needle ends at {:.1} mm",
            case.deepest_mm
        );
        return Err(unusable(path, text));
    }
    // A gap could hide the end of a region, and with it a puncture.
    let mut before = 0.0;
    for [depth, _] in &push {
        if depth - before > MAX_GAP_SHARE * end {
            let text = format!(
                "found no force between {before:.2} and {depth:.2} mm; expected forces at least every {:.2} mm",
                MAX_GAP_SHARE * end
            );
            return Err(unusable(path, text));
        }
        before = *depth;
    }
    if push.last().is_some_and(|row| row[1] <= 0.0) {
        let text = "found a force that is not positive at the deepest point; expected one that is positive while the needle is pushed in";
        return Err(unusable(path, text.to_owned()));
    }
    Ok((thinned(&push), offset_n, drift_n))
}

/// Means of neighbouring points, at most 300.
pub(super) fn thinned(curve: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let mean =
        |rows: &[[f64; 2]]| [0, 1].map(|column| rows.iter().map(|row| row[column]).sum::<f64>() / rows.len() as f64);
    curve
        .chunks(curve.len().div_ceil(MAX_POINTS).max(1))
        .map(mean)
        .collect()
}

/// A displacement that was read: point, depth of the tip, displacement, mm.
type Reading = (usize, f64, f64);

impl MeasuredMotion {
    fn read(case: &IdentificationCase, path: &Path, frames: Option<&Path>, end: f64) -> Result<Self, Error> {
        let table = Csv::open(path, &[])?;
        let has = |names: &[&str]| names.iter().all(|name| table.has(name));
        let (points, readings) = if has(&["frame", "line", "window", "depth_mm", "axial_um"]) {
            windows(case, &table, path, &depths_of_frames(case, frames, path)?)?
        } else if table.has("tip_mm") && (table.has("node") || has(&["x_mm", "y_mm", "z_mm"])) {
            markers(case, &table)?
        } else {
            let expected =
                "a table of `insonify motion`, or the columns tip_mm, node or x_mm,y_mm,z_mm, and ux_mm,uy_mm,uz_mm";
            return Err(unusable(path, format!("found other columns; expected {expected}")));
        };
        let mut all_depths: Vec<f64> = readings.iter().map(|reading| reading.1).collect();
        all_depths.dedup();
        let mut depths: Vec<f64> = first_push(&all_depths)
            .into_iter()
            .map(|index| all_depths[index])
            .collect();
        depths.retain(|depth| *depth <= end + RETREAT_MM);
        if depths.len() > MAX_DEPTHS {
            let stride = (depths.len() - 1) as f64 / (MAX_DEPTHS - 1) as f64;
            depths = (0..MAX_DEPTHS)
                .map(|step| depths[(step as f64 * stride).round() as usize])
                .collect();
        }
        let mut measured = vec![vec![f64::NAN; points.len()]; depths.len()];
        let mut done = vec![false; depths.len()];
        let mut before = f64::NAN;
        for (point, depth, moved) in readings {
            // Rows of a later visit of the same depth are not of the first push.
            if depth != before {
                if let Some(row) = depths.iter().position(|known_depth| *known_depth == before) {
                    done[row] = true;
                }
                before = depth;
            }
            if let Some(row) = depths
                .iter()
                .position(|known_depth| *known_depth == depth)
                .filter(|row| !done[*row])
            {
                measured[row][point] = moved;
            }
        }
        let motion = Self {
            points,
            depths_mm: depths,
            measured_mm: measured,
        };
        motion.within(case, path)
    }

    /// Drops points outside the mesh and those that are never measured.
    fn within(mut self, case: &IdentificationCase, path: &Path) -> Result<Self, Error> {
        let locator = Locator::<f64>::new(&case.scenario.mesh);
        let is_kept = |point: usize| {
            let (rest_mm, _) = self.points[point];
            let measured = self.measured_mm.iter().any(|row| row[point].is_finite());
            measured && locator.locate(rest_mm.into(), NO_ELEMENT).element != NO_ELEMENT
        };
        let kept_points: Vec<usize> = (0..self.points.len()).filter(|point| is_kept(*point)).collect();
        if kept_points.is_empty() || self.depths_mm.len() < 2 {
            let text = format!(
                "found {} places in the mesh that are measured, at {} depths of the first push; expected several of both",
                kept_points.len(),
                self.depths_mm.len()
            );
            return Err(unusable(path, text));
        }
        self.points = kept_points.iter().map(|point| self.points[*point]).collect();
        for row in &mut self.measured_mm {
            *row = kept_points.iter().map(|point| row[*point]).collect();
        }
        Ok(self)
    }
}

/// Depth of the tip in each frame, mm.
fn depths_of_frames(
    case: &IdentificationCase,
    frames: Option<&Path>,
    motion: &Path,
) -> Result<BTreeMap<usize, f64>, Error> {
    let mut depths = BTreeMap::new();
    if let Some(path) = frames {
        let table = Csv::open(path, &["frame", "tip_mm"])?;
        for row in table.rows() {
            depths.insert(row.count("frame")?, row.number("tip_mm")?);
        }
    } else {
        let timing = case.scenario.timing;
        for frame in 0..timing.moments(timing.frame_s) {
            let step = timing
                .step_at(timing.start_s + frame as f64 * timing.frame_s)
                .min(timing.steps);
            let tip = case.scenario.needle_tip().at(timing.at(step)).position_mm();
            depths.insert(frame as usize, (tip - case.entry).dot(&case.direction));
        }
    }
    match depths.get(&0) {
        Some(depth) if *depth > 0.0 => {
            let text = format!(
                "found the needle {depth:.1} mm deep in the first frame, against which motion is measured; expected it outside"
            );
            Err(unusable(frames.unwrap_or(motion), text))
        }
        _ => Ok(depths),
    }
}

/// Windows of ultrasonic lines, gathered in cells.
fn windows(
    case: &IdentificationCase,
    table: &Csv,
    path: &Path,
    depths: &BTreeMap<usize, f64>,
) -> Result<(Vec<(Point3<f64>, Vector3<f64>)>, Vec<Reading>), Error> {
    let grid = BeamGrid::new(&case.scenario.scene.settings.probe)?;
    let to_world = case.scenario.probe(0);
    let mut points = Vec::new();
    let mut cells: BTreeMap<[i64; 2], usize> = BTreeMap::new();
    // Windows of each cell in a frame: displacements of those that correlate, and the number of all.
    let mut by_cell: BTreeMap<(usize, usize), (Vec<f64>, usize)> = BTreeMap::new();
    let correlation = ["least_correlation", "correlation"]
        .into_iter()
        .find(|name| table.has(name));
    for row in table.rows() {
        let (frame, line) = (row.count("frame")?, row.count("line")?);
        let [depth, axial] = row.numbers(["depth_mm", "axial_um"])?;
        let Some(ray) = grid.rays().get(line) else {
            let expected = format!("one of {} lines, those of the scenario's probe", grid.lines());
            return Err(row.wrong("line", expected).into());
        };
        if !depths.contains_key(&frame) {
            return Err(row.wrong("frame", "a frame whose depth of the needle is known").into());
        }
        let [x, y] = [0, 1].map(|axis| ray.origin[axis] + depth * ray.direction[axis]);
        let key = [x, y].map(|coordinate| (coordinate / CELL_MM).floor() as i64);
        let cell = *cells.entry(key).or_insert_with(|| {
            let middle = key.map(|cell_index| (cell_index as f64 + 0.5) * CELL_MM);
            let beam_axis = to_world.rotation * Vector3::new(ray.direction[0], ray.direction[1], 0.0);
            points.push((to_world * Point3::new(middle[0], middle[1], 0.0), beam_axis));
            points.len() - 1
        });
        let (values, count) = by_cell.entry((frame, cell)).or_default();
        *count += 1;
        let correlates = correlation.map_or(Ok(true), |name| row.number(name).map(|value| value >= MIN_CORRELATION))?;
        if correlates {
            values.push(1e-3 * axial);
        }
    }
    if cells.is_empty() {
        return Err(unusable(path, "found no windows".to_owned()));
    }
    // Cells at the edges of the image have fewer windows, off their middle.
    let largest_count = by_cell.values().map(|(_, count)| *count).max().unwrap_or(0);
    let mut readings = Vec::new();
    for ((frame, cell), (mut values, count)) in by_cell {
        values.sort_by(f64::total_cmp);
        if (values.len() as f64) < MIN_CORRELATED_SHARE * largest_count as f64 || 4 * count < 3 * largest_count {
            continue;
        }
        if let Some(middle) = percentile(&values, 0.5) {
            readings.push((cell, depths[&frame], middle));
        }
    }
    Ok((points, readings))
}

/// Nodes or marked points with some components of their displacement.
fn markers(case: &IdentificationCase, table: &Csv) -> Result<(Vec<(Point3<f64>, Vector3<f64>)>, Vec<Reading>), Error> {
    let columns = ["ux_mm", "uy_mm", "uz_mm"];
    let nodes = case.scenario.mesh.nodes();
    let mut points: Vec<(Point3<f64>, Vector3<f64>)> = Vec::new();
    let mut indices: BTreeMap<([u64; 3], usize), usize> = BTreeMap::new();
    let mut readings = Vec::new();
    for row in table.rows() {
        let depth = row.number("tip_mm")?;
        let node_mm = if table.has("node") {
            match nodes.get(row.count("node")?) {
                Some(position) => *position,
                None => {
                    return Err(row
                        .wrong("node", format!("one of {} nodes of the mesh, from 0", nodes.len()))
                        .into());
                }
            }
        } else {
            row.numbers(["x_mm", "y_mm", "z_mm"])?
        };
        for (axis, column) in columns
            .iter()
            .enumerate()
            .filter(|(_, column)| !row.text(column).is_empty())
        {
            let moved = row.number(column)?;
            // A point has a row for each depth: its place at rest says which it is.
            let point = *indices.entry((node_mm.map(f64::to_bits), axis)).or_insert_with(|| {
                let mut direction = Vector3::zeros();
                direction[axis] = 1.0;
                points.push((node_mm.into(), direction));
                points.len() - 1
            });
            readings.push((point, depth, moved));
        }
    }
    Ok((points, readings))
}
