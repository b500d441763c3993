use super::*;

fn read(fields: &str) -> Result<Header, String> {
    let text = format!("NRRD0004\n{fields}\n\n");
    parse(Path::new("folder/test.nrrd"), text.as_bytes()).map_err(|error| error.to_string())
}

const BASE: &str = "type: uchar\ndimension: 3\nsizes: 2 3 4\nencoding: raw";

fn and(more: &str) -> Result<Header, String> {
    read(&format!("{BASE}\n{more}"))
}

#[test]
fn spaces_turn_to_lps() {
    for (space, diagonal) in [
        ("left-posterior-superior", [1.0, 2.0, 3.0]),
        ("LPS", [1.0, 2.0, 3.0]),
        ("right-anterior-superior", [-1.0, -2.0, 3.0]),
        ("RAS", [-1.0, -2.0, 3.0]),
        ("left-anterior-superior", [1.0, -2.0, 3.0]),
        ("LPI", [1.0, 2.0, -3.0]),
        ("scanner-xyz", [1.0, 2.0, 3.0]),
    ] {
        let header = and(&format!(
            "space: {space}\nspace directions: (1,0,0) (0,2,0) (0,0,3)\nspace origin: (10,20,30)"
        ));
        let world = header.unwrap().grid().unwrap().index_to_world;
        assert_eq!([0, 1, 2].map(|n| world[(n, n)]), diagonal, "{space}");
        let origin = [0, 1, 2].map(|n| world[(n, 3)]);
        assert_eq!(
            origin,
            [0, 1, 2].map(|n| (n as f64 + 1.0) * 10.0 * diagonal[n].signum()),
            "{space}"
        );
    }
}

#[test]
fn a_space_with_time_has_vectors_of_four_numbers() {
    for space in ["left-posterior-superior-time", "LPST"] {
        let vectors = |more: &str| {
            let directions = format!("(1,0,0{more}) (0,2,0{more}) (0,0,3{more})");
            and(&format!(
                "space: {space}\nspace directions: {directions}\nspace origin: (10,20,30{more})"
            ))
        };
        let world = vectors(",0").unwrap().grid().unwrap().index_to_world;
        assert_eq!(
            [0, 1, 2].map(|n| [world[(n, n)], world[(n, 3)]]),
            [[1.0, 10.0], [2.0, 20.0], [3.0, 30.0]]
        );
        let error = vectors("").expect_err(space);
        assert!(error.contains("expected 4"), "{error}");
    }
}

#[test]
fn every_type_spelling_is_known() {
    for (spellings, element) in [
        ("signed char,int8,int8_t", Element::I8),
        ("uchar,unsigned char,uint8,uint8_t", Element::U8),
        (
            "short,short int,signed short,signed short int,int16,int16_t",
            Element::I16,
        ),
        ("ushort,unsigned short,unsigned short int,uint16,uint16_t", Element::U16),
        ("int,signed int,int32,int32_t", Element::I32),
        ("uint,unsigned int,uint32,uint32_t", Element::U32),
        (
            "longlong,long long,long long int,signed long long,signed long long int,int64,int64_t",
            Element::I64,
        ),
        (
            "ulonglong,unsigned long long,unsigned long long int,uint64,uint64_t",
            Element::U64,
        ),
        ("float", Element::F32),
        ("double", Element::F64),
    ] {
        for spelling in spellings.split(',') {
            let fields = format!("type: {spelling}\ndimension: 1\nsizes: 2\nencoding: raw\nendian: big");
            let header = read(&fields).unwrap();
            assert_eq!(
                (header.element, header.order),
                (Some(element), ByteOrder::Big),
                "{spelling}"
            );
        }
    }
}

#[test]
fn broken_fields_name_their_line() {
    for (more, expected) in [
        ("spacings: 1 0 1", "line 6: found spacing 0 of axis 1"),
        ("spacings: 1 -2 1", "line 6: found spacing -2 of axis 1"),
        ("spacings: 1 1 nan", "line 6: found spacing NaN of axis 2"),
        (
            "spacings: 1 1",
            "found 2 entries in \"spacings\", expected one for each of 3 axes",
        ),
        ("spacings: a b c", "line 6: found spacings \"a b c\""),
        ("sizes: 2 -3 4", "line 6: found sizes \"2 -3 4\""),
        ("sizes: 2 99999999999999999999999 4", "line 6: found sizes"),
        ("space directions: (1,0,0) (0,1,0) 5", "line 6: found space directions"),
        (
            "space: LPS\nspace directions: (1,0) (0,1) (1,1)",
            "found a vector of 2 numbers, expected 3",
        ),
        (
            "space origin: none",
            "line 6: found space origin \"none\", expected one vector",
        ),
        ("space: up-down-over", "line 6: found space \"up-down-over\""),
        ("encoding: hex", "line 6: encoding \"hex\" is not supported"),
        ("encoding: lzma", "line 6: found encoding \"lzma\""),
        ("type: string", "line 6: found type \"string\""),
        ("type: short", "no field \"endian\""),
        ("byte skip: -2", "line 6: found byte skip \"-2\""),
        ("line skip: -1", "line 6: found line skip \"-1\""),
        ("no separator here", "line 6: found \"no separator here\""),
        ("dimension: 0", "line 6: found dimension \"0\""),
    ] {
        let message = and(more).map(|_| "loaded").unwrap_err();
        assert!(message.contains(expected), "{message} should hold {expected}");
    }
    let message = read("dimension: 3\nsizes: 1 1 1\nencoding: raw")
        .map(|_| "loaded")
        .unwrap_err();
    assert!(message.contains("no field \"type\""), "{message}");
    let magic = parse(Path::new("x"), &b"NRRD0009\n"[..]).map(|_| "loaded").unwrap_err();
    assert!(magic.to_string().contains("line 1: found \"NRRD0009\""), "{magic}");
}

#[test]
fn key_values_keep_colons_and_resolve_escapes() {
    let header = and("a: b:=c\nSegment0_Tags:=x:y|z: w\nnote:=one\\ntwo\\\\").unwrap();
    let expected = [("Segment0_Tags", "x:y|z: w"), ("note", "one\ntwo\\")];
    assert_eq!(
        header.key_values,
        expected.map(|(key, value)| (key.to_owned(), value.to_owned()))
    );
    assert!(
        header
            .warnings
            .iter()
            .any(|warning| warning.contains("unknown field \"a\""))
    );
}

#[test]
fn detached_data_lie_beside_the_header() {
    let header = and("data file: parts/data.raw\nbyte skip: -1\nline skip: 2").unwrap();
    assert_eq!(header.data.path, Path::new("folder/parts/data.raw"));
    assert_eq!((header.data.start, header.data.skip_lines), (0, 2));
    assert_eq!(header.data.skip, Skip::AllButTheImage);
    let text = format!("NRRD0004\n{BASE}\n");
    let missing = parse(Path::new("test.nhdr"), text.as_bytes())
        .map(|_| "loaded")
        .unwrap_err();
    assert!(missing.to_string().contains("no field \"data file\""), "{missing}");
}

#[test]
fn lists_have_no_direction_and_units_scale() {
    let list = and("kinds: domain domain list\nspacings: 1 2 nan").unwrap();
    assert_eq!(list.axes[2].direction, None);
    let metres =
        and("space dimension: 3\nspace units: \"m\" \"m\" \"m\"\nspace directions: (0.001,0,0) (0,0.002,0) (0,0,1)");
    let step = metres.unwrap().axes[1].direction.unwrap();
    assert_eq!(step, Vector3::new(0.0, 2.0, 0.0));
}

fn world(more: &str) -> nalgebra::Matrix4<f64> {
    and(more).unwrap().grid().unwrap().index_to_world
}

#[test]
fn units_of_the_space_are_those_of_its_axes() {
    let directions = "space: RAS\nspace directions: (1,0,0) (0,2,0) (0,0,3)\nspace origin: (10,20,30)";
    for units in [
        "\"microns\" \"microns\" \"microns\"",
        "\"um\"",
        "micrometers micrometers micrometers",
    ] {
        let world = world(&format!("{directions}\nspace units: {units}"));
        assert!(
            (world
                - nalgebra::Matrix4::new(
                    -1e-3, 0.0, 0.0, -1e-2, 0.0, -2e-3, 0.0, -2e-2, 0.0, 0.0, 3e-3, 3e-2, 0.0, 0.0, 0.0, 1.0,
                ))
            .norm()
                < 1e-12,
            "{units}: {world}"
        );
    }
    let mixed = world(&format!("{directions}\nspace units: \"mm\" \"cm\" \"m\""));
    assert_eq!(mixed.diagonal().as_slice(), [-1.0, -20.0, 3000.0, 1.0]);
    assert_eq!(mixed.column(3).xyz().as_slice(), [-10.0, -200.0, 30_000.0]);
    let header = and(&format!("{directions}\nspace units: \"mm\" \"furlong\" \"furlong\"")).unwrap();
    assert_eq!(header.warnings, ["line 9: space units \"furlong\" taken as mm"]);
}

#[test]
fn spacings_have_the_units_of_their_axes() {
    let world = world("spacings: 1 2 3\nunits: \"cm\" \"mm\" \"um\"");
    assert_eq!(world.diagonal().as_slice(), [10.0, 2.0, 3e-3, 1.0]);
    let header = read("type: uchar\ndimension: 4\nsizes: 5 2 3 4\nencoding: raw\nunits: \"s\" \"mm\" \"mm\" \"mm\"\nkinds: time domain domain domain\nspace: LPS\nspacings: nan 1 1 1").unwrap();
    assert!(header.warnings.is_empty(), "{:?}", header.warnings);
    assert!(
        and("spacings: 1 2 3\nunits: \"s\" \"mm\" \"mm\"").unwrap().warnings[0].contains("units \"s\" taken as mm")
    );
}

#[test]
fn ends_of_axes_place_an_image_without_directions() {
    // Cells of 2, 3 and 4 mm, and then nodes.
    let cells = world("axis mins: 10 20 30\naxis maxs: 14 29 46");
    assert_eq!(cells.diagonal().as_slice(), [2.0, 3.0, 4.0, 1.0]);
    assert_eq!(cells.column(3).xyz().as_slice(), [11.0, 21.5, 32.0]);
    let nodes =
        world("axis mins: 10 20 30\naxis maxs: 14 29 46\ncenterings: node node cell\nunits: \"cm\" \"mm\" \"mm\"");
    assert_eq!(nodes.diagonal().as_slice(), [40.0, 4.5, 4.0, 1.0]);
    assert_eq!(nodes.column(3).xyz().as_slice(), [100.0, 20.0, 32.0]);
    let backwards = world("axis mins: 10 20 30\naxis maxs: 6 29 46");
    assert_eq!((backwards[(0, 0)], backwards[(0, 3)]), (-2.0, 9.0));
    let spaced = world("spacings: 1 2 nan\naxis mins: 10 nan 30\naxis maxs: nan nan 46");
    assert_eq!(spaced.diagonal().as_slice(), [1.0, 2.0, 4.0, 1.0]);
    assert_eq!(spaced.column(3).xyz().as_slice(), [10.5, 0.0, 32.0]);
    assert!(
        and("axis mins: 10 20 30\naxis maxs: 14 29 46")
            .unwrap()
            .warnings
            .is_empty()
    );
    let directed = world("space: LPS\nspace directions: (1,0,0) (0,1,0) (0,0,1)\naxis mins: 10 20 30");
    assert_eq!(directed.column(3).xyz().norm(), 0.0, "directions come first");
}

#[test]
fn a_space_without_directions_is_questioned() {
    assert!(and("space: RAS\nspacings: 1 1 1").unwrap().warnings[0].contains("no space directions"));
    assert!(and("space: LPS\nspacings: 1 1 1").unwrap().warnings.is_empty());
}

#[test]
fn data_in_several_files_have_their_names() {
    let names = |more: &str| {
        let data = and(more).unwrap().data;
        let all: Vec<String> = std::iter::once(&data.path)
            .chain(&data.more)
            .map(|path| path.display().to_string())
            .collect();
        (all, data.named)
    };
    let expected = ["folder/a.raw", "folder/b c.raw"].map(str::to_owned).to_vec();
    assert_eq!(
        names("data file: LIST\na.raw\nb c.raw"),
        (expected.clone(), Some(At::Line(6)))
    );
    assert_eq!(names("data file: LIST 3\na.raw\n\nb c.raw").0, expected);
    assert_eq!(
        names("data file: part%03d.raw 8 12 2").0,
        ["folder/part008.raw", "folder/part010.raw", "folder/part012.raw"]
    );
    assert_eq!(
        names("data file: part%d.raw 1 0 -1 3").0,
        ["folder/part1.raw", "folder/part0.raw"]
    );
    assert_eq!(names("data file: 50% done.raw").0, ["folder/50% done.raw"]);
    for (more, expected) in [
        (
            "data file: part%d.raw",
            "line 6: found data file \"part%d.raw\", expected a pattern with first number",
        ),
        ("data file: part%d.raw 0 9 -1", "expected a pattern"),
        ("data file: part%d.raw 0 9 0", "expected a pattern"),
        ("data file: part%d.raw 0 99999 1", "expected at most 65536 data files"),
        ("data file: LIST", "no field \"data file\""),
    ] {
        let message = and(more).map(|_| "read").expect_err(more);
        assert!(message.contains(expected), "{message}");
    }
}

#[test]
fn lines_of_metaimage_are_told_and_change_nothing() {
    let plain =
        "space: LPS\nspace directions: (7,0,0) (0,7,0) (0,0,7)\nspace origin: (-1,-2,-3)\nkinds: domain domain domain";
    let header = and(plain).unwrap();
    let mixed = and(&format!(
        "{plain}\nAnatomicalOrientation: LPI\nCenterOfRotation: 0 0 0\nTransformMatrix: 0 1 0 1 0 0 0 0 1"
    ))
    .unwrap();
    assert_eq!(
        mixed.grid().unwrap().index_to_world,
        header.grid().unwrap().index_to_world
    );
    assert_eq!(mixed.warnings.len(), header.warnings.len() + 3, "{:?}", mixed.warnings);
    let last = mixed.warnings.last().unwrap();
    assert!(
        last.contains("line 12: unknown field \"transformmatrix\" ignored"),
        "{last}"
    );
}

#[test]
fn spacings_alone_and_spacings_beside_directions_are_told() {
    let warnings = |more: &str| and(more).expect(more).warnings;
    assert_eq!(
        warnings("spacings: 2 2 3"),
        ["no space and no directions in the file: placed by its spacings alone, taken as LPS"]
    );
    let directions = "space: LPS\nspace directions: (4,0,0) (0,4,0) (0,0,5)";
    assert_eq!(
        warnings(&format!("{directions}\nspacings: 1 1 1")),
        [
            "line 8: the space directions have steps of 4.00 x 4.00 x 5.00 mm, and spacings says 1.00 x 1.00 x 1.00 mm: the \
             directions are used; if organs have a wrong size, mend them"
        ]
    );
    // Near misses: a space, the same steps, spacings that are not known, and a picture.
    for more in [
        "space: LPS\nspacings: 2 2 3".to_owned(),
        format!("{directions}\nspacings: 4 4.001 5"),
        format!("{directions}\nspacings: nan nan nan"),
    ] {
        assert!(warnings(&more).is_empty(), "{more}: {:?}", warnings(&more));
    }
    let picture = read("type: uchar\ndimension: 2\nsizes: 2 3\nencoding: raw\nspacings: 1 2").expect("a picture");
    assert!(picture.warnings.is_empty(), "{:?}", picture.warnings);
}
