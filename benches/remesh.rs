//! Remeshing at every level, at about 3,300 nodes and 16,000 tetrahedra with 60 contact degrees of freedom: the reference work
//! of the project.
//!
//! Levels I to III use all cores, the exact level one. Its groups give |S|: the same nodes are moved again and again, so that S
//! stays as large as it is. `refactor` is what a user would do without any of this: assemble, factor, solve for the contacts.
//! The dense inverse that levels I to IV start from is computed once and takes seconds.

use std::sync::Arc;
use std::time::Duration;

use criterion::{Criterion, SamplingMode, criterion_group, criterion_main};
use insonify::mechanics::mesh::TetMesh;
use insonify::mechanics::tissue::columns::Columns;
use insonify::mechanics::tissue::compliance::Compliance;
use insonify::mechanics::tissue::dofs::Dofs;
use insonify::mechanics::tissue::factor::Factor;
use insonify::mechanics::tissue::inverse::invert;
use insonify::mechanics::tissue::material::Material;
use insonify::mechanics::tissue::remesh::{Adaptation, AdaptedMesh, Level, Options, Precision, Source};

/// Extent of the block, mm.
const EXTENT: [f64; 3] = [100.0, 80.0, 80.0];

/// Nodes of the mesh, about.
const NODES: usize = 3300;

/// Sizes of S, about.
const HELD: [usize; 5] = [50, 125, 250, 500, 750];

struct Tissue {
    mesh: AdaptedMesh,
    factor: Arc<Factor>,
    /// Degrees of freedom of 20 nodes spread over the inside.
    contacts: Vec<usize>,
    /// Nodes by their distance from a line through the block: those that a needle meets, and ever more around it.
    track: Vec<u32>,
}

fn adapted() -> AdaptedMesh {
    let mesh = TetMesh::over_box([0.0; 3], EXTENT, NODES).expect("a box");
    let floor = mesh.nodes().iter().zip(0..).filter(|(p, _)| p[2] == 0.0);
    let fixed: Vec<u32> = floor.map(|(_, node)| node).collect();
    let dofs = Dofs::new(
        mesh.nodes().len(),
        fixed.iter().flat_map(|node| [0, 1, 2].map(|axis| (*node, axis))),
    );
    let materials = vec![Material::new(10.0, 0.45).expect("a material"); mesh.elements().len()];
    AdaptedMesh::new(&mesh, &materials, &dofs).expect("a usable mesh")
}

impl Tissue {
    fn new() -> Tissue {
        let mesh = adapted();
        let factor = Arc::new(Factor::new(mesh.stiffness()).expect("positive definite"));
        let inside = |p: &[f64; 3]| (0..3).all(|axis| p[axis] > 10.0 && p[axis] < EXTENT[axis] - 10.0);
        let nodes = mesh.base().iter().zip(0..).filter(|(p, _)| inside(p));
        let mut track: Vec<u32> = nodes.map(|(_, node)| node).collect();
        let spread = track.iter().step_by(track.len() / 20).take(20);
        let contacts = spread
            .flat_map(|node| mesh.dofs().of(*node))
            .map(|dof| dof as usize)
            .collect();
        let off_line = |node: &u32| {
            let p = mesh.base()[*node as usize];
            (p[1] - 40.0).powi(2) + (p[2] - 40.0).powi(2)
        };
        track.sort_by(|a, b| off_line(a).total_cmp(&off_line(b)).then(a.cmp(b)));
        Tissue {
            mesh,
            factor,
            contacts,
            track,
        }
    }

    fn follow(&self, source: Source, level: Level, precision: Precision) -> Mover<'_> {
        let options = Options::default();
        let adaptation = Adaptation::new(self.mesh.clone(), source, level, precision, options);
        let mut adaptation = adaptation.expect("a remesher");
        adaptation.parts().1.set_contacts(&self.contacts).expect("contacts");
        Mover {
            tissue: self,
            adaptation,
            nodes: 8,
            count: 0,
        }
    }
}

/// Moves nodes in turn.
struct Mover<'a> {
    tissue: &'a Tissue,
    adaptation: Adaptation,
    /// How many.
    nodes: usize,
    count: usize,
}

impl Mover<'_> {
    /// Moves the next node up to 1 mm along each axis; |S| after it.
    fn step(&mut self) -> usize {
        let node = self.tissue.track[self.count % self.nodes];
        let base = self.adaptation.mesh().base()[node as usize];
        let phase = self.count as f64;
        self.count += 1;
        let to = std::array::from_fn(|axis| base[axis] + (1.7 * phase + axis as f64).sin());
        self.adaptation.move_node(node, to).expect("a small move").held
    }

    /// Moves further nodes until S is this large.
    fn grow(&mut self, held: usize) -> usize {
        self.nodes = 1;
        loop {
            self.count = self.nodes - 1;
            let found = self.step();
            if found >= held || self.nodes == self.tissue.track.len() {
                return found;
            }
            self.nodes += 1;
        }
    }
}

fn remesh(criterion: &mut Criterion) {
    let tissue = Tissue::new();
    let size = tissue.mesh.dofs().free();
    println!("{} nodes, {size} degrees of freedom", tissue.mesh.nodes().len());
    let dense = Source::Double(Arc::new(invert(&tissue.factor, |_, _| {}).expect("an inverse")));

    let mut group = criterion.benchmark_group("remesh/exact");
    for held in HELD {
        let mut mover = tissue.follow(dense.clone(), Level::Exact, Precision::Double);
        let held = mover.grow(held);
        group.bench_function(format!("|S| = {held}"), |bencher| bencher.iter(|| mover.step()));
    }
    group.finish();

    let mut group = criterion.benchmark_group("remesh/levels");
    group.sampling_mode(SamplingMode::Flat);
    for level in [Level::I, Level::II, Level::III, Level::IV] {
        for precision in [Precision::Single, Precision::Double] {
            let mut mover = tissue.follow(dense.clone(), level, precision);
            group.bench_function(format!("{level} {precision}"), |bencher| bencher.iter(|| mover.step()));
        }
    }
    group.finish();
}

fn alternatives(criterion: &mut Criterion) {
    let tissue = Tissue::new();
    let mut group = criterion.benchmark_group("remesh/alternatives");
    group.sampling_mode(SamplingMode::Flat);
    group.bench_function("refactor and solve for the contacts", |bencher| {
        let mut factor = (*tissue.factor).clone();
        bencher.iter(|| {
            let stiffness = tissue
                .mesh
                .stiffness()
                .at_nodes(tissue.mesh.nodes())
                .expect("a usable mesh");
            factor.refactor(&stiffness).expect("positive definite");
            let mut columns = Columns::new(Arc::new(factor.clone()), tissue.contacts.len());
            columns.prefetch(&tissue.contacts).expect("columns");
        });
    });
    group.bench_function("start up without a dense inverse", |bencher| {
        bencher.iter(|| {
            let mesh = adapted();
            let factor = Arc::new(Factor::new(mesh.stiffness()).expect("positive definite"));
            let source = Source::Columns(Columns::new(factor, 1000));
            let adaptation = Adaptation::new(mesh, source, Level::Exact, Precision::Double, Options::default());
            let mut adaptation = adaptation.expect("a remesher");
            adaptation.parts().1.set_contacts(&tissue.contacts).expect("contacts");
            adaptation
        });
    });
    group.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .sample_size(20)
        .warm_up_time(Duration::from_millis(500))
        .measurement_time(Duration::from_secs(2));
    targets = remesh, alternatives
}
criterion_main!(benches);
