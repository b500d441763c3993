//! Broken files: random, cut short, with flipped bits, with headers that promise too much.

use std::cell::Cell;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use insonify::Blame;
use insonify_anatomy::volume::{self, Label, LabelVolume};
use insonify_tracking::sequence::Sequence;
use nalgebra::Matrix4;
use tempfile::TempDir;

/// Counts what is allocated at once, to catch parsers that believe a header.
struct Watched;

static LARGEST: AtomicUsize = AtomicUsize::new(0);

thread_local! {
    static LARGEST_HERE: Cell<usize> = const { Cell::new(0) };
}

fn watch(size: usize) {
    LARGEST.fetch_max(size, Ordering::Relaxed);
    // A thread that is ending has no such variable any more.
    let _ = LARGEST_HERE.try_with(|largest| largest.set(largest.get().max(size)));
}

/// What is the largest that this thread allocates at once while `work` runs.
pub(crate) fn largest_of(work: impl FnOnce()) -> usize {
    LARGEST_HERE.set(0);
    work();
    LARGEST_HERE.get()
}

// SAFETY: every call goes unchanged to the system allocator.
#[allow(unsafe_code, reason = "an allocator cannot be watched without implementing one")]
unsafe impl std::alloc::GlobalAlloc for Watched {
    unsafe fn alloc(&self, layout: std::alloc::Layout) -> *mut u8 {
        watch(layout.size());
        unsafe { std::alloc::System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: std::alloc::Layout) -> *mut u8 {
        watch(layout.size());
        unsafe { std::alloc::System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: std::alloc::Layout, size: usize) -> *mut u8 {
        watch(size);
        unsafe { std::alloc::System.realloc(pointer, layout, size) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: std::alloc::Layout) {
        unsafe { std::alloc::System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Watched = Watched;

/// The largest real file here unpacks to 49 MB, in a buffer that may double.
const MAX_AT_ONCE: usize = 256 << 20;

fn small() -> LabelVolume {
    let voxels: Vec<u8> = (0..60).map(|n| (n % 5 % 3) as u8).collect();
    let labels = (0..3u8)
        .map(|index| Label {
            value: i64::from(index) * 300,
            name: (index > 0).then(|| format!("part {index}")),
            voxels: voxels.iter().filter(|&&voxel| voxel == index).count() as u64,
        })
        .collect();
    LabelVolume::new([3, 4, 5], voxels, labels, Matrix4::identity()).unwrap()
}

/// One small sound file of each format, with its bytes.
fn sound(folder: &TempDir) -> Vec<(PathBuf, Vec<u8>)> {
    let mut files: Vec<(PathBuf, Vec<u8>)> = volume::written()
        .map(|written| {
            let path = folder.path().join(format!("a{}", written.ending));
            volume::save(&small(), &path).unwrap();
            let bytes = std::fs::read(&path).unwrap();
            (path, bytes)
        })
        .collect();
    let texts = [
        (
            "text.nrrd",
            "NRRD0004\ntype: short\ndimension: 3\nsizes: 2 2 2\nspacings: 1 1 1\nencoding: ascii\n\n1 2 3 4 5 6 7 8\n",
        ),
        (
            "raw.mha",
            "NDims = 3\nDimSize = 2 2 2\nElementSpacing = 1 1 1\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n12345678",
        ),
    ];
    for (name, text) in texts {
        files.push((folder.path().join(name), text.as_bytes().to_vec()));
    }
    files
}

/// Tries every reader; all that counts is that each returns.
fn try_all(path: &Path, bytes: &[u8]) -> bool {
    std::fs::File::create(path).unwrap().write_all(bytes).unwrap();
    let loaded = volume::load(path);
    if let Err(error) = &loaded {
        assert!(!error.is_machine(), "{error}");
        assert!(error.to_string().len() < 2000, "{error}");
    }
    let _ = volume::load_scalar(path);
    let _ = Sequence::read(path);
    let _ = Sequence::read_poses(path);
    let largest = LARGEST.load(Ordering::Relaxed);
    assert!(largest < MAX_AT_ONCE, "{largest} bytes asked for at once");
    loaded.is_ok()
}

#[test]
fn sound_files_load_and_every_truncation_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    for (path, bytes) in sound(&folder) {
        assert!(try_all(&path, &bytes), "{}", path.display());
        // A text image may lose its last line end.
        let needed = bytes.len() - usize::from(path.ends_with("text.nrrd"));
        for length in 0..needed {
            assert!(
                !try_all(&path, &bytes[..length]),
                "{} cut to {length} bytes loads",
                path.display()
            );
        }
    }
}

#[test]
fn flipped_bits_in_compressed_data_are_found_with_their_place() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.nii.gz", "a.nrrd", "a.mha"] {
        let path = folder.path().join(name);
        volume::save(&small(), &path).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let data = match name {
            "a.nii.gz" => 10,
            "a.nrrd" => bytes.windows(2).position(|w| w == b"\n\n").unwrap() + 2 + 10,
            _ => bytes.windows(6).position(|w| w == b"LOCAL\n").unwrap() + 6 + 2,
        };
        for at in data..bytes.len() {
            for bit in 0..8 {
                let mut flipped = bytes.clone();
                flipped[at] ^= 1 << bit;
                if try_all(&path, &flipped) {
                    // Bits that deflate leaves unused say nothing; the voxels must be right.
                    let loaded = volume::load(&path).unwrap();
                    assert_eq!(loaded.volume.voxels(), small().voxels(), "{name} byte {at} bit {bit}");
                } else {
                    let message = volume::load(&path).unwrap_err().to_string();
                    let told = message.contains("broken compressed data") || message.contains("the end of the data");
                    assert!(told && message.contains("byte "), "{message}");
                }
            }
        }
    }
}

#[test]
fn headers_that_promise_too_much_get_no_memory() {
    let folder = tempfile::tempdir().unwrap();
    let nrrd = |sizes: &str, encoding: &str, data: &str| {
        format!("NRRD0004\ntype: uint8\ndimension: 3\nsizes: {sizes}\nspacings: 1 1 1\nencoding: {encoding}\n\n{data}")
    };
    let mha = |sizes: &str, compressed: &str| {
        format!(
            "NDims = 3\nDimSize = {sizes}\nElementSpacing = 1 1 1\nCompressedData = {compressed}\nElementType = \
             MET_DOUBLE\nElementDataFile = LOCAL\nabc"
        )
    };
    for (name, text, expected) in [
        (
            "a.nrrd",
            nrrd("2000 2000 2000", "raw", "abc"),
            "the end of the data after 3 bytes",
        ),
        (
            "a.nrrd",
            nrrd("2000 2000 2000", "gzip", "abc"),
            "expected 8000000000 bytes",
        ),
        (
            "a.nrrd",
            nrrd("2000 2000 2000", "bzip2", "abc"),
            "broken compressed data",
        ),
        (
            "a.nrrd",
            nrrd("2000 2000 2000", "ascii", "1 2 3"),
            "expected 15999999999 bytes",
        ),
        ("a.nrrd", nrrd("9999999 9999999 9999999", "raw", ""), "at most 16 GiB"),
        (
            "a.nrrd",
            nrrd("9999999999 9999999999 9999999999", "raw", ""),
            "at most 16 GiB",
        ),
        (
            "a.nrrd",
            nrrd("0 2 2", "raw", ""),
            "at least one sample along every axis",
        ),
        (
            "a.mha",
            mha("1000 1000 1000", "False"),
            "the end of the data after 3 bytes",
        ),
        ("a.mha", mha("1000 1000 1000", "True"), "expected 8000000000 bytes"),
        ("a.mha", mha("9999999999 9999999999 2", "True"), "at most 16 GiB"),
    ] {
        let path = folder.path().join(name);
        assert!(!try_all(&path, text.as_bytes()));
        let message = volume::load(&path).unwrap_err().to_string();
        assert!(message.contains(expected), "{message} should hold {expected}");
    }
}

#[test]
fn skips_of_lines_bytes_and_all_but_the_image_find_the_data() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("data.raw"), b"one\ntwo\nxyz\x01\x02\x03").unwrap();
    let nrrd = |skip: &str| {
        format!(
            "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 3 1 1\nspacings: 1 1 1\nencoding: raw\n{skip}\ndata file: data.raw\n"
        )
    };
    let mha = |skip: &str| {
        format!(
            "NDims = 3\nDimSize = 3 1 1\nElementSpacing = 1 1 1\n{skip}\nElementType = MET_UCHAR\nElementDataFile = \
             data.raw\n"
        )
    };
    for (name, text) in [
        ("a.nhdr", nrrd("byte skip: -1")),
        ("b.nhdr", nrrd("byte skip: 11")),
        ("c.nhdr", nrrd("line skip: 2\nbyte skip: 3")),
        ("d.mhd", mha("HeaderSize = -1")),
        ("e.mhd", mha("HeaderSize = 11")),
    ] {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        let loaded = volume::load(&path).unwrap();
        let values: Vec<i64> = loaded.volume.labels().iter().map(|label| label.value).collect();
        assert_eq!(
            (values, loaded.volume.voxels()),
            (vec![0, 1, 2, 3], &[1, 2, 3][..]),
            "{name}"
        );
    }
    let path = folder.path().join("f.nhdr");
    std::fs::write(&path, nrrd("byte skip: 12")).unwrap();
    let message = volume::load(&path).unwrap_err().to_string();
    assert!(
        message.contains("data.raw, byte 14: found the end of the data after 2 bytes"),
        "{message}"
    );
}

#[test]
fn sheared_transforms_load_with_a_warning_and_singular_ones_do_not() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.nrrd");
    let write = |third: &str| {
        let text = format!(
            "NRRD0004\ntype: uint8\ndimension: 3\nspace: RAS\nsizes: 1 1 2\nspace directions: (1,0,0) (0,1,0) \
             {third}\nencoding: raw\n\n12"
        );
        std::fs::write(&path, text).unwrap();
        volume::load(&path)
    };
    let warnings = write("(0,0.5,1)").unwrap().warnings;
    assert!(warnings[0].contains("sheared: 26.57 degrees"), "{warnings:?}");
    assert!(write("(0,0,1)").unwrap().warnings.is_empty());
    for (third, expected) in [
        ("(0,1,0)", "span no volume"),
        ("(0,0,0)", "span no volume"),
        ("(0,0,nan)", "not finite"),
        ("(0,0,inf)", "not finite"),
        ("(0,0,1e30)", "a spacing of 1e30 mm, expected at most 10000 mm"),
    ] {
        let message = write(third).unwrap_err().to_string();
        assert!(message.contains(expected), "{message} should hold {expected}");
    }
}

/// A gzip of one header's worth of zeros a thousandfold: small on disk, large unpacked.
#[test]
fn a_bomb_is_unpacked_no_further_than_its_header_calls_for() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bomb.nrrd");
    let mut bytes = b"NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 2 2\nspacings: 1 1 1\nencoding: gzip\n\n".to_vec();
    let mut packer = flate2::write::GzEncoder::new(&mut bytes, flate2::Compression::best());
    packer.write_all(&vec![1; 64 << 20]).unwrap();
    packer.finish().unwrap();
    assert!(try_all(&path, &bytes));
    let loaded = volume::load(&path).unwrap();
    assert_eq!(loaded.volume.voxels(), [1; 8]);
    assert!(
        loaded
            .warnings
            .iter()
            .any(|warning| warning.contains("the rest is ignored")),
        "{:?}",
        loaded.warnings
    );
}
