//! The image moves with the tissue: patches of frames, tracked by correlation, go where the mechanics say, to a tenth
//! of a pixel, through a deforming mesh whose reference nodes move too.

use insonify_base::random::{hash3, unit};
use insonify_imaging::effects::Effects;
use insonify_imaging::effects::speckle::Speckle;
use insonify_imaging::effects::tone::Tone;
use insonify_imaging::synth::tables::{Anatomy, Settings};
use insonify_imaging::synth::{Frame, FrameState, Synthesizer};
use insonify_mesh::TetMesh;
use insonify_tracking::probe::{Linear, ProbeShape};
use nalgebra::{Matrix3, Vector3};

use crate::support::anatomy::{self, Acoustics, PLAIN};
use crate::support::scene;
use crate::support::scene::{precisions, synthesizer};

/// Largest difference between what is tracked and what the mechanics say, pixels. The shift that fits best is the mean
/// over the patch of the displacement, weighted by squared grey gradients. With some 80 independent speckles, or grains
/// of texture, in the patch these weights shift its centre by a twelfth of its width of 50 pixels (two and a half
/// deviations); times a strain of 1.5 % that is 0.06 pixels. Interpolation between pixels, four to a speckle, adds a
/// hundredth or two.
const TOLERANCE_PIXELS: f64 = 0.1;

/// Half the side of a patch, and the largest shift looked for, pixels.
const HALF: i64 = 25;
const REACH: i64 = 18;

const SIDE: usize = 300;

fn settings(effects: Effects) -> Settings {
    // Scanlines every 0.2 mm, samples every 0.1 mm, pixels of 0.2 mm.
    let probe = scene::probe(ProbeShape::Linear(Linear { width_mm: 60.0 }), 60.0, 301, 600);
    let mut settings = scene::sized(probe, effects, SIDE, SIDE);
    settings.image.margin = 0.0;
    settings
}

/// What is seen: speckle alone, and texture alone.
fn patterns() -> [(&'static str, Anatomy, Settings); 2] {
    let tone = Some(Tone::default());
    let speckle = Effects {
        speckle: Some(Speckle {
            axial_mm: Some(0.8),
            lateral_mm: Some(1.5),
            elevational_mm: Some(1.8),
            focal_zone_mm: Some(10_000.0),
            ..Speckle::default()
        }),
        tone: tone.clone(),
        ..scene::bare()
    };
    let texture = Effects {
        texture: Some(Default::default()),
        tone,
        ..scene::bare()
    };
    let textured = Acoustics {
        texture: Some("hashed"),
        ..PLAIN
    };
    let meshed = |tissue| {
        let around = [[-50.0, -25.0, -30.0], [50.0, 85.0, 30.0]];
        anatomy::with_mesh(anatomy::uniform(tissue), around, 4000)
    };
    let mut hashed = meshed(textured);
    hashed.textures.insert("hashed".into(), anatomy::hashed_texture());
    [
        ("speckle", meshed(PLAIN), settings(speckle)),
        ("texture", hashed, settings(texture)),
    ]
}

/// A smooth displacement of some 3 mm in the plane, mm; strains up to 1.5 %.
fn field([x, y, z]: [f64; 3]) -> [f64; 3] {
    let wave = |phase: f64| (phase * std::f64::consts::TAU).sin();
    [
        2.13 + 0.2 * wave(y / 90.0 + 0.1) + 0.1 * wave(x / 70.0),
        -1.61 + 0.15 * wave((x + y) / 100.0) + 0.1 * wave(z / 80.0),
        0.0,
    ]
}

/// Reference nodes with three of four inside the mesh moved by up to 1.2 mm along each axis.
fn remeshed(mesh: &TetMesh) -> Vec<[f64; 3]> {
    let [low, high] = mesh.bounds();
    let nodes = mesh.nodes().iter().enumerate();
    nodes
        .map(|(index, node)| {
            let inside = (0..3).all(|axis| node[axis] > low[axis] + 1e-6 && node[axis] < high[axis] - 1e-6);
            let amount = if inside && index % 4 != 0 { 1.2 } else { 0.0 };
            std::array::from_fn(|axis| {
                let drawn = f64::from(unit(hash3([index as i32, axis as i32, 1], [7, 9])[0]));
                node[axis] + amount * (2.0 * drawn - 1.0)
            })
        })
        .collect()
}

fn displaced(nodes: &[[f64; 3]]) -> Vec<[f64; 3]> {
    let moved = nodes
        .iter()
        .map(|&node| Vector3::from(node) + Vector3::from(field(node)));
    moved.map(Into::into).collect()
}

/// Both states of a mesh, as the mechanics have them.
#[derive(Clone)]
struct Mesh<'a> {
    elements: &'a [[u32; 4]],
    reference: Vec<[f64; 3]>,
    current: Vec<[f64; 3]>,
}

impl Mesh<'_> {
    fn state(&self) -> FrameState {
        FrameState {
            nodes: Some(self.current.clone()),
            reference: Some(self.reference.clone()),
            ..scene::straight()
        }
    }

    /// Where tissue is now that is at `p` in the reference state: linear in the element that holds it.
    fn now(&self, p: Vector3<f64>) -> Vector3<f64> {
        for corners in self.elements {
            let of = |nodes: &[[f64; 3]]| corners.map(|node| Vector3::from(nodes[node as usize]));
            let [a, b, c, d] = of(&self.reference);
            let edges = Matrix3::from_columns(&[b - a, c - a, d - a]);
            let to = edges.try_inverse().expect("an element with a volume") * (p - a);
            if to.min() >= -1e-9 && to.sum() <= 1.0 + 1e-9 {
                let [a, b, c, d] = of(&self.current);
                return a + Matrix3::from_columns(&[b - a, c - a, d - a]) * to;
            }
        }
        panic!("{p:?} lies in no element");
    }

    /// Mean over a patch of a frame of how tissue that is there in the reference state has moved, pixels.
    fn shift(&self, frame: &Frame, centre: [i64; 2]) -> [f64; 2] {
        let mut sum = Vector3::zeros();
        let steps = 6;
        for at in 0..(steps + 1) * (steps + 1) {
            let place = |axis: usize, step: i64| (centre[axis] - HALF) as f64 + (2 * HALF * step) as f64 / steps as f64;
            let pixel = [place(0, at % (steps + 1)), place(1, at / (steps + 1)), 0.0];
            let world = frame.image_to_world.transform_point(&pixel.into()).coords;
            sum += self.now(world) - world;
        }
        let mean = sum / ((steps + 1) * (steps + 1)) as f64;
        // The probe is at the origin of the world: columns along x, rows along y.
        [mean.x / frame.pixel_mm, mean.y / frame.pixel_mm]
    }
}

/// Grey level between pixels, by cubic convolution (Keys, IEEE Trans. Acoust. Speech Signal Process. 29(6), 1981).
fn grey(frame: &Frame, x: f64, y: f64) -> f64 {
    if x.fract() == 0.0 && y.fract() == 0.0 {
        return f64::from(frame.pixels[y as usize * frame.width + x as usize]);
    }
    let weights = |t: f64| {
        let (t2, t3) = (t * t, t * t * t);
        [
            0.5 * (-t3 + 2.0 * t2 - t),
            0.5 * (3.0 * t3 - 5.0 * t2 + 2.0),
            0.5 * (-3.0 * t3 + 4.0 * t2 + t),
            0.5 * (t3 - t2),
        ]
    };
    let (wx, wy) = (weights(x - x.floor()), weights(y - y.floor()));
    let mut sum = 0.0;
    for (row, wy) in wy.iter().enumerate() {
        for (column, wx) in wx.iter().enumerate() {
            let at = (y.floor() as usize + row - 1) * frame.width + x.floor() as usize + column - 1;
            sum += wx * wy * f64::from(frame.pixels[at]);
        }
    }
    sum
}

/// Correlation coefficient of a patch of `before` with the same patch of `after` moved by `shift`.
fn correlation(before: &Frame, after: &Frame, centre: [i64; 2], shift: [f64; 2]) -> f64 {
    let [mut a, mut b, mut aa, mut bb, mut ab] = [0.0; 5];
    for row in centre[1] - HALF..=centre[1] + HALF {
        for column in centre[0] - HALF..=centre[0] + HALF {
            let p = f64::from(before.pixels[row as usize * before.width + column as usize]);
            let q = grey(after, column as f64 + shift[0], row as f64 + shift[1]);
            (a, b, aa, bb, ab) = (a + p, b + q, aa + p * p, bb + q * q, ab + p * q);
        }
    }
    let n = ((2 * HALF + 1) * (2 * HALF + 1)) as f64;
    (ab - a * b / n) / ((aa - a * a / n) * (bb - b * b / n)).sqrt()
}

/// Where a patch of `before` is found in `after`, pixels, and how well. A parabola through the correlation at whole
/// pixels is biased towards them; so it is fitted again and again about the last peak, with correlations between pixels
/// and steps that halve.
fn track(before: &Frame, after: &Frame, centre: [i64; 2]) -> ([f64; 2], f64) {
    let lags = (-REACH..=REACH).flat_map(|y| (-REACH..=REACH).map(move |x| [x as f64, y as f64]));
    let (_, mut shift) = lags
        .map(|lag| (correlation(before, after, centre, lag), lag))
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .expect("lags");
    let mut step = 1.0;
    while step > 0.02 {
        for axis in [0, 1] {
            let at = |offset: f64| {
                let mut moved = shift;
                moved[axis] += offset;
                correlation(before, after, centre, moved)
            };
            let [low, middle, high] = [-step, 0.0, step].map(at);
            let bend = low - 2.0 * middle + high;
            if bend < 0.0 {
                shift[axis] += (0.5 * step * (low - high) / bend).clamp(-step, step);
            }
        }
        step *= 0.5;
    }
    (shift, correlation(before, after, centre, shift))
}

const PATCHES: [[i64; 2]; 4] = [[80, 90], [215, 85], [90, 210], [205, 200]];

/// Renders two states and compares the shifts tracked between them with those of the mechanics.
fn compare(name: &str, synthesizer: &mut Synthesizer, before: &Mesh, after: &Mesh) {
    let [first, second] = [before, after].map(|mesh| synthesizer.render(&mesh.state()).expect("a frame").clone());
    for centre in PATCHES {
        let (shift, fit) = track(&first, &second, centre);
        let (from, to) = (before.shift(&first, centre), after.shift(&first, centre));
        let expected = [to[0] - from[0], to[1] - from[1]];
        let off = [shift[0] - expected[0], shift[1] - expected[1]];
        println!("{name} at {centre:?}: {shift:.3?} of {expected:.3?} pixels, off by {off:.3?}; correlation {fit:.3}");
        assert!(fit > 0.8, "{name} at {centre:?}: correlation {fit}");
        for (axis, off) in ["laterally", "axially"].into_iter().zip(off) {
            assert!(
                off.abs() < TOLERANCE_PIXELS,
                "{name} at {centre:?}: off by {off} pixels {axis}"
            );
        }
    }
}

#[test]
fn a_patch_follows_the_mechanics_to_a_tenth_of_a_pixel() {
    for (pattern, anatomy, settings) in patterns() {
        let mesh = anatomy.mesh.clone().expect("a mesh");
        let rest = Mesh {
            elements: mesh.elements(),
            reference: mesh.nodes().to_vec(),
            current: mesh.nodes().to_vec(),
        };
        let moved = Mesh {
            current: displaced(&rest.reference),
            ..rest.clone()
        };
        let reference = remeshed(&mesh);
        let remeshed = Mesh {
            current: displaced(&reference),
            reference,
            ..rest.clone()
        };
        for (precision, backend) in precisions() {
            let mut synthesizer = synthesizer(&anatomy, &settings, backend);
            let name = |what: &str| format!("{precision}, {pattern}, {what}");
            compare(&name("deformed"), &mut synthesizer, &rest, &moved);
            compare(&name("deformed and remeshed"), &mut synthesizer, &rest, &remeshed);
            // Remeshing of deformed tissue, which stays where it is but for the error of linear elements.
            compare(&name("remeshed alone"), &mut synthesizer, &moved, &remeshed);
        }
    }
}
