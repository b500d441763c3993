//! Loading of image files, with their format detected by content.

use std::path::Path;

use nalgebra::Matrix4;

#[cfg(feature = "dicom")]
use super::dicom;
use super::element::{Sample, with_sample};
use super::error::{At, VolumeError};
use super::header::Header;
use super::{FORMATS, LabelVolume, channels, data, extent, foreign, format, labels};
use insonify_base::note::Notes;

/// A label volume with the warnings of the reader.
#[derive(Clone, Debug)]
pub struct Loaded {
    /// Loaded volume.
    pub volume: LabelVolume,
    /// What was read otherwise than as it stands, one sentence each.
    pub notes: Notes,
    /// Assumptions and warnings, one sentence each.
    pub warnings: Vec<String>,
}

/// A grey volume, used for solid textures.
#[derive(Clone, Debug)]
pub struct ScalarImage {
    /// Number of voxels along each index axis.
    pub size: [usize; 3],
    /// Distance between voxel centres along each index axis, mm.
    pub spacing_mm: [f64; 3],
    /// Transform from voxel index to LPS millimetres.
    pub index_to_world: Matrix4<f64>,
    /// Finite values, x fastest, with the file's own scale applied.
    pub data: Vec<f32>,
}

/// Loads a label volume of any format: see `volume/format.rs`. A two-dimensional image is a volume of one slice, 1 mm
/// thick.
///
/// ```
/// use insonify_anatomy::volume::load;
///
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("liver.nrrd");
/// let header = "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 2 1 1\nspace: left-posterior-superior\n\
///     space directions: (2,0,0) (0,2,0) (0,0,2)\nspace origin: (10,20,30)\nencoding: ascii\n";
/// std::fs::write(&path, format!("{header}\n0 5\n"))?;
/// let loaded = load(&path)?;
/// assert_eq!((loaded.volume.spacing_mm(), loaded.volume.labels()[1].value), ([2.0; 3], 5));
///
/// // One voxel of two.
/// std::fs::write(&path, format!("{header}\n0\n"))?;
/// let error = load(&path).unwrap_err();
/// assert!(error.to_string().contains("liver.nrrd"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
/// # Errors
/// [`VolumeError`] with the file, the place in it, what was found and what was expected: for files that are unreadable,
/// of another format or broken, or hold no labels (fractions, more than 256 distinct values, recordings), or span what
/// no body does.
pub fn load(path: &Path) -> Result<Loaded, VolumeError> {
    #[cfg(feature = "dicom")]
    if dicom::recognises(&foreign::start_of(path)?) {
        return dicom::load(path);
    }
    let header = read_header(path)?;
    refuse_sequence(&header)?;
    let unit = header.unit.clone();
    let is_slice = header.axes.iter().filter(|axis| axis.direction.is_some()).count() == 2;
    let mut loaded = match channels::axis(&header) {
        Some(axis) => channels::volume(header, axis)?,
        None => labels::volume(header).map_err(|error| grey(path, error))?,
    };
    extent::check(&loaded.volume, unit.as_deref()).map_err(|error| error.in_file(path))?;
    if is_slice {
        let told = "the file states no thickness of its only slice: taken as 1 mm";
        loaded.notes.push(told.to_owned());
    }
    Ok(loaded)
}

/// An error if an image is a sequence: a recording of frames, or volumes of 3D Slicer over time.
fn refuse_sequence(header: &Header) -> Result<(), VolumeError> {
    let frames = header.key_values.iter().any(|(key, _)| key.starts_with("Seq_Frame"));
    if frames {
        let instead = "`insonify info` tells what is in it, `[motion.sequence]` of a scene moves the probe by it; labels are a volume";
        return Err(header.unsupported("a recording of tracked frames", instead));
    }
    let kind = header.key_values.iter().find(|(key, _)| key == "UltrasoundImageType");
    if let Some((key, kind)) = kind {
        let found = format!("an ultrasound image ({key} = {kind})");
        let instead =
            "give labels; `insonify realism` and `match` compare frames with it, `insonify rf --bmode` shows echoes";
        return Err(header.unsupported(found, instead));
    }
    let name = header.path.to_string_lossy().to_ascii_lowercase();
    let stem = name.rsplit_once('.').map_or("", |(stem, _)| stem);
    if stem.ends_with(".seq") && header.axes.len() > 3 {
        let found = format!("a sequence of volumes ({})", header.sizes());
        return Err(header.unsupported(found, "save one of them, in 3D Slicer as .seg.nrrd or .nrrd"));
    }
    Ok(())
}

/// Least and largest values of CTs, in Hounsfield units: padding or air, and bone or metal.
const CT_HU: [std::ops::RangeInclusive<f32>; 2] = [-4096.0..=-900.0, 150.0..=40_000.0];

/// The error about an image that is no label volume, which says so if it is a CT.
fn grey(path: &Path, error: VolumeError) -> VolumeError {
    let is_grey = match &error {
        VolumeError::Fractional { .. } => true,
        VolumeError::Volume { cause, .. } => matches!(**cause, VolumeError::TooManyLabels(_)),
        _ => false,
    };
    let Some(image) = is_grey.then(|| load_scalar(path).ok()).flatten() else {
        return error;
    };
    let ends = |(low, high): (f32, f32), &value: &f32| (low.min(value), high.max(value));
    let (low, high) = image.data.iter().fold((f32::MAX, f32::MIN), ends);
    if !(CT_HU[0].contains(&low) && CT_HU[1].contains(&high)) {
        return error;
    }
    let found = format!("a CT ({low} to {high} HU)");
    let expected = "labels: give its segmentation; `--ct`, or `volume.ct` of a scene, takes the CT";
    VolumeError::malformed(path, At::Voxels, found, expected)
}

/// Loads a grey volume from the formats of [`load`], any element type.
///
/// # Errors
/// The errors of [`load`], and for values that are not finite; fractions and any number of distinct values are
/// accepted.
pub fn load_scalar(path: &Path) -> Result<ScalarImage, VolumeError> {
    let mut header = read_header(path)?;
    let grid = header.grid()?;
    let values = numbers(&mut header)?;
    Ok(ScalarImage {
        size: grid.size,
        spacing_mm: [0, 1, 2].map(|axis| grid.index_to_world.fixed_view::<3, 1>(0, axis).norm()),
        index_to_world: grid.index_to_world,
        data: values,
    })
}

/// Reads the numbers of an image, with the file's own scale applied.
pub fn numbers(header: &mut Header) -> Result<Vec<f32>, VolumeError> {
    let (order, scale) = (header.data_order(), header.scale);
    let values = with_sample!(header.element()?, T => {
        let value = |number: &[u8]| {
            let stored = T::decode(number, order).as_f64();
            scale.map_or(stored, |scale| scale.apply(stored)) as f32
        };
        data::read_into(header, T::BYTES, &mut |bytes, values| {
            values.extend(bytes.chunks_exact(T::BYTES).map(value));
            Ok(())
        })
    })?;
    if let Some(voxel) = values.iter().position(|value| !value.is_finite()) {
        let side = |axis: usize| header.axes.get(axis).map_or(1, |axis| axis.size);
        let (x, y) = (side(0), side(1));
        let found = format!(
            "{} at voxel ({}, {}, {})",
            values[voxel],
            voxel % x,
            voxel / x % y,
            voxel / x / y
        );
        return Err(header.malformed(found, "finite grey values"));
    }
    Ok(values)
}

/// Parses the header of an image of any known format.
pub fn read_header(path: &Path) -> Result<Header, VolumeError> {
    if let Some((format, header)) = format::header_beside(path).filter(|(_, header)| header.is_file()) {
        return (format.read_header)(&header);
    }
    let start = foreign::start_of(path)?;
    match FORMATS.iter().find(|format| (format.recognises)(&start)) {
        Some(format) => (format.read_header)(path),
        None => Err(foreign::refusal(path, &start)),
    }
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::io::Write;
    use std::path::PathBuf;

    use super::*;

    const CUBE: &str = "type: uchar\ndimension: 3\nsizes: 2 2 3\nspace: LPS\nspacings: 1 1 1";

    fn refused(path: &Path) -> String {
        load(path).map(drop).expect_err("refused").to_string()
    }

    fn gzipped(bytes: &[u8]) -> Vec<u8> {
        let mut packer = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
        packer.write_all(bytes).unwrap();
        packer.finish().unwrap()
    }

    #[test]
    fn a_slice_without_thickness_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.nrrd");
        let told = |axes: &str| {
            fs::write(
                &path,
                format!("NRRD0004\ntype: uchar\nspace: LPS\nencoding: raw\n{axes}\n\n\u{1}\0\0\u{1}"),
            )
            .unwrap();
            load(&path)
                .unwrap()
                .notes
                .iter()
                .filter(|note| note.contains("no thickness"))
                .count()
        };
        let two = "dimension: 2\nsizes: 2 2\nspace directions: (2,0,0) (0,2,0)";
        let three = "dimension: 3\nsizes: 2 2 1\nspace directions: (2,0,0) (0,2,0) (0,0,5)";
        assert_eq!([told(two), told(three)], [1, 0]);
    }

    #[test]
    fn data_in_several_files_are_one_image() {
        let folder = tempfile::tempdir().unwrap();
        let put = |name: &str, bytes: &[u8]| {
            let path = folder.path().join(name);
            fs::write(&path, bytes).unwrap();
            path
        };
        let header = |encoding: &str, files: &str| {
            put(
                "a.nhdr",
                format!("NRRD0004\n{CUBE}\nencoding: {encoding}\ndata file: {files}\n").as_bytes(),
            )
        };
        let slices = [[1, 0, 0, 1], [0, 2, 2, 0], [3, 3, 0, 0]];
        for (index, slice) in slices.iter().enumerate() {
            put(&format!("s{index}.raw"), slice);
            put(&format!("s{index}.gz"), &gzipped(slice));
            put(
                &format!("s{index}.txt"),
                format!("{slice:?}").replace(['[', ']'], "").as_bytes(),
            );
        }
        for (encoding, files) in [
            ("raw", "s%d.raw 0 2 1"),
            ("raw", "LIST\ns0.raw\ns1.raw\ns2.raw"),
            ("gzip", "s%d.gz 0 2 1 2"),
            ("ascii", "s%d.txt 0 2 1"),
        ] {
            let loaded = load(&header(encoding, files)).unwrap();
            assert_eq!(loaded.volume.voxels(), slices.concat(), "{encoding} {files}");
            assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
        }
        let meta = "NDims = 3\nDimSize = 2 2 3\nElementType = MET_UCHAR\nElementSpacing = 1 1 1\nElementDataFile = s%d.raw 0 2 1\n";
        assert_eq!(
            load(&put("a.mhd", meta.as_bytes())).unwrap().volume.voxels(),
            slices.concat()
        );
        let missing = refused(&header("raw", "s%d.raw 1 3 1"));
        assert!(
            missing.contains("s3.raw cannot be read") && missing.contains("line 8"),
            "{missing}"
        );
        assert!(refused(&header("raw", "s%d.raw 0 4 1")).contains("5 data files for 2 x 2 x 3"));
        put("s1.raw", &[0, 2]);
        let short = refused(&header("raw", "s%d.raw 0 2 1"));
        assert!(
            short.contains("s1.raw") && short.contains("after 2 bytes, expected 4 bytes (a share of 2 x 2 x 3"),
            "{short}"
        );
    }

    #[test]
    fn a_header_and_its_image_are_one_volume_packed_or_not_whichever_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let volume = load(&{
            let mut bytes = format!("NRRD0004\n{CUBE}\nencoding: raw\n\n").into_bytes();
            bytes.extend([0, 1, 1, 0, 0, 2, 2, 0, 3, 3, 3, 3]);
            fs::write(path("a.nrrd"), bytes).unwrap();
            path("a.nrrd")
        });
        let volume = volume.unwrap().volume;
        crate::volume::save(&volume, &path("a.nii")).unwrap();
        let mut header = fs::read(path("a.nii")).unwrap();
        let image = header.split_off(header.len() - volume.voxels().len());
        header.truncate(348);
        header[108..112].fill(0);
        header[344..348].copy_from_slice(b"ni1\0");
        fs::write(path("pair.hdr"), &header).unwrap();
        fs::write(path("pair.img"), &image).unwrap();
        fs::write(path("packed.hdr.gz"), gzipped(&header)).unwrap();
        fs::write(path("packed.img.gz"), gzipped(&image)).unwrap();
        for name in ["pair.hdr", "pair.img", "packed.hdr.gz", "packed.img.gz"] {
            let loaded = load(&path(name)).unwrap();
            assert_eq!(loaded.volume.voxels(), volume.voxels(), "{name}");
            assert_eq!(loaded.volume.index_to_world(), volume.index_to_world(), "{name}");
        }
        // An image alone says what is missing.
        fs::remove_file(path("packed.hdr.gz")).unwrap();
        let message = refused(&path("packed.img.gz"));
        assert!(
            message.contains("packed.img.gz") && message.contains("header"),
            "{message}"
        );
        assert!(!message.contains("\\0"), "{message}");
    }

    #[test]
    fn recordings_and_sequences_are_no_labels() {
        let folder = tempfile::tempdir().unwrap();
        let put = |name: &str, header: &str| -> PathBuf {
            let path = folder.path().join(name);
            let mut bytes = format!("NRRD0004\n{header}\nencoding: raw\n\n").into_bytes();
            bytes.extend([0, 1, 1, 0, 0, 1, 1, 0, 1, 1, 1, 1]);
            fs::write(&path, bytes).unwrap();
            path
        };
        let frames = format!("{CUBE}\nSeq_Frame0000_Timestamp:=1.0");
        assert!(refused(&put("a.nrrd", &frames)).contains("a recording of tracked frames is not supported"));
        let times = "type: uchar\ndimension: 4\nsizes: 2 2 1 3\nkinds: domain domain domain list\nspacings: 1 1 1 nan";
        assert!(refused(&put("a.seq.nrrd", times)).contains("a sequence of volumes (2 x 2 x 1 x 3) is not supported"));
        // The same as masks, and a volume of that name.
        assert_eq!(load(&put("a.seg.nrrd", times)).unwrap().volume.labels().len(), 4);
        load(&put("b.seq.nrrd", CUBE)).unwrap();
    }

    #[test]
    fn a_ct_is_told_from_other_grey_images() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.nrrd");
        let save = |values: &[i16]| {
            let sizes = values.len();
            let mut bytes = format!(
                "NRRD0004\ntype: short\nendian: little\ndimension: 3\nsizes: {sizes} 1 1\nspacings: 1 1 1\nencoding: raw\n\n"
            )
            .into_bytes();
            bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
            fs::write(&path, bytes).unwrap();
            refused(&path)
        };
        let ct: Vec<i16> = (-1000..400).collect();
        assert!(save(&ct).contains("found a CT (-1000 to 399 HU), expected labels: give its segmentation"));
        let mr: Vec<i16> = (0..1400).collect();
        let echoes: Vec<i16> = (-9000..9000).step_by(10).collect();
        for grey in [mr, echoes] {
            assert!(
                save(&grey).contains("is this a grey image, such as a reconstructed volume, rather than a label map?")
            );
        }
    }

    #[test]
    fn labels_over_metres_are_refused_by_their_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.nrrd");
        let mut bytes =
            b"NRRD0004\ntype: uchar\ndimension: 3\nsizes: 2 2 3\nspacings: 4000 4000 4000\nencoding: raw\n\n".to_vec();
        bytes.extend([1; 12]);
        fs::write(&path, bytes).unwrap();
        let message = refused(&path);
        assert!(
            message.contains("a.nrrd: found labels over 8000 x 8000 x 12000 mm"),
            "{message}"
        );
    }
}
