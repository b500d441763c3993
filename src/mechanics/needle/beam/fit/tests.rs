use super::*;
use crate::needle::beam::ModelName;
use crate::needle::beam::material::Ogden;
use insonify_base::kinds::KeyedKind;

fn samples(material: Material, compression: Compression, lowest: f64) -> Vec<Sample> {
    let law = Law::new(&material, compression);
    let stretches = (0..=20).map(|index: i32| lowest + (1.0 - lowest) * f64::from(index) / 20.0);
    stretches
        .map(|stretch| Sample {
            stretch,
            stress_kpa: law.at(stretch).stress_kpa,
        })
        .collect()
}

#[test]
fn what_made_the_data_is_found() {
    for material in Material::examples() {
        for compression in [Compression::UEng, Compression::UTru] {
            let fit = Fit::new(&samples(material, compression, 0.5), compression).expect("a fit");
            let fitted = fit
                .models
                .iter()
                .find(|model| model.material.model() == material.model());
            let fitted = fitted.expect("its model");
            assert!(fitted.r_squared > 1.0 - 1e-12, "{fitted:?}");
            let pairs = material.parameters().into_iter().zip(fitted.material.parameters());
            for ((key, expected), (_, value)) in pairs {
                // The golden section ends at 1e-9; the sum of squares is flat there to the root of rounding, 1e-8.
                assert!(
                    (value - expected).abs() < 1e-5 * expected.abs(),
                    "{key}: {value} {expected}"
                );
            }
        }
    }
}

/// Least squares: no small change of a parameter fits better.
#[test]
fn fits_are_the_best_of_their_model() {
    let mut data = samples(
        Material::Ogden(Ogden {
            mu_kpa: 5.0,
            alpha: 6.0,
        }),
        Compression::UTru,
        0.6,
    );
    for (index, sample) in data.iter_mut().enumerate() {
        sample.stress_kpa *= 1.0 + 0.05 * (index as f64 * 2.3).sin();
    }
    let fit = Fit::new(&data, Compression::UTru).expect("a fit");
    for model in &fit.models {
        let best = residual(&data, &model.material, Compression::UTru);
        assert!(model.r_squared > 0.9 && model.r_squared < 1.0);
        for by in [0.999, 1.001] {
            for other in others(&model.material, by) {
                assert!(residual(&data, &other, Compression::UTru) > best, "{other:?}");
            }
        }
    }
}

/// The material with each of its parameters in turn multiplied.
fn others(material: &Material, by: f64) -> Vec<Material> {
    let parameters = material.parameters();
    let other = |changed: usize| {
        let numbers = parameters.iter().enumerate().map(|(index, (key, value))| {
            let value = if index == changed { by * value } else { *value };
            ((*key).to_owned(), value.into())
        });
        let name: ModelName = serde_json::from_value(material.model().into()).expect("a name");
        name.read(serde_json::Value::Object(numbers.collect()))
            .expect("a material")
    };
    (0..parameters.len()).map(other).collect()
}

/// As in Wang et al. 2023: for data from a phantom down to 0.8, the neo-Hookean model diverges from the others first.
#[test]
fn models_that_part_beyond_the_data_are_named() {
    let phantom = Material::Ogden(Ogden {
        mu_kpa: 12.72,
        alpha: -1.0,
    });
    let fit = Fit::new(&samples(phantom, Compression::UEng, 0.8), Compression::UEng).expect("a fit");
    assert!(fit.models.iter().all(|model| model.r_squared > 0.99), "{fit:?}");
    let stretch = |model| {
        fit.partings
            .iter()
            .find(|parting| parting.model == model)
            .map(|p| p.stretch)
    };
    let of_neo_hooke = stretch("neo-hookean").expect("it parts");
    assert!(of_neo_hooke < 0.8, "{of_neo_hooke}");
    for model in ["mooney-rivlin", "yeoh", "ogden"] {
        assert!(stretch(model).unwrap_or(0.0) < of_neo_hooke, "{fit:?}");
    }
}

#[test]
fn data_that_say_nothing_are_refused() {
    let sample = |stretch, stress_kpa| Sample { stretch, stress_kpa };
    let fit = |samples: &[Sample]| Fit::new(samples, Compression::UEng).expect_err("refused");
    let few = [
        sample(1.0, 0.0),
        sample(0.9, -1.0),
        sample(0.9, -1.1),
        sample(0.8, -2.0),
    ];
    assert_eq!(fit(&few), FitError::TooFew { found: 2 });
    let bad = [sample(0.9, -1.0), sample(-0.8, -2.0), sample(0.7, -3.0)];
    assert!(matches!(fit(&bad), FitError::Number { stretch: -0.8, .. }));
    let flat = [sample(0.9, -1.0), sample(0.0, -2.0), sample(0.7, -3.0)];
    assert!(matches!(fit(&flat), FitError::Number { stretch: 0.0, .. }));
    let positive = [sample(0.9, 1.0), sample(0.8, 2.0), sample(0.7, 3.0)];
    assert!(matches!(fit(&positive), FitError::Sign { stretch: 0.7, .. }));
}
