use super::labels::rounding;
use super::picture;
use super::*;

fn frame(change: impl Fn(&mut insonify_imaging::synth::tables::Settings)) -> (Vec<u8>, Vec<bool>) {
    let (anatomy, mut settings, state) = insonify_imaging::anatomies::two_layers();
    settings.effects.noise = None;
    change(&mut settings);
    let mut synth = Synthesizer::new(anatomy, settings, Backend::Cpu).unwrap();
    let rendered = picture(&mut synth, &state, Duration::ZERO).unwrap();
    assert!(rendered.memory_mb > 0.0 && rendered.time.is_some_and(|time| time.frames == 3));
    (rendered.pixels, inside(&synth))
}

#[test]
fn a_level_that_is_brighter_as_a_whole_is_flagged_whatever_it_claims_to_be() {
    let (standard, inside) = frame(|_| {});
    let no_difference = Difference::of(&standard, &standard, &inside);
    assert_eq!(
        (no_difference, no_difference.offset(), rounding(&no_difference)),
        (Difference::default(), None, None)
    );
    // Deliberate mistake: 2 dB of unrequested gain.
    let (louder, _) = frame(|settings| {
        settings.effects.tone.get_or_insert_default().gain_db += 2.0;
    });
    let brighter = Difference::of(&standard, &louder, &inside);
    assert!(brighter.bias > 3.0, "{brighter:?}");
    for flag in [brighter.offset(), brighter.flag(None), rounding(&brighter)] {
        assert!(flag.is_some(), "{brighter:?}");
    }
    // Wording in the report.
    let rows = [Compared {
        variant: (),
        picture: Picture {
            pixels: louder,
            time: None,
            memory_mb: 0.0,
        },
        difference: brighter,
        flag: brighter.flag(None),
    }];
    let table = Table::of(
        "image_grid",
        "A grid",
        &[BACKEND.of(|_| "louder".to_owned())],
        &compared(),
        &rows,
    )
    .flagged(&rows, |row| row.flag.clone());
    assert!(table.text().contains("WRONG: +"), "{}", table.text());
    assert_eq!(table.best(), [false]);
}

#[test]
fn a_refinement_that_is_further_off_than_the_level_before_it_is_flagged() {
    let difference = |rms| Difference {
        rms,
        p99: 3.0 * rms,
        bias: 0.0,
    };
    assert_eq!(difference(2.0).flag(Some(&difference(4.0))), None);
    assert_eq!(difference(4.1).flag(Some(&difference(4.0))), None);
    assert!(
        difference(6.0)
            .flag(Some(&difference(4.0)))
            .is_some_and(|flag| flag.contains("coarser"))
    );
}

#[test]
fn errors_are_those_of_the_pixels_inside() {
    let apart = Difference::of(&[10, 20, 30, 40], &[11, 18, 30, 255], &[true, true, true, false]);
    assert_eq!(
        (apart.rms, apart.p99, apart.bias),
        ((5.0f64 / 3.0).sqrt(), 2.0, -1.0 / 3.0)
    );
}

#[test]
fn every_table_is_filled_and_nothing_in_it_is_wrong() {
    let options = ImageOptions {
        grids: vec![[48, 96], [96, 192], [192, 384]],
        voxel_mm: 4.0,
        coarsen: 4,
        nodes: vec![200],
        moving_nodes: vec![4000, 1000],
        points: 60,
        patience: Duration::ZERO,
        gpus: Vec::new(),
    };
    let mut reached = 0.0;
    let study = study(&options, &mut |_, share| {
        assert!(share >= reached);
        reached = share;
    })
    .unwrap();
    assert_eq!(reached, 1.0);
    let rows: Vec<(&str, usize)> = study.tables.iter().map(|table| (table.key, table.rows.len())).collect();
    let expected = [
        ("image_grid", 4),
        ("image_backend", 4),
        ("image_labels", 12),
        ("image_effects", 22),
        ("image_sampling", 15),
        ("image_texture", 2),
        ("image_lookup", 6),
        ("image_grain", 3),
        ("image_looks", 8),
        ("image_waves", 9),
        ("image_body", 2),
        ("image_location", 3),
    ];
    assert_eq!(rows, expected);
    for table in &study.tables {
        assert!(
            table.rows.iter().all(|row| row.flag.is_none()),
            "{}\n{}",
            table.title,
            table.text()
        );
    }
    // The standard is finer than every grid, so that even the finest grid has an error.
    let grids = &study.tables[0];
    let structure = grids.rows.iter().filter(|row| row.choices[0] == "structure");
    let rms_grey: Vec<Option<f64>> = structure.map(|row| grids.value(row, "rms_grey")).collect();
    assert!(
        rms_grey.len() == 2 && rms_grey.iter().all(|rms| rms.is_some_and(|rms| rms > 1.0)),
        "{rms_grey:?}"
    );
    // With all effects, only rounding errors remain; without one of them, the error is larger.
    let effects = study.tables.iter().find(|table| table.key == "image_effects").unwrap();
    let rms_grey = |row| effects.value(row, "rms_grey").unwrap();
    assert!(rms_grey(&effects.rows[0]) < 0.5);
    for effect in ["texture", "interface", "speckle", "shadow", "haze", "automatic gain"] {
        let row = effects
            .rows
            .iter()
            .find(|row| row.choices[0] == format!("without {effect}"));
        assert!(rms_grey(row.unwrap()) > 0.5, "{effect}: {}", rms_grey(row.unwrap()));
    }
    // Trilinear look-up has rounding errors only; the nearest voxel misses the variation between voxels.
    let lookups = study.tables.iter().find(|table| table.key == "image_lookup").unwrap();
    for pair in lookups.rows.chunks(2) {
        let [nearest, trilinear] = [0, 1].map(|row| lookups.value(&pair[row], "rms_db").unwrap());
        assert!(nearest > 0.1 && trilinear < 1e-2, "{nearest} {trilinear}");
    }
    assert_eq!(study.plots().len(), 4);
    assert!(study.text().contains("no GPU adapter"));
    let too_few = ImageOptions {
        grids: vec![[8, 8]],
        ..options
    };
    let error = super::study(&too_few, &mut |_, _| {}).unwrap_err().to_string();
    assert!(error.starts_with("1 grids: expected two or more"), "{error}");
}
