//! Tracked ultrasound sequences as PLUS writes them: `.igs.mha`, `.igs.mhd` with `.raw`, `.igs.nrrd`. Each frame has
//! one image and a set of named transforms, under keys such as `Seq_Frame0007_ProbeToTrackerTransform` (Lasso et al.
//! 2014, "PLUS: open-source toolkit for ultrasound-guided intervention systems", and IGSIO's sequence files).

use std::collections::{BTreeMap, VecDeque};
use std::path::Path;

use nalgebra::Matrix4;

use insonify_anatomy::volume::header::Header;
use insonify_anatomy::volume::{VolumeError, read_data, read_header};

mod info;
mod keys;

pub use info::{ImageInfo, SequenceInfo, TimeInfo, TransformInfo};
pub use keys::{Orientation, ends};

/// A transform of one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackedTransform {
    /// Matrix from homogeneous coordinates of the first frame of the name to the second: `ProbeToTracker` takes
    /// probe coordinates to tracker coordinates. Lengths in mm.
    pub matrix: Matrix4<f64>,
    /// Whether the transform is valid: false if marked invalid by the tracker, or if the matrix is not finite or
    /// not affine.
    pub valid: bool,
}

/// Data of one frame of a sequence.
#[derive(Clone, Debug, PartialEq)]
pub struct SequenceFrame {
    /// Position in the sequence, from 0; for [`Sequence::read`] also that of its image.
    pub index: usize,
    /// Time stamp, s.
    pub timestamp: Option<f64>,
    /// Transforms by name, such as `ProbeToTracker`.
    pub transforms: BTreeMap<String, TrackedTransform>,
    /// Whether the image is valid: false if the file marks it invalid or has none.
    pub image_valid: bool,
}

/// A grey image in orientation MF: columns run towards the marked side, rows away from the transducer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GreyImage {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Grey levels, row by row from the near unmarked corner, 0 black to 255 white.
    pub pixels: Vec<u8>,
}

/// A tracked sequence.
///
/// ```
/// use insonify_tracking::sequence::Sequence;
/// use nalgebra::Point3;
///
/// let text = "\
/// NDims = 3
/// DimSize = 2 2 1
/// ElementType = MET_UCHAR
/// Seq_Frame0000_Timestamp = 0.5
/// Seq_Frame0000_ProbeToTrackerTransform = 1 0 0 5 0 1 0 0 0 0 1 0 0 0 0 1
/// Seq_Frame0000_ProbeToTrackerTransformStatus = OK
/// ElementDataFile = LOCAL
/// ";
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("sweep.igs.mha");
/// std::fs::write(&path, [text.as_bytes(), &[0, 80, 160, 240]].concat())?;
///
/// let sequence = Sequence::read(&path)?;
/// assert_eq!((sequence.image_size, sequence.frames[0].timestamp), (Some([2, 2]), Some(0.5)));
/// let tracker_to_probe = sequence.transform(0, "Tracker", "Probe").ok_or("no chain of transforms")?;
/// assert_eq!(tracker_to_probe.transform_point(&Point3::origin()), Point3::new(-5.0, 0.0, 0.0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Sequence {
    /// Frames in order; images without keys become frames without transforms.
    pub frames: Vec<SequenceFrame>,
    /// Columns and rows of the images in orientation MF; `None` if the file has no images.
    pub image_size: Option<[usize; 2]>,
    /// Distance between columns and between rows in orientation MF, mm; `None` if the file states 1 x 1, which PLUS and
    /// this program write regardless of the spacing.
    pub spacing_mm: Option<[f64; 2]>,
    /// Orientation of the stored images; `None` if not stated in the file.
    pub orientation: Option<Orientation>,
    /// Type of the images in PLUS's terms, such as `BRIGHTNESS` or `RF_REAL`; `None` if not stated in the file.
    pub image_type: Option<String>,
    /// Numbers of frames with an image but no keys.
    pub missing: Vec<usize>,
    /// Number of ignored frame keys of unknown kind.
    pub stray_keys: usize,
    /// Assumptions and warnings, one sentence each.
    pub warnings: Vec<String>,
    pixels: Vec<u8>,
    stored: Stored,
}

/// Sizes of the images of a file; zeros where it has none.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Stored {
    /// Values of a pixel.
    channels: usize,
    /// Columns and rows.
    size: [usize; 2],
    images: usize,
    /// Whether the values of a pixel in all images follow one another.
    is_by_pixel: bool,
    /// Distance between columns and between rows, mm.
    steps_mm: Option<[f64; 2]>,
}

impl Stored {
    /// Reads the axes of a file: values of a pixel, if it has several, then columns, rows and images.
    fn of(header: &Header, keys: &keys::Keys) -> Result<Self, VolumeError> {
        let axes = &header.axes[..];
        // MetaImage has a direction for every axis, whatever its kind.
        let kind = |axis: usize| keys.kinds.get(axis).filter(|_| keys.kinds.len() == axes.len());
        let is_colour = |kind: &String| kind.contains("vector") || kind.contains("color");
        let is_rgb = keys.image_type.as_deref().is_some_and(|kind| kind.starts_with("RGB"));
        let may_be_colour = is_rgb && axes.len() > 3 && matches!(axes[0].size, 3 | 4);
        let first_is_spatial = match kind(0).map(String::as_str) {
            Some("domain" | "space") => true,
            Some("???" | "none") => !may_be_colour,
            Some(_) => false,
            None => !may_be_colour && axes.first().is_some_and(|axis| axis.direction.is_some()),
        };
        // 3D Slicer wrote the frames of a sequence first, now it writes them last.
        let is_flat = axes.len() == 3 || (axes.len() == 4 && axes[3].size == 1);
        let is_by_pixel = is_flat && !is_rgb && kind(0).is_some_and(|kind| kind == "list");
        let is_interleaved = axes.len() > 2 && !first_is_spatial && !is_by_pixel;
        let (channels, rest) = if is_interleaved {
            (axes[0].size, &axes[1..])
        } else {
            (1, &axes[usize::from(is_by_pixel)..])
        };
        let sizes: Vec<usize> = rest.iter().map(|axis| axis.size).collect();
        let last_is_colour = axes.len() > 2 && kind(axes.len() - 1).is_some_and(is_colour);
        let (size, images) = match sizes[..] {
            _ if !matches!(channels, 1 | 3 | 4) || last_is_colour => {
                let kinds = if keys.kinds.is_empty() {
                    String::new()
                } else {
                    format!(" and kinds {}", keys.kinds.join(" "))
                };
                return Err(header.unsupported(
                    format!("a sequence of sizes {}{kinds}", header.sizes()),
                    "frames have the 3 or 4 colours of a pixel in the first axis, and frames in the last",
                ));
            }
            [width, height] => ([width, height], 1),
            [width, height, images] | [width, height, images, 1] | [width, height, 1, images] => {
                ([width, height], images)
            }
            _ => {
                return Err(header.unsupported(
                    format!("a sequence of sizes {}", header.sizes()),
                    "frames have two dimensions",
                ));
            }
        };
        let steps: Vec<f64> = rest
            .iter()
            .filter_map(|axis| axis.direction.map(|direction| direction.norm()))
            .collect();
        Ok(Self {
            channels,
            size,
            images: if is_by_pixel { axes[0].size } else { images },
            is_by_pixel,
            steps_mm: steps.first_chunk().copied(),
        })
    }
}

/// Grey level of a colour, by the luma of ITU-R BT.601.
fn grey([red, green, blue]: [u8; 3]) -> u8 {
    let [red, green, blue] = [red, green, blue].map(u32::from);
    ((299 * red + 587 * green + 114 * blue + 500) / 1000) as u8
}

impl Sequence {
    /// Reads a sequence with its images: one frame for each image, and for each frame with keys but no image. Colours
    /// become grey by the luma of ITU-R BT.601.
    ///
    /// # Errors
    /// [`VolumeError`] with the file, the place in it, what was found and what was expected.
    pub fn read(path: &Path) -> Result<Self, VolumeError> {
        let mut header = read_header(path)?;
        let stored = Stored::of(&header, &keys::parse(&header.key_values))?;
        if header.element.is_none() || stored.size.contains(&0) {
            return Self::assemble(header, None);
        }
        // Data are read first: only existing images become frames.
        let pixels = read_data(&mut header)?;
        let mut sequence = Self::assemble(header, Some(stored.images))?;
        if pixels.len() == stored.channels * stored.size[0] * stored.size[1] * stored.images {
            sequence.pixels = if stored.is_by_pixel {
                let of_image = |image: usize| pixels[image..].iter().step_by(stored.images);
                (0..stored.images).flat_map(of_image).copied().collect()
            } else {
                pixels
            };
            if stored.channels > 1 {
                let told = "the images are in colour: grey is 0.299 R + 0.587 G + 0.114 B (Rec. 601)";
                sequence.warnings.push(told.to_owned());
            }
        } else {
            let warning = "the images are not of one byte a value, as grey and colour images are: they are not read";
            sequence.warnings.push(warning.to_owned());
        }
        Ok(sequence)
    }

    /// Reads the poses without the images: one frame for each one with keys.
    ///
    /// # Errors
    /// The errors of [`Sequence::read`].
    pub fn read_poses(path: &Path) -> Result<Self, VolumeError> {
        Self::assemble(read_header(path)?, None)
    }

    /// Assembles the frames; `images` is the number of images found in the data.
    fn assemble(mut header: Header, images: Option<usize>) -> Result<Self, VolumeError> {
        let keys = keys::parse(&header.key_values);
        let mut warnings = std::mem::take(&mut header.warnings);
        let stored = Stored::of(&header, &keys).unwrap_or_else(|error| {
            warnings.push(format!("{error}: its poses alone are read"));
            Stored::default()
        });
        let shown = header.element.is_some() && !stored.size.contains(&0);
        warnings.extend(keys.warnings);
        let count = images.unwrap_or(0);
        let last = keys.frames.keys().next_back().copied();
        // Numbers beyond the images cannot be theirs: only the order is known then.
        let fits = last.is_none_or(|last| last < count);
        // As many as the images, counted from 1.
        let is_from_one = keys.frames.len() == count && last == Some(count) && !keys.frames.contains_key(&0);
        if images.is_some() && !fits && !is_from_one {
            let (named, last) = (keys.frames.len(), last.unwrap_or(0));
            warnings.push(format!(
                "{named} frames are named, up to number {last}, for {count} images: taken in order"
            ));
        }
        let mut named: BTreeMap<usize, keys::Frame> = if fits {
            keys.frames
        } else {
            keys.frames.into_values().enumerate().collect()
        };
        let mut missing = Vec::new();
        let frames: Vec<SequenceFrame> = (0..count.max(named.len()))
            .map(|index| {
                let frame = named.remove(&index).unwrap_or_else(|| {
                    missing.push(index);
                    keys::Frame::default()
                });
                SequenceFrame {
                    index,
                    timestamp: frame.timestamp,
                    image_valid: index < count && frame.image_valid.unwrap_or(true),
                    transforms: frame.transforms,
                }
            })
            .collect();
        if missing.len() < frames.len() && !missing.is_empty() {
            warnings.push(format!("{} of {} frames have no keys", missing.len(), frames.len()));
        }
        let orientation = keys.orientation.as_deref().and_then(Orientation::parse);
        if images.is_some() && orientation.is_none() {
            let stated = keys.orientation.as_deref().unwrap_or("nothing");
            warnings.push(format!(
                "the orientation of the images is given as {stated:?}: taken as MF"
            ));
        }
        let orientation_known = orientation.unwrap_or_default();
        // 1 by 1 is what a header says where no size is known.
        let steps_mm = stored.steps_mm.filter(|steps| shown && *steps != [1.0; 2]);
        Ok(Self {
            frames,
            spacing_mm: steps_mm.map(|steps| orientation_known.turned(steps)),
            image_size: shown.then(|| orientation_known.turned(stored.size)),
            orientation,
            image_type: keys.image_type,
            missing,
            stray_keys: keys.strays,
            warnings,
            pixels: Vec::new(),
            stored,
        })
    }

    /// Image of a frame in orientation MF; `None` if the frame is marked invalid or was read without an image.
    pub fn image(&self, frame: usize) -> Option<GreyImage> {
        let [width, height] = self.image_size?;
        let pixels = match self.colours(frame) {
            Some(colours) => colours.into_iter().map(grey).collect(),
            None => self
                .orientation
                .unwrap_or_default()
                .to_mf(self.values(frame)?, self.stored.size),
        };
        Some(GreyImage { width, height, pixels })
    }

    /// Red, green and blue of the pixels of a frame in the order of [`Sequence::image`]; `None` also for grey images.
    pub fn colours(&self, frame: usize) -> Option<Vec<[u8; 3]>> {
        let channels = self.stored.channels;
        let values = self.values(frame).filter(|_| channels > 1)?;
        let colours: Vec<[u8; 3]> = values
            .chunks_exact(channels)
            .map(|pixel| [pixel[0], pixel[1], pixel[2]])
            .collect();
        Some(self.orientation.unwrap_or_default().to_mf(&colours, self.stored.size))
    }

    /// Values of the stored image of a frame, if it is valid.
    fn values(&self, frame: usize) -> Option<&[u8]> {
        let [width, height] = self.stored.size;
        let known = self.frames.get(frame)?;
        let mut images = self.pixels.chunks_exact((self.stored.channels * width * height).max(1));
        images.nth(frame).filter(|_| known.image_valid)
    }

    /// Transform of a frame from `from` to `to` coordinates, composed of its valid transforms and their inverses along
    /// the shortest chain; `None` if they do not connect the two.
    pub fn transform(&self, frame: usize, from: &str, to: &str) -> Option<Matrix4<f64>> {
        chain(&self.frames.get(frame)?.transforms, from, to)
    }
}

/// Composes named transforms from one coordinate system to another; see [`Sequence::transform`].
pub fn chain(transforms: &BTreeMap<String, TrackedTransform>, from: &str, to: &str) -> Option<Matrix4<f64>> {
    let mut edges: Vec<(&str, &str, Matrix4<f64>)> = Vec::new();
    for (name, transform) in transforms.iter().filter(|(_, transform)| transform.valid) {
        let Some((source, target)) = keys::ends(name) else {
            continue;
        };
        edges.push((source, target, transform.matrix));
        if let Some(inverse) = transform.matrix.try_inverse() {
            edges.push((target, source, inverse));
        }
    }
    let mut reached = BTreeMap::from([(from, Matrix4::identity())]);
    let mut queue = VecDeque::from([from]);
    while let Some(system) = queue.pop_front() {
        let here = reached.get(system).copied()?;
        if system == to {
            return Some(here);
        }
        for &(source, target, matrix) in &edges {
            if source == system && !reached.contains_key(target) {
                reached.insert(target, matrix * here);
                queue.push_back(target);
            }
        }
    }
    None
}

/// Adds transforms defined elsewhere to the recorded ones, where neither they nor their inverses are recorded.
pub fn merged(
    recorded: &BTreeMap<String, TrackedTransform>,
    defined: &BTreeMap<String, TrackedTransform>,
) -> BTreeMap<String, TrackedTransform> {
    let mut all = recorded.clone();
    for (name, transform) in defined {
        let back = keys::ends(name).map(|(from, to)| format!("{to}To{from}"));
        if back.is_none_or(|back| !recorded.contains_key(&back)) {
            all.entry(name.clone()).or_insert(*transform);
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shift(x: f64, valid: bool) -> TrackedTransform {
        TrackedTransform {
            matrix: Matrix4::new_translation(&nalgebra::Vector3::new(x, 0.0, 0.0)),
            valid,
        }
    }

    #[test]
    fn transforms_chain_through_inverses() {
        let transforms = BTreeMap::from([
            ("ImageToProbe".to_owned(), shift(100.0, true)),
            ("ProbeToTracker".to_owned(), shift(10.0, true)),
            ("ReferenceToTracker".to_owned(), shift(3.0, true)),
            ("StylusToTracker".to_owned(), shift(1.0, false)),
        ]);
        let x = |from: &str, to: &str| chain(&transforms, from, to).map(|matrix| matrix[(0, 3)]);
        assert_eq!(x("Probe", "Reference"), Some(7.0));
        assert_eq!(x("Reference", "Image"), Some(-107.0));
        assert_eq!(x("Probe", "Probe"), Some(0.0));
        assert_eq!(x("Stylus", "Tracker"), None);
        assert_eq!(x("Probe", "Nowhere"), None);
        assert_eq!(chain(&BTreeMap::new(), "A", "B"), None);
        let turn = TrackedTransform {
            matrix: Matrix4::from_euler_angles(0.0, 0.0, std::f64::consts::FRAC_PI_2),
            valid: true,
        };
        // First moved along x, then turned about z: the shift ends up along y.
        let ordered = BTreeMap::from([("AToB".to_owned(), shift(5.0, true)), ("BToC".to_owned(), turn)]);
        let matrix = chain(&ordered, "A", "C").unwrap();
        assert!(
            (matrix[(1, 3)] - 5.0).abs() < 1e-12 && matrix[(0, 3)].abs() < 1e-12,
            "{matrix}"
        );
    }

    #[test]
    fn what_is_recorded_wins_over_what_is_defined() {
        let map = |pairs: &[(&str, TrackedTransform)]| -> BTreeMap<String, TrackedTransform> {
            pairs
                .iter()
                .map(|(name, transform)| ((*name).to_owned(), *transform))
                .collect()
        };
        let recorded = map(&[("AToB", shift(1.0, false)), ("CToB", shift(2.0, true))]);
        let defined = map(&[
            ("AToB", shift(10.0, true)),
            ("BToC", shift(20.0, true)),
            ("DToC", shift(40.0, true)),
        ]);
        let all = merged(&recorded, &defined);
        assert_eq!(all.len(), 3);
        assert_eq!(chain(&all, "D", "B").map(|matrix| matrix[(0, 3)]), Some(42.0));
        assert_eq!(chain(&all, "A", "B"), None);
    }

    fn write(text: &str, data: &[u8]) -> (tempfile::TempDir, std::path::PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.igs.mha");
        let mut bytes = text.as_bytes().to_vec();
        bytes.extend_from_slice(data);
        std::fs::write(&path, bytes).unwrap();
        (folder, path)
    }

    fn header(sizes: &str, more: &str) -> String {
        format!(
            "NDims = 3\nDimSize = {sizes}\nElementSpacing = 1 1 1\nElementType = MET_UCHAR\n{more}\nElementDataFile = LOCAL\n"
        )
    }

    #[test]
    fn gaps_invalid_frames_and_strays_are_told() {
        let keys = "UltrasoundImageOrientation = MFA\nUltrasoundImageType = BRIGHTNESS\n\
            Seq_Frame0000_AToBTransform = 1 0 0 1e-005 0 1 0 0 0 0 1 0 0 0 0 1\n\
            Seq_Frame0000_AToBTransformStatus = OK\n\
            Seq_Frame0000_Timestamp = 1.5\nSeq_Frame0000_Stylus = what\n\
            Seq_Frame0002_AToBTransform = 1 0 0 nan 0 1 0 0 0 0 1 0 0 0 0 1\n\
            Seq_Frame0002_ImageStatus = INVALID";
        let (_folder, path) = write(&header("2 1 3", keys), &[1, 2, 3, 4, 5, 6]);
        let sequence = Sequence::read(&path).unwrap();
        assert_eq!(sequence.frames.len(), 3);
        assert_eq!(sequence.missing, [1]);
        assert_eq!(sequence.stray_keys, 1);
        assert_eq!(sequence.frames[0].timestamp, Some(1.5));
        assert_eq!(sequence.transform(0, "A", "B").unwrap()[(0, 3)], 1e-5);
        assert!(!sequence.frames[2].transforms["AToB"].valid);
        assert_eq!(sequence.transform(2, "A", "B"), None);
        assert_eq!(sequence.image(1).unwrap().pixels, [3, 4]);
        assert_eq!(sequence.image(2), None);
        assert_eq!(sequence.image(3), None);
        assert_eq!(Sequence::read_poses(&path).unwrap().image(0), None);
    }

    /// Two frames of 3 x 2 pixels, in each format that says which axis has the colours.
    #[test]
    fn colours_are_told_from_columns() {
        let keys = "Seq_Frame0000_AToBTransform = 1 0 0 7 0 1 0 0 0 0 1 0 0 0 0 1\nUltrasoundImageOrientation = MF\nUltrasoundImageType = RGB_COLOR";
        let nrrd = |kinds: &str, sizes: &str, directions: &str| {
            let keys = keys.replace(" = ", ":=");
            format!(
                "NRRD0004\ntype: uint8\ndimension: 4\nsizes: {sizes}\nencoding: raw\nkinds: {kinds}\n{directions}{keys}\n\n"
            )
        };
        let meta = |sizes: &str, more: &str| {
            let text = header(sizes, &format!("{more}\n{keys}"));
            let count = sizes.split(' ').count().to_string();
            text.replace("NDims = 3", &format!("NDims = {count}"))
                .replace("1 1 1", &["1"; 9][..sizes.split(' ').count()].join(" "))
        };
        // Red, green, blue and others; the fourth value is opacity.
        let colours: Vec<[u8; 4]> = (0..12).map(|n| [20 * n, 255 - 20 * n, 7 * n, 99]).collect();
        let expected: Vec<u8> = colours
            .iter()
            .map(|[r, g, b, _]| (0.299 * f64::from(*r) + 0.587 * f64::from(*g) + 0.114 * f64::from(*b)).round() as u8)
            .collect();
        for (text, channels) in [
            (nrrd("vector domain domain list", "3 3 2 2", ""), 3),
            (
                nrrd(
                    "RGB-color domain domain list",
                    "3 3 2 2",
                    "space dimension: 2\nspace directions: none (1,0) (0,1) none\n",
                ),
                3,
            ),
            (nrrd("RGBA-color domain domain list", "4 3 2 2", ""), 4),
            (nrrd("list domain domain list", "4 3 2 2", ""), 4),
            (nrrd("??? ??? ??? ???", "3 3 2 2", ""), 3),
            (meta("3 2 2", "ElementNumberOfChannels = 3"), 3),
            (
                meta("3 2 2", "ElementNumberOfChannels = 4\nKinds = domain domain list"),
                4,
            ),
            (meta("3 3 2 2", "Kinds = vector domain domain list"), 3),
        ] {
            let data: Vec<u8> = colours.iter().flat_map(|colour| &colour[..channels]).copied().collect();
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("a.igs.mha");
            std::fs::write(&path, [text.as_bytes(), &data].concat()).unwrap();
            let sequence = Sequence::read(&path).expect(&text);
            assert_eq!(
                (sequence.image_size, sequence.frames.len()),
                (Some([3, 2]), 2),
                "{text}"
            );
            let image = sequence.image(1).expect("an image").pixels;
            assert_eq!(image, expected[6..], "{text}");
            assert_eq!(sequence.colours(0).expect("colours")[5], [100, 155, 35]);
            assert!(
                sequence.warnings.iter().any(|warning| warning.contains("Rec. 601")),
                "{:?}",
                sequence.warnings
            );
            let poses = Sequence::read_poses(&path).expect(&text);
            assert_eq!((poses.frames.len(), poses.image_size), (1, Some([3, 2])), "{text}");
            assert!(
                !poses.warnings.iter().any(|warning| warning.contains("colour")),
                "{:?}",
                poses.warnings
            );
            let info = SequenceInfo::of(&path).expect("a sequence").to_string();
            assert!(
                info.contains(&format!("3 x 2 pixels of {channels} colours of 8-bit"))
                    || info.contains(&format!("{channels} colours of u")),
                "{info}"
            );
        }
        // What is no colour: its images are refused, its poses are read.
        for (kinds, sizes) in [
            ("vector domain domain list", "2 3 2 2"),
            ("domain domain list RGB-color", "3 2 2 3"),
            ("list domain domain domain", "5 3 2 2"),
        ] {
            let (_folder, path) = write(&nrrd(kinds, sizes, ""), &[0; 60]);
            let error = Sequence::read(&path).expect_err(kinds).to_string();
            assert!(
                error.contains(&kinds.to_lowercase()) && error.contains("3 or 4 colours"),
                "{error}"
            );
            assert_eq!(Sequence::read_poses(&path).expect(kinds).frames.len(), 1);
            assert!(SequenceInfo::of(&path).is_some_and(|info| info.images.is_none()));
        }
        // Three columns are no colours where the kinds say so, or say nothing.
        let (_folder, path) = write(&meta("3 2 2", "Kinds = domain domain list"), &[0; 12]);
        let grey = Sequence::read(&path).expect("grey");
        assert_eq!((grey.image_size, grey.colours(0)), (Some([3, 2]), None));
    }

    #[test]
    fn images_are_those_of_the_list_wherever_it_stands() {
        for (kinds, sizes, data) in [
            (
                "domain domain domain list",
                "3 2 1 2",
                [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11],
            ),
            (
                "list domain domain domain",
                "2 3 2 1",
                [0, 6, 1, 7, 2, 8, 3, 9, 4, 10, 5, 11],
            ),
        ] {
            let text =
                format!("NRRD0004\ntype: uint8\ndimension: 4\nsizes: {sizes}\nencoding: raw\nkinds: {kinds}\n\n");
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("a.seq.nrrd");
            std::fs::write(&path, [text.as_bytes(), &data].concat()).unwrap();
            let sequence = Sequence::read(&path).expect(kinds);
            assert_eq!(
                (sequence.image_size, sequence.frames.len()),
                (Some([3, 2]), 2),
                "{kinds}"
            );
            assert_eq!(sequence.image(1).unwrap().pixels, [6, 7, 8, 9, 10, 11], "{kinds}");
            let info = SequenceInfo::of(&path).expect(kinds);
            assert_eq!(
                (info.frames, info.images.map(|images| images.width)),
                (2, Some(3)),
                "{kinds}"
            );
        }
    }

    #[test]
    fn numbers_past_the_images_give_the_order() {
        let keys = "Seq_Frame0010_Timestamp = 1\nSeq_Frame0020_Timestamp = 2";
        let (_folder, path) = write(&header("1 1 2", keys), &[7, 8]);
        let sequence = Sequence::read(&path).unwrap();
        let times: Vec<_> = sequence.frames.iter().map(|frame| frame.timestamp).collect();
        assert_eq!(times, [Some(1.0), Some(2.0)]);
        assert!(
            sequence
                .warnings
                .iter()
                .any(|warning| warning == "2 frames are named, up to number 20, for 2 images: taken in order")
        );
    }

    /// Line ends, numbers of frames and states as programs write them.
    #[test]
    fn recordings_of_many_programs_are_the_same() {
        let recording = |line_end: &str, first: usize, digits: usize, orientation: &str| {
            let mut keys = format!("UltrasoundImageOrientation = {orientation}\nUltrasoundImageType = BRIGHTNESS");
            for index in 0..3 {
                let frame = format!("\nSeq_Frame{:0digits$}", first + index);
                let status = ["OK", "TOOL_MISSING", "OK"][index];
                keys += &format!("{frame}_AToBTransform = 1 0 0 {index} 0 1 0 0 0 0 1 0 0 0 0 1");
                keys += &format!("{frame}_AToBTransformStatus = {status}");
                keys += &format!("{frame}_Timestamp = {index}.5{frame}_ImageStatus = OK");
            }
            let (_folder, path) = write(&header("2 1 3", &keys).replace('\n', line_end), &[1, 2, 3, 4, 5, 6]);
            Sequence::read(&path).unwrap()
        };
        let plain = recording("\n", 0, 4, "MFA");
        assert!(plain.warnings.is_empty(), "{:?}", plain.warnings);
        assert_eq!(plain.transform(1, "A", "B"), None);
        for (line_end, first, digits, orientation) in [
            ("\r\n", 0, 4, "MFA"),
            ("\n", 1, 4, "MFA"),
            ("\n", 0, 10, "MFA"),
            ("\r\n", 1, 1, "MF"),
            ("\n", 0, 4, "??"),
        ] {
            let other = recording(line_end, first, digits, orientation);
            let case = format!("{line_end:?} {first} {digits} {orientation}");
            assert_eq!(other.frames.len(), 3, "{case}");
            for frame in 0..3 {
                assert_eq!(other.frames[frame].timestamp, plain.frames[frame].timestamp, "{case}");
                assert_eq!(
                    other.transform(frame, "A", "B"),
                    plain.transform(frame, "A", "B"),
                    "{case}"
                );
                assert_eq!(other.image(frame), plain.image(frame), "{case}");
            }
            let doubts = usize::from(orientation == "??");
            assert_eq!(other.warnings.len(), doubts, "{case}: {:?}", other.warnings);
        }
        // Turned, and as sure.
        let turned = recording("\n", 0, 4, "UN");
        assert_eq!(turned.image(0).unwrap().pixels, [2, 1]);
        assert!(turned.warnings.is_empty(), "{:?}", turned.warnings);
    }

    #[test]
    fn a_header_alone_asks_for_no_memory() {
        let (_folder, path) = write(&header("0 0 99999999999999", "Seq_Frame0000_Timestamp = 1"), &[]);
        assert_eq!(Sequence::read(&path).unwrap().frames.len(), 1);
        let (_folder, path) = write(&header("1 1 99999999999999", ""), &[]);
        let message = Sequence::read(&path).unwrap_err().to_string();
        assert!(message.contains("at most 16 GiB"), "{message}");
        let (_folder, path) = write(&header("1 1 9999999999", ""), &[0; 10]);
        let message = Sequence::read(&path).unwrap_err().to_string();
        assert!(message.contains("the end of the data after 10 bytes"), "{message}");
    }
}
