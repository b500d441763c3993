//! Small sound files of every format, and the files that stand beside a case.

use std::fmt::Write as _;
use std::path::Path;

use insonify_anatomy::volume::{Label, LabelVolume, save};
use insonify_mesh::TetMesh;
use insonify_mesh::file::write_vtu;
use nalgebra::Matrix4;

/// Voxels along an axis.
const SIDE: usize = 6;

/// Scenes, scenarios and problems on the files of [`beside`].
pub(crate) const SCENE: &str = include_str!("scene.toml");
pub(crate) const SCENARIO: &str = include_str!("scenario.toml");
pub(crate) const PROBLEM: &str = "mesh = \"block.msh\"\nmodel = \"linear\"\nreport_nodes = [0, 5]\n[[material]]\nyoung_kpa = 5.0\npoisson = 0.45\n\
    [[material]]\nregion = 2\nyoung_kpa = 30.0\npoisson = 0.4\n\
    [[fix]]\nbox_mm = [[-inf, -inf, -inf], [inf, inf, 1.0]]\n[[fix]]\nnodes = [26]\naxes = \"x\"\ndisplacement_mm = [1.0, 0.0, 0.0]\n\
    [[load]]\nnodes = [18, 20]\nforce_n = [0.0, 0.0, 0.01]\n";
pub(crate) const COURSE: &str = "[nonlinear]\nscheme = \"newton\"\ntolerance = 1e-6\niterations = 20\n[viscoelastic]\norder = 0.1\n\
    law = \"load-integral\"\nrule = \"exponentials\"\n[history]\ntime_s = [0.0, 1.0, 2.0]\nfactor = [0.0, 1.0, 1.0]\nstep_s = 0.5\n";
pub(crate) const POSES: &str =
    "# poses\ntime_s,x_mm,y_mm,z_mm,qw,qx,qy,qz\n0,0,-20,0,1,0,0,0\n0.5,5,-20,1,0.7071,0,0.7071,0\n1,9,-21,0,1,0,0,0\n";
pub(crate) const AIMED: &str =
    "time_s,x_mm,y_mm,z_mm,dx,dy,dz,lx,ly,lz\n0,0,-20,0,0,1,0,1,0,0\n1,5,-20,1,0,1,0.1,1,0,0\n";
pub(crate) const MATRICES: &str =
    "time_s,m00,m01,m02,m03,m10,m11,m12,m13,m20,m21,m22,m23,m30,m31,m32,m33\n0,1,0,0,3,0,1,0,4,0,0,1,5,0,0,0,1\n";
pub(crate) const NAMES_OF_LABELS: [&str; 3] = [
    "value,name\n1,liver\n2,spleen\n",
    "1 liver 255 0 0 255\n2 spleen 0 0 0 255\n",
    "  40  255 0 0  1 1 1  \"right lung\"\n",
];
pub(crate) const POINTS: &str = "stretch,stress_kpa\n1.0,0.0\n0.95,-1.98\n0.90,-4.1\n0.85,-6.9\n0.8,-10.2\n0.7,-20\n";
pub(crate) const COSTS: &str = r#"{"measured": "frames", "errors": "mm", "base_ms": 1.5, "settings": [
    {"keys": ["lines", "samples"], "options": [{"values": ["64", "128"], "extra_ms": 0.1, "error": 2}, {"values": ["256", "512"], "extra_ms": 4, "error": 0}]},
    {"keys": ["level"], "options": [{"values": ["exact"], "extra_ms": 0, "error": 0}, {"values": ["two"], "extra_ms": -1, "error": 0.5}]}]}"#;
pub(crate) const XML: &str = r#"<PlusConfiguration version="2.3"><ScanConversion TransducerGeometry="LINEAR" ImagingDepthMm="60.0"
    TransducerWidthMm="40.0" OutputImageSizePixel="820 616" TransducerCenterPixel="410 0" OutputImageSpacingMmPerPixel="0.085 0.085"/>
    <CoordinateDefinitions><Transform From="Image" To="Probe" Matrix="0.08 0 0 1  0 0.08 0 2  0 0 0.08 3  0 0 0 1" Error="0.5"/>
    <Transform From="Reference" To="Tracker" Matrix="1 0 0 1  0 1 0 2  0 0 1 3  0 0 0 1"/></CoordinateDefinitions></PlusConfiguration>"#;

pub(crate) const VTU: &str = r#"<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" header_type="UInt64"><UnstructuredGrid>
    <Piece NumberOfPoints="4" NumberOfCells="1"><Points><DataArray type="Float64" NumberOfComponents="3" format="ascii">0 0 0 10 0 0 0 10 0
    0 0 10</DataArray></Points><Cells><DataArray type="Int64" Name="connectivity" format="ascii">0 1 2 3</DataArray>
    <DataArray type="Int64" Name="offsets" format="ascii">4</DataArray><DataArray type="UInt8" Name="types" format="ascii">10</DataArray>
    </Cells><CellData><DataArray type="Int32" Name="region" format="binary">BAAAAAAAAAABAAAA</DataArray></CellData>
    </Piece></UnstructuredGrid></VTKFile>"#;

/// A body of three labels.
pub(crate) fn volume() -> LabelVolume {
    let inside = |n: usize| [n % SIDE, n / SIDE % SIDE, n / SIDE / SIDE].map(|at| (1..5).contains(&at));
    let voxels: Vec<u8> = (0..SIDE.pow(3))
        .map(|n| {
            if inside(n) == [true; 3] {
                1 + u8::from(n % SIDE > 2)
            } else {
                0
            }
        })
        .collect();
    let names = [None, Some("liver"), Some("kidney_left")];
    let labels = names.iter().enumerate().map(|(index, name)| Label {
        value: 7 * index as i64,
        name: name.map(str::to_owned),
        voxels: voxels.iter().filter(|voxel| usize::from(**voxel) == index).count() as u64,
    });
    let labels = labels.collect();
    #[rustfmt::skip]
    let world = Matrix4::new(
        10.0, 0.0, 0.0, -25.0,
        0.0, 10.0, 0.0, -25.0,
        0.0, 0.0, 10.0, -25.0,
        0.0, 0.0, 0.0, 1.0,
    );
    LabelVolume::new([SIDE; 3], voxels, labels, world).expect("a volume")
}

/// What [`save`] makes of it.
pub(crate) fn saved(folder: &Path, name: &str) -> Vec<u8> {
    let path = folder.join(name);
    save(&volume(), &path).expect("saved");
    let bytes = std::fs::read(&path).expect("saved");
    std::fs::remove_file(&path).expect("saved");
    bytes
}

/// The file of [`saved`] in NIfTI-1 as one of NIfTI-2.
pub(crate) fn nifti_2(nifti: &[u8]) -> Vec<u8> {
    let offset = f32::from_le_bytes(nifti[108..112].try_into().expect("four bytes")) as usize;
    let mut bytes = vec![0; 544];
    let mut put = |start: usize, number: &[u8]| bytes[start..start + number.len()].copy_from_slice(number);
    put(0, &540i32.to_le_bytes());
    put(4, b"n+2\0\r\n\x1a\n");
    put(12, &nifti[70..72]);
    for index in 0..8 {
        put(16 + 8 * index, &[3i64, 6, 6, 6, 1, 1, 1, 1][index].to_le_bytes());
        put(104 + 8 * index, &1f64.to_le_bytes());
    }
    put(168, &544i64.to_le_bytes());
    put(344, &1i32.to_le_bytes());
    put(500, &2i32.to_le_bytes());
    bytes.extend_from_slice(&nifti[offset..]);
    bytes
}

/// Voxels as they stand in a raw file.
fn raw() -> Vec<u8> {
    volume().voxels().iter().map(|index| 7 * index).collect()
}

/// Headers of images with this line for their data, then the data of those that hold them.
pub(crate) fn nrrd(data: &str) -> Vec<u8> {
    let attached = data.starts_with("encoding: raw\n\n");
    let header = format!(
        "NRRD0005\ntype: uint8\ndimension: 3\nspace: left-posterior-superior\nsizes: 6 6 6\n\
         space directions: (10,0,0) (0,10,0) (0,0,10)\nspace origin: (-25,-25,-25)\nkinds: domain domain domain\n\
         Segment0_ID:=Segment_1\nSegment0_LabelValue:=7\nSegment0_Layer:=0\nSegment0_Name:=a\\nliver\n{data}"
    );
    [header.as_bytes(), if attached { raw() } else { Vec::new() }.as_slice()].concat()
}

pub(crate) fn metaimage(file: &str) -> Vec<u8> {
    let header = format!(
        "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nCompressedData = False\n\
         TransformMatrix = 1 0 0 0 1 0 0 0 1\nOffset = -25 -25 -25\nElementSpacing = 10 10 10\nDimSize = 6 6 6\n\
         ElementType = MET_UCHAR\nElementDataFile = {file}\n"
    );
    [
        header.as_bytes(),
        if file == "LOCAL" { raw() } else { Vec::new() }.as_slice(),
    ]
    .concat()
}

/// A grey volume of text.
pub(crate) fn texture() -> Vec<u8> {
    let values: String = (0..64).map(|n| format!("{} ", 1 + n * 7 % 13)).collect();
    format!("NRRD0004\ntype: float\ndimension: 3\nsizes: 4 4 4\nspacings: 1 1 1\nencoding: ascii\n\n{values}\n")
        .into_bytes()
}

/// A recording of three frames of 2 x 2 pixels, as MetaImage or NRRD.
pub(crate) fn sequence(is_nrrd: bool) -> Vec<u8> {
    let mut text = if is_nrrd {
        "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 2 2 3\nspacings: 1 1 1\nencoding: raw\nkinds: domain domain list\n"
            .to_owned()
    } else {
        "ObjectType = Image\nNDims = 3\nDimSize = 2 2 3\nElementSpacing = 1 1 1\n".to_owned()
    };
    let is = if is_nrrd { ":=" } else { " = " };
    let _ = writeln!(text, "UltrasoundImageOrientation{is}MF");
    for frame in 0..3 {
        let matrix = format!("1 0 0 {frame} 0 1 0 -30 0 0 1 0 0 0 0 1");
        for tool in ["Probe", "Needle"] {
            let _ = writeln!(text, "Seq_Frame000{frame}_{tool}ToTrackerTransform{is}{matrix}");
            let _ = writeln!(text, "Seq_Frame000{frame}_{tool}ToTrackerTransformStatus{is}OK");
        }
        let _ = writeln!(text, "Seq_Frame000{frame}_Timestamp{is}{frame}.5");
        let _ = writeln!(text, "Seq_Frame000{frame}_ImageStatus{is}OK");
    }
    text += if is_nrrd {
        "\n"
    } else {
        "ElementType = MET_UCHAR\nElementDataFile = LOCAL\n"
    };
    [text.as_bytes(), b"123456789abc"].concat()
}

/// A cube of 27 nodes, its lower half of region 1, its upper of region 2.
pub(crate) fn cube() -> TetMesh {
    let place = |n: usize| [n % 3, n / 3 % 3, n / 9].map(|at| 10.0 * at as f64 - 10.0);
    let mut elements = Vec::new();
    for cell in 0..8usize {
        let corner = cell % 2 + 3 * (cell / 2 % 2) + 9 * (cell / 4);
        for [first, second] in [[1, 3], [3, 9], [9, 1], [3, 1], [9, 3], [1, 9]] {
            let nodes = [corner, corner + first, corner + first + second, corner + 13].map(|node| node as u32);
            // Odd ways along the axes turn the element inside out.
            let odd = [[3, 1], [9, 3], [1, 9]].contains(&[first, second]);
            elements.push(if odd {
                [nodes[0], nodes[2], nodes[1], nodes[3]]
            } else {
                nodes
            });
        }
    }
    let regions = (0..elements.len())
        .map(|element| 1 + i32::from(element >= elements.len() / 2))
        .collect();
    TetMesh::new((0..27).map(place).collect(), elements, regions).expect("a mesh")
}

/// The cube by [`write_vtu`].
pub(crate) fn vtu(folder: &Path) -> Vec<u8> {
    let path = folder.join("cube.vtu");
    write_vtu(&path, &cube(), Some(&[[0.5, 0.0, 0.0]; 27])).expect("written");
    let bytes = std::fs::read(&path).expect("written");
    std::fs::remove_file(&path).expect("written");
    bytes
}

/// Numbers of a format as text, or as the bytes that it stores.
struct Numbers {
    bytes: Vec<u8>,
    text: bool,
    big: bool,
}

impl Numbers {
    fn put(&mut self, text: &str, little: &[u8]) {
        match (self.text, self.big) {
            (true, _) => self.bytes.extend_from_slice(format!("{text} ").as_bytes()),
            (_, true) => self.bytes.extend(little.iter().rev()),
            (_, false) => self.bytes.extend_from_slice(little),
        }
    }

    fn int(&mut self, all: &[u32]) {
        all.iter().for_each(|n| self.put(&n.to_string(), &n.to_le_bytes()));
    }

    fn long(&mut self, all: &[u64]) {
        all.iter().for_each(|n| self.put(&n.to_string(), &n.to_le_bytes()));
    }

    fn float(&mut self, all: &[f64]) {
        all.iter().for_each(|x| self.put(&format!("{x:?}"), &x.to_le_bytes()));
    }

    fn line(&mut self, text: &str) {
        self.bytes.extend_from_slice(text.as_bytes());
        self.bytes.push(b'\n');
    }
}

const NAMES: &str = "$PhysicalNames\n2\n3 1 \"liver\"\n3 2 \"kidney\"\n$EndPhysicalNames";

/// The cube in version 2.2 of Gmsh's format.
pub(crate) fn gmsh22(text: bool) -> Vec<u8> {
    let (mesh, mut out) = (
        cube(),
        Numbers {
            bytes: Vec::new(),
            text,
            big: false,
        },
    );
    out.line(&format!("$MeshFormat\n2.2 {} 8", u8::from(!text)));
    if !text {
        out.int(&[1]);
        out.line("");
    }
    out.line(&format!("$EndMeshFormat\n{NAMES}\n$Nodes\n27"));
    for (node, place) in mesh.nodes().iter().enumerate() {
        out.int(&[node as u32 + 1]);
        out.float(place);
        if text {
            out.line("");
        }
    }
    out.line("\n$EndNodes\n$Elements\n48");
    if !text {
        out.int(&[4, 48, 2]);
    }
    for (number, (nodes, region)) in mesh.elements().iter().zip(mesh.regions()).enumerate() {
        out.int(&[number as u32 + 1]);
        if text {
            out.int(&[4, 2]);
        }
        out.int(&[*region as u32, *region as u32]);
        out.int(&nodes.map(|node| node + 1));
        if text {
            out.line("");
        }
    }
    out.line("\n$EndElements");
    out.bytes
}

/// The cube in version 4.1 of Gmsh's format.
pub(crate) fn gmsh41(text: bool) -> Vec<u8> {
    let (mesh, mut out) = (
        cube(),
        Numbers {
            bytes: Vec::new(),
            text,
            big: false,
        },
    );
    out.line(&format!("$MeshFormat\n4.1 {} 8", u8::from(!text)));
    if !text {
        out.int(&[1]);
        out.line("");
    }
    out.line(&format!("$EndMeshFormat\n{NAMES}\n$Entities"));
    out.long(&[0, 0, 0, 2]);
    for volume in [1, 2] {
        out.int(&[volume]);
        out.float(&[-10.0, -10.0, -10.0, 10.0, 10.0, 10.0]);
        out.long(&[1]);
        out.int(&[volume]);
        out.long(&[0]);
    }
    out.line("\n$EndEntities\n$Nodes");
    out.long(&[1, 27, 1, 27]);
    out.int(&[3, 1, 0]);
    out.long(&[27]);
    out.long(&(1..=27).collect::<Vec<_>>());
    mesh.nodes().iter().for_each(|place| out.float(place));
    out.line("\n$EndNodes\n$Elements");
    out.long(&[2, 48, 1, 48]);
    for (number, (nodes, region)) in mesh.elements().iter().zip(mesh.regions()).enumerate() {
        if number % 24 == 0 {
            out.int(&[3, *region as u32, 4]);
            out.long(&[24]);
        }
        out.long(&[number as u64 + 1]);
        out.long(&nodes.map(|node| u64::from(node) + 1));
    }
    out.line("\n$EndElements");
    out.bytes
}

/// The cube as legacy VTK, of version 5.1 with offsets or of version 3.
pub(crate) fn vtk(text: bool, offsets: bool) -> Vec<u8> {
    let (mesh, mut out) = (
        cube(),
        Numbers {
            bytes: Vec::new(),
            text,
            big: true,
        },
    );
    let version = if offsets { "5.1" } else { "3.0" };
    let kind = if text { "ASCII" } else { "BINARY" };
    out.line(&format!(
        "# vtk DataFile Version {version}\ncube\n{kind}\nDATASET UNSTRUCTURED_GRID\nPOINTS 27 double"
    ));
    mesh.nodes().iter().for_each(|place| out.float(place));
    if offsets {
        out.line("\nCELLS 49 192\nOFFSETS vtktypeint64");
        out.long(&(0..=48).map(|n| 4 * n).collect::<Vec<_>>());
        out.line("\nCONNECTIVITY vtktypeint64");
        mesh.elements().iter().for_each(|nodes| out.long(&nodes.map(u64::from)));
    } else {
        out.line("\nCELLS 48 240");
        for nodes in mesh.elements() {
            out.int(&[4]);
            out.int(nodes);
        }
    }
    out.line("\nCELL_TYPES 48");
    out.int(&[10; 48]);
    out.line("\nCELL_DATA 48\nSCALARS region int 1\nLOOKUP_TABLE default");
    mesh.regions().iter().for_each(|region| out.int(&[*region as u32]));
    out.line("\nPOINT_DATA 27\nVECTORS displacement double");
    out.float(&[0.1; 81]);
    out.line("");
    out.bytes
}

/// Puts the files there that cases name.
pub(crate) fn beside(folder: &Path) {
    for (name, bytes) in [
        ("labels.raw", raw()),
        ("pair.img", raw()),
        ("labels.nrrd", saved(folder, "labels.nrrd")),
        ("block.msh", gmsh22(true)),
        ("block.vtu", vtu(folder)),
        ("texture.nrrd", texture()),
        ("track.igs.mha", sequence(false)),
        ("poses.csv", POSES.into()),
        ("plus.xml", XML.into()),
    ] {
        std::fs::write(folder.join(name), bytes).expect("written");
    }
}

/// A grey JPEG image of 8 x 8 pixels of one level.
fn jpeg() -> Vec<u8> {
    let mut bytes = b"\xff\xd8\xff\xdb\0\x43\0".to_vec();
    bytes.extend([1; 64]);
    bytes.extend(b"\xff\xc0\0\x0b\x08\0\x08\0\x08\x01\x01\x11\0");
    // One code of one bit: no difference of the mean; the end of the block.
    for table in [0x00, 0x10] {
        bytes.extend([0xff, 0xc4, 0, 20, table, 1]);
        bytes.extend([0; 16]);
    }
    bytes.extend(b"\xff\xda\0\x08\x01\x01\0\0\x3f\0\x3f\xff\xd9");
    bytes
}

/// A DICOM file of two frames of 8 x 8 pixels in a transfer syntax, its pixels as they are, by RLE or as JPEG.
pub(crate) fn dicom(syntax: &str) -> Vec<u8> {
    let element = |tag: [u16; 2], kind: &[u8; 2], value: &[u8]| {
        let tag = tag.map(u16::to_le_bytes).concat();
        let length = (value.len() as u16).to_le_bytes();
        [&tag[..], kind, &length, value].concat()
    };
    let long = |tag: [u16; 2], kind: &[u8; 2], length: u32, value: &[u8]| {
        let tag = tag.map(u16::to_le_bytes).concat();
        [&tag[..], kind, &[0; 2], &length.to_le_bytes(), value].concat()
    };
    let item = |value: &[u8]| [&[0xfe, 0xff, 0, 0xe0], &(value.len() as u32).to_le_bytes()[..], value].concat();
    let number = |tag: [u16; 2], number: u16| element(tag, b"US", &number.to_le_bytes());
    let even = |text: &str| format!("{text}{}", if text.len() % 2 == 1 { "\0" } else { "" }).into_bytes();
    let meta = [
        element([2, 2], b"UI", b"1.2.840.10008.5.1.4.1.1.6.1\0"),
        element([2, 3], b"UI", b"2.25"),
        element([2, 0x10], b"UI", &even(syntax)),
    ]
    .concat();
    let mut rle = [1u32, 64].map(u32::to_le_bytes).concat();
    rle.resize(64, 0);
    rle.extend([193, 40]);
    let fragment = match syntax.rsplit('.').next() {
        Some("5") => Some(rle),
        Some("50") => Some(jpeg()),
        _ => None,
    };
    let pixels = match fragment {
        None => long([0x7fe0, 0x10], b"OB", 128, &[40; 128]),
        Some(fragment) => {
            let end = [0xfe, 0xff, 0xdd, 0xe0, 0, 0, 0, 0];
            let items = [item(&[]), item(&fragment), item(&fragment), end.to_vec()].concat();
            long([0x7fe0, 0x10], b"OB", u32::MAX, &items)
        }
    };
    [
        vec![0; 128],
        b"DICM".to_vec(),
        element([2, 0], b"UL", &(meta.len() as u32).to_le_bytes()),
        meta,
        number([0x28, 2], 1),
        element([0x28, 4], b"CS", b"MONOCHROME2 "),
        element([0x28, 8], b"IS", b"2 "),
        number([0x28, 0x10], 8),
        number([0x28, 0x11], 8),
        element([0x28, 0x30], b"DS", b"0.3\\0.3 "),
        number([0x28, 0x100], 8),
        number([0x28, 0x101], 8),
        number([0x28, 0x102], 7),
        number([0x28, 0x103], 0),
        pixels,
    ]
    .concat()
}

/// A picture by its file: grey, coloured, or with a palette.
pub(crate) fn png(palette: bool) -> Vec<u8> {
    let chunk = |kind: &[u8; 4], data: &[u8]| {
        let named = [&kind[..], data].concat();
        let mut check = flate2::Crc::new();
        check.update(&named);
        [
            &(data.len() as u32).to_be_bytes()[..],
            &named,
            &check.sum().to_be_bytes(),
        ]
        .concat()
    };
    let mut packer = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
    let colour = if palette { 3 } else { 0 };
    std::io::Write::write_all(&mut packer, &[0, 1, 2, 3, 4, 0, 2, 1, 4, 3]).expect("memory");
    let parts = [
        chunk(b"IHDR", &[0, 0, 0, 4, 0, 0, 0, 2, 8, colour, 0, 0, 0]),
        chunk(b"PLTE", &[9; 15]),
        chunk(b"IDAT", &packer.finish().expect("memory")),
        chunk(b"IEND", &[]),
    ];
    [&b"\x89PNG\r\n\x1a\n"[..], &parts.concat()].concat()
}

/// A tetrahedron as PLY, its numbers as text or binary.
pub(crate) fn ply(text: bool) -> Vec<u8> {
    let kind = if text { "ascii" } else { "binary_little_endian" };
    let mut bytes = format!(
        "ply\nformat {kind} 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 4\n\
         property list uchar int vertex_indices\nend_header\n"
    )
    .into_bytes();
    for point in [[0.0f32, 0.0, 0.0], [90.0, 0.0, 0.0], [0.0, 80.0, 0.0], [0.0, 0.0, 70.0]] {
        if text {
            bytes.extend(point.map(|x| format!("{x} ")).concat().into_bytes());
            bytes.push(b'\n');
        } else {
            bytes.extend(point.map(f32::to_le_bytes).concat());
        }
    }
    for face in [[0i32, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]] {
        if text {
            bytes.extend(format!("3 {} {} {}\n", face[0], face[1], face[2]).into_bytes());
        } else {
            bytes.push(3);
            bytes.extend(face.map(i32::to_le_bytes).concat());
        }
    }
    bytes
}

pub(crate) const STL: &str = "solid a\n facet normal 0 0 1\n  outer loop\n   vertex 0 0 0\n   vertex 90 0 0\n   vertex 0 80 0\n  endloop\n endfacet\n\
    endsolid a\n";
pub(crate) const OBJ: &str = "v 0 0 0\nv 90 0 0\nv 0 80 0\nv 0 0 70\nf 1 3 2\nf 1 2 4\nf 2/1 3/1 4/1\nf -4 -1 -2\n";
pub(crate) const MODULI: &str =
    "frequency_rad_s,storage_kpa,loss_kpa\n0.1,0.31,0.05\n1,0.39,0.062\n10,0.49,0.078\n100,0.62,0.098\n";
pub(crate) const CREEP: &str =
    "stress_kpa,time_s,strain\n0.05,1,0.1\n0.05,10,0.13\n0.05,100,0.16\n0.2,1,0.38\n0.2,10,0.47\n0.2,100,0.55\n";
pub(crate) const SESSIONS: &str = "group,person,session,m1,m2,m3,m4,m5,m6,m7,m8,m9,m10\na,p,1,1,2,3,4,5,6,7,8,9,10\na,q,1,1.5,2,3,4,5,6,7,8,9,11\n\
    b,r,1,2,2.5,3,4,5,6,7,8,9,10\nb,s,1,2,2,3.5,4,5,6,7,8,9,10\n";

/// Echoes of two frames of two lines of 16 samples.
pub(crate) fn echoes() -> Vec<u8> {
    let head = "ObjectType = Image\nNDims = 3\nDimSize = 16 2 2\nElementSpacing = 0.02 0.3 1\nUltrasoundImageType = RF_REAL\n\
                UltrasoundImageOrientation = FM\nRfSamplingMHz = 40\nRfPitchMm = 0.3\nElementType = MET_SHORT\nElementDataFile = LOCAL\n";
    let samples = (0..64i32).flat_map(|n| ((n * 997 % 251 - 125) as i16).to_le_bytes());
    head.bytes().chain(samples).collect()
}
