//! Assembly of loads into nodal forces.

use std::collections::BTreeMap;

use super::RegionMaterial;
use super::file::{LoadSpec, ProblemFile};
use super::resolve::Regions;
use crate::input::selection::{Selected, Selection};
use insonify_base::document::InputError;
use insonify_mechanics::tissue::problem::Load;
use insonify_mesh::{Face, TetMesh};

/// Largest force, N, and pressure, kPa.
const STRONGEST: f64 = 1e9;
/// Largest acceleration, m/s^2.
const FASTEST: f64 = 1e6;
/// Newtons per square millimetre in one kilopascal.
const NEWTON_PER_MM2: f64 = 1e-3;
/// Weight in newtons of 1 mm^3 of 1 kg/m^3 under 1 m/s^2.
const NEWTON_PER_MM3: f64 = 1e-9;

/// A nodal force, and the index of its `[[load]]`; weight has none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Applied {
    /// Force and its node.
    pub load: Load,
    /// Index of its table, from 0.
    pub table: Option<usize>,
}

/// All nodal forces, and the area loaded by each `[[load]]`, mm^2 (0 for nodal forces).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Loads {
    /// The forces, in the order of the tables; weight last.
    pub forces: Vec<Applied>,
    /// Area loaded by each table, mm^2.
    pub area_mm2: Vec<f64>,
}

impl Loads {
    /// Total force of a table, N; without a table the weight.
    pub fn sum_n(&self, table: Option<usize>) -> [f64; 3] {
        let forces = self.forces.iter().filter(|applied| applied.table == table);
        forces.fold([0.0; 3], |sum, applied| {
            std::array::from_fn(|axis| sum[axis] + applied.load.force_n[axis])
        })
    }

    fn spread(&mut self, table: usize, faces: &[(Face, f64)], force_n: impl Fn(&Face, f64) -> [f64; 3]) {
        for (face, area) in faces {
            // A uniform traction on a triangle acts equally on its corners.
            let force_n = force_n(face, *area).map(|force| force / 3.0);
            let load = |node| Applied {
                load: Load { node, force_n },
                table: Some(table),
            };
            self.forces.extend(face.nodes.map(load));
        }
    }
}

impl ProblemFile {
    /// Assembles all loads.
    pub(crate) fn loads(
        &self,
        mesh: &TetMesh,
        regions: &Regions,
        materials: &BTreeMap<i32, RegionMaterial>,
    ) -> Result<Loads, InputError> {
        let mut loads = Loads::default();
        for (index, spec) in self.load.iter().enumerate() {
            let area = self.load(index, spec, mesh, regions, &mut loads)?;
            loads.area_mm2.push(area);
        }
        self.weight(mesh, materials, &mut loads)?;
        Ok(loads)
    }

    fn load(
        &self,
        index: usize,
        spec: &LoadSpec,
        mesh: &TetMesh,
        regions: &Regions,
        loads: &mut Loads,
    ) -> Result<f64, InputError> {
        let table = format!("load[{index}]");
        let selection = Selection {
            // Without numbers, what is spread acts on the surface.
            surface: spec.surface || spec.nodes.is_none() && spec.node_force_n.is_none(),
            ..spec.selection()
        };
        let Selected { nodes, regions } = self.selected(&table, &selection, mesh, regions)?;
        let strongest = "a finite number, -1e9 to 1e9 N";
        match (spec.total_force_n, spec.pressure_kpa, spec.node_force_n) {
            (None, None, Some(force_n)) => {
                self.vector(&format!("{table}.node_force_n"), &force_n, STRONGEST, strongest)?;
                let load = |node| Applied {
                    load: Load { node, force_n },
                    table: Some(index),
                };
                loads.forces.extend(nodes.into_iter().map(load));
                Ok(0.0)
            }
            (Some(total), None, None) => {
                self.vector(&format!("{table}.total_force_n"), &total, STRONGEST, strongest)?;
                let (faces, whole) = self.faces(&table, mesh, &nodes, regions.as_deref())?;
                loads.spread(index, &faces, |_, area| total.map(|force| force * (area / whole)));
                Ok(whole)
            }
            (None, Some(pressure), None) => {
                let expected = "-1e9 to 1e9 kPa";
                self.within(&format!("{table}.pressure_kpa"), pressure, STRONGEST, expected)?;
                let (faces, whole) = self.faces(&table, mesh, &nodes, regions.as_deref())?;
                let inward = -pressure * NEWTON_PER_MM2;
                loads.spread(index, &faces, |face, _| face.area_mm2.map(|area| inward * area));
                Ok(whole)
            }
            _ => {
                let forces = [
                    ("`total_force_n`", spec.total_force_n.is_some()),
                    ("`pressure_kpa`", spec.pressure_kpa.is_some()),
                    ("`node_force_n`", spec.node_force_n.is_some()),
                ];
                let given_keys: Vec<&str> = forces
                    .iter()
                    .filter(|(_, is_given)| *is_given)
                    .map(|(key, _)| *key)
                    .collect();
                let found = if given_keys.is_empty() {
                    "no force".to_owned()
                } else {
                    given_keys.join(" and ")
                };
                let expected = "one of `total_force_n`, `pressure_kpa` and `node_force_n`";
                Err(self.wrong_keys(table, found, expected))
            }
        }
    }

    /// Surface faces whose nodes are all selected, with the area of each and the total area, mm^2.
    fn faces(
        &self,
        table: &str,
        mesh: &TetMesh,
        nodes: &[u32],
        regions: Option<&[i32]>,
    ) -> Result<(Vec<(Face, f64)>, f64), InputError> {
        let mut chosen = vec![false; mesh.nodes().len()];
        nodes.iter().for_each(|node| chosen[*node as usize] = true);
        let whole = |face: &Face| {
            face.nodes.iter().all(|node| chosen[*node as usize])
                && regions.is_none_or(|regions| regions.contains(&face.region))
        };
        let faces = mesh.surface().filter(whole);
        let faces: Vec<(Face, f64)> = faces
            .map(|face| (face, nalgebra::Vector3::from(face.area_mm2).norm()))
            .collect();
        let area = faces.iter().map(|(_, area)| area).sum();
        if faces.is_empty() {
            let found = format!("{} nodes between which there is no face of the surface", nodes.len());
            let expected = "all three nodes of at least one face; `node_force_n` acts on single nodes";
            Err(self.wrong_keys(table, found, expected))
        } else {
            Ok((faces, area))
        }
    }

    /// Adds the weight of all tissue, a quarter of each tetrahedron's weight at each corner.
    fn weight(
        &self,
        mesh: &TetMesh,
        materials: &BTreeMap<i32, RegionMaterial>,
        loads: &mut Loads,
    ) -> Result<(), InputError> {
        let Some(gravity) = self.gravity_m_per_s2 else {
            return Ok(());
        };
        self.vector("gravity_m_per_s2", &gravity, FASTEST, "-1e6 to 1e6 m/s^2")?;
        let elements = mesh.elements().iter().zip(mesh.regions());
        for ((corners, region), volume) in elements.zip(mesh.volumes(mesh.nodes())) {
            // Every region has a material.
            let Some(RegionMaterial { table, .. }) = materials.get(region) else {
                continue;
            };
            let density = self.material[*table].density_kg_per_m3.ok_or_else(|| {
                let (key, found) = (format!("material[{table}]"), "no `density_kg_per_m3`");
                self.wrong_keys(key, found, "one in each material, for `gravity_m_per_s2` to pull on")
            })?;
            let force_n = gravity.map(|g| 0.25 * volume * density * g * NEWTON_PER_MM3);
            let load = |node| Applied {
                load: Load { node, force_n },
                table: None,
            };
            loads.forces.extend(corners.map(load));
        }
        Ok(())
    }
}
