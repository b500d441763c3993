use std::fmt::Write as _;
use std::io::Write as _;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use proptest::prelude::*;

use super::super::*;
use super::*;

fn read(bytes: &[u8]) -> Result<MeshFile, MeshFileError> {
    read_mesh_bytes(bytes, Path::new("mesh.vtk"), &ReadOptions::default())
}

fn sample() -> (TetMesh, Vec<[f64; 3]>) {
    let lattice = TetMesh::over_box([-1.0, 0.1, 7.0], [4.0, 3.0, 9.5], 30).unwrap();
    let regions = (0..lattice.elements().len() as i32).map(|n| n % 3 - 1).collect();
    let mesh = TetMesh::new(lattice.nodes().to_vec(), lattice.elements().to_vec(), regions).unwrap();
    let displacements = mesh.nodes().iter().map(|n| [n[1] / 3.0, -n[0] * 1e-7, 0.1]).collect();
    (mesh, displacements)
}

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

/// A `.vtu` file whose arrays are written by `put`, which returns the attributes and the text of an array.
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

/// A compressed array in blocks of `block` bytes: its header and its data.
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
fn what_is_written_is_read_again() {
    let (mesh, displacements) = sample();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mesh.vtk");
    write_legacy(&path, &mesh, Some(&displacements)).unwrap();
    let file = read_mesh(&path, &ReadOptions::default()).unwrap();
    assert_eq!(
        file,
        MeshFile {
            mesh: mesh.clone(),
            displacements: Some(displacements.clone()),
            skipped_cells: 0
        }
    );
    assert_eq!(file.current()[3][2], mesh.nodes()[3][2] + displacements[3][2]);
    let plain = read(legacy_ascii(&mesh, None).as_bytes()).unwrap();
    assert_eq!(plain.displacements, None);
    assert_eq!(plain.current(), mesh.nodes());
    let nowhere = write_legacy(&folder.path().join("no/such/mesh.vtk"), &mesh, None).unwrap_err();
    assert!(nowhere.is_machine(), "{nowhere}");
}

#[test]
fn every_encoding_of_vtu_gives_the_same_mesh() {
    let (mesh, displacements) = sample();
    let expected = MeshFile {
        mesh,
        displacements: Some(displacements),
        skipped_cells: 0,
    };
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
        };
        let file = read_mesh_bytes(&out, Path::new("x.vtk"), &options).unwrap();
        assert_eq!(file.mesh, mesh);
        assert_eq!(file.displacements.as_ref(), Some(&displacements));
        let missing = ReadOptions {
            displacement: Some("u"),
            region: None,
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
    let good = legacy_ascii(&mesh, Some(&displacements));
    let fault = |from: &str, to: &str| {
        assert!(good.contains(from), "{from}");
        read(good.replacen(from, to, 1).as_bytes()).unwrap_err().to_string()
    };
    for (from, to, says) in [
        (
            "ASCII",
            "TEXT",
            "line 3 (byte 36): found `TEXT`; expected ASCII or BINARY",
        ),
        ("UNSTRUCTURED_GRID", "POLYDATA", "line 4"),
        ("POINTS ", "POINTS -", "a count"),
        (" double\n", " decimal\n", "line 5"),
        ("VECTORS", "ARROWS", "`ARROWS`"),
        ("CELL_TYPES", "CELLTYPES", "`CELLTYPES`"),
        ("\n10\n", "\n12\n", "VTK type 12"),
        ("\n4 0 ", "\n4 999 ", "names point 999"),
        ("CELLS ", "CELLS 9", "a matching size"),
    ] {
        let error = fault(from, to);
        assert!(error.contains(says) && error.starts_with("mesh.vtk: "), "{error}");
    }
    assert!(read(b"solid x").unwrap_err().to_string().contains("`solid x`"));
    assert!(read(b"").unwrap_err().to_string().contains("the end of the file"));
}

#[test]
fn hostile_headers_set_no_memory_aside() {
    let legacy =
        b"# vtk DataFile Version 3.0\nx\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 6148914691236517205 double\n1 2";
    assert!(read(legacy).is_err());
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
fn the_real_mesh_is_the_same_in_every_file() {
    let data = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data"));
    let names = [
        "meshes/DERIVED_s0328_3organ_tet_v42_ascii.vtk",
        "meshes/DERIVED_s0328_3organ_tet_v51_bin.vtk",
        "meshes/DERIVED_s0328_3organ_tet.vtu",
        "formats/DERIVED_s0328_3organ_tet_vtk9_appended.vtu",
    ];
    let mut first: Option<MeshFile> = None;
    for name in names {
        let path = data.join(name);
        if !path.exists() {
            println!("SKIPPED: {} is not there", path.display());
            continue;
        }
        let file = read_mesh(&path, &ReadOptions::default()).unwrap();
        let mesh = &file.mesh;
        assert_eq!((mesh.nodes().len(), mesh.elements().len()), (5430, 21727), "{name}");
        let count = |region| mesh.regions().iter().filter(|r| **r == region).count();
        assert_eq!([5, 2, 4].map(count), [14931, 4196, 2600], "{name}");
        let volumes: Vec<f64> = mesh.volumes(mesh.nodes()).collect();
        assert!(volumes.iter().all(|v| *v > 0.0), "{name}");
        assert!(
            (volumes.iter().sum::<f64>() - 2263.96e3).abs() < 10.0,
            "{name}: {}",
            volumes.iter().sum::<f64>()
        );
        match &first {
            Some(first) => assert_eq!(first.mesh, file.mesh, "{name}"),
            None => first = Some(file),
        }
    }
    let surface = data.join("meshes/plus_needle_20cm.vtk");
    if surface.exists() {
        let error = read_mesh(&surface, &ReadOptions::default()).unwrap_err().to_string();
        assert!(
            error.contains("POLYDATA") && error.contains("UNSTRUCTURED_GRID"),
            "{error}"
        );
    }
}

proptest! {
    #[test]
    fn damaged_files_never_panic(flip in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6), cut in any::<prop::sample::Index>()) {
        let (mesh, displacements) = sample();
        let mut zlib = String::new();
        write!(zlib, "{}", vtu("header_type='UInt64' compressor='vtkZLibDataCompressor'", "", |bytes| {
            let (header, data) = deflated(bytes, 96);
            ("format='binary'".into(), STANDARD.encode(header) + &STANDARD.encode(data))
        })).unwrap();
        for text in [legacy_ascii(&mesh, Some(&displacements)), zlib] {
            let mut bytes = text.into_bytes();
            for (place, byte) in &flip {
                let place = place.index(bytes.len());
                bytes[place] = *byte;
            }
            let _ = read(&bytes);
            bytes.truncate(cut.index(bytes.len()));
            let _ = read(&bytes);
        }
    }
}
