use dicom_core::value::DataSetSequence;
use dicom_core::{DataElement, PrimitiveValue, VR};
use dicom_object::FileMetaTableBuilder;

use super::*;

fn put(object: &mut InMemDicomObject, tag: Tag, vr: VR, value: impl Into<PrimitiveValue>) {
    object.put(DataElement::new(tag, vr, value.into()));
}

fn sequence(object: &mut InMemDicomObject, tag: Tag, items: Vec<InMemDicomObject>) {
    object.put(DataElement::new(tag, VR::SQ, DataSetSequence::from(items)));
}

fn item(tag: Tag, vr: VR, value: impl Into<PrimitiveValue>) -> InMemDicomObject {
    let mut item = InMemDicomObject::new_empty();
    put(&mut item, tag, vr, value);
    item
}

fn within(sequence_tag: Tag, inner: InMemDicomObject) -> InMemDicomObject {
    let mut outer = InMemDicomObject::new_empty();
    sequence(&mut outer, sequence_tag, vec![inner]);
    outer
}

/// A segmentation of 4 columns by 2 rows: frames with segment, position and pixels.
fn file(frames: &[(u16, &str, u8)], change: impl Fn(&mut InMemDicomObject)) -> Vec<u8> {
    let mut object = InMemDicomObject::new_empty();
    put(&mut object, tags::SOP_CLASS_UID, VR::UI, "1.2.840.10008.5.1.4.1.1.66.4");
    for (tag, number) in [(tags::ROWS, 2_u16), (tags::COLUMNS, 4), (tags::BITS_ALLOCATED, 1)] {
        put(&mut object, tag, VR::US, number);
    }
    put(&mut object, tags::NUMBER_OF_FRAMES, VR::IS, frames.len().to_string());
    let segments = [(1_u16, "Liver"), (2, "Segment_2")].map(|(number, label)| {
        let mut kind = item(tags::CODE_MEANING, VR::LO, "Kidney");
        sequence(
            &mut kind,
            tags::SEGMENTED_PROPERTY_TYPE_MODIFIER_CODE_SEQUENCE,
            vec![item(tags::CODE_MEANING, VR::LO, "Right")],
        );
        let mut segment = within(tags::SEGMENTED_PROPERTY_TYPE_CODE_SEQUENCE, kind);
        put(&mut segment, tags::SEGMENT_NUMBER, VR::US, number);
        put(&mut segment, tags::SEGMENT_LABEL, VR::LO, label);
        segment
    });
    sequence(&mut object, tags::SEGMENT_SEQUENCE, segments.to_vec());
    let mut shared = within(
        tags::PLANE_ORIENTATION_SEQUENCE,
        item(tags::IMAGE_ORIENTATION_PATIENT, VR::DS, "0\\1\\0\\1\\0\\0"),
    );
    let mut measures = item(tags::PIXEL_SPACING, VR::DS, "2\\3");
    put(&mut measures, tags::SLICE_THICKNESS, VR::DS, "9");
    sequence(&mut shared, tags::PIXEL_MEASURES_SEQUENCE, vec![measures]);
    sequence(&mut object, tags::SHARED_FUNCTIONAL_GROUPS_SEQUENCE, vec![shared]);
    let groups = frames.iter().map(|(segment, position, _)| {
        let mut group = within(
            tags::SEGMENT_IDENTIFICATION_SEQUENCE,
            item(tags::REFERENCED_SEGMENT_NUMBER, VR::US, *segment),
        );
        let place = item(tags::IMAGE_POSITION_PATIENT, VR::DS, *position);
        sequence(&mut group, tags::PLANE_POSITION_SEQUENCE, vec![place]);
        group
    });
    sequence(
        &mut object,
        tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE,
        groups.collect(),
    );
    let mut pixels: Vec<u8> = frames.iter().map(|frame| frame.2).collect();
    pixels.resize(pixels.len().next_multiple_of(2), 0);
    put(&mut object, tags::PIXEL_DATA, VR::OB, pixels);
    change(&mut object);
    let meta = FileMetaTableBuilder::new()
        .transfer_syntax("1.2.840.10008.1.2.1")
        .media_storage_sop_class_uid("1.2.840.10008.5.1.4.1.1.66.4")
        .media_storage_sop_instance_uid("2.25.1");
    let mut bytes = Vec::new();
    let object = object.with_meta(meta).expect("a meta table");
    object.write_all(&mut bytes).expect("memory");
    bytes
}

fn loaded(bytes: &[u8]) -> Result<Loaded, VolumeError> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("seg.dcm");
    std::fs::write(&path, bytes).expect("a file");
    crate::volume::load(&path)
}

/// Slices of 4 mm from z 10 on, in no order, the third one left out as it has no labels.
const FRAMES: [(u16, &str, u8); 4] = [
    (2, "1\\2\\-22", 0b0000_0011),
    (1, "1\\2\\-10", 0b1000_0001),
    (1, "1\\2\\-14", 0b0001_0000),
    (2, "1\\2\\-10", 0b0000_0001),
];

#[test]
fn segments_are_labels_at_the_place_of_their_frames() {
    let volume = loaded(&file(&FRAMES, |_| ())).unwrap();
    let warnings = volume.warnings;
    let volume = volume.volume;
    assert_eq!(volume.size(), [4, 2, 4]);
    // Rows run along y and columns along x: the normal is -z.
    let world = volume.index_to_world();
    assert_eq!(world.column(0).xyz(), Vector3::new(0.0, 3.0, 0.0));
    assert_eq!(world.column(1).xyz(), Vector3::new(2.0, 0.0, 0.0));
    assert_eq!(world.column(2).xyz(), Vector3::new(0.0, 0.0, -4.0));
    assert_eq!(world.column(3).xyz(), Vector3::new(1.0, 2.0, -10.0));
    let labels: Vec<_> = volume.labels()[1..]
        .iter()
        .map(|label| (label.value, label.name.as_deref(), label.voxels))
        .collect();
    assert_eq!(labels, [(1, Some("Liver"), 2), (2, Some("Right Kidney"), 3)]);
    // Both segments have three voxels: of equals the later one is drawn where they meet.
    let marked: Vec<_> = volume
        .voxels()
        .iter()
        .enumerate()
        .filter(|(_, label)| **label > 0)
        .map(|(voxel, label)| (voxel, *label))
        .collect();
    assert_eq!(marked, [(0, 2), (7, 1), (12, 1), (24, 2), (25, 2)]);
    assert_eq!(
        warnings,
        [
            "masks overlap, and a body lies below organs, a larger one below a smaller one: Liver: 33 % covered by Right Kidney"
        ]
    );
}

#[test]
fn probabilities_of_one_half_are_segments() {
    let bytes = file(&[(1, "0\\0\\0", 0)], |object| {
        put(object, tags::BITS_ALLOCATED, VR::US, 8_u16);
        put(object, tags::MAXIMUM_FRACTIONAL_VALUE, VR::US, 100_u16);
        put(object, tags::PIXEL_DATA, VR::OB, vec![0_u8, 49, 50, 100, 0, 0, 0, 0]);
    });
    let loaded = loaded(&bytes).unwrap();
    assert_eq!(loaded.volume.voxels(), [0, 0, 1, 1, 0, 0, 0, 0]);
    assert_eq!(
        loaded.volume.spacing_mm(),
        [3.0, 2.0, 9.0],
        "one slice is as thick as the file says"
    );
    assert!(loaded.notes[0].contains("one half"), "{:?}", loaded.notes);
}

#[test]
fn numbers_of_segments_are_labels() {
    let map = |bits: u16, numbers: PrimitiveValue| {
        let bytes = file(&[(1, "0\\0\\0", 0)], |object| {
            put(object, tags::SOP_CLASS_UID, VR::UI, "1.2.840.10008.5.1.4.1.1.66.7");
            put(object, tags::SEGMENTATION_TYPE, VR::CS, "LABELMAP");
            put(object, tags::BITS_ALLOCATED, VR::US, bits);
            let mut group = InMemDicomObject::new_empty();
            let place = item(tags::IMAGE_POSITION_PATIENT, VR::DS, "0\\0\\0");
            sequence(&mut group, tags::PLANE_POSITION_SEQUENCE, vec![place]);
            sequence(object, tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE, vec![group]);
            put(
                object,
                tags::PIXEL_DATA,
                if bits == 8 { VR::OB } else { VR::OW },
                numbers.clone(),
            );
        });
        loaded(&bytes).unwrap().volume
    };
    for volume in [
        map(8, vec![0_u8, 1, 2, 2, 5, 0, 0, 1].into()),
        map(
            16,
            PrimitiveValue::U16([0_u16, 1, 2, 2, 5, 0, 0, 1].into_iter().collect()),
        ),
    ] {
        assert_eq!(volume.voxels(), [0, 1, 2, 2, 3, 0, 0, 1]);
        let labels: Vec<_> = volume.labels()[1..]
            .iter()
            .map(|label| (label.value, label.name.as_deref()))
            .collect();
        assert_eq!(labels, [(1, Some("Liver")), (2, Some("Right Kidney")), (5, None)]);
    }
}

#[test]
fn what_is_not_stated_or_does_not_fit_is_refused() {
    let refused = |bytes: &[u8]| loaded(bytes).map(drop).expect_err("refused").to_string();
    for (expected, change) in [
        (
            "no PerFrameFunctionalGroupsSequence",
            tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE,
        ),
        ("no ImageOrientationPatient", tags::SHARED_FUNCTIONAL_GROUPS_SEQUENCE),
        ("no Rows", tags::ROWS),
        ("a file without pixels", tags::PIXEL_DATA),
        ("pixels of 0 bits", tags::BITS_ALLOCATED),
    ] {
        let message = refused(&file(&FRAMES, |object| {
            object.remove_element(change);
        }));
        assert!(message.contains(expected), "{message}");
        if expected.starts_with("no ") {
            assert!(
                message.contains("export it anew, with the image that it was drawn on"),
                "{message}"
            );
        }
    }
    let uneven = [(1, "0\\0\\0", 1), (1, "0\\0\\4", 1), (1, "0\\0\\9.5", 1)];
    assert!(refused(&file(&uneven, |_| ())).contains("slices at uneven distances"));
    let bent = [(1, "0\\0\\0", 1), (1, "1\\0\\4", 1), (1, "0\\0\\8", 1)];
    assert!(refused(&file(&bent, |_| ())).contains("slices at uneven distances"));
    let far = [(1, "0\\0\\0", 1), (1, "0\\0\\1", 1), (1, "0\\0\\1e9", 1)];
    assert!(refused(&file(&far, |_| ())).contains("slices at uneven distances"));
    let short = file(&FRAMES, |object| put(object, tags::PIXEL_DATA, VR::OB, vec![0_u8; 2]));
    assert!(refused(&short).contains("2 bytes of pixels where 4 are needed"));
    let cut = file(&FRAMES, |_| ());
    assert!(refused(&cut[..cut.len() / 2]).contains("seg.dcm"));
}

#[test]
fn damaged_files_are_refused_or_read_but_never_a_panic() {
    let sound = file(&FRAMES, |_| ());
    parse(Path::new("seg.dcm"), &sound).unwrap();
    for byte in 132..sound.len() {
        for value in [0, 1, 0x7f, 0xff] {
            let mut damaged = sound.clone();
            damaged[byte] = value;
            let _ = parse(Path::new("seg.dcm"), &damaged);
        }
    }
}

#[test]
fn a_code_names_a_segment_whose_label_is_the_name_of_no_tissue() {
    let named = |label: &str| {
        let bytes = file(&FRAMES, |object| {
            let mut segments = items(object, tags::SEGMENT_SEQUENCE).to_vec();
            put(&mut segments[0], tags::SEGMENT_LABEL, VR::LO, label);
            sequence(object, tags::SEGMENT_SEQUENCE, segments);
        });
        loaded(&bytes).unwrap().volume.labels()[1].name.clone()
    };
    assert_eq!(named("Niere links").as_deref(), Some("Right Kidney"));
    // Near miss: a name that is known.
    assert_eq!(named("spleen").as_deref(), Some("spleen"));
}
