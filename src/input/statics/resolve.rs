//! Resolution of a problem file to a static problem, and its solution.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

use super::Fields;
use super::Made;
use super::course::Model;
use super::file::ProblemFile;
use super::loads::Loads;
use super::run::History;
use super::selection::{AXES, Choice, axes, numbered};
use crate::base::document::InputError;
use crate::base::document::{Names, RegionName};
use crate::mechanics::mesh::TetMesh;
use crate::mechanics::mesh::file::{MeshFile, ReadOptions, read_mesh};
use crate::mechanics::mesh::quality::Quality;
use crate::mechanics::tissue::error::LinearError;
use crate::mechanics::tissue::material::Materials;
use crate::mechanics::tissue::problem::{Fix, Solution, StaticProblem};
use crate::mechanics::tissue::viscoelastic::point::Method;

/// Largest displacement, mm.
const FARTHEST: f64 = 1e6;

/// A static problem with its mesh read and its nodes selected.
#[derive(Clone, Debug)]
pub struct Problem {
    /// File that it was read from.
    pub file: ProblemFile,
    /// Mesh of the problem.
    pub mesh: TetMesh,
    regions: Regions,
    /// Material of each region.
    pub(super) made: BTreeMap<i32, Made>,
    pub(super) fixes: Vec<Fix>,
    /// Index of the `[[fix]]` of each entry of `fixes`.
    pub(super) tables: Vec<usize>,
    pub(super) loads: Loads,
    /// Nodes whose displacements are reported, in the order requested.
    pub report_nodes: Vec<u32>,
    /// Numbers of nodes held by each `[[fix]]`, for the user.
    pub notes: Vec<String>,
    /// Warnings about a solvable problem.
    pub warnings: Vec<String>,
    /// Duration of reading the files, s.
    pub(super) read_seconds: f64,
}

/// Solution of a problem, with its history for models that have one.
#[derive(Clone, Debug, PartialEq)]
pub struct Solved {
    /// Final state.
    pub solution: Solution,
    /// Final strain and stress, if requested.
    pub fields: Option<Fields>,
    /// History up to the final state.
    pub history: Option<History>,
}

/// Numbers and names of the regions of a mesh.
#[derive(Clone, Debug)]
pub(super) struct Regions(BTreeMap<i32, String>, Names<i32>);

impl Regions {
    fn new(mesh: &TetMesh, names: BTreeMap<i32, String>) -> Self {
        let mut all = mesh.regions().to_vec();
        all.sort_unstable();
        all.dedup();
        let name = |region: i32| {
            (
                region,
                i64::from(region),
                names.get(&region).cloned().into_iter().collect(),
            )
        };
        let known = Names::new(all.into_iter().map(name));
        Regions(names, known)
    }

    /// Describes a region in a message.
    pub fn called(&self, region: i32) -> String {
        match self.0.get(&region) {
            Some(name) => format!("region {region} \"{name}\""),
            None => format!("region {region}"),
        }
    }
}

impl ProblemFile {
    /// Reads the mesh, selects the nodes and checks every number. Relative paths start at `base_dir`, the folder of the
    /// file.
    ///
    /// # Errors
    /// [`InputError`] with the key and its place in the file.
    pub fn resolve(self, base_dir: &Path) -> Result<Problem, InputError> {
        let started = Instant::now();
        let mut warnings = self.source.as_ref().map_or_else(Vec::new, |source| source.renamed());
        self.check_course()?;
        let options = ReadOptions {
            region: self.region_array.as_deref(),
            unit: self.mesh_unit,
            ..ReadOptions::default()
        };
        let read = read_mesh(&base_dir.join(&self.mesh), &options).map_err(|error| self.fault("mesh", error))?;
        warnings.extend(file_warnings(&self.mesh, &read));
        let mesh = read.mesh;
        let quality = Quality::of(&mesh, mesh.nodes());
        quality.usable().map_err(|error| self.fault("mesh", error))?;
        warnings.extend(mesh_warnings(&quality));
        let regions = Regions::new(&mesh, read.region_names);
        let made = self.materials(&mesh, &regions)?;
        let mut notes = Vec::new();
        let (fixes, tables) = self.fixes(&mesh, &regions, &mut notes, &mut warnings)?;
        let loads = self.loads(&mesh, &regions, &made)?;
        let unloaded = loads.forces.iter().all(|applied| applied.load.force_n == [0.0; 3]);
        if unloaded && fixes.iter().all(|fix| fix.displacement_mm == 0.0) {
            warnings.push("no force and no displacement is given: nothing moves".to_owned());
        }
        let rule = self.viscosity.map(|viscosity| viscosity.rule);
        if rule == Some(Method::TimeScaledTrapezoid) {
            warnings.push(
                "viscosity.rule: under the time-scaled trapezoid, reactions of held and driven nodes alternate from step to step; it suits displacements \
                 under given loads"
                    .to_owned(),
            );
        }
        let nodes = mesh.nodes().len();
        Ok(Problem {
            made,
            regions,
            fixes,
            tables,
            loads,
            report_nodes: numbered("report_nodes", &self.report_nodes, nodes).map_err(|odd| self.odd(odd))?,
            notes,
            warnings,
            read_seconds: started.elapsed().as_secs_f64(),
            mesh,
            file: self,
        })
    }

    /// Numbers of the regions that match a name.
    pub(super) fn regions(&self, key: &str, name: &RegionName, regions: &Regions) -> Result<Vec<i32>, InputError> {
        regions.1.find(name).map_err(|error| {
            let help = error.help();
            self.fault(key, error).with_help(help)
        })
    }

    /// Numbers of the regions that match the keys `region` and `surface_of` of a table, if it has them.
    pub(super) fn chosen(
        &self,
        table: &str,
        names: [Option<&RegionName>; 2],
        regions: &Regions,
    ) -> Result<[Option<Vec<i32>>; 2], InputError> {
        let numbers = |key: &str, name: Option<&RegionName>| {
            let numbers = name.map(|name| self.regions(&format!("{table}.{key}"), name, regions));
            numbers.transpose()
        };
        Ok([numbers("region", names[0])?, numbers("surface_of", names[1])?])
    }

    /// Fixes, and the index of the table of each.
    fn fixes(
        &self,
        mesh: &TetMesh,
        regions: &Regions,
        notes: &mut Vec<String>,
        warnings: &mut Vec<String>,
    ) -> Result<(Vec<Fix>, Vec<usize>), InputError> {
        let (mut fixes, mut tables) = (Vec::new(), Vec::new());
        for (at, spec) in self.fix.iter().enumerate() {
            let table = format!("fix[{at}]");
            let axes = axes(&table, &spec.axes).map_err(|odd| self.odd(odd))?;
            let key = format!("{table}.displacement_mm");
            self.vector(&key, &spec.displacement_mm, FARTHEST, "a finite number, -1e6 to 1e6 mm")?;
            for axis in (0..3u8).filter(|axis| !axes.contains(axis) && spec.displacement_mm[*axis as usize] != 0.0) {
                let (axis, given) = (AXES[axis as usize], spec.displacement_mm[axis as usize]);
                warnings.push(format!(
                    "{table}: displacement_mm gives {given} mm along {axis}, but `axes = \"{}\"` leaves {axis} free",
                    spec.axes
                ));
            }
            let names = [spec.region.as_ref(), spec.surface_of.as_ref()];
            let [numbers, surface_of] = self.chosen(&table, names, regions)?;
            let choice = Choice {
                nodes: spec.nodes.as_deref(),
                box_mm: spec.box_mm.as_ref(),
                cylinder: spec.cylinder.as_ref(),
                surface_of: surface_of.as_deref(),
                regions: numbers.as_deref(),
                surface: spec.surface,
            };
            let nodes = choice.select(&table, mesh).map_err(|odd| self.odd(odd))?;
            notes.push(format!("{table} holds {} nodes", nodes.len()));
            for node in nodes {
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
}

/// Warnings about the contents of a mesh file.
fn file_warnings(name: &Path, read: &MeshFile) -> Vec<String> {
    let left_out = read.displacements.as_ref().map(|_| {
        format!(
            "{} holds displacements, which are left out: the mesh at rest is solved for",
            name.display()
        )
    });
    read.warnings.iter().cloned().chain(left_out).collect()
}

/// Warnings about the quality of a mesh.
fn mesh_warnings(quality: &Quality) -> Vec<String> {
    let mut odd = Vec::new();
    if let [[first, other], ..] = quality.coincident_nodes[..] {
        let pairs = quality.coincident_nodes.len();
        odd.push(format!(
            "nodes {first} and {other} coincide but are separate nodes, not merged ({pairs} such pairs)"
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
    /// Solves the problem, with final strain and stress if `fields` is set: for viscoelastic tissue with a memory of loads they
    /// need a history of their own.
    ///
    /// # Errors
    /// [`InputError`] with the offending key.
    pub fn solve(&self, fields: bool) -> Result<Solved, InputError> {
        if self.file.model != Model::Linear {
            return self.run(fields);
        }
        let solution = self.linear()?;
        let fields = fields.then(|| {
            let displacement = solution.displacement_mm.as_flattened();
            Ok(Fields::of(&self.body()?, displacement, displacement))
        });
        Ok(Solved {
            solution,
            fields: fields.transpose()?,
            history: None,
        })
    }

    /// Solution of the linear problem with loads and displacements as written.
    pub(super) fn linear(&self) -> Result<Solution, InputError> {
        let problem = StaticProblem {
            mesh: &self.mesh,
            materials: self.linear_materials()?,
            fixes: self.fixes.clone(),
            loads: self.loads.forces.iter().map(|applied| applied.load).collect(),
        };
        problem.solve().map_err(|error| self.blame(error))
    }

    fn linear_materials(&self) -> Result<Materials, InputError> {
        let made = self.made.iter();
        let materials: Vec<_> = made.map(|(region, made)| (*region, *made.law.material())).collect();
        Materials::new(None, &materials).map_err(|error| self.blame(error))
    }

    /// Total force of each `[[load]]`, N.
    pub fn load_n(&self) -> Vec<[f64; 3]> {
        (0..self.file.load.len())
            .map(|table| self.loads.sum_n(Some(table)))
            .collect()
    }

    /// Total weight of the tissue, N, under gravity.
    pub fn weight_n(&self) -> Option<[f64; 3]> {
        self.file.gravity_m_per_s2.map(|_| self.loads.sum_n(None))
    }

    /// Total reaction force of each `[[fix]]` on the mesh, N; a degree of freedom fixed by two counts for the
    /// first.
    pub fn reactions(&self, solution: &Solution) -> Vec<[f64; 3]> {
        let forces: BTreeMap<(u32, u8), f64> = solution
            .reactions
            .iter()
            .map(|reaction| ((reaction.node, reaction.axis), reaction.force_n))
            .collect();
        self.held_by(|node, axis| forces.get(&(node, axis)).copied().unwrap_or(0.0))
    }

    /// Sums forces on the fixed degrees of freedom for each `[[fix]]`.
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

    /// Attaches the key concerned to an error.
    fn blame(&self, error: LinearError) -> InputError {
        let key = match &error {
            LinearError::Contradiction { node, axis, .. } => self.contradicting(*node, *axis),
            LinearError::FreeParts { .. } => "fix".to_owned(),
            LinearError::Count { .. }
            | LinearError::Element { .. }
            | LinearError::TooLarge { .. }
            | LinearError::LooseNodes { .. } => "mesh".to_owned(),
            // Displacements and forces are within bounds.
            LinearError::TwoMaterials { .. } | LinearError::NoMaterial { .. } | LinearError::Overflow => {
                "material".to_owned()
            }
            // Node and axis numbers are valid here; the remaining errors concern the problem as a whole.
            _ => return InputError::new(error),
        };
        match error {
            LinearError::LooseNodes { .. } | LinearError::FreeParts { .. } => {
                let help = "`region = \"NAME\"` or `region = NUMBER` in a [[fix]] holds all nodes of a region";
                let error = error.named(&self.regions.0);
                self.file.fault(key, error).with_help(Some(help.to_owned()))
            }
            error => self.file.fault(key, error),
        }
    }

    /// Key of the fix that gives a displacement a value different from an earlier one.
    fn contradicting(&self, node: u32, axis: u8) -> String {
        let same = self.fixes.iter().zip(&self.tables);
        let mut given = same.filter(|(fix, _)| (fix.node, fix.axis) == (node, axis));
        let first = given.next().map(|(fix, _)| fix.displacement_mm);
        let other = given.find(|(fix, _)| Some(fix.displacement_mm) != first);
        other.map_or("fix".to_owned(), |(_, table)| format!("fix[{table}]"))
    }
}
