use super::*;

/// A unit tetrahedron in every format, with a title.
const CORNERS: [[f64; 3]; 4] = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 3.5]];
const FACES: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]];

fn ascii_stl(title: &str) -> String {
    let mut text = format!("solid {title}\n");
    for face in FACES {
        text += " facet normal 0 0 0\n  outer loop\n";
        for [x, y, z] in face.map(|corner| CORNERS[corner as usize]) {
            text += &format!("   vertex {x} {y:e} {z}\n");
        }
        text += "  endloop\n endfacet\n";
    }
    text + "endsolid facet vertex\n"
}

fn binary_stl(title: &str) -> Vec<u8> {
    let mut bytes = format!("{title:80}").into_bytes();
    bytes.extend(4u32.to_le_bytes());
    for face in FACES {
        bytes.extend([0; 12]);
        for x in face.map(|corner| CORNERS[corner as usize]).as_flattened() {
            bytes.extend((*x as f32).to_le_bytes());
        }
        bytes.extend([0; 2]);
    }
    bytes
}

fn numbers<T: ToString>(all: &[T]) -> String {
    all.iter().map(T::to_string).collect::<Vec<_>>().join(" ")
}

fn files(title: &str) -> Vec<(&'static str, Vec<u8>)> {
    let lines = |head: &str, rows: Vec<String>| rows.iter().map(|row| format!("{head}{row}\n")).collect::<String>();
    let points = || CORNERS.iter().map(|corner| numbers(corner)).collect::<Vec<_>>();
    let faces = || FACES.iter().map(|face| numbers(face)).collect::<Vec<_>>();
    let from_one = FACES
        .iter()
        .map(|face| numbers(&face.map(|n| format!("{}//7", n + 1))))
        .collect();
    let from_last = FACES
        .iter()
        .map(|face| numbers(&face.map(|n| i64::from(n) - 4)))
        .collect();
    let head = format!("# vtk DataFile Version 4.2\n{title}\nASCII\nDATASET");
    let vtk = format!("POINTS 4 double\n{}", lines("", points()));
    let cells = lines("3 ", faces());
    let array = |kind: &str, name: &str, more: &str, values: String| {
        format!("<DataArray type='{kind}' Name='{name}' {more} format='ascii'>{values}</DataArray>\n")
    };
    let xml_points = format!(
        "<Points>{}</Points>",
        array(
            "Float64",
            "Points",
            "NumberOfComponents='3'",
            numbers(CORNERS.as_flattened())
        )
    );
    let xml_cells = array("Int64", "connectivity", "", numbers(FACES.as_flattened()))
        + &array("Int64", "offsets", "", "3 6 9 12".into());
    let space = title.split("SPACE=").nth(1).map_or(String::new(), |_| {
        format!(
            "<FieldData><Array type='String' Name='SPACE' NumberOfTuples='1' format='ascii'>{}</Array></FieldData>",
            numbers(&[&title.as_bytes()[title.len() - 3..], &[0]].concat())
        )
    });
    vec![
        ("stl", ascii_stl(title).into_bytes()),
        ("stl", format!(" \r\n{}", ascii_stl(title).replace('\n', "\r\n")).into_bytes()),
        ("stl", binary_stl(title)),
        ("stl", binary_stl(&format!("solid {title}"))),
        ("obj", format!("# {title}\nmtllib a.mtl\no x\n{}vn 0 0 1\ns off\n{}", lines("v ", points()), lines("f ", from_one)).into_bytes()),
        ("obj", format!("# {title}\r\n{}{}", lines("v ", points()), lines("f ", from_last)).into_bytes()),
        ("ply", format!("ply\nformat ascii 1.0\ncomment {title}\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 4\nproperty list uchar int vertex_indices\nend_header\n{}{}", lines("", points()), lines("3 ", faces())).into_bytes()),
        ("vtk", format!("{head} POLYDATA\n{vtk}VERTICES 1 2\n1 0\nLINES 1 3\n2 0 1\nPOLYGONS 4 16\n{cells}CELL_DATA 6\nSCALARS a int 1\nLOOKUP_TABLE default\n1 1 1 1 1 1\n").into_bytes()),
        ("vtk", format!("{head} POLYDATA\n{vtk}POLYGONS 5 12\nOFFSETS vtktypeint64\n0 3 6 9 12\nCONNECTIVITY vtktypeint64\n{}\n", numbers(FACES.as_flattened())).into_bytes()),
        ("vtk", format!("{head} UNSTRUCTURED_GRID\n{vtk}CELLS 4 16\n{cells}CELL_TYPES 4\n5 5 5 5\n").into_bytes()),
        ("vtp", format!("<?xml version='1.0'?><VTKFile type='PolyData'><PolyData>{space}<Piece NumberOfPoints='4' NumberOfVerts='0' NumberOfLines='1' NumberOfStrips='0' NumberOfPolys='4'>{xml_points}<Lines>{}{}</Lines><Polys>{xml_cells}</Polys></Piece></PolyData></VTKFile>",
            array("Int64", "connectivity", "", "0 1".into()), array("Int64", "offsets", "", "2".into())).into_bytes()),
        ("vtu", format!("<VTKFile type='UnstructuredGrid'><UnstructuredGrid>{space}<Piece NumberOfPoints='4' NumberOfCells='4'>{xml_points}<Cells>{xml_cells}{}</Cells></Piece></UnstructuredGrid></VTKFile>",
            array("UInt8", "types", "", "5 5 5 5".into())).into_bytes()),
    ]
}

/// Triangles by their corners' positions: numbers differ from format to format.
fn shape(surface: &SurfaceFile) -> Vec<[[f64; 3]; 3]> {
    let corner = |number: u32| surface.points[number as usize];
    surface.triangles.iter().map(|corners| corners.map(corner)).collect()
}

#[test]
fn every_format_gives_the_same_surface_and_its_axes() {
    let expected = FACES.map(|face| face.map(|corner| CORNERS[corner as usize]));
    for (title, is_ras) in [
        ("by hand", None),
        ("3D Slicer output. SPACE=RAS", Some(true)),
        ("3D Slicer output. SPACE=LPS", Some(false)),
        ("SPACE=IJK", None),
    ] {
        for (ending, bytes) in files(title) {
            let text = String::from_utf8_lossy(&bytes);
            let surface =
                SurfaceFile::parse(&bytes, ending).unwrap_or_else(|fault| panic!("{ending}: {fault:?}\n{text}"));
            assert_eq!(shape(&surface), expected, "{text}");
            assert_eq!((surface.points.len(), surface.is_ras), (4, is_ras), "{text}");
            assert_eq!(surface.longest_side(), 3.5);
        }
    }
}

#[test]
fn polygons_and_strips_become_triangles() {
    let square = "POINTS 4 float\n0 0 0 1 0 0 1 1 0 0 1 0\n";
    let head = "# vtk DataFile Version 4.2\nx\nASCII\nDATASET POLYDATA\n";
    let polygon = SurfaceFile::parse(format!("{head}{square}POLYGONS 1 5\n4 0 1 2 3\n").as_bytes(), "vtk").unwrap();
    assert_eq!(polygon.triangles, [[0, 1, 2], [0, 2, 3]]);
    let strip = SurfaceFile::parse(
        format!("{head}{square}TRIANGLE_STRIPS 1 5\n4 0 1 3 2\n").as_bytes(),
        "vtk",
    )
    .unwrap();
    assert_eq!(strip.triangles, [[0, 1, 3], [3, 1, 2]]);
    let obj = SurfaceFile::parse(b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1/1/1 2/1 3 4\n", "obj").unwrap();
    assert_eq!(obj.triangles, [[0, 1, 2], [0, 2, 3]]);
    // Of tetrahedra the faces that belong to one alone.
    let grid = "# vtk DataFile Version 4.2\nx\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 5 float\n0 0 0 1 0 0 0 1 0 0 0 1 1 1 1\nCELLS 2 10\n4 0 1 2 3\n4 1 2 3 4\nCELL_TYPES 2\n10 10\n";
    assert_eq!(SurfaceFile::parse(grid.as_bytes(), "vtk").unwrap().triangles.len(), 6);
    // A point within them is none of the surface.
    let grid = "# vtk DataFile Version 4.2\nx\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 5 float\n1 1 1 0 0 0 9 0 0 0 9 0 0 0 9\nCELLS 4 20\n4 0 2 3 4\n4 0 1 3 4\n4 0 1 2 4\n4 0 1 2 3\nCELL_TYPES 4\n10 10 10 10\n";
    let outside = SurfaceFile::parse(grid.as_bytes(), "vtk").unwrap();
    assert_eq!((outside.triangles.len(), outside.points.len()), (4, 4));
    assert!(!outside.points.contains(&[1.0; 3]), "{:?}", outside.points);
}

#[test]
fn faults_say_where_they_are() {
    let stl = ascii_stl("x");
    let fault = |bytes: &[u8], ending: &str| {
        let fault = SurfaceFile::parse(bytes, ending).unwrap_err();
        fault.locate(bytes, Path::new("a")).to_string()
    };
    for (bytes, ending, words) in [
        (
            stl.replace("vertex 1", "vertex one").into_bytes(),
            "stl",
            "found `one`; expected a coordinate",
        ),
        (stl.as_bytes()[..stl.len() - 60].to_vec(), "stl", "the end of the file"),
        (
            stl.replacen("   vertex 0 0e0 0\n", "", 1).into_bytes(),
            "stl",
            "a facet of 2 vertices",
        ),
        (
            binary_stl("x")[..140].to_vec(),
            "stl",
            "140 bytes with a count of 4 triangles",
        ),
        (b"short".to_vec(), "stl", "5 bytes with a count of 0"),
        (b"v 0 0\nf 1 2 3\n".to_vec(), "obj", "found `f`; expected a coordinate"),
        (b"v 0 0 0\nf 1 2 3\n".to_vec(), "obj", "line 2"),
        (
            b"v 0 0 0\nf 1 1 -9223372036854775808\n".to_vec(),
            "obj",
            "the number of one of the 1 vertices",
        ),
        (b"v 0 0 nan\n".to_vec(), "obj", "point 0 at [0.0, 0.0, NaN]"),
        (b"# nothing\n".to_vec(), "obj", "no point; expected a surface"),
        (
            b"ply\nformat ascii 1.0\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n3 0 1 2\n"
                .to_vec(),
            "ply",
            "no point",
        ),
        (
            b"ply\nformat ascii 1.0\nelements vertex 3\n".to_vec(),
            "ply",
            "line 3 (byte 21): found `elements`; expected a line of a PLY header",
        ),
        (
            b"ply\ncomment \xe9\nend_header\n".to_vec(),
            "ply",
            "line 2 (byte 4): found bytes that are no text",
        ),
        (vec![0; 60], "ply", "found binary data; expected a line of a PLY header"),
        (b"ply\n".to_vec(), "ply", "found the end of the file"),
        (b"NRRD0004\n".to_vec(), "stl", "NRRD labels; expected a surface"),
        (
            b"\x00\x01\x02\x03".to_vec(),
            "bin",
            "found binary data; expected a surface",
        ),
    ] {
        let error = fault(&bytes, ending);
        assert!(error.contains(words), "{error}");
    }
}

#[test]
fn elements_without_properties_ask_for_no_memory() {
    let text = "ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\nend_header\n";
    let fault = SurfaceFile::parse(text.as_bytes(), "ply").expect_err("a promise");
    let error = fault.locate(text.as_bytes(), Path::new("skin.ply")).to_string();
    assert!(
        error.contains("skin.ply") && error.contains("4000000000 elements in 73 bytes"),
        "{error}"
    );
}
