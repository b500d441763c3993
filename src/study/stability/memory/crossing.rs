//! Case of a strain that crosses the knee at every step.

use crate::mechanics::tissue::viscoelastic::point::{Body, Control, Knee, Loading, Method, Point, Structure};
use crate::study::stability::record::{Record, Unexpected, largest};

/// Applies a stress that takes the strain far below and far above the knee, and to its other side.
pub fn crossing(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let steps = record.effort().pick(500, 3000);
    let bodies = [
        (
            "spring-pot",
            Body::SpringPot {
                order: 0.1,
                modulus_kpa: 0.4,
            },
        ),
        (
            "zener",
            Body::Zener {
                order: 0.3,
                modulus_kpa: 0.4,
                modulus_inf_kpa: 0.1,
                tau_s: 0.05,
            },
        ),
    ];
    let loading = Loading {
        control: Control::Stress,
        time_s: (0..=steps).map(|at| 1e-3 * f64::from(at)).collect(),
        value: (0..=steps)
            .map(|at| [0.02, 0.5, -0.02, 0.16, -0.5][at as usize % 5])
            .collect(),
    };
    for (name, body) in bodies {
        for (structure, word) in [(Structure::Rate, "rate"), (Structure::LoadIntegral, "load-integral")] {
            let (mut iterations, mut crossings, mut wrong) = (0, usize::MAX, 0);
            let mut differences = Vec::new();
            for stiffening in [0.1, 8.0, 1e3, 1e6] {
                let knee = Knee {
                    strain: 0.35,
                    stiffening,
                };
                let point = Point { body, knee, structure };
                let response = point.respond_in(&loading, Method::Trapezoid, 1)?;
                iterations = iterations.max(response.iterations);
                wrong += response.strain.iter().filter(|strain| !strain.is_finite()).count();
                let above = |strain: &f64| strain.abs() > knee.strain;
                let pairs = response.strain.windows(2);
                crossings = crossings.min(pairs.filter(|pair| above(&pair[0]) != above(&pair[1])).count());
                // For a spring-pot the reverse control uses a different rule, summing strains instead of stresses.
                if matches!(body, Body::Zener { .. }) {
                    let back = Loading {
                        control: Control::Strain,
                        value: response.strain.clone(),
                        ..loading.clone()
                    };
                    let back = point.respond_in(&back, Method::Trapezoid, 1)?;
                    let stresses = back.stress_kpa.iter().zip(&loading.value);
                    differences.push(largest(stresses.map(|(a, b)| a.unwrap_or(f64::NAN) - b)));
                }
            }
            record.under(format!("{name}, {word}: most iterations"), iterations as f64, 30.0);
            record.report(format!("{name}, {word}: fewest crossings"), crossings as f64);
            record.zero(format!("{name}, {word}: strains that are not finite"), wrong as f64);
            if !differences.is_empty() {
                record.under(
                    format!("{name}, {word}: stress that comes back, kPa off"),
                    largest(differences),
                    1e-9,
                );
            }
        }
    }
    Ok(())
}
