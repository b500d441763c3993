use std::io::Write as _;

use super::super::tests::{expected, read, sample};
use crate::TetMesh;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;

/// Every data array of the sample as VTK type, name, components and little-endian bytes.
struct Arrays {
    points: Vec<u8>,
    connectivity: Vec<u8>,
    offsets: Vec<u8>,
    types: Vec<u8>,
    regions: Vec<u8>,
    displacement: Vec<u8>,
}

fn arrays(mesh: &TetMesh, displacements: &[[f64; 3]]) -> Arrays {
    let floats = |v: &[[f64; 3]]| v.as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect();
    let cells = mesh.elements().len();
    Arrays {
        points: floats(mesh.nodes()),
        connectivity: mesh
            .elements()
            .as_flattened()
            .iter()
            .flat_map(|n| i64::from(*n).to_le_bytes())
            .collect(),
        offsets: (1..=cells as i32).flat_map(|n| (4 * n).to_le_bytes()).collect(),
        types: vec![10; cells],
        regions: mesh.regions().iter().flat_map(|n| n.to_le_bytes()).collect(),
        displacement: floats(displacements),
    }
}

/// Returns a `.vtu` file whose arrays are written by `put`, which returns the attributes and the text of an array.
fn vtu(header: &str, tail: &str, mut put: impl FnMut(&[u8]) -> (String, String)) -> String {
    let (mesh, displacements) = sample();
    let a = arrays(&mesh, &displacements);
    let mut array = |kind: &str, name: &str, components: usize, bytes: &[u8]| {
        let (attributes, text) = put(bytes);
        format!(
            "<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents='{components}' {attributes}>{text}</DataArray>\n"
        )
    };
    let points = array("Float64", "Points", 3, &a.points);
    let cells = array("Int64", "connectivity", 1, &a.connectivity)
        + &array("Int32", "offsets", 1, &a.offsets)
        + &array("UInt8", "types", 1, &a.types);
    let point_data = array("Float64", "displacement", 3, &a.displacement);
    let cell_data = array("Int32", "region", 1, &a.regions);
    format!(
        "<?xml version=\"1.0\"?>\n<!-- <Piece> -->\n<VTKFile type=\"UnstructuredGrid\" byte_order=\"LittleEndian\" {header}>\n\
         <UnstructuredGrid>\n<Piece NumberOfPoints=\"{}\" NumberOfCells=\"{}\">\n<PointData Vectors=\"displacement\">{point_data}\
         </PointData>\n<CellData>{cell_data}</CellData>\n<Points>{points}</Points>\n<Cells>{cells}</Cells>\n</Piece>\n\
         </UnstructuredGrid>\n{tail}</VTKFile>\n",
        mesh.nodes().len(),
        mesh.elements().len()
    )
}

fn counted(bytes: &[u8]) -> Vec<u8> {
    [&(bytes.len() as u32).to_le_bytes()[..], bytes].concat()
}

/// Compresses an array in blocks of `block` bytes: returns its header and its data.
fn deflated(bytes: &[u8], block: usize) -> (Vec<u8>, Vec<u8>) {
    let blocks: Vec<Vec<u8>> = bytes
        .chunks(block)
        .map(|chunk| {
            let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::default());
            encoder.write_all(chunk).unwrap();
            encoder.finish().unwrap()
        })
        .collect();
    let words = [blocks.len(), block, bytes.len() % block]
        .into_iter()
        .chain(blocks.iter().map(Vec::len));
    (
        words.flat_map(|word| (word as u64).to_le_bytes()).collect(),
        blocks.concat(),
    )
}

#[test]
fn every_encoding_of_vtu_gives_the_same_mesh() {
    let expected = expected();
    let binary = |text: String| ("format=\"binary\"".to_owned(), format!("\n{text}\n"));

    let inline = vtu("", "", |bytes| binary(STANDARD.encode(counted(bytes))));
    assert_eq!(read(inline.as_bytes()).unwrap(), expected);

    let header = "header_type='UInt64' compressor='vtkZLibDataCompressor'";
    let zlib = vtu(header, "", |bytes| {
        let (header, data) = deflated(bytes, 96);
        binary(STANDARD.encode(header) + &STANDARD.encode(data))
    });
    assert_eq!(read(zlib.as_bytes()).unwrap(), expected);

    for (encoding, compressed) in [("raw", false), ("raw", true), ("base64", false), ("base64", true)] {
        let mut data: Vec<u8> = b"_".to_vec();
        let body = vtu(if compressed { header } else { "" }, "@", |bytes| {
            let attributes = format!("format=\"appended\" offset=\"{}\"", data.len() - 1);
            match (encoding, compressed) {
                ("raw", false) => data.extend(counted(bytes)),
                ("raw", true) => data.extend([deflated(bytes, 96).0, deflated(bytes, 96).1].concat()),
                (_, false) => data.extend(STANDARD.encode(counted(bytes)).bytes()),
                (_, true) => {
                    let (header, packed) = deflated(bytes, 96);
                    data.extend((STANDARD.encode(header) + &STANDARD.encode(packed)).bytes());
                }
            }
            (attributes, String::new())
        });
        let (start, end) = body.split_once('@').unwrap();
        let open = format!("<AppendedData encoding=\"{encoding}\">\n  ");
        let all = [
            start.as_bytes(),
            open.as_bytes(),
            &data,
            b"\n</AppendedData>",
            end.as_bytes(),
        ]
        .concat();
        assert_eq!(read(&all).unwrap(), expected, "{encoding} {compressed}");
    }
}

#[test]
fn ascii_vtu_is_read() {
    let text = "<VTKFile type='UnstructuredGrid'><UnstructuredGrid><Piece NumberOfPoints='4' NumberOfCells='2'>
        <Points><DataArray type='Float32' NumberOfComponents='3' format='ascii'>0 0 0 1 0 0 0 1 0 0 0 1</DataArray></Points>
        <Cells><DataArray type='Int32' Name='connectivity' format='ascii'>0 1 2 3 0 1 2</DataArray>
        <DataArray type='Int32' Name='offsets' format='ascii'>4 7</DataArray>
        <DataArray type='UInt8' Name='types' format='ascii'>10 5</DataArray></Cells>
        </Piece></UnstructuredGrid></VTKFile>";
    let file = read(text.as_bytes()).unwrap();
    assert_eq!((file.mesh.elements(), file.skipped_cells), (&[[0, 1, 2, 3]][..], 1));
    let bad = text.replace("0 0 1</DataArray>", "0 0 l</DataArray>");
    let error = read(bad.as_bytes()).unwrap_err().to_string();
    assert!(error.contains("line 2") && error.contains("`l`"), "{error}");
}

#[test]
fn regions_are_the_only_whole_array_of_vtu() {
    let put = |bytes: &[u8]| ("format=\"binary\"".to_owned(), STANDARD.encode(counted(bytes)));
    let text = vtu("", "", put).replace("Name=\"region\"", "Name=\"labels\"");
    let broken = text.replace(
        "<CellData>",
        "<CellData><DataArray type='Float32' Name='labels' format='lost'>?</DataArray>",
    );
    let file = read(text.as_bytes()).unwrap();
    assert_eq!(file.mesh.regions(), expected().mesh.regions());
    assert!(file.warnings[0].contains("`labels`"), "{:?}", file.warnings);
    // Numbers of elements are no regions, whatever their name; those of materials are, whatever theirs.
    let (mesh, _) = sample();
    let numbers = |count: usize, modulus: usize| {
        let numbers: Vec<String> = (0..count).map(|number| (number % modulus).to_string()).collect();
        format!("format='ascii'>{}</DataArray>", numbers.join(" "))
    };
    let [cells, points] = [mesh.elements().len(), mesh.nodes().len()];
    let ids = format!(
        "<DataArray type='Int32' Name='GlobalElementId' {}",
        numbers(cells, cells)
    );
    let of_points = format!("<DataArray type='Int32' Name='organ' {}", numbers(points, 3));
    let both = text
        .replace("\"labels\"", "\"MaterialIDs\"")
        .replace("<CellData>", &format!("<CellData>{ids}"));
    let both = read(both.as_bytes()).unwrap();
    assert_eq!(both.mesh, file.mesh);
    assert!(both.warnings[0].contains("`MaterialIDs`"), "{:?}", both.warnings);
    let start = text.find("<CellData>").unwrap();
    let end = text.find("</CellData>").unwrap();
    let ids_alone = format!("{}<CellData>{ids}{}", &text[..start], &text[end..]);
    let ids_alone = ids_alone.replace("</PointData>", &format!("{of_points}</PointData>"));
    let hint = read(ids_alone.as_bytes()).unwrap().region_hint.unwrap();
    assert!(
        hint.contains("`GlobalElementId`") && hint.contains("numbers: `organ`"),
        "{hint}"
    );
    assert!(hint.contains("Point Data to Cell Data"), "{hint}");
    // An array that is not wanted is not decoded.
    assert_eq!(read(broken.as_bytes()).unwrap().mesh, file.mesh);
}

#[test]
fn tetrahedra_of_second_order_are_read_by_their_corners() {
    let text = "<VTKFile type='UnstructuredGrid'><UnstructuredGrid><Piece NumberOfPoints='10' NumberOfCells='1'>
        <Points><DataArray type='Float32' NumberOfComponents='3' format='ascii'>0 0 0 0.5 0 0 0 0.5 0 0 0 0.5 0.5 0.5 0 0.5 0 0.5 0 0.5 0.5
        1 0 0 0 1 0 0 0 1</DataArray></Points>
        <Cells><DataArray type='Int32' Name='connectivity' format='ascii'>0 7 8 9 1 4 2 3 5 6</DataArray>
        <DataArray type='Int32' Name='offsets' format='ascii'>10</DataArray>
        <DataArray type='UInt8' Name='types' format='ascii'>24</DataArray></Cells>
        </Piece></UnstructuredGrid></VTKFile>";
    let file = read(text.as_bytes()).unwrap();
    assert_eq!(
        file.mesh.nodes(),
        [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    );
    assert!(
        file.warnings[0].contains("6 of 10 nodes are left out"),
        "{:?}",
        file.warnings
    );
    let linear = text.replace(">24<", ">10<");
    assert!(
        read(linear.as_bytes())
            .unwrap_err()
            .to_string()
            .contains("four entries")
    );
    let other = text.replace("VTKFile", "Other");
    let error = read(other.as_bytes()).unwrap_err().to_string();
    assert!(error.contains("XML that is no VTKFile"), "{error}");
}

#[test]
fn other_formats_are_named() {
    for (bytes, name, instead) in [
        (&b"<Xdmf Version=\"3.0\">"[..], "an XDMF file", "meshio convert"),
        (b"*HEADING\n*NODE\n", "an Abaqus file", "meshio"),
        (b"480 4 0\n0 90 76 58 151\n", "a TetGen file", "-k"),
        (b"MeshVersionFormatted 2\n", "a Medit file", "gmsh"),
        (b"BEGIN BULK\nGRID", "a Nastran file", "meshio"),
        (b"<febio_spec version='4.0'>", "a FEBio file", "export it as VTK"),
        (b"<VTKFile type=\"Collection\">", "a list of VTK files", "give the .vtu"),
        (b"glTF\x02", "a scene of glTF", "mesh make"),
        (b"ply\nformat ascii 1.0\n", "a PLY surface", "mesh make"),
        (b"NRRD0004\n", "NRRD labels", "mesh make"),
    ] {
        let error = read(bytes).unwrap_err().to_string();
        assert!(
            error.contains(&format!("{name}; expected VTK (.vtk, .vtu) or Gmsh (.msh)")) && error.contains(instead),
            "{error}"
        );
    }
}

#[test]
fn hostile_headers_set_no_memory_aside() {
    let header = "header_type='UInt64' compressor='vtkZLibDataCompressor'";
    for words in [
        [u64::MAX, 8, 0, 3],
        [1, u64::MAX, 0, 3],
        [1, 1 << 40, 0, 3],
        [1, 8, 0, u64::MAX],
    ] {
        let bytes: Vec<u8> = words.iter().flat_map(|w| w.to_le_bytes()).collect();
        let text = vtu(header, "", |_| {
            ("format='binary'".into(), STANDARD.encode(&bytes) + "AAAA")
        });
        assert!(read(text.as_bytes()).is_err());
    }
}

#[test]
fn other_compressors_and_pieces_are_refused_with_the_way_on() {
    let put = |bytes: &[u8]| ("format=\"binary\"".to_owned(), STANDARD.encode(counted(bytes)));
    let plain = vtu("", "", put);
    let (start, end) = plain.split_once("</Piece>").unwrap();
    let piece = &start[start.rfind("<Piece").unwrap()..];
    let two = format!("{start}</Piece>{piece}</Piece>{end}");
    let packed = |name: &str| vtu(&format!("compressor='{name}'"), "", put);
    for (text, words) in [
        (
            packed("vtkLZ4DataCompressor"),
            "found compressor=`vtkLZ4DataCompressor`; expected none or vtkZLibDataCompressor (a choice of Save Data",
        ),
        (packed("vtkLZMADataCompressor"), "vtkLZMADataCompressor"),
        (
            two,
            "found a second Piece; expected a single Piece, as ParaView's Save Data writes it",
        ),
    ] {
        let error = read(text.as_bytes()).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    }
}
