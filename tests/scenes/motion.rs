//! Probe and needle move, tissue deforms, frame by frame.

use insonify::synth::FrameState;
use nalgebra::{Matrix4, Point3, Vector3};

use crate::support::{data, fault, resolve, small};

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
    let file = insonify::scene::SceneFile::read(&folder.path().join("mine.toml")).expect("file");
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
    let error = fault(&sequence("image_to_probe = \"1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\""));
    assert!(error.to_string().contains("array_centre_px"), "{error}");
    let error = fault(&sequence("tracker_to_world = \"2 0 0 0 0 2 0 0 0 0 2 0 0 0 0 1\""));
    assert_eq!(error.key(), Some("motion.sequence.tracker_to_world"));
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
    assert!(error.to_string().contains("none of"), "{error}");
}
