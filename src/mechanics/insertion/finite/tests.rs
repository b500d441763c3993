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
    let (mut foreseen, mut made, mut gone) = (0, 0, 0);
    for step in 0..1000 {
        // In by 50 mm, and out.
        let z = 0.1 * f64::from(500 - (step - 500i32).abs());
        let (before, expected) = (nodes(&finite), next_corner(&finite));
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
    // The first node cannot be predicted; the others follow from the straight path.
    assert!(foreseen + 2 >= made, "{foreseen} of {made}");
}
