//! The right kidney: cortex, medullary pyramids around the sinus, and the vessels at its hilum.

use std::sync::LazyLock;

use super::l;
use super::{Noise, Over, Painting, Point, Uneven};
use crate::phantom::geometry::{Bounds, Ellipsoid, Shape, Solid, frame, path, smooth_max, smooth_min};

/// Centre of the kidney, mm.
const CENTRE: [f64; 3] = [-60.0, 33.0, -40.0];
/// Half length, half width (towards the hilum) and half thickness, mm.
const HALF_MM: [f64; 3] = [54.0, 27.0, 22.0];
/// Half angle of a pyramid at the centre of the kidney, in its coordinates scaled to a sphere, radians.
const PYRAMID_RAD: f64 = 0.32;
/// Angles of the pyramids around the hilum's axis, degrees from the hilum, in each of two rows.
const PYRAMIDS_DEG: [f64; 7] = [52.0, 88.0, 128.0, 180.0, 232.0, 272.0, 308.0];

/// Outline without the hilum.
pub(super) static OUTLINE: LazyLock<Ellipsoid> = LazyLock::new(|| Ellipsoid {
    centre: Point::from(CENTRE),
    axes: frame(Point::new(0.20, -0.12, 1.0), Point::new(0.85, -0.5, 0.0)),
    radii: HALF_MM,
});

fn sinus() -> Ellipsoid {
    let body = *OUTLINE;
    Ellipsoid {
        centre: body.centre + body.axes[1] * 9.0,
        radii: [23.0, 13.0, 6.5],
        ..body
    }
}

/// Signed distance of the pyramids: cones from the centre, between sinus and cortex.
fn pyramids(p: &Point) -> f64 {
    let body = *OUTLINE;
    let local = body.local(p);
    let level = local.norm();
    let nearest = PYRAMIDS_DEG
        .iter()
        .flat_map(|deg| {
            let (sin, cos) = deg.to_radians().sin_cos();
            [-0.42, 0.42].map(|row| Point::new(sin, cos, row))
        })
        .chain(
            [-0.6, 0.0, 0.6]
                .into_iter()
                .flat_map(|along| [-1.0, 1.0].map(|row| Point::new(along, -0.1, row))),
        )
        .map(|axis| {
            let axis = axis.normalize();
            (local.dot(&axis) / level.max(1e-9)).clamp(-1.0, 1.0).acos()
        })
        .fold(f64::INFINITY, f64::min);
    let scale = HALF_MM[2];
    let cone = (nearest - PYRAMID_RAD * (1.15 - 0.25 * level)) * level * scale;
    smooth_max(
        smooth_max(cone, (level - 0.79) * scale, 4.0),
        1.2 - sinus().distance(p),
        2.0,
    )
}

/// Adds the kidney with its renal vein.
pub(super) fn add<B: Fn(&Point) -> u8 + Sync>(painting: &mut Painting<B>, seed: u64) {
    let body = *OUTLINE;
    let bounds = body.bounds();
    let hilum = body.centre + body.axes[1] * 30.0;
    let notch = Ellipsoid {
        centre: hilum,
        radii: [16.0, 10.0, 9.0],
        ..body
    };
    let kidney = Uneven {
        shape: Solid {
            bounds: Bounds { ..bounds },
            distance: move |p: &Point| smooth_max(body.distance(p), -notch.distance(p), 5.0),
        },
        noise: Noise::new(seed, 30, 22.0),
        amplitude_mm: 1.0,
    };
    let room = Over::only(&[
        l::PERITONEAL_FAT,
        l::MUSCLE,
        l::LIVER,
        l::BOWEL_WALL,
        l::BOWEL_CONTENT,
        l::GAS,
    ]);
    painting.add(Ellipsoid { ..body }, 4.0, l::PERITONEAL_FAT, room);
    painting.add(kidney, 0.0, l::KIDNEY_CORTEX, Over::only(&[l::PERITONEAL_FAT]));
    let cortex = Over::only(&[l::KIDNEY_CORTEX]);
    painting.add(
        Solid {
            bounds,
            distance: pyramids,
        },
        0.0,
        l::KIDNEY_MEDULLA,
        cortex,
    );
    let opening = Ellipsoid {
        centre: body.centre + body.axes[1] * 20.0,
        radii: [12.0, 12.0, 6.0],
        ..body
    };
    let core = sinus();
    painting.add(
        Uneven {
            shape: Solid {
                bounds,
                distance: move |p: &Point| smooth_min(core.distance(p), opening.distance(p), 4.0),
            },
            noise: Noise::new(seed, 31, 8.0),
            amplitude_mm: 1.8,
        },
        0.0,
        l::RENAL_SINUS,
        Over::only(&[l::KIDNEY_CORTEX, l::KIDNEY_MEDULLA]),
    );
    let vein = path(
        &[
            ([-21.0, 20.0, -32.0], 4.5),
            ([-34.0, 18.0, -36.0], 4.2),
            ([hilum.x, hilum.y, hilum.z], 3.6),
            ([hilum.x - 8.0, hilum.y + 5.0, hilum.z + 2.0], 2.4),
        ],
        4,
    );
    let course = Over::only(&[
        l::PERITONEAL_FAT,
        l::RENAL_SINUS,
        l::KIDNEY_CORTEX,
        l::VESSEL_WALL,
        l::BOWEL_WALL,
    ]);
    painting.add_all(&vein, 0.0, l::VESSEL, course);
}
