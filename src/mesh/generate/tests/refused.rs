//! Rejected input and its error messages.

use super::*;

fn block() -> Volume {
    Volume::new([6, 5, 4], [1.0; 3], |at| 1 + u8::from(at[0] > 3.0))
}

fn refused(change: impl FnOnce(&mut Volume), nodes: usize) -> GenerateError {
    let mut volume = block();
    change(&mut volume);
    volume.generate(nodes).expect_err("refused")
}

#[test]
fn parts_that_do_not_fit_are_named() {
    let size = [6, 5, 4];
    let short = refused(|volume| volume.labels.truncate(119), 100);
    assert_eq!(short, GenerateError::Size { size, found: 119 });
    let huge = refused(|volume| volume.size = [usize::MAX, 2, 2], 100);
    assert!(matches!(huge, GenerateError::Size { found: 120, .. }));
    let empty = refused(
        |volume| {
            volume.size = [0, 5, 4];
            volume.labels.clear();
        },
        100,
    );
    assert!(matches!(empty, GenerateError::Size { found: 0, .. }));

    for bad in [0.0, f64::NAN, f64::INFINITY] {
        let singular = refused(|volume| volume.index_to_world[(1, 1)] = bad, 100);
        assert_eq!(singular, GenerateError::Transform, "{bad}");
        let nowhere = refused(
            |volume| volume.index_to_world[(2, 3)] = if bad == 0.0 { f64::NAN } else { bad },
            100,
        );
        assert_eq!(nowhere, GenerateError::Transform, "{bad}");
    }

    assert_eq!(refused(|volume| volume.regions.clear(), 100), GenerateError::NoLabel);
    let missing = refused(|volume| volume.regions.push((9, 90)), 100);
    let expected = GenerateError::NoVoxels {
        label: 9,
        region: 90,
        present: vec![1, 2],
    };
    assert_eq!(missing, expected);
    assert_eq!(
        missing.to_string(),
        "label 9 (region 90) has no voxel; the volume holds the labels [1, 2]"
    );
    let twice = refused(|volume| volume.regions.push((1, 3)), 100);
    assert_eq!(twice, GenerateError::RepeatedLabel { label: 1 });
    let all = refused(
        |volume| volume.regions = (0..=255).map(|label| (label, i32::from(label))).collect(),
        100,
    );
    assert_eq!(all, GenerateError::TooManyRegions);
}

#[test]
fn options_out_of_range_are_named() {
    let volume = block();
    let with = |options: GenerateOptions| generate(&volume.grid(), 100, &options, |_| {}).expect_err("refused");
    for bad in [-1.0, 30.5, f64::NAN, f64::INFINITY] {
        let options = GenerateOptions {
            min_dihedral_deg: bad,
            ..GenerateOptions::default()
        };
        let words = with(options).to_string();
        assert!(
            words.contains("min_dihedral_deg") && words.contains("0 to 30 degrees"),
            "{words}"
        );
    }
    for bad in [0.0, -2.0, f64::NAN] {
        let options = GenerateOptions {
            max_edge_mm: Some(bad),
            ..GenerateOptions::default()
        };
        let words = with(options).to_string();
        assert!(words.contains("max_edge_mm") && words.contains("positive"), "{words}");
    }
}

#[test]
fn budgets_out_of_range_say_what_would_do() {
    let nodes = MAX_NODES + 1;
    assert_eq!(refused(|_| {}, nodes), GenerateError::TooManyNodes { nodes });
    for nodes in [0, 1, 3, 7] {
        let GenerateError::TooFewNodes { nodes: found, least } = refused(|_| {}, nodes) else {
            panic!("{nodes} nodes make no block")
        };
        assert_eq!(found, nodes);
        assert!(least > nodes);
        block().mesh(least);
    }
}
