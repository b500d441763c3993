//! Constitutive laws as material tables state them, the same for scenarios and static problems.

use insonify_base::range::OutOfRange;
use insonify_mechanics::tissue::law::{AnyLaw, Law, LawSpec, Linear, NoKeys, Stiffening};
use insonify_mechanics::tissue::material::Material;

/// Keys of a material table that state its law: `law`, or `knee_strain` with `stiffening`, or neither for linear tissue.
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
        let alone = |key: &str, other: &str| Err(OutOfRange::new(key, "alone", format!("`{other}` beside it")));
        match (self.law, self.knee_strain, self.stiffening) {
            (None, None, None) => Linear::new(material, NoKeys {}).map(AnyLaw::from),
            (None, Some(knee), Some(rate)) => Stiffening::new(material, knee, rate).map(AnyLaw::from),
            (None, Some(_), None) => alone("knee_strain", "stiffening"),
            (None, None, Some(_)) => alone("stiffening", "knee_strain"),
            (Some(spec), None, None) => {
                let law = spec.of(material).map_err(|error| OutOfRange {
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
