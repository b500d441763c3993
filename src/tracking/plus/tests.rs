use super::super::calibration::Calibration;
use super::*;
use insonify_base::blame::Blame;

fn data(name: &str) -> Option<PathBuf> {
    insonify_testing::shared(&format!("config/{name}"))
}

#[test]
fn calibrations_of_real_devices_are_read() {
    for (name, count, centre) in [
        ("BoneUltrasound_L14_config.xml", 1, Some([410.0, 0.0])),
        (
            "PlusDeviceSet_NwirePhantomFreehand_vtkVolumeReconstructorTest2.xml",
            2,
            None,
        ),
        (
            "PlusDeviceSet_Server_SimulatedUltrasound_3DSlicer.xml",
            3,
            Some([410.0, -5.0]),
        ),
        ("PlusDeviceSet_SpinePhantomFreehandReconstructionOnly.xml", 2, None),
        (
            "PlusDeviceSet_UsSimulatorAlgoTestCurvilinear.xml",
            3,
            Some([600.0, 34.0]),
        ),
    ] {
        let Some(path) = data(name) else { return };
        let plus = PlusConfig::read(&path).expect(name);
        assert_eq!(
            (plus.transforms.len(), plus.array_centre_px()),
            (count, centre),
            "{name}"
        );
        let warning = plus.two_centres();
        assert_eq!(warning.is_some(), name.contains("3DSlicer"), "{warning:?}");
        if let Some(warning) = warning {
            assert!(
                warning.contains("(410, -5) by") && warning.contains("(410, 0) by"),
                "{warning}"
            );
        }
        let image = plus.transform("Image", "Probe").expect(name);
        let calibration = Calibration::new(&image, centre.unwrap_or([410.0, 0.0])).expect(name);
        let skewed = calibration.skew_warning([820, 616]);
        assert_eq!(
            skewed.is_some(),
            name.contains("SpinePhantom") || name.contains("Nwire"),
            "{skewed:?}"
        );
        if let Some(warning) = skewed.filter(|_| name.contains("SpinePhantom")) {
            for figure in ["92.74 degrees", "0.0854, 0.0790 and 0.0822 mm", "1.37 degrees"] {
                assert!(warning.contains(figure), "{warning}");
            }
        }
    }
}

#[test]
fn transducers_of_real_devices_are_read() {
    for (name, size, table) in [
        (
            "BoneUltrasound_L14_config.xml",
            Some([820, 616]),
            "kind = 'linear'\nwidth_mm = 40\ndepth_mm = 60\nlines = 90",
        ),
        (
            "PlusDeviceSet_NwirePhantomFreehand_vtkVolumeReconstructorTest2.xml",
            None,
            "",
        ),
        (
            "PlusDeviceSet_RfProcessingAlgoLinearTest.xml",
            Some([260, 400]),
            "kind = 'linear'\nwidth_mm = 38\ndepth_mm = 55",
        ),
        (
            "PlusDeviceSet_RfProcessingAlgoCurvilinearTest.xml",
            Some([820, 616]),
            "kind = 'curvilinear'\nradius_mm = 10\nangle_deg = 150\ndepth_mm = 72",
        ),
        (
            "PlusDeviceSet_Server_SimulatedUltrasound_3DSlicer.xml",
            Some([820, 616]),
            "kind = 'linear'\nwidth_mm = 40\ndepth_mm = 60\nlines = 128",
        ),
        (
            "PlusDeviceSet_UsSimulatorAlgoTestCurvilinear.xml",
            Some([1200, 800]),
            "kind = 'curvilinear'\nradius_mm = 5\nangle_deg = 120\ndepth_mm = 55\nlines = 256",
        ),
        (
            "PlusDeviceSet_UsSimulatorAlgoTestLinear.xml",
            Some([476, 689]),
            "kind = 'linear'\nwidth_mm = 40\ndepth_mm = 60\nlines = 256",
        ),
    ] {
        let Some(path) = data(name) else { return };
        let plus = PlusConfig::read(&path).expect(name);
        let expected: ProbeSpec = toml::from_str(table).expect(table);
        assert_eq!((plus.probe(), plus.image_size()), (&expected, size), "{name}");
    }
}

#[test]
fn configurations_are_summarised() {
    let Some(path) = data("PlusDeviceSet_Server_SimulatedUltrasound_3DSlicer.xml") else {
        return;
    };
    let info = PlusInfo::read(&path).expect("info");
    let names: Vec<String> = info
        .transforms
        .iter()
        .map(|t| format!("{}To{}", t.from, t.to))
        .collect();
    assert_eq!(
        names,
        ["NeedleTipToNeedle", "ImageToProbe", "ImageToTransducerOriginPixel"]
    );
    assert_eq!(
        (info.image_size, info.array_centre_px),
        (Some([820, 616]), Some([410.0, -5.0]))
    );
    assert_eq!(
        info.calibration.as_ref().map(|calibration| calibration.to.as_str()),
        Some("Probe")
    );
    assert!(
        info.warnings
            .iter()
            .any(|warning| warning.contains("TransducerCenterPixel")),
        "{:?}",
        info.warnings
    );
    let text = info.to_string();
    for part in [
        "probe        kind = linear, width_mm = 40, depth_mm = 60, lines = 128",
        "columns, rows and planes 0.0861, 0.0861 and 0.0861 mm, axes 9",
        "ImageToProbe                  52.597, 35.918, 16.37",
    ] {
        assert!(text.contains(part), "{text}");
    }
}

#[test]
fn what_is_no_xml_is_told() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("a.xml");
    for (bytes, found) in [
        (&b"ObjectType = Image\n"[..], "found \"ObjectType = Ima\""),
        (&[0x1f, 0x8b, 8, 0], "found binary data"),
        (b"a\0\x01\x02", "found binary data; expected a PLUS configuration (XML)"),
        (b"", "found an empty file"),
        (b"<P a='\xff'/>", "not UTF-8 from byte 6 on"),
    ] {
        std::fs::write(&path, bytes).expect("file");
        let error = PlusConfig::read(&path).expect_err(found);
        assert!(error.to_string().contains(found) && !error.is_machine(), "{error}");
    }
    std::fs::write(&path, b"\xef\xbb\xbf <P/>").expect("file");
    let error = PlusConfig::read(&path)
        .err()
        .map_or_else(String::new, |error| error.to_string());
    assert!(!error.contains("expected a PLUS configuration"), "{error}");
}

#[test]
fn encodings_of_plus_are_read() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("a.xml");
    let text = |encoding: &str| {
        format!("<?xml version=\"1.0\" encoding=\"{encoding}\"?>\n<P><ScanConversion TransducerName=\"Mün µ\"/></P>")
    };
    let words = |bytes: fn(u16) -> [u8; 2]| text("UTF-16").encode_utf16().flat_map(bytes).collect::<Vec<u8>>();
    let latin = |encoding: &str| text(encoding).chars().map(|c| c as u8).collect::<Vec<u8>>();
    for bytes in [
        text("UTF-8").into_bytes(),
        [b"\xef\xbb\xbf", text("UTF-8").as_bytes()].concat(),
        latin("ISO-8859-1"),
        latin("iso-8859-1"),
        words(u16::to_le_bytes),
        [vec![0xff, 0xfe], words(u16::to_le_bytes)].concat(),
        [vec![0xfe, 0xff], words(u16::to_be_bytes)].concat(),
    ] {
        std::fs::write(&path, &bytes).expect("file");
        let plus = PlusConfig::read(&path).expect("a configuration");
        assert_eq!(plus.transducer(), Some("Mün µ"), "{bytes:?}");
    }
    std::fs::write(&path, latin("UTF-8")).expect("file");
    let error = PlusConfig::read(&path).expect_err("no UTF-8").to_string();
    assert!(error.contains("encoding=\"ISO-8859-1\""), "{error}");
}

#[test]
fn what_serves_a_guess_never_refuses() {
    let parse = |text: &str| PlusConfig::parse(text, Path::new("c.xml")).expect(text);
    let planes = parse("<V ClipRectangleOrigin='10 20 0' ClipRectangleSize='100 60 1'/>");
    assert_eq!(planes.guessed_centre_px(None), Some(([60.0, 20.0], "clip rectangle")));
    assert_eq!(planes.warnings(), [""; 0]);
    for key in [
        "ClipRectangleOrigin",
        "ClipRectangleSize",
        "NumberOfScanLines",
        "NumberOfScanlines",
    ] {
        let plus = parse(&format!("<V {key}='a b'/>"));
        let [warning] = plus.warnings() else {
            panic!("{key}: {:?}", plus.warnings())
        };
        assert!(
            warning.contains(key) && warning.contains("line 1") && warning.ends_with("ignored"),
            "{warning}"
        );
        assert_eq!(
            (plus.guessed_centre_px(None), plus.probe()),
            (None, &ProbeSpec::default())
        );
    }
    for key in ["OutputImageSizePixel", "OutputImageSpacingMmPerPixel"] {
        let plus = parse(&format!("<ScanConversion {key}='1'/>"));
        assert_eq!(
            (plus.image_size(), plus.pixel_mm(), plus.warnings().len()),
            (None, None, 1),
            "{key}"
        );
    }
}

#[test]
fn faults_say_where_they_are() {
    let parse = |text: &str| PlusConfig::parse(text, Path::new("c.xml"));
    let short =
        "<P>\n <CoordinateDefinitions>\n  <Transform From='A' To='B' Matrix='1 2 3'/>\n </CoordinateDefinitions></P>";
    let error = parse(short).expect_err("short").to_string();
    assert!(
        error.contains("line 3, column 3") && error.contains("3 numbers in place of 16"),
        "{error}"
    );
    let error = parse("<P><Q></P>").expect_err("open").to_string();
    assert!(error.contains("`c.xml`, line 1, column"), "{error}");
    let nameless = "<P><CoordinateDefinitions><Transform To='B' Matrix='1'/></CoordinateDefinitions></P>";
    assert!(parse(nameless).is_err());
    let empty = parse("<P/>").expect("empty");
    let error = empty.transform("Image", "Probe").expect_err("none").to_string();
    assert!(
        error.contains("no transform from `Image` to `Probe`; it has none"),
        "{error}"
    );
    assert!(parse("<P TransducerCenterPixel='4'/>").is_err());
    let deep = "<P>\n<ScanConversion TransducerGeometry='LINEAR' ImagingDepthMm='deep'/></P>";
    let error = parse(deep).expect_err("deep").to_string();
    assert!(
        error.contains("line 2") && error.contains("`ImagingDepthMm` is `deep`"),
        "{error}"
    );
}

#[test]
fn a_centre_is_guessed_from_the_clip_rectangle_or_the_images() {
    let parse = |text: &str| PlusConfig::parse(text, Path::new("c.xml")).expect(text);
    let clipped = parse("<V ClipRectangleOrigin='167 62' ClipRectangleSize='495 488'/>");
    assert_eq!(
        clipped.guessed_centre_px(Some([820, 616])),
        Some(([414.5, 62.0], "clip rectangle"))
    );
    assert_eq!(
        parse("<V/>").guessed_centre_px(Some([820, 616])),
        Some(([410.0, 0.0], "images"))
    );
    assert_eq!(parse("<V/>").guessed_centre_px(None), None);
}

#[test]
fn a_transform_that_is_not_finite_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let info = |matrix: &str| {
        let path = folder.path().join("a.xml");
        let text = format!(
            "<PlusConfiguration><CoordinateDefinitions><Transform From=\"StylusTip\" To=\"Stylus\" Matrix=\"{matrix}\"/>\
             </CoordinateDefinitions></PlusConfiguration>"
        );
        std::fs::write(&path, text).unwrap();
        PlusInfo::read(&path).expect("info")
    };
    let broken = info("1 0 0 nan 0 1 0 0 0 0 1 0 0 0 0 1");
    assert_eq!(
        broken.warnings,
        ["the transform from `StylusTip` to `Stylus` has a number that is not finite: it is left out"]
    );
    assert!(broken.to_string().contains("StylusTipToStylus  not finite"), "{broken}");
    assert!(info("1 0 0 5 0 1 0 0 0 0 1 0 0 0 0 1").warnings.is_empty());
}
