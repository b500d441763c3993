use super::*;

fn sample() -> Vec<u8> {
    let mut bytes = vec![0u8; EXTENSIONS_START];
    let mut put = |at: usize, data: &[u8]| bytes[at..at + data.len()].copy_from_slice(data);
    put(0, &348i32.to_le_bytes());
    for (n, size) in [3i16, 2, 3, 4].iter().enumerate() {
        put(40 + 2 * n, &size.to_le_bytes());
    }
    put(70, &2i16.to_le_bytes());
    for (n, size) in [1f32, 1.5, 2.0, 2.5].iter().enumerate() {
        put(76 + 4 * n, &size.to_le_bytes());
    }
    put(344, b"n+1\0");
    bytes
}

fn read(bytes: &[u8]) -> Result<Header, String> {
    parse(Path::new("test.nii"), bytes, Encoding::Raw).map_err(|error| error.to_string())
}

fn with(at: usize, data: &[u8]) -> Vec<u8> {
    let mut bytes = sample();
    bytes[at..at + data.len()].copy_from_slice(data);
    bytes
}

#[test]
fn voxel_sizes_alone_give_ras_axes_turned_to_lps() {
    let header = read(&sample()).unwrap();
    let grid = header.grid().unwrap();
    assert_eq!(
        header.warnings,
        ["no sform and no qform: placed by its voxel sizes alone, taken as RAS"]
    );
    assert_eq!(grid.size, [2, 3, 4]);
    assert_eq!(grid.index_to_world.diagonal().as_slice(), [-1.5, -2.0, 2.5, 1.0]);
}

#[test]
fn units_become_millimetres() {
    // Unknown, metres, millimetres, micrometres, and millimetres with seconds.
    for (unit, mm) in [(0u8, 1.0), (1, 1000.0), (2, 1.0), (3, 0.001), (2 | 8, 1.0)] {
        let world = read(&with(123, &[unit])).unwrap().grid().unwrap().index_to_world;
        for (axis, size) in [-1.5, -2.0, 2.5].into_iter().enumerate() {
            let step = world[(axis, axis)];
            assert!((step - size * mm).abs() < 1e-12 * mm, "unit {unit}: {step}");
        }
    }
}

#[test]
fn qform_turns_and_mirrors() {
    let mut bytes = with(252, &1i16.to_le_bytes());
    // Half a turn about z: the quaternion (0, 0, 0, 1); qfac -1 reflects the third axis.
    bytes[264..268].copy_from_slice(&1f32.to_le_bytes());
    bytes[268..272].copy_from_slice(&10f32.to_le_bytes());
    bytes[76..80].copy_from_slice(&(-1f32).to_le_bytes());
    let world = read(&bytes).unwrap().grid().unwrap().index_to_world;
    assert!(
        (world.diagonal() - nalgebra::Vector4::new(1.5, 2.0, -2.5, 1.0)).norm() < 1e-12,
        "{world}"
    );
    assert_eq!(world[(0, 3)], -10.0);
}

#[test]
fn broken_fields_name_their_byte() {
    for (bytes, expected) in [
        (
            with(80, &(-1f32).to_le_bytes()),
            "byte 76: found pixdim [-1.0, 2.0, 2.5]",
        ),
        (with(80, &0f32.to_le_bytes()), "byte 76: found pixdim"),
        (with(80, &f32::NAN.to_le_bytes()), "byte 76: found pixdim [NaN"),
        (with(42, &(-2i16).to_le_bytes()), "byte 40: found dim [3, -2, 3, 4"),
        (with(42, &0i16.to_le_bytes()), "byte 40: found dim [3, 0, 3, 4"),
        (with(40, &0i16.to_le_bytes()), "byte 40: found dim [0,"),
        (with(70, &128i16.to_le_bytes()), "byte 70: datatype 128 (RGB colours)"),
        (with(108, &100f32.to_le_bytes()), "byte 108: found vox_offset 100"),
        (with(108, &f32::NAN.to_le_bytes()), "byte 108: found vox_offset NaN"),
        (
            with(344, b"xxxx"),
            "byte 344: found magic \"xxxx\", expected \"n+1\" or \"ni1\"",
        ),
        (with(344, b"\x01\x02\x03\x04"), "found magic bytes that are no text"),
        (
            with(344, b"\0\0\0\0"),
            "byte 344: an Analyze 7.5 header is not supported",
        ),
        (
            with(0, &540i32.to_le_bytes()),
            "found the end of the file after 352 bytes, expected a NIfTI-2 header of 540 bytes",
        ),
        (
            sample()[..200].to_vec(),
            "byte 200: found the end of the file after 200 bytes",
        ),
    ] {
        let message = read(&bytes).map(|_| "loaded").unwrap_err();
        assert!(message.contains(expected), "{message} should hold {expected}");
    }
}

#[test]
fn slope_of_nan_or_zero_means_none() {
    assert_eq!(read(&with(112, &f32::NAN.to_le_bytes())).unwrap().scale, None);
    assert_eq!(read(&with(112, &0f32.to_le_bytes())).unwrap().scale, None);
    assert_eq!(read(&with(112, &1f32.to_le_bytes())).unwrap().scale, None);
    let scale = read(&with(112, &2f32.to_le_bytes())).unwrap().scale.unwrap();
    assert_eq!(scale.apply(3.0), 6.0);
}

#[test]
fn big_endian_headers_are_read() {
    let mut bytes = sample();
    let mut swap = |at: usize, length: usize| bytes[at..at + length].reverse();
    swap(0, 4);
    (0..4).for_each(|n| swap(40 + 2 * n, 2));
    swap(70, 2);
    (0..4).for_each(|n| swap(76 + 4 * n, 4));
    let header = read(&bytes).unwrap();
    assert_eq!(header.order, ByteOrder::Big);
    assert_eq!(header.sizes(), "2 x 3 x 4");
}

/// A header of NIfTI-2 with the sizes and voxel sizes of [`sample`].
fn sample_2(big: bool) -> Vec<u8> {
    let mut bytes = vec![0u8; 544];
    let mut put = |start: usize, mut number: Vec<u8>| {
        if big {
            number.reverse();
        }
        bytes[start..start + number.len()].copy_from_slice(&number);
    };
    put(0, 540i32.to_le_bytes().to_vec());
    put(12, 2i16.to_le_bytes().to_vec());
    for (index, size) in [3i64, 2, 3, 4].iter().enumerate() {
        put(16 + 8 * index, size.to_le_bytes().to_vec());
    }
    for (index, size) in [1f64, 1.5, 2.0, 2.5].iter().enumerate() {
        put(104 + 8 * index, size.to_le_bytes().to_vec());
    }
    put(168, 544i64.to_le_bytes().to_vec());
    put(348, 2i32.to_le_bytes().to_vec());
    for (row, (step, offset)) in [(1.5f64, 7f64), (2.0, 8.0), (2.5, 9.0)].into_iter().enumerate() {
        put(400 + 32 * row + 8 * row, step.to_le_bytes().to_vec());
        put(400 + 32 * row + 24, offset.to_le_bytes().to_vec());
    }
    put(500, 1i32.to_le_bytes().to_vec());
    bytes[4..12].copy_from_slice(b"n+2\0\r\n\x1a\n");
    bytes
}

#[test]
fn nifti_2_is_read_in_both_byte_orders() {
    for big in [false, true] {
        let header = read(&sample_2(big)).unwrap();
        let grid = header.grid().unwrap();
        assert_eq!((grid.size, header.element), ([2, 3, 4], Some(Element::U8)));
        assert_eq!(
            grid.index_to_world.diagonal().as_slice(),
            [-1500.0, -2000.0, 2500.0, 1.0]
        );
        assert_eq!(
            grid.index_to_world.column(3).xyz().as_slice(),
            [-7000.0, -8000.0, 9000.0]
        );
        assert_eq!(header.data.skip, Skip::Bytes(544));
        assert_eq!(header.order == ByteOrder::Big, big);
    }
    let mut text = sample_2(false);
    text[8] = b' ';
    let message = read(&text).unwrap_err();
    assert!(message.contains("byte 4: found magic"), "{message}");
}

/// A header with voxels of 7 mm and an sform whose steps are the given ones, changed.
fn changed(steps: [f32; 3], change: impl Fn(&mut Vec<u8>)) -> Vec<u8> {
    let mut bytes = with(254, &1i16.to_le_bytes());
    for axis in 0..3 {
        bytes[80 + 4 * axis..][..4].copy_from_slice(&7f32.to_le_bytes());
        bytes[280 + 20 * axis..][..4].copy_from_slice(&steps[axis].to_le_bytes());
    }
    change(&mut bytes);
    bytes
}

/// Warnings about [`changed`].
fn warned(steps: [f32; 3], change: impl Fn(&mut Vec<u8>)) -> Vec<String> {
    read(&changed(steps, change)).unwrap().warnings
}

#[test]
fn an_sform_that_contradicts_the_voxel_sizes_is_told() {
    let told = warned([1.0, 1.0, 2.0], |_| ());
    assert_eq!(
        told,
        [
            "the sform has voxels of 1 x 1 x 2 mm, pixdim says 7 x 7 x 7 mm: the sform is used; if organs have a wrong size, mend the sform"
        ]
    );
    assert!(warned([7.0, 7.0, 6.9], |_| ())[0].contains("7 x 7 x 6.9 mm"));
    // Rounding, an axis of one voxel, and voxel sizes that are not stated.
    assert!(warned([7.05, 7.0, 7.0], |_| ()).is_empty());
    assert!(
        warned([7.0, 7.0, 1.0], |bytes| bytes[46..48]
            .copy_from_slice(&1i16.to_le_bytes()))
        .is_empty()
    );
    assert!(warned([1.0; 3], |bytes| bytes[80..92].fill(0)).is_empty());
}

#[test]
fn a_qform_at_another_place_is_told_from_one_voxel_on() {
    let moved = |x: f32, code: i16| {
        warned([7.0; 3], |bytes| {
            bytes[252..254].copy_from_slice(&code.to_le_bytes());
            bytes[268..272].copy_from_slice(&x.to_le_bytes());
        })
    };
    let told = moved(8.0, 1);
    assert!(
        told.len() == 1
            && told[0].contains("lies at (0, 0, 0) mm by the sform and at (-8, 0, 0) mm by the qform, 8 mm apart"),
        "{told:?}"
    );
    assert!(moved(6.9, 1).is_empty());
    assert!(moved(8.0, 0).is_empty(), "there is no qform");
    // A shear of 0.1 of a step along x for each one along y moves the last corner by 1.4 mm, and more moves it more.
    let sheared = |qform_mm: f32| {
        warned([7.0; 3], |bytes| {
            bytes[252..254].copy_from_slice(&1i16.to_le_bytes());
            bytes[284..288].copy_from_slice(&0.7f32.to_le_bytes());
            bytes[268..272].copy_from_slice(&qform_mm.to_le_bytes());
        })
    };
    assert!(sheared(-6.9).is_empty());
    assert_eq!(sheared(-20.0).len(), 1);
    // Half a turn about z.
    let turned = warned([7.0; 3], |bytes| {
        bytes[252..254].copy_from_slice(&1i16.to_le_bytes());
        bytes[264..268].copy_from_slice(&1f32.to_le_bytes());
    });
    assert!(
        turned[0].contains("voxel (1, 2, ") && turned[0].contains("apart"),
        "{turned:?}"
    );
}

#[test]
fn an_sform_of_directions_alone_takes_the_voxel_sizes() {
    let grid = |steps: [f32; 3], qform_x_mm: f32| {
        let bytes = changed(steps, |bytes| {
            bytes[252..254].copy_from_slice(&1i16.to_le_bytes());
            bytes[268..272].copy_from_slice(&qform_x_mm.to_le_bytes());
        });
        let header = read(&bytes).unwrap();
        (header.grid().unwrap().index_to_world, header.warnings)
    };
    let (world, told) = grid([1.0; 3], 0.0);
    assert_eq!(world.diagonal().xyz().as_slice(), [-7.0, -7.0, 7.0]);
    assert_eq!(
        told,
        [
            "the sform has voxels of 1 x 1 x 1 mm, pixdim says 7 x 7 x 7 mm: the sform has directions alone, and the voxel sizes of \
             pixdim are used"
        ]
    );
    // A qform at another place is still told, and other steps are voxel sizes.
    assert!(grid([1.0; 3], 20.0).1[1].starts_with("sform and qform differ"));
    assert_eq!(
        grid([1.0, 1.0, 2.0], 0.0).0.diagonal().xyz().as_slice(),
        [-1.0, -1.0, 2.0]
    );
}

#[test]
fn slices_and_images_of_two_axes_lie_in_space() {
    // One slice, whose size along the third axis may be 0 or anything, and an image of two axes.
    for (change, step) in [
        (&[(46, 1i16)][..], 2.5),
        (&[(46, 1), (88, 0), (90, 0)], 1.0),
        (&[(40, 2)], 1.0),
        (&[(40, 5), (48, 1), (50, 1)], 2.5),
    ] {
        let mut bytes = sample();
        for (start, value) in change {
            bytes[*start..start + 2].copy_from_slice(&value.to_le_bytes());
        }
        let grid = read(&bytes).unwrap().grid().unwrap();
        assert_eq!(
            grid.index_to_world.diagonal().as_slice(),
            [-1.5, -2.0, step, 1.0],
            "{change:?}"
        );
    }
    // A slice whose sform leaves its own direction empty.
    let mut bytes = changed([7.0, 7.0, 0.0], |_| ());
    bytes[46..48].copy_from_slice(&1i16.to_le_bytes());
    let grid = read(&bytes).unwrap().grid().unwrap();
    assert_eq!(grid.index_to_world.diagonal().as_slice(), [-7.0, -7.0, 1.0, 1.0]);
}

#[test]
fn every_type_is_known_and_others_are_named() {
    for (code, element) in [
        (2, Element::U8),
        (4, Element::I16),
        (8, Element::I32),
        (16, Element::F32),
        (64, Element::F64),
        (256, Element::I8),
        (512, Element::U16),
        (768, Element::U32),
        (1024, Element::I64),
        (1280, Element::U64),
    ] {
        assert_eq!(read(&with(70, &i16::to_le_bytes(code))).unwrap().element, Some(element));
    }
    for (code, name) in [
        (1, "one bit"),
        (32, "complex numbers"),
        (128, "RGB colours"),
        (2304, "RGBA colours"),
    ] {
        let message = read(&with(70, &i16::to_le_bytes(code))).map(drop).unwrap_err();
        assert!(
            message.contains(&format!(
                "datatype {code} ({name}) is not supported; labels are integers"
            )),
            "{message}"
        );
    }
}

#[test]
fn an_sform_that_spans_no_volume_gives_way_to_the_qform() {
    let mut bytes = with(254, &1i16.to_le_bytes());
    for (coded, told) in [(0i16, "the voxel sizes are used"), (1, "the qform is used")] {
        bytes[252..254].copy_from_slice(&coded.to_le_bytes());
        let header = read(&bytes).unwrap();
        assert_eq!(
            header.grid().unwrap().index_to_world.diagonal().as_slice(),
            [-1.5, -2.0, 2.5, 1.0]
        );
        let warning = format!("the sform spans no volume: {told}");
        assert!(header.warnings.contains(&warning), "{:?}", header.warnings);
    }
    // Near miss: an sform that spans one.
    for row in 0..3 {
        let start = 280 + 16 * row + 4 * row;
        bytes[start..start + 4].copy_from_slice(&2f32.to_le_bytes());
    }
    let header = read(&bytes).unwrap();
    assert_eq!(
        header.grid().unwrap().index_to_world.diagonal().as_slice(),
        [-2.0, -2.0, 2.0, 1.0]
    );
    assert!(header.warnings.iter().all(|line| !line.contains("spans no volume")));
}
