//! Resolution of a problem file to a static problem, and its solution.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

use super::RegionMaterial;
use super::file::ProblemFile;
use super::loads::Loads;
use crate::input::selection::{AXES, Selected, Selection, axes, numbered};
use insonify_base::document::{InputError, Names, RegionName};
use insonify_base::note::Notes;
use insonify_mechanics::tissue::problem::Fix;
use insonify_mechanics::tissue::viscoelastic::point::Method;
use insonify_mesh::TetMesh;
use insonify_mesh::file::{MeshFile, ReadOptions, read_mesh};
use insonify_mesh::quality::Quality;

/// Largest displacement, mm.
const FARTHEST: f64 = 1e6;

/// A static problem with its mesh read and its nodes selected.
#[derive(Clone, Debug)]
pub struct Problem {
    /// File that it was read from.
    pub file: ProblemFile,
    /// Mesh of the problem.
    pub mesh: TetMesh,
    /// Numbers and names of the mesh's regions.
    pub regions: Regions,
    /// Material of each region.
    pub materials: BTreeMap<i32, RegionMaterial>,
    /// Prescribed displacements, each of one node along one axis.
    pub fixes: Vec<Fix>,
    /// Index of the `[[fix]]` of each entry of `fixes`.
    pub tables: Vec<usize>,
    /// Forces on nodes, and the areas that carry them.
    pub loads: Loads,
    /// Nodes whose displacements are reported, in the order requested.
    pub report_nodes: Vec<u32>,
    /// Numbers of nodes held by each `[[fix]]`, for the user.
    pub notes: Notes,
    /// Warnings about a solvable problem.
    pub warnings: Vec<String>,
    /// Duration of reading the files, s.
    pub read_seconds: f64,
}

/// Numbers and names of the regions of a mesh.
#[derive(Clone, Debug)]
pub struct Regions {
    pub(crate) names: BTreeMap<i32, String>,
    known: Names<i32>,
    /// Means by which the file could name regions, where nothing names any.
    hint: Option<String>,
}

impl Regions {
    fn new(mesh: &TetMesh, names: BTreeMap<i32, String>, hint: Option<String>) -> Self {
        let mut regions = mesh.regions().to_vec();
        regions.sort_unstable();
        regions.dedup();
        let name = |region: i32| {
            (
                region,
                i64::from(region),
                names.get(&region).cloned().into_iter().collect(),
            )
        };
        let known = Names::new(regions.into_iter().map(name));
        Regions { names, known, hint }
    }

    /// Describes a region in a message.
    pub fn called(&self, region: i32) -> String {
        match self.names.get(&region) {
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
        // Before the mesh, which may take long to read.
        self.check_course()?;
        let options = ReadOptions {
            region: self.region_array.as_deref(),
            unit: self.mesh_unit,
            ..ReadOptions::default()
        };
        let read = read_mesh(&base_dir.join(&self.mesh), &options).map_err(|error| self.fault("mesh", error))?;
        warnings.extend(file_warnings(&self.mesh, &read));
        let mesh = read.mesh;
        let quality = Quality::measure(&mesh, mesh.nodes());
        quality.usable().map_err(|error| self.fault("mesh", error))?;
        warnings.extend(mesh_warnings(&quality));
        let regions = Regions::new(&mesh, read.region_names, read.region_hint);
        let materials = self.materials(&mesh, &regions)?;
        let mut notes = Notes::default();
        let (fixes, tables) = self.fixes(&mesh, &regions, &mut notes, &mut warnings)?;
        let loads = self.loads(&mesh, &regions, &materials)?;
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
            materials,
            regions,
            fixes,
            tables,
            loads,
            report_nodes: numbered("report_nodes", &self.report_nodes, nodes)
                .map_err(|error| self.selection_fault(error))?,
            notes,
            warnings,
            read_seconds: started.elapsed().as_secs_f64(),
            mesh,
            file: self,
        })
    }

    /// Numbers of the regions that match a name.
    pub(crate) fn regions(&self, key: &str, name: &RegionName, regions: &Regions) -> Result<Vec<i32>, InputError> {
        regions.known.find(name).map_err(|error| {
            let help = error.help().or_else(|| regions.hint.clone());
            self.fault(key, error).with_help(help)
        })
    }

    /// Nodes that a table selects.
    pub(crate) fn selected(
        &self,
        table: &str,
        selection: &Selection<'_>,
        mesh: &TetMesh,
        regions: &Regions,
    ) -> Result<Selected, InputError> {
        let numbers = |key: &str, name: &RegionName| self.regions(key, name, regions);
        selection.select(table, mesh, numbers, |error| self.selection_fault(error))
    }

    /// Fixes, and the index of the table of each.
    fn fixes(
        &self,
        mesh: &TetMesh,
        regions: &Regions,
        notes: &mut Notes,
        warnings: &mut Vec<String>,
    ) -> Result<(Vec<Fix>, Vec<usize>), InputError> {
        let (mut fixes, mut tables) = (Vec::new(), Vec::new());
        for (index, spec) in self.fix.iter().enumerate() {
            let table = format!("fix[{index}]");
            let axes = axes(&table, &spec.axes).map_err(|error| self.selection_fault(error))?;
            let key = format!("{table}.displacement_mm");
            self.vector(&key, &spec.displacement_mm, FARTHEST, "a finite number, -1e6 to 1e6 mm")?;
            for axis in (0..3u8).filter(|axis| !axes.contains(axis) && spec.displacement_mm[*axis as usize] != 0.0) {
                let (axis, displacement) = (AXES[axis as usize], spec.displacement_mm[axis as usize]);
                warnings.push(format!(
                    "{table}: displacement_mm gives {displacement} mm along {axis}, but `axes = \"{}\"` leaves {axis} free",
                    spec.axes
                ));
            }
            let Selected { nodes, .. } = self.selected(&table, &spec.selection(), mesh, regions)?;
            notes.push(format!("{table} holds {} nodes", nodes.len()));
            for node in nodes {
                fixes.extend(axes.iter().map(|&axis| Fix {
                    node,
                    axis,
                    displacement_mm: spec.displacement_mm[axis as usize],
                }));
            }
            tables.resize(fixes.len(), index);
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
    if let [[first, second], ..] = quality.coincident_nodes[..] {
        let pairs = quality.coincident_nodes.len();
        odd.push(format!(
            "nodes {first} and {second} coincide but are separate nodes, not merged ({pairs} such pairs)"
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
