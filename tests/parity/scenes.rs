//! Anatomies and poses of the parity tests.

use insonify_imaging::synth::tables::Anatomy;
use insonify_imaging::synth::{FrameState, NeedleShaft};
use insonify_mesh::Displacement;
use nalgebra::Vector3;

use crate::support::anatomy::{self, Acoustics, Frame, PLAIN, SILENT};
use crate::support::scene;

/// Centre of the volumes, away from the origin as in a real scan, mm.
const CENTRE: [f64; 3] = [31.0, -44.0, 57.0];

/// Tissues that differ in everything.
fn tissues() -> Vec<Acoustics> {
    let row = |echo_db, attenuation_db_cm_mhz, occlusion_per_mm, impedance_mrayl, texture| Acoustics {
        echo_db,
        attenuation_db_cm_mhz,
        occlusion_per_mm,
        impedance_mrayl,
        texture,
    };
    vec![
        SILENT,
        row(0.0, 0.5, 0.0, 1.65, Some("hashed")),
        row(6.0, 1.1, 0.0, 1.70, None),
        row(-12.0, 0.1, 0.0, 1.52, Some("hashed")),
        row(10.0, 2.0, 0.05, 4.0, None),
    ]
}

fn textured(mut anatomy: Anatomy) -> Anatomy {
    anatomy.textures.insert("hashed".into(), anatomy::hashed_texture());
    anatomy
}

/// Labels drawn anew at every voxel of a 40 mm cube.
pub(crate) fn random_anatomy() -> Anatomy {
    textured(anatomy::random(Frame::around(CENTRE, [40; 3], 1.0), &tissues(), 1))
}

/// The same in an oblique, anisotropic frame.
pub(crate) fn oblique_anatomy() -> Anatomy {
    textured(anatomy::random(
        Frame::around(CENTRE, [40; 3], 1.0).oblique(),
        &tissues(),
        2,
    ))
}

/// Random labels that neither attenuate nor occlude.
pub(crate) fn unattenuating() -> Anatomy {
    let tissues: Vec<Acoustics> = tissues()
        .into_iter()
        .map(|own| Acoustics {
            attenuation_db_cm_mhz: 0.0,
            occlusion_per_mm: 0.0,
            ..own
        })
        .collect();
    textured(anatomy::random(Frame::around(CENTRE, [40; 3], 1.0), &tissues, 1))
}

/// The same with a tissue among them that is as opaque as bone.
pub(crate) fn with_bone() -> Anatomy {
    let mut tissues = tissues();
    if let Some(last) = tissues.last_mut() {
        last.occlusion_per_mm = 0.9;
    }
    textured(anatomy::random(Frame::around(CENTRE, [40; 3], 1.0), &tissues, 6))
}

/// The same with gas.
pub(crate) fn with_gas() -> Anatomy {
    let mut tissues = tissues();
    if let Some(last) = tissues.last_mut() {
        (last.occlusion_per_mm, last.impedance_mrayl) = (0.9, 0.0004);
    }
    textured(anatomy::random(Frame::around(CENTRE, [40; 3], 1.0), &tissues, 7))
}

/// Tissue with a ball in it over gas that is tilted and curved.
pub(crate) fn above_gas() -> Anatomy {
    let mut tissues = tissues();
    if let Some(last) = tissues.last_mut() {
        (last.occlusion_per_mm, last.impedance_mrayl) = (0.9, 0.0004);
    }
    let anatomy = anatomy::anatomy_from(Frame::around(CENTRE, [60; 3], 0.8), &tissues, |p| {
        let [x, y, z] = std::array::from_fn(|axis| p[axis] - CENTRE[axis]);
        if y > 2.0 + 0.4 * x + 0.1 * z + 0.02 * x * x {
            4
        } else {
            1 + u8::from(x * x + (y + 6.0).powi(2) + z * z < 25.0)
        }
    });
    textured(anatomy)
}

/// Voxels of 1 mm whose faces lie at whole and half millimetres of the world.
pub(crate) fn unit_voxels() -> Anatomy {
    textured(anatomy::random(
        Frame::around([0.0, 20.0, 0.0], [40; 3], 1.0),
        &tissues(),
        3,
    ))
}

/// The same with a mesh of cells of 4 mm over its middle.
pub(crate) fn on_a_lattice() -> Anatomy {
    anatomy::with_mesh(unit_voxels(), [[-10.0, 4.0, -8.0], [10.0, 28.0, 8.0]], 6 * 7 * 5)
}

/// A ball in a box before a straight probe.
pub(crate) fn ball() -> Anatomy {
    textured(anatomy::ball(
        Frame::around([0.0, 20.0, 0.0], [40; 3], 1.0),
        [1.0, 19.0, 0.0],
        9.0,
        &tissues(),
    ))
}

/// Three layers before a straight probe; no sample of the grids used comes near a boundary.
pub(crate) fn flat_layers() -> Anatomy {
    anatomy::layers(
        Frame::around([0.0, 60.0, 0.0], [3, 130, 3], 1.01).stretched([100.0, 1.0, 100.0]),
        &[3.37, 21.7, 44.9],
        &{
            let mut tissues = tissues();
            tissues.truncate(4);
            for own in &mut tissues {
                own.texture = None;
            }
            tissues[0] = PLAIN;
            tissues
        },
    )
}

/// A probe at the rim of the volumes, turned about every axis.
pub(crate) fn oblique_pose() -> FrameState {
    let [x, y, z] = CENTRE;
    scene::aimed([x - 9.0, y - 17.0, z + 3.0], [x + 4.0, y + 9.0, z - 2.0], 0.7)
}

/// The volume and the pose 900 mm away from the origin of the world.
pub(crate) fn far_away() -> (Anatomy, FrameState) {
    let centre = [310.0, -440.0, 720.0];
    let anatomy = textured(anatomy::random(Frame::around(centre, [40; 3], 1.0), &tissues(), 4));
    let [x, y, z] = centre;
    (
        anatomy,
        scene::aimed([x - 9.0, y - 17.0, z + 3.0], [x + 4.0, y + 9.0, z - 2.0], 0.7),
    )
}

/// Random labels under a mesh smaller than the volume, pressed in and swirled: parts of the beam lie in the mesh,
/// outside it, and where its tissue has moved away.
pub(crate) fn pressed() -> (Anatomy, FrameState) {
    let [x, y, z] = CENTRE;
    let mut anatomy = random_anatomy();
    anatomy = anatomy::with_mesh(
        anatomy,
        [[x - 14.0, y - 13.0, z - 12.0], [x + 12.0, y + 14.0, z + 13.0]],
        200,
    );
    let mut state = oblique_pose();
    let press = Displacement::Indentation {
        centre_mm: [x - 4.0, y - 10.0, z],
        direction: [0.2, 1.0, 0.1],
        depth_mm: 5.0,
        radius_mm: 7.0,
    };
    let swirl = Displacement::Swirl {
        centre_mm: CENTRE,
        axis: [0.3, 0.2, 1.0],
        angle_deg: 14.0,
        radius_mm: 9.0,
    };
    let mesh = anatomy.mesh.clone().expect("a mesh");
    let nodes = mesh
        .nodes()
        .iter()
        .map(|&node| {
            let moved = Vector3::from(node) + Vector3::from(press.apply(node)) + Vector3::from(swirl.apply(node));
            moved.into()
        })
        .collect();
    state.nodes = Some(nodes);
    (anatomy, state)
}

/// A bent needle that leaves the plane of a pose.
pub(crate) fn with_needle(mut state: FrameState) -> FrameState {
    let points = [[-16.0, 3.0, 0.2], [-7.0, 11.0, 0.1], [1.0, 20.0, 0.3], [6.0, 31.0, 1.1]];
    let nodes = points
        .map(|point| state.probe_to_world.transform_point(&point.into()))
        .to_vec();
    state.needle = Some(NeedleShaft {
        nodes,
        diameter_mm: 1.2,
    });
    state
}
