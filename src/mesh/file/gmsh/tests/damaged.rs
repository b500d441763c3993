//! Damaged Gmsh files and their errors.

use super::read;
use super::written::{ALL, Model, ascii};
use insonify_base::blame::Blame;

/// Returns the error of an ASCII file with one change.
fn changed(version: u8, from: &str, to: &str) -> String {
    let text = String::from_utf8(ascii(version).write(&Model::default())).unwrap();
    assert!(text.contains(from), "{from} in\n{text}");
    match read(text.replacen(from, to, 1).as_bytes()) {
        Err(error) => error.to_string(),
        Ok(_) => panic!("{from:?} to {to:?} is read"),
    }
}

#[test]
fn faults_name_their_line_and_what_they_found() {
    for (version, from, to, says) in [
        (
            2,
            "2.2 0 8",
            "2.3 0 8",
            "line 2 (byte 12): found `2.3`; expected version 2.2 or 4.1",
        ),
        (2, "2.2 0 8", "4 0 8", "found `4`"),
        (2, "2.2 0 8", "2.2 2 8", "0 (ASCII) or 1 (binary)"),
        (2, "2.2 0 8", "2.2 0 4", "a data size of 8"),
        (2, "$MeshFormat", "$Comment", "line 1"),
        (2, "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n", "", "$MeshFormat before it"),
        (2, "$EndComments", "$EndComment", "found `$Comments`"),
        (
            2,
            "3 7 \"left",
            "4 7 \"left",
            "line 10 (byte 103): found `4`; expected a dimension from 0 to 3",
        ),
        (2, "\"skin\"", "\"skin", "a name in quotes"),
        (2, "$Nodes\n6\n", "$Nodes\n5\n", "$EndNodes"),
        (2, "$Nodes\n6\n", "$Nodes\n-1\n", "found `-1`; expected a count"),
        (2, "$Nodes\n6\n", "$Nodes\n99999\n", "99999 items"),
        (
            2,
            "$Nodes\n6\n",
            "$Nodes\n18446744073709551615\n",
            "18446744073709551615 items",
        ),
        (2, "\n21 ", "\n7 ", "two nodes with the tag 7"),
        (2, "\n21 ", "\n-21 ", "the tag -21"),
        (2, "\n21 ", "\n2e1 ", "found `2e1`; expected a whole number"),
        (2, "\n21 ", "\n22 ", "the node 21"),
        (
            2,
            "\n21 0.1 ",
            "\n21 NaN ",
            "found NaN; expected a finite coordinate of node 21",
        ),
        (2, "\n21 0.1 ", "\n21 inf ", "found inf"),
        (2, "\n21 0.1 ", "\n21 0,1 ", "found `0,1`; expected a number"),
        (2, "\n$Nodes", "\n$Nodse", "found `$Nodse`"),
        (
            2,
            "\n4 4 3 ",
            "\n4 5 3 ",
            "a hexahedron (element type 5); expected tetrahedra as the only",
        ),
        (2, "\n4 4 3 ", "\n4 13 3 ", "a second-order prism"),
        (2, "\n4 4 3 ", "\n4 77 3 ", "element type 77"),
        (2, "\n4 4 3 ", "\n4 4 2147483647 ", "2147483647 items"),
        (2, "\n4 4 3 ", "\n4 4 -3 ", "the tag -3"),
        (4, "4.1 0 8", "4.0 0 8", "found `4.0`"),
        (
            4,
            "$Entities\n1 1 0 2",
            "$Entities\n1 1 0 1844674407370955161",
            "1844674407370955161 items",
        ),
        (4, "$Entities\n1 1 0 2", "$Entities\n1 1 0 3", "found `$EndEntities`"),
        (4, "$Nodes\n2 6 ", "$Nodes\n2 7 ", "6 nodes in the blocks; expected 7"),
        (4, "$Nodes\n2 6 ", "$Nodes\n3 6 ", "found `$EndNodes`"),
        (4, "$Nodes\n2 6 ", "$Nodes\n9999999999 6 ", "found `$EndNodes`"),
        (4, "\n3 1 0 5 \n", "\n3 1 0 5000000000 \n", "5000000000 items"),
        (4, "\n3 1 0 5 \n", "\n4 1 0 5 \n", "dimension 4, parametric 0"),
        (4, "\n3 1 0 5 \n", "\n3 1 2 5 \n", "dimension 3, parametric 2"),
        (4, "\n21 \n", "\n7 \n", "two nodes with the tag 7"),
        (4, "\n0.1 0.0", "\nnan 0.0", "finite coordinate of node 21"),
        (
            4,
            "$Elements\n5 6 ",
            "$Elements\n5 5 ",
            "6 elements in the blocks; expected 5",
        ),
        (
            4,
            "\n3 1 4 2 \n",
            "\n2 1 4 2 \n",
            "tetrahedra on an entity of dimension 2",
        ),
        (4, "\n3 1 4 2 \n", "\n3 1 6 2 \n", "a prism"),
        (
            4,
            "\n3 1 4 2 \n",
            "\n3 1 4 18446744073709551615 \n",
            "bytes to the end of the file",
        ),
        (
            4,
            "90 3 7 10 21",
            "90 3 7 10 22",
            "a tetrahedron with the node 22; expected the tags of 4 of the 6 nodes",
        ),
        (4, "90 3 7 10 21", "90 3 7 10 10", "names node 2 twice"),
        (4, "$Elements", "$Nodes", "one of each section"),
        (4, "$EndElements", "$EndElement", "expected $EndElements"),
        (
            4,
            "$NodeData\n1\n\"x\"\n$EndNodeData",
            "stray",
            "found `stray`; expected a section",
        ),
    ] {
        let error = changed(version, from, to);
        assert!(
            error.contains(says) && error.starts_with("mesh.msh: "),
            "{from:?} to {to:?}: {error}"
        );
    }
}

#[test]
fn other_orders_and_versions_are_refused() {
    for (text, says) in [
        ("$NOD\n1\n1 0 0 0\n$ENDNOD\n", "version 1 of the format"),
        ("$MeshFormat\n2.2 0 8\n$EndMeshFormat\n", "without a mesh"),
        (
            "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Elements\n0\n$EndElements\n",
            "$Nodes before it",
        ),
        (
            "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$ParametricNodes\n",
            "nodes with parameters; expected $Nodes, as Gmsh writes with `Mesh.SaveParametric = 0`",
        ),
        (
            "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n0\n$EndNodes\n$Elements\n0\n$EndElements\n",
            "no tetrahedra",
        ),
        ("$MeshFormat\n2.2 1 8\n\u{1}\u{0}\u{1}\u{0}\n", "tells the byte order"),
        ("$", "found `$`"),
        ("$MeshFormat", "the end of the file"),
    ] {
        let error = read(text.as_bytes()).unwrap_err().to_string();
        assert!(error.contains(says), "{text:?}: {error}");
    }
}

#[test]
fn hostile_blocks_of_version_2_are_refused() {
    let start = b"$MeshFormat\n2.2 1 8\n\x01\x00\x00\x00\n$EndMeshFormat\n$Nodes\n0\n$EndNodes\n$Elements\n1\n";
    for block in [[4, 1, i32::MAX], [4, i32::MAX, 1], [15, 0, 0], [4, -1, 0], [4, 2, 0]] {
        let mut bytes = start.to_vec();
        block.iter().for_each(|n: &i32| bytes.extend(n.to_le_bytes()));
        bytes.extend([0; 200]);
        assert!(read(&bytes).is_err(), "{block:?}");
    }
}

#[test]
fn files_cut_short_anywhere_are_refused() {
    for encoding in ALL {
        let bytes = encoding.write(&Model {
            groups: vec![7, 9],
            partitioned: encoding.version == 4,
            parametric: encoding.version == 4,
            curved: true,
        });
        let end = b"$EndElements";
        let whole = bytes.windows(end.len()).rposition(|window| window == end).unwrap() + end.len();
        for length in 0..whole {
            let error = read(&bytes[..length]).expect_err("a file cut short");
            assert!(!error.is_machine(), "{encoding:?} cut to {length}");
        }
        assert!(read(&bytes[..whole]).is_ok(), "{encoding:?}");
    }
}
