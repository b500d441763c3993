use super::*;
use crate::StudyError;
use crate::testing::insertions;
use crate::tradeoff::{Row, Table};

fn small(part: Part) -> InsertionOptions {
    InsertionOptions {
        nodes: 300,
        depth_mm: 12.0,
        bevel_depth_mm: 40.0,
        bevel_sweep: false,
        passes: 1,
        parts: vec![part],
    }
}

fn study_of(part: Part) -> Study {
    let mut shares = Vec::new();
    let study = study(&small(part), &mut |_, share| shares.push(share)).unwrap();
    assert!(shares.is_sorted() && shares.last() == Some(&1.0), "{shares:?}");
    let flagged = study.tables.iter().flat_map(|table| &table.rows);
    let flagged: Vec<&Row> = flagged.filter(|row| row.flag.is_some()).collect();
    assert!(flagged.is_empty(), "{flagged:?}");
    assert_eq!(study.plots().len(), study.figures.len(), "every figure has points");
    study
}

fn value(study: &Study, choices: &[&str], key: &str) -> Option<f64> {
    let table = &study.tables[0];
    let row = table.rows.iter().find(|row| row.choices == choices).unwrap();
    row.values[table.axis(key).unwrap()]
}

/// The exact condensed level agrees with level I (or its row would be flagged), and III is closer than IV.
#[test]
fn levels_differ_as_they_must() {
    let study = study_of(Part::Levels);
    let figure = |level: &str, key: &str| value(&study, &[level, "with"], key);
    assert_eq!(figure("I", "force_after_n"), None);
    assert!(figure("III", "tip_after_mm") < figure("IV", "tip_after_mm") && figure("IV", "tip_after_mm") > Some(1e-3));
    assert!(figure("exact condensed", "tip_after_mm") < Some(1e-3));
    for key in ["median_ms", "p95_ms", "p99_ms", "max_ms", "remesh_max_ms"] {
        assert!(figure("exact condensed", key) > Some(0.0), "{key}");
    }
    let spread = [
        "remesh_min_ms",
        "remesh_q1_ms",
        "remesh_median_ms",
        "remesh_q3_ms",
        "remesh_max_ms",
    ];
    let spread = spread.map(|key| figure("III", key).expect(key));
    assert!(spread.is_sorted() && spread[0] < spread[4], "{spread:?}");
    let remesh_table = study.tables.iter().find(|table| table.key == "levels-remesh").unwrap();
    let drawn = remesh_table.rows.iter().filter(|row| row.choices == ["III", "with"]);
    let drawn: Vec<_> = drawn.map(|row| row.values[1].unwrap()).collect();
    assert_eq!(drawn, spread);
    assert_eq!(study.tables[0].rows.len(), 8);
    assert!(!study.text().contains("tip_aside_mm") && !study.text().contains("Along the insertion"));
    assert!(study.tables[1].rows.len() > 8 * 100 && study.tables[1].csv().contains("tip_aside_mm"));
}

/// Deflection increases with r and with depth; without a bevel there is none (or rows would be flagged).
#[test]
fn bevels_deflect_in_proportion() {
    let study = study_of(Part::Bevel);
    let aside = |r: &str| value(&study, &["18", r, "10"], "deflection_mm").unwrap();
    assert!(aside("0").abs() < 0.05 && study.tables[0].rows.len() == 5);
    assert!(study.tables[1].csv().contains("measured: 10.4 mm"));
    assert!((aside("0.8") / aside("0.4") - 2.0).abs() < 0.2);
    assert!(value(&study, &["18", "0.8", "10"], "half_mm").unwrap() < 0.6 * aside("0.8"));
}

#[test]
fn masses_and_springs_are_set_against_finite_elements() {
    let study = study_of(Part::Masses);
    let springs = &["masses and springs", "no ratio to choose", "5.0"];
    let percent = value(&study, springs, "tissue_percent").unwrap();
    assert!((1.0..100.0).contains(&percent), "{percent} %");
    assert_eq!(
        value(&study, &["finite elements", "0.45", "5.0"], "tissue_percent"),
        None
    );
    assert!(value(&study, springs, "median_ms") > Some(0.0));
    assert!(
        study.notes[0].contains("masses and springs: a step takes"),
        "{:?}",
        study.notes
    );
}

/// Fewer candidates constrain less; without thinning nothing differs.
#[test]
fn thinning_is_a_trade() {
    let study = study_of(Part::Thinning);
    assert_eq!(value(&study, &["1"], "probe_percent"), None);
    assert!(value(&study, &["2"], "probe_percent") > Some(1.0));
    assert!(value(&study, &["2"], "candidates") < value(&study, &["1"], "candidates"));
}

/// Shorter links and beam elements converge to the finest, both with the same bending stiffness and end position.
#[test]
fn shorter_links_and_elements_come_nearer_and_bend_the_same() {
    let insertions = insertions();
    let beam = &pieces::ELEMENTS.table(&insertions.elements);
    let links = &pieces::LINKS.table(&insertions.links);
    let value = |table: &Table, length: &str, key: &str| {
        let row = table.rows.iter().find(|row| row.choices == [length]).unwrap();
        table.value(row, key)
    };
    let tip = |length: &str| value(links, length, "tip_mm").unwrap();
    assert!(
        tip("20") > 2.0 * tip("5") && tip("10") > 2.0 * tip("2.5"),
        "{}",
        links.text()
    );
    assert_eq!(value(links, "1.25", "tip_mm"), None);
    let tip = |length: &str| value(beam, length, "tip_mm").unwrap();
    assert!(tip("20") > tip("10") && tip("20") > tip("5"), "{}", beam.text());
    assert_eq!(value(beam, "2.5", "tip_mm"), None);
    let [a, b] = [beam, links].map(|table| value(table, "2.5", "deflection_mm").unwrap());
    assert!((a - b).abs() < 0.1 * b, "{a} mm of a beam, {b} mm of links");
    let mut rows = beam.rows.iter().chain(&links.rows);
    assert!(rows.all(|row| row.flag.is_none()), "{}{}", beam.text(), links.text());
}

/// Finer meshes converge to the finest, which is the only one not compared.
#[test]
fn finer_meshes_come_nearer() {
    let study = study_of(Part::Mesh);
    let table = &study.tables[0];
    let axis = table.axis("force_rms_n").unwrap();
    let errors: Vec<Option<f64>> = table.rows.iter().map(|row| row.values[axis]).collect();
    assert_eq!((errors.len(), errors[3], table.rows[3].gold), (4, None, true));
    assert!(errors[2] < errors[0] && errors[2] > Some(0.0), "{errors:?}");
}

#[test]
fn sizes_out_of_range_are_refused_with_what_is_expected() {
    type Spoil = fn(&mut InsertionOptions);
    let spoils: [(Spoil, &str); 6] = [
        (|options| options.nodes = 7, "100 to 100000"),
        (|options| options.depth_mm = 90.0, "10 to 80 mm"),
        (|options| options.depth_mm = f64::NAN, "10 to 80 mm"),
        (|options| options.bevel_depth_mm = 150.0, "10 to 140 mm"),
        (|options| options.passes = 0, "1 to 1000"),
        (|options| options.parts.clear(), "1 or more"),
    ];
    for (spoil, expected) in spoils {
        let mut options = small(Part::Bevel);
        spoil(&mut options);
        let refused = study(&options, &mut |_, _| {}).unwrap_err();
        assert!(refused.to_string().contains(expected), "{refused}");
    }
    let refused = levels::check_memory(30_000, Some(1 << 30)).unwrap_err();
    assert!(
        matches!(refused.downcast_ref(), Some(StudyError::Memory { what, .. }) if what.contains("30000")),
        "{refused}"
    );
    assert!(levels::check_memory(500, Some(1 << 30)).is_ok() && levels::check_memory(30_000, None).is_ok());
}
