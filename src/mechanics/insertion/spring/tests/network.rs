//! Mass-spring network against theory.

use nalgebra::{DMatrix, DVector, Vector3};

use super::super::cylinder::Cylinder;
use super::super::network::Network;
use super::super::testing::*;
use super::super::*;
use crate::insertion::InvalidSetup;

fn small() -> MassSpringParameters {
    MassSpringParameters {
        radius_mm: 10.0,
        length_mm: Some(20.0),
        rings: 2,
        layers: Some(4),
        damping_per_s: 0.0,
        spring_damping_s: 0.0,
        ..MassSpringParameters::default()
    }
}

fn network(parameters: &MassSpringParameters) -> Network {
    Network::new(Cylinder::new(parameters).unwrap(), parameters)
}

fn go(network: &mut Network, h: f64) {
    network.find_forces();
    network.advance(h);
}

/// Pseudo-random displacements of up to 1 mm.
fn shake(network: &mut Network) {
    let mut number = 1u64;
    let mut next = || {
        number = number
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        (number >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    };
    for node in 0..network.mass.len() {
        if !network.fixed[node] {
            network.displacement[node] = Vector3::new(next(), next(), next());
        }
    }
}

#[test]
fn the_cylinder_is_whole() {
    for (rings, sectors, layers) in [(1, 3, 2), (1, 12, 2), (2, 5, 3), (5, 6, 20)] {
        let parameters = MassSpringParameters {
            rings,
            sectors,
            layers: Some(layers),
            radius_mm: 5.0 * rings as f64,
            length_mm: Some(5.0 * layers as f64),
            ..MassSpringParameters::default()
        };
        let cylinder = Cylinder::new(&parameters).unwrap();
        assert_eq!(cylinder.mesh.nodes().len(), parameters.nodes());
        // A prism with as many sides as the last ring has nodes.
        let sides = (rings * sectors) as f64;
        let area = 0.5 * sides * (5.0 * rings as f64).powi(2) * (std::f64::consts::TAU / sides).sin();
        let volumes = cylinder.mesh.volumes(cylinder.mesh.nodes());
        let inner = (std::f64::consts::TAU / sides).cos();
        let total: f64 = volumes.inspect(|&volume| assert!(volume > 0.0)).sum();
        assert!((total / (area * parameters.length_mm()) - 1.0).abs() < 1e-12, "{inner}");
        // Only its surface has faces without a neighbour: as many triangles as top, bottom and side have.
        let outside = cylinder
            .mesh
            .neighbours()
            .iter()
            .flatten()
            .filter(|&&neighbour| neighbour == u32::MAX)
            .count();
        assert_eq!(outside, 2 * sectors * rings * rings + 2 * sectors * rings * layers);
    }
    assert!(
        Cylinder::new(&MassSpringParameters::default())
            .unwrap()
            .least_dihedral_deg
            > 35.0
    );
    let thin = Cylinder::new(&MassSpringParameters {
        length_mm: Some(2000.0),
        layers: Some(20),
        ..MassSpringParameters::default()
    });
    assert!(matches!(thin, Err(InvalidSetup::Thin { .. })));
}

#[test]
fn numbers_out_of_range_are_named() {
    type Spoil = fn(&mut MassSpringParameters);
    let spoils: [(&str, Spoil); 11] = [
        ("young_kpa", |parameters| parameters.young_kpa = 0.0),
        ("density_kg_per_m3", |parameters| {
            parameters.density_kg_per_m3 = f64::NAN
        }),
        ("damping_per_s", |parameters| parameters.damping_per_s = -1.0),
        ("spring_damping_s", |parameters| {
            parameters.spring_damping_s = f64::INFINITY
        }),
        ("radius_mm", |parameters| parameters.radius_mm = -1.0),
        ("length_mm", |parameters| parameters.length_mm = Some(0.0)),
        ("rings", |parameters| parameters.rings = 0),
        ("sectors", |parameters| parameters.sectors = 2),
        ("layers", |parameters| parameters.layers = Some(1)),
        ("lambda", |parameters| parameters.lambda = 0.3),
        ("most_substeps", |parameters| parameters.most_substeps = 0),
    ];
    assert_eq!(MassSpringParameters::default().check(), Ok(()));
    for (expected, spoil) in spoils {
        let mut parameters = MassSpringParameters::default();
        spoil(&mut parameters);
        let Err(error) = parameters.check() else {
            panic!("{expected}");
        };
        assert!(matches!(error, InvalidSetup::Number(error) if error.key == expected));
    }
    let large = MassSpringParameters {
        rings: 64,
        layers: Some(1000),
        ..MassSpringParameters::default()
    };
    assert!(matches!(large.check(), Err(InvalidSetup::Large { .. })));
}

#[test]
fn rest_stays_at_rest_to_the_bit() {
    let mut network = network(&small());
    network.place(&nalgebra::Isometry3::new(
        Vector3::new(13.7, -8.1, 120.3),
        Vector3::new(0.3, 1.1, -0.7),
    ));
    for _ in 0..100 {
        let h = network.limit_s;
        go(&mut network, h);
    }
    assert!(
        network
            .displacement
            .iter()
            .all(|displacement| *displacement == Vector3::zeros())
    );
    assert_eq!(network.energy(), 0.0);
}

/// Springs act in pairs: for any displacements, the sums of their forces and torques on all nodes, the fixed ones
/// included, vanish.
#[test]
fn forces_balance() {
    let mut network = network(&small());
    shake(&mut network);
    network.find_forces();
    let sum: Vector3<f64> = network.force.iter().sum();
    let turn: Vector3<f64> = network
        .force
        .iter()
        .zip(&network.reference)
        .map(|(force, position)| position.cross(force))
        .sum();
    let size: f64 = network.force.iter().map(|force| force.norm()).sum();
    assert!(sum.norm() < 1e-14 * size && turn.norm() < 1e-13 * size * 20.0);
    assert!(size > 1.0);
}

/// Computes the stiffness of the free nodes by unit displacements, divided by their masses: M^-1/2 K M^-1/2.
fn dynamic_matrix(network: &mut Network) -> (Vec<usize>, DMatrix<f64>) {
    let free: Vec<usize> = (0..network.mass.len()).filter(|&node| !network.fixed[node]).collect();
    let mut matrix = DMatrix::zeros(3 * free.len(), 3 * free.len());
    for (column, &node) in free.iter().enumerate() {
        for axis in 0..3 {
            network.rest();
            network.displacement[node][axis] = 1.0;
            network.find_forces();
            for (row, &row_node) in free.iter().enumerate() {
                let scale = (network.mass[node] * network.mass[row_node]).sqrt();
                for row_axis in 0..3 {
                    matrix[(3 * row + row_axis, 3 * column + axis)] = -network.force[row_node][row_axis] / scale;
                }
            }
        }
    }
    network.rest();
    (free, matrix)
}

/// Each eigenmode follows the symplectic Euler solution of an oscillator: x_n = x_0 (cos nt - tan(t/2) sin nt) with cos
/// t = 1 - (h w)^2 / 2; and no frequency is beyond the limit.
#[test]
fn free_vibrations_have_their_frequency() {
    let parameters = MassSpringParameters {
        rings: 1,
        layers: Some(3),
        length_mm: Some(24.0),
        ..small()
    };
    let mut network = network(&parameters);
    let (free, matrix) = dynamic_matrix(&mut network);
    assert_eq!(free.len(), 3);
    assert!((&matrix - matrix.transpose()).amax() < 1e-12 * matrix.amax());
    let modes = matrix.symmetric_eigen();
    let limit = network.limit_s;
    for (index, squared) in modes.eigenvalues.iter().enumerate() {
        let frequency = squared.sqrt();
        assert!(limit < 2.0 / frequency);
        for h in [0.02 / frequency, 0.9 * limit] {
            network.rest();
            let mode: DVector<f64> = modes.eigenvectors.column(index).into();
            for (row, &node) in free.iter().enumerate() {
                network.displacement[node] =
                    mode.fixed_rows::<3>(3 * row).into_owned() / network.mass[node].sqrt() * 1e-4;
            }
            let start = network.displacement.clone();
            let steps = 1000;
            (0..steps).for_each(|_| go(&mut network, h));
            let angle = (1.0 - 0.5 * squared * h * h).acos();
            let turned = steps as f64 * angle;
            let share = turned.cos() - (0.5 * angle).tan() * turned.sin();
            for &node in &free {
                let miss = (network.displacement[node] - start[node] * share).norm();
                assert!(miss < 1e-9 * start.iter().map(|displacement| displacement.norm()).fold(0.0, f64::max));
            }
            if h * frequency < 0.1 {
                // At short steps that is the frequency of the oscillator itself, to (h w)^2 / 24.
                assert!((angle / h / frequency - 1.0).abs() < squared * h * h / 20.0);
            }
        }
    }
}

/// Undamped at the limit itself: v M v + u K u - h v K u is constant, so energy stays within (1 + a) / (1 - a) times
/// the first, a being half the step times the highest frequency.
#[test]
fn undamped_energy_stays_bounded() {
    let mut network = network(&small());
    shake(&mut network);
    let h = network.limit_s;
    let invariant = |network: &mut Network| {
        network.find_forces();
        let mixed: f64 = network.velocity.iter().zip(&network.force).map(|(v, f)| v.dot(f)).sum();
        network.energy() + 0.5 * h * mixed
    };
    let (first_invariant, energy) = (invariant(&mut network), network.energy());
    let a = 0.95;
    for _ in 0..10_000 {
        go(&mut network, h);
        assert!(network.energy() <= energy * (1.0 + a) / (1.0 - a));
    }
    assert!((invariant(&mut network) / first_invariant - 1.0).abs() < 1e-9);
    assert!(network.energy() > energy * (1.0 - a) / (1.0 + a));
}

/// With damping of either kind the energy never exceeds that bound of any earlier energy, and vanishes, up to the limit
/// stated for that damping.
#[test]
fn damped_energy_never_grows() {
    for (damping_per_s, spring_damping_s) in [(200.0, 0.0), (0.0, 1e-4), (200.0, 1e-4), (20.0, 1e-2), (2e4, 0.0)] {
        let mut network = network(&MassSpringParameters {
            damping_per_s,
            spring_damping_s,
            ..small()
        });
        shake(&mut network);
        let h = network.limit_s;
        let first_energy = network.energy();
        let mut least = first_energy;
        for _ in 0..10_000 {
            go(&mut network, h);
            let energy = network.energy();
            // (1 + a) / (1 - a) of a = 0.95; the last term is where squares underflow.
            assert!(energy <= 39.0 * least + 1e-290, "{damping_per_s} {spring_damping_s}");
            least = least.min(energy);
        }
        assert!(
            network.energy() < 1e-3 * first_energy,
            "{damping_per_s} {spring_damping_s}"
        );
    }
}

/// Beyond the limit the same springs diverge: the limit is not trivial.
#[test]
fn beyond_twice_the_limit_it_bursts() {
    let mut network = network(&small());
    shake(&mut network);
    let first_energy = network.energy();
    let h = 2.0 * network.limit_s;
    for _ in 0..200 {
        // Without the mass increase for stability.
        network.find_forces();
        for node in 0..network.mass.len() {
            if !network.fixed[node] {
                let gain = h / network.mass[node];
                network.velocity[node] += network.force[node] * gain;
                network.displacement[node] += network.velocity[node] * h;
            }
        }
    }
    assert!(network.energy() > 1e6 * first_energy);
}

/// A long cylinder fixed at both ends and stretched: its apparent modulus. Its springs are not distributed evenly over
/// directions, so that it is only about E; with the sides kept from contracting, the upper bound is 1.2 E (both Lame
/// parameters 0.4 E).
#[test]
fn drawn_out_it_shows_its_modulus() {
    let parameters = MassSpringParameters {
        radius_mm: 10.0,
        length_mm: Some(80.0),
        rings: 2,
        layers: Some(16),
        damping_per_s: 100.0,
        spring_damping_s: 0.0,
        ..MassSpringParameters::default()
    };
    let mut cylinder = Cylinder::new(&parameters).unwrap();
    for (fixed, node) in cylinder.fixed.iter_mut().zip(cylinder.mesh.nodes()) {
        *fixed = node[2] == 0.0 || node[2] == 80.0;
    }
    let mut network = Network::new(cylinder, &parameters);
    for node in 0..network.mass.len() {
        network.displacement[node].z = 0.01 * network.original[node].z;
    }
    let h = network.limit_s;
    (0..3000).for_each(|_| go(&mut network, h));
    let end = |z: f64| -> f64 {
        let end_nodes = (0..network.mass.len()).filter(|&node| network.original[node].z == z);
        end_nodes.map(|node| network.force[node].z).sum()
    };
    let (force, opposite) = (end(0.0), end(80.0));
    assert!((force + opposite).abs() < 1e-6 * force);
    let area = 6.0 * 100.0 * (std::f64::consts::TAU / 12.0).sin();
    let modulus_kpa = force / area / 0.01 * 1e3;
    assert!((modulus_kpa / 10.0 - 1.0).abs() < 0.2, "{modulus_kpa}");
}

/// A node that is moved and restored leaves masses and springs bit for bit, and moves no tissue.
#[test]
fn moved_and_restored() {
    let mut network = network(&coarse());
    for node in 0..network.mass.len() {
        network.displacement[node] = network.original[node] * 0.01 + Vector3::repeat(0.1);
    }
    let before = network.clone();
    let total: f64 = network.mass.iter().sum();
    let node = (0..network.mass.len() as u32)
        .find(|&node| !network.fixed[node as usize] && network.original[node as usize].z > 20.0);
    let node = node.unwrap();
    let element = network.around(node)[3];
    let corner = network.elements[element as usize]
        .iter()
        .position(|&corner| corner == node)
        .unwrap();
    let mut coordinates = [0.2; 4];
    coordinates[corner] = 0.4;
    let position = network.to_reference(element, &coordinates);
    assert!(network.take_to(node, element, &coordinates, &(position * 1.01 + Vector3::repeat(0.1))));
    assert_eq!(network.reference[node as usize], position);
    assert!((network.mass.iter().sum::<f64>() / total - 1.0).abs() < 1e-12);
    // A linear field is reproduced exactly wherever the node is.
    network.find_forces();
    network.restore(node);
    assert_eq!(format!("{:?}", network.reference), format!("{:?}", before.reference));
    assert_eq!(network.mass, before.mass);
    assert!((network.displacement[node as usize] - before.displacement[node as usize]).norm() < 1e-13);
    let moving = |network: &Network| {
        (0..network.mass.len() as u32)
            .map(|node| network.moving_mass(node, 1.0))
            .collect::<Vec<_>>()
    };
    assert_eq!(moving(&network), moving(&before));
    // Onto the face opposite: the element would be flat.
    coordinates = [1.0 / 3.0; 4];
    coordinates[corner] = 0.0;
    assert!(!network.take_to(node, element, &coordinates, &position));
    assert_eq!((network.mass, network.reference), (before.mass, before.reference));
}
