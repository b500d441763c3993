//! Remeshing with the inverse on a GPU: each pass against exact arithmetic and its twin in f32, whole sequences against
//! the inverse of the moved mesh.

use std::sync::Arc;

use faer::linalg::solvers::Solve;
use faer::{Mat, MatRef};
use insonify_base::real::Real;
use insonify_gpu::{Gpu, GpuError};
use insonify_mechanics::remesh_gpu::{DeviceStore, follow, tiles};
use insonify_mechanics::tissue::remesh::levels::{Levels, Store, Which};
use insonify_mechanics::tissue::remesh::{
    Adaptation, AdaptedMesh, Change, Level, Precision, Rebuilt, RemeshError, Remesher, RemesherOptions, Source,
};
use insonify_mechanics::tissue::symmetric::Symmetric;
use insonify_testing::lossy::{Lossy, with};

use super::remesh_support::{contacts, error, free_nodes, gold, mesh, noise, nth_move, part, rounding, single};
use insonify_testing::gpu::{gpu_or_skip, gpu_without_features};
use insonify_testing::lossy::BIASES;

/// Rounding unit of f32. WGSL allows either neighbour of an exact sum or product, twice as much; bounds of worst cases
/// leave room for that ([`bounds_of_updates_hold_for_the_least_accurate_arithmetic`]).
const UNIT: f64 = 0.5 * f32::EPSILON as f64;

/// gamma_n of Higham, Accuracy and Stability of Numerical Algorithms, section 3.1. Fused sums and products only help.
fn gamma(terms: usize) -> f64 {
    let n = terms as f64 * UNIT;
    n / (1.0 - n)
}

fn symmetric(size: usize, salt: u64) -> Symmetric<f32> {
    Symmetric::from_fn(size, |i, j| noise(((salt << 20) + i as u64) << 20 | j as u64) as f32)
}

/// `rank` different numbers below `size`, ascending.
fn choose(size: usize, rank: usize) -> Vec<usize> {
    (0..rank).map(|k| k * size / rank).collect()
}

fn all(store: &mut DeviceStore) -> Mat<f64> {
    let every: Vec<usize> = (0..store.size()).collect();
    store.entries(&every, &every).unwrap()
}

/// An update A - Y C Y^T of one case, exactly, and how far an entry in f32 may be from it.
struct Exact {
    value: Mat<f64>,
    bound: Mat<f64>,
}

impl Exact {
    /// Z = Y C has an error of gamma_s |Y| |C| in each entry, Y Z^T one of gamma_s |Y| |Z| beside what Z brings along,
    /// and the difference rounds once.
    fn of(a: &Symmetric<f32>, y: &Mat<f64>, c: &Mat<f64>) -> Exact {
        let rank = c.nrows();
        let magnitude = |m: &Mat<f64>| Mat::from_fn(m.nrows(), m.ncols(), |i, j| m[(i, j)].abs());
        let (value, y_abs, c_abs) = (y * c * y.transpose(), magnitude(y), magnitude(c));
        let total = &y_abs * &c_abs * y_abs.transpose();
        let old = |i, j| f64::from(a.get(i, j));
        Exact {
            bound: Mat::from_fn(a.size(), a.size(), |i, j| {
                2.02 * gamma(rank) * total[(i, j)] + 1.01 * UNIT * (old(i, j).abs() + total[(i, j)])
            }),
            value: Mat::from_fn(a.size(), a.size(), |i, j| old(i, j) - value[(i, j)]),
        }
    }

    fn check(&self, found: MatRef<'_, f64>, other: impl Fn(usize, usize) -> f64, case: &str) {
        for j in 0..found.ncols() {
            for i in 0..found.nrows() {
                let (own, bound) = (found[(i, j)], self.bound[(i, j)]);
                let far = (own - self.value[(i, j)]).abs();
                assert!(
                    far <= bound,
                    "{case}: ({i}, {j}) is {own}, off by {far:e}, allowed {bound:e}"
                );
                let apart = (own - other(i, j)).abs();
                assert!(apart <= 2.0 * bound, "{case}: ({i}, {j}) is {apart:e} from the CPU's");
            }
        }
    }
}

#[test]
fn updates_of_every_shape_follow_the_cpu() {
    let Some(gpu) = gpu_or_skip() else {
        return;
    };
    let tile = tiles::bytes_of(1);
    // Sizes around a tile's edge, ranks around the padding, and banks of one tile, two, and all.
    for (size, rank, bank) in [
        (1, 1, tile),
        (127, 15, tile),
        (128, 16, 2 * tile),
        (129, 17, tile),
        (300, 48, 2 * tile),
        (517, 60, 64 * tile),
    ] {
        let case = format!("{size} rows, rank {rank}, banks of {} tiles", bank / tile);
        let base = Arc::new(symmetric(size, 1));
        let columns = choose(size, rank);
        let y = Mat::from_fn(size, rank, |i, k| f64::from(base.get(i, columns[k])));
        let c = Mat::from_fn(rank, rank, |i, j| {
            f64::from(noise(7 << 40 | (i.max(j) as u64) << 20 | i.min(j) as u64) as f32)
        });
        let (y_single, c_single) = (
            Mat::from_fn(size, rank, |i, k| y[(i, k)] as f32),
            Mat::from_fn(rank, rank, |i, j| c[(i, j)] as f32),
        );
        let exact = Exact::of(&base, &y, &c);

        let mut store = DeviceStore::new(&gpu, Arc::clone(&base), rank, bank).unwrap();
        let count = tiles::bytes_of(size).div_ceil(bank);
        assert_eq!(store.bank_count() as u64, count, "{case}");
        let g = store.take(Which::Current, &columns).unwrap();
        for (i, j) in (0..rank).flat_map(|i| (0..rank).map(move |j| (i, j))) {
            assert_eq!(g[(i, j)], y[(columns[i], j)], "{case}: G");
        }
        let near = choose(size, size.min(20));
        let block = store.update(c.as_ref(), None, &near).unwrap();
        let found = all(&mut store);
        for (i, j) in (0..near.len()).flat_map(|i| (0..near.len()).map(move |j| (i, j))) {
            let (row, column) = (near[i], near[j]);
            let (ahead, bound) = ((block[(i, j)] - found[(row, column)]).abs(), exact.bound[(row, column)]);
            assert!(
                ahead <= bound,
                "{case}: ({row}, {column}) is {ahead:e} ahead, allowed {bound:e}"
            );
        }
        let mut twin = (*base).clone();
        twin.rank_update(y_single.as_ref(), c_single.as_ref()).unwrap();
        exact.check(found.as_ref(), |i, j| f64::from(twin.get(i, j)), &case);

        // From the base again, in batches of columns: the same to within the rounding of the batches.
        let mut narrow = DeviceStore::new(&gpu, Arc::clone(&base), rank.div_ceil(3), bank).unwrap();
        narrow.take(Which::Base, &columns).unwrap();
        narrow.restart(c.as_ref()).unwrap();
        let bound = Exact {
            bound: Mat::from_fn(size, size, |i, j| 4.0 * exact.bound[(i, j)]),
            value: exact.value.clone(),
        };
        bound.check(all(&mut narrow).as_ref(), |i, j| f64::from(twin.get(i, j)), &case);

        // Some rows and columns: the others keep their bits.
        let rows = choose(size, rank.div_ceil(3));
        let mut store = DeviceStore::new(&gpu, Arc::clone(&base), rank, bank).unwrap();
        store.take(Which::Current, &columns).unwrap();
        store.update(c.as_ref(), Some(&rows), &[]).unwrap();
        let mut twin = (*base).clone();
        twin.update_rows(&rows, y_single.as_ref(), c_single.as_ref()).unwrap();
        let named = |i: usize| rows.binary_search(&i).is_ok();
        let found = all(&mut store);
        let partial = Exact {
            value: Mat::from_fn(size, size, |i, j| {
                if named(i) || named(j) {
                    exact.value[(i, j)]
                } else {
                    f64::from(base.get(i, j))
                }
            }),
            bound: Mat::from_fn(
                size,
                size,
                |i, j| if named(i) || named(j) { exact.bound[(i, j)] } else { 0.0 },
            ),
        };
        partial.check(found.as_ref(), |i, j| f64::from(twin.get(i, j)), &case);
        for (i, j) in (0..size).flat_map(|i| (0..i).map(move |j| (i, j))) {
            assert_eq!(found[(i, j)], found[(j, i)], "{case}: one value for both triangles");
        }
    }
}

/// The update of the shader, in the least accurate arithmetic that WGSL allows.
#[test]
fn bounds_of_updates_hold_for_the_least_accurate_arithmetic() {
    let sum = |terms: &mut dyn Iterator<Item = Lossy>| terms.fold(Lossy::default(), |sum, term| sum + term);
    let mut worst = [0.0f64; BIASES.len()];
    for (worst, bias) in worst.iter_mut().zip(BIASES) {
        *worst = with(bias, || {
            let mut worst = 0.0f64;
            for (size, rank) in [(1, 1), (65, 17), (96, 48)] {
                let base = symmetric(size, 1);
                let columns = choose(size, rank);
                let y = Mat::from_fn(size, rank, |i, k| f64::from(base.get(i, columns[k])));
                let c = noisy(rank, 1.0);
                let c = Mat::from_fn(rank, rank, |i, j| f64::from(c[(i, j)] as f32));
                let exact = Exact::of(&base, &y, &c);
                let lossy = |matrix: &Mat<f64>, i, j| Lossy::from(matrix[(i, j)] as f32);
                let z = |i, k| sum(&mut (0..rank).map(|l| lossy(&y, i, l) * lossy(&c, l, k)));
                let z: Vec<Vec<Lossy>> = (0..size).map(|i| (0..rank).map(|k| z(i, k)).collect()).collect();
                for (i, j) in (0..size).flat_map(|i| (0..=i).map(move |j| (i, j))) {
                    let update = sum(&mut (0..rank).map(|k| lossy(&y, i, k) * z[j][k]));
                    let found = (Lossy::from(base.get(i, j)) - update).wide();
                    let share = (found - exact.value[(i, j)]).abs() / exact.bound[(i, j)];
                    assert!(
                        share <= 1.0,
                        "{bias:?}, {size} rows, rank {rank}: ({i}, {j}) is at {share} of the bound"
                    );
                    worst = worst.max(share);
                }
            }
            worst
        });
    }
    // Errors in one direction add up, to a third of the bound.
    assert!(worst.iter().any(|share| *share > 0.3), "{worst:?}");
}

/// A symmetric matrix of noise in f64, as large as `scale`.
fn noisy(rank: usize, scale: f64) -> Mat<f64> {
    Mat::from_fn(rank, rank, |i, j| {
        scale * noise(9 << 40 | (i.max(j) as u64) << 20 | i.min(j) as u64)
    })
}

/// (I + dK G)^-1 dK by faer, G at rows and columns of `base`.
fn solved(base: &Symmetric<f32>, columns: &[usize], change: &Mat<f64>) -> Mat<f64> {
    let rank = columns.len();
    let g = Mat::from_fn(rank, rank, |i, j| f64::from(base.get(columns[i], columns[j])));
    let matrix = Mat::<f64>::identity(rank, rank) + change * g;
    matrix.partial_piv_lu().solve(change)
}

#[test]
fn a_capacitance_matrix_solved_on_the_device_is_that_of_exact_arithmetic() {
    let Some(gpu) = gpu_or_skip() else {
        return;
    };
    if !gpu.has_f64() {
        return insonify_testing::skip("the GPU has no f64 for a capacitance matrix");
    }
    let tile = tiles::bytes_of(1);
    // I + dK G = [0 -1/2; 3/4 4] has no first pivot on its diagonal; (G^-1 + dK)^-1 by hand.
    let base = Arc::new(Symmetric::from_fn(2, |i, j| [[0.5, 0.25], [0.25, 1.0]][i][j]));
    let mut store = DeviceStore::new(&gpu, base, 2, tile).unwrap();
    let change = Mat::from_fn(2, 2, |i, j| [[-2.0, 0.0], [0.0, 3.0]][i][j]);
    let (_, found) = store
        .apply(&[0, 1], change.as_ref(), 1e-10, None, &[0, 1])
        .unwrap()
        .unwrap();
    for (i, j, expected) in [
        (0, 0, 29.0 / 6.0),
        (1, 0, 2.0 / 3.0),
        (0, 1, 2.0 / 3.0),
        (1, 1, 1.0 / 3.0),
    ] {
        let far = (found[(i, j)] - expected).abs();
        assert!(far <= 16.0 * UNIT * 29.0 / 6.0, "({i}, {j}) is off by {far:e}");
    }
    // Entries of dK G far above 1 and without order, so that each column needs its pivot found.
    for (size, rank, bank) in [
        (1, 1, tile),
        (129, 17, tile),
        (300, 48, 2 * tile),
        (300, 128, 64 * tile),
    ] {
        let case = format!("{size} rows, rank {rank}");
        let base = Arc::new(symmetric(size, 5));
        let columns = choose(size, rank);
        let change = noisy(rank, 10.0);
        let c = solved(&base, &columns, &change);
        let y = Mat::from_fn(size, rank, |i, k| f64::from(base.get(i, columns[k])));
        let exact = Exact::of(&base, &y, &c);
        // C is rounded to f32 as well.
        let exact = Exact {
            bound: Mat::from_fn(size, size, |i, j| 2.0 * exact.bound[(i, j)]),
            value: exact.value,
        };
        let near = choose(size, size.min(20));
        let rows = choose(size, rank.div_ceil(3));
        for rows in [None, Some(&rows[..])] {
            let mut store = DeviceStore::new(&gpu, Arc::clone(&base), rank, bank).unwrap();
            let (condition, block) = store
                .apply(&columns, change.as_ref(), 1e-10, rows, &near)
                .unwrap()
                .unwrap_or_else(|| panic!("{case}: refused"));
            assert!((1e-7..=1.0).contains(&condition), "{case}: {condition:e}");
            let found = all(&mut store);
            let named = |i: usize| rows.is_none_or(|rows| rows.binary_search(&i).is_ok());
            for (i, j) in (0..size).flat_map(|i| (0..size).map(move |j| (i, j))) {
                let (value, bound) = if named(i) || named(j) {
                    (exact.value[(i, j)], exact.bound[(i, j)])
                } else {
                    (f64::from(base.get(i, j)), 0.0)
                };
                let far = (found[(i, j)] - value).abs();
                assert!(far <= bound, "{case}: ({i}, {j}) off by {far:e}, allowed {bound:e}");
            }
            for (i, j) in (0..near.len()).flat_map(|i| (0..near.len()).map(move |j| (i, j))) {
                let (row, column) = (near[i], near[j]);
                let apart = (block[(i, j)] - found[(row, column)]).abs();
                // The same sum, but for products fused with it.
                assert!(
                    apart <= exact.bound[(row, column)],
                    "{case}: ({row}, {column}) is {apart:e} ahead"
                );
            }
        }
    }
}

#[test]
fn a_rebuild_on_the_device_is_that_from_a_fresh_upload() {
    let Some(gpu) = gpu_or_skip() else {
        return;
    };
    let (size, rank, bank) = (300, 40, 2 * tiles::bytes_of(1));
    let base = Arc::new(symmetric(size, 6));
    let columns = choose(size, rank);
    let c = noisy(rank, 0.1);
    let mut fresh = DeviceStore::new(&gpu, Arc::clone(&base), rank, bank).unwrap();
    fresh.take(Which::Current, &columns).unwrap();
    fresh.update(c.as_ref(), None, &[]).unwrap();
    let expected = all(&mut fresh);
    let mut sent = Vec::new();
    for is_kept in [true, false] {
        let mut store = DeviceStore::new(&gpu, Arc::clone(&base), 16, bank).unwrap();
        if !is_kept {
            store.free_base();
        }
        // Moves away from the base, in rows that the rebuild must bring back.
        let others: Vec<usize> = columns.iter().map(|column| column + 1).take(16).collect();
        store.take(Which::Current, &others).unwrap();
        store.update(noisy(16, 1.0).as_ref(), None, &[]).unwrap();
        assert_ne!(all(&mut store), expected);
        let before = gpu.traffic();
        let g = store.take(Which::Base, &columns).unwrap();
        assert_eq!(g[(1, 2)], f64::from(base.get(columns[1], columns[2])));
        store.restart(c.as_ref()).unwrap();
        sent.push((gpu.traffic() - before).bytes_up);
        assert_eq!(all(&mut store), expected, "base kept: {is_kept}");
    }
    // Rows of zeros below the last are not sent.
    let whole = tiles::bytes_of(size - size % tiles::SIDE)..=tiles::bytes_of(size);
    assert!(
        whole.contains(&(sent[1] - sent[0])),
        "the base, and nothing else: {sent:?}"
    );
    assert!(sent[0] < 10_000, "{sent:?}");
}

#[test]
fn sums_of_columns_and_products_are_those_of_exact_arithmetic() {
    let Some(gpu) = gpu_or_skip() else {
        return;
    };
    let tile = tiles::bytes_of(1);
    for (size, bank) in [(1, tile), (129, tile), (300, 2 * tile), (517, 64 * tile)] {
        let base = Arc::new(symmetric(size, 3));
        // Room for fewer columns than are summed: several batches.
        let mut store = DeviceStore::new(&gpu, Arc::clone(&base), 16, bank).unwrap();
        let columns = choose(size, 40.min(size));
        let weights: Vec<f64> = (0..columns.len() as u64).map(noise).collect();
        let x: Vec<f64> = (0..size as u64).map(|i| noise(i + 900)).collect();
        let every: Vec<usize> = (0..size).collect();
        let mut out = vec![f64::NAN; size];
        for (columns, weights, whole) in [(&columns, &weights, false), (&every, &x, true)] {
            if whole {
                store.multiply(&x, &mut out).unwrap();
            } else {
                store.combine(columns, weights, &mut out).unwrap();
            }
            for i in 0..size {
                let terms = columns.iter().zip(weights);
                let terms = terms.map(|(column, weight)| f64::from(base.get(i, *column)) * weight);
                let (sum, total) = terms.fold((0.0, 0.0), |(sum, total), term| (sum + term, total + term.abs()));
                // A weight is rounded, too.
                let bound = 1.01 * gamma(columns.len() + 1) * total;
                let far = (out[i] - sum).abs();
                assert!(
                    far <= bound,
                    "{size} rows, {whole}, row {i}: off by {far:e}, allowed {bound:e}"
                );
            }
        }
    }
}

fn on_device(gpu: Option<Gpu>, mesh: &AdaptedMesh, level: Level, options: RemesherOptions) -> Option<Adaptation> {
    let source = single(mesh);
    let device = follow(&gpu?, mesh, &source, level, options).unwrap();
    let mut adaptation = Adaptation::new(mesh.clone(), source, Level::IV, Precision::Single, options).unwrap();
    adaptation.parts().1.set_contacts(&contacts(mesh)).unwrap();
    adaptation.replace(Box::new(device)).unwrap();
    Some(adaptation)
}

/// Bound on the error of an inverse in f32 after some updates, relative to the gold standard's largest entry. The base
/// is rounded to f32 and each update adds about the rounding of one backward stable solution; the condition of the mesh
/// carries it on, and 8 holds the constants of the inner products.
fn allowed(mesh: &AdaptedMesh, gold: MatRef<'_, f64>, updates: usize) -> f64 {
    8.0 * (updates + 1) as f64 * rounding(mesh, gold) * f64::from(f32::EPSILON) / f64::EPSILON
}

#[test]
fn level_one_follows_the_moved_mesh_as_its_twin_does() {
    level_one_follows(gpu_or_skip());
}

/// The capacitance matrix is solved on the CPU then.
#[test]
fn level_one_follows_the_moved_mesh_without_f64_on_the_device() {
    let gpu = gpu_without_features();
    assert!(gpu.as_ref().is_none_or(|gpu| !gpu.has_f64()));
    level_one_follows(gpu);
}

fn level_one_follows(gpu: Option<Gpu>) {
    let mesh = mesh(0.45);
    let Some(mut device) = on_device(gpu, &mesh, Level::I, RemesherOptions::default()) else {
        return;
    };
    let nodes = free_nodes(&mesh);
    let mut host = Adaptation::new(
        mesh.clone(),
        single(&mesh),
        Level::I,
        Precision::Single,
        RemesherOptions::default(),
    )
    .unwrap();
    host.parts().1.set_contacts(&contacts(&mesh)).unwrap();
    let mut done = 0;
    for n in 0..10 {
        let (node, position) = nth_move(device.mesh(), &nodes, n);
        if device.mesh().assess(node, position).is_err() {
            continue;
        }
        done += 1;
        let report = device.move_node(node, position).unwrap();
        let twin = host.move_node(node, position).unwrap();
        assert_eq!((report.rank, report.level), (twin.rank, Level::I));
        assert_eq!(report.rebuilt, None);
    }
    assert!(done > 5, "{done} moves");
    let gold = gold(device.mesh());
    let every: Vec<usize> = (0..gold.nrows()).collect();
    let allowed = allowed(device.mesh(), gold.as_ref(), done);
    assert!(allowed < 0.2, "the bound says nothing: {allowed}");
    let contacts = contacts(&mesh);
    let expected = part(gold.as_ref(), &contacts, &contacts);
    for adaptation in [&mut device, &mut host] {
        let (mesh, remesher) = adaptation.parts();
        let whole = remesher.compliance(&every, &every).unwrap();
        let off = error(whole.as_ref(), gold.as_ref());
        assert!(off <= allowed, "K^-1 is off by {off:e}, allowed {allowed:e}");
        let off = error(remesher.condensed(), expected.as_ref());
        assert!(off <= allowed, "K^c is off by {off:e}, allowed {allowed:e}");

        let mut forces = vec![0.0; contacts.len()];
        forces[4] = 1.0;
        let mut u = vec![0.0; gold.nrows()];
        remesher.displacement(&forces, &mut u).unwrap();
        let largest = (0..u.len()).map(|i| gold[(i, contacts[4])].abs()).fold(0.0, f64::max);
        for (i, u) in u.iter().enumerate() {
            assert!(
                (u - gold[(i, contacts[4])]).abs() <= allowed * largest,
                "displacement {i}"
            );
        }
        // Refinement leaves the square of the error.
        let left = remesher.displacement_refined(mesh, &forces, &mut u).unwrap();
        assert!(left <= allowed * allowed, "backward error {left:e}");
        for (i, u) in u.iter().enumerate() {
            let far = (u - gold[(i, contacts[4])]).abs();
            assert!(
                far <= allowed * allowed * largest,
                "refined displacement {i} is off by {far:e}"
            );
        }
    }
}

#[test]
fn levels_two_and_three_are_right_in_their_rows_and_rebuild_when_switched_up() {
    for level in [Level::II, Level::III] {
        let mesh = mesh(0.45);
        let Some(mut device) = on_device(gpu_or_skip(), &mesh, level, RemesherOptions::default()) else {
            return;
        };
        let base = gold(&mesh);
        let nodes = free_nodes(&mesh);
        let (node, position) = nth_move(&mesh, &nodes, 3);
        let report = device.move_node(node, position).unwrap();
        assert!(report.bytes_moved < base.nrows() * base.nrows(), "{report:?}");
        let gold = gold(device.mesh());
        let allowed = allowed(device.mesh(), gold.as_ref(), 1);
        let own: Vec<usize> = match level {
            Level::II => device.mesh().support().map(|dof| dof as usize).collect(),
            _ => device.mesh().dofs().of(node).map(|dof| dof as usize).to_vec(),
        };
        let every: Vec<usize> = (0..gold.nrows()).collect();
        let others: Vec<usize> = every.iter().copied().filter(|dof| !own.contains(dof)).collect();
        let remesher = device.parts().1;
        let right = remesher.compliance(&own, &every).unwrap();
        let off = error(right.as_ref(), part(gold.as_ref(), &own, &every).as_ref());
        assert!(
            off <= allowed,
            "level {level}: updated rows are off by {off:e}, allowed {allowed:e}"
        );
        let left = remesher.compliance(&others, &others).unwrap();
        for (at, value) in left.col_iter().flat_map(|column| column.iter()).enumerate() {
            let (i, j) = (others[at % others.len()], others[at / others.len()]);
            assert_eq!(
                *value,
                f64::from(base[(i.max(j), i.min(j))] as f32),
                "level {level}: ({i}, {j})"
            );
        }

        let report = device.switch(Level::I, Precision::Single).unwrap().expect("a rebuild");
        assert_eq!(report.rebuilt, Some(Rebuilt::Switched));
        let whole = device.parts().1.compliance(&every, &every).unwrap();
        let off = error(whole.as_ref(), gold.as_ref());
        assert!(
            off <= allowed,
            "level {level}, rebuilt: off by {off:e}, allowed {allowed:e}"
        );
    }
}

/// A change whose capacitance matrix has an eigenvalue of `eigenvalue` and is the identity otherwise.
fn nearly_singular(remesher: &mut dyn Remesher, mut change: Change, eigenvalue: f64) -> Change {
    let support: Vec<usize> = change.support.iter().map(|dof| *dof as usize).collect();
    let g = remesher.compliance(&support, &support).unwrap();
    let v = |i: usize| noise(i as u64 + 77);
    let rank = support.len();
    let sum = (0..rank).flat_map(|i| (0..rank).map(move |j| (i, j)));
    let sum: f64 = sum.map(|(i, j)| v(i) * g[(i, j)] * v(j)).sum();
    change.stiffness = Mat::from_fn(rank, rank, |i, j| (eigenvalue - 1.0) * v(i) * v(j) / sum);
    change
}

#[test]
fn an_ill_conditioned_change_is_refused_as_on_the_cpu() {
    let Some(gpu) = gpu_or_skip() else {
        return;
    };
    for level in [Level::I, Level::II, Level::III] {
        let mut mesh = mesh(0.45);
        let source = single(&mesh);
        let Source::Single(base) = &source else {
            panic!("single is single")
        };
        let options = RemesherOptions {
            check_every: 0,
            ..RemesherOptions::default()
        };
        let mut device = follow(&gpu, &mesh, &source, level, options).unwrap();
        let mut host = Levels::<f32>::new(&mesh, Arc::clone(base), level, options).unwrap();
        let contacts = contacts(&mesh);
        let (node, position) = nth_move(&mesh, &free_nodes(&mesh), 3);
        let change = mesh.move_node(node, position).unwrap();
        let every: Vec<usize> = (0..mesh.dofs().free()).collect();
        let mut refused = Vec::new();
        for remesher in [&mut device as &mut dyn Remesher, &mut host] {
            remesher.set_contacts(&contacts).unwrap();
            let before = remesher.compliance(&every, &every).unwrap();
            let condensed = remesher.condensed().to_owned();
            let bad = nearly_singular(remesher, change.clone(), 1e-13);
            refused.push(remesher.remesh(&mesh, &bad).unwrap_err());
            assert!(matches!(refused[0], RemeshError::Singular { .. }), "{}", refused[0]);
            assert_eq!(remesher.compliance(&every, &every).unwrap(), before, "level {level}");
            assert_eq!(remesher.condensed(), condensed.as_ref(), "level {level}");
            // Badly conditioned, and not beyond the limit.
            let poor = nearly_singular(remesher, change.clone(), 1e-6);
            let report = remesher.remesh(&mesh, &poor).unwrap();
            let condition = report.reciprocal_condition;
            assert!((1e-10..1e-5).contains(&condition), "level {level}: {condition:e}");
        }
        assert_eq!(refused[0], refused[1], "level {level}");
    }
}

#[test]
fn a_move_waits_once_and_sends_little() {
    let devices = [gpu_or_skip(), gpu_without_features()];
    let levels = [Level::I, Level::II, Level::III];
    for (gpu, level) in devices
        .iter()
        .flatten()
        .flat_map(|gpu| levels.map(|level| (gpu, level)))
    {
        let mut mesh = mesh(0.45);
        let options = RemesherOptions {
            check_every: 0,
            ..RemesherOptions::default()
        };
        let mut device = follow(gpu, &mesh, &single(&mesh), level, options).unwrap();
        let contacts = contacts(&mesh);
        device.set_contacts(&contacts).unwrap();
        let (node, position) = nth_move(&mesh, &free_nodes(&mesh), 3);
        let change = mesh.move_node(node, position).unwrap();
        let before = gpu.traffic();
        let report = device.remesh(&mesh, &change).unwrap();
        let moved = gpu.traffic() - before;
        // All entries are updated in a submission of their own; without f64 G comes back first.
        let (updates, fetches) = (u64::from(level == Level::I), u64::from(!gpu.has_f64()));
        assert_eq!(
            (report.rebuilt, moved.submissions, moved.waits),
            (None, 1 + updates + fetches, 1 + fetches),
            "level {level}"
        );
        if gpu.has_f64() {
            let named = match level {
                Level::I => 0,
                Level::II => report.rank,
                _ => 3,
            };
            let lists = 4 * (report.rank + contacts.len() + named);
            let expected = 8 * report.rank.pow(2) + lists + 2 * 256;
            assert_eq!(moved.bytes_up, expected as u64, "level {level}");
            let values = (1 + contacts.len().pow(2)).next_power_of_two();
            assert_eq!(moved.bytes_down, 4 * values as u64, "level {level}");
        }
        let before = gpu.traffic();
        device.refresh(&mesh).unwrap();
        let rebuilt = gpu.traffic() - before;
        assert_eq!((rebuilt.submissions, rebuilt.waits), (3, 1), "level {level}");
        assert!(rebuilt.bytes_up < 50_000, "{rebuilt:?}");
    }
}

#[test]
fn devices_and_cpu_are_switched_while_running() {
    let mesh = mesh(0.45);
    let Some(mut adaptation) = on_device(gpu_or_skip(), &mesh, Level::I, RemesherOptions::default()) else {
        return;
    };
    let nodes = free_nodes(&mesh);
    let contacts = contacts(&mesh);
    let check = |adaptation: &Adaptation, updates| {
        let gold = gold(adaptation.mesh());
        let expected = part(gold.as_ref(), &contacts, &contacts);
        let allowed = allowed(adaptation.mesh(), gold.as_ref(), updates);
        let off = error(adaptation.remesher().condensed(), expected.as_ref());
        assert!(off <= allowed, "off by {off:e}, allowed {allowed:e}");
        assert_eq!(adaptation.remesher().contacts(), contacts);
    };
    let step = |adaptation: &mut Adaptation, n| {
        let (node, position) = nth_move(adaptation.mesh(), &nodes, n);
        adaptation.move_node(node, position).unwrap();
    };
    step(&mut adaptation, 3);
    check(&adaptation, 1);
    adaptation.switch(Level::Exact, Precision::Single).unwrap();
    check(&adaptation, 1);
    step(&mut adaptation, 4);
    check(&adaptation, 2);
    let gpu = gpu_or_skip().expect("as before");
    let back = follow(
        &gpu,
        adaptation.mesh(),
        &single(&mesh),
        Level::I,
        RemesherOptions::default(),
    )
    .unwrap();
    adaptation.replace(Box::new(back)).unwrap();
    check(&adaptation, 2);
    step(&mut adaptation, 5);
    check(&adaptation, 3);
    adaptation.undo().unwrap();
    check(&adaptation, 4);
}

#[test]
fn what_a_device_cannot_do_is_said() {
    let Some(gpu) = gpu_or_skip() else {
        return;
    };
    let soft = mesh(0.45);
    let small = DeviceStore::new(&gpu, Arc::new(symmetric(10, 1)), 3, 1 << 10);
    assert!(matches!(
        small.err(),
        Some(GpuError::Limit {
            needed: 65_536,
            available: 1024,
            ..
        })
    ));

    let nearly = mesh(0.499);
    let refused = follow(&gpu, &nearly, &single(&nearly), Level::I, RemesherOptions::default())
        .err()
        .unwrap();
    assert!(refused.to_string().contains("0.499"), "{refused}");
    let exact = follow(&gpu, &soft, &single(&soft), Level::Exact, RemesherOptions::default())
        .err()
        .unwrap();
    assert!(
        matches!(
            exact,
            RemeshError::Level {
                asked: Level::Exact,
                ..
            }
        ),
        "{exact}"
    );

    let mut adaptation = on_device(Some(gpu), &soft, Level::I, RemesherOptions::default()).expect("as before");
    let Source::Single(base) = single(&soft) else {
        panic!("single is single")
    };
    let own = gpu_or_skip().expect("as before");
    let lost = follow(&own, &soft, &Source::Single(base), Level::I, RemesherOptions::default()).unwrap();
    adaptation.replace(Box::new(lost)).unwrap();
    own.simulate_loss().unwrap();
    let (node, position) = nth_move(&soft, &free_nodes(&soft), 3);
    let failed = adaptation.move_node(node, position).unwrap_err();
    assert!(matches!(failed, RemeshError::Device(_)), "{failed}");
    assert_eq!(adaptation.mesh().nodes(), soft.nodes(), "the move is taken back");
    // The CPU takes over.
    adaptation.switch(Level::Exact, Precision::Single).unwrap();
    adaptation.move_node(node, position).unwrap();
}

#[test]
fn the_levels_of_the_cpu_are_those_of_the_same_store_trait() {
    // Without a GPU: the store of the CPU through the same door.
    let mesh = mesh(0.45);
    let Source::Single(base) = single(&mesh) else {
        panic!("single is single")
    };
    let mut levels = Levels::<f32>::new(&mesh, Arc::clone(&base), Level::I, RemesherOptions::default()).unwrap();
    assert_eq!(levels.store().size(), base.size());
    assert_eq!(levels.precision(), Precision::Single);
    let mut out = vec![0.0; base.size()];
    levels.store().combine(&[5], &[2.0], &mut out).unwrap();
    for (i, value) in out.iter().enumerate() {
        assert_eq!(*value, 2.0 * f64::from(base.get(i, 5)));
    }
}
