//! Parameters of the mass-spring model.

/// Parameters of the mass-spring model. The tissue is one material throughout (Zhu et al. 2007, section 2.2).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameters {
    /// Young's modulus, kPa (above 0).
    pub young_kpa: f64,
    /// Density, kg/m^3 (above 0).
    pub density_kg_per_m3: f64,
    /// Rate at which a free node loses its velocity, 1/s (0 or more): damping in proportion to mass.
    pub damping_per_s: f64,
    /// Ratio of a spring's damping to its stiffness, s (0 or more). It reduces the stable step.
    pub spring_damping_s: f64,
    /// Radius of the cylinder of tissue around the path, mm (above 0). Its side is fixed.
    pub radius_mm: f64,
    /// Length of the cylinder below the skin, mm (above 0). Its far end is fixed.
    pub length_mm: f64,
    /// Number of rings of nodes around the axis (1 to 64).
    pub rings: usize,
    /// Number of nodes of the first ring (3 to 12); ring i has i times as many, so that six give nearly equilateral
    /// triangles.
    pub sectors: usize,
    /// Number of layers of elements along the axis (2 to 1000).
    pub layers: usize,
    /// Share of the far face's circumference below whose distance the tip node is penetrated (0.005 to 0.2).
    pub lambda: f64,
    /// Maximum number of substeps for the sake of stability (1 to 4096). In a step that would need more, less time is
    /// simulated for the tissue: it approaches its equilibrium more slowly.
    pub most_substeps: usize,
}

impl Default for Parameters {
    /// Returns liver-like tissue (10 kPa), 25 mm around a path of 100 mm, nodes every 5 mm.
    fn default() -> Self {
        Parameters {
            young_kpa: 10.0,
            density_kg_per_m3: 1000.0,
            damping_per_s: 200.0,
            spring_damping_s: 1e-4,
            radius_mm: 25.0,
            length_mm: 100.0,
            rings: 5,
            sectors: 6,
            layers: 20,
            lambda: 0.05,
            most_substeps: 100,
        }
    }
}

/// Reason why a model cannot be built.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum InvalidParameters {
    /// A number outside its range.
    #[error("`{key}` is {found}; expected {expected}")]
    Number {
        /// Name of the field.
        key: &'static str,
        /// The rejected value.
        found: f64,
        /// Permitted range.
        expected: &'static str,
    },
    /// Rings, sectors and layers make elements too thin for computation.
    #[error(
        "the cylinder's least dihedral angle is {found_deg:.2} degrees; expected at least {LEAST_DIHEDRAL_DEG} \
         (make radius / rings and length / layers more alike)"
    )]
    Thin {
        /// The least angle between two faces of an element, degrees.
        found_deg: f64,
    },
    /// Rings, sectors and layers make more nodes than the model supports.
    #[error("the cylinder has {found} nodes; expected at most {MOST_NODES}")]
    Large {
        /// Number of nodes.
        found: usize,
    },
}

/// Least dihedral angle that is accepted, degrees. The default mesh has 35.
pub const LEAST_DIHEDRAL_DEG: f64 = 5.0;
/// Maximum number of nodes of a cylinder.
pub const MOST_NODES: usize = 200_000;

impl Parameters {
    /// Checks every number against its range.
    ///
    /// # Errors
    /// [`InvalidParameters::Number`], [`InvalidParameters::Large`].
    pub fn check(&self) -> Result<(), InvalidParameters> {
        let check = |key, found: f64, holds: bool, expected| match found.is_finite() && holds {
            true => Ok(()),
            false => Err(InvalidParameters::Number { key, found, expected }),
        };
        for (key, found) in [
            ("young_kpa", self.young_kpa),
            ("density_kg_per_m3", self.density_kg_per_m3),
            ("radius_mm", self.radius_mm),
            ("length_mm", self.length_mm),
        ] {
            check(key, found, (1e-6..=1e12).contains(&found), "a number of 1e-6 to 1e12")?;
        }
        for (key, found) in [
            ("damping_per_s", self.damping_per_s),
            ("spring_damping_s", self.spring_damping_s),
        ] {
            check(key, found, (0.0..=1e12).contains(&found), "a number of 0 to 1e12")?;
        }
        check(
            "lambda",
            self.lambda,
            (0.005..=0.2).contains(&self.lambda),
            "a number of 0.005 to 0.2",
        )?;
        let whole = |key, found: usize, holds: bool, expected| check(key, found as f64, holds, expected);
        whole("rings", self.rings, (1..=64).contains(&self.rings), "1 to 64")?;
        whole("sectors", self.sectors, (3..=12).contains(&self.sectors), "3 to 12")?;
        whole("layers", self.layers, (2..=1000).contains(&self.layers), "2 to 1000")?;
        let most = self.most_substeps;
        whole("most_substeps", most, (1..=4096).contains(&most), "1 to 4096")?;
        match self.nodes() {
            found if found > MOST_NODES => Err(InvalidParameters::Large { found }),
            _ => Ok(()),
        }
    }

    /// Returns the number of nodes of one layer.
    pub(super) fn nodes_of_layer(&self) -> usize {
        1 + self.sectors * self.rings * (self.rings + 1) / 2
    }

    /// Returns the number of nodes of the cylinder.
    pub fn nodes(&self) -> usize {
        (self.layers + 1) * self.nodes_of_layer()
    }
}
