//! Materials of the regions of a problem.

use std::collections::BTreeMap;

use super::course::Model;
use super::file::{MaterialSpec, ProblemFile};
use super::resolve::Regions;
use crate::input::InputError;
use crate::mechanics::mesh::TetMesh;
use crate::mechanics::tissue::material::Material;
use crate::mechanics::tissue::nonlinear::Stiffening;

/// Material of a region.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Made {
    pub law: Stiffening,
    /// Index of its `[[material]]` table.
    pub table: usize,
}

impl ProblemFile {
    /// Material of each region of the mesh.
    pub(super) fn materials(&self, mesh: &TetMesh, regions: &Regions) -> Result<BTreeMap<i32, Made>, InputError> {
        if self.material.is_empty() {
            return Err(self.wrong_keys("material", "no `[[material]]`", "at least one"));
        }
        let (mut others, mut made) = (None, BTreeMap::new());
        for (table, spec) in self.material.iter().enumerate() {
            let key = format!("material[{table}]");
            let law = self.law(&key, spec)?;
            let one = Made { law, table };
            let Some(name) = &spec.region else {
                if others.replace(one).is_some() {
                    let found = "a second material without `region`";
                    return Err(self.wrong_keys(key, found, "one at most, for all other regions"));
                }
                continue;
            };
            let key = format!("{key}.region");
            for region in self.regions(&key, name, regions)? {
                if made.insert(region, one).is_some() {
                    let found = format!("a second material for {}", regions.called(region));
                    return Err(self.wrong_keys(key, found, "one for each region"));
                }
            }
        }
        let mut without = BTreeMap::<i32, usize>::new();
        for region in mesh.regions() {
            match (made.contains_key(region), others) {
                (true, _) => {}
                (false, Some(others)) => drop(made.insert(*region, others)),
                (false, None) => *without.entry(*region).or_default() += 1,
            }
        }
        if without.is_empty() {
            return Ok(made);
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

    fn law(&self, table: &str, spec: &MaterialSpec) -> Result<Stiffening, InputError> {
        let key = |name: &str| format!("{table}.{name}");
        let material = Material::given(spec.young_kpa, spec.shear_kpa, spec.poisson);
        let material = material.map_err(|error| self.fault(key(&error.key), error))?;
        self.in_ranges(table, spec)?;
        match (spec.knee_strain, spec.stiffening) {
            (None, None) => Ok(Stiffening::linear(material)),
            (knee, _) if self.model == Model::Linear => {
                let name = if knee.is_some() { "knee_strain" } else { "stiffening" };
                let found = format!("`{name}` beside `model = \"linear\"`");
                Err(self.wrong_keys(key(name), found, "`model = \"nonlinear\"` or `\"viscoelastic\"`"))
            }
            (Some(knee), Some(rate)) => {
                Stiffening::new(material, knee, rate).map_err(|error| self.fault(key(&error.key), error))
            }
            (Some(_), None) => {
                Err(self.wrong_keys(key("knee_strain"), "`knee_strain` alone", "`stiffening` beside it"))
            }
            (None, Some(_)) => Err(self.wrong_keys(key("stiffening"), "`stiffening` alone", "`knee_strain` beside it")),
        }
    }
}
