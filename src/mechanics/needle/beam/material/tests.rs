use super::*;

/// Sum of powers of the stretches, less that at rest.
pub(super) fn sum(stretches: [f64; 3], power: f64) -> f64 {
    stretches.iter().map(|x| x.powf(power)).sum::<f64>() - 3.0
}

/// Stress from the energy itself, by differences along the path permitted by the constraint.
#[test]
fn stress_is_the_slope_of_the_energy() {
    for material in Material::examples() {
        for compression in Compression::ALL {
            let energy = |l: f64| {
                let stretches = match compression {
                    Compression::CTru => [1.0, l, 1.0 / l],
                    _ => [l.powf(-0.5), l, l.powf(-0.5)],
                };
                material.energy_kpa(stretches)
            };
            let law = Law::new(&material, compression);
            for ratio in [0.45, 0.8, 0.97, 1.2] {
                let step = 1e-5 * ratio;
                let engineering = (energy(ratio + step) - energy(ratio - step)) / (2.0 * step);
                let expected = match compression {
                    Compression::UEng => engineering,
                    _ => engineering * ratio,
                };
                // Second-order differences: (step^2/6) W''' is 1e-10 of W' / ratio^2 times a few powers of alpha.
                let stress = law.at(ratio).stress_kpa;
                let near = 1e-6 * expected.abs();
                assert!(
                    (stress - expected).abs() < near,
                    "{material:?} {compression:?} {ratio}: {stress} {expected}"
                );
            }
        }
    }
}

#[test]
fn moduli_are_the_slopes_of_stress() {
    for material in Material::examples() {
        for compression in Compression::ALL {
            let law = Law::new(&material, compression);
            for ratio in [0.3, 0.6, 0.9, 1.0] {
                let step = 1e-5 * ratio;
                let [more, less] = [law.at(ratio + step), law.at(ratio - step)];
                let here = law.at(ratio);
                let slope_of = |part: fn(&Response) -> f64| (part(&more) - part(&less)) / (2.0 * step);
                // The same tolerance; rounding of differences adds 1e-11 of the largest term, which may cancel in the
                // sum.
                for (modulus, expected) in [
                    (here.tangent_kpa, slope_of(|r| r.stress_kpa)),
                    (here.rate_kpa, slope_of(|r| r.tangent_kpa)),
                ] {
                    let near = 1e-6 * modulus.abs() + 1e-7 * here.tangent_kpa.abs();
                    assert!(
                        (modulus - expected).abs() < near,
                        "{material:?} {compression:?} {ratio}: {modulus} {expected}"
                    );
                }
            }
        }
    }
}

/// At rest the tangent modulus is 3 mu, or 4 mu where tissue cannot widen along the needle, mu being that of shear: a
/// stretch by e along one axis and the inverse along another has the energy 2 mu e^2.
#[test]
fn at_rest_all_materials_of_a_shear_modulus_are_alike() {
    for material in Material::examples() {
        let secant = |strain: f64| material.energy_kpa([1.0, strain.exp(), (-strain).exp()]) / (2.0 * strain.powi(2));
        // The error of second order drops out of two strains; that of fourth is below 1e-8 for an exponent of 20,
        // rounding some 1e-10.
        let mu = (4.0 * secant(1.5e-3) - secant(3e-3)) / 3.0;
        for (compression, times) in Compression::ALL.into_iter().zip([3.0, 3.0, 4.0]) {
            let at_rest = Law::new(&material, compression).at(1.0);
            assert!(at_rest.stress_kpa.abs() < 1e-13 * mu, "{material:?}");
            assert!(
                (at_rest.tangent_kpa - times * mu).abs() < 1e-7 * mu,
                "{material:?} {compression:?}"
            );
        }
    }
}

/// The law from section III-A of Wang et al. and the moduli at rest.
#[test]
fn ogden_is_as_published() {
    let (mu, alpha, l) = (3.63, 8.74, 0.7f64);
    let material = Material::Ogden(Ogden { mu_kpa: mu, alpha });
    let expected = [
        2.0 * mu / alpha * (l.powf(alpha - 1.0) - l.powf(-alpha / 2.0 - 1.0)),
        2.0 * mu / alpha * (l.powf(alpha) - l.powf(-alpha / 2.0)),
        2.0 * mu / alpha * (l.powf(alpha) - l.powf(-alpha)),
    ];
    for (compression, expected) in Compression::ALL.into_iter().zip(expected) {
        let stress = Law::new(&material, compression).at(l).stress_kpa;
        assert!((stress - expected).abs() < 1e-13 * expected.abs(), "{compression:?}");
    }
}

#[test]
fn numbers_out_of_range_are_refused_by_name() {
    for (material, key) in [
        (
            Material::Ogden(Ogden {
                mu_kpa: -1.0,
                alpha: 2.0,
            }),
            "mu_kpa",
        ),
        (
            Material::Ogden(Ogden {
                mu_kpa: 1.0,
                alpha: 0.0,
            }),
            "alpha",
        ),
        (
            Material::MooneyRivlin(MooneyRivlin {
                c10_kpa: 1.0,
                c01_kpa: -1.5,
            }),
            "c01_kpa",
        ),
        (
            Material::Yeoh(Yeoh {
                c10_kpa: 1.0,
                c20_kpa: f64::NAN,
            }),
            "c20_kpa",
        ),
        (
            Material::Yeoh(Yeoh {
                c10_kpa: -1.0,
                c20_kpa: 1.0,
            }),
            "c10_kpa",
        ),
    ] {
        assert_eq!(material.check().unwrap_err().key, key);
    }
    Material::examples()
        .iter()
        .for_each(|material| material.check().expect("a material"));
}
