//! PNG files, 8 bits for pictures and 16 for ground-truth layers, and their numbered names.

use std::io::{self, Write};
use std::path::{Path, PathBuf};

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder, ImageError};

use super::{OutputError, atomic, numbered};

/// Compression of a PNG file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Compression {
    /// Deflate at its usual level, for single files.
    Usual,
    /// The compressor of the crate `fdeflate`, for folders of frames: about 20 times as fast; grey frames are 5 %
    /// larger, layers 1.2 to 3 times as large.
    Fast,
}

/// Writes a grey picture, one byte per pixel, row by row. The write is atomic.
pub fn write_grey(path: &Path, width: usize, height: usize, pixels: &[u8]) -> Result<(), OutputError> {
    write_grey_with(Compression::Usual, path, [width, height], pixels)
}

/// As [`write_grey`], with the compression of choice.
pub fn write_grey_with(
    compression: Compression,
    path: &Path,
    size: [usize; 2],
    pixels: &[u8],
) -> Result<(), OutputError> {
    write(compression, path, size, pixels, ExtendedColorType::L8)
}

/// Writes a colour picture, three bytes (sRGB) per pixel, row by row. The write is atomic.
pub fn write_rgb(path: &Path, width: usize, height: usize, pixels: &[u8]) -> Result<(), OutputError> {
    write(
        Compression::Usual,
        path,
        [width, height],
        pixels,
        ExtendedColorType::Rgb8,
    )
}

/// Writes a layer of 16-bit numbers, row by row. The write is atomic.
pub fn write_grey16(
    compression: Compression,
    path: &Path,
    size: [usize; 2],
    pixels: &[u16],
) -> Result<(), OutputError> {
    write(
        compression,
        path,
        size,
        bytemuck::cast_slice(pixels),
        ExtendedColorType::L16,
    )
}

fn write(
    compression: Compression,
    path: &Path,
    [width, height]: [usize; 2],
    pixels: &[u8],
    colour: ExtendedColorType,
) -> Result<(), OutputError> {
    let channels = usize::from(colour.bits_per_pixel() / 8);
    let expected = width.checked_mul(height).and_then(|n| n.checked_mul(channels));
    let size = (u32::try_from(width), u32::try_from(height));
    let ((Ok(columns @ 1..), Ok(rows @ 1..)), true) = (size, expected == Some(pixels.len())) else {
        let text = format!(
            "{} bytes of pixels for {width}x{height} pixels of {channels} bytes each; the size must be at least 1x1",
            pixels.len()
        );
        return Err(OutputError::contents(path, text));
    };
    let compression = match compression {
        Compression::Usual => CompressionType::Default,
        Compression::Fast => CompressionType::Fast,
    };
    atomic::write(path, |file| {
        PngEncoder::new_with_quality(&mut *file, compression, FilterType::Adaptive)
            .write_image(pixels, columns, rows, colour)
            .map_err(|error| match error {
                ImageError::IoError(error) => error,
                other => io::Error::other(other),
            })?;
        file.flush()
    })
}

/// Path of frame `frame` of `total` in a numbered folder: `frame_0000.png`, with as many digits as the last one has, at
/// least 4.
pub fn frame_path(folder: &Path, frame: usize, total: usize) -> PathBuf {
    folder.join(format!("frame_{}.png", numbered(frame, total)))
}

/// Path of a layer of a file: beside it, with the layer's name before the extension: `frame_0000_depth.png`.
pub fn layer_path(file: &Path, layer: &str) -> PathBuf {
    let stem = Path::new(file.file_stem().unwrap_or_default());
    // Sequences of PLUS end in .igs.mha.
    let mut name = if stem.extension().is_some_and(|inner| inner.eq_ignore_ascii_case("igs")) {
        layer_path(stem, layer).into_os_string()
    } else {
        [stem.as_os_str(), "_".as_ref(), layer.as_ref()].into_iter().collect()
    };
    name.push(".");
    name.push(file.extension().unwrap_or("png".as_ref()));
    file.with_file_name(name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::blame::Blame;

    #[test]
    fn pixels_read_back_as_written() {
        let folder = tempfile::tempdir().expect("folder");
        let grey: Vec<u8> = (0..35).map(|i| i * 7).collect();
        let path = frame_path(folder.path(), 3, 5);
        write_grey(&path, 7, 5, &grey).expect("written");
        let image = image::open(&path).expect("png").into_luma8();
        assert_eq!((image.dimensions(), image.into_raw()), ((7, 5), grey.clone()));
        let rgb = &grey[..30];
        let path = layer_path(&path, "depth");
        assert!(path.ends_with("frame_0003_depth.png"));
        assert_eq!(
            layer_path("a/b.igs.mha".as_ref(), "depth"),
            Path::new("a/b_depth.igs.mha")
        );
        write_rgb(&path, 5, 2, rgb).expect("written");
        let image = image::open(&path).expect("png").into_rgb8();
        assert_eq!((image.dimensions(), image.into_raw()), ((5, 2), rgb.to_vec()));
    }

    #[test]
    fn sixteen_bits_read_back_as_written() {
        let folder = tempfile::tempdir().expect("folder");
        let values: Vec<u16> = (0..12).map(|i| i * 5461 + 3).collect();
        let path = folder.path().join("depth.png");
        for compression in [Compression::Usual, Compression::Fast] {
            write_grey16(compression, &path, [4, 3], &values).expect("written");
            let image = image::open(&path).expect("png");
            let image = image.as_luma16().expect("16 bits");
            assert_eq!((image.dimensions(), image.as_raw()), ((4, 3), &values));
            assert!(write_grey16(compression, &path, [4, 4], &values).is_err());
        }
    }

    #[test]
    fn the_same_pixels_make_the_same_bytes() {
        let folder = tempfile::tempdir().expect("folder");
        let pixels: Vec<u8> = (0..64 * 64).map(|i| (i % 251) as u8).collect();
        for compression in [Compression::Usual, Compression::Fast] {
            let bytes = ["a.png", "b.png"].map(|name| {
                let path = folder.path().join(name);
                write_grey_with(compression, &path, [64, 64], &pixels).expect("written");
                let image = image::open(&path).expect("png").into_luma8();
                assert_eq!(image.as_raw(), &pixels);
                std::fs::read(path).expect("read")
            });
            assert_eq!(bytes[0], bytes[1]);
        }
    }

    #[test]
    fn pixels_that_do_not_fill_the_size_leave_no_file() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("a.png");
        for (width, height, count) in [(3, 3, 8), (0, 5, 0), (usize::MAX, 2, 4), (5, 0, 0)] {
            let error = write_grey(&path, width, height, &vec![0; count]).expect_err("wrong size");
            assert!(
                matches!(error, OutputError::Contents { .. }) && !error.is_machine(),
                "{error}"
            );
        }
        assert_eq!(std::fs::read_dir(folder.path()).expect("folder").count(), 0);
    }

    #[test]
    fn a_place_that_does_not_exist_is_named() {
        let error = write_grey(Path::new("/proc/none/a.png"), 1, 1, &[0]).expect_err("unwritable");
        assert!(
            !error.is_machine() && error.to_string().contains("/proc/none/a.png"),
            "{error}"
        );
    }

    #[test]
    fn frames_sort_by_name() {
        let name = |frame, of| frame_path(Path::new("out"), frame, of).display().to_string();
        assert_eq!(
            [name(0, 1), name(9_999, 10_000)],
            ["out/frame_0000.png", "out/frame_9999.png"]
        );
        assert_eq!(
            [name(7, 10_001), name(10_000, 10_001)],
            ["out/frame_00007.png", "out/frame_10000.png"]
        );
    }
}
