//! Liver with its veins and a lesion, gallbladder, and the great vessels.

use super::wall::{CAVITY_MM, diaphragm, skin_depth};
use super::{Noise, Over, Painting, Point, Uneven, l};
use crate::phantom::geometry::{Bounds, Ellipsoid, Shape, Solid, Tube, path, smooth_max};
use crate::phantom::vessels::Growth;

/// Radius of the thinnest vessels drawn, mm.
const THINNEST_MM: f64 = 1.15;
/// Thickness of the bright wall of portal branches (with the tissue of their sheath), mm.
const PORTAL_WALL_MM: f64 = 1.3;
/// The target: an 18 mm lesion of the right lobe.
const LESION: ([f64; 3], f64) = ([-72.0, -14.0, 22.0], 9.0);

/// Signed distance of the unperturbed liver: a wedge under the diaphragm, thick on the right and thin on the left.
fn liver(p: &Point) -> f64 {
    let under_wall = (CAVITY_MM - skin_depth(p)).max(diaphragm(p) + 2.2);
    let visceral = -46.0 + 0.48 * (p.x + 80.0) + 0.36 * p.y;
    let from_below = 0.85 * (visceral - p.z);
    let from_behind = 0.63 * (p.x + 40.0) + 0.78 * (p.y - 40.0);
    let from_left = 0.95 * (p.x - 60.0) + 0.3 * (p.z - 40.0);
    let far_back = p.y - 67.0;
    let lobe = smooth_max(
        smooth_max(under_wall, from_below, 22.0),
        smooth_max(smooth_max(from_behind, far_back, 14.0), from_left, 14.0),
        14.0,
    );
    smooth_max(lobe, 5.0 - super::KIDNEY.distance(p), 4.0)
}

/// Adds the liver and its structures, then the great vessels.
pub(super) fn add<B: Fn(&Point) -> u8 + Sync>(painting: &mut Painting<B>, seed: u64) {
    let bounds = Bounds {
        min: Point::new(-135.0, -85.0, -80.0),
        max: Point::new(75.0, 75.0, 98.0),
    };
    let surface = Noise::new(seed, 10, 34.0);
    let uneven = move || Uneven {
        shape: Solid {
            bounds,
            distance: liver,
        },
        noise: surface,
        amplitude_mm: 3.5,
    };
    painting.add(uneven(), 0.0, l::LIVER, Over::only(&[l::PERITONEAL_FAT]));
    let (centre, radius) = LESION;
    let lesion = Uneven {
        shape: Ellipsoid::upright(centre, [radius, 0.95 * radius, 1.05 * radius]),
        noise: Noise::new(seed, 11, 7.0),
        amplitude_mm: 1.1,
    };
    // Branches keep off this ball, larger than the lesion by a margin for its uneven surface.
    let ball = Tube {
        ends: [Point::from(centre); 2],
        radii: [radius + 1.5; 2],
    };
    let ligament = path(
        &[
            ([4.0, -66.0, 12.0], 3.0),
            ([3.0, -48.0, 24.0], 3.5),
            ([-2.0, -28.0, 34.0], 3.0),
        ],
        4,
    );
    painting.add_all(&ligament, 0.0, l::LIGAMENT, Over::only(&[l::LIVER]));

    let gallbladder = gallbladder();
    let trees = Trees::grow(seed, &|p| uneven().distance(p), &ball, &gallbladder);
    let around = Over::only(&[l::LIVER, l::PERITONEAL_FAT, l::LIGAMENT, l::PANCREAS]);
    // Only portal branches get a wall that echoes: hepatic veins are told from them by its absence.
    painting.add_all(&trees.portal, PORTAL_WALL_MM, l::VESSEL_WALL, around);
    let within = Over::only(&[l::LIVER, l::PERITONEAL_FAT, l::VESSEL_WALL, l::LIGAMENT, l::PANCREAS]);
    painting.add_all(&trees.portal, 0.0, l::VESSEL, within);
    painting.add_all(&trees.hepatic, 0.0, l::VESSEL, within);
    painting.add(lesion, 0.0, l::LESION, Over::only(&[l::LIVER]));
    great_vessels(painting);

    let room = Over::only(&[
        l::LIVER,
        l::PERITONEAL_FAT,
        l::VESSEL_WALL,
        l::BOWEL_WALL,
        l::BOWEL_CONTENT,
        l::GAS,
    ]);
    painting.add_all(&gallbladder, 1.8, l::GALLBLADDER_WALL, room);
    painting.add_all(&gallbladder, 0.0, l::BILE, Over::only(&[l::GALLBLADDER_WALL]));
}

/// A pear shape from the neck at the hilum of the liver to the fundus below its edge.
fn gallbladder() -> Vec<Tube> {
    path(
        &[
            ([-52.0, 10.0, 8.0], 2.2),
            ([-58.0, 4.0, 3.0], 4.5),
            ([-65.0, -8.0, -10.0], 10.5),
            ([-72.0, -24.0, -26.0], 14.0),
            ([-76.0, -34.0, -37.0], 14.5),
        ],
        4,
    )
}

fn hepatic_trunks() -> [Vec<Tube>; 3] {
    [
        path(
            &[
                ([-22.0, 14.0, 66.0], 7.0),
                ([-48.0, 14.0, 60.0], 6.0),
                ([-74.0, 16.0, 44.0], 5.2),
            ],
            3,
        ),
        path(
            &[
                ([-22.0, 10.0, 66.0], 6.5),
                ([-36.0, -8.0, 58.0], 5.6),
                ([-50.0, -22.0, 42.0], 5.0),
            ],
            3,
        ),
        path(
            &[
                ([-18.0, 8.0, 64.0], 5.5),
                ([-4.0, -14.0, 56.0], 4.8),
                ([10.0, -30.0, 48.0], 4.2),
            ],
            3,
        ),
    ]
}

fn portal_trunks() -> [Vec<Tube>; 3] {
    [
        path(
            &[
                ([-46.0, 1.0, 20.0], 5.6),
                ([-62.0, 6.0, 22.0], 5.0),
                ([-78.0, 12.0, 16.0], 4.4),
            ],
            3,
        ),
        path(
            &[
                ([-46.0, 1.0, 20.0], 5.0),
                ([-58.0, -12.0, 10.0], 4.6),
                ([-72.0, -30.0, 4.0], 4.2),
            ],
            3,
        ),
        path(
            &[
                ([-44.0, 1.0, 18.0], 4.8),
                ([-24.0, -12.0, 28.0], 4.4),
                ([-2.0, -20.0, 36.0], 4.0),
            ],
            3,
        ),
    ]
}

/// Venous trees of the liver.
struct Trees {
    hepatic: Vec<Tube>,
    portal: Vec<Tube>,
}

impl Trees {
    fn grow(seed: u64, organ: &dyn Fn(&Point) -> f64, lesion: &Tube, gallbladder: &[Tube]) -> Self {
        let (hepatic_trunks, portal_trunks) = (hepatic_trunks(), portal_trunks());
        let main_portal = path(
            &[
                ([-2.0, 8.0, -28.0], 6.5),
                ([-18.0, 6.0, -8.0], 6.5),
                ([-36.0, 2.0, 12.0], 6.5),
                ([-46.0, 1.0, 20.0], 6.0),
            ],
            4,
        );
        let mut avoid = vec![*lesion];
        avoid.extend(gallbladder);
        avoid.extend(hepatic_trunks.iter().flatten());
        avoid.extend(portal_trunks.iter().flatten());
        let mut portal = main_portal;
        portal.extend(portal_trunks.iter().flatten());
        let mut hepatic: Vec<Tube> = hepatic_trunks.iter().flatten().copied().collect();
        for (kind, trunks) in [(0, &portal_trunks), (1, &hepatic_trunks)] {
            for (i, trunk) in trunks.iter().enumerate() {
                let Some(last) = trunk.last() else { continue };
                // Each tree avoids those grown before it and every trunk but its own, at whose end it begins.
                let growth = Growth {
                    organ,
                    avoid: &others(&avoid, trunk),
                    thinnest_mm: THINNEST_MM,
                    seed,
                    stream: 20 + 4 * kind + i as u32,
                };
                let tree = growth.from(last);
                avoid.extend(&tree);
                if kind == 0 { &mut portal } else { &mut hepatic }.extend(tree);
            }
        }
        Self { hepatic, portal }
    }
}

/// All tubes except those of one trunk: a tree may start where its own trunk ends.
fn others(all: &[Tube], trunk: &[Tube]) -> Vec<Tube> {
    all.iter()
        .filter(|tube| !trunk.iter().any(|part| part.ends == tube.ends))
        .copied()
        .collect()
}

/// Inferior vena cava and aorta with its first branches.
fn great_vessels<B: Fn(&Point) -> u8 + Sync>(painting: &mut Painting<B>) {
    let cava = path(
        &[
            ([-20.0, 24.0, -125.0], 10.5),
            ([-20.0, 22.0, -60.0], 10.5),
            ([-22.0, 20.0, 0.0], 11.0),
            ([-22.0, 16.0, 60.0], 11.5),
            ([-16.0, 8.0, 92.0], 11.5),
        ],
        6,
    );
    let aorta = path(
        &[
            ([8.0, 20.0, -125.0], 8.0),
            ([9.0, 18.0, -60.0], 8.5),
            ([10.0, 18.0, 0.0], 9.5),
            ([8.0, 20.0, 60.0], 10.5),
            ([6.0, 24.0, 115.0], 11.0),
        ],
        6,
    );
    let mesenteric = path(
        &[
            ([10.0, 8.0, 4.0], 3.4),
            ([9.0, -6.0, -8.0], 3.4),
            ([6.0, -10.0, -30.0], 3.2),
            ([2.0, -14.0, -70.0], 2.6),
        ],
        5,
    );
    let soft = Over::only(&[
        l::PERITONEAL_FAT,
        l::LIVER,
        l::DIAPHRAGM,
        l::LUNG,
        l::HEART,
        l::MUSCLE,
        l::PANCREAS,
        l::BOWEL_WALL,
        l::BOWEL_CONTENT,
        l::GAS,
    ]);
    // All walls before all lumens: where the artery leaves the aorta, its lumen opens the walls of both.
    painting.add_all(&cava, 0.8, l::VESSEL_WALL, soft);
    painting.add_all(&aorta, 1.6, l::VESSEL_WALL, soft);
    painting.add_all(&mesenteric, 1.2, l::VESSEL_WALL, soft);
    for vessel in [cava, aorta, mesenteric] {
        painting.add_all(&vessel, 0.0, l::VESSEL, Over::only(&[l::VESSEL_WALL, l::LIVER]));
    }
}
