//! Poses of a marker from a tracked sequence or a CSV file.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use nalgebra::{Matrix3, Matrix4, Vector3};

use crate::TrackingError;
use crate::sequence::{Sequence, TrackedTransform, chain, ends, merged};
use crate::trajectory::{Interpolation, Key, Trajectory};
use crate::world::World;
use insonify_base::matrix;
use insonify_base::text::some_of;

/// Pose of a marker in one frame.
#[derive(Clone, Copy, Debug)]
pub struct MarkerPose {
    /// Frame or row of the input, from 0.
    pub frame: usize,
    /// Rotation from the marker's frame to the tracker's.
    pub rotation: Matrix3<f64>,
    /// Position of the marker in the tracker's frame, mm.
    pub position: Vector3<f64>,
}

impl MarkerPose {
    /// A pose from a rigid transform.
    pub fn new(frame: usize, matrix: &Matrix4<f64>) -> Self {
        Self {
            frame,
            rotation: matrix.fixed_view::<3, 3>(0, 0).into_owned(),
            position: matrix.fixed_view::<3, 1>(0, 3).into_owned(),
        }
    }
}

/// Poses of a marker.
#[derive(Clone, Debug)]
pub struct Poses {
    /// Valid poses.
    pub poses: Vec<MarkerPose>,
    /// Number of frames without a valid pose.
    pub skipped: usize,
    /// Name of the marker's frame.
    pub marker: String,
    /// Name of the frame that the poses lead to.
    pub tracker: String,
}

impl Poses {
    /// Reads poses from a CSV file as a path of the probe: `time_s` with `m00` to `m33` (row major, mm), or with a
    /// position and a quaternion or direction.
    ///
    /// # Errors
    /// [`TrackingError`] with the line, what was found and what was expected.
    pub fn from_csv(path: &Path, transform: Option<&str>) -> Result<Self, TrackingError> {
        let (marker, tracker) = parts(transform.unwrap_or("MarkerToTracker"))?;
        let path = Trajectory::from_csv(path, World::Lps, Interpolation::Linear)?;
        let pose = |key: &Key| MarkerPose::new(key.source, key.pose.probe_to_world());
        Ok(Self {
            poses: path.keys().iter().map(pose).collect(),
            skipped: 0,
            marker: marker.to_owned(),
            tracker: tracker.to_owned(),
        })
    }

    /// Poses of a sequence that was read from `path`: the named transform, composed of those of each frame and
    /// `defined` ones where need be. Without a name the only transform to the tracker is taken.
    ///
    /// # Errors
    /// [`TrackingError`] if the sequence has no such transform, or several of which none is named.
    pub fn from_sequence(
        sequence: &Sequence,
        path: &Path,
        transform: Option<&str>,
        defined: &BTreeMap<String, TrackedTransform>,
    ) -> Result<Self, TrackingError> {
        let names: BTreeSet<&String> = sequence
            .frames
            .iter()
            .flat_map(|frame| frame.transforms.keys())
            .chain(defined.keys())
            .collect();
        // A set first: most names occur in every frame.
        let names: Vec<String> = names.into_iter().cloned().collect();
        let listed = || {
            if names.is_empty() {
                "none".to_owned()
            } else {
                some_of(&names)
            }
        };
        let tracked: Vec<&String> = names.iter().filter(|name| name.ends_with("ToTracker")).collect();
        let name = match (transform, &tracked[..]) {
            (Some(name), _) => name.to_owned(),
            (None, [only]) => (*only).clone(),
            (None, _) => {
                let text = format!(
                    ": its transforms are {}; expected the name of one (--transform)",
                    listed()
                );
                return Err(TrackingError::file(path, text));
            }
        };
        let name = &name;
        // A transform named after its node joins two frames without names.
        let nameless = || names.contains(name).then_some((name.as_str(), "Tracker"));
        let (marker, tracker) = ends(name).or_else(nameless).map_or_else(|| parts(name), Ok)?;
        let mut poses = Vec::new();
        for frame in &sequence.frames {
            let matrix = match ends(name) {
                Some(_) => chain(&merged(&frame.transforms, defined), marker, tracker),
                None => frame
                    .transforms
                    .get(name)
                    .filter(|known| known.valid)
                    .map(|known| known.matrix),
            };
            poses.extend(
                matrix
                    .and_then(|matrix| matrix::rigid(&matrix).ok())
                    .map(|matrix| MarkerPose::new(frame.index, &matrix)),
            );
        }
        if poses.is_empty() {
            let text = format!(
                ": none of its {} frames has a valid `{name}`; its transforms are {}",
                sequence.frames.len(),
                listed()
            );
            return Err(TrackingError::file(path, text));
        }
        Ok(Self {
            skipped: sequence.frames.len() - poses.len(),
            poses,
            marker: marker.to_owned(),
            tracker: tracker.to_owned(),
        })
    }

    /// Pose of a frame.
    pub fn get(&self, frame: usize) -> Option<&MarkerPose> {
        let index = self.poses.binary_search_by_key(&frame, |pose| pose.frame);
        index.ok().map(|index| &self.poses[index])
    }
}

/// Frames that a transform's name joins.
fn parts(name: &str) -> Result<(&str, &str), TrackingError> {
    let wrong = || TrackingError::new(format!("transform `{name}`; expected a name such as StylusToTracker"));
    ends(name).ok_or_else(wrong)
}
