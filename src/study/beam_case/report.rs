//! Report and plot of a bent needle.

use std::fmt;

use serde::Serialize;

use super::BeamCase;
use insonify_base::number::decimal;
use insonify_base::table::{Cell, Table};
use insonify_mechanics::needle::beam::{LayerLoad, Shape};
use insonify_report::plot::{Axis, Marker, Plot, Series};

/// Number of rows of the shape in the text report.
const ROWS: usize = 12;
/// Number of curve points between two nodes.
const FINE: usize = 4;

/// Results for a bent needle, as `insonify beam --json` prints them.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BeamReport {
    /// Deflection of the tip, mm.
    pub tip_mm: f64,
    /// Remote centre of motion: intersection of the tangent at the base with the undeflected needle, mm below the
    /// entry.
    pub rcm_mm: Option<f64>,
    /// Centre of motion: first point with zero deflection, mm below the entry.
    pub com_mm: Option<f64>,
    /// Largest residual moment over the largest moment.
    pub residual: f64,
    /// Number of Newton iterations.
    pub iterations: usize,
    /// Nodes, from base to tip.
    pub shape: Vec<Node>,
    /// Force and moment at the base, N and N mm.
    #[serde(skip)]
    base_load: [f64; 2],
    #[serde(skip)]
    least_ratio: f64,
    /// Loads on the layers that the needle reaches.
    #[serde(skip)]
    layers: Vec<LayerLoad>,
}

/// A node of the needle.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Node {
    /// Position along the undeflected needle, mm from the entry.
    pub x: f64,
    /// Deflection, mm.
    pub u: f64,
    /// Slope du/dx.
    pub slope: f64,
    /// Tissue reaction per length, N/mm, with the sign of the deflection; at the boundary of layers that of the deeper
    /// one.
    pub reaction: f64,
}

impl BeamReport {
    /// Creates the report of a shape.
    pub fn new(shape: &Shape) -> BeamReport {
        let nodes = shape.points.iter().map(|point| Node {
            x: point.x_mm,
            u: point.u_mm,
            slope: point.slope,
            reaction: point.reaction_n_per_mm,
        });
        BeamReport {
            tip_mm: shape.tip_mm(),
            rcm_mm: shape.rcm_mm(),
            com_mm: shape.com_mm(),
            residual: shape.residual,
            iterations: shape.iterations,
            shape: nodes.collect(),
            base_load: [shape.base_force_n, shape.base_moment_nmm],
            least_ratio: shape.least_ratio,
            layers: shape.layers.clone(),
        }
    }
}

impl fmt::Display for BeamReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let depth = |depth: Option<f64>| {
            depth.map_or("none".to_owned(), |depth| {
                format!("{} mm below the entry", decimal(depth, 4))
            })
        };
        writeln!(f, "tip          {} mm", decimal(self.tip_mm, 6))?;
        writeln!(f, "RCM          {} (where the base points)", depth(self.rcm_mm))?;
        writeln!(f, "COM          {} (where the needle pivots)", depth(self.com_mm))?;
        let [force, moment] = self.base_load.map(|load| decimal(load, 6));
        writeln!(f, "base         {force} N, {moment} N mm")?;
        writeln!(f, "compression  to {:.4} of the tissue's length", self.least_ratio)?;
        for load in &self.layers {
            let [from, to] = load.depths_mm.map(|depth| decimal(depth, 1));
            let (name, force) = (format!("layer {}", load.layer + 1), decimal(load.force_n, 4));
            write!(
                f,
                "{name:<12} {from} to {to} mm: to {:.4} of its length",
                load.least_ratio
            )?;
            let [depth, most] = [decimal(load.least_at_mm, 1), decimal(load.most_n_per_mm, 4)];
            writeln!(f, " at {depth} mm, at most {most} N/mm, {force} N in all")?;
        }
        writeln!(
            f,
            "residual     {:.1e}, {} Newton steps\n",
            self.residual, self.iterations
        )?;
        // Fine meshes have more nodes than fit: every n-th is shown, and the tip always.
        let last = self.shape.len().saturating_sub(1);
        let every = last.div_ceil(ROWS).max(1);
        let shown = self.shape.iter().enumerate();
        let shown = shown.filter(|(index, _)| index % every == 0 || *index == last);
        let rows = shown.map(|(_, Node { x, u, slope, reaction })| {
            [(*x, 3), (*u, 6), (*slope, 6), (*reaction, 6)].map(|(value, digits)| decimal(value, digits))
        });
        let head = ["x mm", "u mm", "slope", "reaction N/mm"].map(Cell::number);
        f.write_str(&Table::new(head).with(rows).text(" ", &[10, 12, 12, 14]))
    }
}

/// Plots the needle in its tissue: its shape, the tangent at its base, and both centres of motion.
pub fn plot(case: &BeamCase, shape: &Shape) -> Plot {
    let nodes: Vec<f64> = shape.points.iter().map(|point| point.x_mm).collect();
    // Deflections are cubic between nodes: straight lines from node to node would show corners.
    let between = |pair: &[f64]| {
        let (from, length) = (pair[0], pair[1] - pair[0]);
        (1..=FINE).map(move |part| from + length * part as f64 / FINE as f64)
    };
    let positions = nodes
        .first()
        .copied()
        .into_iter()
        .chain(nodes.windows(2).flat_map(between));
    let needle: Vec<[f64; 2]> = positions.map(|x| [x, shape.at(x)[0]]).collect();
    let deflections = || needle.iter().map(|point| point[1]);
    let low = deflections().fold(0.0, f64::min);
    let high = deflections().fold(0.0, f64::max);
    let mut series = Vec::new();
    let mut depth = 0.0;
    let boundaries = case.problem.layers.iter().map(|layer| layer.thickness_mm);
    for boundary in std::iter::once(0.0).chain(boundaries) {
        depth += boundary;
        series.push(Series::line("layers of tissue", 5, vec![[depth, low], [depth, high]]));
    }
    let base = &shape.points[0];
    let tip = nodes[nodes.len() - 1];
    // The tangent meets the axis at the RCM; one behind the base would lead the line away from the tissue.
    let reach = shape.rcm_mm().filter(|rcm| *rcm > base.x_mm).unwrap_or(tip);
    let end = [reach, base.u_mm + base.slope * (reach - base.x_mm)];
    series.extend([
        Series::line("at rest", 6, vec![[base.x_mm, 0.0], [tip, 0.0]]),
        Series::line("where the base points", 4, vec![[base.x_mm, base.u_mm], end]),
        Series::line("needle", 0, needle),
    ]);
    if !case.measured_mm.is_empty() {
        series.push(Series::line("measured", 3, case.measured_mm.clone()));
    }
    for (name, depth, colour) in [("RCM", shape.rcm_mm(), 1), ("COM", shape.com_mm(), 2)] {
        series.extend(depth.map(|depth| Series::points(name, colour, Marker::Disc, vec![[depth, 0.0]])));
    }
    let [x, y] = ["depth, mm", "deflection, mm"].map(Axis::linear);
    Plot::new("Needle whose base is moved", x, y, series)
}
