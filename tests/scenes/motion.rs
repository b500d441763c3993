//! Probe and needle move, tissue deforms, frame by frame.

use std::f64::consts::PI;

use insonify_base::document::InputError;
use insonify_imaging::scene::Scene;
use insonify_imaging::synth::FrameState;
use nalgebra::{Matrix4, Point3, Vector3};

use super::support::{data, fault, labelled, resolve, small};

const LINE: &str = "[[motion.keyframes]]\ntime_s = 1\nposition_mm = [0, -90, 0]\ndirection = [0, 1, 0]\n[[motion.keyframes]]\ntime_s = 3\nposition_mm = [0, -90, 40]\ndirection = [0, 1, 0]\n";

#[test]
fn keyframes_are_spread_over_the_frames_asked_for() {
    let scene = resolve(&small(LINE)).expect("scene");
    assert_eq!(scene.frames(), 51);
    assert_eq!([0, 1, 2].map(|frame| scene.time_s(frame, 3)), [1.0, 2.0, 3.0]);
    assert!((scene.probe_pose(1, 3).position_mm() - Point3::new(0.0, -90.0, 20.0)).norm() < 1e-9);
    let stated = resolve(&small(&format!("[motion]\nframes = 7\n{LINE}"))).expect("scene");
    assert_eq!(stated.frames(), 7);
    let error = fault(&small(&LINE.replace("time_s = 3", "time_s = 0")));
    assert_eq!(error.key(), Some("motion.keyframes[1].time_s"));
}

#[test]
fn a_deformation_grows_as_its_ramp_says() {
    let field = "[deform]\nnodes = 300\nramp_s = 2\n[deform.field]\nkind = \"affine\"\nmatrix = [[1,0,0,0],[0,1,0,0],[0,0,1,10],[0,0,0,1]]\n";
    let scene = resolve(&small(field)).expect("scene");
    assert_eq!(scene.frames(), 51);
    let mesh = scene.anatomy.mesh.clone().expect("mesh");
    assert!((200..450).contains(&mesh.nodes().len()), "{}", mesh.nodes().len());
    let mut state = FrameState::at(Matrix4::identity());
    for (frame, shift) in [(0, 0.0), (1, 5.0), (2, 10.0)] {
        scene.state(frame, 3, &mut state).expect("state");
        let nodes = state.nodes.as_ref().expect("nodes");
        assert!((nodes[7][2] - mesh.nodes()[7][2] - shift).abs() < 1e-9);
        assert_eq!(state.frame, frame as u64);
    }
    let place = state.nodes.as_ref().map(|nodes| nodes.as_ptr());
    scene.state(0, 3, &mut state).expect("state");
    assert_eq!(
        place,
        state.nodes.as_ref().map(|nodes| nodes.as_ptr()),
        "the memory is not reused"
    );
    // The ramp starts with the motion.
    let moving = resolve(&small(&format!("{LINE}{field}"))).expect("scene");
    moving.state(0, 2, &mut state).expect("state");
    assert_eq!(state.nodes.as_ref().map(|nodes| nodes[7][2]), Some(mesh.nodes()[7][2]));
    assert_eq!(moving.time_s(1, 2), 3.0);
}

#[test]
fn fields_add_up_and_the_mesh_covers_the_volume() {
    let shift =
        |x: f64| format!("[[deform.field]]\nkind = \"affine\"\nmatrix = [[1,0,0,{x}],[0,1,0,0],[0,0,1,0],[0,0,0,1]]\n");
    let scene = resolve(&small(&format!("{}{}", shift(3.0), shift(4.0)))).expect("scene");
    let mut state = FrameState::at(Matrix4::identity());
    scene.state(0, 1, &mut state).expect("state");
    let mesh = scene.anatomy.mesh.as_ref().expect("mesh");
    assert!((4000..6000).contains(&mesh.nodes().len()));
    assert!((state.nodes.expect("nodes")[0][0] - mesh.nodes()[0][0] - 7.0).abs() < 1e-9);
    let volume = &scene.anatomy.volume;
    let (size, spacing, centre) = (volume.size(), volume.spacing_mm(), volume.centre_mm());
    let corner =
        |sign: f64| Point3::from([0, 1, 2].map(|axis| centre[axis] + sign * size[axis] as f64 * spacing[axis] / 2.0));
    let [low, high] = mesh.bounds();
    assert!((Point3::from(low) - corner(-1.0)).norm() < 1e-9 && (Point3::from(high) - corner(1.0)).norm() < 1e-9);
}

#[test]
fn a_needle_moves_and_bends() {
    let text = "[needle]\nlength_mm = 100\n[[needle.motion.keyframes]]\ntime_s = 0\ntip_mm = [0, -100, 0]\ndirection = [0, 1, 0]\n[[needle.motion.keyframes]]\ntime_s = 1\ntip_mm = [0, -20, 0]\ndirection = [0.2, 1, 0]\n";
    let scene = resolve(&small(text)).expect("scene");
    assert!(scene.settings.has_needle);
    assert_eq!(scene.needle_pose(1, 2).map(|needle| needle.nodes_mm().len()), Some(2));
    assert_eq!(
        scene.needle_pose(1, 2).map(|needle| needle.tip_mm()),
        Some(Point3::new(0.0, -20.0, 0.0))
    );
    let bent = format!("{text}[needle.bending]\nentry_mm = [-10, -70, 0]\nentry_direction = [0, 1, 0]\n");
    let scene = resolve(&small(&bent)).expect("scene");
    assert_eq!(scene.needle_pose(1, 2).map(|needle| needle.nodes_mm().len()), Some(3));
    let error = fault(&small(
        &bent.replace("[needle.bending]", "[needle.bending]\nmax_weight = 2"),
    ));
    assert_eq!(error.key(), Some("needle.bending.max_weight"));
    let error = fault(&small(&format!(
        "{}\n",
        text.replace("length_mm = 100", "tip_mm = [0, 0, 0]")
    )));
    assert_eq!(error.key(), Some("needle"));
}

#[test]
fn a_csv_path_is_read_beside_the_scene() {
    let folder = tempfile::tempdir().expect("folder");
    let rows = "time_s,x_mm,y_mm,z_mm,dx,dy,dz\n0,0,-90,0,0,1,0\n0.5,0,-90,10,0,1,0\n2,0,-90,30,0,1,0\n";
    std::fs::write(folder.path().join("path.csv"), rows).expect("file");
    std::fs::write(folder.path().join("mine.toml"), small("[motion]\ncsv = \"path.csv\"")).expect("file");
    let file = insonify_imaging::scene::SceneFile::read(&folder.path().join("mine.toml")).expect("file");
    let scene = file.resolve(folder.path()).expect("scene");
    assert_eq!((scene.frames(), scene.time_s(1, 3), scene.time_s(1, 2)), (3, 0.5, 2.0));
}

#[test]
fn a_recording_gives_a_frame_for_each_valid_pose() {
    let (Some(file), Some(config)) = (
        data("tracked/BoneUltrasound_L14.igs.mha"),
        data("config/BoneUltrasound_L14_config.xml"),
    ) else {
        return;
    };
    let sequence = |more: &str| small(&format!("[motion.sequence]\nfile = {file:?}\n{more}"));
    let scene = resolve(&sequence(&format!("plus_config = {config:?}"))).expect("scene");
    assert_eq!(scene.frames(), 21);
    let bare = resolve(&sequence("")).expect("scene");
    let tells = |scene: &Scene| scene.notes.iter().any(|note| note.contains("no calibration is stated"));
    let stated = resolve(&sequence("transducer_to_probe = \"1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\"")).expect("scene");
    assert_eq!([&bare, &scene, &stated].map(tells), [true, false, false]);
    let moved = scene.probe_pose(0, 21).position_mm() - bare.probe_pose(0, 21).position_mm();
    assert!(moved.norm() > 5.0, "the calibration moves the array: {moved}");
    assert!(
        scene.warnings.iter().any(|warning| warning.contains("sees nothing")),
        "{:?}",
        scene.warnings
    );
    let placed = resolve(&sequence("tracker_to_world = \"1 0 0 5 0 1 0 6 0 0 1 7 0 0 0 1\"")).expect("scene");
    let moved = placed.probe_pose(3, 21).position_mm() - bare.probe_pose(3, 21).position_mm();
    assert!((moved - Vector3::new(5.0, 6.0, 7.0)).norm() < 1e-9, "{moved}");
    // Relative to the reference marker, by a chain of two recorded transforms.
    let chained = resolve(&sequence("transform = \"ProbeToReference\"")).expect("scene");
    assert_ne!(chained.probe_pose(0, 21), bare.probe_pose(0, 21));
    let error = fault(&sequence("transform = \"NeedleToTracker\""));
    assert_eq!(error.key(), Some("motion.sequence.transform"));
    assert!(error.to_string().contains("ProbeToTracker"), "{error}");
    assert_eq!(
        help(&sequence("transform = \"probetoTracker\"")),
        "did you mean \"ProbeToTracker\"?"
    );
    assert_eq!(
        help(&sequence("transform = \"ProbToReference\"")),
        "did you mean \"ProbeToReference\"?"
    );
    let error = fault(&sequence("image_to_probe = \"1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\""));
    assert!(error.to_string().contains("array_centre_px"), "{error}");
    let error = fault(&sequence("tracker_to_world = \"2 0 0 0 0 2 0 0 0 0 2 0 0 0 0 1\""));
    assert_eq!(error.key(), Some("motion.sequence.tracker_to_world"));
}

/// A recording of three poses without pixels, each with the given keys.
fn poses(keys: &str) -> (tempfile::TempDir, String) {
    let folder = tempfile::tempdir().expect("folder");
    let mut text =
        "ObjectType = Image\nNDims = 3\nDimSize = 120 90 3\nElementSpacing = 1 1 1\nElementType = MET_UCHAR\n"
            .to_owned();
    for frame in 0..3 {
        for line in keys.lines() {
            text.push_str(&format!(
                "Seq_Frame000{frame}_{}\n",
                line.trim().replace("Z", &frame.to_string())
            ));
        }
        text.push_str(&format!("Seq_Frame000{frame}_Timestamp = {frame}\n"));
    }
    text.push_str("UltrasoundImageOrientation = MF\nElementDataFile = LOCAL\n");
    let path = folder.path().join("a.igs.mha");
    std::fs::write(&path, [text.as_bytes(), &[0; 120 * 90 * 3]].concat()).expect("file");
    let file = format!("{path:?}");
    (folder, file)
}

#[test]
fn transforms_named_after_nodes_can_be_named() {
    let (folder, file) = poses("LinearTransform_3Transform = 1 0 0 5 0 1 0 6 0 0 1 Z 0 0 0 1\nStylus = what");
    let sequence = |more: &str| small(&format!("[motion.sequence]\nfile = {file}\n{more}"));
    let scene = resolve(&sequence("transform = \"LinearTransform_3\"")).expect("scene");
    assert_eq!(
        (scene.frames(), scene.probe_pose(2, 3).position_mm()),
        (3, Point3::new(5.0, 6.0, 2.0))
    );
    assert!(
        scene
            .notes
            .iter()
            .any(|note| note.contains("`LinearTransform_3` does not say which frames")),
        "{:?}",
        scene.notes
    );
    assert!(
        scene.warnings.iter().any(|warning| warning.contains("ignored: Stylus")),
        "{:?}",
        scene.warnings
    );
    // The poses of an array need no calibration.
    let (_folder, of_array) = poses("TransducerToTrackerTransform = 1 0 0 5 0 1 0 6 0 0 1 Z 0 0 0 1");
    let of_array = small(&format!(
        "[motion.sequence]\nfile = {of_array}\ntransform = \"TransducerToTracker\""
    ));
    let notes = resolve(&of_array).expect("scene").notes;
    assert!(!notes.iter().any(|note| note.contains("calibration")), "{notes:?}");
    // One that is not there is refused with the list.
    let error = fault(&sequence("transform = \"LinearTransform_4\""));
    assert_eq!(error.key(), Some("motion.sequence.transform"));
    assert!(error.to_string().contains("it has LinearTransform_3"), "{error}");
    let error = fault(&sequence(""));
    assert!(error.to_string().contains("it has LinearTransform_3"));
    assert_eq!(error.help(), Some("did you mean \"LinearTransform_3\"?"));
    // Nor do transforms of a configuration move the probe.
    let config = folder.path().join("plus.xml");
    let text = "<PlusConfiguration><CoordinateDefinitions><Transform From=\"Image\" To=\"Probe\" \
                Matrix=\"1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\"/></CoordinateDefinitions></PlusConfiguration>";
    std::fs::write(&config, text).expect("a configuration");
    let error = fault(&sequence(&format!(
        "transform = \"ProbeToImag\"\nplus_config = {config:?}"
    )));
    assert_eq!(error.help(), Some("did you mean \"LinearTransform_3\"?"), "{error}");
    // Near miss: a misspelt pair that moves.
    let (_folder, file) = poses("ProbeToTrackerTransform = 1 0 0 5 0 1 0 6 0 0 1 Z 0 0 0 1");
    let error = fault(&small(&format!(
        "[motion.sequence]\nfile = {file}\ntransform = \"ProbeToTracer\""
    )));
    assert_eq!(error.help(), Some("did you mean \"ProbeToTracker\"?"));
}

#[test]
fn a_calibration_in_the_frames_is_used_where_none_is_named() {
    let pose = "ProbeToTrackerTransform = 1 0 0 0 0 1 0 0 0 0 1 Z 0 0 0 1\n";
    let stored = "ImageToProbeTransform = 0.5 0 0 10 0 0.5 0 20 0 0 0.5 30 0 0 0 1";
    let position = |keys: &str, more: &str| {
        let (_folder, file) = poses(&format!("{pose}{keys}"));
        let scene = resolve(&small(&format!("[motion.sequence]\nfile = {file}\n{more}"))).expect("scene");
        (
            scene.probe_pose(1, 3).position_mm(),
            scene.notes.join("; "),
            scene.warnings.join("; "),
        )
    };
    let (position_mm, notes, warnings) = position(stored, "array_centre_px = [40, 4]");
    assert_eq!(position_mm, Point3::new(30.0, 22.0, 31.0));
    assert!(
        notes.contains("the calibration is `ImageToProbe`") && !warnings.contains("ImageToProbe"),
        "{notes} {warnings}"
    );
    // Without a centre of the array a guess is offered, not used.
    let (_folder, file) = poses(&format!("{pose}{stored}"));
    let error = fault(&small(&format!("[motion.sequence]\nfile = {file}\n")));
    assert_eq!(error.key(), Some("motion.sequence.file"));
    assert!(
        error.to_string().contains("`ImageToProbe`, without `array_centre_px`"),
        "{error}"
    );
    assert!(
        error
            .help()
            .is_some_and(|help| help.contains("`array_centre_px = [60, 0]`: a guess")),
        "{:?}",
        error.help()
    );
    // A named calibration wins, and one that moves is none.
    let (position_mm, notes, _) = position(stored, "transducer_to_probe = \"1 0 0 1 0 1 0 2 0 0 1 3 0 0 0 1\"");
    assert_eq!(position_mm, Point3::new(1.0, 2.0, 4.0));
    assert!(!notes.contains("ImageToProbe"), "{notes}");
    let (position_mm, _, warnings) = position(&stored.replace("10", "Z0"), "");
    assert_eq!(position_mm, Point3::new(0.0, 0.0, 1.0));
    assert!(warnings.contains("not the same in all frames"), "{warnings}");
}

#[test]
fn invalid_frames_of_a_recording_are_counted() {
    let Some(file) = data("tracked/SlidingProbeTrackingData.igs.mha") else {
        return;
    };
    let text = small(&format!(
        "[motion.sequence]\nfile = {file:?}\n[needle.motion.sequence]\nfile = {file:?}\n"
    ));
    let scene = match resolve(&text) {
        Ok(scene) => scene,
        Err(error) => panic!("{error}"),
    };
    assert_eq!((scene.frames(), scene.settings.has_needle), (85, true));
    let needle = scene.needle_pose(0, 85).expect("needle");
    assert!((needle.length_mm() - 150.0).abs() < 1e-9);
    let Some(file) = data("tracked/NwirePhantomFreehand.igs.mha") else {
        return;
    };
    let error = fault(&small(&format!(
        "[motion.sequence]\nfile = {file:?}\ntransform = \"StylusToTracker\""
    )));
    assert_eq!(error.key(), Some("motion.sequence.transform"));
    assert!(
        error.to_string().contains("`StylusToTracker`: none of 97 frames"),
        "{error}"
    );
    let error = fault(&small(&format!(
        "[motion.sequence]\nfile = {file:?}\ntransform = \"StylusToReference\""
    )));
    assert!(
        error.to_string().contains("StylusToTracker (invalid in all 97 frames)"),
        "{error}"
    );
}

/// The help of the error of a scene that must have one.
fn help(text: &str) -> String {
    let error = fault(text);
    error.help().unwrap_or_default().to_owned()
}

/// Two frames of an array that looks to the back of a body: at x = -20 and -60 mm, y = -70 mm.
const TRACKED: &str = "ObjectType = Image\nNDims = 3\nDimSize = 40 30 2\nElementSpacing = 1 1 1\nElementType = MET_UCHAR\n\
    UltrasoundImageOrientation = MF\nUltrasoundImageType = BRIGHTNESS\n\
    Seq_Frame0000_ProbeToTrackerTransform = 1 0 0 -20 0 1 0 -70 0 0 1 0 0 0 0 1\nSeq_Frame0000_ProbeToTrackerTransformStatus = OK\n\
    Seq_Frame0000_StylusToTrackerTransform = 1 0 0 7 0 1 0 8 0 0 1 9 0 0 0 1\nSeq_Frame0000_StylusToTrackerTransformStatus = INVALID\n\
    Seq_Frame0000_Timestamp = 1.5\n\
    Seq_Frame0001_ProbeToTrackerTransform = 1 0 0 -60 0 1 0 -70 0 0 1 0 0 0 0 1\nSeq_Frame0001_ProbeToTrackerTransformStatus = OK\n\
    Seq_Frame0001_Timestamp = 1.75\nElementDataFile = LOCAL\n";

const CONFIG: &str = "<PlusConfiguration><ScanConversion TransducerName='L12' TransducerGeometry='LINEAR' TransducerWidthMm='30' \
    ImagingDepthMm='25' TransducerCenterPixel='20 2' NumberOfScanLines='50'/><CoordinateDefinitions>\
    <Transform From='Image' To='Probe' Matrix='1 0.05 0 0 0 1 0 0 0 0 1 0 0 0 0 1'/></CoordinateDefinitions></PlusConfiguration>";

/// The scene of a recording of that, with more keys of its tables; of a cube in a corner of the axes for a stated
/// probe.
fn recorded(motion: &str, sequence: &str, more: &str) -> Result<insonify_imaging::scene::Scene, InputError> {
    recorded_as([TRACKED, CONFIG], motion, sequence, more)
}

/// As [`recorded`], of another recording and configuration.
fn recorded_as(
    [tracked, config]: [&str; 2],
    motion: &str,
    sequence: &str,
    more: &str,
) -> Result<insonify_imaging::scene::Scene, InputError> {
    let folder = tempfile::tempdir().expect("folder");
    std::fs::write(folder.path().join("a.mha"), [tracked.as_bytes(), &[0; 2400]].concat()).expect("file");
    std::fs::write(folder.path().join("plus.xml"), config).expect("file");
    let header = "ObjectType = Image\nNDims = 3\nDimSize = 20 20 20\nElementSpacing = 5 5 5\nOffset = 0 0 -50\nElementType = \
                  MET_UCHAR\nElementDataFile = LOCAL\n";
    std::fs::write(folder.path().join("cube.mha"), [header.as_bytes(), &[1; 8000]].concat()).expect("file");
    let text = small(&format!(
        "[motion]\n{motion}\n[motion.sequence]\nfile = \"a.mha\"\n{sequence}\n{more}"
    ));
    let text = if more.contains("width_mm = 30") {
        text.replace(
            "phantom = \"abdomen\"\nresolution_mm = 5",
            "file = \"cube.mha\"\nunlabelled = \"air\"",
        )
    } else {
        text
    };
    super::support::parse(&text).and_then(|file| file.resolve(folder.path()))
}

fn says<T: AsRef<str>>(all: &[T], parts: &[&str]) -> bool {
    all.iter()
        .any(|one| parts.iter().all(|part| one.as_ref().contains(part)))
}

#[test]
fn poses_in_ras_are_turned_and_offered() {
    let lps = recorded("", "", "").expect("scene");
    let ras = recorded("world = \"ras\"", "", "").expect("scene");
    let place = |scene: &insonify_imaging::scene::Scene| scene.probe_pose(0, 2).position_mm();
    assert_eq!(place(&lps), Point3::new(-20.0, -70.0, 0.0));
    assert_eq!(place(&ras), Point3::new(20.0, 70.0, 0.0));
    assert!(
        says(&lps.notes, &["taken as LPS", "`world = \"ras\"` under [motion]"]),
        "{:?}",
        lps.notes
    );
    assert!(!says(&ras.notes, &["taken as LPS"]), "{:?}", ras.notes);
    // A cube in one corner of the axes.
    let linear = "[probe]\nkind = \"linear\"\nwidth_mm = 30\ndepth_mm = 25";
    let black = recorded("", "", linear).expect("scene");
    let hint = [
        "in 2 of 2 poses",
        "In the first of them the centre of the array is at (-20, -70, 0) mm and the volume spans (-3, -3, -53) to (98, 98, 48)",
        "mm (LPS): 70 mm apart. Read as RAS it sees the volume in 2",
        "state `world = \"ras\"` under [motion]",
    ];
    assert!(says(&black.warnings, &hint), "{:?}", black.warnings);
    let seen = recorded("world = \"ras\"", "", linear).expect("scene");
    assert!(!says(&seen.warnings, &["sees nothing"]), "{:?}", seen.warnings);
    let away = "tracker_to_world = \"1 0 0 0 0 1 0 9000 0 0 1 0 0 0 0 1\"";
    let nowhere = recorded("", away, linear).expect("scene");
    assert!(says(
        &nowhere.warnings,
        &["sees nothing", "mm apart. `tracker_to_world` under"]
    ));
    assert!(!says(&nowhere.warnings, &["RAS"]));
    // Which axes are assumed matters with a registration, too.
    let near = recorded("", "tracker_to_world = \"1 0 0 1 0 1 0 0 0 0 1 0 0 0 0 1\"", "").expect("scene");
    assert!(says(&near.notes, &["taken as LPS"]), "{:?}", near.notes);
}

/// Before a body far from the origin, poses in metres or centimetres are told by the unit in which they would see it.
#[test]
fn poses_in_other_units_are_questioned_as_such() {
    let folder = tempfile::tempdir().expect("folder");
    let header = "ObjectType = Image\nNDims = 3\nDimSize = 20 20 20\nElementSpacing = 5 5 5\nOffset = 300 200 -50\nElementType = \
                  MET_UCHAR\nElementDataFile = LOCAL\n";
    std::fs::write(folder.path().join("cube.mha"), [header.as_bytes(), &[1; 8000]].concat()).expect("file");
    let warnings = |per_mm: f64| {
        let [x, y] = [350.0, 190.0].map(|mm| mm * per_mm);
        let text = format!(
            "version = 2\n[volume]\nfile = \"cube.mha\"\nunlabelled = \"air\"\n[probe]\nkind = \"linear\"\ndepth_mm = 40\n\
             [pose]\nposition_mm = [{x}, {y}, 0]\ndirection = [0, 1, 0]\n"
        );
        let scene = super::support::parse(&text).and_then(|file| file.resolve(folder.path()));
        scene.expect("a scene").warnings
    };
    for (per_mm, words) in [(1e-3, "Are the positions in m?"), (0.1, "Are the positions in cm?")] {
        let told = warnings(per_mm);
        assert!(says(&told, &["sees nothing", words]), "{told:?}");
    }
    assert!(!says(&warnings(1.0), &["sees nothing"]));
    assert!(!says(&warnings(0.5), &["Are the positions"]));
}

#[test]
fn poses_and_needles_take_either_world() {
    let pair = |lps: &str, ras: &str| {
        let [lps, ras] = [lps, ras].map(|text| resolve(&small(text)).unwrap_or_else(|error| panic!("{error}")));
        assert_eq!(lps.probe_pose(1, 3), ras.probe_pose(1, 3));
        let nodes =
            |scene: &insonify_imaging::scene::Scene| scene.needle_pose(1, 3).map(|needle| needle.nodes_mm().to_vec());
        let turned = nodes(&ras)
            .unwrap_or_default()
            .into_iter()
            .zip(nodes(&lps).unwrap_or_default());
        assert_eq!(
            nodes(&lps).map(|nodes| nodes.len()),
            nodes(&ras).map(|nodes| nodes.len())
        );
        for (a, b) in turned {
            assert!((a - b).norm() < 1e-9, "{a} {b}");
        }
    };
    pair(
        "[pose]\nposition_mm = [10, -80, 5]\ndirection = [0.1, 1, 0]",
        "[pose]\nworld = \"ras\"\nposition_mm = [-10, 80, 5]\ndirection = [-0.1, -1, 0]",
    );
    pair(
        "[[motion.keyframes]]\ntime_s = 0\nposition_mm = [10, -80, 5]\ndirection = [0.1, 1, 0]\n[needle]\ntip_mm = [1, 2, 3]\nentry_mm = [4, 5, 6]",
        "[motion]\nworld = \"ras\"\n[[motion.keyframes]]\ntime_s = 0\nposition_mm = [-10, 80, 5]\ndirection = [-0.1, -1, 0]\n[needle]\nworld = \"ras\"\ntip_mm = [-1, -2, 3]\nentry_mm = [-4, -5, 6]",
    );
    let needle = |world: &str, sign: f64| {
        format!(
            "[needle]\n{world}[[needle.motion.keyframes]]\ntime_s = 0\ntip_mm = [{}, {}, 0]\ndirection = [0, {sign}, 0]\n[needle.bending]\nentry_mm = [{}, {}, 0]\nentry_direction = [0, {sign}, 0]\n",
            5.0 * sign,
            -20.0 * sign,
            3.0 * sign,
            -70.0 * sign
        )
    };
    pair(&needle("", 1.0), &needle("world = \"ras\"\n", -1.0));
    for (text, key) in [
        ("[pose]\nworld = \"ras\"", "pose.world"),
        ("[motion]\nworld = \"ras\"", "motion.world"),
    ] {
        assert_eq!(fault(&small(text)).key(), Some(key));
    }
}

#[test]
fn a_configuration_fills_in_the_probe() {
    let plus = "plus_config = \"plus.xml\"";
    let probe = |scene: &insonify_imaging::scene::Scene| toml::to_string(&scene.settings.probe).expect("toml");
    let scene = recorded("", plus, "").expect("scene");
    let words = [
        "kind = linear, width_mm = 30, depth_mm = 25, lines = 50",
        "`plus_config` (L12)",
    ];
    assert!(says(&scene.notes, &words), "{:?}", scene.notes);
    for key in [
        "kind = \"linear\"",
        "width_mm = 30",
        "depth_mm = 25",
        "lines = 50",
        "samples = 512",
    ] {
        assert!(probe(&scene).contains(key), "{}", probe(&scene));
    }
    assert_eq!(scene.open_grid, [false, true]);
    let stated = recorded("", plus, "[probe]\ndepth_mm = 20\nfrequency_mhz = 7").expect("scene");
    assert!(probe(&stated).contains("depth_mm = 20") && probe(&stated).contains("width_mm = 30"));
    let other = "[probe]\nkind = \"phased\"\nangle_deg = 80\ndepth_mm = 50";
    let other = recorded("", plus, other).expect("scene");
    assert!(
        says(&other.warnings, &["stated as phased", "says linear (L12)"]),
        "{:?}",
        other.warnings
    );
    let bare = recorded("", "", "").expect("scene");
    assert!(
        says(&bare.warnings, &["no `[probe]`", "default probe"]),
        "{:?}",
        bare.warnings
    );
    assert!(
        says(&scene.warnings, &["87.14 degrees apart", "image.grid"]),
        "{:?}",
        scene.warnings
    );
}

#[test]
fn frames_lie_on_the_recorded_grid() {
    let scene = recorded(
        "",
        "plus_config = \"plus.xml\"",
        "[image]\ngrid = \"recorded\"\n[effects]\nonly = []",
    )
    .expect("scene");
    assert_eq!((scene.settings.image.width, scene.settings.image.height), (40, 30));
    assert!(!says(&scene.warnings, &["apart"]), "{:?}", scene.warnings);
    let stated = scene.file.image.expect("image");
    assert_eq!((stated.width, stated.height), (40, 30));
    let again = "[image]\ngrid = \"recorded\"\nwidth = 40\nheight = 30";
    recorded("", "plus_config = \"plus.xml\"", again).expect("the size in use");
    let tilted = ["87.14 degrees apart", "pixels stay", "tilted by 1.43 degrees"];
    assert!(says(&scene.notes, &tilted), "{:?}", scene.notes);
    let frame = super::support::render(&scene, &mut super::support::synthesizer(&scene), 1, 2);
    assert_eq!((frame.width, frame.height), (40, 30));
    for [column, row] in [[0.0, 0.0], [39.0, 0.0], [20.0, 2.0], [7.0, 29.0]] {
        let corner = frame.image_to_world.transform_point(&Point3::new(column, row, 0.0));
        let expected = Point3::new(column + 0.05 * row - 60.0, row - 70.0, 0.0);
        assert!((corner - expected).norm() < 1e-9, "{corner} {expected}");
    }
    let frames = [0, 1].map(|frame| scene.recorded(frame, 2).expect("recorded"));
    assert!(!frames[0].transforms["StylusToTracker"].valid && frames[1].transforms.len() == 1);
    assert_eq!(scene.recorded(0, 5), None);
    let error = |sequence: &str, more: &str| recorded("", sequence, more).expect_err(more).to_string();
    let bare = error("", "[image]\ngrid = \"recorded\"");
    assert!(bare.contains("no calibrated images"), "{bare}");
    let sized = error("plus_config = \"plus.xml\"", "[image]\ngrid = \"recorded\"\nwidth = 30");
    assert!(sized.contains("has its own size"), "{sized}");
}

#[test]
fn frames_without_a_pose_are_listed() {
    let status = "Seq_Frame0001_ProbeToTrackerTransformStatus = ";
    let tracked = TRACKED.replace(&format!("{status}OK"), &format!("{status}INVALID"));
    let scene = recorded_as([&tracked, CONFIG], "", "", "").expect("scene");
    assert_eq!(scene.frames(), 1);
    let words = "1 of 2 frames skipped (1); frame 1: the tracker marked its transform invalid";
    assert!(says(&scene.warnings, &[words]), "{:?}", scene.warnings);
    let gone = TRACKED.replace("Status = OK", "Status = INVALID");
    let error = recorded_as([&gone, CONFIG], "", "", "").expect_err("no pose");
    assert_eq!(error.key(), Some("motion.sequence.transform"));
    assert!(
        error
            .to_string()
            .contains("`ProbeToTracker`: none of 2 frames has a valid pose"),
        "{error}"
    );
}

#[test]
fn a_needle_is_read_in_the_axes_of_the_motion() {
    let needle = |world: &str| {
        format!("[needle]\n{world}[needle.motion.sequence]\nfile = \"a.mha\"\ntransform = \"ProbeToTracker\"")
    };
    let tip = |scene: &insonify_imaging::scene::Scene| scene.needle_pose(0, 2).expect("needle").tip_mm();
    let inherited = recorded("world = \"ras\"", "", &needle("")).expect("scene");
    assert_eq!(tip(&inherited), Point3::new(20.0, 70.0, 0.0));
    assert!(
        says(&inherited.notes, &["needle is read as RAS, as [motion] states"]),
        "{:?}",
        inherited.notes
    );
    assert!(!says(&inherited.notes, &["taken as LPS"]), "{:?}", inherited.notes);
    assert!(!says(&inherited.warnings, &["never meets"]), "{:?}", inherited.warnings);
    let stated = recorded("world = \"ras\"", "", &needle("world = \"lps\"\n")).expect("scene");
    assert_eq!(tip(&stated), Point3::new(-20.0, -70.0, 0.0));
    assert!(!says(&stated.notes, &["needle is read"]), "{:?}", stated.notes);
    let away = "tip_to_marker = \"1 0 0 0  0 1 0 0  0 0 1 -20  0 0 0 1\"";
    let aloof = recorded("", "", &format!("{}\n{away}", needle(""))).expect("scene");
    assert!(
        says(
            &aloof.warnings,
            &["never meets the scan plane: it stays 20.0 mm", "in all 2 frames"]
        ),
        "{:?}",
        aloof.warnings
    );
}

/// The needle in the frame and axes of the probe goes into the world with it, unless it says how.
#[test]
fn a_needle_has_the_registration_of_the_probe() {
    let [away, back] = [9, -9].map(|x| format!("tracker_to_world = \"1 0 0 {x} 0 1 0 0 0 0 1 0 0 0 0 1\""));
    let at = |needle: &str, own: &str| {
        let needle =
            format!("{needle}[needle.motion.sequence]\nfile = \"a.mha\"\ntransform = \"ProbeToTracker\"\n{own}");
        let scene = recorded("world = \"ras\"", &away, &needle).expect("scene");
        let tip = scene.needle_pose(0, 2).expect("needle").tip_mm();
        (tip - scene.probe_pose(0, 2).position_mm(), scene.notes)
    };
    let (apart, notes) = at("", "");
    assert!(
        apart.norm() < 1e-9 && says(&notes, &["`tracker_to_world` is that of [motion.sequence]"]),
        "{apart} {notes:?}"
    );
    let (apart, notes) = at("", &back);
    assert!(
        (apart - Vector3::new(18.0, 0.0, 0.0)).norm() < 1e-9 && !says(&notes, &["[motion.sequence]"]),
        "{apart}"
    );
    let (_, notes) = at("[needle]\nworld = \"lps\"\n", "");
    assert!(
        says(&notes, &["`tracker_to_world` is not that of [motion.sequence]"]),
        "{notes:?}"
    );
}

#[test]
fn transforms_of_the_configuration_are_part_of_the_chain() {
    let more = "<Transform From='Phantom' To='Tracker' Matrix='1 0 0 100 0 1 0 0 0 0 1 0 0 0 0 1'/>\
        <Transform From='Probe' To='Tracker' Matrix='1 0 0 999 0 1 0 0 0 0 1 0 0 0 0 1'/>\
        <Transform From='NeedleTip' To='Probe' Matrix='1 0 0 0 0 1 0 3 0 0 1 0 0 0 0 1'/></CoordinateDefinitions>";
    let config = CONFIG.replace("</CoordinateDefinitions>", more);
    let plus = "plus_config = \"plus.xml\"\ntransform = \"ProbeToPhantom\"";
    let of = |sequence: &str, more: &str| recorded_as([TRACKED, &config], "", sequence, more);
    let scene = of(plus, "").expect("scene");
    let plain = of("plus_config = \"plus.xml\"", "").expect("scene");
    let moved = scene.probe_pose(0, 2).position_mm() - plain.probe_pose(0, 2).position_mm();
    assert!((moved - Vector3::new(-100.0, 0.0, 0.0)).norm() < 1e-9, "{moved}");
    let words = ["`ProbeToPhantom` does not follow from the recording alone"];
    assert!(
        says(&scene.notes, &words) && !says(&plain.notes, &["alone"]),
        "{:?}",
        scene.notes
    );
    let tip = |scene: &insonify_imaging::scene::Scene| scene.needle_pose(0, 2).expect("needle").tip_mm();
    let needle = "[needle.motion.sequence]\nfile = \"a.mha\"\ntransform = \"NeedleTipToTracker\"";
    let shared = of("plus_config = \"plus.xml\"", needle).expect("scene");
    assert!((tip(&shared) - Point3::new(-20.0, -67.0, 0.0)).norm() < 1e-9);
    let by_needle = of("", &format!("{needle}\nplus_config = \"plus.xml\"")).expect("scene");
    assert_eq!(tip(&by_needle), tip(&shared));
    let error = of("", needle).expect_err("no definitions");
    assert_eq!(error.key(), Some("needle.motion.sequence.transform"));
    let error = of("transform = \"ProbeToPhantom\"", "").expect_err("no definitions");
    let help = error.help();
    assert_ne!(help, Some("did you mean \"ProbeToProbe\"?"));
    let error = of(&plus.replace("ToPhantom", "ToFantom"), "").expect_err("misspelt");
    assert!(
        error
            .to_string()
            .contains("`plus_config` defines ImageToProbe, NeedleTipToProbe, PhantomToTracker"),
        "{error}"
    );
    let help = error.help();
    assert_eq!(help, Some("did you mean \"ProbeToPhantom\"?"));
}

/// The place of a pixel of the first frame in the world.
fn pixel_mm(scene: &insonify_imaging::scene::Scene, column: f64, row: f64) -> Point3<f64> {
    let grid = scene.settings.image.placed.as_ref().expect("the recorded grid");
    let place = scene.probe_pose(0, scene.frames()).probe_to_world() * grid.image_to_probe();
    place.transform_point(&Point3::new(column, row, 0.0))
}

#[test]
fn cropped_recordings_lie_where_their_pixels_were() {
    let timestamp = "Seq_Frame0001_Timestamp";
    let crops = |first: &str, second: &str| {
        let keys = [(0, first), (1, second)].map(|(frame, crop)| {
            format!("Seq_Frame000{frame}_ImageToCroppedImageTransform = {crop}\nSeq_Frame000{frame}_ImageToCroppedImageTransformStatus = OK\n")
        });
        TRACKED.replace(timestamp, &format!("{}{timestamp}", keys.concat()))
    };
    let shift = "1 0 0 -5 0 1 0 -3 0 0 1 0 0 0 0 1";
    let config = CONFIG.replace("<ScanConversion", "<ScanConversion OutputImageSizePixel='80 60'");
    let (plus, grid) = ("plus_config = \"plus.xml\"", "[image]\ngrid = \"recorded\"");
    let tracked = crops(shift, shift);
    let scene = recorded_as([&tracked, &config], "", plus, grid).expect("scene");
    let whole = recorded("", plus, grid).expect("scene");
    assert!((pixel_mm(&scene, 2.0, 4.0) - pixel_mm(&whole, 7.0, 7.0)).norm() < 1e-9);
    assert_eq!(scene.probe_pose(0, 2), whole.probe_pose(0, 2));
    assert!(
        says(&scene.notes, &["cropped", "pixel (0, 0) is pixel (5, 3)"]),
        "{:?}",
        scene.notes
    );
    assert!(!says(&scene.warnings, &["other images"]), "{:?}", scene.warnings);
    assert!(
        scene
            .recorded(0, 2)
            .expect("recorded")
            .transforms
            .contains_key("ImageToCroppedImage")
    );
    let fitted = recorded_as([&tracked, &config], "", plus, "").expect("scene");
    assert!(
        !fitted
            .recorded(0, 2)
            .expect("recorded")
            .transforms
            .contains_key("ImageToCroppedImage")
    );
    let turned = "0 1 0 -5 -1 0 0 -3 0 0 1 0 0 0 0 1";
    for (first, second, words) in [
        (
            shift,
            "1 0 0 -6 0 1 0 -3 0 0 1 0 0 0 0 1",
            "is not in frame 1 what it is in frame 0",
        ),
        (turned, turned, "`ImageToCroppedImage` that is [["),
        (shift, "what", "is invalid in frame 1"),
    ] {
        let error = recorded_as([&crops(first, second), &config], "", plus, grid).expect_err(words);
        assert_eq!(error.key(), Some("motion.sequence.file"));
        assert!(error.to_string().contains(words), "{error}");
    }
}

#[test]
fn a_real_cropped_recording_lies_where_its_pixels_were() {
    let (Some(file), Some(config)) = (
        data("tracked/NwirePhantomFreehandCropped.igs.mha"),
        data("config/PlusDeviceSet_NwirePhantomFreehand_vtkVolumeReconstructorTest2.xml"),
    ) else {
        return;
    };
    let scene = resolve(&small(&format!(
        "[motion.sequence]\nfile = {file:?}\nplus_config = {config:?}\narray_centre_px = [414.5, 62]\n[image]\ngrid = \"recorded\""
    )))
    .unwrap_or_else(|error| panic!("{error}"));
    assert_eq!((scene.settings.image.width, scene.settings.image.height), (200, 150));
    let image = insonify_tracking::plus::PlusConfig::read(&config)
        .and_then(|config| config.transform("Image", "Probe"))
        .expect("calibration");
    let probe = scene.recorded(0, scene.frames()).expect("recorded").transforms["ProbeToTracker"].matrix;
    let expected = (probe * image).transform_point(&Point3::new(335.0, 285.0, 0.0));
    let size = pixel_mm(&scene, 0.0, 0.0);
    assert!((size - expected).norm() < 0.05, "{size} {expected}");
}

#[test]
fn a_missing_array_centre_is_guessed_aloud() {
    let Some(config) = data("config/PlusDeviceSet_SpinePhantomFreehandReconstructionOnly.xml") else {
        return;
    };
    let Some(file) = data("tracked/BoneUltrasound_L14.igs.mha") else {
        return;
    };
    let text = small(&format!("[motion.sequence]\nfile = {file:?}\nplus_config = {config:?}"));
    assert!(fault(&text).to_string().contains("no `TransducerCenterPixel`"));
    assert!(
        help(&text).contains("`array_centre_px = [410, 0]`: a guess"),
        "{}",
        help(&text)
    );
}

#[test]
fn the_scene_of_the_documentation_runs_on_a_recording() {
    let page = include_str!("../../docs/tracked-data.md");
    let blocks = page
        .split("```toml\n")
        .skip(1)
        .filter_map(|rest| rest.split("```").next());
    let text = blocks.collect::<String>().replace("NeedleTo", "StylusTo");
    let (Some(file), Some(config)) = (
        data("tracked/BoneUltrasound_L14.igs.mha"),
        data("config/BoneUltrasound_L14_config.xml"),
    ) else {
        return;
    };
    let folder = tempfile::tempdir().expect("folder");
    let header = "ObjectType = Image\nNDims = 3\nDimSize = 100 100 100\nElementSpacing = 10 10 10\nOffset = -500 -500 -500\n\
                  ElementType = MET_UCHAR\nElementDataFile = LOCAL\n";
    let cube = folder.path().join("cube.mha");
    std::fs::write(&cube, [header.as_bytes(), &vec![5; 1_000_000]].concat()).expect("file");
    let mut text = text;
    for (name, path) in [
        ("phantom.seg.nrrd", cube),
        ("recording.igs.mha", file),
        ("config.xml", config),
    ] {
        assert!(text.contains(name), "{name}");
        text = text.replace(name, &path.display().to_string());
    }
    let scene = resolve(&text).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(
        (scene.frames(), scene.settings.image.width, scene.settings.image.height),
        (21, 820, 616)
    );
    let names: Vec<_> = scene
        .recorded(20, 21)
        .expect("recorded")
        .transforms
        .keys()
        .cloned()
        .collect();
    assert_eq!(names, ["ProbeToTracker", "ReferenceToTracker", "StylusToTracker"]);
    assert!(scene.needle_pose(20, 21).is_some() && says(&scene.notes, &["is that of [motion.sequence]"]));
    assert!(
        !says(&scene.warnings, &["sees nothing"]) && !says(&scene.warnings, &["apart"]),
        "{:?}",
        scene.warnings
    );
}

/// Organs of the phantom in a breath of 5 s, on a mesh of cells of 11 mm.
const BREATHING: &str =
    "[deform]\nnodes = 20000\n[motion.breathing]\nrate_per_min = 12\ntravel_mm = { liver = 15, kidney = 10 }\n";

/// Ways towards the feet, mm, of the nodes whose tissue or label has a name in it, ascending, in frame `frame` of 126.
/// Elements of the mesh must not fold.
fn downwards_mm(scene: &Scene, frame: usize, name: &str) -> Vec<f64> {
    let mesh = scene.anatomy.mesh.as_ref().expect("mesh");
    let mut state = FrameState::at(Matrix4::identity());
    scene.state(frame, 126, &mut state).expect("state");
    let nodes = state.nodes.expect("nodes");
    let pairs = mesh.volumes(&nodes).zip(mesh.volumes(mesh.nodes()));
    assert!(pairs.into_iter().all(|(moved, rest)| moved > 0.09 * rest), "{frame}");
    let volume = scene.anatomy.volume.undivided();
    let is_named = |node: &[f64; 3]| {
        let label = volume.label_index_at(&(*node).into()).filter(|label| *label > 0);
        label.is_some_and(|label| {
            let label_name = volume.labels()[usize::from(label)].name.as_deref();
            label_name.is_some_and(|label_name| label_name.contains(name))
                || scene.anatomy.tissues.tissue(label).name.contains(name)
        })
    };
    let pairs = mesh.nodes().iter().zip(&nodes).filter(|(rest, _)| is_named(rest));
    let mut downwards: Vec<f64> = pairs
        .map(|(rest, node)| {
            assert_eq!(rest[..2], node[..2]);
            rest[2] - node[2]
        })
        .collect();
    assert!(!downwards.is_empty(), "no node in {name}");
    downwards.sort_by(f64::total_cmp);
    downwards
}

#[test]
fn organs_go_with_the_breath_and_bone_and_skin_rest() {
    let scene = resolve(&small(BREATHING)).expect("scene");
    assert_eq!(scene.frames(), 126);
    // Beside ribs and the spine, organs go less far.
    for (name, travel_mm) in [("liver", 15.0), ("kidney", 10.0)] {
        for frame in [0, 31, 63] {
            let expected_mm = travel_mm * (PI * scene.time_s(frame, 126) / 5.0).sin().powi(4);
            let downwards = downwards_mm(&scene, frame, name);
            let farthest_mm = downwards[downwards.len() - 1];
            assert!((farthest_mm - expected_mm).abs() < 1e-9, "{name}: {farthest_mm} mm");
        }
    }
    for name in ["bone", "skin"] {
        assert!(downwards_mm(&scene, 63, name).iter().all(|mm| *mm == 0.0), "{name}");
    }
    // Far travels are cut short beside ribs, which is told.
    let far = resolve(&small(&BREATHING.replace("liver = 15", "liver = 90"))).expect("scene");
    assert!(downwards_mm(&far, 63, "bone").iter().all(|mm| *mm == 0.0));
    let is_told = |scene: &Scene| scene.notes.iter().any(|note| note.contains("go less far than stated"));
    assert!(is_told(&far));
    // With a path the breath takes no part in the number of frames.
    let along = resolve(&small(&format!("{LINE}{BREATHING}"))).expect("scene");
    assert_eq!(along.frames(), 51);
    // Without the table there is no mesh and no pass for one.
    assert!(resolve(&small("")).expect("scene").anatomy.mesh.is_none());
}

#[test]
fn a_held_breath_is_still() {
    let scene = resolve(&small(&format!("{BREATHING}hold_s = [2, 4]\n"))).expect("scene");
    let at = |frame| downwards_mm(&scene, frame, "liver");
    // Frames of 40 ms.
    assert_ne!(at(40), at(50));
    assert_eq!(at(50), at(60));
    assert_eq!(at(50), at(100));
    assert_ne!(at(100), at(110));
}

#[test]
fn elements_that_fold_as_motions_add_up_are_counted() {
    let with = |scale: f64, travel_mm: f64| {
        let field =
            format!("[deform.field]\nkind = \"affine\"\nmatrix = [[1,0,0,0],[0,1,0,0],[0,0,{scale},0],[0,0,0,1]]\n");
        let breath = format!("[motion.breathing]\ntravel_mm = {{ liver = {travel_mm} }}\n");
        let scene = resolve(&small(&format!("{field}{breath}"))).expect("scene");
        let told = scene
            .warnings
            .iter()
            .filter(|warning| warning.contains("fold where its motions add up"));
        told.count()
    };
    // A breath leaves elements a tenth of their volume at least.
    assert_eq!([with(0.15, 15.0), with(0.95, 2.0)], [1, 0]);
}

#[test]
fn organs_of_a_patient_breathe_under_the_ribs() {
    for (file, more, surroundings) in [
        ("volumes/DERIVED_ts_example_body_labels.nii.gz", "", false),
        ("volumes/ts_example_seg_full.nii.gz", "unlabelled = \"air\"\n", true),
    ] {
        let Some(path) = data(file) else { return };
        let text = format!(
            "version = 2\n[volume]\nfile = \"{}\"\n{more}[deform]\nnodes = 20000\n[motion.breathing]\n",
            path.display()
        );
        let scene = resolve(&text).expect("scene");
        for (name, travel_mm) in [("liver", 24.4), ("kidney_right", 16.5)] {
            let downwards = downwards_mm(&scene, 63, name);
            let is_whole = |mm: &&f64| (**mm - travel_mm * (PI * 63.0 / 125.0).sin().powi(4)).abs() < 1e-9;
            let whole = downwards.iter().filter(is_whole).count();
            assert!(2 * whole > downwards.len(), "{name}: {whole} of {}", downwards.len());
        }
        for name in ["rib", "costal_cartilages", "vertebrae"] {
            assert!(downwards_mm(&scene, 63, name).iter().all(|mm| *mm == 0.0), "{name}");
        }
        let is_told = scene.notes.iter().any(|note| note.contains("has no labels"));
        assert_eq!(is_told, surroundings, "{file}");
        // The same on every run.
        let again = resolve(&text).expect("scene");
        assert_eq!(downwards_mm(&scene, 63, "liver"), downwards_mm(&again, 63, "liver"));
    }
}

#[test]
fn breaths_that_cannot_be_meant_are_refused() {
    for (travel, key, reason) in [
        ("{ prostate = 5 }", "motion.breathing.travel_mm.prostate", "prostate"),
        (
            "{ liver = 150 }",
            "motion.breathing.travel_mm.liver",
            "a travel from 0 to 100 mm",
        ),
    ] {
        let error = fault(&small(&BREATHING.replace("{ liver = 15, kidney = 10 }", travel)));
        assert_eq!(error.key(), Some(key));
        assert!(error.to_string().contains(reason), "{error}");
    }
    let error = fault(&small(&format!("{BREATHING}hold_s = [3, 2]\n")));
    assert_eq!(error.key(), Some("motion.breathing.hold_s"));
    let error = fault(&small(&BREATHING.replace("= 12", "= 0")));
    assert_eq!(error.key(), Some("motion.breathing.rate_per_min"));
}

/// A probe pressed into the abdomen goes as far as it is told, the skin with it; bone rests, and a gallbladder under it
/// gets flatter. By the force that this takes it goes as far.
#[test]
fn a_pressed_probe_dents_the_skin_and_what_is_soft_below() {
    let at_rest = resolve(&small("")).expect("scene");
    let pressed = resolve(&small("[motion.press]\nindent_mm = 8\n")).expect("scene");
    assert_eq!(pressed.frames(), 1);
    let way = pressed.probe_pose(0, 1).position_mm() - at_rest.probe_pose(0, 1).position_mm();
    let along = at_rest.probe_pose(0, 1).axial().into_inner();
    assert!((way - along * 8.0).norm() < 1e-9, "{way}");
    let mut state = FrameState::at(Matrix4::identity());
    pressed.state(0, 1, &mut state).expect("state");
    let (mesh, nodes) = (
        pressed.anatomy.mesh.as_ref().expect("mesh"),
        state.nodes.expect("nodes"),
    );
    let ways: Vec<f64> = mesh
        .nodes()
        .iter()
        .zip(&nodes)
        .map(|(rest, node)| (Point3::from(*node) - Point3::from(*rest)).dot(&along))
        .collect();
    let farthest_mm = ways.iter().copied().fold(0.0, f64::max);
    // Skin that lies behind the array at rest is pushed farther by that.
    assert!((8.0..13.0).contains(&farthest_mm), "{farthest_mm} mm");
    for (corners, region) in mesh.elements().iter().zip(mesh.regions()) {
        if pressed.anatomy.tissues.tissue(*region as u8).name == "bone" {
            assert!(corners.iter().all(|node| ways[*node as usize] == 0.0));
        }
    }
    let told = |scene: &Scene| {
        let note = scene
            .notes
            .iter()
            .find(|note| note.contains("the probe, pressed by"))
            .expect("a note");
        let numbers: Vec<f64> = note.split_whitespace().filter_map(|word| word.parse().ok()).collect();
        (numbers[0], numbers[1])
    };
    let (depth_mm, force_n) = told(&pressed);
    assert_eq!(depth_mm, 8.0);
    let by_force = resolve(&small(&format!("[motion.press]\nforce_n = {force_n}\n"))).expect("scene");
    assert!((told(&by_force).0 - 8.0).abs() < 0.3, "{:?}", told(&by_force));
    for (text, key) in [
        ("[motion.press]\n", "motion.press"),
        ("[motion.press]\nindent_mm = 8\nforce_n = 3\n", "motion.press"),
        ("[motion.press]\nindent_mm = 80\n", "motion.press.indent_mm"),
        (
            "[deform]\nmesh = \"m.vtu\"\n[motion.press]\nindent_mm = 8\n",
            "motion.press",
        ),
        (
            "[probe]\nkind = \"trus-sagittal\"\n[motion.press]\nindent_mm = 8\n",
            "motion.press",
        ),
    ] {
        assert_eq!(fault(&small(text)).key(), Some(key), "{text}");
    }
    assert_eq!(
        fault(&small(&format!("{LINE}[motion.press]\nindent_mm = 8\n"))).key(),
        Some("motion.press")
    );
}

/// Under a linear probe a superficial vein gets flat, and an artery as deep hardly. What a round cylinder of other
/// stiffness strains of what the muscle around it does is 2 / (1 + ratio of moduli) where neither changes its volume
/// (Eshelby 1957): 0.34 for the artery, 1.85 for a vein whose blood could not move away. Moduli that a scene states
/// hold for both.
#[test]
fn a_pressed_probe_flattens_veins_and_spares_arteries() {
    let names = ["muscle", "femoral_vein", "femoral_artery"];
    let file = labelled([80.0, 60.0, 40.0], 1.0, &names, |p| match p {
        _ if (p.x + 9.0).hypot(p.y + 9.0) < 4.0 => 2,
        _ if (p.x - 9.0).hypot(p.y + 9.0) < 4.0 => 3,
        _ if p.y > -25.0 => 1,
        _ => 0,
    });
    // How much less the depths of vein and artery in the image vary.
    let strains = |like: Option<&str>| {
        let stated = |like| format!("[[tissue]]\nname = \"stated\"\nlabels = [2, 3]\nlike = {like}\n");
        let scene = resolve(&file.scene(&format!(
            "unlabelled = \"air\"\nstructures = false\n[probe]\nkind = \"linear\"\ndepth_mm = 40\n[pose]\n\
             position_mm = [0, -25, 0]\ndirection = [0, 1, 0]\nlateral = [1, 0, 0]\n[motion.press]\nindent_mm = 5\n{}",
            like.map_or(String::new(), stated)
        )))
        .expect("scene");
        let mut state = FrameState::at(Matrix4::identity());
        scene.state(0, 1, &mut state).expect("state");
        let mesh = scene.anatomy.mesh.as_ref().expect("mesh");
        let nodes = state.nodes.expect("nodes");
        let spread_mm = |nodes: &[[f64; 3]], wanted: i32| {
            let elements = mesh.elements().iter().zip(mesh.regions());
            let corners = elements
                .filter(|(_, region)| **region == wanted)
                .flat_map(|(corners, _)| corners);
            let in_image = corners.filter(|node| mesh.nodes()[**node as usize][2].abs() < 3.0);
            let depths: Vec<f64> = in_image.map(|node| nodes[*node as usize][1]).collect();
            let mean = depths.iter().sum::<f64>() / depths.len() as f64;
            depths.iter().map(|depth| (depth - mean).powi(2)).sum::<f64>().sqrt()
        };
        [2, 3].map(|region| 1.0 - spread_mm(&nodes, region) / spread_mm(mesh.nodes(), region))
    };
    let ([vein, artery], [muscle, _]) = (strains(None), strains(Some("\"muscle\"")));
    println!("a vein strains by {vein}, an artery by {artery}, muscle in their place by {muscle}");
    assert!(vein > 1.85 * muscle, "{vein} {muscle}");
    // Elements of 3 mm are too stiff by as much.
    assert!((artery / muscle - 0.34).abs() < 0.2, "{artery} {muscle}");
    let [vein, artery] = strains(Some("\"blood\"\nyoung_kpa = 12\npoisson = 0.49"));
    assert!(
        (vein / muscle - 1.0).abs() < 0.05 && (artery / vein - 1.0).abs() < 0.2,
        "{vein} {artery}"
    );
}

#[test]
fn arteries_of_a_patient_widen_with_every_beat() {
    let Some(path) = data("volumes/ts_example_seg_full.nii.gz") else {
        return;
    };
    let with = |more: &str| {
        format!(
            "version = 2\n[volume]\nfile = \"{}\"\n[deform]\nnodes = 60000\n[motion.pulse]\nrate_per_min = 60\n{more}",
            path.display()
        )
    };
    let scene = resolve(&with("radial_mm = { aorta = 1.5 }")).expect("scene");
    // One beat, widest after 0.3 s.
    assert_eq!(scene.frames(), 26);
    let mesh = scene.anatomy.mesh.as_ref().expect("mesh");
    let volume = scene.anatomy.volume.undivided();
    let mut state = FrameState::at(Matrix4::identity());
    let mut ways_mm = |time_frame: usize, name: &str| -> Vec<f64> {
        scene.state(time_frame, 101, &mut state).expect("state");
        let nodes = state.nodes.as_ref().expect("nodes");
        assert!(mesh.volumes(nodes).all(|mm3| mm3 > 0.0));
        let is_named = |node: &[f64; 3]| {
            let label = volume.label_index_at(&(*node).into()).unwrap_or(0);
            let name_of = volume.labels()[usize::from(label)].name.as_deref();
            name_of.is_some_and(|label_name| label_name.starts_with(name))
        };
        let pairs = mesh.nodes().iter().zip(nodes).filter(|(rest, _)| is_named(rest));
        pairs
            .map(|(rest, node)| (Point3::from(*node) - Point3::from(*rest)).norm())
            .collect()
    };
    let widest = |ways: &[f64]| ways.iter().copied().fold(0.0, f64::max);
    assert_eq!(widest(&ways_mm(0, "aorta")), 0.0);
    let systole = widest(&ways_mm(30, "aorta"));
    assert!((1.0..1.5 + 1e-9).contains(&systole), "{systole} mm");
    assert!((widest(&ways_mm(15, "aorta")) - 0.5 * systole).abs() < 1e-9);
    assert_eq!(widest(&ways_mm(30, "vertebrae")), 0.0);
    assert_eq!(widest(&ways_mm(30, "urinary_bladder")), 0.0);
    // Those of the volume by a share of their radius, which is told.
    let usual = resolve(&with("")).expect("scene");
    let is_told =
        |note: &&insonify_base::note::Note| note.contains("9 % of their radius") && note.contains("iliac_artery_left");
    assert_eq!(usual.notes.iter().filter(is_told).count(), 1, "{:?}", usual.notes);
    for (more, key, reason) in [
        (
            "radial_mm = { aorta = 9 }",
            "motion.pulse.radial_mm.aorta",
            "from 0 to 5 mm",
        ),
        (
            "radial_mm = { carotid = 1 }",
            "motion.pulse.radial_mm.carotid",
            "carotid",
        ),
        (
            "radial_mm = { iliac_artery = 5 }",
            "motion.pulse.radial_mm",
            "at most half of the radius",
        ),
    ] {
        let error = fault(&with(more));
        assert_eq!(error.key(), Some(key));
        assert!(error.to_string().contains(reason), "{error}");
    }
    let error = fault(&with("").replace("= 60\n", "= 300\n"));
    assert_eq!(error.key(), Some("motion.pulse.rate_per_min"));
}
