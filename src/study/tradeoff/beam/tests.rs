use super::*;
use crate::tradeoff::{Rates, Row, Table};

fn value(table: &Table, row: &Row, key: &str) -> f64 {
    row.values[table.axis(key).expect("an axis")].expect("a value")
}

#[test]
fn choices_are_measured_against_the_fine_needle() {
    let study = study().expect("a study");
    let [elements, friction, term, models, needles] = &study.tables[..] else {
        panic!("five tables");
    };
    assert!(
        study
            .tables
            .iter()
            .flat_map(|table| &table.rows)
            .all(|row| row.flag.is_none())
    );
    let rows: Vec<usize> = study.tables.iter().map(|table| table.rows.len()).collect();
    assert_eq!(rows, [15, 30, 48, 72, 10]);
    assert_eq!(study.plots().len(), study.figures.len(), "every figure has points");
    // The length of elements of an inserted needle is advised on by the insertion study alone.
    assert!(
        study
            .tables
            .iter()
            .all(|table| table.in_time(&Rates::default()).is_empty())
    );
    assert!(needles.advice().iter().all(|advice| {
        let take = advice.take.as_ref();
        take.is_none_or(|way| ["springs", "beam"].contains(&way.name.as_str()))
    }));
    // Fourth order: errors fall tenfold or more from 5 to 1 mm.
    for case in elements.rows.chunks(5) {
        let errors: Vec<f64> = case[..4].iter().map(|row| value(elements, row, "error_mm")).collect();
        assert!(
            errors.is_sorted_by(|a, b| a > b) && errors[2] < 0.1 * errors[0],
            "{errors:?}"
        );
        assert!(errors[2] < 1e-4, "{errors:?}");
    }
    // More friction moves the needle more; without friction nothing moves.
    for rows in friction.rows.chunks(5) {
        let moved: Vec<f64> = rows.iter().map(|row| value(friction, row, "shape_mm")).collect();
        assert!(moved[0] == 0.0 && moved.is_sorted_by(|a, b| a < b), "{moved:?}");
    }
    // With the friction term only the element error remains; without it, the effect of friction.
    for pair in term.rows.chunks(2) {
        let [left_out, kept] = [0, 1].map(|index| value(term, &pair[index], "error_mm"));
        assert!(kept < 1e-2 * left_out, "{left_out} {kept}");
    }
    // The right model has only its element error, any other more, and swapped parameters err the more the deeper the
    // needle is.
    let right = |row: &&Row| {
        row.choices[2] == "right" && [["PVC", "UEng"], ["PSM", "UTru"]].contains(&[&row.choices[0], &row.choices[1]])
    };
    for row in &models.rows {
        let error = value(models, row, "largest_mm");
        assert!(right(&row) == (error < 1e-5), "{row:?}");
    }
    for tissue in ["PVC", "PSM"] {
        let swapped = models
            .rows
            .iter()
            .filter(|row| row.choices[0] == tissue && row.choices[2] == "swapped");
        let swapped = swapped.filter(|row| row.choices[1] == "UTru");
        let errors: Vec<f64> = swapped.map(|row| value(models, row, "median_mm")).collect();
        assert!(errors.len() == 3 && errors.is_sorted(), "{errors:?}");
    }
    // Both models of a needle converge to the same shape, quadratically in the length of their pieces.
    for rows in [0, 1].map(|model| needles.rows.iter().skip(model).step_by(2)) {
        let errors: Vec<f64> = rows.map(|row| value(needles, row, "error_mm")).collect();
        assert!(
            errors.is_sorted_by(|a, b| a > b) && errors[4] < 0.01 * errors[0],
            "{errors:?}"
        );
    }
}
