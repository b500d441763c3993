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
        ("data file: LIST", "line 6: data file \"LIST\" is not supported"),
        (
            "data file: slice%03d.raw 1 9 1",
            "is not supported; the data must lie in one file",
        ),
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
