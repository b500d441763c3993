//! Tests of reported points, of stress, of fixed nodes, and of the depth at which regions are met.

use nalgebra::{Matrix3, Point3, Vector3};

use super::prescribed::PrescribedModel;
use super::{BLOCK, fixed, resolved};
use crate::input::scenario::Scenario;
use crate::input::scenario::reported_points::{Displaced, Extremes, Points};
use crate::run::record::Record;
use crate::run::{Deformed, Observer, Requests, Step, run};
use insonify_base::note::Note;
use insonify_mechanics::insertion::{EventKind, Model, StepError, Tissue};

/// The block with an oblique probe that turns on the way, and two points.
fn reporting() -> String {
    let pose = "[scene.pose]\nposition_mm = [0, -40, 0]\ndirection = [0.6, 0.8, 0]\nlateral = [0.8, -0.6, 0]\n";
    let reports = "[[report]]\nname = \"lump\"\nat_mm = [3, -2, 4]\n[[report]]\nname = \"node_7\"\nnode = 7\n";
    BLOCK.replace("[scene.image]", &format!("{pose}[scene.image]")) + reports
}

/// Tissue of a scenario under an affine displacement, slope times position plus shift.
fn affine(scenario: &Scenario, slope: &Matrix3<f64>, shift: &Vector3<f64>) -> Tissue {
    let nodes = scenario.mesh.nodes();
    let moved = |point: &[f64; 3]| <[f64; 3]>::from(Vector3::from(*point) + slope * Vector3::from(*point) + shift);
    Tissue {
        reference: nodes.to_vec(),
        current: nodes.iter().map(moved).collect(),
        inverted: 0,
    }
}

/// Linear elements carry an affine displacement exactly, whatever element a point is in.
#[test]
fn points_are_carried_in_the_world_and_in_the_image() {
    let scenario = resolved(&reporting()).expect("a scenario");
    let slope = Matrix3::new(0.1, 0.02, -0.03, 0.0, -0.05, 0.04, 0.07, 0.01, 0.02);
    let shift = Vector3::new(1.0, -2.0, 0.5);
    let tissue = affine(&scenario, &slope, &shift);
    let imager = PrescribedModel::new(&scenario).imager();
    let mut points = Points::new(&scenario);
    let probe = scenario.probe(0);
    let carried = points.carry(imager.as_ref(), &tissue, &probe).to_vec();
    let node = Vector3::from(scenario.mesh.nodes()[7]);
    for (components, point) in carried.iter().zip([Vector3::new(3.0, -2.0, 4.0), node]) {
        let expected = slope * point + shift;
        let axial = expected.dot(&Vector3::new(0.6, 0.8, 0.0));
        let lateral = expected.dot(&Vector3::new(0.8, -0.6, 0.0));
        let elevational = expected.dot(&Vector3::new(0.8, -0.6, 0.0).cross(&Vector3::new(0.6, 0.8, 0.0)));
        let expected = [expected.x, expected.y, expected.z, axial, lateral, elevational];
        for (component, expected) in components.iter().zip(expected) {
            assert!((component - expected).abs() < 1e-9, "{component} for {expected}");
        }
    }
    let mut extremes = Extremes::new(&scenario.reports[0]);
    extremes.add(0.5, &carried[0]);
    extremes.add(0.75, &carried[0].map(|value| -0.5 * value));
    let axial = carried[0][3];
    assert_eq!(extremes.axial_mm, [axial.min(-0.5 * axial), axial.max(-0.5 * axial)]);
    let [x, y, z, ..] = carried[0];
    assert!((extremes.max_displacement_mm - Vector3::new(x, y, z).norm()).abs() < 1e-12);
    assert_eq!(
        (extremes.max_at_s, extremes.x_mm),
        (0.5, [(-0.5 * x).min(x), x.max(-0.5 * x)])
    );
}

/// Keeps the tables of a run and its deformed meshes.
struct Kept {
    record: Record,
    steps: Vec<u8>,
    points: Vec<u8>,
    stresses: Vec<Option<Vec<f64>>>,
    /// Regions met, each with the depth of the tissue at the tip, mm along z.
    regions: Vec<(i32, f64)>,
}

impl Kept {
    fn of(scenario: &Scenario, model: &mut dyn Model, requests: Requests) -> (Kept, crate::run::summary::Summary) {
        let mut kept = Kept {
            record: Record::new(scenario),
            steps: Vec::new(),
            points: Vec::new(),
            stresses: Vec::new(),
            regions: Vec::new(),
        };
        kept.record.points_head(&mut kept.points).expect("memory");
        let summary = run(scenario, model, requests, &mut kept).expect("a run");
        (kept, summary)
    }
}

impl Observer for Kept {
    type Error = StepError;

    fn step(&mut self, step: &Step<'_>) -> Result<(), StepError> {
        let crossings = step
            .outcome
            .events
            .iter()
            .filter(|event| event.kind == EventKind::Region);
        let depth = step.outcome.tip_at_rest_mm.map_or(f64::NAN, |tip| tip.z);
        self.regions
            .extend(crossings.filter_map(|event| Some((event.region?, depth))));
        self.record.step(step, &mut self.steps).expect("memory");
        Ok(())
    }

    fn mesh(&mut self, deformed: &Deformed<'_>) -> Result<(), StepError> {
        self.stresses.push(deformed.von_mises_kpa.map(<[f64]>::to_vec));
        Ok(())
    }

    fn points(&mut self, displaced: &Displaced<'_>) -> Result<(), StepError> {
        self.record.points(displaced, &mut self.points).expect("memory");
        Ok(())
    }
}

#[test]
fn a_run_writes_the_displacements_of_points_at_the_rate_of_frames() {
    let scenario = resolved(&reporting()).expect("a scenario");
    let mut model = scenario.model(|_, _| {}).expect("a model");
    let requests = Requests {
        frames: false,
        mesh_s: Some(0.5),
    };
    let (kept, summary) = Kept::of(&scenario, model.as_mut(), requests);
    let text = String::from_utf8(kept.points).expect("text");
    let rows: Vec<Vec<&str>> = text.lines().map(|line| line.split(',').collect()).collect();
    assert_eq!(rows.len(), 52, "25 a second for 2 s, and the head");
    assert!(rows.iter().all(|row| row.len() == 14), "{text}");
    assert_eq!(rows[0][2..6], ["lump_x_mm", "lump_y_mm", "lump_z_mm", "lump_axial_mm"]);
    let column = |name: &str| {
        let index = rows[0].iter().position(|head| *head == name).expect("a column");
        rows[1..]
            .iter()
            .map(move |row| row[index].parse::<f64>().expect("a number"))
    };
    // The needle drags the tissue along z, the normal of the image here.
    let largest_mm = column("lump_z_mm").fold(0.0, f64::max);
    assert!(largest_mm > 0.05, "{largest_mm}");
    let point = &summary.points[0];
    assert!(
        (point.z_mm[1] - largest_mm).abs() < 1e-6 && point.max_displacement_mm >= largest_mm,
        "{point:?}"
    );
    let apart: f64 = column("lump_z_mm")
        .zip(column("lump_elevational_mm"))
        .map(|(z, e)| (z - e).abs())
        .fold(0.0, f64::max);
    assert!(apart < 1e-5, "{apart}");
    let plots = kept.record.plots();
    let names: Vec<_> = plots.iter().map(|(name, _)| *name).collect();
    let expected = [
        "forces",
        "tip",
        "paths",
        "profile",
        "displacement_axial",
        "displacement_lateral",
        "displacement_elevational",
        "step_time",
    ];
    assert_eq!(names, expected);
    assert_eq!([2, 4].map(|plot| plots[plot].1.series.len()), [6, 2]);
    assert!(kept.stresses.len() == 5 && kept.stresses[4].as_ref().expect("stress").iter().any(|kpa| *kpa > 0.1));
    assert_profile(&kept.record, &kept.steps);
    // Without reports, nothing is added.
    let plain = resolved(BLOCK).expect("a scenario");
    let mut model = PrescribedModel::new(&plain);
    let (kept, summary) = Kept::of(&plain, &mut model, Requests::default());
    assert_eq!((summary.points.len(), kept.record.plots().len()), (0, 4));
    assert_eq!(kept.points, b"time_s,inserted_mm\n");
}

/// The force along the needle adds up to that on the hand in the same step, of 10 ms.
fn assert_profile(record: &Record, steps: &[u8]) {
    let (_, plot) = &record.plots()[3];
    let deepest = &plot.series[0];
    let shaft_n: f64 = deepest
        .points
        .windows(2)
        .map(|ends| (ends[1][0] - ends[0][0]) * ends[0][1])
        .sum();
    let words: Vec<&str> = deepest.name.split(' ').collect();
    let time_s: f64 = words[5].parse().expect("a time");
    let tip_n: f64 = words[words.len() - 2].parse().expect("a force");
    let mut head = Vec::new();
    record.head(&mut head).expect("memory");
    let [head, row] = [&head[..], steps].map(|text| std::str::from_utf8(text).expect("text"));
    let column = head
        .split(',')
        .position(|name| name == "base_force_z_n")
        .expect("a column");
    let cell = row
        .lines()
        .nth((100.0 * time_s).round() as usize - 1)
        .and_then(|row| row.split(',').nth(column));
    let on_hand_n: f64 = cell.expect("a row").parse().expect("a number");
    assert!(
        shaft_n > 0.1 && (shaft_n + tip_n + on_hand_n).abs() < 1e-3,
        "{shaft_n} {tip_n} {on_hand_n}"
    );
}

#[test]
fn odd_points_are_refused() {
    for (report, key, words) in [
        ("name = \"a b\"\nnode = 1", "report[0].name", "letters, digits"),
        ("name = \"\"\nnode = 1", "report[0].name", "letters, digits"),
        ("name = \"a\"", "report[0]", "neither `at_mm` nor `node`"),
        (
            "name = \"a\"\nnode = 1\nat_mm = [0, 0, 0]",
            "report[0]",
            "both `at_mm` and `node`",
        ),
        ("name = \"a\"\nnode = 99999", "report[0].node", "found node 99999"),
        ("name = \"a\"\nnode = -1", "report[0].node", "found node -1"),
        (
            "name = \"a\"\nat_mm = [0, 0, 400]",
            "report[0].at_mm",
            "in no element of the mesh",
        ),
        (
            "name = \"a\"\nat_mm = [0, 0, nan]",
            "report[0].at_mm",
            "finite coordinates",
        ),
        (
            "name = \"a\"\nnode = 1\n[[report]]\nname = \"a\"\nnode = 2",
            "report[1].name",
            "a second point",
        ),
    ] {
        let error = resolved(&format!("{BLOCK}[[report]]\n{report}\n"))
            .map(drop)
            .expect_err(report);
        assert_eq!(error.key(), Some(key), "{error}");
        assert!(
            error.to_string().contains(words) && error.location().is_some(),
            "{error}"
        );
    }
    let springs = BLOCK.replace("nodes = 250", "model = \"mass-spring\"");
    let fix_table = springs.find("[[tissue.fix]]").expect("a fix");
    let end = springs.find("[[tissue.material]]").expect("a material");
    let springs = format!(
        "{}{}[[report]]\nname = \"a\"\nnode = 1\n",
        &springs[..fix_table],
        &springs[end..]
    );
    let error = resolved(&springs).map(drop).expect_err("a node");
    assert!(error.to_string().contains("when the needle enters"), "{error}");
    let scenario = resolved(&springs.replace("node = 1", "at_mm = [0, 0, -30]")).expect("a point of springs");
    assert_eq!(scenario.reports[0].at_mm, Point3::new(0.0, 0.0, -30.0));
}

/// Uniaxial strain e gives 2 mu e, simple shear g gives sqrt(3) mu g, in each region with its own modulus.
#[test]
fn the_stress_of_a_deformed_mesh_is_that_of_its_materials() {
    let scenario = resolved(BLOCK).expect("a scenario");
    let model = PrescribedModel::new(&scenario);
    for (slope, factor) in [
        (Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.1), 2.0 * 0.1),
        (
            Matrix3::new(0.0, 0.0, 0.0, 0.2, 0.0, 0.0, 0.0, 0.0, 0.0),
            3f64.sqrt() * 0.2,
        ),
    ] {
        let tissue = affine(&scenario, &slope, &Vector3::new(1.0, 2.0, 3.0));
        let stress_kpa = scenario
            .von_mises_kpa(&model, scenario.mesh.elements(), &tissue)
            .expect("stress");
        for (mises_kpa, material) in stress_kpa
            .iter()
            .zip(&scenario.tissue.finite_element().unwrap().materials)
        {
            let [_, mu] = material.lame_kpa();
            assert!(
                (mises_kpa / (factor * mu) - 1.0).abs() < 1e-9,
                "{mises_kpa} for {}",
                factor * mu
            );
        }
    }
}

/// The hole of the phantom, 9 mm wide about x = 0, y = 26 mm, held by a bar (Dehghan et al. 2008).
#[test]
fn nodes_are_fixed_by_cylinder_and_by_the_surface_of_a_region() {
    let fine = BLOCK
        .replace("nodes = 250", "nodes = 1500")
        .replace("resolution_mm = 5", "resolution_mm = 3");
    let with_fix = |fix: &str| {
        fine.replace(
            "[[tissue.material]]",
            &format!("[[tissue.fix]]\n{fix}\n[[tissue.material]]"),
        )
    };
    let hole = |part: &str| format!("cylinder = {{ at_mm = [0, 26, 7], axis = [0, 0, 2], radius_mm = 9, {part} }}");
    let held_nodes = |text: &str| {
        let scenario = resolved(text).unwrap_or_else(|error| panic!("{error}"));
        let mut nodes: Vec<u32> = fixed(&scenario).iter().map(|(node, _)| *node).collect();
        nodes.dedup();
        (scenario, nodes)
    };
    let gap_mm = |scenario: &Scenario, node: u32| {
        let [x, y, _] = scenario.mesh.nodes()[node as usize];
        x.hypot(y - 26.0) - 9.0
    };
    let (scenario, nodes) = held_nodes(&with_fix(&(hole("within_mm = 2") + "\nsurface = true")));
    let of_hole: Vec<u32> = nodes
        .iter()
        .copied()
        .filter(|node| scenario.mesh.nodes()[*node as usize][2] < 40.0)
        .collect();
    assert!(of_hole.len() > 40, "{}", of_hole.len());
    assert!(of_hole.iter().all(|node| gap_mm(&scenario, *node).abs() <= 2.0));
    // The bar holds all around, and all along.
    for (axis, start, end) in [(0, -8.0, 8.0), (1, 18.5, 33.0), (2, -40.0, 35.0)] {
        let places = of_hole.iter().map(|node| scenario.mesh.nodes()[*node as usize][axis]);
        let (low, high) = (
            places.clone().fold(f64::INFINITY, f64::min),
            places.fold(f64::NEG_INFINITY, f64::max),
        );
        assert!(low < start && high > end, "axis {axis}: {low} to {high}");
    }
    let counted = |note: &&Note| note.starts_with("tissue.fix[1] fixes ") && note.ends_with(" nodes");
    assert_eq!(scenario.notes.iter().filter(counted).count(), 1, "{:?}", scenario.notes);

    let (scenario, inside) = held_nodes(&with_fix(&hole("part = \"inside\"")));
    let (_, outside) = held_nodes(&with_fix(&hole("part = \"outside\"")));
    let wall = |node: &u32| gap_mm(&scenario, *node) <= 0.0;
    assert!(
        inside
            .iter()
            .filter(|node| scenario.mesh.nodes()[**node as usize][2] < 40.0)
            .all(wall)
    );
    assert!(inside.len() + outside.len() >= scenario.mesh.nodes().len());

    let (scenario, nodes) = held_nodes(&with_fix("surface_of = \"phantom_inclusion\""));
    let mesh = &scenario.mesh;
    let mut regions = vec![[false; 2]; mesh.nodes().len()];
    for (corners, region) in mesh.elements().iter().zip(mesh.regions()) {
        corners
            .iter()
            .for_each(|node| regions[*node as usize][usize::from(*region == 2)] = true);
    }
    let mut open = vec![false; mesh.nodes().len()];
    mesh.surface()
        .for_each(|face| face.nodes.iter().for_each(|node| open[*node as usize] = true));
    let border = |node: usize| regions[node][1] && (regions[node][0] || open[node]);
    let expected: Vec<u32> = (0..mesh.nodes().len())
        .filter(|&node| border(node) || mesh.nodes()[node][2] >= 40.0)
        .map(|node| node as u32)
        .collect();
    assert_eq!(nodes, expected);

    for (fix, key, words) in [
        (
            hole("within_mm = 2").replace("radius_mm = 9", "radius_mm = 0"),
            "cylinder.radius_mm",
            "above 0 mm",
        ),
        (hole("within_mm = -1"), "cylinder.within_mm", "0 mm or more"),
        (
            hole("part = \"inside\", within_mm = 1"),
            "cylinder.within_mm",
            "has no wall",
        ),
        (
            hole("part = \"wall\"").replace("[0, 0, 2]", "[0, 0, 0]"),
            "cylinder.axis",
            "not all zero",
        ),
        (
            hole("part = \"inside\"").replace("26", "260"),
            "cylinder",
            "no node in this part of the cylinder",
        ),
        (
            format!("{}\nnodes = [1]", hole("part = \"wall\"")),
            "",
            "`nodes` beside another choice",
        ),
        ("surface_of = \"phantom\"".to_owned(), "surface_of", "phantom_inclusion"),
        (
            "surface_of = \"phantom_inclusion\"\nbox_mm = [[-1, -1, -1], [1, 1, 1]]".to_owned(),
            "box_mm",
            "no node in this box",
        ),
    ] {
        let error = resolved(&with_fix(&fix)).map(drop).expect_err(&fix);
        let key = if key.is_empty() {
            "tissue.fix[1]".to_owned()
        } else {
            format!("tissue.fix[1].{key}")
        };
        assert_eq!(error.key(), Some(key.as_str()), "{error}");
        assert!(error.to_string().contains(words), "{error}");
    }
}

/// Remeshing moves nodes of interfaces to the tip, but no interface: the inclusion, whose end is a hemisphere of 15 mm
/// about z = -10 mm, begins on the needle's line where it does at rest, on coarse and fine meshes.
#[test]
fn regions_are_met_at_their_depth_at_rest_on_any_mesh() {
    let block = BLOCK
        .replace("resolution_mm = 5", "resolution_mm = 2")
        .replace("dt_ms = 10", "dt_ms = 20");
    let border = -10.0 - f64::sqrt(225.0 - 13.0);
    for nodes in [250, 600, 1000] {
        let text = block
            .replace("nodes = 250", &format!("nodes = {nodes}"))
            .replace("[0, 0, -50]", "[3, 2, -50]");
        let scenario = resolved(&text.replace("[0, 0, -30]", "[3, 2, -15]")).expect("a scenario");
        let mut model = scenario.model(|_, _| {}).expect("a model");
        let (kept, summary) = Kept::of(&scenario, model.as_mut(), Requests::default());
        assert!(summary.remeshes > 2, "{nodes}: {}", summary.remeshes);
        let [(2, depth)] = kept.regions[..] else {
            panic!("{nodes} nodes: {:?}", kept.regions)
        };
        assert!(
            (depth - border).abs() < 0.5,
            "{nodes} nodes: met at {depth}, at rest at {border} mm"
        );
    }
}
