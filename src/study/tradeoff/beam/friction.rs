//! The friction term: on and off.

use super::{apart, axis, factor, solve};
use crate::mechanics::needle::beam::{Base, BeamError};
use crate::study::beam::{ELEMENT_MM, TISSUES, problem};
use crate::study::tradeoff::{Figure, Table};

const FRICTION: [f64; 5] = [0.0, 0.1, 0.3, 0.6, 1.0];
const SLOPES: [f64; 3] = [-0.1, -0.4, -0.8];

pub(super) fn table() -> Result<Table, BeamError> {
    let axes = [
        axis("gamma", "gamma", "friction, gamma", false),
        axis(
            "tip_mm",
            "tip mm",
            "change of the tip's deflection against no friction, mm",
            false,
        ),
        axis("shape_mm", "shape mm", "largest change of the deflection, mm", false),
        axis("com_mm", "COM mm", "change of the centre of motion's depth, mm", false),
    ];
    let factors = [
        factor("tissue", "tissue"),
        factor("slope", "slope"),
        factor("friction", "friction"),
    ];
    let title = "Friction: change against none, 60 mm in, base 20 mm before the entry, moved by 15 mm";
    let mut table = Table::new("friction", title, &factors, &axes).against("the same needle without friction");
    for tissue in TISSUES {
        for slope in SLOPES {
            let base = Base {
                displacement_mm: 15.0,
                slope: Some(slope),
            };
            let mut needle = problem(tissue.material, tissue.compression, 20.0, 60.0, ELEMENT_MM);
            let smooth = solve(&needle, &base)?;
            for friction in FRICTION {
                needle.layers[0].friction = friction;
                let rough = solve(&needle, &base)?;
                let com = rough
                    .com_mm()
                    .zip(smooth.com_mm())
                    .map(|(rough, smooth)| rough - smooth);
                let values = vec![
                    Some(friction),
                    Some(rough.tip_mm() - smooth.tip_mm()),
                    Some(apart(&rough, &smooth)),
                    com,
                ];
                let choices = vec![tissue.name.to_owned(), format!("slope {slope}"), format!("{friction}")];
                table.push(choices, values, None);
            }
        }
    }
    Ok(table)
}

pub(super) fn figures() -> Vec<Figure> {
    vec![Figure {
        file: "beam-friction".to_owned(),
        title: "Friction: how far it moves the needle".to_owned(),
        table: "friction",
        x: "gamma",
        y: "shape_mm",
        colour: "slope",
        marker: vec!["tissue"],
        only: Vec::new(),
        joined: true,
        marked: true,
        front: false,
    }]
}
