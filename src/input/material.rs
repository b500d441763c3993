//! Material tables: the keys that scenarios and static problems share, the laws that they state, and the table of each
//! region.

use std::collections::BTreeMap;

use insonify_base::document::{InputError, RegionName};
use insonify_base::range::OutOfRange;
use insonify_mechanics::tissue::law::{AnyLaw, Law, LawSpec, Linear, NoKeys, Stiffening};
use insonify_mechanics::tissue::material::Material;

/// Declares a material table: the keys of every such table, with the type of Poisson's ratio, and after them its own.
macro_rules! material_table {
    ($(#[$meta:meta])* pub struct $name:ident $(with $required:ident keys)? by $Kind:ident { poisson: $poisson:ty; $($own:tt)* }) => {
        insonify_base::range::parameters! {
            $(#[$meta])*
            pub struct $name $(with $required keys)? by $Kind {
                /// Region: its name, a part of its name, or its number. Without one, the table applies to all regions
                /// without their own table.
                region: Option<insonify_base::document::RegionName>;
                /// Young's modulus.
                young_kpa: Option<f64>, above 0 "kPa";
                /// In place of `young_kpa`: shear modulus G. Young's modulus is 2 (1 + nu) G.
                shear_kpa: Option<f64>, above 0 "kPa";
                /// Poisson's ratio nu.
                poisson: $poisson, above -1..0.5;
                /// Law of the tissue, whose moduli at small strain are those above, for example
                /// `{ kind = "ogden", alpha = -5 }`; `knee_strain` and `stiffening` state the law `knee`. Viscosity
                /// needs a law with a secant modulus. Default `linear`.
                law: Option<insonify_mechanics::tissue::law::LawSpec>, for Nonlinear | Viscoelastic;
                /// Relative strain above which the tissue stiffens (0 or more); sqrt(3)/2 times a knee in simple shear.
                /// Default: no stiffening.
                knee_strain: Option<f64>, for Nonlinear | Viscoelastic;
                /// With `knee_strain`: stiffening coefficient, a in E (1 + a (e - knee)^2).
                stiffening: Option<f64>, for Nonlinear | Viscoelastic, in 0;
                $($own)*
            }
        }

        impl $name {
            /// Law that the table states for a material with these moduli at small strain; where tissue `creeps`, one
            /// with a secant modulus.
            pub(crate) fn law_of(
                &self,
                material: insonify_mechanics::tissue::material::Material,
                creeps: bool,
            ) -> Result<insonify_mechanics::tissue::law::AnyLaw, insonify_base::range::OutOfRange> {
                let keys = $crate::input::material::LawKeys {
                    law: self.law.as_ref(),
                    knee_strain: self.knee_strain,
                    stiffening: self.stiffening,
                };
                keys.law(material, creeps)
            }
        }
    };
}
pub(crate) use material_table;

/// The material table of each region, and that of all other regions, as indices.
#[derive(Default)]
pub(crate) struct TableOfRegion {
    by_region: BTreeMap<i32, usize>,
    others: Option<usize>,
}

impl TableOfRegion {
    /// Assigns the tables of the list at the key `list`, in order, by the names of their regions. `numbers` finds the
    /// regions that a name at a key means, `called` describes one, and `fault` makes an error of key, what was found
    /// and what was expected.
    ///
    /// # Errors
    /// A second table for a region, or for all others.
    pub(crate) fn new<'a>(
        list: &str,
        names: impl Iterator<Item = Option<&'a RegionName>>,
        numbers: impl Fn(&str, &RegionName) -> Result<Vec<i32>, InputError>,
        called: impl Fn(i32) -> String,
        fault: impl Fn(String, String, &str) -> InputError,
    ) -> Result<Self, InputError> {
        let mut tables = Self::default();
        for (index, name) in names.enumerate() {
            let key = format!("{list}[{index}]");
            let Some(name) = name else {
                if tables.others.replace(index).is_some() {
                    let found = "a second material without `region`".to_owned();
                    return Err(fault(key, found, "one at most, for all other regions"));
                }
                continue;
            };
            let key = format!("{key}.region");
            for region in numbers(&key, name)? {
                if tables.by_region.insert(region, index).is_some() {
                    let found = format!("a second material for {}", called(region));
                    return Err(fault(key, found, "one for each region"));
                }
            }
        }
        Ok(tables)
    }

    /// The table of a region.
    pub(crate) fn of(&self, region: i32) -> Option<usize> {
        self.by_region.get(&region).copied().or(self.others)
    }
}

/// Keys of a material table that state its law: `law`, or `knee_strain` with `stiffening`, or neither for linear
/// tissue.
pub(crate) struct LawKeys<'a> {
    pub law: Option<&'a LawSpec>,
    pub knee_strain: Option<f64>,
    pub stiffening: Option<f64>,
}

impl LawKeys<'_> {
    /// Law of a material with these moduli at small strain; where tissue `creeps`, one with a secant modulus.
    ///
    /// # Errors
    /// [`OutOfRange`] with the key at fault.
    pub(crate) fn law(&self, material: Material, creeps: bool) -> Result<AnyLaw, OutOfRange> {
        let alone = |key: &str, other_key: &str| Err(OutOfRange::new(key, "alone", format!("`{other_key}` beside it")));
        match (self.law, self.knee_strain, self.stiffening) {
            (None, None, None) => Linear::new(material, NoKeys {}).map(AnyLaw::from),
            (None, Some(knee), Some(rate)) => Stiffening::new(material, knee, rate).map(AnyLaw::from),
            (None, Some(_), None) => alone("knee_strain", "stiffening"),
            (None, None, Some(_)) => alone("stiffening", "knee_strain"),
            (Some(spec), None, None) => {
                let law = spec.law(material).map_err(|error| OutOfRange {
                    key: format!("law.{}", error.key),
                    ..error
                })?;
                if creeps && law.as_secant().is_none() {
                    let laws = AnyLaw::examples(material)?.into_iter();
                    let secants = laws.filter(|(_, law)| law.as_secant().is_some());
                    let names: Vec<String> = secants.map(|(name, _)| format!("`{name}`")).collect();
                    let found = "one without a secant modulus, which viscosity needs";
                    return Err(OutOfRange::new("law", found, names.join(" or ")));
                }
                Ok(law)
            }
            (Some(_), knee, _) => {
                let key = if knee.is_some() { "knee_strain" } else { "stiffening" };
                let expected = "one of them: `law = { kind = \"knee\", ... }` has these keys itself";
                Err(OutOfRange::new(key, "beside `law`", expected))
            }
        }
    }
}
