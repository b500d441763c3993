use faer::Mat;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use super::*;
use crate::mechanics::insertion::{Instruments, Interaction, Model};
use crate::mechanics::needle::{CentreLine, Entry, Load, Needle, Row};
use crate::mechanics::tissue::material::Material;
use crate::mechanics::tissue::remesh::{Level, Precision};

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

    fn linearise(&mut self, _: &CentreLine, _: &[Load], _: &[Row], _: &mut [f64], _: &mut Mat<f64>) -> usize {
        0
    }
}

/// A block of tissue, 60 x 60 mm across, from z = 0 (free) to 80 (fixed), shaken a little.
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
        options: Options::default(),
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
    let nodes = |finite: &Finite| -> Vec<u32> { finite.contacts.iter().map(|contact| contact.node).collect() };
    let (mut foreseen, mut made, mut gone) = (0, 0, 0);
    for step in 0..1000 {
        // In by 50 mm, and out.
        let z = 0.1 * f64::from(500 - (step - 500i32).abs());
        let (before, expected) = (nodes(&finite), finite.next_corner());
        finite.step(&at(z), 0.001).expect("a step");
        let after = nodes(&finite);
        if after.len() > before.len() {
            made += 1;
            foreseen += usize::from(expected == after.last().copied());
        } else if after.len() < before.len() {
            gone += 1;
            assert_eq!(after, before[..after.len()], "the last comes off");
        }
    }
    assert!(made >= 5 && gone >= 5, "{made} made, {gone} gone");
    // The first is made where nothing can be known before; the others where the straight path says.
    assert!(foreseen + 2 >= made, "{foreseen} of {made}");
}

#[test]
fn the_level_changes_with_the_needle_in() {
    let interaction = Interaction {
        friction_n_per_mm: 0.02,
        cutting_n: 0.5,
        ..Interaction::default()
    };
    let mut settled = setup(interaction, Level::Exact);
    // Forces come to rest so closely that what is left of a jump is rounding.
    settled.options.tolerance_mm = 1e-12;
    let mut finite = Finite::new(settled, |_, _| {}).expect("a setup");
    for step in 1..=300 {
        finite.step(&at(0.1 * f64::from(step)), 0.001).expect("a step");
    }
    assert!(finite.contacts.len() >= 3 && finite.held() > 0);
    let before = finite.outcome().on_hand;
    assert!(before.force_n.norm() > 0.5, "{before:?}");
    let mut from = Level::Exact;
    for to in [Level::I, Level::III, Level::IV, Level::II, Level::Exact] {
        let change = finite.set_level(to).expect("a level");
        assert_eq!((change.from, change.to), (from, to));
        assert_eq!(finite.adaptation().remesher().level(), to);
        // The mesh has not changed since level I, so all are current: forces change by the friction of what iterations leave, 1e-5 mm.
        assert!(
            change.force_jump_n < 2e-7 && change.compliance_change < 1e-9,
            "{change:?}"
        );
        from = to;
    }
    let after = finite.outcome().on_hand;
    assert!((after.force_n - before.force_n).norm() < 2e-7, "{before:?} {after:?}");
    assert!(
        (after.torque_nmm - before.torque_nmm).norm() < 4e-5,
        "{before:?} {after:?}"
    );

    // Level IV leaves what remeshing changes; at the exact level it is there again, as in a model that was always at it.
    finite.set_level(Level::IV).expect("a level");
    for step in 301..=500 {
        finite.step(&at(0.1 * f64::from(step)), 0.001).expect("a step");
    }
    let change = finite.set_level(Level::Exact).expect("a level");
    assert!(
        change.compliance_change > 1e-3 && change.force_jump_n > 1e-4,
        "{change:?}"
    );
    let mut other = Finite::new(setup(interaction, Level::Exact), |_, _| {}).expect("a setup");
    other.restore(&finite.save()).expect("a state");
    let [own, expected] = [&finite, &other].map(|finite| finite.adaptation().remesher().condensed());
    assert!((own - expected).norm_max() < 1e-9 * expected.norm_max());
    let again = finite.set_level(Level::Exact).expect("the same");
    assert!(again.force_jump_n < 1e-9, "{again:?}");
}
