use super::*;
use crate::bench::tests::removable;
use insonify_imaging::anatomies::two_layers as scene;

fn options() -> CompareOptions {
    CompareOptions {
        grids: vec![[16, 32], [32, 64]],
        effects_grid: [32, 64],
        patience: Duration::ZERO,
        most_ms: 1e6,
        nodes: vec![150],
        updates: 4,
        gpus: Vec::new(),
    }
}

#[test]
fn without_a_gpu_the_part_of_the_cpu_is_there_and_says_so() {
    let (anatomy, settings, state) = scene();
    let subject = Subject {
        anatomy: &anatomy,
        settings: &settings,
        state: &state,
    };
    let mut last = 0.0;
    let study = compare(&subject, &options(), &mut |_, share| {
        assert!(share >= last);
        last = share;
    })
    .unwrap();
    assert_eq!(last, 1.0);
    assert!(study.text().contains("no GPU adapter"));
    let table = |key: &str| study.tables.iter().find(|table| table.key == key).unwrap();
    let passes = table("compare_passes");
    assert!(passes.rows.iter().any(|row| row.choices[1] == "speckle_scatter"));
    assert!(
        passes
            .rows
            .iter()
            .all(|row| row.values[1].is_some() && row.values[2].is_none())
    );
    assert!(table("compare_crossing").rows.is_empty());
    assert_eq!(table("compare_solvers").rows[0].choices[0], "none");
    assert!(study.tables.iter().all(|table| table.key != "compare_transfers"));
    let effects: Vec<&str> = table("compare_effects")
        .rows
        .iter()
        .map(|row| row.choices[1].as_str())
        .collect();
    let expected = removable(&anatomy, &settings);
    assert_eq!(effects[1..effects.len() - 1], expected[..]);
    let rows = &table("compare_effects").rows;
    let measured = |values: &[Option<f64>]| values.iter().map(Option::is_some).collect::<Vec<_>>();
    assert!(
        rows[1..rows.len() - 1]
            .iter()
            .all(|row| !measured(&row.values).contains(&false))
    );
    assert_eq!(
        measured(&rows[0].values),
        [true, true, false, false, false, false, false, true, false],
        "everything has nothing to be compared with"
    );
    // Saved and added times are differences of two neighbouring columns.
    for row in &rows[1..rows.len() - 1] {
        let [without, whole, saved, alone, bare, adds] = [0, 2, 3, 4, 5, 6].map(|column| row.values[column].unwrap());
        assert_eq!([whole - without, alone - bare], [saved, adds], "{row:?}");
    }
    let page = study.page().unwrap();
    for words in ["<h1>GPU against CPU</h1>", "with less without", "<svg"] {
        assert!(page.contains(words), "{words}");
    }
    let memory = table("compare_memory");
    assert_eq!(
        memory.rows.len(),
        expected.len() - 1,
        "all but tone, which is linear without a curve"
    );
    assert!(memory.rows.iter().all(|row| row.flag.is_none()), "{}", memory.text());
    let speckle = memory.rows.iter().find(|row| row.choices[1] == "speckle").unwrap();
    assert!(
        speckle.values[0] > Some(1000.0) && speckle.values[2] == Some(0.0),
        "{speckle:?}"
    );
}

#[test]
fn the_gpu_wins_from_where_it_stays_ahead() {
    let mut rows = Vec::new();
    let mut push = |what: &str, ratios: [Option<f64>; 4]| {
        rows.extend(["a", "b", "c", "d"].iter().zip(ratios).map(|(size, ratio)| Compared {
            gpu: "g".to_owned(),
            what: what.to_owned(),
            size: (*size).to_owned(),
            cpu_ms: ratio,
            gpu_ms: Some(1.0),
            beside: (),
        }));
    };
    push("always", [Some(2.0), Some(3.0), Some(4.0), Some(5.0)]);
    push("at last", [Some(1.5), Some(0.9), Some(1.1), Some(2.0)]);
    push("never", [Some(0.1), Some(0.5), Some(0.9), None]);
    push("unknown", [None; 4]);
    let found = crossing(&ratios(&rows).collect::<Vec<_>>());
    let wins: Vec<&str> = found.rows.iter().map(|row| row.choices[2].as_str()).collect();
    assert_eq!(wins, ["from the smallest, a", "from c", "never up to c"]);
    assert_eq!(found.rows[2].values, [Some(0.1), Some(0.9)]);
}
