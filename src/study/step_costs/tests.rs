use super::*;
use crate::testing::insertions;

fn option(value: &str, extra_ms: f64, error: f64) -> SettingOption {
    SettingOption {
        values: vec![value.to_owned()],
        extra_ms,
        error,
    }
}

/// Costs of a small block of 500 nodes whose steps take 0.2 ms, 0.3 with a probe; 1,500 and 3,500 nodes take 0.5 and
/// 2.5 ms more.
fn made_up() -> StepCosts {
    let setting = |key: &str, options: Vec<SettingOption>| VariedSetting {
        keys: vec![key.to_owned()],
        options,
    };
    let levels = setting(LEVEL, vec![option("\"exact\"", 0.0, 0.0), option("\"IV\"", -0.1, 0.2)]);
    let pieces = |key| setting(key, vec![option("20", -0.1, 0.1), option("10", 0.0, 0.01)]);
    StepCosts {
        few: 500,
        base_ms: [0.2, 0.3],
        levels: [levels.clone(), levels],
        nodes: setting(NODES, vec![option("1500", 0.5, 0.4), option("3500", 2.5, 0.0)]),
        links: pieces(LINK),
        elements: pieces(ELEMENT),
        thinning: setting(THINNING, vec![option("1", 0.0, 0.0), option("2", -0.1, 0.3)]),
    }
}

fn keys(costs: &Costs) -> Vec<String> {
    costs.settings.iter().map(|setting| setting.keys.join(",")).collect()
}

/// Stated nodes are interpolated linearly, open ones are a choice, and those of a file are reported as not counted.
#[test]
fn nodes_count_wherever_they_are_known() {
    let costs_at = |nodes| {
        made_up().in_situation(&Situation {
            nodes,
            ..Situation::default()
        })
    };
    for (nodes, extra_ms) in [
        (8, 0.0),
        (500, 0.0),
        (1000, 0.25),
        (1500, 0.5),
        (2500, 1.5),
        (4500, 3.5),
    ] {
        let costs = costs_at(Nodes::Stated(nodes));
        assert!((costs.base_ms - 0.2 - extra_ms).abs() < 1e-12, "{nodes}: {costs:?}");
        assert_eq!(keys(&costs), [LEVEL, LINK]);
        assert!(
            costs.measured.contains(&format!("at {nodes} nodes")),
            "{}",
            costs.measured
        );
    }
    let open = costs_at(Nodes::Open);
    assert_eq!(
        (open.base_ms, keys(&open)),
        (0.2, [LEVEL, LINK, NODES].map(str::to_owned).to_vec())
    );
    let unknown = costs_at(Nodes::Unknown);
    assert_eq!(
        (unknown.base_ms, keys(&unknown)),
        (0.2, [LEVEL, LINK].map(str::to_owned).to_vec())
    );
    assert!(
        unknown.measured.contains("a larger mesh takes longer"),
        "{}",
        unknown.measured
    );
}

#[test]
fn a_beam_has_elements_a_probe_has_candidates_and_no_piece_is_longer_than_the_needle() {
    let costs_of = |needle_mm| {
        made_up().in_situation(&Situation {
            probe: true,
            beam: true,
            needle_mm,
            nodes: Nodes::Unknown,
        })
    };
    let any_length = costs_of(None);
    assert_eq!(
        (any_length.base_ms, keys(&any_length)),
        (0.3, [LEVEL, ELEMENT, THINNING].map(str::to_owned).to_vec())
    );
    let lengths = |costs: &Costs| {
        costs.settings[1]
            .options
            .iter()
            .map(|option| option.values[0].clone())
            .collect::<Vec<_>>()
    };
    assert_eq!(lengths(&any_length), ["20", "10"]);
    assert_eq!(lengths(&costs_of(Some(15.0))), ["10"]);
    // A setting without options is no choice.
    assert_eq!(keys(&costs_of(Some(5.0))), [LEVEL, THINNING]);
}

/// Every setting has the options of its table, with times relative to the steps of the usual needle on the small block.
#[test]
fn studies_of_insertions_give_costs_of_every_key() {
    let insertions = insertions();
    let costs = StepCosts::of(insertions);
    assert!(
        (200..=300).contains(&costs.few) && costs.base_ms.iter().all(|ms| *ms > 0.0),
        "{costs:?}"
    );
    let levels: Vec<&str> = costs.levels[0]
        .options
        .iter()
        .map(|option| option.values[0].as_str())
        .collect();
    assert_eq!(levels, ["\"I\"", "\"III\"", "\"exact\""], "level IV is a baseline");
    for setting in costs.levels.iter().chain([&costs.links, &costs.thinning]) {
        assert!(setting.options.len() >= 3, "{setting:?}");
        let default_options = setting.options.iter().filter(|option| option.extra_ms == 0.0);
        assert_eq!(default_options.count(), 1, "{setting:?}");
    }
    for setting in [
        &costs.nodes,
        &costs.elements,
        &costs.links,
        &costs.thinning,
        &costs.levels[0],
    ] {
        assert!(
            setting.options.len() >= 3 && setting.options.iter().any(|option| option.error == 0.0),
            "{setting:?}"
        );
    }
    let extra = |setting: &VariedSetting, value: &str| {
        setting
            .options
            .iter()
            .find(|option| option.values == [value])
            .unwrap()
            .extra_ms
    };
    let remesh_ms = |times: &StepTimes| times.remesh_median_ms.unwrap();
    let level = |level| {
        let mut rows = insertions.levels.rows.iter();
        let row = rows.find(|row| row.level == level && !row.probe).unwrap();
        remesh_ms(&row.measured.times)
    };
    let piece = |rows: &[PieceRow], length_mm| {
        let row = rows.iter().find(|row| row.length_mm == length_mm).unwrap();
        remesh_ms(&row.times)
    };
    assert_eq!(extra(&costs.levels[0], "\"I\""), level(Level::I) - level(Level::Exact));
    let default_ms = piece(&insertions.links, 10.0);
    assert_eq!(costs.base_ms[0], default_ms);
    assert_eq!(
        extra(&costs.elements, "5"),
        piece(&insertions.elements, 5.0) - default_ms
    );
    let finest = insertions.meshes.last().unwrap();
    assert_eq!(
        extra(&costs.nodes, &finest.nodes.to_string()),
        remesh_ms(&finest.times) - default_ms
    );
}
