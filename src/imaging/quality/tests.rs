use super::cache::Cache;
use super::*;
use insonify_base::range::Ranges;
use insonify_tracking::probe::{Linear, Probe};

fn option(value: &str, extra_ms: f64, error: f64) -> SettingOption {
    SettingOption {
        values: vec![value.to_owned()],
        extra_ms,
        error,
    }
}

/// Links and thinning: 0.5 ms with the defaults.
fn costs() -> Costs {
    let setting = |key: &str, options: &[SettingOption]| VariedSetting {
        keys: vec![key.to_owned()],
        options: options.to_vec(),
    };
    Costs {
        measured: "made up".to_owned(),
        errors: Some("mm of made-up tissue".to_owned()),
        base_ms: 0.5,
        settings: vec![
            setting(
                "link",
                &[option("20", -0.2, 0.3), option("10", 0.0, 0.1), option("5", 0.8, 0.02)],
            ),
            setting("every", &[option("1", 0.0, 0.0), option("4", -0.2, 0.5)]),
        ],
    }
}

fn values(picked: &Picked) -> Vec<&str> {
    picked.settings.iter().map(|setting| setting.value.as_str()).collect()
}

#[test]
fn of_what_stays_within_the_time_the_least_wrong_is_picked() {
    for (budget, expected, ms, met) in [
        (2.0, ["5", "1"], 1.3, true),
        (1.0, ["10", "1"], 0.5, true),
        (0.4, ["20", "1"], 0.3, true),
        (0.2, ["20", "4"], 0.1, true),
        (0.05, ["20", "4"], 0.1, false),
    ] {
        let picked = pick("step_ms", &costs(), budget, |_| true).unwrap();
        assert_eq!((values(&picked), picked.met), (expected.to_vec(), met), "{budget}");
        assert!((picked.expected_ms - ms).abs() < 1e-12, "{budget}: {picked:?}");
        assert_eq!(pick("step_ms", &costs(), budget, |_| true).unwrap(), picked);
    }
}

#[test]
fn what_is_stated_is_not_touched_and_what_cannot_be_met_is_said_with_its_figure() {
    let picked = pick("step_ms", &costs(), 0.4, |key| key != "link").unwrap();
    assert_eq!(values(&picked), ["4"], "thinner candidates must do alone");
    assert_eq!((picked.value("every"), picked.value("link")), (Some("4"), None));
    assert_eq!(pick("step_ms", &costs(), 0.4, |_| false), None);
    let missed = pick("step_ms", &costs(), 0.05, |_| true).unwrap();
    assert!(
        missed
            .why
            .contains("nothing stays within 0.05 ms: this is the cheapest, 0.10 ms"),
        "{}",
        missed.why
    );
    let met = pick("step_ms", &costs(), 1.0, |_| true).unwrap();
    assert_eq!(
        met.why,
        "link = 10, every = 1: 0.50 of 1 ms, off by 0.10 mm of made-up tissue; the next better, link = 5, every = 1, \
         takes 1.30 ms (made up)"
    );
}

/// A real step takes three times as long as the costs predict, except with thin candidates, which save next to nothing
/// there.
#[test]
fn what_is_picked_is_tried_and_picked_again_where_it_takes_longer() {
    let truly = |picked: &Picked| {
        let own = [("20", 0.3), ("10", 0.5), ("5", 1.3)];
        let link = own
            .iter()
            .find(|(link, _)| picked.value("link") == Some(link))
            .unwrap()
            .1;
        3.0 * link - if picked.value("every") == Some("4") { 0.01 } else { 0.0 }
    };
    for (budget, expected, ms, trials) in [
        // 1.3 predicted, 3.9 measured; then 0.5 predicted, so 1.5, as measured; 3.9 has been tried already.
        (1.6, ["10", "1"], 1.5, 2),
        // Sufficient in any case, at the first try.
        (4.0, ["5", "1"], 3.9, 1),
        // Only thinner candidates are fast enough.
        (0.895, ["20", "4"], 0.89, 2),
        // No setting is: the fastest of those tried.
        (0.1, ["20", "4"], 0.89, 1),
    ] {
        let mut tried = 0;
        let picked = trial::pick_tried(
            "step_ms",
            &costs(),
            budget,
            |_| true,
            |picked| {
                tried += 1;
                Ok::<_, ()>(trial::Tried {
                    ms: truly(picked),
                    measured: "tried".to_owned(),
                })
            },
        );
        let picked = picked.unwrap().unwrap();
        assert_eq!(
            (values(&picked), tried),
            (expected.to_vec(), trials),
            "{budget}: {picked:?}"
        );
        assert!((picked.expected_ms - ms).abs() < 1e-12, "{budget}: {picked:?}");
        assert_eq!(picked.met, ms <= budget);
        assert!(picked.why.ends_with("(tried)"), "{}", picked.why);
    }
    let none = trial::pick_tried("step_ms", &costs(), 1.0, |_| false, |_| Err("nothing is tried"));
    assert_eq!(none, Ok(None));
    let failed = trial::pick_tried("step_ms", &costs(), 1.0, |_| true, |_| Err("as the thing fails"));
    assert_eq!(failed, Err("as the thing fails"));
}

/// A real step takes a tenth of what the costs predict: settings that seemed too slow are tried too.
#[test]
fn what_takes_less_than_was_said_is_picked_finer() {
    let picked = trial::pick_tried(
        "step_ms",
        &costs(),
        0.2,
        |_| true,
        |picked| {
            Ok::<_, ()>(trial::Tried {
                ms: match picked.value("link") {
                    Some("5") => 0.13,
                    Some("10") => 0.05,
                    _ => 0.01,
                },
                measured: String::new(),
            })
        },
    );
    let picked = picked.unwrap().unwrap();
    assert_eq!((values(&picked), picked.met), (vec!["5", "1"], true));
}

#[test]
fn grids_are_measured_until_one_takes_too_long() {
    let probe = Probe::new(Linear { width_mm: 40.0 }, 50.0).unwrap();
    let grids = grid::candidates(&probe, [true, true], [512, 512]);
    assert_eq!(
        grids,
        [[64, 128], [128, 256], [256, 512], [512, 1024]],
        "two samples a pixel suffice"
    );
    let mut tried = 0;
    let ms = |[lines, samples]: [u32; 2]| f64::from(lines * samples) / 8192.0;
    let costs = grid::measure(&grids, [true, true], 5.0, "made up".to_owned(), |grid| {
        tried += 1;
        Ok::<_, ()>(ms(grid))
    });
    // 1, 4, 16 ms: the third ends it.
    assert_eq!(tried, 3);
    let picked = pick("frame_ms", &costs.unwrap(), 5.0, |_| true).unwrap();
    assert_eq!(
        (picked.value("probe.lines"), picked.value("probe.samples")),
        (Some("128"), Some("256"))
    );
    // Stated values are kept, and only open ones have a key.
    let stated = grid::candidates(&probe, [false, true], [64, 64]);
    assert_eq!(stated, [[256, 128]], "the coarsest grid is always there");
    let costs = grid::measure(&stated, [false, true], 5.0, String::new(), |grid| Ok::<_, ()>(ms(grid)));
    assert_eq!(costs.unwrap().settings[0].keys, ["probe.samples"]);
}

#[test]
fn budgets_have_a_range() {
    let of = |frame_ms, step_ms| QualitySpec { frame_ms, step_ms }.out_of_range();
    assert_eq!(of(Some(16.0), Some(1.0)), None);
    assert_eq!(
        of(None, Some(0.0)),
        Some(("step_ms", 0.0, "0.01 to 10000 ms".to_owned()))
    );
    assert_eq!(
        of(Some(1e5), None),
        Some(("frame_ms", 1e5, "0.01 to 10000 ms".to_owned()))
    );
    assert!(of(Some(f64::NAN), None).is_some());
}

#[test]
fn costs_are_kept_by_what_was_measured() {
    let folder = tempfile::tempdir().unwrap();
    let cache = Cache::at(&folder.path().join("deeper"), "here");
    let get = |cache: &Cache, thing: &[&str]| {
        cache
            .get::<Costs>(thing, |costs| costs.base_ms > 0.0)
            .map_err(|bad| bad.to_string())
    };
    assert_eq!(get(&cache, &["steps"]), Ok(None));
    cache.put(&["steps"], &costs()).unwrap();
    assert_eq!(get(&cache, &["steps"]), Ok(Some(costs())));
    assert_eq!(get(&cache, &["step", "s"]), Ok(None));
    let there = Cache::at(&folder.path().join("deeper"), "there");
    assert_eq!(get(&there, &["steps"]), Ok(None), "another machine");
    let unsound = Costs {
        base_ms: -1.0,
        ..costs()
    };
    cache.put(&["steps"], &unsound).unwrap();
    assert!(get(&cache, &["steps"]).unwrap_err().contains("no measurement gives"));
    for file in std::fs::read_dir(folder.path().join("deeper")).unwrap() {
        let path = file.unwrap().path();
        std::fs::write(&path, "{").unwrap();
        assert!(
            get(&cache, &["steps"])
                .unwrap_err()
                .starts_with(&path.display().to_string())
        );
    }
}

#[test]
fn settings_of_a_file_are_finite_short_and_have_a_value_for_each_key() {
    let setting = |values: &[&str], extra_ms, copies| VariedSetting {
        keys: vec!["a".to_owned(), "b".to_owned()],
        options: vec![
            SettingOption {
                values: values.iter().map(|&value| value.to_owned()).collect(),
                extra_ms,
                error: 0.0,
            };
            copies
        ],
    };
    let sound = |setting: &VariedSetting| setting.is_sound(|key, value| (key == "a") == (value == "1"));
    assert!(sound(&setting(&["1", "2"], 0.0, 16)));
    assert!(!sound(&setting(&["1", "2"], 0.0, 17)), "too many to try all");
    assert!(!sound(&setting(&["1", "2"], f64::INFINITY, 1)));
    assert!(!sound(&setting(&["1"], 0.0, 1)));
    assert!(!sound(&setting(&["2", "2"], 0.0, 1)));
}
