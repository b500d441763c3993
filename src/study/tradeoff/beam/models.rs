//! Material and compression models: tip error with right parameters, wrong ones and those of the other tissue (figures 7 and 8).

use super::{FINE_MM, axis, factor, solve};
use crate::base::report::statistics::percentile;
use crate::mechanics::needle::beam::{Base, BeamError, Compression, FoundationBeam, Material};
use crate::study::beam::{CONTROLS_MM, DEPTHS_MM, DISPLACEMENTS_MM, ELEMENT_MM, TISSUES, Tissue, problem};
use crate::study::tradeoff::{Figure, Table};

/// Motion of the base, and the resulting tip position.
struct Truth {
    control_mm: f64,
    base: Base,
    tip_mm: f64,
}

pub(super) fn table() -> Result<Table, BeamError> {
    let axes = [
        axis("inserted_mm", "l mm", "inserted depth, mm", false),
        axis(
            "median_mm",
            "median mm",
            "error of the tip (median over base motions), mm",
            false,
        ),
        axis("largest_mm", "largest mm", "error of the tip (largest), mm", false),
    ];
    let factors = [
        factor("tissue", "tissue"),
        factor("compression", "compression"),
        factor("parameters", "parameters"),
        factor("depth", "depth"),
    ];
    let title = "Models: error of the tip over base motions of 2.5 to 15 mm, 20 and 40 mm before the entry";
    let gold = format!("UEng for PVC and UTru for PSM with the right parameters, elements of {FINE_MM} mm");
    let mut table = Table::new("models", title, &factors, &axes).against(gold);
    for (tissue, other) in [(TISSUES[0], TISSUES[1]), (TISSUES[1], TISSUES[0])] {
        for depth in DEPTHS_MM {
            let truths = truths(&tissue, depth)?;
            for compression in Compression::ALL {
                for (parameters, material) in materials(&tissue, &other) {
                    let found = errors(&truths, material, compression, depth);
                    let choices = [tissue.name, compression.name(), parameters].map(str::to_owned);
                    let choices = [&choices[..], &[format!("{depth} mm")]].concat();
                    match found {
                        Ok(errors) => {
                            let values = [Some(depth), percentile(&errors, 0.5), errors.last().copied()];
                            table.push(choices, values.to_vec(), None);
                        }
                        Err(error) => table.push(choices, vec![Some(depth), None, None], Some(error.to_string())),
                    }
                }
            }
        }
    }
    Ok(table)
}

/// Returns the parameters to compare: the right ones, wrong moduli, and those of the other tissue.
fn materials(tissue: &Tissue, other: &Tissue) -> [(&'static str, Material); 4] {
    let times = |factor: f64| match tissue.material {
        Material::Ogden { mu_kpa, alpha } => Material::Ogden {
            mu_kpa: factor * mu_kpa,
            alpha,
        },
        material => material,
    };
    [
        ("right", tissue.material),
        ("mu x 0.5", times(0.5)),
        ("mu x 2", times(2.0)),
        ("swapped", other.material),
    ]
}

/// Returns the motion of a freely rotating base in the true tissue.
fn truths(tissue: &Tissue, depth: f64) -> Result<Vec<Truth>, BeamError> {
    let mut truths = Vec::new();
    for control_mm in CONTROLS_MM {
        let needle = problem(tissue.material, tissue.compression, control_mm, depth, FINE_MM);
        let mut beam = FoundationBeam::new(&needle)?;
        for displacement_mm in DISPLACEMENTS_MM {
            let shape = beam.solve(&Base {
                displacement_mm,
                slope: None,
            })?;
            truths.push(Truth {
                control_mm,
                base: Base {
                    displacement_mm,
                    slope: Some(shape.points[0].slope),
                },
                tip_mm: shape.tip_mm(),
            });
        }
    }
    Ok(truths)
}

/// Returns the errors of the tip with a model, mm, ascending.
fn errors(truths: &[Truth], material: Material, compression: Compression, depth: f64) -> Result<Vec<f64>, BeamError> {
    let errors = truths.iter().map(|truth| {
        let needle = problem(material, compression, truth.control_mm, depth, ELEMENT_MM);
        Ok((solve(&needle, &truth.base)?.tip_mm() - truth.tip_mm).abs())
    });
    let mut errors = errors.collect::<Result<Vec<f64>, BeamError>>()?;
    errors.sort_by(f64::total_cmp);
    Ok(errors)
}

pub(super) fn figures() -> Vec<Figure> {
    let figure = |tissue: &str| Figure {
        marker: vec!["parameters"],
        only: vec![("tissue", tissue.to_owned())],
        ..Figure::new(
            format!("beam-models-{}", tissue.to_lowercase()),
            format!("Models of tissue, {tissue}: error of the tip"),
            "models",
            ["inserted_mm", "median_mm"],
            "compression",
        )
    };
    TISSUES.map(|tissue| figure(tissue.name)).to_vec()
}
