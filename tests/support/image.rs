//! Comparison of grey images; what differs is written where a person can look at it.

use std::path::PathBuf;

use image::GrayImage;

/// Asserts that `actual` lies pixel by pixel within `allowed` (lowest and highest grey level). On failure writes
/// `actual`, `expected` and their difference (amplified) as PNGs.
pub(crate) fn assert_within(
    name: &str,
    [width, height]: [usize; 2],
    actual: &[u8],
    expected: &[u8],
    allowed: &[[u8; 2]],
) {
    assert_eq!(actual.len(), width * height, "{name}");
    let outside: Vec<usize> = (0..actual.len())
        .filter(|&at| !(allowed[at][0]..=allowed[at][1]).contains(&actual[at]))
        .collect();
    let Some(&first) = outside.first() else { return };
    let folder = write(name, [width, height], actual, expected);
    panic!(
        "{name}: {} of {} pixels are out of bounds, the first at column {}, row {}: {}, not {} to {}; see {}",
        outside.len(),
        actual.len(),
        first % width,
        first / width,
        actual[first],
        allowed[first][0],
        allowed[first][1],
        folder.display()
    );
}

/// Asserts equality byte for byte, as [`assert_within`].
pub(crate) fn assert_same(name: &str, size: [usize; 2], actual: &[u8], expected: &[u8]) {
    let allowed: Vec<[u8; 2]> = expected.iter().map(|&grey| [grey; 2]).collect();
    assert_within(name, size, actual, expected, &allowed);
}

fn write(name: &str, [width, height]: [usize; 2], actual: &[u8], expected: &[u8]) -> PathBuf {
    let target = option_env!("CARGO_TARGET_TMPDIR").map_or_else(std::env::temp_dir, PathBuf::from);
    let folder = target.parent().unwrap_or(&target).join("parity-failures");
    std::fs::create_dir_all(&folder).expect("a folder for failed images");
    let difference: Vec<u8> = actual
        .iter()
        .zip(expected)
        .map(|(&a, &b)| a.abs_diff(b).saturating_mul(16))
        .collect();
    for (kind, pixels) in [("actual", actual), ("expected", expected), ("difference", &difference)] {
        let picture =
            GrayImage::from_raw(width as u32, height as u32, pixels.to_vec()).expect("as many bytes as pixels");
        picture
            .save(folder.join(format!("{}-{kind}.png", name.replace([' ', '/'], "_"))))
            .expect("a written PNG");
    }
    folder
}
