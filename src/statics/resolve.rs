//! From a problem file to a problem, and to its solution.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

use super::course::Model;
use super::error::{StaticsError, Wrong};
use super::file::{MaterialSpec, ProblemFile};
use super::run::History;
use super::selection::AXES;
use crate::mechanics::mesh::TetMesh;
use crate::mechanics::mesh::file::{MeshFile, ReadOptions, read_mesh};
use crate::mechanics::mesh::quality::Quality;
use crate::mechanics::tissue::material::{Material, Materials, MaterialsError};
use crate::mechanics::tissue::nonlinear::Stiffening;
use crate::mechanics::tissue::problem::{Fix, Load, Solution, SolveError, StaticProblem};
use crate::mechanics::tissue::rigid::RigidError;

/// A static problem whose mesh is read and whose nodes are picked.
#[derive(Clone, Debug)]
pub struct Problem {
    pub(super) file: ProblemFile,
    mesh: TetMesh,
    materials: Materials,
    /// What materials do above their knee, by region.
    pub(super) laws: Vec<(Option<i32>, Stiffening)>,
    pub(super) fixes: Vec<Fix>,
    pub(super) loads: Vec<Load>,
    /// The `[[fix]]` that each of the fixes stands in.
    pub(super) tables: Vec<usize>,
    /// The `[[load]]` that each of the loads stands in.
    pub(super) load_tables: Vec<usize>,
    report_nodes: Vec<u32>,
    /// What is odd, though it can be solved.
    warnings: Vec<String>,
    read_seconds: f64,
}

/// A problem's solution, and for models with a history how it came to it.
#[derive(Clone, Debug, PartialEq)]
pub struct Solved {
    /// The state at the end.
    pub solution: Solution,
    /// What led there.
    pub history: Option<History>,
}

impl ProblemFile {
    /// Reads the mesh, picks the nodes and checks every number. Relative paths start at `base_dir`, the folder of the file.
    ///
    /// # Errors
    /// [`StaticsError`], with the key and its place in the file.
    pub fn resolve(self, base_dir: &Path) -> Result<Problem, StaticsError> {
        let started = Instant::now();
        let mut warnings = Vec::new();
        self.check_course()?;
        let materials = self.materials()?;
        let laws = self.laws()?;
        let options = ReadOptions {
            region: self.region.as_deref(),
            ..ReadOptions::default()
        };
        let read = read_mesh(&base_dir.join(&self.mesh), &options).map_err(|error| self.fault("mesh", error))?;
        warnings.extend(odd_in_file(&self.mesh, &read));
        let mesh = read.mesh;
        let quality = Quality::of(&mesh, mesh.nodes());
        quality.usable().map_err(|error| self.fault("mesh", error))?;
        warnings.extend(odd_in_mesh(&quality));
        for region in materials
            .named_regions()
            .filter(|region| !mesh.regions().contains(region))
        {
            warnings.push(format!(
                "the mesh has no region {region}, for which there is a material"
            ));
        }
        let (fixes, tables) = self.fixes(&mesh, &mut warnings)?;
        let (loads, load_tables) = self.loads(&mesh)?;
        if loads.iter().all(|load| load.force_n == [0.0; 3]) && fixes.iter().all(|fix| fix.displacement_mm == 0.0) {
            warnings.push("no force and no displacement is given: nothing moves".to_owned());
        }
        Ok(Problem {
            materials,
            laws,
            fixes,
            loads,
            tables,
            load_tables,
            report_nodes: self.numbered("report_nodes", &self.report_nodes, mesh.nodes().len())?,
            warnings,
            read_seconds: started.elapsed().as_secs_f64(),
            mesh,
            file: self,
        })
    }

    fn materials(&self) -> Result<Materials, StaticsError> {
        if self.material.is_empty() {
            return Err(self.wrong_keys("material".to_owned(), "no `[[material]]`", "at least one"));
        }
        let (mut default, mut by_region) = (None, Vec::new());
        for (at, spec) in self.material.iter().enumerate() {
            let material = self.material_of(at, spec)?;
            match spec.region {
                Some(region) => by_region.push((region, material)),
                None if default.is_none() => default = Some(material),
                None => {
                    let found = "a second material without `region`";
                    return Err(self.wrong_keys(
                        format!("material[{at}]"),
                        found,
                        "one at most, for all other regions",
                    ));
                }
            }
        }
        Materials::new(default, &by_region).map_err(|error| {
            let twice = |region: i32| self.material.iter().rposition(|spec| spec.region == Some(region));
            let at = match &error {
                MaterialsError::Twice { region, .. } => twice(*region),
                MaterialsError::Missing { .. } => None,
            };
            self.fault(
                at.map_or("material".to_owned(), |at| format!("material[{at}].region")),
                error,
            )
        })
    }

    pub(super) fn material_of(&self, at: usize, spec: &MaterialSpec) -> Result<Material, StaticsError> {
        Material::new(spec.young_kpa, spec.poisson)
            .map_err(|error| self.fault(format!("material[{at}].{}", error.key()), error))
    }

    /// Fixes, and the table that each comes from.
    fn fixes(&self, mesh: &TetMesh, warnings: &mut Vec<String>) -> Result<(Vec<Fix>, Vec<usize>), StaticsError> {
        let (mut fixes, mut tables) = (Vec::new(), Vec::new());
        for (at, spec) in self.fix.iter().enumerate() {
            let table = format!("fix[{at}]");
            let axes = self.axes(&table, &spec.axes)?;
            self.finite(&format!("{table}.displacement_mm"), &spec.displacement_mm)?;
            for axis in (0..3u8).filter(|axis| !axes.contains(axis) && spec.displacement_mm[*axis as usize] != 0.0) {
                let (axis, given) = (AXES[axis as usize], spec.displacement_mm[axis as usize]);
                warnings.push(format!(
                    "{table}: displacement_mm gives {given} mm along {axis}, but `axes = \"{}\"` leaves {axis} free",
                    spec.axes
                ));
            }
            for node in self.select(&table, spec.nodes.as_deref(), spec.box_mm.as_ref(), mesh.nodes())? {
                fixes.extend(axes.iter().map(|&axis| Fix {
                    node,
                    axis,
                    displacement_mm: spec.displacement_mm[axis as usize],
                }));
            }
            tables.resize(fixes.len(), at);
        }
        Ok((fixes, tables))
    }

    /// Loads, and the table that each comes from.
    fn loads(&self, mesh: &TetMesh) -> Result<(Vec<Load>, Vec<usize>), StaticsError> {
        let (mut loads, mut tables) = (Vec::new(), Vec::new());
        for (at, spec) in self.load.iter().enumerate() {
            let table = format!("load[{at}]");
            self.finite(&format!("{table}.force_n"), &spec.force_n)?;
            let nodes = self.select(&table, spec.nodes.as_deref(), spec.box_mm.as_ref(), mesh.nodes())?;
            let load = |node| Load {
                node,
                force_n: spec.force_n,
            };
            loads.extend(nodes.into_iter().map(load));
            tables.resize(loads.len(), at);
        }
        Ok((loads, tables))
    }
}

/// What may surprise about a mesh file that can be read.
fn odd_in_file(name: &Path, read: &MeshFile) -> Vec<String> {
    let left_out = read.displacements.as_ref().map(|_| {
        format!(
            "{} holds displacements, which are left out: the mesh at rest is solved for",
            name.display()
        )
    });
    read.warnings.iter().cloned().chain(left_out).collect()
}

/// What may surprise about a mesh that can be calculated on.
fn odd_in_mesh(quality: &Quality) -> Vec<String> {
    let mut odd = Vec::new();
    if let [[first, other], ..] = quality.coincident_nodes[..] {
        let pairs = quality.coincident_nodes.len();
        odd.push(format!(
            "nodes {first} and {other} lie in one place ({pairs} such pairs): nothing joins them"
        ));
    }
    if let [_, second, ..] = quality.parts[..] {
        let (parts, first) = (quality.parts.len(), second.first);
        odd.push(format!(
            "the mesh is in {parts} parts that do not touch; the second starts at tetrahedron {first}"
        ));
    }
    odd
}

impl Problem {
    /// The mesh.
    pub fn mesh(&self) -> &TetMesh {
        &self.mesh
    }

    /// The nodes whose displacements are reported, in the order asked for.
    pub fn report_nodes(&self) -> &[u32] {
        &self.report_nodes
    }

    /// What is odd about the problem, though it can be solved.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// Seconds that reading took.
    pub fn read_seconds(&self) -> f64 {
        self.read_seconds
    }

    /// Solves it.
    ///
    /// # Errors
    /// [`StaticsError`], with the key that is to blame.
    pub fn solve(&self) -> Result<Solved, StaticsError> {
        if self.file.model == Model::Linear {
            return Ok(Solved {
                solution: self.linear()?,
                history: None,
            });
        }
        let (solution, history) = self.run()?;
        Ok(Solved {
            solution,
            history: Some(history),
        })
    }

    /// How tissue answers.
    pub fn model(&self) -> Model {
        self.file.model
    }

    /// The solution were tissue linear, loads and displacements as they are written.
    pub(super) fn linear(&self) -> Result<Solution, StaticsError> {
        let problem = StaticProblem {
            mesh: &self.mesh,
            materials: self.materials.clone(),
            fixes: self.fixes.clone(),
            loads: self.loads.clone(),
        };
        problem.solve().map_err(|error| self.blame(error))
    }

    /// The force that each `[[fix]]` puts on the mesh, in sum, N; what two hold counts for the first.
    pub fn reactions(&self, solution: &Solution) -> Vec<[f64; 3]> {
        let forces: BTreeMap<(u32, u8), f64> = solution
            .reactions
            .iter()
            .map(|reaction| ((reaction.node, reaction.axis), reaction.force_n))
            .collect();
        self.held_by(|node, axis| forces.get(&(node, axis)).copied().unwrap_or(0.0))
    }

    /// The same of any forces on what is held.
    pub(super) fn held_by(&self, force_n: impl Fn(u32, u8) -> f64) -> Vec<[f64; 3]> {
        let mut holder = BTreeMap::new();
        for (fix, table) in self.fixes.iter().zip(&self.tables) {
            holder.entry((fix.node, fix.axis)).or_insert(*table);
        }
        let mut sums = vec![[0.0; 3]; self.file.fix.len()];
        for ((node, axis), table) in holder {
            sums[table][axis as usize] += force_n(node, axis);
        }
        sums
    }

    /// The error with the key that it is about.
    fn blame(&self, error: SolveError) -> StaticsError {
        let key = match &error {
            SolveError::Contradiction { node, axis, .. } => self.contradicting(*node, *axis),
            SolveError::Materials(_) => "material".to_owned(),
            SolveError::Rigid(RigidError::FreeParts { .. }) => "fix".to_owned(),
            SolveError::Assembly(_) | SolveError::Rigid(RigidError::LooseNodes { .. }) => "mesh".to_owned(),
            // Numbers of nodes and axes are right here; what is left concerns all of the problem.
            _ => return StaticsError::new(Wrong::Solve(error)),
        };
        self.file.fault(key, error)
    }

    /// The fix that gives a displacement another value than one before it.
    fn contradicting(&self, node: u32, axis: u8) -> String {
        let same = self.fixes.iter().zip(&self.tables);
        let mut given = same.filter(|(fix, _)| (fix.node, fix.axis) == (node, axis));
        let first = given.next().map(|(fix, _)| fix.displacement_mm);
        let other = given.find(|(fix, _)| Some(fix.displacement_mm) != first);
        other.map_or("fix".to_owned(), |(_, table)| format!("fix[{table}]"))
    }
}
