//! Static finite elements at the size of a detailed training model: 3,328 nodes, 16,200 tetrahedra, 9,360 free degrees
//! of freedom. Assembly, ordering and factorisation, and solutions, on one thread.

use std::hint::black_box;
use std::sync::Arc;
use std::time::Duration;

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use faer::Mat;
use insonify_mechanics::tissue::assembly::Stiffness;
use insonify_mechanics::tissue::dofs::Dofs;
use insonify_mechanics::tissue::factor::Factor;
use insonify_mechanics::tissue::material::{Material, Materials};
use insonify_mechanics::tissue::nonlinear::{Scheme, Solid, Solver, SolverOptions, Stiffening, Supports, Target};
use insonify_mechanics::tissue::problem::{Fix, Load, StaticProblem};
use insonify_mesh::TetMesh;
use nalgebra::Matrix4;

/// Cells of the lattice, of 10 mm each.
const CELLS: [usize; 3] = [15, 15, 12];

/// A block held at one face.
struct Block {
    mesh: TetMesh,
    materials: Vec<Material>,
    dofs: Dofs,
    held: Vec<(u32, u8)>,
}

fn block() -> Block {
    let [x, y, z] = CELLS.map(|cells| 10.0 * cells as f64);
    let to_world = Matrix4::from_diagonal(&[x, y, z, 1.0].into());
    let mesh = TetMesh::lattice(CELLS, &to_world).expect("a lattice");
    let face = (0..).zip(mesh.nodes()).filter(|(_, position)| position[1] == 0.0);
    let held: Vec<(u32, u8)> = face.flat_map(|(node, _)| [0, 1, 2].map(|axis| (node, axis))).collect();
    Block {
        materials: vec![soft(); mesh.elements().len()],
        dofs: Dofs::new(mesh.nodes().len(), held.iter().copied()),
        held,
        mesh,
    }
}

fn soft() -> Material {
    Material::new(5.0, 0.45).expect("a material")
}

fn stiffness(block: &Block) -> Stiffness {
    Stiffness::assemble(&block.mesh, &block.materials, &block.dofs).expect("a sound mesh")
}

fn assembly(criterion: &mut Criterion) {
    let block = block();
    let assembled = stiffness(&block);
    let mut group = criterion.benchmark_group("tissue/assembly");
    group.bench_function("from the mesh", |bencher| bencher.iter(|| stiffness(black_box(&block))));
    group.bench_function("nodes moved", |bencher| {
        bencher.iter(|| assembled.at_nodes(black_box(block.mesh.nodes())).expect("a sound mesh"));
    });
    group.finish();
}

fn factor(criterion: &mut Criterion) {
    let stiffness = stiffness(&block());
    let mut factor = Factor::new(&stiffness).expect("positive definite");
    let mut group = criterion.benchmark_group("tissue/factor");
    group.bench_function("ordering and factorisation", |bencher| {
        bencher.iter(|| Factor::new(black_box(&stiffness)).expect("positive definite"));
    });
    group.bench_function("factorisation", |bencher| {
        bencher.iter(|| factor.refactor(black_box(&stiffness)).expect("positive definite"));
    });
    group.finish();
}

fn solve(criterion: &mut Criterion) {
    let stiffness = stiffness(&block());
    let factor = Factor::new(&stiffness).expect("positive definite");
    let size = factor.size();
    let load = |row: usize, column: usize| 1e-3 * ((row + 7 * column) % 11) as f64;
    let mut group = criterion.benchmark_group("tissue/solve");
    group.bench_function("one load", |bencher| {
        let loads: Vec<f64> = (0..size).map(|row| load(row, 0)).collect();
        let fresh = || loads.clone();
        bencher.iter_batched_ref(fresh, |rhs| factor.solve_in_place(rhs), BatchSize::LargeInput);
    });
    group.bench_function("one load, with residual", |bencher| {
        let loads: Vec<f64> = (0..size).map(|row| load(row, 0)).collect();
        bencher.iter(|| factor.solve_refined(&stiffness, black_box(&loads)));
    });
    for columns in [24, 60] {
        let loads = Mat::from_fn(size, columns, load);
        group.bench_function(format!("{columns} loads"), |bencher| {
            let fresh = || loads.clone();
            bencher.iter_batched_ref(
                fresh,
                |rhs| factor.solve_many_in_place(rhs.as_mut()),
                BatchSize::LargeInput,
            );
        });
    }
    group.finish();
}

fn problem(criterion: &mut Criterion) {
    let block = block();
    let fix = |&(node, axis): &(u32, u8)| Fix {
        node,
        axis,
        displacement_mm: 0.0,
    };
    let problem = StaticProblem {
        mesh: &block.mesh,
        materials: Materials::uniform(soft()),
        fixes: block.held.iter().map(fix).collect(),
        loads: vec![Load {
            node: block.mesh.nodes().len() as u32 - 1,
            force_n: [0.0, 0.01, 0.0],
        }],
    };
    criterion.bench_function("tissue/problem", |bencher| {
        bencher.iter(|| problem.solve().expect("solvable"))
    });
}

/// A plate of 20 x 20 mm that goes to and fro by half a millimetre, 8 mm deep in tissue that stiffens above a relative
/// strain of 0.1: forces in balance to a millionth.
fn nonlinear(criterion: &mut Criterion) {
    let block = block();
    let law = Stiffening::new(soft(), 0.1, 20.0).expect("a law");
    let body = Solid::tetrahedra(&block.mesh, &vec![law; block.mesh.elements().len()]).expect("a sound mesh");
    let body = Arc::new(body);
    let [x, y, z] = CELLS.map(|cells| 10.0 * cells as f64);
    let near = |p: f64, middle: f64| (p - middle).abs() < 11.0;
    let plate = (0..)
        .zip(block.mesh.nodes())
        .filter(|(_, p)| p[1] == y && near(p[0], x / 2.0) && near(p[2], z / 2.0));
    let plate: Vec<u32> = plate.map(|(node, _)| node).collect();
    let held = block.held.iter().copied().chain(plate.iter().map(|node| (*node, 1)));
    let supports = Supports::new(block.mesh.nodes().len(), held);
    let loads = vec![0.0; supports.all()];
    let at = |depth: f64| -> Vec<f64> {
        let driven = |dof: &u32| plate.contains(&(dof / 3)) && dof % 3 == 1;
        supports
            .prescribed()
            .iter()
            .map(|dof| if driven(dof) { -depth } else { 0.0 })
            .collect()
    };
    let mut group = criterion.benchmark_group("tissue/nonlinear");
    for (name, scheme) in [("modified Newton", Scheme::MODIFIED), ("full Newton", Scheme::Newton)] {
        let options = SolverOptions {
            scheme,
            tolerance: 1e-6,
            ..SolverOptions::default()
        };
        let mut solver = Solver::new(Arc::clone(&body), supports.clone(), options).expect("held");
        let go = |solver: &mut Solver<3, 4>, depth: f64| {
            let prescribed = at(depth);
            let target = Target {
                loads: &loads,
                prescribed: &prescribed,
                contact: None,
                offset: None,
            };
            solver.step(black_box(&target)).expect("solvable").iterations
        };
        for step in 1..=16 {
            go(&mut solver, 0.5 * f64::from(step));
        }
        // On from 8 mm, not back and forth: a way back is foreseen from the way there, and takes one iteration.
        group.bench_function(format!("a step, {name}"), |bencher| {
            bencher.iter_batched_ref(|| solver.clone(), |solver| go(solver, 8.5), BatchSize::PerIteration);
        });
    }
    group.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(20).measurement_time(Duration::from_secs(4));
    targets = assembly, factor, solve, problem, nonlinear
}
criterion_main!(benches);
