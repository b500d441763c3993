//! Mesh of a scenario, read from a file or generated from the scene's volume, and its fixed nodes.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use nalgebra::Point3;

use super::file::ScenarioFile;
use super::regions::{Region, Regions};
use super::tissue::DEFAULT_NODES;
use super::{mesh_note, path_pieces, tissue_box};
use crate::input::selection::{Selected, SelectionError, axes, ordered};
use insonify_anatomy::volume::LabelVolume;
use insonify_base::document::{InputError, RegionName, stated};
use insonify_base::note::Notes;
use insonify_imaging::scene::Scene;
use insonify_mechanics::tissue::dofs::Dofs;
use insonify_mechanics::tissue::error::LinearError;
use insonify_mechanics::tissue::rigid::{self, FreePart};
use insonify_mesh::file::{ReadOptions, read_mesh};
use insonify_mesh::generate::{GenerateOptions, LabelGrid, generate};
use insonify_mesh::quality::Quality;
use insonify_mesh::{NO_ELEMENT, TetMesh};
use insonify_tracking::trajectory::Trajectory;

/// Largest fraction of the nodes in an unsupported part of a generated mesh that is fixed automatically: small debris
/// beside the intended anatomy.
const SMALL_PART: f64 = 0.02;

/// A mesh and the region names from its file.
pub(crate) struct Meshed {
    pub mesh: TetMesh,
    pub names: BTreeMap<i32, String>,
    /// Cell arrays of the file that could give the regions, where nothing does.
    pub region_hint: Option<String>,
}

impl ScenarioFile {
    /// Reads or generates the mesh. `progress` receives the completed fraction.
    pub(crate) fn mesh(
        &self,
        scene: &Scene,
        base: &Path,
        path: &Trajectory,
        progress: &mut dyn FnMut(f32),
        notes: &mut Notes,
        warnings: &mut Vec<String>,
    ) -> Result<Meshed, InputError> {
        let spec = &self.tissue;
        let meshed = match &spec.mesh {
            Some(file) => {
                if let Some(key) = stated(spec, &["nodes", "box_mm", "along_path", "outside"]) {
                    let found = format!("`{key}` with `mesh`");
                    return Err(self.wrong_keys(
                        format!("tissue.{key}"),
                        found,
                        "one of them: a file is taken as it is",
                    ));
                }
                let options = ReadOptions {
                    region: spec.region_array.as_deref(),
                    unit: spec.mesh_unit,
                    ..ReadOptions::default()
                };
                let read = read_mesh(&base.join(file), &options).map_err(|error| self.fault("tissue.mesh", error))?;
                warnings.extend(read.warnings);
                Meshed {
                    mesh: read.mesh,
                    names: read.region_names,
                    region_hint: read.region_hint,
                }
            }
            None => {
                if spec.region_array.is_some() {
                    let found = "`region_array` without `mesh`";
                    return Err(self.wrong_keys("tissue.region_array", found, "a mesh file that has the array"));
                }
                Meshed {
                    mesh: self.generated(scene, path, progress, notes)?,
                    names: BTreeMap::new(),
                    region_hint: None,
                }
            }
        };
        // Before the solver sees the mesh: here an element of no use is blamed on a key of the file.
        let quality = Quality::measure(&meshed.mesh, meshed.mesh.nodes());
        quality.usable().map_err(|error| self.fault("tissue.mesh", error))?;
        Ok(meshed)
    }

    fn generated(
        &self,
        scene: &Scene,
        path: &Trajectory,
        progress: &mut dyn FnMut(f32),
        notes: &mut Notes,
    ) -> Result<TetMesh, InputError> {
        let nodes = self.tissue.nodes.unwrap_or(DEFAULT_NODES);
        // Vessels drawn into organs are only imaged; the mesh has the organs as they were before.
        let volume = scene.anatomy.volume.undivided();
        let none = BTreeMap::new();
        let regions = Regions::new(self, scene, &none);
        let outside = self.outside(&regions)?;
        let labels = match &self.tissue.box_mm {
            None => std::borrow::Cow::Borrowed(volume.voxels()),
            Some(corners) => std::borrow::Cow::Owned(self.cropped(volume, corners)?),
        };
        // A box may cut labels away, which leaves regions without a voxel to mesh.
        let mut is_present = [false; 256];
        labels.iter().for_each(|label| is_present[usize::from(*label)] = true);
        let mut wanted = Vec::new();
        for (index, label) in volume.labels().iter().enumerate().skip(1) {
            let Ok(number) = i32::try_from(label.value) else {
                let found = format!("label {}, which cannot be the number of a region", label.value);
                return Err(self.wrong_keys("scene", found, "label values of 32 bits"));
            };
            if is_present[index] && !outside.contains(&number) {
                wanted.push((index as u8, number));
            }
        }
        let grid = LabelGrid {
            labels: &labels,
            size: volume.size(),
            index_to_world: *volume.index_to_world(),
            regions: &wanted,
        };
        let key = if self.tissue.nodes.is_some() {
            "tissue.nodes"
        } else {
            "tissue"
        };
        let pieces: Vec<_> = path_pieces(path)
            .into_iter()
            .map(|piece| piece.map(Into::into))
            .collect();
        let options = GenerateOptions {
            path: &pieces,
            along_path: self.along_path(),
            ..GenerateOptions::default()
        };
        let generated = generate(&grid, nodes as usize, &options, progress).map_err(|error| self.fault(key, error))?;
        notes.push(mesh_note(&generated.report, options.along_path));
        Ok(generated.mesh)
    }

    /// Whether elements are finer along the needle's path.
    fn along_path(&self) -> bool {
        let usual = self.tissue.model.is_finer_along_path();
        self.tissue.along_path.unwrap_or(usual)
    }

    /// Numbers of the labels excluded from the mesh.
    pub(crate) fn outside(&self, regions: &Regions<'_>) -> Result<Vec<i32>, InputError> {
        let mut outside = Vec::new();
        for (index, name) in self.tissue.outside.iter().enumerate() {
            outside.extend(regions.numbers(&format!("tissue.outside[{index}]"), name)?);
        }
        Ok(outside)
    }

    /// Returns the labels, with everything outside a box unlabelled.
    fn cropped(&self, volume: &LabelVolume, corners: &[[f64; 3]; 2]) -> Result<Vec<u8>, InputError> {
        let [low, high] =
            ordered("tissue.box_mm", corners).map_err(|error: SelectionError| self.fault(error.0, error.1))?;
        let [nx, ny, _] = volume.size();
        let to_world = volume.index_to_world();
        let is_inside = |voxel: usize| {
            let index = Point3::new(
                (voxel % nx) as f64,
                (voxel / nx % ny) as f64,
                (voxel / (nx * ny)) as f64,
            );
            let world = to_world.transform_point(&index);
            (0..3).all(|axis| low[axis] <= world[axis] && world[axis] <= high[axis])
        };
        let labels: Vec<u8> = volume
            .voxels()
            .iter()
            .enumerate()
            .map(|(voxel, &label)| if label > 0 && is_inside(voxel) { label } else { 0 })
            .collect();
        if labels.iter().all(|label| *label == 0) {
            let expected = "a box that holds labelled tissue (LPS, mm)";
            return Err(self.wrong_keys("tissue.box_mm", "no labelled voxel in this box", expected));
        }
        Ok(labels)
    }

    /// Returns fixed nodes and axes, ascending.
    pub(crate) fn fixed(
        &self,
        mesh: &TetMesh,
        names: &Regions<'_>,
        properties: &BTreeMap<i32, Region>,
        notes: &mut Notes,
        warnings: &mut Vec<String>,
    ) -> Result<Vec<(u32, u8)>, InputError> {
        let mut fixed = vec![[false; 3]; mesh.nodes().len()];
        let rigid = |region: &i32| properties.get(region).is_some_and(|material| material.rigid);
        let elements = mesh.elements().iter().zip(mesh.regions());
        for node in elements
            .filter(|(_, region)| rigid(region))
            .flat_map(|(nodes, _)| nodes)
        {
            fixed[*node as usize] = [true; 3];
        }
        // The body beyond a box would hold the tissue at the cut. A scenario that fixes anything states all
        // its supports.
        if let (Some(corners), true) = (&self.tissue.box_mm, self.tissue.fix.is_empty()) {
            let (outside, volume) = (self.outside(names)?, names.volume());
            let is_tissue = |label: u8| {
                let value = volume.labels()[usize::from(label)].value;
                label > 0 && !outside.iter().any(|out| i64::from(*out) == value)
            };
            let cut_nodes = tissue_box::cut_nodes(mesh, corners, volume, is_tissue);
            notes.push(format!(
                "the mesh is fixed where `box_mm` cuts the tissue ({} nodes)",
                cut_nodes.len()
            ));
            cut_nodes.into_iter().for_each(|node| fixed[node as usize] = [true; 3]);
        }
        for (index, spec) in self.tissue.fix.iter().enumerate() {
            let table = format!("tissue.fix[{index}]");
            let fault = |error: SelectionError| self.fault(error.0, error.1);
            let fixed_axes = axes(&table, spec.axes.as_deref().unwrap_or("xyz")).map_err(fault)?;
            let numbers = |key: &str, name: &RegionName| names.numbers(key, name);
            let Selected { nodes, .. } = spec.selection().select(&table, mesh, numbers, fault)?;
            notes.push(format!("{table} fixes {} nodes", nodes.len()));
            for node in nodes {
                fixed_axes
                    .iter()
                    .for_each(|axis| fixed[node as usize][*axis as usize] = true);
            }
        }
        // Last, as it looks for parts that nothing else holds.
        self.fix_small_parts(mesh, names, &mut fixed, warnings)?;
        Ok(list(&fixed))
    }

    /// Fixes small unsupported parts, and refuses large ones.
    fn fix_small_parts(
        &self,
        mesh: &TetMesh,
        names: &Regions<'_>,
        fixed: &mut [[bool; 3]],
        warnings: &mut Vec<String>,
    ) -> Result<(), InputError> {
        // A mesh that was read is the user's, down to its last part.
        let max_nodes = SMALL_PART * mesh.nodes().len() as f64;
        let free = match rigid::check(mesh, &Dofs::new(mesh.nodes().len(), list(fixed))) {
            Ok(()) => return Ok(()),
            Err(LinearError::FreeParts { parts, .. })
                if self.tissue.mesh.is_none() && parts.iter().all(|part| (part.nodes as f64) <= max_nodes) =>
            {
                parts
            }
            Err(error) => {
                let help = "fix nodes with [[tissue.fix]], by `box_mm`, `region` or `nodes`".to_owned();
                let called = mesh.regions().iter().map(|region| (*region, names.name(*region)));
                let error = error.named(&called.collect());
                return Err(self.fault("tissue.fix", error).with_help(Some(help)));
            }
        };
        let mut fixed_nodes = 0;
        for part in &free {
            let nodes = together(mesh, part);
            fixed_nodes += nodes.len();
            nodes.into_iter().for_each(|node| fixed[node as usize] = [true; 3]);
        }
        let parts = match free.len() {
            1 => "a small part of the mesh without fixed nodes is fixed".to_owned(),
            parts => format!("{parts} small parts of the mesh without fixed nodes are fixed"),
        };
        warnings.push(format!("{parts} ({fixed_nodes} nodes)"));
        rigid::check(mesh, &Dofs::new(mesh.nodes().len(), list(fixed))).map_err(|error| self.fault("tissue.fix", error))
    }
}

/// Lists the fixed axes of nodes, ascending.
fn list(fixed: &[[bool; 3]]) -> Vec<(u32, u8)> {
    let axes = |(node, axes): (usize, &[bool; 3])| {
        let axes = *axes;
        (0..3u8)
            .filter(move |axis| axes[*axis as usize])
            .map(move |axis| (node as u32, axis))
    };
    fixed.iter().enumerate().flat_map(axes).collect()
}

/// Nodes of a face-connected part. A node that it shares as a hinge with another part is included.
fn together(mesh: &TetMesh, part: &FreePart) -> BTreeSet<u32> {
    let mut seen = vec![false; mesh.elements().len()];
    for start in 0..mesh.elements().len() {
        if seen[start] || !mesh.elements()[start].contains(&part.example) {
            continue;
        }
        let (mut nodes, mut next) = (BTreeSet::new(), vec![start]);
        seen[start] = true;
        while let Some(element) = next.pop() {
            nodes.extend(mesh.elements()[element]);
            for &neighbour in mesh.neighbours()[element]
                .iter()
                .filter(|neighbour| **neighbour != NO_ELEMENT)
            {
                if !std::mem::replace(&mut seen[neighbour as usize], true) {
                    next.push(neighbour as usize);
                }
            }
        }
        if nodes.len() == part.nodes {
            return nodes;
        }
    }
    BTreeSet::from([part.example])
}
