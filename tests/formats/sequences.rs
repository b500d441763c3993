use insonify_imaging::sequence::{FrameInfo, SequenceWriter};
use insonify_tracking::sequence::{Sequence, SequenceInfo};

use crate::data;

fn read(name: &str) -> Option<Sequence> {
    let path = data(name)?;
    Some(Sequence::read(&path).unwrap_or_else(|error| panic!("{error}")))
}

fn valid(sequence: &Sequence, name: &str) -> usize {
    let is_valid = |transforms: &std::collections::BTreeMap<_, insonify_tracking::sequence::TrackedTransform>| {
        transforms.get(name).is_some_and(|transform| transform.valid)
    };
    sequence
        .frames
        .iter()
        .filter(|frame| is_valid(&frame.transforms))
        .count()
}

#[test]
fn every_real_sequence_has_its_frames() {
    for (name, frames, size) in [
        ("tracked/BoneUltrasound_L14.igs.mha", 21, Some([820, 616])),
        ("tracked/NwirePhantomFreehand.igs.mha", 97, Some([820, 616])),
        ("tracked/NwirePhantomFreehand.igs.nrrd", 97, Some([820, 616])),
        ("tracked/NwirePhantomFreehandCropped.igs.mha", 20, Some([200, 150])),
        ("tracked/SlidingProbeTrackingData.igs.mha", 85, None),
        (
            "tracked/UsSimulatorOutputSpinePhantom2CurvilinearBaselineNoUS.igs.mha",
            15,
            Some([1, 1]),
        ),
        ("tracked/Prostate10_tracker.igs.mha", 10, Some([1, 1])),
        ("textures/Prostate10_video.igs.mhd", 10, Some([640, 480])),
        (
            "textures/UltrasonixCurvilinearScanConvertedDataGroundTruth.igs.mha",
            5,
            Some([820, 616]),
        ),
        ("textures/BkCurvilinearScanConvertedData.igs.mha", 1, Some([600, 400])),
        ("rf/BkCurvilinearRfData.igs.mhd", 1, Some([358, 3480])),
        ("rf/UltrasonixLinearRfData.igs.mha", 1, Some([256, 2080])),
    ] {
        if let Some(sequence) = read(name) {
            assert_eq!((sequence.frames.len(), sequence.image_size), (frames, size), "{name}");
            let grey = size.is_some() && !name.starts_with("rf/");
            assert_eq!(sequence.image(0).is_some(), grey, "{name}");
            let poses = Sequence::read_poses(&data(name).unwrap()).unwrap();
            let named = frames - sequence.missing.len();
            assert_eq!(poses.frames.len(), named, "{name}");
        }
    }
}

#[test]
fn real_sequences_are_summarised() {
    let info = |name: &str| data(name).map(|path| SequenceInfo::of(&path).expect(name));
    if let Some(nwire) = info("tracked/NwirePhantomFreehand.igs.nrrd") {
        let images = nwire.images.as_ref().unwrap();
        assert_eq!(
            (nwire.frames, images.width, images.height, images.valid),
            (97, 820, 616, 97)
        );
        assert_eq!((images.pixel, images.orientation.as_deref()), ("uint8", Some("MFA")));
        let found: Vec<_> = nwire
            .transforms
            .iter()
            .map(|t| (t.name.as_str(), t.frames, t.valid))
            .collect();
        let expected = [
            ("ProbeToTracker", 97, 97),
            ("ReferenceToTracker", 97, 97),
            ("StylusToTracker", 97, 0),
        ];
        assert_eq!(found, expected);
        let text = nwire.to_string();
        assert!(text.contains("StylusToTracker          97        0"), "{text}");
    }
    if let Some(sliding) = info("tracked/SlidingProbeTrackingData.igs.mha") {
        let time = sliding.time.unwrap();
        assert_eq!((sliding.frames, sliding.images, time.frames), (85, None, 85));
        let intervals =
            [time.median_interval_s, time.longest_interval_s].map(|interval| (interval.unwrap() * 1e3).round());
        assert_eq!((intervals, time.gaps, time.not_after), ([117.0, 521.0], 33, 0));
    }
    for labels in [
        "volumes/plus_SpinePhantomFreehandReconstructed.mha",
        "config/BoneUltrasound_L14_config.xml",
    ] {
        assert_eq!(data(labels).and_then(|path| SequenceInfo::of(&path)), None, "{labels}");
    }
}

#[test]
fn both_formats_of_one_recording_agree() {
    let (Some(mha), Some(nrrd)) = (
        read("tracked/NwirePhantomFreehand.igs.mha"),
        read("tracked/NwirePhantomFreehand.igs.nrrd"),
    ) else {
        return;
    };
    assert_eq!(mha.frames, nrrd.frames);
    assert_eq!(mha.image(96), nrrd.image(96));
    assert_eq!((valid(&mha, "StylusToTracker"), valid(&mha, "ProbeToTracker")), (0, 97));
    assert!(mha.transform(0, "Probe", "Reference").is_some());
    assert_eq!(mha.transform(0, "Stylus", "Reference"), None);
    let exponent = mha.frames[0].transforms["StylusToTracker"].matrix[(0, 1)];
    assert_eq!(exponent, -8.434_82e-5);
}

#[test]
fn gaps_strays_and_missing_images_are_told() {
    if let Some(video) = read("textures/Prostate10_video.igs.mhd") {
        assert_eq!(video.missing, [2]);
        assert_eq!(video.frames[3].timestamp, Some(2.0));
    }
    if let Some(sliding) = read("tracked/SlidingProbeTrackingData.igs.mha") {
        assert_eq!(valid(&sliding, "NeedleToTracker"), 85);
        assert!(sliding.frames.iter().all(|frame| !frame.image_valid));
        let at = |frame: usize| sliding.transform(frame, "Probe", "Tracker").unwrap()[(0, 3)];
        let xs: Vec<f64> = (0..85).map(at).collect();
        let (low, high) = xs
            .iter()
            .fold((f64::MAX, f64::MIN), |(low, high), &x| (low.min(x), high.max(x)));
        assert!(
            (high - low - 38.0).abs() < 1.0,
            "the probe slides 38 mm, found {}",
            high - low
        );
    }
    if let Some(cropped) = read("tracked/NwirePhantomFreehandCropped.igs.mha") {
        let crop = cropped.transform(0, "Image", "CroppedImage").unwrap();
        assert_eq!((crop[(0, 3)], crop[(1, 3)]), (-335.0, -285.0));
    }
}

#[test]
fn a_real_sequence_comes_back_from_the_writer() {
    let Some(original) = read("tracked/NwirePhantomFreehandCropped.igs.mha") else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    for name in ["again.igs.mha", "again.igs.nrrd"] {
        let path = folder.path().join(name);
        let mut writer = SequenceWriter::create(&path, 200, 150).unwrap();
        for frame in &original.frames {
            let transforms: Vec<_> = frame
                .transforms
                .iter()
                .map(|(name, transform)| (name.as_str(), transform.matrix, transform.valid))
                .collect();
            let info = FrameInfo {
                timestamp: frame.timestamp.unwrap(),
                transforms: &transforms,
                image_valid: frame.image_valid,
            };
            writer
                .push(&original.image(frame.index).unwrap().pixels, &info)
                .unwrap();
        }
        writer.finish().unwrap();
        let again = Sequence::read(&path).unwrap();
        assert_eq!(again.frames, original.frames, "{name}");
        for frame in 0..20 {
            assert_eq!(again.image(frame), original.image(frame));
        }
    }
}
