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
    let grid = read(&sample()).unwrap().grid().unwrap();
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
        (with(344, b"xxxx"), "byte 344: found magic \"xxxx\""),
        (with(0, &540i32.to_le_bytes()), "byte 0: NIfTI-2 is not supported"),
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
