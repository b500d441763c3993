//! Files that are no files, that never end, or that unpack to far more than they say.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

use insonify::input::scenario::ScenarioFile;
use insonify::{Blame, Error};
use insonify_anatomy::volume;
use insonify_imaging::scene::SceneFile;
use insonify_mesh::file::{ReadOptions, read_mesh, read_mesh_bytes};
use insonify_study::beam_case::points;
use insonify_tracking::plus::PlusConfig;
use insonify_tracking::sequence::Sequence;
use insonify_tracking::trajectory::{Interpolation, Trajectory};

use crate::broken::largest_of;

/// What each reader says of a file: its words, and whether it blames the machine.
fn words(path: &Path) -> Vec<(String, bool)> {
    let said = |error: Error| (error.to_string(), error.exit_status() != 2);
    let trajectory = Trajectory::from_csv(path, Default::default(), Interpolation::default()).unwrap_err();
    let calibration = PlusConfig::read(path).unwrap_err();
    vec![
        said(volume::load(path).unwrap_err().into()),
        said(volume::load_scalar(path).unwrap_err().into()),
        said(Sequence::read(path).unwrap_err().into()),
        said(read_mesh(path, &ReadOptions::default()).unwrap_err().into()),
        said(SceneFile::read(path).unwrap_err().into()),
        said(ScenarioFile::read(path).unwrap_err().into()),
        said(points::read(path).unwrap_err().into()),
        (trajectory.to_string(), trajectory.is_machine()),
        (calibration.to_string(), calibration.is_machine()),
    ]
}

#[test]
fn pipes_devices_folders_and_loops_are_refused_by_every_reader() {
    let folder = tempfile::tempdir().unwrap();
    let pipe = folder.path().join("pipe");
    assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let looped = folder.path().join("loop");
    std::os::unix::fs::symlink(&looped, &looped).unwrap();
    for (path, says) in [
        (PathBuf::from("/dev/zero"), "found a device"),
        (pipe, "found a pipe"),
        (folder.path().to_owned(), "found a folder"),
        (looped, "found a loop of symbolic links"),
        (folder.path().join("none"), "No such file"),
    ] {
        for (reader, (error, machine)) in words(&path).into_iter().enumerate() {
            assert!(error.contains(says) && !machine, "reader {reader}: {error}");
            assert!(error.contains(path.to_str().unwrap()), "reader {reader}: {error}");
        }
    }
}

#[test]
fn what_is_read_whole_is_limited() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("huge");
    // Sparse: the file takes no room.
    std::fs::File::create(&path).unwrap().set_len(5 << 30).unwrap();
    for (error, machine) in words(&path) {
        let limited = error.contains("found 5368709120 bytes or more; expected a") && error.contains("of at most");
        let image = error.contains("expected the start of a NIfTI, NRRD");
        assert!((limited || image) && !machine, "{error}");
    }
}

/// A header whose data are elsewhere.
fn detached(skip: &str, data: &str) -> String {
    format!(
        "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 4 4\nspacings: 1 1 1\nencoding: raw\n{skip}data file: {data}\n"
    )
}

#[test]
fn data_files_are_named_with_the_line_of_the_header_and_their_lines_are_not_skipped_for_ever() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.nhdr");
    let long = folder.path().join("long");
    std::fs::File::create(&long).unwrap().set_len(1 << 30).unwrap();
    for (skip, data, says) in [
        ("", "none.raw", "a.nhdr, line 7: the data file"),
        ("", "none.raw", "none.raw cannot be read: No such file"),
        (
            "line skip: 1\n",
            "/dev/zero",
            "line 8: the data file /dev/zero cannot be read: found a device",
        ),
        (
            "line skip: 1\n",
            "long",
            "found more than 268435456 bytes in the 1 lines to skip",
        ),
    ] {
        std::fs::write(&path, detached(skip, data)).unwrap();
        let error = volume::load(&path).unwrap_err();
        assert!(error.to_string().contains(says) && !error.is_machine(), "{error}");
    }
    let path = folder.path().join("a.mhd");
    std::fs::write(
        &path,
        "NDims = 3\nDimSize = 2 2 2\nElementSpacing = 1 1 1\nElementType = MET_UCHAR\nElementDataFile = b\n",
    )
    .unwrap();
    let error = volume::load(&path).unwrap_err().to_string();
    assert!(error.contains("a.mhd, line 5: the data file"), "{error}");
}

#[test]
fn numbers_in_text_stand_anywhere_and_are_no_longer_than_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.nrrd");
    let load = |data: &str| {
        let header = "NRRD0004\ntype: short\ndimension: 3\nsizes: 2 2 1\nspacings: 1 1 1\nencoding: ascii\n\n";
        std::fs::write(&path, format!("{header}{data}")).unwrap();
        volume::load(&path)
    };
    assert_eq!(load(" 1,\t0\n\n0 , 300").unwrap().volume.voxels(), [1, 0, 0, 2]);
    for (data, says) in [
        (
            "1 2 3 ".to_owned() + &" ".repeat(9),
            "the end of the data after 6 bytes, expected 8 bytes",
        ),
        (
            "1 2 x 4".to_owned(),
            "byte 84: found \"x\", expected a number of type int16",
        ),
        (
            "1 2 3 ".to_owned() + &"0".repeat(3000),
            "expected a number of type int16",
        ),
    ] {
        let error = load(&data).unwrap_err().to_string();
        assert!(error.contains(says), "{error}");
    }
}

/// Zeros, packed by gzip.
fn packed_zeros(bytes: usize) -> Vec<u8> {
    let mut packer = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::best());
    packer.write_all(&vec![0; bytes]).unwrap();
    packer.finish().unwrap()
}

#[test]
fn labels_are_made_while_data_are_unpacked() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("wide.nrrd");
    let header =
        "NRRD0004\ntype: double\nendian: little\ndimension: 3\nsizes: 128 128 64\nspacings: 1 1 1\nencoding: gzip\n\n";
    let voxels = 128 * 128 * 64;
    std::fs::write(&path, [header.as_bytes(), &packed_zeros(8 * voxels)].concat()).unwrap();
    let largest = largest_of(|| assert!(volume::load(&path).is_ok()));
    assert_eq!(largest, voxels, "one byte a voxel, and nothing that is larger");
}

/// A grid of one tetrahedron with arrays that share one packed block.
fn bomb(arrays: &str, data: &[u8]) -> Vec<u8> {
    let head = format!(
        "<VTKFile type=\"UnstructuredGrid\" byte_order=\"LittleEndian\" header_type=\"UInt64\" \
         compressor=\"vtkZLibDataCompressor\"><UnstructuredGrid><Piece NumberOfPoints=\"4\" NumberOfCells=\"1\">{arrays}<Points>\
         <DataArray type=\"Float64\" NumberOfComponents=\"3\" format=\"ascii\">0 0 0 1 0 0 0 1 0 0 0 1</DataArray></Points><Cells>\
         <DataArray type=\"Int32\" Name=\"connectivity\" format=\"ascii\">0 1 2 3</DataArray>\
         <DataArray type=\"Int32\" Name=\"offsets\" format=\"ascii\">4</DataArray>\
         <DataArray type=\"UInt8\" Name=\"types\" format=\"ascii\">10</DataArray></Cells></Piece></UnstructuredGrid>\
         <AppendedData encoding=\"raw\">_"
    );
    [head.as_bytes(), data].concat()
}

#[test]
fn arrays_of_a_mesh_are_unpacked_only_where_they_are_wanted_and_fit() {
    const UNPACKED: usize = 64 << 20;
    let mut packer = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::best());
    packer.write_all(&vec![0; UNPACKED]).unwrap();
    let block = packer.finish().unwrap();
    assert!(block.len() < 70_000);
    let words = [1, UNPACKED as u64, 0, block.len() as u64];
    let data = [words.map(u64::to_le_bytes).concat(), block].concat();
    let array = |name: &str| format!("<DataArray type=\"UInt8\" Name=\"{name}\" format=\"appended\" offset=\"0\"/>");
    let read = |arrays: &str| {
        let bytes = bomb(arrays, &data);
        let mut result = None;
        let largest =
            largest_of(|| result = Some(read_mesh_bytes(&bytes, Path::new("bomb.vtu"), &ReadOptions::default())));
        assert!(largest < 1 << 20, "{largest} bytes at once");
        result.unwrap()
    };
    let many: String = (0..12).map(|n| array(&format!("a{n}"))).collect();
    assert!(
        read(&format!("<PointData>{many}</PointData>")).is_ok(),
        "they are not looked at"
    );
    for (arrays, says) in [
        (
            format!("<PointData>{}</PointData>", array("displacement")),
            "in `displacement`; expected 4 values",
        ),
        (
            format!("<CellData>{}</CellData>", array("region").repeat(9)),
            "in `region`; expected 1 values",
        ),
    ] {
        let error = read(&arrays).unwrap_err().to_string();
        assert!(
            error.contains("found 67108864 bytes (1 a value)") && error.contains(says),
            "{error}"
        );
    }
}
