use std::collections::BTreeMap;
use std::fmt::Write;

use nalgebra::{Point3, Rotation3};

use super::*;

/// A surface of points and triangles, written as OBJ.
struct Shape(Vec<[f64; 3]>, Vec<[u32; 3]>);

impl Shape {
    /// A box with its middle at the origin.
    fn cuboid(sides: [f64; 3]) -> Self {
        let corner = |n: u32| [0, 1, 2].map(|axis| sides[axis as usize] * (f64::from(n >> axis & 1) - 0.5));
        let faces = [
            [0, 1, 3, 2],
            [4, 6, 7, 5],
            [0, 4, 5, 1],
            [2, 3, 7, 6],
            [0, 2, 6, 4],
            [1, 5, 7, 3],
        ];
        let triangles = faces.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]);
        Shape((0..8).map(corner).collect(), triangles.collect())
    }

    /// A ball of meridians and parallels.
    fn ball(radius: f64) -> Self {
        let (around, rows) = (64u32, 32u32);
        let mut points = vec![[0.0, 0.0, radius], [0.0, 0.0, -radius]];
        let mut triangles = Vec::new();
        let number = |row: u32, column: u32| 2 + (row - 1) * around + column % around;
        for row in 1..rows {
            let polar = std::f64::consts::PI * f64::from(row) / f64::from(rows);
            for column in 0..around {
                let angle = std::f64::consts::TAU * f64::from(column) / f64::from(around);
                points.push([polar.sin() * angle.cos(), polar.sin() * angle.sin(), polar.cos()].map(|x| x * radius));
                if row == 1 {
                    triangles.push([0, number(1, column), number(1, column + 1)]);
                } else {
                    let [a, b, c, d] = [
                        number(row - 1, column),
                        number(row, column),
                        number(row, column + 1),
                        number(row - 1, column + 1),
                    ];
                    triangles.extend([[a, b, c], [a, c, d]]);
                }
            }
        }
        triangles.extend((0..around).map(|column| [1, number(rows - 1, column + 1), number(rows - 1, column)]));
        Shape(points, triangles)
    }

    fn moved(mut self, turn: [f64; 3], by: [f64; 3]) -> Self {
        let rotation = Rotation3::from_euler_angles(turn[0], turn[1], turn[2]);
        for point in &mut self.0 {
            *point = (rotation * Point3::from(*point) + Vector3::from(by)).into();
        }
        self
    }

    /// Volume by the divergence theorem, mm3, and area, mm2.
    fn measures(&self) -> [f64; 2] {
        let [volume, area] = self.1.iter().fold([0.0; 2], |[volume, area], corners| {
            let [a, b, c] = corners.map(|corner| Vector3::from(self.0[corner as usize]));
            [
                volume + a.dot(&b.cross(&c)) / 6.0,
                area + (b - a).cross(&(c - a)).norm() / 2.0,
            ]
        });
        // Triangles may turn either way.
        [volume.abs(), area]
    }

    fn write(&self, path: &Path, title: &str) {
        let mut text = format!("# {title}\n");
        self.0
            .iter()
            .for_each(|[x, y, z]| writeln!(text, "v {x} {y} {z}").unwrap());
        self.1
            .iter()
            .for_each(|[a, b, c]| writeln!(text, "f {} {} {}", a + 1, b + 1, c + 1).unwrap());
        fs::write(path, text).unwrap();
    }
}

fn opened(path: &Path) -> Segmentation {
    super::super::open(path, &Default::default()).unwrap_or_else(|error| panic!("{error}"))
}

/// Volume of each label, mm3, and the mean of its voxels, mm.
fn labels(volume: &LabelVolume) -> BTreeMap<String, (f64, Point3<f64>)> {
    let mut sums = vec![(0.0, Vector3::zeros()); volume.labels().len()];
    let [x, y, _] = volume.size();
    for (voxel, label) in volume.voxels().iter().enumerate() {
        let index = Point3::from([voxel % x, voxel / x % y, voxel / x / y].map(|n| n as f64));
        let (count, sum) = &mut sums[usize::from(*label)];
        *count += 1.0;
        *sum += volume.index_to_world().transform_point(&index).coords;
    }
    let named = volume.labels().iter().zip(sums).skip(1);
    named
        .map(|(label, (count, sum))| {
            (
                label.name.clone().unwrap(),
                (count * volume.voxel_mm3(), Point3::from(sum / count)),
            )
        })
        .collect()
}

/// The count of voxels is off by those that the surface crosses at most, and by far fewer in the mean.
#[test]
fn volumes_and_places_are_those_of_the_surfaces() {
    let folder = tempfile::tempdir().unwrap();
    for (name, shape, centre) in [
        (
            "ball",
            Shape::ball(40.0).moved([0.1, 0.2, 0.3], [5.3, -7.1, 11.9]),
            [5.3, -7.1, 11.9],
        ),
        (
            "slab",
            Shape::cuboid([60.0, 30.0, 90.0]).moved([0.5, -0.4, 0.9], [-3.0, 2.5, 1.0]),
            [-3.0, 2.5, 1.0],
        ),
        ("straight", Shape::cuboid([64.0, 32.0, 16.0]), [0.0; 3]),
    ] {
        let path = folder.path().join(format!("{name}.obj"));
        shape.write(&path, "SPACE=LPS");
        let volume = opened(&path).volume;
        let [expected, area] = shape.measures();
        let (found, middle) = labels(&volume)[name];
        let voxel = volume.spacing_mm()[0];
        let bound = area * voxel * 3f64.sqrt() / 2.0;
        assert!((found - expected).abs() < bound, "{name}: {found} {expected} {bound}");
        assert!((found / expected - 1.0).abs() < 0.01, "{name}: {found} {expected}");
        assert!((middle - Point3::from(centre)).norm() < 0.6 * voxel, "{name}: {middle}");
        assert_eq!(opened(&path).volume.voxels(), volume.voxels());
    }
}

/// Bodies that touch share no voxel and leave none out, whatever the grid.
#[test]
fn halves_make_a_whole() {
    let half = |x: f64| {
        Solid::new(&surface(
            &Shape::cuboid([8.0, 16.0, 16.0]).moved([0.0; 3], [x, 0.0, 0.0]),
        ))
        .unwrap()
    };
    let whole = Solid::new(&surface(&Shape::cuboid([16.0; 3]))).unwrap();
    for (shift, voxel) in [(0.0, 1.0), (0.5, 1.0), (0.123, 0.7), (0.0, 0.8)] {
        let first = Vector3::repeat(-10.0 + shift);
        let voxels = |solid: &Solid| solid.voxels(&first, voxel, [30; 3]);
        let sum: Vec<u8> = voxels(&half(-4.0))
            .iter()
            .zip(voxels(&half(4.0)))
            .map(|(a, b)| a + b)
            .collect();
        assert_eq!(sum, voxels(&whole), "{shift} {voxel}");
    }
}

fn surface(shape: &Shape) -> SurfaceFile {
    SurfaceFile {
        points: shape.0.clone(),
        triangles: shape.1.clone(),
        ..SurfaceFile::default()
    }
}

#[test]
fn a_folder_of_surfaces_is_nested() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, title: &str, shape: Shape| shape.write(&folder.path().join(name), title);
    write("body.obj", "SPACE=LPS", Shape::cuboid([200.0, 150.0, 100.0]));
    write(
        "liver.obj",
        "SPACE=RAS",
        Shape::ball(30.0).moved([0.0; 3], [-40.0, 10.0, 0.0]),
    );
    write("tumour.obj", "", Shape::ball(6.0).moved([0.0; 3], [40.0, -10.0, 5.0]));
    fs::write(folder.path().join("notes.txt"), "no surface").unwrap();
    let segmentation = opened(folder.path());
    let labels = labels(&segmentation.volume);
    assert_eq!(labels.keys().collect::<Vec<_>>(), ["body", "liver", "tumour"]);
    let [ball, small] = [30.0, 6.0].map(|radius| Shape::ball(radius).measures()[0]);
    let expected = [200.0 * 150.0 * 100.0 - ball, ball - small, small];
    for ((name, (found, _)), expected) in labels.iter().zip(expected) {
        assert!((found / expected - 1.0).abs() < 0.05, "{name}: {found} {expected}");
    }
    assert!(
        (labels["liver"].1 - Point3::new(40.0, -10.0, 0.0)).norm() < 1.0,
        "{:?}",
        labels["liver"]
    );
    let note = segmentation
        .notes
        .iter()
        .find(|note| note.contains("3 closed surfaces"))
        .unwrap();
    assert!(
        note.contains("turned from RAS, as they state: liver")
            && note.contains("taken as LPS, as they state no axes: tumour"),
        "{note}"
    );
}

#[test]
fn open_surfaces_and_wrong_units_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("liver.obj");
    let error = |shape: Shape| {
        shape.write(&path, "");
        super::super::open(&path, &Default::default()).unwrap_err().to_string()
    };
    let mut open = Shape::cuboid([40.0, 40.0, 40.0]);
    open.1.pop();
    let open = error(open);
    assert!(
        open.contains("liver.obj") && open.contains("3 of 18 edges lie at a hole, 136.6 mm in all"),
        "{open}"
    );
    let metres = error(Shape::cuboid([0.04, 0.04, 0.3]));
    assert!(metres.contains("in metres it is 300"), "{metres}");
    let mesh = folder.path().join("mesh.vtk");
    let text = "# vtk DataFile Version 4.2\nx\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 float\n0 0 0 90 0 0 0 90 0 0 0 90\nCELLS 1 5\n4 0 1 2 3\nCELL_TYPES 1\n10\n";
    fs::write(&mesh, text).unwrap();
    let mesh = super::super::open(&mesh, &Default::default()).unwrap_err().to_string();
    assert!(
        mesh.contains("a mesh of tetrahedra") && mesh.contains("mesh info"),
        "{mesh}"
    );
    let flat = error(Shape(vec![[0.0; 3], [50.0, 0.0, 0.0], [0.0, 50.0, 0.0]], Vec::new()));
    assert!(flat.contains("no triangle"), "{flat}");
}

/// Organs of a body as surfaces, against their volumes by the divergence theorem.
#[test]
fn organs_of_a_body_have_their_volumes() {
    let folder = tempfile::tempdir().unwrap();
    let mut expected = BTreeMap::new();
    for name in ["liver", "kidney_right", "gallbladder"] {
        let Some(file) = insonify_testing::shared(&format!("meshes/DERIVED_s0328_{name}.stl")) else {
            return;
        };
        fs::copy(&file, folder.path().join(format!("{name}.stl"))).unwrap();
        let surface = SurfaceFile::read(&file).unwrap();
        expected.insert(name.to_owned(), Shape(surface.points, surface.triangles).measures()[0]);
    }
    let segmentation = opened(folder.path());
    let found = labels(&segmentation.volume);
    assert_eq!(found.len(), 3);
    for (name, expected) in expected {
        assert!(
            (found[&name].0 / expected - 1.0).abs() < 0.005,
            "{name}: {} {expected}",
            found[&name].0
        );
    }
    let values: Vec<i64> = segmentation.volume.labels().iter().map(|label| label.value).collect();
    assert_eq!(values, [0, 2, 4, 5], "the classes of TotalSegmentator");
}

#[test]
fn the_grid_may_be_stated() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ball.obj");
    Shape::ball(40.0).write(&path, "SPACE=LPS");
    let open = |path: &Path, mm: f64| super::super::open_on(path, &Default::default(), Some(mm));
    for mm in [2.0, 0.7] {
        let opened = open(&path, mm).unwrap();
        let spacing = opened.volume.spacing_mm();
        assert!(spacing.iter().all(|side| (side - mm).abs() < 1e-9), "{spacing:?}");
        let (ball, _) = labels(&opened.volume)["ball"];
        assert!((ball / Shape::ball(40.0).measures()[0] - 1.0).abs() < 0.02, "{ball}");
        assert!(
            opened.notes[0].contains(&format!("on a grid of {mm} mm")),
            "{:?}",
            opened.notes
        );
        assert!(!opened.notes[0].contains("resolution_mm"));
    }
    assert!(opened(&path).notes[0].contains("`volume.resolution_mm` states another"));
    let error = open(&path, 0.05).unwrap_err();
    assert_eq!(error.key(), Some("resolution_mm"));
    assert!(error.to_string().contains("expected at most 2.6e8"), "{error}");
    // Labels have a grid.
    let labels = folder.path().join("a.nrrd");
    crate::volume::save(&opened(&path).volume, &labels).unwrap();
    let error = open(&labels, 1.0).unwrap_err();
    assert!(
        error.key() == Some("resolution_mm") && error.to_string().contains("a.nrrd"),
        "{error}"
    );
}

#[test]
fn objects_of_one_file_are_labels_of_their_own() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("organs.obj");
    let cubes = |word: &str, side: f64| {
        let (mut text, mut first) = (String::new(), 1);
        for (name, x) in [("liver", 0.0), ("kidney_right", 100.0), ("spleen", 200.0)] {
            text.push_str(&format!("{word} {name}\n"));
            for corner in 0..8 {
                let [dx, y, z] = [0, 1, 2].map(|axis| f64::from(corner >> axis & 1) * side);
                text.push_str(&format!("v {} {y} {z}\n", x + dx));
            }
            for face in [
                [0, 2, 3, 1],
                [4, 5, 7, 6],
                [0, 1, 5, 4],
                [2, 6, 7, 3],
                [0, 4, 6, 2],
                [1, 3, 7, 5],
            ] {
                let corners = face.map(|corner| (corner + first).to_string());
                text.push_str(&format!("f {}\n", corners.join(" ")));
            }
            first += 8;
        }
        text
    };
    let read = |text: String| {
        fs::write(&path, text).unwrap();
        super::super::open_on(&path, &super::super::Naming::default(), Some(4.0)).unwrap()
    };
    for word in ["o", "g"] {
        let read = read(cubes(word, 60.0));
        let names: Vec<_> = read.volume.labels()[1..]
            .iter()
            .filter_map(|label| label.name.clone())
            .collect();
        assert_eq!(names.len(), 3, "{names:?}");
        assert!(
            ["liver", "kidney_right", "spleen"]
                .iter()
                .all(|name| names.contains(&(*name).to_owned()))
        );
        assert!(
            read.notes[0].contains("3 closed surfaces are labels") && read.notes[0].contains("objects of organs"),
            "{:?}",
            read.notes
        );
    }
    // Near misses: parts that are not closed, and one object.
    let open = cubes("o", 60.0).replace("f 10 12 16 14\n", "o lid\nf 10 12 16 14\n");
    let one = cubes("o", 60.0)
        .replacen("o kidney_right\n", "", 1)
        .replacen("o spleen\n", "", 1);
    for text in [open, one] {
        let read = read(text);
        assert_eq!(
            read.volume.labels()[1].name.as_deref(),
            Some("organs"),
            "{:?}",
            read.notes
        );
        assert!(
            read.notes[0].contains("1 closed surface is a label"),
            "{:?}",
            read.notes
        );
    }
}

#[test]
fn surfaces_in_centimetres_are_told_their_unit() {
    let folder = tempfile::tempdir().unwrap();
    let read = |scale: f64| {
        for (name, side) in [("liver", 110.0), ("spleen", 60.0)] {
            let shape = Shape::cuboid([side * scale; 3]);
            shape.write(&folder.path().join(format!("{name}.obj")), "SPACE=LPS");
        }
        super::super::open(folder.path(), &super::super::Naming::default())
            .unwrap()
            .warnings
    };
    let warnings = read(0.1);
    assert!(
        warnings
            .iter()
            .any(|line| line.contains("as if in centimetres: check the unit of the surfaces, which is taken as mm")),
        "{warnings:?}"
    );
    assert!(read(1.0).is_empty(), "{:?}", read(1.0));
    // A body alone has no organs to be compared with.
    let path = folder.path().join("body.stl");
    let told = |side: f64| {
        Shape::cuboid([side, side, side * 0.5]).write(&path, "");
        super::super::open(&path, &Default::default()).unwrap().warnings
    };
    assert!(told(36.0)[0].contains("in centimetres it would be 360 mm") && told(360.0).is_empty());
}

#[test]
fn an_image_of_vtk_is_named_as_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("labels.vtk");
    let text = "# vtk DataFile Version 3.0\nx\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 2 2 2\n";
    fs::write(&path, text).unwrap();
    let refused = super::super::open(&path, &super::super::Naming::default())
        .unwrap_err()
        .to_string();
    assert!(
        refused.contains("an image of VTK") && refused.contains("save it as NRRD"),
        "{refused}"
    );
}
