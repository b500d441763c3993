use super::*;

#[test]
fn the_bound_is_the_published_one() {
    // At 5 MHz, bandwidth 0.6 and 1 mm, with noise 30 dB below the echoes in the band of the pulse.
    let acquisition = Acquisition {
        snr_db: 30.0 - 10.0 * (20.0_f64 / 3.0).log10(),
        ..Acquisition::new(5.0)
    };
    for (rho, expected_um) in [(0.99, 1.3), (0.98, 1.8), (0.95, 2.9)] {
        let bound = bound_um(&acquisition, 1.0, rho);
        assert!((bound - expected_um).abs() < 0.06, "{rho}: {bound} um");
    }
}

#[test]
fn no_estimate_beats_the_bound_and_long_windows_come_near_to_it() {
    let study = study(Effort::Quick, &mut |_, _| {});
    let table = &study.tables[0];
    assert_eq!(table.rows.len(), 7 * MOTIONS.len());
    let (medium, usual) = medium(Effort::Quick);
    let value = |window: &str, search: &str, motion: usize, key: &str| {
        let choices = [window, "2", search, MOTIONS[motion].0];
        let row = table.rows.iter().find(|row| row.choices == choices);
        table.value(row.expect("a row"), key).expect("a value")
    };
    for window in ["0.5", "1", "2", "4"] {
        let bound = bound_um(&medium.acquisition, window.parse().unwrap(), 1.0);
        let ratio = value(window, "prior", 0, "sd_um") / bound;
        assert!((1.0..1.8).contains(&ratio), "{window} mm: {ratio} of the bound");
    }
    // 1 % of strain costs less than noise would that lowers the correlation as much: what it changes is corrected.
    let rho = strained_correlation(&medium.acquisition, usual.window_mm, 0.01);
    let bounds = [1.0, rho].map(|rho| bound_um(&medium.acquisition, usual.window_mm, rho));
    let spread = value("1", "prior", 1, "sd_um");
    assert!(
        bounds[0] < spread && spread < 0.5 * bounds[1],
        "{rho}: {spread} um, bounds {bounds:?} um"
    );
    // Strain spoils long windows, noise short ones.
    assert!(value("4", "prior", 1, "sd_um") > 2.0 * value("1", "prior", 1, "sd_um"));
    assert!(value("1", "exhaustive", 0, "correlations") > 8.0 * value("1", "prior", 0, "correlations"));
    for row in &table.rows {
        // Hardly any of the longest windows correlates under the largest strain, or none.
        let wrong = table.value(row, "wrong").unwrap_or(1.0);
        let long = row.choices[0] == "4" && row.choices[3] == MOTIONS[2].0;
        assert!(wrong < 0.01 || row.choices[2] == "exhaustive" || long, "{row:?}");
    }
}

#[test]
fn estimates_follow_swings_and_a_needle() {
    let study = validation::study(Effort::Quick, &mut |_, _| {}).unwrap();
    let table = study
        .tables
        .iter()
        .find(|table| table.key == "errors")
        .expect("table I");
    let value = |motion: &str, key: &str| {
        let row = table.rows.iter().find(|row| row.choices[0] == motion).expect("a row");
        table.value(row, key).expect("a value")
    };
    let rigid = "1 mm at 1 Hz";
    assert!(
        value(rigid, "mean_error_um") < 0.5 && value(rigid, "sd_um") < 1.5,
        "{table:?}"
    );
    // The reference changes with the strain, and residuals add up: less than a tenth of the paper's 0.5 mm.
    let strained = "strain of 4 % at 0.25 Hz";
    assert!(
        value(strained, "switches") > 0.0 && value(strained, "drift_um").abs() < 50.0,
        "{table:?}"
    );
    assert!(value("insertion", "mean_error_um") < 20.0, "{table:?}");
    assert!(study.plots().len() >= 8, "{}", study.plots().len());
    // In tissue that is strained, too, both methods follow a bead.
    let beads = study.tables.iter().find(|table| table.key == "beads").expect("beads");
    assert_eq!(beads.rows.len(), 9);
    for row in &beads.rows {
        let of = |key: &str| beads.value(row, key).expect("a value");
        assert!(of("moved_um") > 100.0 && of("lost") == 0.0, "{row:?}");
        assert!(of("estimator_um") < 10.0 && of("envelope_um") < 20.0, "{row:?}");
    }
    for key in ["media", "line", "courses", "bead-courses", "places", "sides", "needle"] {
        let table_found = study.tables.iter().find(|table| table.key == key);
        assert!(table_found.is_some_and(|table| !table.rows.is_empty()), "{key}");
    }
}
