//! Cases of tissue laws: each runs on every law of the registry.

use std::sync::Arc;

use nalgebra::{Matrix3, Rotation3, Vector3};

use super::fixtures::shaken;
use super::record::{Record, Unexpected, largest, relative};
use super::{Group, HardCase};
use insonify_mechanics::tissue::element::DegenerateElement;
use insonify_mechanics::tissue::law::{AnyLaw, Tensor};
use insonify_mechanics::tissue::material::Material;
use insonify_mechanics::tissue::nonlinear::{NonlinearError, Scheme, Solid, Solver, SolverOptions, Supports, Target};

/// Group of the cases of laws.
pub(crate) const GROUP: Group = Group {
    name: "Tissue laws",
    cases: &[
        HardCase {
            name: "compressed to 0.3",
            criterion: "every law, a block to 0.3 of its height in one increment: between smooth walls the law's own stress and energy to \
                        1e-8; glued to both plates no element inverted, forces in balance to 1e-9, and the work of the plates the energy \
                        of the tissue to 1e-4",
            covers: &["cpu f64"],
            seed: 141,
            run: compressed,
        },
        HardCase {
            name: "Poisson's ratio 0.499",
            criterion: "every law, a bar to 0.7 and 1.5 of its length: stretches across and force of the law alone to 1e-7; glued to both \
                        plates forces in balance to 1e-9 and the work of the plates the energy of the tissue to 1e-4",
            covers: &["cpu f64"],
            seed: 142,
            run: nearly_incompressible,
        },
        HardCase {
            name: "an inverted element",
            criterion: "every law: an element inverted at rest is refused by name; a block turned by 120 degrees at once, which Newton's \
                        first step inverts, is solved to 1e-8; a face pushed through the opposite one is refused by name under laws of \
                        finite strain, the state as before, and solved exactly under those of small strain",
            covers: &["cpu f64"],
            seed: 143,
            run: inverted,
        },
    ],
};

/// Edge of the block, mm.
const EDGE_MM: f64 = 8.0;
const CELLS: usize = 4;
/// Largest unbalanced force relative to the largest.
const TOLERANCE: f64 = 1e-11;
/// Newtons per square millimetre in one kilopascal.
const NEWTON_PER_MM2: f64 = 1e-3;

/// A block of tissue of one law.
struct Block {
    body: Arc<Solid>,
    law: AnyLaw,
    name: &'static str,
}

/// Displacement prescribed at each (node, axis), mm.
type Prescribed = Vec<(u32, u8, f64)>;

/// A block of each law.
fn blocks(poisson: f64, seed: u64) -> Result<Vec<Block>, Unexpected> {
    let mesh = shaken([CELLS; 3], [EDGE_MM; 3], 0.15, seed)?;
    let laws = AnyLaw::examples(Material::new(10.0, poisson)?)?;
    let block = |(name, law)| {
        let body = Solid::tetrahedra(&mesh, &vec![law; mesh.elements().len()])?;
        Ok(Block {
            body: Arc::new(body),
            law,
            name,
        })
    };
    laws.into_iter().map(block).collect()
}

/// Returns the stretch less one across a bar whose sides are free of stress, by bisection of the law alone.
fn across(law: &AnyLaw, stretch: f64) -> f64 {
    let side_kpa = |side: f64| law.stress_kpa(&Tensor::from_diagonal(&[side, side, stretch].into()))[(0, 0)];
    let (mut low, mut high) = (-0.9, 3.0);
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        *(if side_kpa(middle) < 0.0 { &mut low } else { &mut high }) = middle;
    }
    low
}

impl Block {
    fn solver(&self, prescribed: &Prescribed) -> Result<Solver<3, 4>, NonlinearError> {
        self.solver_to(prescribed, TOLERANCE)
    }

    fn solver_to(&self, prescribed: &Prescribed, tolerance: f64) -> Result<Solver<3, 4>, NonlinearError> {
        let nodes = self.body.nodes().len();
        let supports = Supports::new(nodes, prescribed.iter().map(|&(node, axis, _)| (node, axis)));
        let options = SolverOptions {
            scheme: Scheme::Newton,
            tolerance,
            ..SolverOptions::default()
        };
        Solver::new(Arc::clone(&self.body), supports, options)
    }

    /// Prescribes displacements, times a share, in one increment without loads.
    fn step(&self, solver: &mut Solver<3, 4>, prescribed: &Prescribed, share: f64) -> Result<(), NonlinearError> {
        let mut displacement_mm = vec![0.0; 3 * self.body.nodes().len()];
        for &(node, axis, value_mm) in prescribed {
            displacement_mm[3 * node as usize + usize::from(axis)] = share * value_mm;
        }
        let values: Vec<f64> = solver
            .supports()
            .prescribed()
            .iter()
            .map(|&dof| displacement_mm[dof as usize])
            .collect();
        let loads = vec![0.0; displacement_mm.len()];
        let target = Target {
            loads: &loads,
            prescribed: &values,
            contact: None,
            offset: None,
        };
        solver.step(&target).map(drop)
    }

    /// Nodes where a coordinate has a value, mm.
    fn face(&self, axis: usize, place_mm: f64) -> impl Iterator<Item = u32> {
        let nodes = (0..).zip(self.body.nodes());
        nodes
            .filter(move |(_, p)| (p[axis] - place_mm).abs() < 1e-9)
            .map(|(node, _)| node)
    }

    /// Smooth walls: at 0 on each axis, and on each axis with a stretch at the other end.
    fn walls(&self, stretches: [Option<f64>; 3]) -> Prescribed {
        let mut prescribed = Prescribed::new();
        for (axis, stretch) in stretches.iter().enumerate() {
            prescribed.extend(self.face(axis, 0.0).map(|node| (node, axis as u8, 0.0)));
            if let Some(stretch) = stretch {
                let stretch_mm = (stretch - 1.0) * EDGE_MM;
                prescribed.extend(self.face(axis, EDGE_MM).map(|node| (node, axis as u8, stretch_mm)));
            }
        }
        prescribed
    }

    /// Plates glued to both ends of the z axis.
    fn plates(&self, stretch: f64) -> Prescribed {
        let below = self
            .face(2, 0.0)
            .flat_map(|node| [0, 1, 2].map(|axis| (node, axis, 0.0)));
        let stretch_mm = (stretch - 1.0) * EDGE_MM;
        let above = self
            .face(2, EDGE_MM)
            .flat_map(move |node| [(node, 0, 0.0), (node, 1, 0.0), (node, 2, stretch_mm)]);
        below.chain(above).collect()
    }

    /// Prescribes an affine displacement of the whole surface.
    fn surface(&self, gradient: &Tensor) -> Prescribed {
        let outside = |p: &[f64; 3]| p.iter().any(|x| *x < 1e-9 || *x > EDGE_MM - 1e-9);
        let nodes = (0..).zip(self.body.nodes()).filter(|(_, p)| outside(p));
        nodes
            .flat_map(|(node, p)| {
                let displacement = gradient * Vector3::from(*p);
                [0, 1, 2].map(|axis| (node, axis, displacement[usize::from(axis)]))
            })
            .collect()
    }

    /// Largest difference of the displacements from an affine field, relative to its largest.
    fn error(&self, solver: &Solver<3, 4>, gradient: &Tensor) -> f64 {
        let affine = |p: &[f64; 3]| <[f64; 3]>::from(gradient * Vector3::from(*p));
        let exact: Vec<f64> = self.body.nodes().iter().flat_map(affine).collect();
        relative(solver.displacement(), &exact)
    }

    /// Force on the plate or wall at the end of the z axis, N.
    fn force_n(&self, solver: &Solver<3, 4>) -> f64 {
        self.face(2, EDGE_MM)
            .map(|node| solver.forces()[3 * node as usize + 2])
            .sum()
    }

    /// Sum of all forces along the worst axis, relative to the force on the plate.
    fn imbalance(&self, solver: &Solver<3, 4>) -> f64 {
        let sum = |axis: usize| solver.forces().iter().skip(axis).step_by(3).sum::<f64>();
        largest([0, 1, 2].map(sum)) / self.force_n(solver).abs()
    }

    /// Strain energy, N mm; `None` for a law without one.
    fn energy_nmm(&self, solver: &Solver<3, 4>) -> Option<f64> {
        let edges = |corners: &[u32; 4], position: &dyn Fn(u32) -> Vector3<f64>| {
            Matrix3::from_columns(&[1, 2, 3].map(|corner| position(corners[corner]) - position(corners[0])))
        };
        let at_rest = |node: u32| Vector3::from(self.body.nodes()[node as usize]);
        let displacement = |node: u32| Vector3::from_column_slice(&solver.displacement()[3 * node as usize..][..3]);
        let energies = self.body.elements().iter().map(|corners| {
            let reference = edges(corners, &at_rest);
            let gradient = edges(corners, &displacement) * reference.try_inverse()?;
            Some(self.law.energy_kpa(&gradient)? * reference.determinant() / 6.0 * NEWTON_PER_MM2)
        });
        energies.sum()
    }

    fn inverted(&self, solver: &Solver<3, 4>) -> usize {
        let elements = 0..self.body.elements().len();
        elements
            .filter(|element| self.body.is_inverted(*element, solver.displacement()))
            .count()
    }

    /// Compresses the block between glued plates at once, and again in many increments, by whose forces the plates do
    /// work.
    fn press(&self, record: &mut Record<'_>, stretch: f64) -> Result<(), Unexpected> {
        let name = format!("{}, glued, to {stretch}", self.name);
        let plates = self.plates(stretch);
        let mut at_once = self.solver(&plates)?;
        self.step(&mut at_once, &plates, 1.0)?;
        record.under(format!("imbalance, {name}"), self.imbalance(&at_once), 1e-9);
        let mut gradual = self.solver(&plates)?;
        let increments = record.effort().pick(32, 128);
        let mut forces = vec![0.0];
        for increment in 1..=increments {
            self.step(&mut gradual, &plates, f64::from(increment) / f64::from(increments))?;
            forces.push(self.force_n(&gradual));
        }
        record.under(
            format!("one increment unlike {increments}, {name}"),
            relative(at_once.displacement(), gradual.displacement()),
            1e-8,
        );
        if self.law.as_secant().is_none() {
            record.zero(format!("elements inverted, {name}"), self.inverted(&at_once) as f64);
        }
        // Simpson's rule over pairs of increments.
        let step_mm = (stretch - 1.0) * EDGE_MM / f64::from(increments);
        let pairs = forces.windows(3).step_by(2);
        let work: f64 = pairs.map(|f| (f[0] + 4.0 * f[1] + f[2]) * step_mm / 3.0).sum();
        if let Some(energy) = self.energy_nmm(&gradual) {
            record.under(format!("work unlike energy, {name}"), (work / energy - 1.0).abs(), 1e-4);
        }
        record.report(format!("force, N, {name}"), self.force_n(&at_once));
        Ok(())
    }
}

/// Tests blocks of every law compressed to three tenths of their height.
fn compressed(record: &mut Record<'_>) -> Result<(), Unexpected> {
    const STRETCH: f64 = 0.3;
    for block in blocks(0.45, record.seed())? {
        let name = format!("{}, between walls", block.name);
        let gradient = Tensor::from_diagonal(&[0.0, 0.0, STRETCH - 1.0].into());
        let walls = block.walls([Some(1.0), Some(1.0), Some(STRETCH)]);
        let mut solver = block.solver(&walls)?;
        block.step(&mut solver, &walls, 1.0)?;
        record.under(format!("displacement, {name}"), block.error(&solver, &gradient), 1e-8);
        let stress = block.law.stress_kpa(&gradient)[(2, 2)];
        let expected = stress * EDGE_MM.powi(2) * NEWTON_PER_MM2;
        record.under(
            format!("force, {name}"),
            (block.force_n(&solver) / expected - 1.0).abs(),
            1e-8,
        );
        if let (Some(energy_nmm), Some(exact)) = (block.energy_nmm(&solver), block.law.energy_kpa(&gradient)) {
            let expected = exact * EDGE_MM.powi(3) * NEWTON_PER_MM2;
            record.under(format!("energy, {name}"), (energy_nmm / expected - 1.0).abs(), 1e-8);
        }
        block.press(record, STRETCH)?;
    }
    Ok(())
}

/// Tests blocks of every law that hardly change their volume.
fn nearly_incompressible(record: &mut Record<'_>) -> Result<(), Unexpected> {
    for block in blocks(0.499, record.seed())? {
        for stretch in [0.7, 1.5] {
            let name = format!("{}, a bar to {stretch}", block.name);
            let side = across(&block.law, stretch - 1.0);
            let gradient = Tensor::from_diagonal(&[side, side, stretch - 1.0].into());
            let walls = block.walls([None, None, Some(stretch)]);
            let mut solver = block.solver(&walls)?;
            block.step(&mut solver, &walls, 1.0)?;
            record.under(format!("displacement, {name}"), block.error(&solver, &gradient), 1e-7);
            let stress = block.law.stress_kpa(&gradient)[(2, 2)];
            let expected = stress * EDGE_MM.powi(2) * NEWTON_PER_MM2;
            record.under(
                format!("force, {name}"),
                (block.force_n(&solver) / expected - 1.0).abs(),
                1e-7,
            );
        }
        block.press(record, 0.8)?;
    }
    Ok(())
}

/// Tests elements that are inverted at rest, on the way to the solution, and in it.
fn inverted(record: &mut Record<'_>) -> Result<(), Unexpected> {
    for block in blocks(0.45, record.seed())? {
        let mut elements = block.body.elements().to_vec();
        let spoilt = elements.len() / 2;
        elements[spoilt].swap(2, 3);
        record.refused(
            format!("an element inverted at rest, {}", block.name),
            Solid::of(block.body.nodes().to_vec(), elements, &vec![block.law; block.body.elements().len()], 1.0),
            |error| {
                matches!(error, NonlinearError::Element { element, cause: DegenerateElement::Inverted { .. } } if *element == spoilt)
            },
        );

        // Rigidly turned, tissue of finite strain has no stress; the way there crosses flat elements only at half a
        // turn.
        let turn = Rotation3::from_euler_angles(0.0, 120f64.to_radians(), 0.0).into_inner() - Tensor::identity();
        let surface = block.surface(&turn);
        let mut solver = block.solver(&surface)?;
        block.step(&mut solver, &surface, 1.0)?;
        record.under(
            format!("displacement, turned, {}", block.name),
            block.error(&solver, &turn),
            1e-8,
        );
        let exact = block.law.stress_kpa(&turn);
        let largest_error = |stress: &[[f64; 3]; 3]| {
            largest((0..9).map(|entry| stress[entry / 3][entry % 3] - exact[(entry / 3, entry % 3)]))
        };
        if block.law.as_secant().is_none() {
            let stresses = solver.body().stresses_kpa(solver.displacement(), solver.displacement());
            record.under(
                format!("stress, turned, kPa, {}", block.name),
                largest(stresses.iter().map(largest_error)),
                1e-6,
            );
        }

        // The end beyond the opposite wall: the flatter the elements, the fewer digits their stress has, so to the
        // usual tolerance.
        let walls = block.walls([Some(1.0), Some(1.0), Some(-0.2)]);
        let mut solver = block.solver_to(&walls, SolverOptions::default().tolerance)?;
        let gradient = Tensor::from_diagonal(&[0.0, 0.0, -1.2].into());
        let answer = block.step(&mut solver, &walls, 1.0);
        if block.law.as_secant().is_some() {
            answer?;
            record.under(
                format!("displacement, pushed through, {}", block.name),
                block.error(&solver, &gradient),
                1e-8,
            );
            let missed = block.body.elements().len() - block.inverted(&solver);
            record.zero(format!("inverted elements not seen, {}", block.name), missed as f64);
        } else {
            record.refused(format!("pushed through, {}", block.name), answer, |error| {
                matches!(error, NonlinearError::Inverted { .. })
            });
            record.zero(
                format!("displacement left, pushed through, {}", block.name),
                largest(solver.displacement().iter().copied()),
            );
            let half = block.walls([Some(1.0), Some(1.0), Some(0.5)]);
            block.step(&mut solver, &half, 1.0)?;
            let gradient = Tensor::from_diagonal(&[0.0, 0.0, -0.5].into());
            record.under(
                format!("displacement after that, {}", block.name),
                block.error(&solver, &gradient),
                1e-8,
            );
        }
    }
    Ok(())
}
