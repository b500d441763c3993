use super::*;

fn label(value: i64, name: Option<&str>) -> Label {
    Label {
        value,
        name: name.map(str::to_owned),
        voxels: 1,
    }
}

fn nameless(values: &[i64]) -> Vec<Label> {
    std::iter::once(&0)
        .chain(values)
        .map(|&value| label(value, None))
        .collect()
}

fn named(names: &[&str]) -> Vec<Label> {
    let first = label(0, None);
    std::iter::once(first)
        .chain(names.iter().zip(1..).map(|(name, value)| label(value, Some(name))))
        .collect()
}

fn resolved(labels: &[Label], overrides: &[TissueOverride], hint: Preset) -> (Vec<String>, Vec<String>) {
    let (table, warnings) = TissueTable::resolve(labels, overrides, hint).unwrap();
    let names = (1..labels.len())
        .map(|index| table.tissue(index as u8).name.to_string())
        .collect();
    assert_eq!(table.of_label.len(), labels.len());
    (names, warnings)
}

#[test]
fn names_find_tissues_classes_and_words() {
    let cases = [
        ("liver", "liver"),
        ("kidney_medulla", "kidney_medulla"),
        ("kidney_right", "kidney_cortex"),
        ("Right kidney", "kidney_cortex"),
        ("right lung", "lung"),
        ("lung_upper_lobe_left", "lung"),
        ("Portal vein and splenic vein", "vessel"),
        ("ribs", "bone"),
        ("rib_left_4", "bone"),
        ("cervical vertebral column", "bone"),
        ("vertebrae_L5", "bone"),
        ("Hepatic artery", "vessel"),
        ("Urinary Bladder", "urine"),
        ("left kidney cyst", "cyst"),
        ("spinal_cord", "nerve"),
        ("gastrocnemius muscle", "muscle"),
        ("subcutaneous fat tissue", "fat"),
        ("tissue", "soft_tissue"),
        ("Gall bladder", "bile"),
        ("Postcava", "vessel"),
        ("Kidney_R", "kidney_cortex"),
        ("Rt. adrenal gland", "adrenal"),
    ];
    let labels = named(&cases.map(|(name, _)| name));
    let (tissues, warnings) = resolved(&labels, &[], Preset::Auto);
    assert_eq!(tissues, cases.map(|(_, tissue)| tissue.to_owned()));
    assert!(warnings.is_empty(), "{warnings:?}");
}

#[test]
fn every_class_finds_its_tissue_by_name() {
    for class in numbering::all() {
        assert_eq!(
            by_name(&class.name, Preset::Auto, true),
            Some(class.tissue),
            "{class:?}"
        );
    }
    for tissue in presets::all() {
        assert_eq!(plain(&tissue.name), tissue.name);
    }
}

#[test]
fn labels_without_names_are_soft_tissue_and_questioned() {
    let (tissues, warnings) = resolved(&nameless(&[5, 150]), &[], Preset::Auto);
    assert_eq!(tissues, ["soft_tissue", "soft_tissue"]);
    assert_eq!(warnings.len(), 1);
    assert!(
        warnings[0].contains("labels 5, 150;") && warnings[0].contains("--names") && warnings[0].contains("labels ="),
        "{warnings:?}"
    );
}

#[test]
fn hints_narrow_the_rules() {
    let labels = named(&["liver", "right lung"]);
    assert_eq!(resolved(&labels, &[], Preset::Phantom).0, ["liver", "soft_tissue"]);
    let (tissues, warnings) = resolved(&labels, &[], Preset::None);
    assert_eq!(tissues, ["soft_tissue", "soft_tissue"]);
    assert!(
        warnings[0].contains("1 (\"liver\"), 2 (\"right lung\")"),
        "{warnings:?}"
    );
    let appended = Label {
        voxels: 0,
        ..label(204, Some("skin"))
    };
    for (hint, count) in [(Preset::None, 1), (Preset::Phantom, 0)] {
        let labels = [label(0, None), label(5, Some("liver")), appended.clone()];
        let (tissues, warnings) = resolved(&labels, &[], hint);
        assert_eq!((tissues[1].as_str(), warnings.len()), ("skin", count), "{warnings:?}");
        assert!(warnings.iter().all(|warning| warning.contains("label 5 (\"liver\");")));
    }
}

#[test]
fn overrides_claim_by_value_and_name_and_change_presets_everywhere() {
    let overrides = [
        TissueOverride {
            name: "tumour".into(),
            like: Some("lesion".into()),
            labels: vec![1, 99],
            label_names: vec!["Right Lung".into()],
            ..TissueOverride::default()
        },
        TissueOverride {
            name: "bone".into(),
            echogenicity_db: Some(30.0),
            ..TissueOverride::default()
        },
    ];
    let labels = named(&["liver", "right_lung", "rib_left_2", "spleen"]);
    let (table, warnings) = TissueTable::resolve(&labels, &overrides, Preset::Auto).unwrap();
    assert_eq!(table.tissue(1).name, "tumour");
    assert_eq!(table.tissue(2).name, "tumour");
    assert_eq!(table.tissue(3).echogenicity_db, 30.0);
    assert_eq!(table.tissue(4).name, "spleen");
    assert_eq!(table.tissue(0).name, "background");
    assert_eq!(table.tissues.len(), 4);
    assert!(
        warnings.len() == 1 && warnings[0].contains("no label 99"),
        "{warnings:?}"
    );
}

#[test]
fn contradictions_are_errors() {
    let claim = |name: &str| TissueOverride {
        name: name.into(),
        labels: vec![1],
        ..TissueOverride::default()
    };
    let labels = nameless(&[1]);
    let resolve = |overrides: &[TissueOverride]| TissueTable::resolve(&labels, overrides, Preset::Auto).unwrap_err();
    assert!(matches!(
        resolve(&[claim("a"), claim("b")]),
        TissueError::ClaimedTwice { .. }
    ));
    assert_eq!(resolve(&[claim("a"), claim("a")]), TissueError::Duplicate("a".into()));
    assert_eq!(resolve(&[claim(" ")]), TissueError::Unnamed { position: 1 });
}

#[test]
fn a_background_can_be_claimed_and_a_missing_index_is_background() {
    let bath = TissueOverride {
        name: "bath".into(),
        like: Some("gel".into()),
        labels: vec![0],
        ..TissueOverride::default()
    };
    let (table, _) = TissueTable::resolve(&nameless(&[5]), &[bath], Preset::Auto).unwrap();
    assert_eq!(table.tissue(0).name, "bath");
    assert_eq!(table.tissue(200).name, "bath");
}
