//! `insonify beam measure` and `compare` on synthetic CT: volumes painted from solved needles, with slices of 0.5 mm
//! and markers out of place by 0.1 mm (stage) and 0.2 mm (container), as Wang et al. 2023 (section III-B) measured
//! theirs: they were built so, the same in all scans.

use insonify_mechanics::needle::beam::material::Ogden;
use insonify_mechanics::needle::beam::{
    Base, BeamLayer, Compression, FoundationBeam, Material, Problem, Shape, bending_stiffness_nmm2,
};
use insonify_study::beam::measure::{SYNTHETIC_CONTAINER_MM, SYNTHETIC_STAGE_MM};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use serde_json::Value;

use crate::support::Bench;

/// Sizes of the markers, mm.
const DIAMETERS: [f64; 2] = [3.0, 2.0];
const CONTROL_MM: f64 = 40.0;
const DEPTH_MM: f64 = 60.0;
const VOXEL_MM: f64 = 0.5;
/// Voxels, and the corner of the volume in the frame of the container, mm.
const SIZE: [usize; 3] = [156, 176, 260];
const CORNER: [f64; 3] = [-60.0, -44.0, -36.0];

const TISSUE: &str = "\
[needle]
young_gpa = 200.0
diameter_mm = 1.0
[base]
control_distance_mm = 1.0
displacement_mm = 0.0
pivot_mm = 10.0
[[layer]]
thickness_mm = 55.0
model = \"ogden\"
mu_kpa = 3.63
alpha = 8.74
compression = \"UTru\"
initial_length_mm = 50.0
";

/// Needle in porcine muscle, moved by a free base.
fn needle(displacement_mm: f64) -> Shape {
    let problem = Problem {
        bending_nmm2: bending_stiffness_nmm2(200.0, 1.0),
        control_distance_mm: CONTROL_MM,
        pivot_mm: 0.0,
        inserted_mm: DEPTH_MM,
        layers: vec![BeamLayer {
            thickness_mm: DEPTH_MM,
            material: Material::Ogden(Ogden {
                mu_kpa: 3.63,
                alpha: 8.74,
            }),
            compression: Compression::UTru,
            initial_length_mm: 50.0,
            friction: 0.0,
            least_ratio: 0.0,
        }],
        element_mm: 1.0,
    };
    let mut beam = FoundationBeam::new(&problem).expect("a problem");
    let slope = None;
    beam.solve(&Base { displacement_mm, slope }).expect("a shape")
}

/// Numbers of mean 0 and deviation 1: the sum of twelve of a linear congruence (Knuth's MMIX).
struct Normal(u64);

impl Normal {
    fn next(&mut self) -> f64 {
        let sum: f64 = (0..12)
            .map(|_| {
                self.0 = self
                    .0
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1_442_695_040_888_963_407);
                (self.0 >> 11) as f64 / (1u64 << 53) as f64
            })
            .sum();
        sum - 6.0
    }

    /// A displacement whose length is `mm` in the mean square.
    fn vector(&mut self, mm: f64) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.next()) * (mm / 3.0f64.sqrt())
    }
}

/// A CT of a needle, in Hounsfield units.
struct Ct {
    data: Vec<i16>,
    to_world: Isometry3<f64>,
}

impl Ct {
    /// Paints needle and markers, out of place by the numbers of a seed; `left_out` counts markers of container and
    /// stage.
    fn of(shape: &Shape, left_out: &[usize], seed: u64) -> Self {
        let mut noise = Normal(seed);
        // The container lies askew in the scanner, the needle along its axis but for a few degrees.
        let tilt = UnitQuaternion::from_euler_angles(0.03, -0.02, 0.04);
        let upright = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), -std::f64::consts::FRAC_PI_2);
        let to_world = Isometry3::from_parts(Translation3::new(20.0, -130.0, 700.0), tilt * upright);
        let mut ct = Self {
            data: vec![40; SIZE.iter().product()],
            to_world,
        };
        let base = &shape.points[0];
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), base.slope.atan());
        let stage = Isometry3::from_parts(Translation3::new(base.x_mm, base.u_mm, 0.0), turn);
        let container = SYNTHETIC_CONTAINER_MM.map(|place| (Point3::from(place), DIAMETERS[0], 0.2));
        let stage = SYNTHETIC_STAGE_MM.map(|place| (stage * Point3::from(place), DIAMETERS[1], 0.1));
        let markers = container.into_iter().chain(stage).enumerate();
        for (at, (centre, diameter, off)) in markers {
            let centre = centre + noise.vector(off);
            if !left_out.contains(&at) {
                let radius = 0.5 * diameter;
                ct.paint(centre, radius, &|p| (p - centre).norm() <= radius);
            }
        }
        let deflection = |x: f64| {
            let [u, slope] = shape.at(x.max(base.x_mm));
            (u + slope * (x - x.max(base.x_mm)), slope)
        };
        let inside = |p: &Point3<f64>| {
            let (u, slope) = deflection(p.x);
            p.x <= DEPTH_MM && ((p.y - u) * slope.atan().cos()).hypot(p.z) <= 0.5
        };
        for step in 0..=2 * (DEPTH_MM + CONTROL_MM + 8.0) as i32 {
            let x = 0.5 * f64::from(step) - CONTROL_MM - 8.0;
            ct.paint(Point3::new(x, deflection(x).0, 0.0), 1.0, &inside);
        }
        ct
    }

    /// Centre of a voxel in the frame of the container; slices lie across the third axis.
    fn centre(&self, index: [usize; 3]) -> Point3<f64> {
        // Along the axes of the world, about the place of the container.
        let rest = Isometry3::from_parts(self.to_world.translation, self.upright());
        let corner = rest * Point3::new(CORNER[0], CORNER[1], -CORNER[2]);
        let world = corner + Vector3::from(index.map(|i| i as f64 * VOXEL_MM));
        self.to_world.inverse() * world
    }

    fn upright(&self) -> UnitQuaternion<f64> {
        UnitQuaternion::from_axis_angle(&Vector3::y_axis(), -std::f64::consts::FRAC_PI_2)
    }

    /// Fills voxels within `reach` mm of a point by the share of them that is inside.
    fn paint(&mut self, about: Point3<f64>, reach: f64, inside: &dyn Fn(&Point3<f64>) -> bool) {
        let first = self.centre([0; 3]);
        let axes = [0, 1, 2].map(|axis| {
            let mut index = [0; 3];
            index[axis] = 1;
            self.centre(index) - first
        });
        let middle = axes.map(|axis| (about - first).dot(&axis) / (VOXEL_MM * VOXEL_MM));
        let margin = reach / VOXEL_MM + 1.0;
        let range = |axis: usize| {
            let (low, high) = ((middle[axis] - margin).floor().max(0.0), (middle[axis] + margin).ceil());
            low as usize..(high.max(0.0) as usize).min(SIZE[axis])
        };
        for z in range(2) {
            for y in range(1) {
                for x in range(0) {
                    let centre = first + axes[0] * x as f64 + axes[1] * y as f64 + axes[2] * z as f64;
                    let mut filled = 0;
                    for part in 0..64 {
                        let at = |axis: u32| f64::from(part / 4i32.pow(axis) % 4) / 4.0 - 0.375;
                        filled += i32::from(inside(&(centre + axes[0] * at(0) + axes[1] * at(1) + axes[2] * at(2))));
                    }
                    let value = &mut self.data[(z * SIZE[1] + y) * SIZE[0] + x];
                    *value = (*value).max((40 + filled * 46) as i16);
                }
            }
        }
    }

    fn write(&self, bench: &Bench, name: &str) {
        let rest = Isometry3::from_parts(self.to_world.translation, self.upright());
        let corner = rest * Point3::new(CORNER[0], CORNER[1], -CORNER[2]);
        let header = format!(
            "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nTransformMatrix = 1 0 0 0 1 0 0 0 1\n\
             Offset = {} {} {}\nElementSpacing = {VOXEL_MM} {VOXEL_MM} {VOXEL_MM}\nDimSize = {} {} {}\nElementType = MET_SHORT\n\
             ElementDataFile = LOCAL\n",
            corner.x, corner.y, corner.z, SIZE[0], SIZE[1], SIZE[2]
        );
        let data = self.data.iter().flat_map(|value| value.to_le_bytes());
        let bytes: Vec<u8> = header.into_bytes().into_iter().chain(data).collect();
        std::fs::write(bench.path(name), bytes).expect("written");
    }
}

/// Puts a volume or the design of its markers, by the name that the docs give it, into a folder if it is to be read.
/// False if they have no such name.
pub(crate) fn bring(bench: &Bench, name: &str, is_read: bool) -> bool {
    if name == "design.csv" {
        bench.write(name, &design());
        return true;
    }
    let displacement = ["rest", "moved_1", "moved_2"]
        .iter()
        .position(|stem| name.strip_suffix(".nii.gz") == Some(stem));
    if let Some(at) = displacement.filter(|_| is_read) {
        Ct::of(&needle(7.5 * at as f64), &[], 1).write(bench, name);
    }
    displacement.is_some()
}

fn design() -> String {
    let row =
        |body: &'static str, diameter: f64| move |[x, y, z]: &[f64; 3]| format!("{body},{diameter},{x},{y},{z}\n");
    let rows: String = SYNTHETIC_CONTAINER_MM
        .iter()
        .map(row("container", DIAMETERS[0]))
        .collect();
    let rows = rows
        + &SYNTHETIC_STAGE_MM
            .iter()
            .map(row("stage", DIAMETERS[1]))
            .collect::<String>();
    format!("body,diameter_mm,x_mm,y_mm,z_mm\n{rows}")
}

fn bench() -> Bench {
    let bench = Bench::new();
    bench.write("tissue.toml", TISSUE);
    bench.write("design.csv", &design());
    bench
}

fn number(json: &Value, key: &str) -> f64 {
    json[key]
        .as_f64()
        .unwrap_or_else(|| panic!("no number {key} in {json}"))
}

const MEASURE: &str = "beam measure --markers design.csv --case tissue.toml";

#[test]
fn needles_are_measured_in_ct_and_compared() {
    let bench = bench();
    Ct::of(&needle(0.0), &[], 1).write(&bench, "rest.mha");
    // In the second, markers are out of place anew.
    let motions = [(-12.5, vec![], 1), (7.5, vec![14], 2), (15.0, vec![3, 17], 1)];
    for (at, (displacement, left_out, seed)) in motions.iter().enumerate() {
        Ct::of(&needle(*displacement), left_out, *seed).write(&bench, &format!("moved_{at}.mha"));
    }
    let run = bench.run(&format!(
        "{MEASURE} --threshold 1500 rest.mha moved_0.mha moved_1.mha moved_2.mha -o cases --json"
    ));
    let json = run.json();
    assert!(run.stderr.is_empty(), "{run:?}");
    for (at, (displacement, left_out, _)) in motions.iter().enumerate() {
        let (report, shape) = (&json[at], needle(*displacement));
        let base = &shape.points[0];
        let near = |key: &str, expected: f64, within: f64| {
            let value = number(report, key);
            assert!((value - expected).abs() < within, "{at} {key}: {value} {expected}");
        };
        near("displacement_mm", base.u_mm, 0.1);
        near("slope", base.slope, 0.005);
        near("tip_mm", shape.tip_mm(), 0.25);
        near("control_distance_mm", CONTROL_MM, 0.2);
        // Half a slice (0.25), the slant of voxels across the end, and three deviations of the container along x, 0.2 /
        // sqrt(3 x 12).
        near("inserted_mm", DEPTH_MM, 0.4);
        near("com_mm", Shape::com_mm(&shape).expect("a COM"), 1.0);
        near("rcm_mm", shape.rcm_mm().expect("an RCM"), 2.5);
        let rms = &report["markers_rms_mm"];
        assert!(rms[0].as_f64() < Some(0.3) && rms[1].as_f64() < Some(0.2), "{rms}");
        let count = report["markers"][0].as_u64().unwrap_or(0) + report["markers"][1].as_u64().unwrap_or(0);
        assert_eq!(count as usize, 19 - left_out.len());
        // What was written bends, and its shape is where the needle was painted.
        let case: toml::Table = bench.text(&format!("cases/moved_{at}.toml")).parse().expect("a case");
        let pairs = case["needle"]["measured_mm"].as_array().expect("pairs").clone();
        assert!(pairs.len() > 190, "{}", pairs.len());
        for pair in pairs {
            let [x, u] = [0, 1].map(|i| pair[i].as_float().expect("a number"));
            let expected = shape.at(x.min(DEPTH_MM))[0];
            // A slice of the needle has about three voxels: half a voxel (0.25), and three deviations of the container
            // at the base (0.077).
            assert!((u - expected).abs() < 0.5, "{at}: {x} {u} {expected}");
        }
        let bent = bench.run(&format!("beam cases/moved_{at}.toml --json")).json();
        assert!((number(&bent, "tip_mm") - shape.tip_mm()).abs() < 0.4);
    }
    let json = bench
        .run("beam compare cases --tissue tissue.toml -o out --json")
        .json();
    let row = |table: &str, at: usize| json["tables"][table]["rows"][at].clone();
    assert_eq!(json["tables"]["cases"]["rows"].as_array().map(Vec::len), Some(6));
    let all = row("errors", 2);
    assert_eq!((all["depth"].as_str(), number(&all, "count")), (Some("all"), 3.0));
    let [mean, most] = ["mean_mm", "max_mm"].map(|key| number(&all, key));
    assert!(
        mean <= most && most < 0.4 && number(&all, "variance_mm2") < 0.05,
        "{all}"
    );
    assert_eq!(number(&row("centres", 0), "count"), 3.0);
    for file in ["errors.csv", "cases.csv", "beam-compare-distribution.svg", "index.html"] {
        assert!(bench.files("out").contains(&file.to_owned()), "{file}");
    }

    // One volume makes one case.
    bench
        .run(&format!("{MEASURE} --threshold 1500 rest.mha moved_0.mha -o one.toml"))
        .text();
    assert_eq!(bench.text("one.toml"), bench.text("cases/moved_0.toml"));
}

#[test]
fn volumes_and_designs_that_cannot_be_measured_are_refused() {
    let bench = bench();
    Ct::of(&needle(0.0), &[], 1).write(&bench, "rest.mha");
    let all: Vec<usize> = (0..19).collect();
    Ct::of(&needle(5.0), &all, 1).write(&bench, "bare.mha");
    let before = bench.files(".");
    let design = bench.text("design.csv");
    let fails = |arguments: &str, words: &[&str]| {
        bench
            .run(&format!("{MEASURE} {arguments} -o case.toml"))
            .fails(2, words);
        assert_eq!(bench.files("."), before, "{arguments}");
    };
    fails(
        "rest.mha bare.mha",
        &[
            "bare.mha",
            "markers of the container, 3 mm",
            "0 of 12",
            "the diameters are",
            "--threshold",
        ],
    );
    fails("rest.mha none.mha", &["none.mha"]);
    fails("rest.mha rest.mha --threshold 30", &["higher threshold"]);
    fails("rest.mha rest.mha --needle-threshold 9000", &["found no needle"]);
    fails("rest.mha", &["CT"]);
    for (from, to, words) in [
        ("stage,2,", "stage,3,", "differ by a factor"),
        ("stage,2,-14", "needle,2,-14", "line 14"),
        ("container,3,8", "container,4,8", "line 3"),
        ("z_mm", "z", "z"),
    ] {
        bench.write("design.csv", &design.replace(from, to));
        fails("rest.mha rest.mha", &["design.csv", words]);
    }
    bench.run("beam compare tissue.toml").fails(2, &["`measured_mm`"]);
    bench.run("beam compare .").fails(2, &["no case with `measured_mm`"]);
}
