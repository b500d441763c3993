use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use super::*;
use crate::insertion::{Instruments, Interaction, Model, Tissue as MovedTissue};
use crate::needle::{CentreLine, Entry, Load, Needle, Row};
use crate::tissue::material::Material;
use crate::tissue::remesh::{Level, Precision};

/// A straight needle.
#[derive(Debug)]
struct Straight {
    length: f64,
}

impl Needle for Straight {
    fn length_mm(&self) -> f64 {
        self.length
    }

    fn radius_mm(&self) -> f64 {
        0.64
    }

    fn is_flexible(&self) -> bool {
        false
    }

    fn place(&mut self, base: &Isometry3<f64>, _: Option<&Entry>, _: &[Load], _: &[Load], line: &mut CentreLine) {
        line.set([0.0, self.length].map(|arc| (arc, base * Point3::new(0.0, 0.0, arc))));
    }

    fn linearise(&mut self, _: &CentreLine, _: &[Load], _: &[Row], _: &mut [f64], _: &mut [f64]) -> usize {
        0
    }
}

/// A block of tissue, 60 x 60 mm across, from z = 0 (free) to 80 (fixed), with slightly perturbed nodes.
fn block(cell: f64) -> TetMesh {
    let cells = [60.0, 60.0, 80.0].map(|edge| (edge / cell).round() as usize);
    let to_world = nalgebra::Matrix4::new_nonuniform_scaling(&Vector3::new(60.0, 60.0, 80.0));
    TetMesh::lattice(cells, &to_world).expect("a lattice")
}

fn setup(interaction: Interaction, level: Level) -> Setup {
    let mesh = block(8.0);
    let fixed = (0..mesh.nodes().len() as u32)
        .filter(|node| mesh.nodes()[*node as usize][2] > 79.9)
        .flat_map(|node| (0..3).map(move |axis| (node, axis)))
        .collect();
    Setup {
        materials: vec![Material::new(10.0, 0.45).expect("a material"); mesh.elements().len()],
        fixed,
        interactions: mesh
            .regions()
            .first()
            .map(|region| (*region, interaction))
            .into_iter()
            .collect(),
        anatomy: None,
        needle: Box::new(Straight { length: 150.0 }),
        probe: None,
        level,
        precision: Precision::Double,
        options: FiniteOptions::default(),
        mesh,
    }
}

/// The base such that the tip of a straight needle along z is at (x, y, z).
fn base(x: f64, y: f64, z: f64) -> Isometry3<f64> {
    Isometry3::from_parts(Translation3::new(x, y, z - 150.0), UnitQuaternion::identity())
}

fn at(z: f64) -> Instruments {
    Instruments {
        base: base(31.3, 28.9, z),
        probe: None,
        guide: None,
        deposit: false,
    }
}

#[test]
fn what_remeshing_moves_is_foreseen() {
    let interaction = Interaction {
        friction_n_per_mm: 0.02,
        cutting_n: 0.5,
        puncture_n: 1.5,
        ..Interaction::default()
    };
    let mut finite = Finite::new(setup(interaction, Level::Exact), |_, _| {}).expect("a setup");
    let nodes = |finite: &Finite| -> Vec<u32> { finite.contact_states().map(|(node, _)| node).collect() };
    let next_corner = |finite: &Finite| {
        let Finite {
            contacts,
            needle,
            tip,
            tissue,
            options,
            ..
        } = finite;
        prediction::next_corner(contacts, needle, tip, tissue, options)
    };
    let (mut foreseen, mut added, mut removed) = (0, 0, 0);
    for step in 0..1000 {
        // In by 50 mm, and out.
        let z = 0.1 * f64::from(500 - (step - 500i32).abs());
        let (before, expected) = (nodes(&finite), next_corner(&finite));
        finite.step(&at(z), 0.001).expect("a step");
        let after = nodes(&finite);
        if after.len() > before.len() {
            added += 1;
            foreseen += usize::from(expected == after.last().copied());
        } else if after.len() < before.len() {
            removed += 1;
            assert_eq!(after, before[..after.len()], "the last comes off");
        }
    }
    assert!(added >= 5 && removed >= 5, "{added} added, {removed} removed");
    // The first node cannot be predicted; the others follow from the straight path.
    assert!(foreseen + 2 >= added, "{foreseen} of {added}");
}

/// A rigid needle that slides through one tissue carries its friction per length all along, its cutting force at the
/// tip, and in all the force on the hand.
#[test]
fn forces_along_the_needle_are_those_of_the_tissue() {
    let interaction = Interaction {
        friction_n_per_mm: 0.02,
        cutting_n: 0.5,
        ..Interaction::default()
    };
    let mut finite = Finite::new(setup(interaction, Level::Exact), |_, _| {}).expect("a setup");
    let mut loads = Vec::new();
    finite.shaft_loads(&mut loads);
    assert_eq!(loads, []);
    // Steps end when nothing moves by more than 1e-5 mm.
    const SAME: f64 = 1e-5;
    // Forces are carried over a change of the mesh, which moves nodes along the needle, until the next step.
    const AFTER_REMESH: f64 = 2e-3;
    let [mut slid, mut cut] = [0, 0];
    for step in 0..300 {
        let outcome = finite.step(&at(0.2 * f64::from(step)), 0.001).expect("a step").clone();
        finite.shaft_loads(&mut loads);
        let sum: Vector3<f64> = loads.iter().map(|load| load.force_n).sum();
        assert!((sum - outcome.on_hand.force_n).norm() < 1e-9, "{step}: {loads:?}");
        assert!(
            loads.windows(2).all(|pair| pair[0].to_mm <= pair[1].from_mm + 1e-9),
            "{loads:?}"
        );
        let Some((tip, shaft)) = loads.split_last() else {
            continue;
        };
        assert_eq!([tip.from_mm, tip.to_mm], [150.0; 2]);
        cut += usize::from((tip.force_n.z + 0.5).abs() < 1e-9);
        for load in shaft.iter().filter(|load| load.length_mm() > 1.0) {
            let density = load.force_n.z / load.length_mm();
            let tolerance = if outcome.remeshes > 0 { AFTER_REMESH } else { SAME };
            assert!(density.abs() < 0.02 + tolerance, "{step}: {density}");
            slid += usize::from((density + 0.02).abs() < SAME);
        }
    }
    assert!(slid > 100 && cut > 100, "{slid} lengths slide, {cut} steps cut");
}

/// Pushes a needle into a block until its surface breaks. Returns the way from touch to puncture, mm.
fn dent(cell: f64, patch_mm: f64, puncture_n: f64) -> f64 {
    let interaction = Interaction {
        puncture_n,
        cutting_n: 0.1 * puncture_n,
        ..Interaction::default()
    };
    let mut of_block = setup(interaction, Level::Exact);
    of_block.mesh = block(cell);
    let nodes = of_block.mesh.nodes();
    of_block.fixed = (0..nodes.len() as u32)
        .filter(|node| nodes[*node as usize][2] > 79.9)
        .flat_map(|node| (0..3).map(move |axis| (node, axis)))
        .collect();
    of_block.materials = vec![Material::new(10.0, 0.45).expect("a material"); of_block.mesh.elements().len()];
    of_block.options.patch_mm = patch_mm;
    let mut finite = Finite::new(of_block, |_, _| {}).expect("a setup");
    let mut touch = None;
    for step in 0..3000 {
        let z = 0.01 * f64::from(step);
        let outcome = finite.step(&at(z), 0.001).expect("a step");
        assert!(outcome.converged);
        let has = |kind| outcome.events.iter().any(|event| event.kind == kind);
        if has(EventKind::Skin) {
            touch = Some(z);
        }
        if has(EventKind::Puncture) {
            return z - touch.expect("a touch before");
        }
        if touch.is_some() && step % 50 == 0 {
            shows_the_dent(&mut finite);
        }
    }
    f64::NAN
}

/// The picture has the tissue at the tip there, and that far from it where the forces on the mesh have moved it.
fn shows_the_dent(finite: &mut Finite) {
    let (mut snapshot, mut shown, mut solved) = (Snapshot::default(), MovedTissue::default(), MovedTissue::default());
    finite.snapshot(&mut snapshot);
    let mut imager = finite.imager();
    imager.tissue(&snapshot, &mut shown);
    let at_tip = snapshot.at_tip.take().expect("a tip in tissue");
    imager.tissue(&snapshot, &mut solved);
    let corners = at_tip.corners.iter().zip(at_tip.shares);
    let at = |tissue: &MovedTissue| -> Vector3<f64> {
        let nodes = corners.clone();
        nodes
            .map(|(node, share)| Vector3::from(tissue.current[*node as usize]) * share)
            .sum()
    };
    assert!((at(&shown) - at_tip.tip_mm.coords).norm() < 1e-9);
    let missing_mm = (at(&solved) - at_tip.tip_mm.coords).norm();
    for (index, reference) in shown.reference.iter().enumerate() {
        let [x, y, z] = [0, 1, 2].map(|axis| shown.current[index][axis] - solved.current[index][axis]);
        let (shift_mm, distance_mm) = (
            Vector3::new(x, y, z).norm(),
            (Point3::from(*reference) - at_tip.tip_mm).norm(),
        );
        let most = if distance_mm < 45.0 { 1.5 } else { 0.3 };
        assert!(
            shift_mm <= most * missing_mm,
            "{shift_mm} of {missing_mm} mm at {distance_mm} mm"
        );
    }
}

/// F (1 - nu^2) / (2 a E), whatever the elements.
#[test]
fn an_unbroken_surface_is_dented_as_by_a_punch() {
    for (cell, patch_mm) in [(20.0, 5.0), (10.0, 5.0), (8.0, 5.0), (10.0, 2.0), (10.0, 12.0)] {
        let punch = 0.4 * (1.0 - 0.45 * 0.45) / (2.0 * patch_mm * 0.01);
        let dent = dent(cell, patch_mm, 0.4);
        assert!(
            (dent / punch - 1.0).abs() < 0.05,
            "{cell} mm, {patch_mm} mm: {dent} for {punch}"
        );
    }
}
