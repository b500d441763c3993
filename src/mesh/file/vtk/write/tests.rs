use std::path::Path;

use super::super::tests::{expected, sample};
use super::super::xml;
use super::*;
use crate::file::{ReadOptions, read_mesh, write_pvd, written};
use insonify_base::blame::Blame;

#[test]
fn what_is_written_is_read_again() {
    let (mesh, mut displacements) = sample();
    displacements[1] = [-0.0, f64::MIN_POSITIVE / 8.0, 1e6];
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mesh.vtu");
    write_vtu(&path, &mesh, Some(&displacements)).unwrap();
    let (start, written) = (
        std::fs::read(&path).unwrap(),
        written().find(|written| written.ending == ".vtu").unwrap(),
    );
    let mark = written.marks[0];
    assert!(start[..512].windows(mark.len()).any(|part| part == mark));
    let file = read_mesh(&path, &ReadOptions::default()).unwrap();
    let bits = |vectors: &[[f64; 3]]| -> Vec<u64> { vectors.as_flattened().iter().map(|x| x.to_bits()).collect() };
    assert_eq!(bits(file.displacements.as_deref().unwrap()), bits(&displacements));
    assert_eq!(bits(file.mesh.nodes()), bits(mesh.nodes()));
    assert_eq!(file.mesh, mesh);
    assert_eq!(file.skipped_cells, 0);
    for axis in 0..3 {
        assert_eq!(file.current()[3][axis], mesh.nodes()[3][axis] + displacements[3][axis]);
    }

    write_vtu(&path, &mesh, None).unwrap();
    let plain = read_mesh(&path, &ReadOptions::default()).unwrap();
    assert_eq!((plain.displacements.as_ref(), &plain.mesh), (None, &expected().mesh));
    assert_eq!(plain.current(), mesh.nodes());
    let files: Vec<_> = std::fs::read_dir(folder.path()).unwrap().collect();
    assert_eq!(files.len(), 1, "{files:?}");
}

#[test]
fn arrays_longer_than_a_block_and_of_whole_blocks_are_read_again() {
    // Nodes of 24 bytes, corners of 32 and regions of 4: lengths of 0, of 1 and of several blocks, with and without a
    // remainder.
    for cells in [1, 2, 1024, 1025, 8192] {
        let nodes: Vec<[f64; 3]> = (0..4 * cells)
            .map(|n| {
                [
                    f64::from(n % 4 == 1),
                    f64::from(n % 4 == 2),
                    f64::from(n % 4 == 3) + 2.0 * f64::from(n / 4),
                ]
            })
            .collect();
        let elements = (0..cells as u32)
            .map(|n| [4 * n, 4 * n + 1, 4 * n + 2, 4 * n + 3])
            .collect();
        let mesh = TetMesh::new(nodes, elements, (0..cells).collect()).unwrap();
        let mut bytes = Vec::new();
        vtu(
            &mut bytes,
            &mesh,
            &BTreeMap::new(),
            &[],
            &[(REGION, Values::Integers(mesh.regions()))],
        )
        .unwrap();
        assert_eq!(super::super::tests::read(&bytes).unwrap().mesh, mesh, "{cells}");
    }
}

#[test]
fn names_of_regions_are_read_again() {
    let (mesh, _) = sample();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mesh.vtu");
    let names = BTreeMap::from([(-3, "Leber <links>".to_owned()), (5, "\u{9aa8} & x".to_owned())]);
    write_vtu_with(&path, &mesh, &names, &[], &[]).unwrap();
    assert_eq!(read_mesh(&path, &ReadOptions::default()).unwrap().region_names, names);
    let broken = std::fs::read_to_string(&path).unwrap().replacen(" 0\n", " 256 0\n", 1);
    std::fs::write(&path, broken).unwrap();
    let message = read_mesh(&path, &ReadOptions::default()).unwrap_err().to_string();
    assert!(
        message.contains("256") && message.contains("code of a character"),
        "{message}"
    );
}

#[test]
fn named_arrays_keep_their_bits() {
    let (mesh, _) = sample();
    let (nodes, cells) = (mesh.nodes().len(), mesh.elements().len());
    let pressure: Vec<f64> = (0..nodes).map(|n| 1.0 / (n as f64 - 3.0)).collect();
    let gradient: Vec<[f64; 3]> = (0..cells).map(|n| [n as f64 / 7.0, f64::NAN, -1e-300]).collect();
    let ids: Vec<i32> = (0..nodes as i32).map(|n| n * 7_654_321 + i32::MIN).collect();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("arrays.vtu");
    let points = [
        ("pressure <kPa> & \"more\"", Values::Scalars(&pressure)),
        ("ids", Values::Integers(&ids)),
    ];
    write_vtu_with(
        &path,
        &mesh,
        &BTreeMap::new(),
        &points,
        &[("gradient", Values::Vectors(&gradient))],
    )
    .unwrap();
    let grid = xml::parse(&std::fs::read(&path).unwrap(), false, |_, arrays| {
        (0..arrays.len()).collect()
    })
    .unwrap();
    let names: Vec<&str> = grid.point_arrays.iter().map(|array| array.name.as_str()).collect();
    assert_eq!(names, ["pressure <kPa> & \"more\"", "ids"]);
    assert_eq!(grid.point_arrays[0].values, pressure);
    assert_eq!(
        grid.point_arrays[1].values,
        ids.iter().map(|id| f64::from(*id)).collect::<Vec<_>>()
    );
    let [region, gradients] = &grid.cell_arrays[..] else {
        panic!("two cell arrays")
    };
    assert_eq!(
        (region.name.as_str(), gradients.name.as_str(), gradients.components),
        (REGION, "gradient", 3)
    );
    let bits = |values: &[f64]| -> Vec<u64> { values.iter().map(|x| x.to_bits()).collect() };
    assert_eq!(bits(&gradients.values), bits(gradient.as_flattened()));
}

#[test]
fn arrays_that_cannot_be_written_leave_no_file() {
    let (mesh, displacements) = sample();
    let regions = mesh.regions().to_vec();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mesh.vtu");
    let short = Values::Vectors(&displacements[1..]);
    let nodes = mesh.nodes().len();
    for (points, cells, says) in [
        (
            &[("u", short)][..],
            &[][..],
            format!("{} entries for {nodes} nodes", nodes - 1),
        ),
        (&[("", short)], &[], "at least one character".to_owned()),
        (&[("a\u{7}", short)], &[], "printed".to_owned()),
        (&[], &[(REGION, Values::Integers(&regions))], "taken".to_owned()),
        (&[], &[("x", Values::Integers(&regions[2..]))], "tetrahedra".to_owned()),
    ] {
        let error = write_vtu_with(&path, &mesh, &BTreeMap::new(), points, cells).unwrap_err();
        assert!(error.to_string().contains(&says) && !error.is_machine(), "{error}");
    }
    let nowhere = write_vtu(&folder.path().join("no/such/mesh.vtu"), &mesh, None).unwrap_err();
    assert!(!nowhere.is_machine(), "{nowhere}");
    assert!(
        write_vtu(folder.path(), &mesh, None)
            .unwrap_err()
            .to_string()
            .contains("not a regular file")
    );
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn a_time_series_lists_its_files() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.pvd");
    write_pvd(&path, &[(0.0, "run_0.vtu".into()), (1.0 / 3.0, "a & b.vtu".into())]).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    let document = roxmltree::Document::parse(&text).unwrap();
    let sets: Vec<_> = document
        .descendants()
        .filter(|node| node.has_tag_name("DataSet"))
        .collect();
    let of = |key| -> Vec<&str> { sets.iter().map(|set| set.attribute(key).unwrap()).collect() };
    assert_eq!(of("file"), ["run_0.vtu", "a & b.vtu"]);
    let times: Vec<f64> = of("timestep").iter().map(|time| time.parse().unwrap()).collect();
    assert_eq!(times, [0.0, 1.0 / 3.0]);
    let error = write_pvd(Path::new("x.pvd"), &[(f64::NAN, "n.vtu".into())]).unwrap_err();
    assert!(
        error.to_string().contains("n.vtu") && !Path::new("x.pvd").exists(),
        "{error}"
    );
}
