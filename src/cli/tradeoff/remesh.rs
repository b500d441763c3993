//! `insonify tradeoff remesh`: levels of remeshing.

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use insonify_mesh::TetMesh;
use insonify_mesh::file::{ReadOptions, read_mesh};
use insonify_study::tradeoff::gather::Devices;
use insonify_study::tradeoff::remesh::subject::generated;
use insonify_study::tradeoff::remesh::{NODES, RemeshOptions, study};

use crate::backend::{BackendArgs, BackendName};
use crate::failure::{Error, usage};
use crate::study::Printed;
use crate::terminal;
use crate::variants::ranged;

use super::effort;

const EXAMPLES: &str = "\
Examples:
  insonify tradeoff remesh --quick                              a first look, in seconds
  insonify tradeoff remesh -o study                             the default mesh, with plots
  insonify tradeoff remesh --nodes 500,1000,3300,10000 -o study  growth with the size of the mesh
  insonify tradeoff remesh --mesh organs.vtu --poisson 0.49 --json

A row with a star is a best choice: no other is both faster and nearer to the truth. A row that violates the guarantee of its
level is marked WRONG.";

/// Levels of remeshing: time against error, for each level, backend and precision
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Remesh {
    /// Tetrahedral mesh to study (Gmsh, VTK, VTU); its lowest nodes along z, at least 3 % of all, are fixed [default: a generated
    /// block]
    #[arg(long, value_name = "FILE", conflicts_with = "nodes")]
    mesh: Option<PathBuf>,
    /// Nodes of the generated meshes [default: 3300; with --quick 500]
    #[arg(long, value_name = "N,...", value_delimiter = ',', value_parser = node_count)]
    nodes: Vec<usize>,
    /// Number of remeshes of each contender, insertions and withdrawals of the needle together [default: 1000; with
    /// --quick 60]
    #[arg(long, value_name = "N", value_parser = update_count)]
    updates: Option<usize>,
    /// Young's modulus, kPa
    #[arg(long, value_name = "KPA", default_value_t = RemeshOptions::default().young_kpa, allow_negative_numbers = true)]
    young_kpa: f64,
    /// Poisson's ratio, above -1 and below 0.5
    #[arg(long, value_name = "NU", default_value_t = RemeshOptions::default().poisson, allow_negative_numbers = true)]
    poisson: f64,
    /// Seconds after which a contender ends early
    #[arg(long, alias = "patience-s", value_name = "S", value_parser = super::super::bench::seconds)]
    time_limit_s: Option<f64>,
    /// A small mesh and few updates
    #[arg(long)]
    quick: bool,
    #[command(flatten)]
    backend: BackendArgs,
    #[command(flatten)]
    printed: Printed,
}

impl Remesh {
    pub(super) fn run(&self) -> Result<(), Error> {
        self.backend.check()?;
        self.printed.check()?;
        let meshes = self.meshes()?;
        let Devices { gpus, missing } = self.backend.gpus()?;
        self.printed.run(|progress| {
            let mut study = study(&meshes, &gpus, &self.options(), progress)?;
            study.notes.extend(missing);
            Ok(study)
        })
    }

    fn options(&self) -> RemeshOptions {
        let usual = RemeshOptions::of(effort(self.quick));
        RemeshOptions {
            young_kpa: self.young_kpa,
            poisson: self.poisson,
            moves: usual.moves,
            updates: self.updates.unwrap_or(usual.updates),
            patience: self.time_limit_s.map_or(usual.patience, Duration::from_secs_f64),
            cpu: self.backend.backend != BackendName::Gpu,
        }
    }

    fn meshes(&self) -> Result<Vec<TetMesh>, Error> {
        if let Some(path) = &self.mesh {
            let file = read_mesh(path, &ReadOptions::default())?;
            file.warnings.iter().for_each(terminal::warn);
            return Ok(vec![file.mesh]);
        }
        let usual = effort(self.quick).pick(NODES.0, NODES.1);
        let nodes = if self.nodes.is_empty() {
            vec![usual]
        } else {
            self.nodes.clone()
        };
        let made = nodes.iter().map(|nodes| {
            generated(*nodes).map_err(|error| usage(format!("--nodes {nodes}: {error}"), "ask for other nodes"))
        });
        made.collect()
    }
}

pub(super) fn node_count(text: &str) -> Result<usize, String> {
    ranged(text, 100..=100_000, "a number of nodes from 100 to 100000")
}

fn update_count(text: &str) -> Result<usize, String> {
    ranged(text, 1..=1_000_000, "a number of updates from 1 to 1000000")
}
