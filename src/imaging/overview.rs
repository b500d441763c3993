//! Overview picture of the probe against the anatomy.

use image::{Rgb, RgbImage, imageops};
use insonify_base::parallel::{chunks_mut, for_each};
use nalgebra::{Point3, Vector3};

use super::canvas::{self, Colour, Point};
use insonify_anatomy::volume::LabelVolume;
use insonify_tracking::needle::NeedlePose;
use insonify_tracking::pose::Pose;
use insonify_tracking::probe::BeamGrid;

/// Size of one view, pixels.
const PANEL: u32 = 360;
/// Gap between views, pixels.
const GAP: u32 = 6;
/// Fraction of a view left free around its content.
const MARGIN: f64 = 0.06;
/// Length of the drawn probe body behind the array, and its minimum half-width, as fractions of the view.
const BODY: [f64; 2] = [0.12, 0.03];
/// Largest drawn coordinate, mm, far beyond any body.
const FARTHEST_MM: f64 = 1e7;

const PAPER: Colour = [14, 16, 20];
const FRAME: Colour = [70, 76, 86];
const SECTOR: Colour = [255, 214, 64];
const BODY_FILL: Colour = [236, 239, 244];
const BODY_EDGE: Colour = [40, 44, 52];
const MARKER: Colour = [64, 220, 120];
const NEEDLE: Colour = [90, 215, 255];
const LETTER: Colour = [235, 238, 245];

/// One view: the world axes along its columns and rows, their signs, and the letters at its left, right, top and
/// bottom.
struct View {
    axes: [usize; 2],
    signs: [f64; 2],
    letters: [&'static str; 4],
}

/// Axial, coronal and sagittal in radiological convention: the patient's right on the left, anterior up or on the left,
/// the head up.
const VIEWS: [View; 3] = [
    View {
        axes: [0, 1],
        signs: [1.0, 1.0],
        letters: ["R", "L", "A", "P"],
    },
    View {
        axes: [0, 2],
        signs: [1.0, -1.0],
        letters: ["R", "L", "H", "F"],
    },
    View {
        axes: [1, 2],
        signs: [1.0, -1.0],
        letters: ["A", "P", "H", "F"],
    },
];

/// Geometry common to the three views: the point through which they cut, the centre, and the scale.
struct Frame {
    cut: Point3<f64>,
    middle: Vector3<f64>,
    mm_per_pixel: f64,
}

/// Draws three slices of a label volume (axial, coronal, sagittal, at one scale) through the middle of the probe's
/// field of view, with the outline of the field of view, the probe with a green dot at its marked side, and the needle
/// if there is one, all in orthographic projection. `colours` holds one sRGB colour per label index; an index beyond it
/// is drawn grey.
pub fn overview(
    volume: &LabelVolume,
    colours: &[[u8; 3]],
    pose: &Pose,
    beam: &BeamGrid,
    needle: Option<&NeedlePose>,
) -> RgbImage {
    let sector = in_world(pose, &beam.outline_mm(64));
    let frame = Frame::around(volume, pose, beam, &sector);
    let body = in_world(pose, &body_outline(beam, &frame));
    let marker = {
        let bounds = beam.bounds_mm();
        let edge = beam.to_plane(beam.lines() as f64 - 1.0, -0.5);
        // The body is drawn no narrower than a fixed part of the view: the dot of a small probe lies at that
        // edge, not inside it.
        let x = if beam.lines() > 1 { edge[0] } else { bounds.max[0] / 2.0 };
        let away = frame.mm_per_pixel * 6.0;
        in_world(
            pose,
            &[[x.max(frame.mm_per_pixel * f64::from(PANEL) * BODY[1]), edge[1] - away]],
        )
    };
    let mut picture = RgbImage::from_pixel(3 * PANEL + 4 * GAP, PANEL + 2 * GAP, Rgb(PAPER));
    for (number, view) in VIEWS.iter().enumerate() {
        let mut panel = slice(volume, colours, &frame, view);
        let flat = |points: &[Point3<f64>]| -> Vec<Point> { points.iter().map(|p| frame.project(view, p)).collect() };
        let outline = flat(&sector);
        canvas::fill(&mut panel, &outline, SECTOR, 0.16);
        canvas::outline(&mut panel, &outline, 1.6, SECTOR);
        let outline = flat(&body);
        canvas::fill(&mut panel, &outline, BODY_FILL, 0.9);
        canvas::outline(&mut panel, &outline, 1.4, BODY_EDGE);
        for centre in flat(&marker) {
            canvas::disc(&mut panel, centre, 4.6, BODY_EDGE);
            canvas::disc(&mut panel, centre, 3.6, MARKER);
        }
        if let Some(needle) = needle {
            for ends in needle.segments_mm() {
                let ends = ends.map(|end| frame.project(view, &end));
                canvas::line(&mut panel, ends, 3.6, BODY_EDGE, 0.7);
                canvas::line(&mut panel, ends, 1.8, NEEDLE, 1.0);
            }
            canvas::disc(&mut panel, frame.project(view, &needle.tip_mm()), 2.6, NEEDLE);
        }
        annotate(&mut panel, view);
        // One bar serves all three views, which share the scale.
        if number == 0 {
            scale_bar(&mut panel, frame.mm_per_pixel);
        }
        let left = GAP + number as u32 * (PANEL + GAP);
        imageops::replace(&mut picture, &panel, i64::from(left), i64::from(GAP));
    }
    picture
}

fn in_world(pose: &Pose, plane: &[[f64; 2]]) -> Vec<Point3<f64>> {
    let position = |&[x, y]: &[f64; 2]| pose.probe_to_world().transform_point(&Point3::new(x, y, 0.0));
    plane.iter().map(position).collect()
}

/// Outline of the probe's body in its plane: the array's curve, closed behind it; the complete round probe if the array
/// covers more than half of it.
fn body_outline(beam: &BeamGrid, frame: &Frame) -> Vec<[f64; 2]> {
    let side = frame.mm_per_pixel * f64::from(PANEL);
    if let Some(radius) = beam
        .virtual_apex_mm()
        .filter(|&radius| beam.rays()[0].origin[1] < -radius)
    {
        let turn = |step: u32| (f64::from(step) * std::f64::consts::TAU / 64.0).sin_cos();
        return (0..64)
            .map(turn)
            .map(|(sin, cos)| [radius * sin, radius * (cos - 1.0)])
            .collect();
    }
    let near: Vec<[f64; 2]> = beam.outline_mm(32).into_iter().take(33).collect();
    let half = near.iter().map(|p| p[0].abs()).fold(side * BODY[1], f64::max);
    let back = near.iter().map(|p| p[1]).fold(0.0, f64::min) - side * BODY[0];
    let shoulder = near.iter().map(|p| p[1]).fold(0.0, f64::min);
    let mut body = vec![
        [half * 0.55, back],
        [-half * 0.55, back],
        [-half, shoulder - side * 0.03],
        [-half, shoulder],
    ];
    body.extend(near);
    body.extend([[half, shoulder], [half, shoulder - side * 0.03]]);
    body
}

impl Frame {
    /// Frame around the volume and as much of the probe and its sector as lies within one volume's size of it.
    fn around(volume: &LabelVolume, pose: &Pose, beam: &BeamGrid, sector: &[Point3<f64>]) -> Self {
        let bounded = |p: Point3<f64>| p.coords.map(|x| x.clamp(-FARTHEST_MM, FARTHEST_MM));
        let mut low = Vector3::repeat(f64::INFINITY);
        let mut high = -low;
        let size = volume.size().map(|n| n as f64 - 0.5);
        for corner in 0..8 {
            let index = [0, 1, 2].map(|axis| if corner >> axis & 1 == 1 { size[axis] } else { -0.5 });
            let world = bounded(volume.index_to_world().transform_point(&Point3::from(index)));
            (low, high) = (low.inf(&world), high.sup(&world));
        }
        // A probe far off would shrink the volume to a dot: the frame reaches one volume's size beyond it at most.
        let room = (high - low).amax().max(1e-3);
        let (lower, upper) = (low.add_scalar(-room), high.add_scalar(room));
        let behind = pose
            .probe_to_world()
            .transform_point(&Point3::new(0.0, -0.15 * room, 0.0));
        for point in sector.iter().chain([&behind]) {
            let world = bounded(*point).sup(&lower).inf(&upper);
            (low, high) = (low.inf(&world), high.sup(&world));
        }
        let cut = pose
            .probe_to_world()
            .transform_point(&Point3::new(0.0, beam.depth_mm() / 2.0, 0.0));
        Self {
            cut,
            middle: (low + high) / 2.0,
            mm_per_pixel: (high - low).amax() / (f64::from(PANEL) * (1.0 - 2.0 * MARGIN)),
        }
    }

    fn project(&self, view: &View, world: &Point3<f64>) -> Point {
        [0, 1].map(|i| {
            let axis = view.axes[i];
            let offset = (world[axis] - self.middle[axis]) * view.signs[i] / self.mm_per_pixel;
            f64::from(PANEL - 1) / 2.0 + offset
        })
    }

    fn unproject(&self, view: &View, pixel: Point) -> Point3<f64> {
        let mut world = self.cut;
        for i in 0..2 {
            let offset = (pixel[i] - f64::from(PANEL - 1) / 2.0) * self.mm_per_pixel;
            world[view.axes[i]] = self.middle[view.axes[i]] + offset * view.signs[i];
        }
        world
    }
}

/// Colours of the labels in one plane, four samples per pixel.
fn slice(volume: &LabelVolume, colours: &[[u8; 3]], frame: &Frame, view: &View) -> RgbImage {
    let colour_at = |pixel: Point| match volume.label_index_at(&frame.unproject(view, pixel)) {
        Some(label) => colours.get(usize::from(label)).copied().unwrap_or([128; 3]),
        None => PAPER,
    };
    let mut bytes = vec![0; (PANEL * PANEL * 3) as usize];
    for_each((0.., chunks_mut(&mut bytes, (PANEL * 3) as usize)), &|(row, bytes)| {
        for (column, pixel) in bytes.chunks_exact_mut(3).enumerate() {
            let mut sum = [0u32; 3];
            for (dx, dy) in [(-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25)] {
                let colour = colour_at([column as f64 + dx, row as f64 + dy]);
                for (sum, part) in sum.iter_mut().zip(colour) {
                    *sum += u32::from(part);
                }
            }
            for (byte, sum) in pixel.iter_mut().zip(sum) {
                *byte = ((sum + 2) / 4) as u8;
            }
        }
    });
    RgbImage::from_raw(PANEL, PANEL, bytes).unwrap_or_else(|| RgbImage::new(PANEL, PANEL))
}

fn annotate(panel: &mut RgbImage, view: &View) {
    let last = f64::from(PANEL - 1);
    canvas::outline(panel, &[[0.0, 0.0], [last, 0.0], [last, last], [0.0, last]], 1.0, FRAME);
    let [width, height] = canvas::text_size("R", 2);
    let (middle_x, middle_y) = ((PANEL - width) / 2, (PANEL - height) / 2);
    let edge = 5;
    let places = [
        [edge, middle_y],
        [PANEL - edge - width, middle_y],
        [middle_x, edge],
        [middle_x, PANEL - edge - height],
    ];
    for (letter, corner) in view.letters.iter().zip(places) {
        canvas::text(panel, corner, letter, 2, LETTER);
    }
}

/// Draws a scale bar of the longest round length that takes at most a quarter of the view.
fn scale_bar(panel: &mut RgbImage, mm_per_pixel: f64) {
    let lengths = [
        ("200 mm", 200.0),
        ("100 mm", 100.0),
        ("50 mm", 50.0),
        ("20 mm", 20.0),
        ("10 mm", 10.0),
        ("5 mm", 5.0),
    ];
    let longest = f64::from(PANEL) / 4.0 * mm_per_pixel;
    let Some((name, length)) = lengths.into_iter().find(|(_, length)| *length <= longest) else {
        return;
    };
    let (left, bottom) = (10.0, f64::from(PANEL) - 10.0);
    let right = left + length / mm_per_pixel;
    canvas::line(panel, [[left, bottom], [right, bottom]], 4.0, [0; 3], 1.0);
    canvas::line(panel, [[left, bottom], [right, bottom]], 2.0, LETTER, 1.0);
    canvas::text(panel, [10, PANEL - 24], name, 1, LETTER);
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix4;

    use super::*;
    use insonify_anatomy::volume::Label;
    use insonify_tracking::probe::{Curvilinear, Linear, Phased, Probe, ProbeShape, TrusSagittal, TrusTransverse};

    const COLOURS: [[u8; 3]; 4] = [[0, 0, 0], [216, 180, 140], [180, 80, 70], [240, 235, 215]];

    /// A torso of ellipses with a liver on the patient's right and a spine behind, 3 mm voxels.
    fn torso() -> LabelVolume {
        let size = [120, 80, 100];
        let mut voxels = Vec::with_capacity(size.iter().product());
        for k in 0..size[2] {
            for j in 0..size[1] {
                for i in 0..size[0] {
                    let [x, y, z] = [i, j, k].map(|n| n as f64 * 3.0);
                    let ellipse = |centre: [f64; 3], radii: [f64; 3]| {
                        let at = [x, y, z];
                        (0..3).map(|a| ((at[a] - centre[a]) / radii[a]).powi(2)).sum::<f64>() < 1.0
                    };
                    let label = if ellipse([180.0, 175.0, z], [22.0, 20.0, 1.0]) {
                        3
                    } else if ellipse([110.0, 110.0, 180.0], [70.0, 60.0, 70.0]) {
                        2
                    } else {
                        u8::from(ellipse([180.0, 120.0, z], [165.0, 105.0, 1.0]))
                    };
                    voxels.push(label);
                }
            }
        }
        let labels = (0..4)
            .map(|value| Label {
                value,
                name: None,
                voxels: 0,
            })
            .collect();
        let place = Matrix4::new_translation(&Vector3::new(-180.0, -120.0, -150.0)) * Matrix4::new_scaling(3.0);
        LabelVolume::new(size, voxels, labels, place).expect("volume")
    }

    fn beam() -> BeamGrid {
        let shape = ProbeShape::Curvilinear(Curvilinear {
            radius_mm: 60.0,
            angle_deg: 70.0,
        });
        BeamGrid::new(&Probe::new(shape, 150.0).expect("probe")).expect("beam")
    }

    fn pose() -> Pose {
        let from_front = Pose::from_direction(Point3::new(-80.0, -98.0, 30.0), Vector3::new(0.1, 1.0, 0.0), None);
        from_front.expect("pose").turned(0.4, 0.0, 0.2)
    }

    #[test]
    fn views_show_anatomy_sector_marker_and_needle() {
        let needle = NeedlePose::straight(Point3::new(-60.0, -20.0, 30.0), Vector3::new(0.8, 1.0, 0.0), 150.0, 1.2);
        let needle = needle.expect("needle");
        let picture = overview(&torso(), &COLOURS, &pose(), &beam(), Some(&needle));
        if let Some(path) = std::env::var_os("INSONIFY_OVERVIEW") {
            picture.save(path).expect("saved");
        }
        assert_eq!(picture.dimensions(), (3 * PANEL + 4 * GAP, PANEL + 2 * GAP));
        for panel in 0..3 {
            let left = GAP + panel * (PANEL + GAP);
            let view = imageops::crop_imm(&picture, left, GAP, PANEL, PANEL).to_image();
            for colour in [SECTOR, MARKER, NEEDLE, BODY_FILL, COLOURS[1], COLOURS[2], LETTER] {
                let near = |pixel: &&Rgb<u8>| (0..3).all(|i| pixel.0[i].abs_diff(colour[i]) < 28);
                let count = view.pixels().filter(near).count();
                assert!(count > 8, "view {panel} lacks {colour:?}: {count}");
            }
        }
        assert_eq!(picture, overview(&torso(), &COLOURS, &pose(), &beam(), Some(&needle)));
    }

    #[test]
    fn the_patients_right_is_on_the_left_and_the_head_is_up() {
        let frame = Frame::around(&torso(), &pose(), &beam(), &[]);
        let right = frame.project(&VIEWS[0], &Point3::new(-100.0, -50.0, 80.0));
        let left = frame.project(&VIEWS[0], &Point3::new(100.0, 50.0, 0.0));
        assert!(right[0] < left[0] && right[1] < left[1]);
        for view in &VIEWS[1..] {
            let head = frame.project(view, &Point3::new(0.0, 0.0, 80.0));
            let feet = frame.project(view, &Point3::new(0.0, 0.0, 0.0));
            assert!(head[1] < feet[1]);
        }
        for view in &VIEWS {
            let there = frame.project(view, &frame.unproject(view, [13.0, 77.0]));
            assert!((there[0] - 13.0).abs() < 1e-9 && (there[1] - 77.0).abs() < 1e-9);
        }
    }

    #[test]
    fn a_probe_far_away_and_a_single_voxel_still_make_a_picture() {
        let label = Label {
            value: 0,
            name: None,
            voxels: 1,
        };
        let dot = LabelVolume::new([1, 1, 1], vec![0], vec![label], Matrix4::identity()).expect("volume");
        let far = Pose::from_direction(Point3::new(9e5, -9e5, 0.0), Vector3::y(), None).expect("pose");
        for (volume, pose) in [(&dot, &pose()), (&dot, &far), (&torso(), &far)] {
            let picture = overview(volume, &[], pose, &beam(), None);
            assert_eq!(picture.dimensions().1, PANEL + 2 * GAP);
        }
    }

    #[test]
    fn all_shapes_of_probe_are_drawn() {
        let shapes = [
            ProbeShape::Linear(Linear { width_mm: 40.0 }),
            ProbeShape::Phased(Phased { angle_deg: 90.0 }),
            ProbeShape::TrusTransverse(TrusTransverse {
                radius_mm: 10.0,
                angle_deg: 200.0,
            }),
            ProbeShape::TrusSagittal(TrusSagittal { length_mm: 60.0 }),
        ];
        for shape in shapes {
            let beam = BeamGrid::new(&Probe::new(shape, 60.0).expect("probe")).expect("beam");
            let picture = overview(&torso(), &COLOURS, &pose(), &beam, None);
            if let Some(path) = std::env::var_os("INSONIFY_OVERVIEW") {
                let name = format!(
                    "{}_{}.png",
                    path.to_string_lossy().trim_end_matches(".png"),
                    shape.kind()
                );
                picture.save(name).expect("saved");
            }
            assert!(picture.pixels().filter(|pixel| pixel.0 == MARKER).count() > 20);
        }
    }
}
