use std::collections::BTreeMap;
use std::path::Path;

use insonify::Blame;
use insonify_mesh::TetMesh;
use insonify_mesh::file::{MeshFile, ReadOptions, SurfaceFile, read_mesh, read_mesh_bytes};

use crate::broken::largest_of;
use crate::data;

/// The same mesh of a liver, a kidney and a gallbladder, in every format.
const THREE_ORGANS: [&str; 7] = [
    "meshes/DERIVED_s0328_3organ_tet.vtu",
    "formats/DERIVED_s0328_3organ_tet_vtk9_appended.vtu",
    "meshes/DERIVED_s0328_3organ_tet_v42_ascii.vtk",
    "meshes/DERIVED_s0328_3organ_tet_v51_bin.vtk",
    "meshes/DERIVED_s0328_3organ_tet_v22_bin.msh",
    "meshes/DERIVED_s0328_3organ_tet_v22_ascii.msh",
    "meshes/DERIVED_s0328_3organ_tet_v41_ascii.msh",
];

fn load(name: &str) -> Option<MeshFile> {
    let path = data(name)?;
    Some(read_mesh(&path, &ReadOptions::default()).unwrap_or_else(|error| panic!("{error}")))
}

/// Elements and volume (ml) of each region.
fn regions(mesh: &TetMesh) -> BTreeMap<i32, (usize, f64)> {
    let mut regions = BTreeMap::new();
    for (region, volume) in mesh.regions().iter().zip(mesh.volumes(mesh.nodes())) {
        let (elements, sum) = regions.entry(*region).or_insert((0, 0.0));
        *elements += 1;
        *sum += volume / 1000.0;
    }
    regions
}

/// The mesh in the corners' own coordinates, which does not depend on how nodes are numbered.
fn corners(mesh: &TetMesh) -> Vec<f64> {
    let nodes = mesh.nodes();
    let corners = mesh.elements().as_flattened().iter();
    corners.flat_map(|node| nodes[*node as usize]).collect()
}

#[test]
fn the_three_organs_are_the_same_in_every_format() {
    let mut first: Option<MeshFile> = None;
    for name in THREE_ORGANS {
        let Some(file) = load(name) else { return };
        let mesh = &file.mesh;
        assert_eq!((mesh.nodes().len(), mesh.elements().len()), (5430, 21727), "{name}");
        assert_eq!((file.skipped_cells, file.warnings.len()), (0, 0), "{name}");
        assert!(mesh.volumes(mesh.nodes()).all(|volume| volume > 0.0), "{name}");
        let regions = regions(mesh);
        let elements: Vec<_> = regions
            .iter()
            .map(|(region, (elements, _))| (*region, *elements))
            .collect();
        assert_eq!(elements, [(2, 4196), (4, 2600), (5, 14931)], "{name}");
        // The list of the data gives the whole to a hundredth.
        let whole: f64 = regions.values().map(|(_, volume)| volume).sum();
        assert!((whole - 2263.96).abs() < 0.005, "{name}: {whole} ml");
        if name.ends_with(".msh") {
            let names: Vec<_> = file.region_names.iter().map(|(n, name)| (*n, name.as_str())).collect();
            assert_eq!(names, [(2, "kidney_right"), (4, "gallbladder"), (5, "liver")], "{name}");
        }
        let Some(first) = &first else {
            first = Some(file);
            continue;
        };
        // Gmsh prints 16 digits, which may be off by one in the last: 1e-15 of coordinates below 400 mm.
        let (found, expected) = (corners(mesh), corners(&first.mesh));
        let off = found.iter().zip(&expected).map(|(a, b)| (a - b).abs());
        let off = off.fold(0.0, f64::max);
        assert!(off < 400.0 * 1e-15, "{name}: {off} mm");
        assert_eq!(mesh.regions(), first.mesh.regions(), "{name}");
        assert_eq!(mesh.neighbours(), first.mesh.neighbours(), "{name}");
    }
}

/// The mesh in Gmsh's 4.1 binary, a volume for each region in the order of the elements.
fn gmsh_binary(file: &MeshFile) -> Vec<u8> {
    let mesh = &file.mesh;
    let volumes: Vec<(i32, usize)> = mesh
        .regions()
        .chunk_by(|a, b| a == b)
        .map(|all| (all[0], all.len()))
        .collect();
    let mut out = b"$MeshFormat\n4.1 1 8\n\x01\x00\x00\x00\n$EndMeshFormat\n$PhysicalNames\n".to_vec();
    out.extend(format!("{}\n", file.region_names.len()).bytes());
    for (region, name) in &file.region_names {
        out.extend(format!("3 {region} \"{name}\"\n").bytes());
    }
    fn ints(out: &mut Vec<u8>, all: &[i32]) {
        out.extend(all.iter().flat_map(|n| n.to_le_bytes()));
    }
    fn sizes(out: &mut Vec<u8>, all: &[u64]) {
        out.extend(all.iter().flat_map(|n| n.to_le_bytes()));
    }
    out.extend(b"$EndPhysicalNames\n$Entities\n");
    sizes(&mut out, &[0, 0, 0, volumes.len() as u64]);
    for (place, (region, _)) in volumes.iter().enumerate() {
        ints(&mut out, &[place as i32 + 1]);
        out.extend(mesh.bounds().as_flattened().iter().flat_map(|x| x.to_le_bytes()));
        sizes(&mut out, &[1]);
        ints(&mut out, &[*region]);
        sizes(&mut out, &[0]);
    }
    out.extend(b"\n$EndEntities\n$Nodes\n");
    let nodes = mesh.nodes().len() as u64;
    sizes(&mut out, &[1, nodes, 1, nodes]);
    ints(&mut out, &[3, 1, 0]);
    sizes(&mut out, &[nodes]);
    sizes(&mut out, &(1..=nodes).collect::<Vec<_>>());
    out.extend(mesh.nodes().as_flattened().iter().flat_map(|x| x.to_le_bytes()));
    out.extend(b"\n$EndNodes\n$Elements\n");
    let elements = mesh.elements().len() as u64;
    sizes(&mut out, &[volumes.len() as u64, elements, 1, elements]);
    let mut tag = 0;
    for (place, (_, count)) in volumes.iter().enumerate() {
        ints(&mut out, &[3, place as i32 + 1, 4]);
        sizes(&mut out, &[*count as u64]);
        for _ in 0..*count {
            let corners = mesh.elements()[tag].map(|node| u64::from(node) + 1);
            tag += 1;
            sizes(&mut out, &[tag as u64]);
            sizes(&mut out, &corners);
        }
    }
    out.extend(b"\n$EndElements\n");
    out
}

#[test]
fn the_three_organs_are_the_same_in_binary_of_gmsh_4_1() {
    let Some(file) = load("meshes/DERIVED_s0328_3organ_tet_v41_ascii.msh") else {
        return;
    };
    let again = read_mesh_bytes(&gmsh_binary(&file), Path::new("x.msh"), &ReadOptions::default()).unwrap();
    assert_eq!(again, file);
}

#[test]
fn the_sphere_has_its_nodes_and_tetrahedra() {
    let Some(file) = load("meshes/fenris_sphere_tet4_593.msh") else {
        return;
    };
    let mesh = &file.mesh;
    assert_eq!((mesh.nodes().len(), mesh.elements().len()), (183, 593));
    assert!(file.skipped_cells > 0 && mesh.regions().iter().all(|region| *region == 1));
    // A ball of radius 0.5 holds its inscribed polyhedron.
    let volume: f64 = mesh.volumes(mesh.nodes()).sum();
    let ball = std::f64::consts::PI / 6.0;
    assert!(volume < ball && volume > 0.9 * ball, "{volume}");
}

#[test]
fn surfaces_are_refused() {
    for name in ["meshes/plus_needle_20cm.vtk", "meshes/aigt_NeedleModel.vtk"] {
        let Some(path) = data(name) else { return };
        let error = read_mesh(&path, &ReadOptions::default()).unwrap_err().to_string();
        assert!(
            error.contains("POLYDATA") && error.contains("UNSTRUCTURED_GRID"),
            "{error}"
        );
    }
    for name in ["meshes/DERIVED_s0328_liver.stl", "meshes/DERIVED_s0328_liver.obj"] {
        let Some(path) = data(name) else { return };
        let error = read_mesh(&path, &ReadOptions::default()).unwrap_err();
        let words = error.to_string();
        assert!(
            words.contains(" surface; expected VTK") && words.contains("mesh make") && !error.is_machine(),
            "{words}"
        );
    }
}

/// Every file cut short and with bytes changed, at many places: an error or a mesh, and no more memory than it fills.
#[test]
fn damaged_real_meshes_never_panic() {
    // A number of two characters becomes eight bytes, in a vector that may double; twice that for what goes with it.
    // Zlib may truly unpack to more, but not in these files.
    const PER_BYTE: usize = 16;
    for name in THREE_ORGANS.into_iter().chain(["meshes/fenris_sphere_tet4_593.msh"]) {
        let Some(path) = data(name) else { return };
        let sound = std::fs::read(&path).unwrap();
        let read = |bytes: &[u8]| {
            let largest = largest_of(|| drop(read_mesh_bytes(bytes, &path, &ReadOptions::default())));
            let allowed = PER_BYTE * sound.len();
            assert!(largest <= allowed, "{name}: {largest} bytes, {allowed} allowed");
        };
        read(&sound);
        for step in 0..24 {
            // Steps of the golden ratio, so that places do not line up with records.
            let place = (sound.len() as f64 * (f64::from(step) * 0.618_033_988_749_895).fract()) as usize;
            let step = step as usize;
            read(&sound[..place]);
            let mut bytes = sound.clone();
            bytes[place..]
                .iter_mut()
                .take(1 + step % 9)
                .for_each(|byte| *byte ^= 0xff >> (step % 8));
            read(&bytes);
            // Where the numbers are that say how much follows.
            let mut bytes = sound.clone();
            bytes[place % 2000] = [b'9', 0xff, 0x7f][step % 3];
            read(&bytes);
        }
    }
}

#[test]
fn surfaces_have_their_points_triangles_and_axes() {
    for (name, points, triangles, is_ras) in [
        ("DERIVED_s0328_liver.stl", 1500, 3000, None),
        ("DERIVED_s0328_liver.obj", 1500, 3000, None),
        ("plus_VesselModel_Reference.stl", 48, 92, None),
        ("plus_GelBlockModel_Reference.stl", 8, 12, None),
        // 44 polygons of 240 corners, 1107 of 3408.
        ("plus_needle_20cm.vtk", 160, 240 - 2 * 44, None),
        ("aigt_NeedleModel.vtk", 651, 3408 - 2 * 1107, Some(true)),
    ] {
        let Some(path) = data(&format!("meshes/{name}")) else {
            return;
        };
        let surface = SurfaceFile::read(&path).unwrap_or_else(|error| panic!("{error}"));
        let found = (surface.points.len(), surface.triangles.len(), surface.is_ras);
        assert_eq!(found, (points, triangles, is_ras), "{name}");
    }
    // The outside of tetrahedra in three regions.
    let Some(path) = data("meshes/DERIVED_s0328_3organ_tet.vtu") else {
        return;
    };
    let file = read_mesh(&path, &ReadOptions::default()).unwrap();
    let outside = file.mesh.surface().count();
    assert_eq!(SurfaceFile::read(&path).unwrap().triangles.len(), outside);
}

#[test]
fn displacements_are_finite() {
    let vtk = |x: &str| {
        format!(
            "# vtk DataFile Version 3.0\nx\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 float\n0 0 0 10 0 0 0 10 0 0 0 10\n\
             CELLS 1 5\n4 0 1 2 3\nCELL_TYPES 1\n10\nPOINT_DATA 4\nVECTORS displacement float\n0 0 0 0 {x} 0 0 0 0 0 0 0\n"
        )
    };
    let read = |x: &str| read_mesh_bytes(vtk(x).as_bytes(), Path::new("a.vtk"), &ReadOptions::default());
    assert!(read("0.5").is_ok());
    for bad in ["nan", "inf", "1e7"] {
        let error = read(bad).expect_err(bad).to_string();
        assert!(
            error.contains("displacement of node 1") && error.contains("a.vtk"),
            "{error}"
        );
    }
}
