//! Stomach, pancreas, bowel with its gas, and the heart above the diaphragm.

use super::l;
use super::{Noise, Over, Painting, Point, Uneven};
use crate::phantom::geometry::{Ellipsoid, Tube, path};
use crate::random::noise::choice;

/// Thickness of the bowel wall, mm.
const BOWEL_WALL_MM: f64 = 2.2;
/// Thickness of the stomach wall, mm.
const STOMACH_WALL_MM: f64 = 4.0;

/// Adds the organs. Gas lies anteriorly, where it rises to in the supine position.
pub(super) fn add<B: Fn(&Point) -> u8 + Sync>(painting: &mut Painting<B>, seed: u64) {
    let free = Over::only(&[l::PERITONEAL_FAT]);
    let heart = Ellipsoid::upright([26.0, -24.0, 96.0], [52.0, 38.0, 38.0]);
    painting.add(heart, 0.0, l::HEART, Over::only(&[l::LUNG]));

    let pancreas = path(
        &[
            ([-24.0, -4.0, -44.0], 9.0),
            ([-20.0, -4.0, -28.0], 12.0),
            ([0.0, -10.0, -14.0], 8.5),
            ([30.0, -8.0, -2.0], 8.0),
            ([66.0, 12.0, 12.0], 7.5),
            ([90.0, 26.0, 20.0], 6.0),
        ],
        4,
    );
    for (i, piece) in pancreas.into_iter().enumerate() {
        let lobulated = Uneven {
            shape: piece,
            noise: Noise::new(seed, 50 + (i as u32 & 1), 7.0),
            amplitude_mm: 1.2,
        };
        painting.add(lobulated, 0.0, l::PANCREAS, free);
    }

    let stomach = path(
        &[
            ([92.0, 0.0, 52.0], 30.0),
            ([72.0, -22.0, 20.0], 26.0),
            ([48.0, -42.0, -14.0], 18.0),
            ([14.0, -46.0, -26.0], 14.0),
            ([-14.0, -32.0, -24.0], 11.0),
            ([-32.0, -18.0, -22.0], 8.0),
        ],
        5,
    );
    painting.add_all(&stomach, 0.0, l::STOMACH_WALL, free);
    painting.add_all(
        &stomach,
        -STOMACH_WALL_MM,
        l::BOWEL_CONTENT,
        Over::only(&[l::STOMACH_WALL]),
    );
    let bubble = Ellipsoid::upright([72.0, -44.0, 24.0], [34.0, 14.0, 30.0]);
    painting.add(bubble, 0.0, l::GAS, Over::only(&[l::BOWEL_CONTENT]));

    let duodenum = path(
        &[
            ([-34.0, -16.0, -20.0], 9.0),
            ([-44.0, 0.0, -26.0], 10.0),
            ([-42.0, 8.0, -52.0], 10.5),
            ([-32.0, 6.0, -66.0], 10.5),
            ([0.0, 0.0, -66.0], 10.0),
            ([28.0, 0.0, -54.0], 10.0),
        ],
        5,
    );
    loop_of_bowel(painting, &duodenum, 0.25, seed, 60);
    let colon = path(
        &[
            ([-104.0, 22.0, -135.0], 22.0),
            ([-104.0, 14.0, -104.0], 21.0),
            ([-98.0, -22.0, -92.0], 19.0),
            ([-70.0, -46.0, -104.0], 18.0),
            ([-30.0, -54.0, -92.0], 17.0),
            ([20.0, -54.0, -78.0], 17.0),
            ([62.0, -46.0, -62.0], 17.0),
            ([100.0, -30.0, -40.0], 17.0),
        ],
        6,
    );
    loop_of_bowel(painting, &colon, 0.62, seed, 70);
    for (i, course) in small_bowel(seed).iter().enumerate() {
        loop_of_bowel(painting, course, 0.35, seed, 80 + i as u32);
    }
}

/// Wall, content, and gas in a fraction of the segments.
fn loop_of_bowel<B: Fn(&Point) -> u8 + Sync>(
    painting: &mut Painting<B>,
    course: &[Tube],
    gas_share: f64,
    seed: u64,
    stream: u32,
) {
    painting.add_all(course, 0.0, l::BOWEL_WALL, Over::only(&[l::PERITONEAL_FAT]));
    let lumen = Over::only(&[l::BOWEL_WALL]);
    painting.add_all(course, -BOWEL_WALL_MM, l::BOWEL_CONTENT, lumen);
    for (i, piece) in course.iter().enumerate() {
        if choice(seed, stream, [i as i32, 0]) < gas_share {
            let [a, b] = piece.ends;
            let radius = 0.5 * (piece.radii[0] + piece.radii[1]);
            let reach = (0.5 * (b - a).norm() + 2.0).max(0.5 * radius);
            let middle = (a + b) / 2.0;
            let pocket = Ellipsoid::upright(
                [middle.x, middle.y - 0.42 * radius, middle.z],
                [reach, 0.45 * radius, reach],
            );
            painting.add(pocket, 0.0, l::GAS, Over::only(&[l::BOWEL_CONTENT]));
        }
    }
}

/// Hairpin loops of small bowel below the pancreas and behind the transverse colon.
fn small_bowel(seed: u64) -> Vec<Vec<Tube>> {
    [[-32.0, -70.0], [-6.0, -96.0], [-36.0, -116.0], [-10.0, -136.0]]
        .iter()
        .enumerate()
        .map(|(row, [y, z])| {
            let jitter = |i: i32, which: i32| 9.0 * (choice(seed, 90 + row as u32, [i, which]) - 0.5);
            let knots: Vec<([f64; 3], f64)> = (0..16)
                .map(|i| {
                    let limb = i / 2;
                    let up = (i % 2 == 0) == (limb % 2 == 0);
                    let x = -58.0 + 23.0 * f64::from(limb);
                    let along = if up { 15.0 } else { -15.0 };
                    ([x + jitter(i, 0), y + jitter(i, 1), z + along + jitter(i, 2)], 11.5)
                })
                .collect();
            path(&knots, 3)
        })
        .collect()
}
