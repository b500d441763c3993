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

#[test]
fn what_encloses_all_other_labels_is_the_body_whatever_its_name() {
    let folder = Folder::new();
    let size = [40, 30, 20];
    let at = |offset: usize| [offset % size[0], offset / size[0] % size[1], offset / size[0] / size[1]];
    let radius = |[x, y, _]: [usize; 3]| (x as f64 - 20.0).hypot(y as f64 - 15.0);
    let masks = |name: &str, inside: &dyn Fn([usize; 3]) -> bool| {
        let path = folder.path(name);
        fs::create_dir(&path).unwrap();
        let mask = |file: &str, inside: &dyn Fn([usize; 3]) -> bool| {
            let voxels: Vec<u8> = (0..size.iter().product())
                .map(|offset| u8::from(inside(at(offset))))
                .collect();
            let count = voxels.iter().filter(|voxel| **voxel > 0).count();
            save(&volume(size, voxels, &[(1, count)], 10.0), &path.join(file)).unwrap();
        };
        mask(&format!("{name}.nii"), inside);
        mask("liver.nii", &|place @ [_, _, z]| {
            radius(place) < 6.0 && (5..15).contains(&z)
        });
        opened(&path)
    };
    let filled = |place: [usize; 3]| radius(place) < 14.0;
    for name in ["External", "Haut", "Body_contour", "skin", "outline", "tissue"] {
        let read = masks(name, &filled);
        let is_body = |label: &Label| label.name.as_deref() == Some("body");
        assert!(read.volume.labels().iter().any(is_body), "{name}: {:?}", names(&read));
        let told = format!("({name}) is taken for the body: ");
        assert!(
            read.notes.iter().any(|note| note.contains(&told)),
            "{name}: {:?}",
            read.notes
        );
        let completed = complete(&read.volume, &CompleteOptions::default()).unwrap();
        assert!(
            completed.note.contains("nothing was filled"),
            "{name}: {}",
            completed.note
        );
    }
    // Near misses: a shell, what encloses not all, and an organ.
    let shell = |place: [usize; 3]| (12.5..14.0).contains(&radius(place));
    let beside = |place: [usize; 3]| filled(place) && place[0] < 20;
    for (name, inside) in [
        ("Skin", &shell as &dyn Fn([usize; 3]) -> bool),
        ("Couch", &beside),
        ("fat", &filled),
    ] {
        let read = masks(name, inside);
        assert!(
            names(&read).iter().any(|(_, kept)| *kept == name),
            "{name}: {:?}",
            names(&read)
        );
    }
    // Where one label a voxel is stored, a body lacks what lies in it, here lungs that reach out of it by a voxel.
    let stored = |lung_mm: f64| {
        let label = |place: [usize; 3]| match (radius(place) < lung_mm, filled(place)) {
            (true, _) => 2,
            (false, inside) => u8::from(inside && place[2] > 0),
        };
        let voxels: Vec<u8> = (0..size.iter().product()).map(|offset| label(at(offset))).collect();
        let count = |label: u8| voxels.iter().filter(|voxel| **voxel == label).count();
        let counts = [(1, count(1)), (2, count(2))];
        let mut volume = volume(size, voxels, &counts, 10.0);
        volume.name(1, "tissue".to_owned());
        volume.name(2, "lung".to_owned());
        named("a.seg.nrrd", &volume)
    };
    assert_eq!(names(&stored(9.0)), [(1, "body"), (2, "lung")]);
    // Near miss: a rim around the larger rest.
    assert_eq!(names(&stored(11.0)), [(1, "tissue"), (2, "lung")]);
    let path = folder.path("External");
    let naming = Naming {
        claimed_names: &["External".to_owned()],
        ..Naming::default()
    };
    let claimed = open(&path, &naming).unwrap();
    assert!(names(&claimed).iter().any(|(_, name)| *name == "External"));
}
