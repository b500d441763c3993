//! Isotropic linear elastic materials, by mesh region.

use std::collections::BTreeMap;

use crate::tissue::error::LinearError;
use insonify_base::range::OutOfRange;
use insonify_mesh::TetMesh;

/// Isotropic linear elastic material, valid by construction.
///
/// ```
/// use insonify_mechanics::tissue::material::{Material, Materials};
///
/// let liver = Material::new(6.0, 0.45)?;
/// let [lambda_kpa, mu_kpa] = liver.lame_kpa();
/// assert!((mu_kpa - 6.0 / 2.9).abs() < 1e-12 && lambda_kpa > mu_kpa);
///
/// // By the shear modulus that elastography measures.
/// let stated = Material::from_modulus(None, Some(mu_kpa), 0.45)?;
/// assert!((stated.young_kpa() - liver.young_kpa()).abs() < 1e-12);
/// assert_eq!(Material::new(6.0, 0.5).unwrap_err().key, "poisson");
///
/// // Region 2 of a mesh is harder than all others.
/// let materials = Materials::new(Some(liver), &[(2, Material::new(30.0, 0.45)?)])?;
/// assert_eq!(materials.of(7), Some(&liver));
/// assert_eq!(materials.of(2).map(Material::young_kpa), Some(30.0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    young_kpa: f64,
    poisson: f64,
}

impl Material {
    /// Creates a material of Young's modulus `young_kpa` (above 0, kPa) and Poisson's ratio `poisson` (above -1, below
    /// 0.5).
    ///
    /// # Errors
    /// [`OutOfRange`] with the parameter that is out of range.
    pub fn new(young_kpa: f64, poisson: f64) -> Result<Material, OutOfRange> {
        if !(poisson > -1.0 && poisson < 0.5) {
            let expected = "a number above -1 and below 0.5 (soft tissue: 0.45 to 0.499; 0.5 itself is incompressible, which \
                            displacements alone cannot represent)";
            return Err(OutOfRange::new("poisson", poisson, expected));
        }
        let material = Material { young_kpa, poisson };
        let [lambda, mu] = material.lame_kpa();
        if !(young_kpa > 0.0 && mu.is_normal() && lambda.is_finite()) {
            let expected = "a number above 0, and neither so small nor so large that stiffness is lost";
            return Err(OutOfRange::new("young_kpa", young_kpa, expected));
        }
        Ok(material)
    }

    /// Creates a material from the one given of Young's modulus E and the shear modulus G (above 0, kPa), where
    /// `E = 2 (1 + nu) G`.
    ///
    /// # Errors
    /// [`OutOfRange`] with the parameter that is out of range, or if not exactly one modulus is given.
    pub fn from_modulus(young_kpa: Option<f64>, shear_kpa: Option<f64>, poisson: f64) -> Result<Material, OutOfRange> {
        match (young_kpa, shear_kpa) {
            (Some(young), None) => Material::new(young, poisson),
            (None, Some(shear)) => {
                Material::new(2.0 * (1.0 + poisson) * shear, poisson).map_err(|error| match error.key.as_str() {
                    "young_kpa" => OutOfRange::new("shear_kpa", shear, error.expected),
                    _ => error,
                })
            }
            (Some(_), Some(shear)) => Err(OutOfRange::new(
                "shear_kpa",
                format!("{shear} beside `young_kpa`"),
                "one of the two",
            )),
            (None, None) => Err(OutOfRange::new(
                "young_kpa",
                "neither `young_kpa` nor `shear_kpa`",
                "one of the two",
            )),
        }
    }

    /// Young's modulus, kPa.
    pub const fn young_kpa(&self) -> f64 {
        self.young_kpa
    }

    /// Poisson's ratio.
    pub const fn poisson(&self) -> f64 {
        self.poisson
    }

    /// Lame parameters `[lambda, mu]`, kPa: stress is `lambda tr(strain) I + 2 mu strain`.
    pub fn lame_kpa(&self) -> [f64; 2] {
        let nu = self.poisson;
        [
            self.young_kpa * (nu / ((1.0 + nu) * (1.0 - 2.0 * nu))),
            self.young_kpa * (0.5 / (1.0 + nu)),
        ]
    }
}

/// Materials of a mesh: one per named region, and a default for all others.
#[derive(Clone, Debug, PartialEq)]
pub struct Materials {
    default: Option<Material>,
    by_region: BTreeMap<i32, Material>,
}

impl Materials {
    /// Assigns `by_region` to the regions it names, and `default` to all others.
    ///
    /// # Errors
    /// [`LinearError::TwoMaterials`] where a region is named twice.
    pub fn new(default: Option<Material>, by_region: &[(i32, Material)]) -> Result<Materials, LinearError> {
        let mut map = BTreeMap::new();
        for &(region, material) in by_region {
            if let Some(listed) = map.insert(region, material) {
                return Err(LinearError::TwoMaterials {
                    region,
                    materials: [listed, material],
                });
            }
        }
        Ok(Materials {
            default,
            by_region: map,
        })
    }

    /// Assigns one material to every region.
    pub fn uniform(material: Material) -> Materials {
        Materials {
            default: Some(material),
            by_region: BTreeMap::new(),
        }
    }

    /// Material of a region, if any.
    pub fn of(&self, region: i32) -> Option<&Material> {
        self.by_region.get(&region).or(self.default.as_ref())
    }

    /// Regions with a material of their own, ascending.
    #[cfg(test)]
    pub fn named_regions(&self) -> impl Iterator<Item = i32> + '_ {
        self.by_region.keys().copied()
    }

    /// Returns the material of each element of a mesh.
    ///
    /// # Errors
    /// [`LinearError::NoMaterial`] with all regions that have no material.
    pub fn check(&self, mesh: &TetMesh) -> Result<Vec<Material>, LinearError> {
        let mut missing = BTreeMap::<i32, usize>::new();
        let mut materials = Vec::with_capacity(mesh.regions().len());
        for &region in mesh.regions() {
            match self.of(region) {
                Some(material) => materials.push(*material),
                None => *missing.entry(region).or_default() += 1,
            }
        }
        if missing.is_empty() {
            Ok(materials)
        } else {
            Err(LinearError::NoMaterial {
                regions: missing.into_iter().collect(),
            })
        }
    }
}

#[cfg(test)]
mod tests;
