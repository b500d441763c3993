//! Problem files for static problems: mesh, materials, constraints and loads in one TOML file.
//!
//! [`ProblemFile`] is the file as written; [`ProblemFile::resolve`] reads its mesh and selects nodes;
//! [`Problem::solve`] solves it (see [`mechanics::tissue`](insonify_mechanics::tissue)). Errors point at the line.
//!
//! ```
//! use insonify::input::statics::ProblemFile;
//!
//! let text = r#"
//! mesh = "block.vtu"
//! report_nodes = [7]
//! [[material]]
//! young_kpa = 5.0
//! poisson = 0.45
//! [[fix]]
//! box_mm = [[-inf, -inf, -inf], [inf, inf, 0.0]]
//! [[load]]
//! nodes = [7]
//! node_force_n = [0.0, 0.0, 0.001]
//! "#;
//! let file = ProblemFile::parse(text, "pull.toml")?;
//! assert_eq!(file.load[0].node_force_n, Some([0.0, 0.0, 0.001]));
//!
//! let error = ProblemFile::parse(&text.replace("poisson", "poison"), "pull.toml").unwrap_err();
//! assert_eq!(error.location(), Some(("pull.toml", 6)));
//! # Ok::<(), insonify::InputError>(())
//! ```

pub mod course;
pub mod file;
mod loads;
mod resolve;

pub use course::{Model, SchemeName};
pub use file::ProblemFile;

use std::collections::BTreeMap;

use super::material::TableOfRegion;
use super::selection::SelectionError;
use file::MaterialSpec;
use insonify_base::document::{InputError, InvalidFile};
use insonify_base::range::OutOfRange;
use insonify_mechanics::tissue::law::AnyLaw;
use insonify_mechanics::tissue::material::Material;
use insonify_mesh::TetMesh;
pub use loads::{Applied, Loads};
pub use resolve::{Problem, Regions};

/// Example problem file with every key of linear tissue.
pub const EXAMPLE: &str = include_str!("../../assets/press.toml");

/// Example problem file of viscoelastic tissue with a load history.
pub const CREEP: &str = include_str!("../../assets/liver-plate.toml");

impl ProblemFile {
    /// Creates an error about a selection of nodes or axes.
    #[allow(clippy::boxed_local, reason = "the boxed error of a result")]
    fn selection_fault(&self, error: SelectionError) -> InputError {
        self.fault(error.0, error.1)
    }

    /// Checks that a number is finite and no larger than `bound`.
    fn within(&self, key: &str, found: f64, bound: f64, expected: &'static str) -> Result<(), InputError> {
        if found.abs() <= bound {
            Ok(())
        } else {
            Err(self.fault(key, InvalidFile::number(found, expected)))
        }
    }

    /// Checks that each component of a vector is finite and no larger than `bound`.
    fn vector(&self, key: &str, vector: &[f64; 3], bound: f64, expected: &'static str) -> Result<(), InputError> {
        let check = |(index, found): (usize, &f64)| self.within(&format!("{key}[{index}]"), *found, bound, expected);
        vector.iter().enumerate().try_for_each(check)
    }
}

/// Material of a region.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RegionMaterial {
    /// Elastic law of the tissue.
    pub law: AnyLaw,
    /// Index of its `[[material]]` table.
    pub table: usize,
}

impl ProblemFile {
    /// Material of each region of the mesh.
    fn materials(&self, mesh: &TetMesh, regions: &Regions) -> Result<BTreeMap<i32, RegionMaterial>, InputError> {
        if self.material.is_empty() {
            return Err(self.wrong_keys("material", "no `[[material]]`", "at least one"));
        }
        let laws = self.material.iter().enumerate();
        let laws = laws.map(|(table, spec)| self.law(&format!("material[{table}]"), spec));
        // All tables, even of regions that this mesh lacks: a fault would else appear with another mesh.
        let laws: Vec<AnyLaw> = laws.collect::<Result<_, _>>()?;
        let tables = TableOfRegion::new(
            "material",
            self.material.iter().map(|spec| spec.region.as_ref()),
            |key, name| self.regions(key, name, regions),
            |region| regions.called(region),
            |key, found, expected| self.wrong_keys(key, found, expected),
        )?;
        let mut materials = BTreeMap::new();
        let mut without = BTreeMap::<i32, usize>::new();
        for region in mesh.regions() {
            match tables.of(*region) {
                Some(table) => drop(materials.insert(
                    *region,
                    RegionMaterial {
                        law: laws[table],
                        table,
                    },
                )),
                None => *without.entry(*region).or_default() += 1,
            }
        }
        if without.is_empty() {
            return Ok(materials);
        }
        let listed = without.iter();
        let listed = listed.map(|(region, elements)| format!("{} ({elements} tetrahedra)", regions.called(*region)));
        let found = format!("no material for {}", listed.collect::<Vec<_>>().join(", "));
        Err(self.wrong_keys(
            "material",
            found,
            "one for each region, or one without `region` for all others",
        ))
    }

    fn law(&self, table: &str, spec: &MaterialSpec) -> Result<AnyLaw, InputError> {
        let fault = |error: OutOfRange| self.fault(format!("{table}.{}", error.key), error);
        let material = Material::from_modulus(spec.young_kpa, spec.shear_kpa, spec.poisson).map_err(fault)?;
        self.in_ranges(table, spec)?;
        self.of_kind(table, spec, self.model)?;
        spec.law_of(material, self.model == Model::Viscoelastic).map_err(fault)
    }
}

#[cfg(test)]
mod tests;
