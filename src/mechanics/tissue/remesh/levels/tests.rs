use super::*;
use crate::tissue::remesh::testing::{adapted, dofs_of, error, gold, inner_nodes, inverse, nearby, part, rounding};

fn levels(mesh: &AdaptedMesh, level: Level, options: RemesherOptions) -> Levels<f64> {
    let mut levels = Levels::new(mesh, inverse(mesh), level, options).expect("a remesher");
    levels
        .set_contacts(&dofs_of(mesh, &inner_nodes(mesh)))
        .expect("contacts");
    levels
}

fn go(mesh: &mut AdaptedMesh, remesher: &mut dyn Remesher, node: u32, salt: u32) -> RemeshReport {
    let change = mesh.move_node(node, nearby(mesh, node, salt)).expect("a small move");
    remesher.remesh(mesh, &change).expect("a remesh")
}

fn whole<T: Entry>(levels: &Levels<T>) -> Mat<f64> {
    let size = levels.inverse().size();
    Mat::from_fn(size, size, |i, j| levels.inverse().get(i, j).wide())
}

#[test]
fn level_one_is_the_inverse_of_the_moved_mesh() {
    let mut mesh = adapted(0.45);
    let inner = inner_nodes(&mesh);
    let mut levels = levels(&mesh, Level::I, RemesherOptions::default());
    for (salt, node) in [inner[0], inner[1], inner[0]].into_iter().enumerate() {
        let report = go(&mut mesh, &mut levels, node, salt as u32);
        let gold = gold(&mesh);
        assert!(error(&whole(&levels), &gold) <= rounding(&mesh, &gold));
        assert_eq!(report.rebuilt, None);
        assert_eq!(
            levels.condensed(),
            part(&whole(&levels), levels.contacts(), levels.contacts()).as_ref()
        );
    }
}

#[test]
fn levels_two_and_three_are_right_in_their_rows_and_leave_the_rest() {
    for level in [Level::II, Level::III] {
        let mut mesh = adapted(0.45);
        let node = inner_nodes(&mesh)[0];
        let mut levels = levels(&mesh, level, RemesherOptions::default());
        let before = whole(&levels);
        go(&mut mesh, &mut levels, node, 1);
        let nodes = if level == Level::II {
            mesh.neighbours(node)
        } else {
            std::slice::from_ref(&node)
        };
        let rows = dofs_of(&mesh, nodes);
        let (gold, updated) = (gold(&mesh), whole(&levels));
        let bound = rounding(&mesh, &gold) * gold.norm_max();
        for (i, j) in (0..gold.nrows()).flat_map(|i| (0..gold.ncols()).map(move |j| (i, j))) {
            if rows.contains(&i) || rows.contains(&j) {
                assert!((updated[(i, j)] - gold[(i, j)]).abs() <= bound, "{level} ({i}, {j})");
            } else {
                assert_eq!(updated[(i, j)], before[(i, j)], "{level} ({i}, {j})");
            }
        }
    }
}

#[test]
fn level_four_leaves_everything() {
    let mut mesh = adapted(0.45);
    let node = inner_nodes(&mesh)[0];
    let mut levels = levels(&mesh, Level::IV, RemesherOptions::default());
    let (before, condensed) = (whole(&levels), levels.condensed().to_owned());
    let report = go(&mut mesh, &mut levels, node, 1);
    assert_eq!((whole(&levels), levels.condensed()), (before, condensed.as_ref()));
    assert_eq!((report.bytes_moved, report.reciprocal_condition), (0, 1.0));
}

#[test]
fn a_higher_level_begins_with_a_rebuild() {
    let mut mesh = adapted(0.45);
    let inner = inner_nodes(&mesh);
    let mut levels = levels(&mesh, Level::IV, RemesherOptions::default());
    go(&mut mesh, &mut levels, inner[0], 1);
    assert_eq!(levels.set_level(&mesh, Level::IV), Ok(None));
    let report = levels.set_level(&mesh, Level::I).expect("a rebuild").expect("a report");
    assert_eq!(report.rebuilt, Some(Rebuilt::Switched));
    let gold_now = gold(&mesh);
    assert!(error(&whole(&levels), &gold_now) <= rounding(&mesh, &gold_now));
    // A move at level I keeps all of the inverse. Lowering the level loses nothing until the next move; raising it
    // again is then free.
    go(&mut mesh, &mut levels, inner[1], 2);
    assert_eq!(levels.set_level(&mesh, Level::III), Ok(None));
    assert_eq!(levels.set_level(&mesh, Level::I), Ok(None));
    let exact = levels.set_level(&mesh, Level::Exact);
    assert_eq!(
        exact,
        Err(RemeshError::Level {
            asked: Level::Exact,
            offered: Level::I
        })
    );
    assert_eq!(levels.level(), Level::I);
}

#[test]
fn a_spoiled_inverse_is_seen_and_rebuilt() {
    let mut mesh = adapted(0.45);
    let inner = inner_nodes(&mesh);
    let mut levels = levels(
        &mesh,
        Level::I,
        RemesherOptions {
            check_every: 1,
            ..RemesherOptions::default()
        },
    );
    assert_eq!(go(&mut mesh, &mut levels, inner[0], 1).rebuilt, None);
    let size = mesh.dofs().free();
    let ones = Mat::from_fn(size, 1, |_, _| 1.0);
    let slight = Mat::from_fn(1, 1, |_, _| 1e-6);
    levels
        .inverse
        .store
        .current
        .rank_update(ones.as_ref(), slight.as_ref())
        .expect("an update");
    let report = go(&mut mesh, &mut levels, inner[1], 1);
    assert!(matches!(report.rebuilt, Some(Rebuilt::Residual(_))), "{report:?}");
    let gold = gold(&mesh);
    assert!(error(&whole(&levels), &gold) <= rounding(&mesh, &gold));
    assert_eq!(levels.rebuilds(), 1);
}

#[test]
fn contacts_that_are_not_positive_definite_are_mended() {
    let mut mesh = adapted(0.45);
    let inner = inner_nodes(&mesh);
    let mut levels = levels(&mesh, Level::III, RemesherOptions::default());
    let size = mesh.dofs().free();
    // Makes the first contact's compliance strongly negative.
    let dof = levels.contacts()[0];
    let unit = Mat::from_fn(size, 1, |i, _| if i == dof { 1.0 } else { 0.0 });
    let large = Mat::from_fn(1, 1, |_, _| 2.0 * levels.condensed()[(0, 0)]);
    levels
        .inverse
        .store
        .current
        .rank_update(unit.as_ref(), large.as_ref())
        .expect("an update");
    let last_node = *inner.last().expect("nodes");
    let report = go(&mut mesh, &mut levels, last_node, 1);
    assert_eq!(report.rebuilt, Some(Rebuilt::Indefinite));
    let gold = gold(&mesh);
    assert!(error(&whole(&levels), &gold) <= rounding(&mesh, &gold));
}

#[test]
fn single_precision_is_refused_where_rounding_outgrows_the_answer() {
    let mesh = adapted(0.495);
    let single = Arc::new(inverse(&mesh).cast::<f32>());
    for level in [Level::I, Level::II, Level::III] {
        match Levels::new(&mesh, single.clone(), level, RemesherOptions::default()) {
            Err(RemeshError::Unsuited {
                precision: Precision::Single,
                reason,
                ..
            }) => {
                assert!(reason.contains("0.495") && reason.contains("0.49"), "{reason}");
            }
            other => panic!("{other:?}"),
        }
    }
    let mut fourth = Levels::new(&mesh, single, Level::IV, RemesherOptions::default()).expect("nothing is updated");
    assert!(matches!(
        fourth.set_level(&mesh, Level::I),
        Err(RemeshError::Unsuited { .. })
    ));
    assert_eq!(fourth.level(), Level::IV);
    assert!(Levels::new(&mesh, inverse(&mesh), Level::I, RemesherOptions::default()).is_ok());
    let small = Arc::new(Symmetric::<f64>::zeros(3));
    assert!(matches!(
        Levels::new(&mesh, small, Level::I, RemesherOptions::default()),
        Err(RemeshError::Compliance(_))
    ));
    assert!(matches!(
        Levels::new(&mesh, inverse(&mesh), Level::Exact, RemesherOptions::default()),
        Err(RemeshError::Level { .. })
    ));
}

#[test]
fn a_refused_change_leaves_the_inverse_as_it_was() {
    for level in [Level::I, Level::II, Level::III] {
        let mut mesh = adapted(0.45);
        let node = inner_nodes(&mesh)[0];
        let mut levels = levels(
            &mesh,
            level,
            RemesherOptions {
                reciprocal_limit: 0.9,
                ..RemesherOptions::default()
            },
        );
        let before = (whole(&levels), levels.condensed().to_owned());
        let change = mesh.move_node(node, nearby(&mesh, node, 1)).expect("a small move");
        assert!(matches!(
            levels.remesh(&mesh, &change),
            Err(RemeshError::Singular { .. })
        ));
        assert!(matches!(levels.refresh(&mesh), Err(RemeshError::FarFromBase { .. })));
        assert_eq!((whole(&levels), levels.condensed().to_owned()), before);
        // The refused change does not count: raising the level again needs no rebuild.
        assert_eq!(levels.set_level(&mesh, Level::IV), Ok(None));
        assert_eq!(levels.set_level(&mesh, level), Ok(None));
    }
}

#[test]
fn displacements_are_the_columns_of_the_contacts() {
    let mut mesh = adapted(0.45);
    let inner = inner_nodes(&mesh);
    let mut levels = levels(&mesh, Level::I, RemesherOptions::default());
    go(&mut mesh, &mut levels, inner[0], 1);
    let contacts = dofs_of(&mesh, &inner[..1]);
    levels.set_contacts(&contacts).expect("contacts");
    let size = mesh.dofs().free();
    let mut u = vec![0.0; size];
    levels.displacement(&[0.0, 2.0, 0.0], &mut u).expect("displacements");
    let inverse = whole(&levels);
    assert!((0..size).all(|i| u[i] == 2.0 * inverse[(i, contacts[1])]));
    let left = levels
        .displacement_refined(&mesh, &[0.0, 2.0, 0.0], &mut u)
        .expect("displacements");
    assert!(left <= size as f64 * f64::EPSILON, "{left}");
    assert!(levels.displacement(&[1.0], &mut u).is_err());
    assert!(levels.displacement(&[1.0; 3], &mut u[1..]).is_err());
}
