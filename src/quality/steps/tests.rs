use super::*;

/// Every dial has the rungs of its table, and one of them costs nothing extra.
#[test]
fn a_study_of_insertions_gives_costs_of_every_key() {
    let options = InsertionOptions {
        nodes: 300,
        depth_mm: 10.0,
        passes: 1,
        parts: vec![Part::Levels, Part::Thinning, Part::Links],
        ..InsertionOptions::default()
    };
    let study = study(&options, &mut |_, _| {}).unwrap();
    let [free, pressed] = costs(&study);
    let keys = |costs: &Costs| costs.dials.iter().map(|dial| dial.keys.join(",")).collect::<Vec<_>>();
    assert_eq!(keys(&free), [LEVEL, LINK]);
    assert_eq!(keys(&pressed), [LEVEL, LINK, THINNING]);
    for costs in [&free, &pressed] {
        assert!(
            costs.base_ms > 0.0 && costs.measured.contains("nodes"),
            "{}",
            costs.measured
        );
        for dial in &costs.dials {
            assert!(dial.rungs.len() >= 4, "{dial:?}");
            assert_eq!(
                dial.rungs.iter().filter(|rung| rung.extra_ms == 0.0).count(),
                1,
                "{dial:?}"
            );
            assert!(dial.rungs.iter().any(|rung| rung.error == 0.0), "{dial:?}");
        }
    }
    // A level costs what its steps take that remesh, beyond those of the exact one.
    let levels = study.tables.iter().find(|table| table.key == "levels").unwrap();
    let of = |name: &str| {
        let row = levels.rows.iter().find(|row| row.choices == [name, "without"]).unwrap();
        levels.value(row, "remesh_median_ms").unwrap()
    };
    let mut rungs = free.dials[0].rungs.iter();
    assert!(rungs.clone().any(|rung| rung.values == ["\"exact\""]));
    let first = rungs.find(|rung| rung.values == ["\"I\""]).unwrap();
    assert_eq!(first.extra_ms, of("I") - of("exact condensed"));
}
