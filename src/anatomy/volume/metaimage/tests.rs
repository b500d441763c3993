use super::*;

fn read(more: &str) -> Result<Header, String> {
    let text = format!(
        "ObjectType = Image\nNDims = 3\nDimSize = 2 3   4   \nElementType = MET_SHORT\n{more}\nElementDataFile = LOCAL\n"
    );
    parse(Path::new("folder/test.mha"), text.as_bytes()).map_err(|error| error.to_string())
}

#[test]
fn transform_rows_are_axes() {
    let header = read("TransformMatrix = 0 1 0 1 0 0 0 0 -1\nElementSpacing = 1 2 3\nOffset = 7 8 9").unwrap();
    let world = header.grid().unwrap().index_to_world;
    assert_eq!(world.column(0).xyz(), Vector3::new(0.0, 1.0, 0.0));
    assert_eq!(world.column(1).xyz(), Vector3::new(2.0, 0.0, 0.0));
    assert_eq!(world.column(2).xyz(), Vector3::new(0.0, 0.0, -3.0));
    assert_eq!(world.column(3).xyz(), Vector3::new(7.0, 8.0, 9.0));
    // An asymmetric matrix distinguishes rows from columns.
    let lopsided = read("Rotation = 0 1 0 0 0 1 1 0 0\nElementSize = 1 2 3\nOrigin = 0 0 0").unwrap();
    assert_eq!(lopsided.axes[0].direction, Some(Vector3::new(0.0, 1.0, 0.0)));
}

#[test]
fn spacing_wins_over_size_and_its_absence_is_told() {
    let both = read("ElementSize = 5 5 5\nElementSpacing = 1 2 3").unwrap();
    assert_eq!(both.axes[1].direction, Some(Vector3::new(0.0, 2.0, 0.0)));
    assert_eq!(
        both.warnings,
        [
            "ElementSpacing is 1 x 2 x 3 and ElementSize 5 x 5 x 5: the spacing is used; if organs have a wrong size, mend it"
        ]
    );
    let thick = read("ElementSize = 1 2 5\nElementSpacing = 1 2 3").unwrap();
    assert!(thick.warnings.is_empty(), "slices may be thicker than their distance");
    assert!(read("").unwrap().warnings[0].contains("no spacing"));
}

#[test]
fn every_type_is_known() {
    for (name, element) in [
        ("MET_CHAR", Some(Element::I8)),
        ("MET_UCHAR", Some(Element::U8)),
        ("MET_SHORT", Some(Element::I16)),
        ("MET_USHORT", Some(Element::U16)),
        ("MET_INT", Some(Element::I32)),
        ("MET_UINT", Some(Element::U32)),
        ("MET_LONG", Some(Element::I32)),
        ("MET_ULONG", Some(Element::U32)),
        ("MET_LONG_LONG", Some(Element::I64)),
        ("MET_ULONG_LONG", Some(Element::U64)),
        ("MET_FLOAT", Some(Element::F32)),
        ("MET_DOUBLE", Some(Element::F64)),
        ("MET_OTHER", None),
    ] {
        assert_eq!(
            read(&format!("ElementType = {name}")).unwrap().element,
            element,
            "{name}"
        );
    }
}

#[test]
fn byte_order_compression_and_header_size() {
    let header = read("ElementByteOrderMSB = True\nCompressedData = True\nHeaderSize = -1").unwrap();
    assert_eq!(header.order, ByteOrder::Big);
    assert_eq!(header.data.encoding, Encoding::Zlib);
    assert_eq!(header.data.skip, Skip::AllButTheImage);
    assert_eq!(
        read("BinaryDataByteOrderMSB = False\nHeaderSize = 5")
            .unwrap()
            .data
            .skip,
        Skip::Bytes(5)
    );
}

#[test]
fn broken_tags_name_their_line() {
    for (more, expected) in [
        (
            "ElementSpacing = 1 0 1",
            "line 5: found ElementSpacing \"1 0 1\", expected spacings above 0",
        ),
        ("ElementSpacing = 1 -1 1", "line 5: found ElementSpacing"),
        ("ElementSpacing = 1 nan 1", "line 5: found ElementSpacing"),
        ("ElementSpacing = 1 inf 1", "line 5: found ElementSpacing"),
        ("ElementSpacing = 1 1", "expected 3 numbers"),
        ("DimSize = 2 -3 4", "line 5: found DimSize \"2 -3 4\""),
        ("NDims = 0", "line 5: found NDims \"0\""),
        ("TransformMatrix = 1 0 0 1", "expected 9 numbers"),
        ("ElementType = MET_STRING", "line 5: found ElementType"),
        ("ElementNumberOfChannels = 0", "values of a pixel"),
        ("ElementDataFile = slice%03d.raw 9 1 1", "line 5: found ElementDataFile"),
        ("CompressedData = maybe", "expected True or False"),
        ("HeaderSize = -2", "line 5: found HeaderSize"),
        ("ObjectType = Tube", "only images are read"),
        ("nothing", "line 5: found \"nothing\""),
    ] {
        let message = read(more).map(|_| "loaded").unwrap_err();
        assert!(message.contains(expected), "{message} should hold {expected}");
    }
    let early = parse(Path::new("x"), &b"DimSize = 1 1 1\nNDims = 3\n"[..])
        .map(|_| "loaded")
        .unwrap_err();
    assert!(early.to_string().contains("on a line before it"), "{early}");
    let endless = parse(Path::new("x"), &b"NDims = 3\n"[..])
        .map(|_| "loaded")
        .unwrap_err();
    assert!(endless.to_string().contains("after 1 lines"), "{endless}");
}

#[test]
fn the_stated_orientation_counts_where_there_are_no_directions() {
    let diagonal = |more: &str| {
        let header = read(&format!("ElementSpacing = 1 1 1\n{more}")).unwrap();
        let world = header.grid().unwrap().index_to_world;
        (world.diagonal().xyz(), header.warnings)
    };
    let (lps, quiet) = diagonal("AnatomicalOrientation = RAI");
    assert_eq!((lps, quiet.len()), (Vector3::repeat(1.0), 0));
    let (ras, told) = diagonal("AnatomicalOrientation = LPI");
    assert_eq!(ras, Vector3::new(-1.0, -1.0, 1.0));
    assert!(
        told[0].contains("AnatomicalOrientation") && told[0].contains("LPI"),
        "{told:?}"
    );
    for other in ["???", "RRI", "RA", ""] {
        assert_eq!(
            diagonal(&format!("AnatomicalOrientation = {other}")),
            (Vector3::repeat(1.0), Vec::new()),
            "{other}"
        );
    }
    let (stated, quiet) = diagonal("AnatomicalOrientation = LPI\nTransformMatrix = 1 0 0 0 1 0 0 0 1");
    assert_eq!(
        (stated, quiet.len()),
        (Vector3::repeat(1.0), 0),
        "the matrix comes first"
    );
}

#[test]
fn units_of_distance_become_millimetres() {
    let read = |unit: &str| {
        read(&format!(
            "DistanceUnits = {unit}\nElementSpacing = 1 2 3\nOffset = 7 8 9"
        ))
        .unwrap()
    };
    for (unit, mm) in [("mm", 1.0), ("um", 1e-3), ("cm", 10.0), ("?", 1.0), ("furlong", 1.0)] {
        let header = read(unit);
        let world = header.grid().unwrap().index_to_world;
        assert_eq!((world[(1, 1)], world[(2, 3)]), (2.0 * mm, 9.0 * mm), "{unit}");
        assert_eq!(header.warnings.is_empty(), unit != "furlong");
    }
}

#[test]
fn data_in_several_files_have_their_names() {
    let names = |value: &str| {
        let text = format!("NDims = 1\nDimSize = 4\nElementType = MET_UCHAR\nElementDataFile = {value}\n");
        let parsed = parse(Path::new("folder/test.mhd"), text.as_bytes()).map_err(|error| error.to_string());
        parsed.map(|header| {
            let data = header.data;
            let all = std::iter::once(data.path).chain(data.more);
            all.map(|path| path.display().to_string()).collect::<Vec<_>>()
        })
    };
    assert_eq!(names("LIST\na.raw\nb.raw").unwrap(), ["folder/a.raw", "folder/b.raw"]);
    assert_eq!(names("LIST 2\na.raw").unwrap(), ["folder/a.raw"]);
    assert_eq!(
        names("s%03d.raw 1 3 1").unwrap(),
        ["folder/s001.raw", "folder/s002.raw", "folder/s003.raw"]
    );
    assert_eq!(names("s%02d.raw 1 2").unwrap(), ["folder/s01.raw", "folder/s02.raw"]);
    assert!(names("LIST").unwrap_err().contains("no tag \"ElementDataFile\""));
}
