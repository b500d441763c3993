use nalgebra::Matrix4;

use super::*;
use crate::volume::{Label, load};
use insonify_base::blame::Blame;

pub(crate) fn sample(values: &[i64]) -> LabelVolume {
    #[rustfmt::skip]
    let world = Matrix4::new(
        0.0, 1.5, 0.25, -10.5,
        -2.0, 0.0, 0.0, 20.25,
        0.0, 0.0, 3.0, 30.125,
        0.0, 0.0, 0.0, 1.0,
    );
    let size = [3, 4, 5];
    let voxels: Vec<u8> = (0..60).map(|n| (n * 7 % values.len()) as u8).collect();
    let labels = values
        .iter()
        .enumerate()
        .map(|(index, &value)| Label {
            value,
            name: (value != 0).then(|| format!("part {value} & <more>")),
            voxels: voxels.iter().filter(|&&voxel| usize::from(voxel) == index).count() as u64,
        })
        .collect();
    LabelVolume::new(size, voxels, labels, world).unwrap()
}

#[test]
fn volumes_come_back_from_every_format() {
    let folder = tempfile::tempdir().unwrap();
    let sets: [&[i64]; 6] = [
        &[0, 1, 255],
        &[0, -3, 100],
        &[0, 300, 65_535],
        &[0, -40_000, 7],
        &[0, 1, 4_000_000_000],
        &[0, -1, 1 << 40],
    ];
    for values in sets {
        let volume = sample(values);
        for name in format::written().map(|written| format!("a{}", written.ending)) {
            let path = folder.path().join(&name);
            save(&volume, &path).unwrap();
            let loaded = load(&path).unwrap();
            assert_eq!(loaded.volume.size(), volume.size(), "{name}");
            let values_of = |volume: &LabelVolume| -> Vec<i64> {
                volume
                    .voxels()
                    .iter()
                    .map(|&v| volume.labels()[usize::from(v)].value)
                    .collect()
            };
            assert_eq!(values_of(&loaded.volume), values_of(&volume), "{name} {values:?}");
            for label in volume.labels() {
                let back = loaded.volume.labels().iter().find(|other| other.value == label.value);
                assert_eq!(back, Some(label), "{name}");
            }
            let difference = (loaded.volume.index_to_world() - volume.index_to_world()).abs().max();
            // MetaImage divides by the spacing and multiplies again; these steps are exact in single precision.
            assert!(difference < 1e-14, "{name} differs by {difference}");
            assert!(
                loaded.warnings.iter().all(|warning| warning.contains("sheared")),
                "{:?}",
                loaded.warnings
            );
        }
    }
}

#[test]
fn the_smallest_type_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.nii");
    save(&sample(&[0, 1, 255]), &path).unwrap();
    let small = std::fs::metadata(&path).unwrap().len();
    save(&sample(&[0, 1, 256]), &path).unwrap();
    assert_eq!(std::fs::metadata(&path).unwrap().len(), small + 60);
}

#[test]
fn other_endings_long_axes_and_missing_folders_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let other = save(&sample(&[0, 1]), &folder.path().join("a.png")).unwrap_err();
    let text = other.to_string();
    assert!(
        text.contains("names end in .nii, .nii.gz, ") && !other.is_machine(),
        "{text}"
    );
    assert!(format::written().all(|written| text.contains(written.ending)), "{text}");
    let away = save(&sample(&[0, 1]), &folder.path().join("no/a.mha")).unwrap_err();
    assert!(!away.is_machine(), "{away}");
    let labels = vec![Label {
        value: 0,
        name: None,
        voxels: 40_000,
    }];
    let long = LabelVolume::new([40_000, 1, 1], vec![0; 40_000], labels, Matrix4::identity()).unwrap();
    let message = save(&long, &folder.path().join("a.nii")).unwrap_err().to_string();
    assert!(message.contains("at most 32767"), "{message}");
}
