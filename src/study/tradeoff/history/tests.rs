use super::*;

#[test]
fn every_rule_comes_near_the_exact_law_with_its_order() {
    let options = HistoryOptions {
        steps: vec![100, 1000],
        ..HistoryOptions::default()
    };
    let mut reached = 0.0;
    let study = study(&options, &mut |_, share| {
        assert!(share >= reached);
        reached = share;
    })
    .unwrap();
    assert_eq!(reached, 1.0);
    let json = study.json();
    let rows = json["tables"]["history"]["rows"].as_array().unwrap();
    // Seven rules on equal steps, all but one on unequal ones, twice.
    assert_eq!(rows.len(), 26);
    let error = |rule: &str, lengths: &str, count: &str| {
        let row = rows
            .iter()
            .find(|row| row["rule"] == rule && row["lengths"] == lengths && row["count"] == count);
        row.unwrap()["error"].as_f64().unwrap()
    };
    for (rule, order) in [
        ("rectangle", 1.0),
        ("time-scaled trapezoid", 1.0 + options.order),
        ("Gruenwald-Letnikov", 1.0),
        ("trapezoid", 2.0),
        ("exponentials, 1e-10", 2.0),
    ] {
        let order_found = (error(rule, "equal", "100") / error(rule, "equal", "1000")).log10();
        assert!(
            order_found > order - 0.2 && order_found < order + 0.3,
            "{rule}: {order_found}"
        );
    }
    // A loose tolerance adds no more error than itself.
    let coarse = (error("exponentials, 1e-4", "equal", "1000") - error("trapezoid", "equal", "1000")).abs();
    assert!(coarse < 1e-4, "{coarse:e}");
    assert!(rows.iter().all(|row| row["flag"].is_null()), "{json}");
    assert!(study.plots().len() == 3 && study.notes.len() == 3, "{:?}", study.notes);
}

#[test]
fn orders_are_checked() {
    let options = HistoryOptions {
        order: 1.5,
        steps: vec![10],
    };
    assert!(matches!(
        study(&options, &mut |_, _| {}),
        Err(HistoryError::Order { .. })
    ));
}
