//! Bodies, and backgrounds that are not 0.

use super::*;
use crate::volume::complete::{CompleteOptions, complete};

#[test]
fn a_single_label_as_large_as_a_body_is_a_body() {
    let filled = |size: [usize; 3], value: i64, inside: &dyn Fn([usize; 3]) -> bool| {
        let place = |offset: usize| [offset % size[0], offset / size[0] % size[1], offset / size[0] / size[1]];
        let voxels: Vec<u8> = (0..size.iter().product())
            .map(|offset| u8::from(inside(place(offset))))
            .collect();
        let count = voxels.iter().filter(|voxel| **voxel > 0).count();
        named("mask.nii", &volume(size, voxels, &[(value, count)], 10.0))
    };
    let round = |radius: f64| move |[x, y, _]: [usize; 3]| (x as f64 - 20.0).hypot(y as f64 - 15.0) < radius;
    for value in [1, 5, 255] {
        let body = filled([40, 30, 20], value, &round(14.0));
        assert_eq!(names(&body), [(value, "body")]);
        assert!(
            body.notes[0].contains("taken for the body") && body.warnings.is_empty(),
            "{:?}",
            body.warnings
        );
        let completed = complete(&body.volume, &CompleteOptions::default()).unwrap();
        assert!(completed.note.contains("nothing was filled"), "{}", completed.note);
    }
    // Near miss: a liver through all slices.
    let liver = filled([40, 30, 20], 1, &round(6.5));
    assert_eq!(names(&liver), [(1, "-")]);
    assert!(liver.warnings[0].contains("names no tissue"), "{:?}", liver.warnings);
}

#[test]
fn a_background_that_is_not_0_is_guessed_and_told() {
    let organs = numbered(Preset::TotalSegmentator);
    let around = |value: i64| {
        let mut labels = organs.labels().to_vec();
        let last = labels.len() as u8;
        labels.push(Label {
            value,
            ..labels[0].clone()
        });
        labels[0].voxels = 0;
        let voxels = organs
            .voxels()
            .iter()
            .map(|&voxel| if voxel == 0 { last } else { voxel });
        LabelVolume::new(organs.size(), voxels.collect(), labels, *organs.index_to_world()).unwrap()
    };
    let plain = named("a.nrrd", &organs);
    for value in [-1, 255] {
        let read = named("a.nrrd", &around(value));
        assert_eq!(
            (names(&read), read.volume.voxels()),
            (names(&plain), plain.volume.voxels())
        );
        assert_eq!(read.volume.labels()[0].voxels, plain.volume.labels()[0].voxels);
        let told = format!("label {value} (14.9 l) surrounds all others and is taken as unlabelled");
        assert_eq!(
            (&*read.notes[0], read.warnings.len()),
            (told.as_str(), 0),
            "{:?}",
            read.warnings
        );
    }
    // Near misses: another value, and 255 that does not surround.
    assert!(
        named("a.nrrd", &around(254))
            .warnings
            .iter()
            .any(|warning| warning.contains("no label 254"))
    );
    let inner = named("a.nrrd", &torso(&[(1, "liver"), (255, "spleen")]));
    assert_eq!(inner.volume.labels().len(), 3);
}
