//! Solution of static problems, of problems in time, and their report.

mod history;
mod report;

pub use history::History;
pub use report::Report;

use std::collections::BTreeMap;

use insonify_base::document::InputError;
use insonify_mechanics::tissue::error::LinearError;
use insonify_mechanics::tissue::material::Materials;
use insonify_mechanics::tissue::nonlinear::{Solid, von_mises};
use insonify_mechanics::tissue::problem::{Solution, StaticProblem};

use crate::input::statics::Problem;
use crate::input::statics::course::Model;

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

/// Symmetric tensors of each element: xx, yy, zz, xy, yz and xz.
#[derive(Clone, Debug, PartialEq)]
pub struct Fields {
    /// Strain; shear as tensor components, half of the engineering shear strain.
    pub strain: Vec<[f64; 6]>,
    /// Stress, kPa.
    pub stress_kpa: Vec<[f64; 6]>,
}

fn six(m: [[f64; 3]; 3]) -> [f64; 6] {
    [m[0][0], m[1][1], m[2][2], m[0][1], m[1][2], m[0][2]]
}

impl Fields {
    /// Fields of a body displaced by `displacement`, with the stress due to `strained`, both in mm.
    pub fn of(body: &Solid, displacement: &[f64], strained: &[f64]) -> Fields {
        Self::with(body, displacement, &body.stresses_kpa(displacement, strained))
    }

    /// Fields of a displaced body with known stress, kPa.
    pub fn with(body: &Solid, displacement: &[f64], stress_kpa: &[[[f64; 3]; 3]]) -> Fields {
        Fields {
            strain: body.strains(displacement).into_iter().map(six).collect(),
            stress_kpa: stress_kpa.iter().copied().map(six).collect(),
        }
    }

    /// Von Mises stress of each element, kPa.
    pub fn von_mises_kpa(&self) -> Vec<f64> {
        let equivalent = |&[xx, yy, zz, xy, yz, xz]: &[f64; 6]| von_mises(&[[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]);
        self.stress_kpa.iter().map(equivalent).collect()
    }
}

impl Problem {
    /// Solves the problem, with final strain and stress if `fields` is set: for viscoelastic tissue with a memory of
    /// loads they need a history of their own.
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
        let materials = self.materials.iter();
        let materials: Vec<_> = materials
            .map(|(region, material)| (*region, material.law.at_rest()))
            .collect();
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
                let error = error.named(&self.regions.names);
                self.file.fault(key, error).with_help(Some(help.to_owned()))
            }
            error => self.file.fault(key, error),
        }
    }

    /// Key of the fix that gives a displacement a value different from an earlier one.
    fn contradicting(&self, node: u32, axis: u8) -> String {
        let same = self.fixes.iter().zip(&self.tables);
        let mut displacements = same.filter(|(fix, _)| (fix.node, fix.axis) == (node, axis));
        let first_mm = displacements.next().map(|(fix, _)| fix.displacement_mm);
        let different = displacements.find(|(fix, _)| Some(fix.displacement_mm) != first_mm);
        different.map_or("fix".to_owned(), |(_, table)| format!("fix[{table}]"))
    }
}
