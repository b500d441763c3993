use std::io::Write;

use super::*;

/// An indexed PNG file of 2 x 1 pixels, with this palette and these sizes in its header.
fn indexed(palette: &[u8], sizes: [u32; 2]) -> Vec<u8> {
    let chunk = |kind: &[u8; 4], data: &[u8]| {
        let named = [&kind[..], data].concat();
        let mut check = flate2::Crc::new();
        check.update(&named);
        let length = (data.len() as u32).to_be_bytes();
        [&length[..], &named, &check.sum().to_be_bytes()].concat()
    };
    let mut packer = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
    packer.write_all(&[0, 1, 200]).unwrap();
    let header = [&sizes[0].to_be_bytes()[..], &sizes[1].to_be_bytes(), &[8, 3, 0, 0, 0]].concat();
    let parts = [
        chunk(b"IHDR", &header),
        chunk(b"PLTE", palette),
        chunk(b"IDAT", &packer.finish().unwrap()),
        chunk(b"IEND", &[]),
    ];
    [&b"\x89PNG\r\n\x1a\n"[..], &parts.concat()].concat()
}

#[test]
fn palettes_and_sizes_of_png_files_are_checked_before_they_are_decoded() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("us.png");
    let read = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        picture(&path).map_err(|error| error.to_string())
    };
    // An index beyond a palette of three colours is black.
    let picture = read(&indexed(&[9; 9], [2, 1])).unwrap();
    assert_eq!((picture.width, picture.height, picture.grey), (2, 1, vec![9.0, 0.0]));
    for (bytes, says) in [
        (indexed(&[9; 760], [2, 1]), "a palette of 760 bytes"),
        (indexed(&[9; 771], [2, 1]), "a palette of 771 bytes"),
        (indexed(&[], [2, 1]), "a palette of 0 bytes"),
        (indexed(&[9; 9], [8192, 8192]), "67108864 bytes from"),
        (
            indexed(&[9; 9], [u32::MAX; 2]),
            "a picture of 18446744065119617025 bytes",
        ),
        (b"\x89PNG\r\n\x1a\n".to_vec(), "PNG"),
    ] {
        let error = read(&bytes).unwrap_err();
        assert!(error.contains(says) && error.contains("us.png"), "{error}");
    }
}

/// A ramp across and down, coloured in its first columns, as JPEG.
fn jpeg() -> Vec<u8> {
    let ramp = image::RgbImage::from_fn(64, 48, |x, y| {
        image::Rgb(if x < 8 { [250, 60, 0] } else { [(x + 2 * y) as u8; 3] })
    });
    let mut bytes = Cursor::new(Vec::new());
    ramp.write_to(&mut bytes, ImageFormat::Jpeg).unwrap();
    bytes.into_inner()
}

#[test]
fn jpeg_files_are_read_by_their_bytes_and_refused_where_they_are_cut() {
    let folder = tempfile::tempdir().unwrap();
    let read = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        read(&[path], 1, Some(0.2)).map_err(|error| error.to_string())
    };
    let whole = jpeg();
    for name in ["a.jpg", "a.JPEG", "a.png"] {
        let picture = &read(name, &whole).unwrap()[0];
        assert_eq!((picture.width, picture.height, picture.mm), (64, 48, Some([0.2; 2])));
        for (x, y) in [(20, 5), (40, 30), (60, 47)] {
            let error = picture.grey[y * 64 + x] - (x + 2 * y) as f64;
            assert!(error.abs() < 5.0, "{x}, {y}: {error}");
        }
        assert!(picture.overlay[64 * 20 + 2] && !picture.overlay[64 * 20 + 40]);
    }
    let sizes_at = whole.windows(2).position(|pair| pair == [0xff, 0xc0]).unwrap() + 5;
    let huge = [&whole[..sizes_at], &[0x1f; 4], &whole[sizes_at + 4..]].concat();
    for (bytes, says) in [
        (&whole[..whole.len() * 3 / 4], "a JPEG image that is cut off"),
        (&whole[..20], "a JPEG image without sizes"),
        (&huge, "bytes from"),
    ] {
        let error = read("us.jpg", bytes).unwrap_err();
        assert!(error.contains(says) && error.contains("us.jpg"), "{error}");
    }
}

#[test]
fn other_files_are_named_with_a_converter_and_without_their_bytes() {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes, says) in [
        ("a.gif", &b"GIF89a\x01\x02\xff"[..], "a picture (GIF)"),
        ("a.tif", b"II*\0\x08\xfe\xff", "a picture (TIFF)"),
        ("a.mp4", b"\0\0\0\x20ftypisom\xff\xfe", "a video"),
        ("a.jp2", b"\0\0\0\x0cjP  \r\n\x87\n", "a file of no known kind"),
        ("a", b"\xff\xd8\xff\xe0\0\x10JFIF", "a picture (JPEG)"),
    ] {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        let error = read(&[path], 1, None).unwrap_err().to_string();
        assert!(
            error.contains(says) && error.contains(".jpg") && error.contains("magick"),
            "{error}"
        );
        assert!(
            !error.contains('\u{fffd}') && !error.contains("JFIF") && !error.contains("label"),
            "{error}"
        );
    }
}

#[test]
fn groups_are_sub_folders_several_folders_or_names_without_their_number() {
    let root = tempfile::tempdir().unwrap();
    let save = |name: &str| {
        let path = root.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        image::GrayImage::new(2, 2).save(path).unwrap();
    };
    for name in [
        "flat/liver_01.png",
        "flat/Liver 2.png",
        "flat/heart_a4c (1).jpg",
        "flat/003.png",
        "flat/clip/x.png",
        "tree/Kidney/a.png",
        "tree/lung/a_1.png",
        "tree/lung/b.png",
    ] {
        save(name);
    }
    let groups = |paths: &[&str]| -> Vec<String> {
        let paths: Vec<PathBuf> = paths.iter().map(|path| root.path().join(path)).collect();
        let pictures = read(&paths, 1, None).unwrap();
        pictures.into_iter().map(|picture| picture.group).collect()
    };
    assert_eq!(groups(&["flat"]), ["flat", "liver", "heart_a4c", "liver"]);
    assert_eq!(groups(&["tree"]), ["kidney", "lung", "lung"]);
    assert_eq!(groups(&["tree/lung"]), ["a", "b"]);
    assert_eq!(
        groups(&["tree/lung", "tree/Kidney", "flat/003.png"]),
        ["lung", "lung", "kidney", "flat"]
    );
}
