//! Constitutive laws of tissue.
//!
//! A law gives the first Piola-Kirchhoff stress and its derivative for a displacement gradient H = du/dX: the
//! deformation gradient is F = I + H. Laws of small strain take the symmetric part of H. In plane strain the third row
//! and column of H are zero.

use nalgebra::{Matrix3, SMatrix};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::tissue::material::Material;
use insonify_base::range::{OutOfRange, Range, Ranges};

/// Displacement gradient, or a stress.
pub type Tensor = Matrix3<f64>;

/// Derivative of a stress with respect to the displacement gradient, kPa: entry `(3 i + j, 3 k + l)` is dP_ij / dH_kl.
pub type Moduli = SMatrix<f64, 9, 9>;

/// A constitutive law.
///
/// ```
/// use insonify_mechanics::tissue::law::{Law, NeoHookean, NoKeys, Tensor};
/// use insonify_mechanics::tissue::material::Material;
///
/// let material = Material::new(10.0, 0.45)?;
/// let law = NeoHookean::new(material, NoKeys {})?;
/// let [_, shear_kpa] = material.lame_kpa();
///
/// // Sheared by 1 %, the tissue answers by its shear modulus.
/// let mut gradient = Tensor::zeros();
/// gradient[(0, 1)] = 0.01;
/// let stress_kpa = law.stress_kpa(&gradient)[(0, 1)];
/// assert!((stress_kpa - 0.01 * shear_kpa).abs() < 1e-5);
///
/// // Entry (1, 1) of the moduli is dP_01 / dH_01.
/// assert!((law.moduli_kpa(&Tensor::zeros())[(1, 1)] - shear_kpa).abs() < 1e-12);
/// # Ok::<(), insonify_base::range::OutOfRange>(())
/// ```
pub trait Law {
    /// Keys of the law in files, besides the moduli of the material at rest.
    type Keys: Ranges + Clone;

    /// Usual keys, for tests of all laws.
    const EXAMPLE: Self::Keys;

    /// Creates the law of a material with these moduli at small strain.
    ///
    /// # Errors
    /// [`OutOfRange`] for a key that is out of range.
    fn new(material: Material, keys: Self::Keys) -> Result<Self, OutOfRange>
    where
        Self: Sized;

    /// The material at small strain.
    fn at_rest(&self) -> Material;

    /// Strain energy per volume at rest, kPa, if the stress derives from one; NaN where the law is not defined, as for
    /// an inverted element.
    fn energy_kpa(&self, _gradient: &Tensor) -> Option<f64> {
        None
    }

    /// First Piola-Kirchhoff stress, kPa; NaN where the law is not defined.
    fn stress_kpa(&self, gradient: &Tensor) -> Tensor;

    /// Derivative of the stress.
    fn moduli_kpa(&self, gradient: &Tensor) -> Moduli;

    /// The law as a secant modulus times linear elasticity at small strain, if it is one: what a memory of fractional
    /// order needs.
    fn as_secant(&self) -> Option<Stiffening> {
        None
    }
}

/// No keys besides the moduli at small strain.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NoKeys {}

impl Ranges for NoKeys {
    const KEYS: &'static [&'static str] = &[];
    const RANGES: &'static [Range<Self>] = &[];
}

/// Deformation of an element that is neither flat nor inverted.
struct Deformation {
    /// Deformation gradient F.
    f: Tensor,
    /// Transpose of its inverse.
    inverse: Tensor,
    /// Change of volume J - 1.
    dilation: f64,
    /// C - I, twice the Green-Lagrange strain.
    strain: Tensor,
}

impl Deformation {
    /// Deformation with this displacement gradient H; `None` where an element is flat or inverted.
    fn new(gradient: &Tensor) -> Option<Self> {
        let h = gradient;
        let f = Tensor::identity() + h;
        let minor = |i: usize, k: usize| h[(i, i)] * h[(k, k)] - h[(i, k)] * h[(k, i)];
        // Both strains are formed from H: from F, small ones would lose their digits to the identity.
        let dilation = h.trace() + minor(0, 1) + minor(0, 2) + minor(1, 2) + h.determinant();
        let inverse = f.try_inverse().filter(|_| dilation > -1.0)?;
        Some(Self {
            f,
            inverse: inverse.transpose(),
            dilation,
            strain: h + h.transpose() + h.transpose() * h,
        })
    }
}

/// Declares the laws: the names of files, each with its module, type and description.
macro_rules! laws {
    ($($name:literal $module:ident: $Law:ident = $doc:literal;)+) => {
        $(mod $module; pub use $module::$Law;)+

        /// Any law.
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub enum AnyLaw {
            $(#[doc = $doc] $Law($Law),)+
        }

        /// A law as a file states it.
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
        #[serde(tag = "kind")]
        pub enum LawSpec {
            $(
                #[doc = $doc]
                #[serde(rename = $name)]
                $Law(<$Law as Law>::Keys),
            )+
        }

        $(impl From<$Law> for AnyLaw {
            fn from(law: $Law) -> Self {
                Self::$Law(law)
            }
        })+

        impl LawSpec {
            /// Every law with its usual keys, and its name in files.
            pub fn examples() -> Vec<(&'static str, Self)> {
                vec![$(($name, Self::$Law(<$Law as Law>::EXAMPLE)),)+]
            }

            /// Creates the law of a material with these moduli at small strain.
            ///
            /// # Errors
            /// [`OutOfRange`] for a key that is out of range.
            pub fn law(&self, material: Material) -> Result<AnyLaw, OutOfRange> {
                match self {
                    $(Self::$Law(keys) => {
                        keys.check_ranges()?;
                        <$Law as Law>::new(material, keys.clone()).map(AnyLaw::$Law)
                    })+
                }
            }
        }

        impl AnyLaw {
            /// Every law with its usual keys, of a material with these moduli at small strain, and its name in files.
            ///
            /// # Errors
            /// None for the laws that there are.
            pub fn examples(material: Material) -> Result<Vec<(&'static str, Self)>, OutOfRange> {
                let laws = LawSpec::examples().into_iter();
                laws.map(|(name, spec)| Ok((name, spec.law(material)?))).collect()
            }

            /// The material at small strain.
            pub fn at_rest(&self) -> Material {
                match self {
                    $(Self::$Law(law) => law.at_rest(),)+
                }
            }

            /// See [`Law::energy_kpa`].
            pub fn energy_kpa(&self, gradient: &Tensor) -> Option<f64> {
                match self {
                    $(Self::$Law(law) => law.energy_kpa(gradient),)+
                }
            }

            /// See [`Law::stress_kpa`].
            pub fn stress_kpa(&self, gradient: &Tensor) -> Tensor {
                match self {
                    $(Self::$Law(law) => law.stress_kpa(gradient),)+
                }
            }

            /// See [`Law::moduli_kpa`].
            pub fn moduli_kpa(&self, gradient: &Tensor) -> Moduli {
                match self {
                    $(Self::$Law(law) => law.moduli_kpa(gradient),)+
                }
            }

            /// See [`Law::as_secant`].
            pub fn as_secant(&self) -> Option<Stiffening> {
                match self {
                    $(Self::$Law(law) => law.as_secant(),)+
                }
            }
        }
    };
}

laws! {
    "linear" linear: Linear = "Linear elasticity at small strain.";
    "knee" knee: Stiffening = "Stiffening above a knee strain (Kobayashi et al. 2010).";
    "neo-hookean" neo_hookean: NeoHookean = "Neo-Hookean tissue, of finite strain.";
    "ogden" ogden: Ogden = "Ogden tissue of one term, of finite strain; with a negative exponent it is stiffer in compression.";
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;

    use super::*;

    fn laws() -> Vec<(&'static str, AnyLaw)> {
        AnyLaw::examples(Material::new(10.0, 0.45).unwrap()).unwrap()
    }

    /// Gradients with three different stretches, two equal ones, none, a plane one, and a large one.
    fn gradients() -> Vec<Tensor> {
        vec![
            Tensor::new(0.12, 0.05, -0.03, 0.02, -0.08, 0.07, 0.04, -0.06, 0.1),
            Tensor::from_diagonal(&[0.2, -0.1, -0.1].into()),
            Tensor::zeros(),
            Tensor::new(0.1, 0.3, 0.0, 0.0, -0.1, 0.0, 0.0, 0.0, 0.0),
            Tensor::new(0.9, 0.4, 0.1, -0.2, -0.5, 0.3, 0.2, 0.1, 0.3),
        ]
    }

    fn difference<const N: usize>(function: impl Fn(&Tensor) -> [f64; N], gradient: &Tensor, entry: usize) -> [f64; N] {
        const STEP: f64 = 1e-6;
        let mut step = Tensor::zeros();
        step[(entry / 3, entry % 3)] = STEP;
        let [after, before] = [function(&(gradient + step)), function(&(gradient - step))];
        std::array::from_fn(|component| (after[component] - before[component]) / (2.0 * STEP))
    }

    #[test]
    fn stresses_are_derivatives_of_energies_and_moduli_of_stresses() {
        for (name, law) in laws() {
            for gradient in gradients() {
                let (stress, moduli) = (law.stress_kpa(&gradient), law.moduli_kpa(&gradient));
                let scale = moduli.amax();
                for entry in 0..9 {
                    if law.energy_kpa(&gradient).is_some() {
                        let [slope] = difference(|h| [law.energy_kpa(h).unwrap()], &gradient, entry);
                        let position = (entry / 3, entry % 3);
                        assert!(
                            (slope - stress[position]).abs() < 1e-8 * scale,
                            "{name} {gradient}{slope} {}",
                            stress[position]
                        );
                    }
                    let rows = |h: &Tensor| -> [f64; 9] {
                        let stress = law.stress_kpa(h);
                        std::array::from_fn(|row| stress[(row / 3, row % 3)])
                    };
                    let column = difference(rows, &gradient, entry);
                    for (row, slope) in column.iter().enumerate() {
                        let exact = moduli[(row, entry)];
                        assert!(
                            (slope - exact).abs() < 1e-7 * scale,
                            "{name} {gradient}{row} {entry}: {slope} {exact}"
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn at_rest_every_law_is_linear_elasticity() {
        let linear = laws()[0].1.moduli_kpa(&Tensor::zeros());
        for (name, law) in laws() {
            assert_eq!(law.at_rest(), laws()[0].1.at_rest());
            assert!(law.stress_kpa(&Tensor::zeros()).amax() < 1e-12, "{name}");
            assert!(
                (law.moduli_kpa(&Tensor::zeros()) - linear).amax() < 1e-9 * linear.amax(),
                "{name}"
            );
        }
    }

    /// Small strains keep their digits: stress departs from the linear one by its square alone.
    #[test]
    fn under_small_strain_every_law_is_linear_to_rounding() {
        let gradient = gradients()[0] * 1e-11;
        let linear = laws()[0].1.stress_kpa(&gradient);
        for (name, law) in laws() {
            let error = (law.stress_kpa(&gradient) - linear).amax() / linear.amax();
            assert!(error < 1e-9, "{name}: {error:e}");
            if let Some(energy) = law.energy_kpa(&gradient) {
                let expected = 0.5 * linear.dot(&gradient);
                assert!(
                    (energy / expected - 1.0).abs() < 1e-4,
                    "{name}: {energy:e} {expected:e}"
                );
            }
        }
    }

    /// Laws of finite strain are objective: a turned element has the turned stress, P(Q F) = Q P(F). Those of small
    /// strain are not.
    #[test]
    fn laws_of_finite_strain_are_objective() {
        let turn = Rotation3::from_euler_angles(0.9, -0.4, 2.1).into_inner();
        for (name, law) in laws() {
            for gradient in gradients() {
                let turned = turn * (Tensor::identity() + gradient) - Tensor::identity();
                let [stress_kpa, expected] = [law.stress_kpa(&turned), turn * law.stress_kpa(&gradient)];
                let is_objective = (stress_kpa - expected).amax() < 1e-9 * law.moduli_kpa(&gradient).amax();
                assert_eq!(
                    is_objective,
                    law.as_secant().is_none(),
                    "{name} {gradient}{stress_kpa}{expected}"
                );
                if law.as_secant().is_none() {
                    let [a, b] = [&gradient, &turned].map(|h| law.energy_kpa(h).expect("an energy"));
                    assert!((a - b).abs() < 1e-9 * (1.0 + a.abs()), "{name}: {a} {b}");
                }
            }
        }
    }

    /// Nominal stress of a bar of nearly incompressible tissue at a stretch, kPa.
    pub(super) fn uniaxial_kpa<L: Law>(keys: L::Keys, stretch: f64) -> (f64, f64) {
        let material = Material::new(9.0, 0.499_999_9).unwrap();
        let law = L::new(material, keys).unwrap();
        // The lateral stretch at which the sides are free of stress.
        let pull = |side: f64| Tensor::from_diagonal(&[stretch - 1.0, side - 1.0, side - 1.0].into());
        let (mut low, mut high) = (0.5 / stretch.sqrt(), 2.0 / stretch.sqrt());
        for _ in 0..200 {
            let middle = 0.5 * (low + high);
            if law.stress_kpa(&pull(middle))[(1, 1)] < 0.0 {
                low = middle
            } else {
                high = middle
            }
        }
        let [_, mu] = material.lame_kpa();
        (law.stress_kpa(&pull(low))[(0, 0)], mu)
    }

    #[test]
    fn inverted_elements_have_no_stress() {
        for (name, law) in laws() {
            let flat = Tensor::from_diagonal(&[-1.2, 0.0, 0.0].into());
            assert_eq!(
                law.stress_kpa(&flat).iter().any(|x| x.is_nan()),
                law.as_secant().is_none(),
                "{name}"
            );
        }
    }
}
