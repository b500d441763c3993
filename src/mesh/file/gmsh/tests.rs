mod damaged;
mod written;

use std::path::Path;

use super::Kind;
use super::*;
use crate::file::{MeshFile, MeshFileError, read_mesh_bytes};
use written::{ALL, Encoding, Model, ascii};

fn read(bytes: &[u8]) -> Result<MeshFile, MeshFileError> {
    read_mesh_bytes(bytes, Path::new("mesh.msh"), &ReadOptions::default())
}

#[test]
fn every_version_and_encoding_gives_the_same_mesh() {
    let model = Model::default();
    let first = read(&ALL[0].write(&model)).unwrap();
    // In the order of the tags, not of the file.
    let xs: Vec<f64> = first.mesh.nodes().iter().map(|node| node[0]).collect();
    assert_eq!(xs, [0.0, 1.0, 0.0, 0.1, 1.0 / 3.0, -2.0]);
    assert_eq!(first.mesh.elements(), [[0, 1, 2, 3], [1, 2, 3, 4], [0, 2, 3, 5]]);
    assert_eq!(first.mesh.regions(), [7, 7, 2]);
    assert_eq!(first.skipped_cells, 3);
    let names: Vec<_> = first.region_names.iter().map(|(n, name)| (*n, name.as_str())).collect();
    assert_eq!(names, [(7, "left \"half\" & more")]);
    for encoding in &ALL[1..] {
        let mut file = read(&encoding.write(&model)).unwrap_or_else(|error| panic!("{encoding:?}: {error}"));
        // Only version 4.1 lists further groups without repeating the element.
        file.warnings.clone_from(&first.warnings);
        assert_eq!(file, first, "{encoding:?}");
    }
}

#[test]
fn tetrahedra_of_second_order_are_read_by_their_corners() {
    for encoding in ALL {
        let straight = read(&encoding.write(&Model::default())).unwrap();
        let mut curved = read(&encoding.write(&Model {
            curved: true,
            ..Model::default()
        }))
        .unwrap();
        let told = curved.warnings.pop().unwrap();
        assert!(told.contains("3 tetrahedra") && told.contains("2 of 8 nodes"), "{told}");
        assert_eq!(curved, straight, "{encoding:?}");
    }
}

#[test]
fn regions_are_groups_or_volumes() {
    for encoding in ALL {
        let bytes = encoding.write(&Model::default());
        let regions = |name| {
            let options = ReadOptions {
                region: Some(name),
                ..ReadOptions::default()
            };
            read_mesh_bytes(&bytes, Path::new("mesh.msh"), &options)
        };
        assert_eq!(
            regions("gmsh:physical").unwrap().mesh.regions(),
            [7, 7, 2],
            "{encoding:?}"
        );
        let volumes = regions("gmsh:geometrical").unwrap();
        assert_eq!(volumes.mesh.regions(), [1, 1, 2], "{encoding:?}");
        assert!(volumes.region_names.is_empty(), "{encoding:?}");
        let error = regions("label").unwrap_err().to_string();
        assert!(
            error.contains("`label`") && error.contains("`gmsh:physical`"),
            "{error}"
        );
        let moved = ReadOptions {
            displacement: Some("u"),
            ..ReadOptions::default()
        };
        let error = read_mesh_bytes(&bytes, Path::new("mesh.msh"), &moved).unwrap_err();
        assert!(error.to_string().contains("point array `u`"), "{error}");
    }
}

#[test]
fn further_groups_and_shared_numbers_are_told() {
    for encoding in ALL {
        let several = read(&encoding.write(&Model {
            groups: vec![7, 9],
            ..Model::default()
        }));
        let several = several.unwrap();
        assert_eq!(several.mesh.regions(), [7, 7, 2], "{encoding:?}");
        let [warning] = &several.warnings[..] else {
            panic!("{encoding:?}: {:?}", several.warnings)
        };
        assert!(warning.contains("several physical groups (2 times"), "{warning}");
        // Volume 2 has no group, and group 2 is volume 1.
        let shared = read(&encoding.write(&Model {
            groups: vec![2],
            ..Model::default()
        }));
        let shared = shared.unwrap();
        assert_eq!(shared.mesh.regions(), [2, 2, 2], "{encoding:?}");
        assert!(shared.warnings[0].contains("region 2"), "{:?}", shared.warnings);
    }
}

#[test]
fn a_sign_of_a_group_is_an_orientation() {
    for encoding in ALL {
        let file = read(&encoding.write(&Model {
            groups: vec![-7],
            ..Model::default()
        }));
        assert_eq!(file.unwrap().mesh.regions(), [7, 7, 2], "{encoding:?}");
    }
}

#[test]
fn parameters_of_nodes_and_parts_of_volumes_are_understood() {
    for encoding in ALL.into_iter().filter(|encoding| encoding.version == 4) {
        let plain = read(&encoding.write(&Model::default())).unwrap();
        let parametric = Model {
            parametric: true,
            ..Model::default()
        };
        assert_eq!(read(&encoding.write(&parametric)).unwrap(), plain, "{encoding:?}");
        let partitioned = Model {
            partitioned: true,
            ..Model::default()
        };
        assert_eq!(read(&encoding.write(&partitioned)).unwrap(), plain, "{encoding:?}");
    }
}

#[test]
fn sections_without_entities_give_the_numbers_of_volumes() {
    let text = String::from_utf8(ascii(4).write(&Model::default())).unwrap();
    let (before, rest) = text.split_once("$Entities").unwrap();
    let (_, after) = rest.split_once("$EndEntities").unwrap();
    let file = read(format!("{before}{after}").as_bytes()).unwrap();
    assert_eq!(file.mesh.regions(), [1, 1, 2]);
}

#[test]
fn four_byte_sizes_are_read() {
    let narrow = Encoding { wide: false, ..ALL[4] };
    assert_eq!(
        read(&narrow.write(&Model::default())).unwrap(),
        read(&ALL[4].write(&Model::default())).unwrap()
    );
}

#[test]
fn every_type_of_element_has_the_nodes_of_its_order() {
    // Nodes of a full Lagrange element of order p: (p + 1) in each direction of a cube, binomials in a simplex.
    for (code, nodes) in [
        (1, 2),
        (8, 3),
        (26, 4),
        (27, 5),
        (28, 6),
        (2, 3),
        (9, 6),
        (21, 10),
        (23, 15),
        (25, 21),
        (4, 4),
        (11, 10),
        (29, 20),
        (30, 35),
        (31, 56),
    ] {
        assert_eq!(Kind::usable(code, 0).map(|kind| kind.nodes), Ok(nodes), "{code}");
    }
    for solid in [5, 6, 7, 12, 13, 14, 17, 18, 19, 92, 93] {
        assert!(Kind::usable(solid, 0).is_err(), "{solid}");
    }
    for unknown in [0, -1, 32, i32::MAX, i32::MIN] {
        assert!(Kind::usable(unknown, 0).is_err(), "{unknown}");
    }
}
