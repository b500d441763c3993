use std::path::Path;

use super::super::tests::{expected, read, sample};
use crate::TetMesh;
use crate::file::{ReadOptions, read_mesh_bytes};

/// Writes the mesh as a legacy ASCII file of version 4.2.
fn ascii(mesh: &TetMesh, displacements: &[[f64; 3]]) -> String {
    let line = |v: &[f64; 3]| format!("{:?} {:?} {:?}\n", v[0], v[1], v[2]);
    let vectors = |all: &[[f64; 3]]| all.iter().map(line).collect::<String>();
    let cells = mesh.elements().len();
    let corners = |[a, b, c, d]: &[u32; 4]| format!("4 {a} {b} {c} {d}\n");
    format!(
        "# vtk DataFile Version 4.2\nsample\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS {} double\n{}CELLS {cells} {}\n{}\
         CELL_TYPES {cells}\n{}CELL_DATA {cells}\nSCALARS region int 1\nLOOKUP_TABLE default\n{}\
         POINT_DATA {}\nVECTORS displacement double\n{}",
        mesh.nodes().len(),
        vectors(mesh.nodes()),
        5 * cells,
        mesh.elements().iter().map(corners).collect::<String>(),
        "10\n".repeat(cells),
        mesh.regions()
            .iter()
            .map(|region| format!("{region}\n"))
            .collect::<String>(),
        displacements.len(),
        vectors(displacements)
    )
}

#[test]
fn ascii_is_read() {
    let (mesh, displacements) = sample();
    assert_eq!(read(ascii(&mesh, &displacements).as_bytes()).unwrap(), expected());
}

#[test]
fn binary_legacy_is_read_in_both_layouts_of_cells() {
    let (mesh, displacements) = sample();
    let big = |v: &[[f64; 3]]| {
        v.as_flattened()
            .iter()
            .flat_map(|x| x.to_be_bytes())
            .collect::<Vec<u8>>()
    };
    let (nodes, cells) = (mesh.nodes().len(), mesh.elements().len());
    for version in ["4.2", "5.1"] {
        let mut out =
            format!("# vtk DataFile Version {version}\nx\nBINARY\nDATASET UNSTRUCTURED_GRID\nPOINTS {nodes} double\n")
                .into_bytes();
        out.extend(big(mesh.nodes()));
        if version == "4.2" {
            out.extend(format!("\nCELLS {cells} {}\n", 5 * cells).bytes());
            for corners in mesh.elements() {
                out.extend([&[4], &corners[..]].concat().iter().flat_map(|n| n.to_be_bytes()));
            }
        } else {
            out.extend(format!("\nCELLS {} {}\nOFFSETS vtktypeint64\n", cells + 1, 4 * cells).bytes());
            out.extend((0..=cells as i64).flat_map(|n| (4 * n).to_be_bytes()));
            out.extend(b"\nCONNECTIVITY vtktypeint64\n");
            out.extend(
                mesh.elements()
                    .as_flattened()
                    .iter()
                    .flat_map(|n| i64::from(*n).to_be_bytes()),
            );
        }
        out.extend(format!("\nCELL_TYPES {cells}\n").bytes());
        out.extend((0..cells).flat_map(|_| 10i32.to_be_bytes()));
        out.extend(format!("\nCELL_DATA {cells}\nFIELD FieldData 1\nregion 1 {cells} int\n").bytes());
        out.extend(mesh.regions().iter().flat_map(|n| n.to_be_bytes()));
        out.extend(b"\nMETADATA\nINFORMATION 0\n\n");
        out.extend(format!("POINT_DATA {nodes}\nVECTORS moved%20by double\n").bytes());
        out.extend(big(&displacements));
        out.push(b'\n');
        let options = ReadOptions {
            displacement: Some("moved by"),
            region: Some("region"),
            ..ReadOptions::default()
        };
        let file = read_mesh_bytes(&out, Path::new("x.vtk"), &options).unwrap();
        assert_eq!(file.mesh, mesh);
        assert_eq!(file.displacements.as_ref(), Some(&displacements));
        let missing = ReadOptions {
            displacement: Some("u"),
            ..ReadOptions::default()
        };
        let error = read_mesh_bytes(&out, Path::new("x.vtk"), &missing)
            .unwrap_err()
            .to_string();
        assert!(error.contains("`moved by`") && error.contains("`u`"), "{error}");
        let cut = read(&out[..out.len() - 9]).unwrap_err().to_string();
        assert!(cut.contains("byte") && cut.contains("binary values"), "{cut}");
    }
}

#[test]
fn faults_name_their_line() {
    let (mesh, displacements) = sample();
    let good = ascii(&mesh, &displacements);
    let fault = |from: &str, to: &str| {
        assert!(good.contains(from), "{from}");
        read(good.replacen(from, to, 1).as_bytes()).unwrap_err().to_string()
    };
    for (from, to, says) in [
        (
            "ASCII",
            "TEXT",
            "line 3 (byte 34): found `TEXT`; expected ASCII or BINARY",
        ),
        ("UNSTRUCTURED_GRID", "POLYDATA", "line 4"),
        ("POINTS ", "POINTS -", "a count"),
        (" double\n", " decimal\n", "line 5"),
        ("VECTORS", "ARROWS", "`ARROWS`"),
        ("CELL_TYPES", "CELLTYPES", "`CELLTYPES`"),
        ("\n10\n", "\n12\n", "a hexahedron, VTK type 12; expected tetrahedra"),
        ("\n10\n", "\n99\n", "cell 0 is VTK type 99"),
        ("\n4 0 ", "\n4 999 ", "names point 999"),
        ("CELLS ", "CELLS 9", "a matching size"),
    ] {
        let error = fault(from, to);
        assert!(error.contains(says) && error.starts_with("mesh.vtk: "), "{error}");
    }
    assert!(
        read(b"\x01\x02\x03")
            .unwrap_err()
            .to_string()
            .contains("found binary data; expected `# vtk")
    );
    assert!(read(b"solid x").unwrap_err().to_string().contains("`solid x`"));
    assert!(read(b"").unwrap_err().to_string().contains("the end of the file"));
}

#[test]
fn regions_are_the_only_whole_array_or_told() {
    let (mesh, displacements) = sample();
    let good = ascii(&mesh, &displacements);
    let cells = mesh.elements().len();
    let array =
        |name: &str, kind: &str, values: &str| format!("SCALARS {name} {kind} 1\nLOOKUP_TABLE default\n{values}");
    let more = |name: &str, kind: &str| array(name, kind, &"1\n".repeat(cells));
    let with = |name: &str, kind: &str, before: &str| {
        let text = good.replace("SCALARS region int 1", &format!("{before}SCALARS {name} {kind} 1"));
        read(text.as_bytes()).unwrap()
    };
    let named = with(
        "labels",
        "int",
        &(more("stress", "double") + &more("vtkOriginalCellIds", "vtktypeint64")),
    );
    assert_eq!(named.mesh.regions(), mesh.regions());
    assert!(
        named.warnings.len() == 1 && named.warnings[0].contains("`labels`"),
        "{:?}",
        named.warnings
    );
    for (file, arrays) in [
        (with("labels", "int", &more("organs", "short")), "`organs`, `labels`"),
        (with("labels", "float", ""), "`labels`"),
    ] {
        assert!(file.mesh.regions().iter().all(|region| *region == 0));
        let hint = file.region_hint.unwrap();
        assert!(hint.starts_with(&format!("cell arrays: {arrays}; all regions are 0")) && file.warnings == [hint]);
    }
    // Numbers of more than 32 bits are no regions.
    let wide = array("hash", "vtktypeint64", &"5000000000\n".repeat(cells));
    let start = good.find("SCALARS region").unwrap();
    let file = read(format!("{}{wide}", &good[..start]).as_bytes()).unwrap();
    assert!(file.region_hint.is_some_and(|hint| hint.contains("`hash`")));
    // A number for each of many cells is no region.
    let many = TetMesh::over_box([0.0; 3], [9.0; 3], 700).unwrap();
    let numbers = (0..many.elements().len() as i32).collect();
    let many = TetMesh::new(many.nodes().to_vec(), many.elements().to_vec(), numbers).unwrap();
    let text = ascii(&many, &vec![[0.0; 3]; many.nodes().len()]).replace("SCALARS region", "SCALARS number");
    assert!(read(text.as_bytes()).unwrap().region_hint.is_some());
}

#[test]
fn hostile_counts_set_no_memory_aside() {
    let legacy =
        b"# vtk DataFile Version 3.0\nx\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 6148914691236517205 double\n1 2";
    assert!(read(legacy).is_err());
}
