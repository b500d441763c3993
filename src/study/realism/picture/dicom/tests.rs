use dicom_core::value::{DataSetSequence, PixelFragmentSequence};
use dicom_core::{DataElement, PrimitiveValue, VR};
use dicom_object::FileMetaTableBuilder;

use super::*;

fn put(object: &mut InMemDicomObject, tag: Tag, vr: VR, value: impl Into<PrimitiveValue>) {
    object.put(DataElement::new(tag, vr, value.into()));
}

/// A file of `frames` of 8-bit pixels, 4 columns by 2 rows each.
fn file(kind: &str, frames: &[[u8; 8]], change: impl Fn(&mut InMemDicomObject)) -> Vec<u8> {
    file_in("1.2.840.10008.1.2.1", kind, frames, change)
}

fn file_in(syntax: &str, kind: &str, frames: &[[u8; 8]], change: impl Fn(&mut InMemDicomObject)) -> Vec<u8> {
    let mut object = InMemDicomObject::new_empty();
    for (tag, number) in [
        (tags::ROWS, 2_u16),
        (tags::COLUMNS, 4),
        (tags::SAMPLES_PER_PIXEL, 1),
        (tags::BITS_ALLOCATED, 8),
        (tags::BITS_STORED, 8),
        (tags::HIGH_BIT, 7),
        (tags::PIXEL_REPRESENTATION, 0),
    ] {
        put(&mut object, tag, VR::US, number);
    }
    put(&mut object, tags::PHOTOMETRIC_INTERPRETATION, VR::CS, kind);
    put(&mut object, tags::NUMBER_OF_FRAMES, VR::IS, frames.len().to_string());
    put(&mut object, tags::PIXEL_DATA, VR::OB, frames.concat());
    change(&mut object);
    let meta = FileMetaTableBuilder::new()
        .transfer_syntax(syntax)
        .media_storage_sop_class_uid("1.2.840.10008.5.1.4.1.1.6.1")
        .media_storage_sop_instance_uid("2.25.1");
    let mut bytes = Vec::new();
    let object = object.with_meta(meta).expect("a meta table");
    object.write_all(&mut bytes).expect("memory");
    bytes
}

fn pictures(bytes: &[u8], max_frames: usize) -> Result<Vec<Picture>, VolumeError> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("us.dcm");
    std::fs::write(&path, bytes).expect("a file");
    read(&path, max_frames)
}

fn region(columns: u32, delta_cm: f64, units: u16) -> InMemDicomObject {
    let mut region = InMemDicomObject::new_empty();
    for (tag, number) in [
        (tags::REGION_LOCATION_MIN_X0, 0),
        (tags::REGION_LOCATION_MAX_X1, columns),
        (tags::REGION_LOCATION_MIN_Y0, 0),
        (tags::REGION_LOCATION_MAX_Y1, 2),
    ] {
        put(&mut region, tag, VR::UL, number);
    }
    for tag in [tags::PHYSICAL_UNITS_X_DIRECTION, tags::PHYSICAL_UNITS_Y_DIRECTION] {
        put(&mut region, tag, VR::US, units);
    }
    put(&mut region, tags::PHYSICAL_DELTA_X, VR::FD, delta_cm);
    put(&mut region, tags::PHYSICAL_DELTA_Y, VR::FD, -2.0 * delta_cm);
    region
}

#[test]
fn frames_and_their_neighbours_are_read_with_the_size_of_the_largest_region() {
    let frames = [[1; 8], [2; 8], [0, 50, 100, 150, 200, 250, 255, 3]];
    let bytes = file("MONOCHROME2", &frames, |object| {
        // Seconds (4) across a trace of a Doppler spectrum are no size of pixels.
        let regions = vec![region(2, 0.01, 3), region(3, 0.02, 3), region(4, 0.5, 4)];
        let regions = DataSetSequence::from(regions);
        object.put(DataElement::new(tags::SEQUENCE_OF_ULTRASOUND_REGIONS, VR::SQ, regions));
    });
    let decoded = pictures(&bytes, 2).unwrap();
    assert_eq!(decoded.len(), 2);
    assert_eq!(decoded[0].grey, [1.0; 8]);
    assert_eq!(decoded[0].neighbour.as_deref(), Some(&[2.0; 8][..]));
    assert_eq!(decoded[1].grey, frames[2].map(f64::from));
    assert_eq!(decoded[1].neighbour.as_deref(), Some(&[2.0; 8][..]));
    assert_eq!((decoded[1].width, decoded[1].height), (4, 2));
    let mm = decoded[0].mm.unwrap();
    assert!((mm[0] - 0.2).abs() < 1e-12 && (mm[1] - 0.4).abs() < 1e-12, "{mm:?}");
    assert!(decoded[1].name.ends_with("us.dcm, frame 2") && decoded[1].overlay.is_empty());
}

#[test]
fn palettes_colour_indices() {
    let indices = [0, 1, 2, 3, 4, 5, 6, 255];
    let palette = |data: [PrimitiveValue; 3], bits: u16| {
        move |object: &mut InMemDicomObject| {
            for ([descriptor, plain, _], data) in PALETTES.into_iter().zip(data.clone()) {
                let numbers = PrimitiveValue::U16([7, 1, bits].into_iter().collect());
                put(object, descriptor, VR::US, numbers);
                put(object, plain, VR::OW, data);
            }
        }
    };
    // Indices count from 1, and the last entry holds beyond the end.
    let grey = [10.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0];
    let words: Vec<u16> = [10, 20, 30, 40, 50, 60, 70].map(|level| level << 8 | 7).to_vec();
    let words = PrimitiveValue::U16(words.into());
    let bytes = PrimitiveValue::U8(vec![10, 20, 30, 40, 50, 60, 70, 0].into());
    for (data, bits) in [(words, 16), (bytes.clone(), 8)] {
        let levels = [data.clone(), data.clone(), data];
        let decoded = pictures(&file("PALETTE COLOR", &[indices], palette(levels, bits)), 1).unwrap();
        assert_eq!(decoded[0].grey, grey);
        assert!(!decoded[0].overlay.contains(&true));
    }
    let red = PrimitiveValue::U8(vec![10, 200, 30, 40, 50, 60, 70, 0].into());
    let decoded = pictures(
        &file("PALETTE COLOR", &[indices], palette([red, bytes.clone(), bytes], 8)),
        1,
    )
    .unwrap();
    assert_eq!(decoded[0].overlay.iter().position(|covered| *covered), Some(2));
    let error = pictures(&file("PALETTE COLOR", &[indices], |_| ()), 1)
        .unwrap_err()
        .to_string();
    assert!(error.contains("a colour palette that cannot be read"), "{error}");
}

#[test]
fn colours_and_inverted_grey_levels_are_decoded() {
    let colour = |kind: &str, planar: u16, bytes: [u8; 24]| {
        let bytes = file(kind, &[[0; 8]], |object| {
            put(object, tags::SAMPLES_PER_PIXEL, VR::US, 3_u16);
            put(object, tags::PLANAR_CONFIGURATION, VR::US, planar);
            put(object, tags::PIXEL_DATA, VR::OB, bytes.to_vec());
        });
        pictures(&bytes, 1).unwrap().remove(0)
    };
    let mut by_pixel = [60; 24];
    by_pixel[3..6].copy_from_slice(&[200, 60, 60]);
    let mut by_channel = [60; 24];
    by_channel[1] = 200;
    // Y, Cb and Cr of a red pixel (BT.601), grey elsewhere.
    let mut luminance = [128; 24];
    luminance[..3].copy_from_slice(&[76, 85, 255]);
    for (kind, planar, bytes, expected) in [
        ("RGB", 0, by_pixel, 1),
        ("RGB", 1, by_channel, 1),
        ("YBR_FULL", 0, luminance, 0),
    ] {
        let decoded = colour(kind, planar, bytes);
        let coloured: Vec<usize> = (0..8).filter(|pixel| decoded.overlay[*pixel]).collect();
        assert_eq!(coloured, [expected], "{kind}, {planar}");
    }
    // Luma of the red pixel (Rec. 709).
    assert!((colour("YBR_FULL", 0, luminance).grey[0] - 0.2126 * 254.0).abs() < 1.5);
    let decoded = pictures(&file("MONOCHROME1", &[[0, 1, 2, 3, 4, 5, 254, 255]], |_| ()), 1).unwrap();
    assert_eq!(decoded[0].grey, [255.0, 254.0, 253.0, 252.0, 251.0, 250.0, 1.0, 0.0]);
}

#[test]
fn segments_of_palettes_expand() {
    assert_eq!(
        expanded(&[0, 2, 10, 20, 1, 4, 60, 0], 6),
        Some(vec![10, 20, 30, 40, 50, 60])
    );
    assert_eq!(expanded(&[0, 1, 9, 1, 3, 0], 4), Some(vec![9, 6, 3, 0]));
    for bad in [&[1, 2, 9][..], &[2, 1, 0, 0], &[0, 7, 1], &[0, 1, 5, 1, 9]] {
        assert_eq!(expanded(bad, 6), None, "{bad:?}");
    }
}

#[test]
fn broken_files_are_refused() {
    let bytes_written = file("MONOCHROME2", &[[9; 8]; 3], |_| ());
    for offset in (0..bytes_written.len()).step_by(3) {
        let mut bytes = bytes_written.clone();
        bytes[offset] ^= 0x55;
        let _ = pictures(&bytes, 3);
        let _ = pictures(&bytes_written[..offset], 3);
    }
    let error = pictures(&bytes_written[..140], 1).unwrap_err().to_string();
    assert!(error.contains("expected one that ends in the file"), "{error}");
    let wide = file("MONOCHROME2", &[[9; 8]], |object| {
        put(object, tags::COLUMNS, VR::US, 9000_u16)
    });
    let error = pictures(&wide, 1).unwrap_err().to_string();
    assert!(error.contains("images of 9000 x 2 pixels"), "{error}");
}

/// A file of one packed frame.
fn packed(syntax: &str, fragment: &[u8]) -> Vec<u8> {
    file_in(syntax, "MONOCHROME2", &[[0; 8]], |object| {
        let fragments = PixelFragmentSequence::new(Vec::new(), vec![fragment.to_vec()]);
        object.put(DataElement::new(tags::PIXEL_DATA, VR::OB, fragments));
    })
}

/// A fragment of RLE with one segment.
fn rle(segments: u32, segment: &[u8]) -> Vec<u8> {
    let mut fragment = segments.to_le_bytes().to_vec();
    fragment.extend(64u32.to_le_bytes());
    fragment.resize(64, 0);
    [&fragment, segment].concat()
}

const RLE: &str = "1.2.840.10008.1.2.5";
const JPEG: &str = "1.2.840.10008.1.2.4.50";

#[test]
fn runs_are_unpacked_where_they_fill_the_frame() {
    // Six of one level, then two of their own, and a byte that pads.
    for pad in [&[][..], &[0]] {
        let segment = [&[251, 9, 1, 70, 80][..], pad].concat();
        let decoded = pictures(&packed(RLE, &rle(1, &segment)), 1).unwrap();
        assert_eq!(decoded[0].grey, [9.0, 9.0, 9.0, 9.0, 9.0, 9.0, 70.0, 80.0]);
    }
}

/// A grey JPEG image of 8 x 8 pixels of one level: unit steps, one code of one bit in both tables.
fn jpeg() -> Vec<u8> {
    let table = |kind: u8| [&[0xff, 0xc4, 0, 20, kind, 1][..], &[0; 16]].concat();
    [
        &[0xff, 0xd8, 0xff, 0xdb, 0, 67, 0][..],
        &[1; 64],
        &[0xff, 0xc0, 0, 11, 8, 0, 8, 0, 8, 1, 1, 0x11, 0],
        &table(0),
        &table(0x10),
        &[0xff, 0xda, 0, 8, 1, 1, 0, 0, 63, 0, 0x3f, 0xff, 0xd9],
    ]
    .concat()
}

#[test]
fn jpeg_images_of_the_sizes_of_the_file_are_decoded() {
    let of = |rows: u16| {
        file_in(JPEG, "MONOCHROME2", &[[0; 8]], |object| {
            put(object, tags::ROWS, VR::US, rows);
            put(object, tags::COLUMNS, VR::US, 8_u16);
            let fragments = PixelFragmentSequence::new(Vec::new(), vec![jpeg()]);
            object.put(DataElement::new(tags::PIXEL_DATA, VR::OB, fragments));
        })
    };
    assert_eq!(pictures(&of(8), 1).unwrap()[0].grey, [128.0; 64]);
    let error = pictures(&of(4), 1).unwrap_err().to_string();
    assert!(
        error.contains("a JPEG image of 8 x 8 pixels with 1 samples of 8 bits"),
        "{error}"
    );
}

#[test]
fn what_a_decoder_would_fail_on_is_refused_before_it() {
    let long = rle(1, &[129, 9].repeat(500));
    let frame_of = |rows: u16, columns: u16, samples: u8| {
        let [rows, columns] = [rows, columns].map(u16::to_be_bytes);
        let sizes = [8, rows[0], rows[1], columns[0], columns[1], samples];
        [
            &[0xff, 0xd8, 0xff, 0xe0, 0, 4, 1, 1, 0xff, 0xc0, 0, 11][..],
            &sizes,
            &[1, 0x11, 0],
        ]
        .concat()
    };
    for (bytes, says) in [
        // A count of segments that asks for 15 GB.
        (
            packed(RLE, &rle(0xe0ff_d8ff, &[7; 8])),
            "3774863615 segments of RLE where 1 are needed",
        ),
        (packed(RLE, &[1, 0, 0, 0]), "0 segments of RLE"),
        (packed(RLE, &rle(1, &[251, 9])), "6 bytes in segment 0 for 8 pixels"),
        (packed(RLE, &long), "64000 bytes in segment 0 for 8 pixels"),
        (
            packed(JPEG, &frame_of(60_000, 60_000, 3)),
            "a JPEG image of 60000 x 60000 pixels with 3 samples",
        ),
        (packed(JPEG, &frame_of(3, 4, 1)), "a JPEG image of 4 x 3 pixels"),
        (packed(JPEG, &frame_of(2, 4, 1)[..8]), "a JPEG image without sizes"),
        (packed(JPEG, b"\xff\xd8nothing"), "a JPEG image without sizes"),
        (
            packed("1.2.840.10008.1.2.8.1", b"deflated"),
            "pixels in transfer syntax 1.2.840.10008.1.2.8.1",
        ),
        (
            file("MONOCHROME2", &[[9; 8]], |object| {
                put(object, tags::BITS_STORED, VR::US, 0_u16)
            }),
            "pixels of 0 bits in 8",
        ),
        (
            file("MONOCHROME2", &[[9; 8]], |object| {
                put(object, tags::HIGH_BIT, VR::US, 8_u16)
            }),
            "a highest bit 8 of 8",
        ),
        (
            file("MONOCHROME2", &[[9; 8]], |object| {
                put(object, tags::SAMPLES_PER_PIXEL, VR::US, 2_u16)
            }),
            "2 samples a pixel",
        ),
        (
            file("MONOCHROME2", &[[9; 8]], |object| {
                put(object, tags::NUMBER_OF_FRAMES, VR::IS, "2000000000")
            }),
            "2000000000 frames of 8 bytes, and 8 bytes of pixels",
        ),
    ] {
        let error = pictures(&bytes, 1).unwrap_err().to_string();
        assert!(error.contains(says) && error.contains("us.dcm"), "{error}");
    }
}
