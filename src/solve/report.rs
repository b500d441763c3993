//! Report of a solution.

use std::collections::BTreeMap;
use std::fmt;

use serde::Serialize;

use super::{History, Solved};
use crate::input::statics::Problem;
use crate::input::statics::course::Model;
use insonify_base::number::decimal;
use insonify_base::table::{Cell, Table};

/// Summary of a solved problem, as `insonify solve --json` prints it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// Tissue model.
    pub model: Model,
    /// Number of nodes.
    pub nodes: usize,
    /// Number of tetrahedra.
    pub elements: usize,
    /// Normwise backward error of the solution; with a history the largest residual force over the largest force, at
    /// the end.
    pub residual: f64,
    /// Displacements of the requested nodes, in that order, mm.
    pub displacement_mm: Vec<[f64; 3]>,
    /// Largest displacement magnitude of all nodes, mm.
    pub max_displacement_mm: f64,
    /// Total force of each `[[load]]`, as written, N.
    pub load_n: Vec<[f64; 3]>,
    /// Surface area loaded by each `[[load]]`, mm^2; 0 for nodal forces.
    pub load_area_mm2: Vec<f64>,
    /// Total weight of the tissue, N, under gravity.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub weight_n: Option<[f64; 3]>,
    /// Total reaction force of each `[[fix]]` on the mesh, N. A degree of freedom fixed by two counts for the first.
    pub reaction_n: Vec<[f64; 3]>,
    /// Wall-clock time by phase, and in total, s.
    pub seconds: BTreeMap<&'static str, f64>,
    /// Course over time, for models with a history.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub history: Option<History>,
    /// Warnings about the problem.
    pub warnings: Vec<String>,
    /// Numbers of the requested nodes.
    #[serde(skip)]
    report_nodes: Vec<u32>,
    /// Node with the largest displacement.
    #[serde(skip)]
    farthest: usize,
}

impl Report {
    /// Creates the report of a problem and its solution.
    ///
    /// # Panics
    /// Panics if the solution belongs to another mesh.
    pub fn new(problem: &Problem, solved: &Solved) -> Report {
        let solution = &solved.solution;
        let length = |u: &[f64; 3]| u.iter().fold(0.0, |a: f64, x| a.hypot(*x));
        let lengths = solution.displacement_mm.iter().map(length).enumerate();
        let (farthest, max) = lengths.fold((0, 0.0), |best, next| if next.1 > best.1 { next } else { best });
        let phases = &solution.seconds;
        let phases = [
            ("read", problem.read_seconds),
            ("check", phases.check),
            ("assembly", phases.assembly),
            ("factor", phases.factor),
            ("solve", phases.solve),
        ];
        let total = phases.iter().map(|(_, seconds)| seconds).sum();
        let displacement = |node: &u32| solution.displacement_mm[*node as usize];
        Report {
            model: problem.file.model,
            history: solved.history.clone(),
            nodes: problem.mesh.nodes().len(),
            elements: problem.mesh.elements().len(),
            residual: solution.residual,
            displacement_mm: problem.report_nodes.iter().map(displacement).collect(),
            max_displacement_mm: max,
            load_n: problem.load_n(),
            load_area_mm2: problem.loads.area_mm2.clone(),
            weight_n: problem.weight_n(),
            reaction_n: problem.reactions(solution),
            seconds: phases.into_iter().chain([("total", total)]).collect(),
            warnings: problem.warnings.clone(),
            report_nodes: problem.report_nodes.clone(),
            farthest,
        }
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "mesh         {} nodes, {} tetrahedra", self.nodes, self.elements)?;
        // A history is solved by iterations, which stop at a small force; a linear problem by one solve,
        // whose error is that of rounding.
        let error_name = match self.history {
            None => "normwise backward error",
            Some(_) => "largest force out of balance over the largest force",
        };
        writeln!(f, "residual     {:.1e} ({error_name})", self.residual)?;
        if let Some(history) = &self.history {
            let [iterations, factorisations] =
                [&history.iterations, &history.factorisations].map(|counts| counts.iter().sum::<usize>());
            writeln!(
                f,
                "history      {} steps to {} s, {iterations} iterations, {factorisations} factorisations",
                history.time_s.len() - 1,
                history.time_s.last().copied().unwrap_or(0.0)
            )?;
        }
        writeln!(
            f,
            "farthest     {:.6} mm, node {}",
            self.max_displacement_mm, self.farthest
        )?;
        let forces = |name: &str| [name, "x N", "y N", "z N", "on mm^2"].map(Cell::number);
        let fixed = self.reaction_n.iter().enumerate();
        let fixed = fixed.map(|(fix, force)| row(format!("fix[{fix}]"), force, None));
        put(f, Table::new(forces("held by").into_iter().take(4)).with(fixed))?;
        let loads = self.load_n.iter().zip(&self.load_area_mm2).enumerate();
        let loads = loads.map(|(load, (force, area))| {
            // Forces at nodes have no area to spread over.
            let area = match area {
                0.0 => "nodes".to_owned(),
                area => format!("{area:.3}"),
            };
            row(format!("load[{load}]"), force, Some(area))
        });
        let weight = self.weight_n.map(|weight| row("weight".to_owned(), &weight, None));
        put(f, Table::new(forces("loaded by")).with(loads.chain(weight)))?;
        let nodes = self.report_nodes.iter().zip(&self.displacement_mm);
        let nodes = nodes.map(|(node, displacement)| row(node.to_string(), displacement, None));
        let head = ["node", "x mm", "y mm", "z mm"].map(Cell::number);
        put(f, Table::new(head).with(nodes))?;
        let phases = ["read", "check", "assembly", "factor", "solve", "total"].iter();
        let phases = phases.filter_map(|name| Some(format!("{name} {:.1}", 1e3 * self.seconds.get(name)?)));
        write!(f, "\nmilliseconds {}", phases.collect::<Vec<_>>().join(", "))
    }
}

/// Writes a table below an empty line, unless it is empty.
fn put(f: &mut fmt::Formatter<'_>, table: Table) -> fmt::Result {
    if table.is_empty() {
        Ok(())
    } else {
        write!(f, "\n{}", table.text(" ", &[10, 14, 14, 14, 14]))
    }
}

fn row(name: String, vector: &[f64; 3], more: Option<String>) -> Vec<String> {
    let cells = std::iter::once(name).chain(vector.map(|x| decimal(x, 6)));
    cells.chain(more).collect()
}
