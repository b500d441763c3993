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
        png(&path).map_err(|error| error.to_string())
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
