//! Tracked sequences of a scene: recorded poses, calibration, and the probe and pixels of the recorded images.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use nalgebra::Matrix4;

use super::At;
use super::file::SceneFile;
use super::paths::SequenceSpec;
use crate::synth::tables::ImageSize;
use insonify_base::document::{InputError, InvalidFile, nearest};
use insonify_base::matrix::Rows;
use insonify_base::note::Notes;
use insonify_tracking::calibration::Calibration;
use insonify_tracking::plus::PlusConfig;
use insonify_tracking::probe::{GridSpec, ImageSpec, ProbeSpec};
use insonify_tracking::sequence::{Sequence, SequenceFrame, TrackedTransform, chain, ends, merged};
use insonify_tracking::trajectory::{TrackedFrame, Trajectory};

const KEY: &str = "motion.sequence";

/// Name of the transform from calibrated images to the stored crop of them.
pub(super) const CROP: &str = "ImageToCroppedImage";

/// Tolerance for entries of the crop transform.
const SAME_CROP: f64 = 1e-6;

/// Tracked sequence that moves the probe.
#[derive(Clone, Debug)]
pub(super) struct Recording {
    /// Recorded frames.
    pub frames: Vec<SequenceFrame>,
    /// Name of the transform that gives the pose of the marker.
    pub transform: String,
    /// Rigid transform from the centre of the array to the marker on the probe.
    pub array_to_marker: Matrix4<f64>,
    /// Calibration of the stored pixels.
    calibration: Option<Calibration>,
    image_size: Option<[usize; 2]>,
}

impl SceneFile {
    /// Reads the PLUS configuration that the scene names.
    pub(super) fn plus_config(&self, base: &Path) -> Result<Option<PlusConfig>, InputError> {
        let spec = self.motion.as_ref().and_then(|motion| motion.sequence.as_ref());
        let config = spec.and_then(|spec| spec.plus_config.as_ref());
        let read = |config| PlusConfig::read(&base.join(config)).at(self, "motion.sequence.plus_config");
        config.map(read).transpose()
    }

    /// Returns the probe table, with open keys taken from the configuration of the recording.
    pub(super) fn probe_table(
        &self,
        plus: Option<&PlusConfig>,
        notes: &mut Notes,
        warnings: &mut Vec<String>,
    ) -> Option<ProbeSpec> {
        let recorded = plus.map(|plus| (plus.probe(), plus.transducer().unwrap_or("a transducer without a name")));
        // Geometry of a probe of another kind would mean something else: keys are filled in only where the kinds agree.
        match (&self.probe, recorded) {
            (Some(ProbeSpec { kind: Some(kind), .. }), Some((ProbeSpec { kind: Some(other), .. }, name)))
                if kind != other =>
            {
                warnings.push(format!(
                    "the probe is stated as {kind}, but `plus_config` says {other} ({name}): nothing is taken from it"
                ));
                self.probe.clone()
            }
            (stated, Some((recorded @ ProbeSpec { kind: Some(_), .. }, name))) => {
                let (table, filled) = stated.clone().unwrap_or_default().filled_from(recorded);
                if !filled.is_empty() {
                    notes.push(format!(
                        "the probe has {} from `plus_config` ({name})",
                        filled.join(", ")
                    ));
                }
                Some(table)
            }
            (None, _) if self.motion.as_ref().is_some_and(|motion| motion.sequence.is_some()) => {
                let warning = "no `[probe]`, and no `plus_config` that describes the transducer: the default probe may not be the \
                               one that was recorded";
                warnings.push(warning.to_owned());
                None
            }
            (stated, _) => stated.clone(),
        }
    }

    /// Recorded probe poses of a sequence, with calibration and image data.
    pub(super) fn recording(
        &self,
        spec: &SequenceSpec,
        base: &Path,
        plus: Option<&PlusConfig>,
        notes: &mut Notes,
        warnings: &mut Vec<String>,
    ) -> Result<(Vec<TrackedFrame>, Recording), InputError> {
        let transform = spec.transform();
        let (frames, sequence) = self.frames(KEY, (spec.file.as_deref(), transform, plus), base, notes)?;
        warnings.extend(sequence.warnings);
        warnings.extend(
            plus.into_iter()
                .flat_map(PlusConfig::warnings)
                .map(|text| format!("{KEY}.plus_config: {text}")),
        );
        if ends(transform).is_none() {
            notes.push(format!(
                "{KEY}: `{transform}` does not say which frames it joins: taken as from the marker on the probe to the tracker"
            ));
        }
        // An image size of a single pixel means that there are no images.
        let stored = sequence.image_size.filter(|size| *size != [1, 1]);
        let configured = plus.and_then(PlusConfig::image_size);
        let marker = ends(transform).map_or("Probe", |(from, _)| from);
        let stored_calibration = match (spec.transducer_to_probe, spec.image_to_probe, plus) {
            (None, None, None) => stored_calibration(&frames, &sequence.frames, marker, warnings),
            _ => None,
        };
        let crop = if spec.image_to_probe.is_some() || plus.is_some() || stored_calibration.is_some() {
            cropping(&frames, &sequence.frames).map_err(|found| {
                let expected = "a shift and a scale of columns and rows, valid and the same in all frames";
                self.wrong_keys("motion.sequence.file", format!("`{CROP}` that {found}"), expected)
            })?
        } else {
            None
        };
        if let (Some([width, height]), Some([columns, rows]), None) = (stored, configured, crop)
            && stored != configured
        {
            warnings.push(format!(
                "{KEY}: the images have {width} x {height} pixels, and `plus_config` is for {columns} x {rows}: its calibration \
                 may be for other images"
            ));
        }
        let image_size = stored.or(configured);
        let calibrated_size = if crop.is_some() { configured } else { image_size };
        let calibration = match stored_calibration {
            None => self.calibration(spec, plus, marker, calibrated_size)?,
            Some(image_to_probe) => {
                let key = "motion.sequence.file";
                let Some(centre) = spec.array_centre_px else {
                    let guess = calibrated_size.map(|[width, _]| [width as f64 / 2.0, 0.0]);
                    let found =
                        format!("frames that store the calibration `ImageTo{marker}`, without `array_centre_px`");
                    let expected = "the pixel (column, row) at the centre of the array, or `transducer_to_probe` in place of the \
                                    stored calibration";
                    let help = guess.map(|guess| offered_centre(guess, "images"));
                    return Err(self.wrong_keys(key, found, expected).with_help(help));
                };
                notes.push(format!(
                    "{KEY}: the calibration is `ImageTo{marker}`, which the frames store"
                ));
                Some(Calibration::new(&image_to_probe, centre).at(self, key)?)
            }
        };
        if let Some(calibration) = &calibration {
            self.doubts_of_calibration(calibration, (spec, plus), calibrated_size, notes, warnings);
        }
        notes.extend(crop.map(|crop| {
            let [column, row] = [0, 1].map(|axis| 0.0 - crop[(axis, 3)] / crop[(axis, axis)]);
            format!(
                "{KEY}: the images are cropped (`{CROP}`): their pixel (0, 0) is pixel ({column}, {row}) of those that were \
                 calibrated"
            )
        }));
        // Poses of `TransducerToTracker` are those of the array.
        if calibration.is_none() && spec.transducer_to_probe.is_none() && marker != "Transducer" {
            notes.push(format!(
                "{KEY}: no calibration is stated: the array is taken to be where the marker of `{transform}` is, with its axes; state \
                 `transducer_to_probe`, `image_to_probe` with `array_centre_px`, or `plus_config`"
            ));
        }
        let stated = spec.transducer_to_probe.map_or_else(Matrix4::identity, |rows| rows.0);
        let recording = Recording {
            frames: sequence.frames,
            transform: transform.to_owned(),
            array_to_marker: calibration.map_or(stated, |calibration| *calibration.transducer_to_probe()),
            calibration: calibration.map(|whole| crop.map_or(whole, |crop| whole.cropped(&crop))),
            image_size,
        };
        Ok((frames, recording))
    }

    /// Tells what looks wrong about the calibration of images of this size.
    fn doubts_of_calibration(
        &self,
        calibration: &Calibration,
        (spec, plus): (&SequenceSpec, Option<&PlusConfig>),
        calibrated_size: Option<[usize; 2]>,
        notes: &mut Notes,
        warnings: &mut Vec<String>,
    ) {
        let size = calibrated_size.unwrap_or([640, 480]);
        let on_grid = self.image.is_some_and(|image| image.grid == GridSpec::Recorded);
        let (skewed, still) = if on_grid {
            (None, calibration.skew_note(size))
        } else {
            (calibration.skew_warning(size), None)
        };
        notes.extend(still.map(|text| format!("{KEY}: {text}")));
        let other = plus
            .and_then(PlusConfig::pixel_mm)
            .and_then(|stated| calibration.other_pixels(stated));
        let far = calibrated_size.and_then(|size| calibration.far_centre(size));
        let twice = match spec.array_centre_px {
            Some(_) => None,
            None => plus.and_then(PlusConfig::two_centres),
        };
        warnings.extend(
            [skewed, other, far, twice]
                .into_iter()
                .flatten()
                .map(|text| format!("{KEY}: {text}")),
        );
    }

    /// Recorded poses of one transform in a sequence, composed with transforms of a configuration where needed.
    pub(super) fn frames(
        &self,
        key: &str,
        (file, transform, plus): (Option<&Path>, &str, Option<&PlusConfig>),
        base: &Path,
        notes: &mut Notes,
    ) -> Result<(Vec<TrackedFrame>, Sequence), InputError> {
        let Some(file) = file else {
            return Err(self.wrong_keys(key, "no `file`", "the path of a tracked sequence"));
        };
        let path = base.join(file);
        let sequence = Sequence::read_poses(&path).at(self, &format!("{key}.file"))?;
        let defined = plus.map_or_else(BTreeMap::new, PlusConfig::definitions);
        let named = sequence
            .frames
            .iter()
            .any(|frame| frame.transforms.contains_key(transform));
        // A transform named after its node joins two frames without names.
        let Some((from, to)) = ends(transform).or(named.then_some((transform, ""))) else {
            let (has, help) = known_transforms(&sequence, &defined, transform, ["", ""]);
            let problem = InvalidFile::Unknown(format!(
                "no frame of {} has `{transform}`; it has {has}; expected one of these, or a pair such as `ProbeToTracker`",
                path.display()
            ));
            return Err(self.fault(format!("{key}.transform"), problem).with_help(help));
        };
        let recorded = |frame: &SequenceFrame| match frame.transforms.get(transform) {
            // An invalid pose stays so, even where other transforms could replace it: the tracker had lost
            // the tool.
            Some(recorded) => recorded.valid.then_some(recorded.matrix),
            None => chain(&frame.transforms, from, to),
        };
        let timed = |frame: &SequenceFrame, tool_to_tracker| TrackedFrame {
            time_s: frame.timestamp,
            tool_to_tracker,
        };
        let has_pose = |frames: &[TrackedFrame]| frames.iter().any(|frame| frame.tool_to_tracker.is_some());
        let recorded_frames = sequence.frames.iter();
        let frames: Vec<TrackedFrame> = recorded_frames
            .clone()
            .map(|frame| timed(frame, recorded(frame)))
            .collect();
        if named || has_pose(&frames) {
            return Ok((frames, sequence));
        }
        // Only now the configuration: what was recorded outranks what is defined.
        let composed = |frame: &SequenceFrame| chain(&merged(&frame.transforms, &defined), from, to);
        let frames: Vec<TrackedFrame> = recorded_frames.map(|frame| timed(frame, composed(frame))).collect();
        if has_pose(&frames) {
            notes.push(format!(
                "{key}: `{transform}` does not follow from the recording alone: transforms that `plus_config` defines are part of it"
            ));
            return Ok((frames, sequence));
        }
        let (has, help) = known_transforms(&sequence, &defined, transform, [from, to]);
        let problem = InvalidFile::Unknown(format!(
            "no frame of {} has `{transform}`, or valid transforms that connect the two; it has {has}",
            path.display()
        ));
        Err(self.fault(format!("{key}.transform"), problem).with_help(help))
    }

    /// Calibration of the recorded images, if the scene has one.
    fn calibration(
        &self,
        spec: &SequenceSpec,
        plus: Option<&PlusConfig>,
        marker: &str,
        image_size: Option<[usize; 2]>,
    ) -> Result<Option<Calibration>, InputError> {
        let ways = [
            spec.transducer_to_probe.is_some(),
            spec.image_to_probe.is_some(),
            spec.plus_config.is_some(),
        ];
        if ways.iter().filter(|stated| **stated).count() > 1 {
            let found = "more than one of `transducer_to_probe`, `image_to_probe` and `plus_config`";
            return Err(self.wrong_keys(KEY, found, "at most one calibration"));
        }
        if let Some(plus) = plus {
            let key = "motion.sequence.plus_config";
            let unknown = |error: InputError| {
                let transform = spec.transform();
                let help =
                    format!("`transform = \"{transform}\"` takes {marker} for the marker on the probe: is it another?");
                error.with_help(Some(help))
            };
            let image_to_probe = plus.transform("Image", marker).at(self, key).map_err(unknown)?;
            let Some(centre) = spec.array_centre_px.or_else(|| plus.array_centre_px()) else {
                let guess = plus.guessed_centre_px(image_size);
                let help = guess.map(|(centre_px, grounds)| offered_centre(centre_px, grounds));
                let found = "no `TransducerCenterPixel` in the configuration";
                return Err(self
                    .wrong_keys(key, found, "`array_centre_px` beside it")
                    .with_help(help));
            };
            return Calibration::new(&image_to_probe, centre).at(self, key).map(Some);
        }
        match (&spec.image_to_probe, spec.array_centre_px) {
            (Some(image), Some(centre)) => Calibration::new(&image.0, centre)
                .at(self, "motion.sequence.image_to_probe")
                .map(Some),
            (Some(_), None) => Err(self.wrong_keys(
                "motion.sequence.image_to_probe",
                "`image_to_probe` without `array_centre_px`",
                "the pixel (column, row) at the centre of the array",
            )),
            (None, Some(_)) => Err(self.wrong_keys(
                "motion.sequence.array_centre_px",
                "`array_centre_px` without `image_to_probe` or `plus_config`",
                "the calibration that it belongs to",
            )),
            (None, None) => Ok(None),
        }
    }

    /// Pixels of a frame, on the grid of the recording if the scene requests it.
    pub(super) fn on_grid(&self, image: ImageSize, recording: Option<&Recording>) -> Result<ImageSize, InputError> {
        let Some(spec) = self.image.filter(|image| image.grid == GridSpec::Recorded) else {
            return Ok(image);
        };
        let calibrated = recording.and_then(|recording| recording.calibration.zip(recording.image_size));
        let Some((calibration, size)) = calibrated else {
            let expected = "a [motion.sequence] of images with `image_to_probe` or `plus_config`, or a `plus_config` with \
                            `OutputImageSizePixel`";
            return Err(self.wrong_keys("image.grid", "no calibrated images to take the grid of", expected));
        };
        let fitted = ImageSpec::default();
        let stated = [spec.width, spec.height];
        let has_own_size = stated == [fitted.width, fitted.height] || stated.map(|side| side as usize) == size;
        if !has_own_size || spec.margin != fitted.margin {
            let found = "`grid = \"recorded\"` with `width`, `height` or `margin`";
            return Err(self.wrong_keys(
                "image",
                found,
                "the grid alone, without `--size`: the recording has its own size",
            ));
        }
        let placed = calibration.grid(size).at(self, "image.grid")?;
        let [width, height] = size;
        Ok(ImageSize {
            width,
            height,
            placed: Some(placed),
            ..image
        })
    }
}

/// Offer of a guessed centre of the array. It is never used unasked: a wrong centre shifts every pose, and nothing else
/// would show it.
fn offered_centre([column, row]: [f64; 2], grounds: &str) -> String {
    format!(
        "for a straight array along the upper edge of the {grounds}, `array_centre_px = [{column}, {row}]`: a guess, to be \
         checked against an image"
    )
}

/// Transform from pixels to the marker that the frames with a pose store, if it is one and the same.
fn stored_calibration(
    frames: &[TrackedFrame],
    recorded: &[SequenceFrame],
    marker: &str,
    warnings: &mut Vec<String>,
) -> Option<Matrix4<f64>> {
    /// Pixel at which two calibrations are compared, and distance below which they are the same, mm.
    const FAR_PX: f64 = 1000.0;
    const SAME_MM: f64 = 0.1;
    let name = format!("ImageTo{marker}");
    let used = recorded
        .iter()
        .zip(frames)
        .filter(|(_, pose)| pose.tool_to_tracker.is_some());
    let stored: Vec<_> = used
        .filter_map(|(frame, _)| frame.transforms.get(&name).filter(|known| known.valid))
        .collect();
    let first = stored.first()?.matrix;
    let corner = |matrix: &Matrix4<f64>| matrix * nalgebra::Vector4::new(FAR_PX, FAR_PX, 0.0, 1.0);
    let is_same = |known: &&TrackedTransform| (corner(&known.matrix) - corner(&first)).norm() <= SAME_MM;
    if stored.iter().all(is_same) {
        return Some(first);
    }
    warnings.push(format!(
        "{KEY}: `{name}` is not the same in all frames: not used as the calibration"
    ));
    None
}

/// Crop of the images of a recording, if the frames with a pose have one; otherwise a description of the error.
fn cropping(frames: &[TrackedFrame], recorded: &[SequenceFrame]) -> Result<Option<Matrix4<f64>>, String> {
    let used = recorded.iter().zip(frames);
    let used: Vec<_> = used.filter(|(_, pose)| pose.tool_to_tracker.is_some()).collect();
    let crops = used.iter().map(|(frame, _)| (frame.index, frame.transforms.get(CROP)));
    let Some((first, Some(crop))) = crops.clone().find(|(_, crop)| crop.is_some()) else {
        return Ok(None);
    };
    for (frame, other) in crops {
        match other {
            Some(other) if !other.valid => return Err(format!("is invalid in frame {frame}")),
            Some(other) if (other.matrix - crop.matrix).amax() <= SAME_CROP => {}
            _ => return Err(format!("is not in frame {frame} what it is in frame {first}")),
        }
    }
    let matrix = crop.matrix;
    let flat = [(0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1), (2, 3)];
    let flat = flat.iter().all(|entry| matrix[*entry].abs() <= SAME_CROP);
    if flat && matrix[(0, 0)] > 0.0 && matrix[(1, 1)] > 0.0 {
        return Ok(Some(matrix));
    }
    let rows = Rows(matrix).rows();
    Err(format!("is {rows:?}"))
}

/// Lists the transforms of a sequence, invalid ones marked, and those defined in the configuration, with a suggestion
/// for a misspelt name.
fn known_transforms(
    sequence: &Sequence,
    defined: &BTreeMap<String, TrackedTransform>,
    wanted: &str,
    ends_of_it: [&str; 2],
) -> (String, Option<String>) {
    let mut valid: BTreeMap<&str, bool> = BTreeMap::new();
    for (name, transform) in sequence.frames.iter().flat_map(|frame| &frame.transforms) {
        *valid.entry(name).or_default() |= transform.valid;
    }
    let names = valid.keys().copied().chain(defined.keys().map(String::as_str));
    let systems: BTreeSet<&str> = names.filter_map(ends).flat_map(<[&str; 2]>::from).collect();
    let moving: BTreeSet<&str> = valid
        .keys()
        .copied()
        .filter_map(ends)
        .flat_map(<[&str; 2]>::from)
        .collect();
    let pairs = systems.iter().flat_map(|from| systems.iter().map(move |to| (from, to)));
    // What the configuration alone defines does not move.
    let pairs = pairs.filter(|(from, to)| from != to && (moving.contains(*from) || moving.contains(*to)));
    let candidates: Vec<String> = pairs.map(|(from, to)| format!("{from}To{to}")).collect();
    // A suggestion helps with a coordinate system that nobody names; a pair of known ones is absent, not misspelt.
    let misspelt = !ends_of_it.iter().all(|end| systems.contains(end));
    let nodes: Vec<&str> = valid
        .iter()
        .filter(|(name, is_valid)| **is_valid && ends(name).is_none() && **name != CROP)
        .map(|(name, _)| *name)
        .collect();
    let near = nearest(
        wanted,
        candidates.iter().map(String::as_str).chain(nodes.iter().copied()),
    );
    let help = match (near.filter(|_| misspelt), &nodes[..]) {
        (Some(meant), _) => Some(format!("did you mean \"{meant}\"?")),
        (None, []) => None,
        (None, [node]) => Some(format!("did you mean \"{node}\"?")),
        (None, nodes) => Some(format!("name that of the probe: {}", nodes.join(", "))),
    };
    let frames = sequence.frames.len();
    let has = valid.into_iter().map(|(name, valid)| {
        if valid {
            name.to_owned()
        } else {
            format!("{name} (invalid in all {frames} frames)")
        }
    });
    let mut has = has.collect::<Vec<_>>().join(", ");
    if has.is_empty() {
        has.push_str("no transforms");
    }
    if !defined.is_empty() {
        let defined: Vec<&str> = defined.keys().map(String::as_str).collect();
        has.push_str(&format!(", and `plus_config` defines {}", defined.join(", ")));
    }
    (has, help)
}

/// Notes about frames of a recording without a pose, or with a repeated pose.
pub(super) fn left_out(key: &str, path: &Trajectory, frames: usize) -> Vec<String> {
    let mut said = Vec::new();
    if let Some(first) = path.skipped().first() {
        said.push(format!(
            "{key}: {} of {frames} frames skipped ({}); frame {}: {}",
            path.skipped().len(),
            ranges(path.skipped().iter().map(|skipped| skipped.frame)),
            first.frame,
            first.reason
        ));
    }
    if path.repeated() > 0 {
        said.push(format!(
            "{key}: {} of {frames} frames repeat the pose before them (a tool at rest, or a tracker that stalled)",
            path.repeated()
        ));
    }
    said
}

/// Formats ascending numbers as ranges such as `3, 7 to 9`, the first of many.
fn ranges(numbers: impl Iterator<Item = usize>) -> String {
    const SHOWN: usize = 12;
    let mut ranges: Vec<[usize; 2]> = Vec::new();
    for number in numbers {
        match ranges.last_mut() {
            Some([_, last]) if *last + 1 == number => *last = number,
            _ => ranges.push([number, number]),
        }
    }
    let shown = ranges.iter().take(SHOWN).map(|[first, last]| {
        if first == last {
            first.to_string()
        } else {
            format!("{first} to {last}")
        }
    });
    let mut text = shown.collect::<Vec<_>>().join(", ");
    if ranges.len() > SHOWN {
        text.push_str(", ...");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_told_as_ranges() {
        assert_eq!(ranges([3, 7, 8, 9, 11].into_iter()), "3, 7 to 9, 11");
        assert_eq!(ranges([5].into_iter()), "5");
        let even = ranges((0..40).map(|half| 2 * half));
        assert!(even.ends_with("20, 22, ..."), "{even}");
    }
}
