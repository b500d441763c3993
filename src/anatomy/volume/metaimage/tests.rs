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
    assert!(both.warnings.is_empty());
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
        ("ElementNumberOfChannels = 3", "images of one channel"),
        (
            "ElementDataFile = LIST",
            "line 5: ElementDataFile \"LIST\" is not supported",
        ),
        ("ElementDataFile = slice%03d.raw 1 9 1", "the data must lie in one file"),
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
