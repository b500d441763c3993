//! `insonify solve`: a static problem of tissue mechanics.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use insonify::input::statics::{self, Model, ProblemFile};
use insonify::solve::Report;
use insonify_mesh::file::{DISPLACEMENT, Values, write_vtu_with};

use super::failure::{Error, usage};
use super::output::{self, Force};
use super::terminal;

const EXAMPLES: &str = "\
The case names a mesh, the [[material]] of each region, and what is held ([[fix]]) and loaded ([[load]]): nodes by number, or those that
a box, a cylinder, a region (by name or number) or its surface (surface_of) and the surface of the mesh have in common:
  mesh = \"organs.msh\"                       # mesh_unit = \"m\" of a mesh in metres
  gravity_m_per_s2 = [0.0, 9.81, 0.0]        # on the density_kg_per_m3 of each material
  [[material]]                               # without region: all that have none of their own
  young_kpa = 5.0
  poisson = 0.45
  density_kg_per_m3 = 1050.0
  [[fix]]
  region = \"kidney_right\"                  # surface = true: its nodes on the surface only
  [[load]]
  box_mm = [[-inf, -inf, 50.0], [inf, inf, inf]]
  total_force_n = [0.0, 0.0, -0.5]           # over the surface in the box; or pressure_kpa, or node_force_n on each node

Examples:
  insonify solve --example > case.toml             a file to start from: every key, its unit and default
  insonify solve case.toml                         displacements, loads and reactions as a table
  insonify solve case.toml -o deformed.vtu         for ParaView: warp by the point array `displacement`
  insonify solve case.toml --json | jq .displacement_mm
  insonify schema solve                            every key, as a JSON schema

By default tissue is linear elastic, solved directly; `residual` is the normwise backward error, about 1e-16.
With `model = \"nonlinear\"` a material stiffens above a knee: young_kpa (1 + stiffening (e - knee_strain)^2), e the relative strain.
With `model = \"viscoelastic\"` it creeps too, with a derivative of fractional order ([viscosity]). Both follow a [history]
of times and factors of all loads and displacements, in steps; [solver] says how each step is solved:
  insonify solve --example=viscoelastic > creep.toml
  insonify solve creep.toml --history creep.csv    displacements of report_nodes and forces of each fix, a row a step
Strain and stress in OUT.vtu are symmetric tensors of each element (xx, yy, zz, xy, yz, xz), shear strain half of the angle.
Exit status: 0 solved; 2 the case or a file is wrong; 1 a failure of the machine.";

/// Solves a static case: how tissue deforms under forces and prescribed displacements
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Solve {
    /// Case file: mesh, materials, fixed nodes and loads
    #[arg(value_name = "CASE.toml", required_unless_present = "example")]
    case: Option<PathBuf>,
    /// Print an example case file, which says how its mesh is made
    #[arg(
        long, value_name = "MODEL", num_args = 0..=1, require_equals = true, default_missing_value = "linear",
        conflicts_with_all = ["case", "json", "output", "history"]
    )]
    example: Option<Example>,
    /// Print one JSON object: `model`, `nodes`, `elements`, `residual`, `displacement_mm`, `max_displacement_mm`,
    /// `load_n`, `load_area_mm2`, `weight_n`, `reaction_n`, `seconds`, `warnings`, and for models with a history
    /// `history`
    #[arg(long)]
    json: bool,
    /// Write the mesh with `displacement` (mm) and `reaction_n` (N) of its nodes, and `strain`, `stress_kpa` (symmetric
    /// tensors: xx, yy, zz, xy, yz, xz) and `von_mises_kpa` of its elements
    #[arg(short, long, value_name = "OUT.vtu")]
    output: Option<PathBuf>,
    /// Write the history: displacements of `report_nodes` (mm) and forces of each fix (N), one row per step
    #[arg(long, value_name = "OUT.csv")]
    history: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
}

#[derive(Clone, Copy, ValueEnum)]
enum Example {
    /// A plate on linear tissue
    Linear,
    /// A plate on stiffening, viscoelastic liver
    Viscoelastic,
}

impl Solve {
    pub(crate) fn run(&self) -> Result<(), Error> {
        let path = match (&self.case, self.example) {
            (Some(path), None) => path.as_path(),
            (_, Some(Example::Viscoelastic)) => return terminal::emit(statics::CREEP),
            (_, Some(Example::Linear) | None) => return terminal::emit(statics::EXAMPLE),
        };
        let inputs = output::inputs(path);
        self.force.check_ending(&self.output, "vtu", "meshes", &inputs)?;
        let outputs: Vec<&Path> = self.output.iter().chain(&self.history).map(PathBuf::as_path).collect();
        self.force.check(&outputs, &inputs)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let problem = ProblemFile::read(path)?.resolve(folder)?;
        if self.history.is_some() && problem.file.model == Model::Linear {
            let found = "--history of a case without one: `model = \"linear\"`".to_owned();
            return Err(usage(found, "leave it out, or give the case a model with a [history]"));
        }
        terminal::notes(&problem.notes);
        problem.warnings.iter().for_each(terminal::warn);
        let solved = problem.solve(self.output.is_some())?;
        if let (Some(output), Some(fields)) = (&self.output, &solved.fields) {
            // Only nodes that are held have reactions, while a mesh file needs a value at every node.
            let mut reactions = vec![[0.0; 3]; problem.mesh.nodes().len()];
            for reaction in &solved.solution.reactions {
                reactions[reaction.node as usize][usize::from(reaction.axis)] = reaction.force_n;
            }
            let of_nodes = [
                (DISPLACEMENT, Values::Vectors(&solved.solution.displacement_mm)),
                ("reaction_n", Values::Vectors(&reactions)),
            ];
            let of_elements = [
                ("strain", Values::Symmetric(&fields.strain)),
                ("stress_kpa", Values::Symmetric(&fields.stress_kpa)),
                ("von_mises_kpa", Values::Scalars(&fields.von_mises_kpa())),
            ];
            write_vtu_with(output, &problem.mesh, &Default::default(), &of_nodes, &of_elements)?;
        }
        if let (Some(output), Some(history)) = (&self.history, &solved.history) {
            let table = history.csv(&problem.report_nodes);
            output::text(output, &table)?;
        }
        let report = Report::new(&problem, &solved);
        terminal::print(&report, self.json)
    }
}
