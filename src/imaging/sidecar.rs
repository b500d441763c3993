//! JSON sidecar of a frame with its parameters and geometry: ground truth for training models.

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use nalgebra::{Matrix4, Point3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use insonify_base::matrix::Rows;
use insonify_base::output::{OutputError, atomic};
use insonify_tracking::needle::NeedlePose;
use insonify_tracking::pose::Pose;
use insonify_tracking::probe::ImageGrid;

/// Version of the sidecar layout.
pub const VERSION: u32 = 2;

/// Metadata of one frame. Lengths are millimetres, the world is LPS, matrices act on column vectors.
/// ```
/// use insonify_base::matrix::Rows;
/// use insonify_imaging::scene::SceneFile;
/// use insonify_imaging::sidecar::{Files, ImagePlace, Sidecar, VERSION};
/// use insonify_tracking::probe::ImageGrid;
///
/// let text = "volume = { phantom = \"two-layer\", resolution_mm = 4.0 }\n";
/// let scene = SceneFile::parse(text, "scene.toml")?.resolve(".".as_ref())?;
/// let pose = scene.probe_pose(0, 1);
/// let grid = ImageGrid::new(320, 240, 0.5, [-79.75, 0.25])?;
/// let sidecar = Sidecar {
///     version: VERSION,
///     frame: 0,
///     time_s: 0.0,
///     seed: scene.settings.seed,
///     frame_parameters: scene.parameters(0, 1)?,
///     files: Files { image: Some("frame.png".into()), ..Files::default() },
///     image: ImagePlace::new(&grid, &pose),
///     probe_to_world: Rows(*pose.probe_to_world()),
///     needle: None,
///     parameters: Some(serde_json::to_value(&scene.file)?),
///     parameters_file: None,
///     warnings: scene.warnings.clone(),
///     made_by: None,
/// };
/// let folder = tempfile::tempdir()?;
/// let path = Sidecar::path_for(&folder.path().join("frame.png"));
/// sidecar.write(&path)?;
/// assert_eq!(path.extension(), Some("json".as_ref()));
/// assert_eq!(serde_json::from_str::<Sidecar>(&std::fs::read_to_string(&path)?)?, sidecar);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Sidecar {
    /// Version of the layout.
    pub version: u32,
    /// Frame number, from 0.
    pub frame: usize,
    /// Time of the frame, s.
    pub time_s: f64,
    /// Seed of all random numbers of the frame.
    pub seed: u64,
    /// Parameters of this frame alone, by the path of their keys in the scene: those of its row or drawn.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub frame_parameters: BTreeMap<String, serde_json::Value>,
    /// Files of the picture and layers.
    pub files: Files,
    /// Geometry of the pixels.
    pub image: ImagePlace,
    /// Transform from the probe frame to the world.
    pub probe_to_world: Rows,
    /// The needle, if the scene has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub needle: Option<NeedlePlace>,
    /// All parameters of the scene with defaults filled in, and the table of labels with their tissues.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub parameters: Option<serde_json::Value>,
    /// Path of the file with these parameters, relative to this one, if many frames share them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub parameters_file: Option<String>,
    /// Warnings about the frame.
    pub warnings: Vec<String>,
    /// Program, backend and input files that made the frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub made_by: Option<Provenance>,
}

/// Program, backend and inputs of a run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Provenance {
    /// Name of the program.
    pub program: String,
    /// Its version.
    pub version: String,
    /// Commit of its sources, where the build knows it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub commit: Option<String>,
    /// Backend: `cpu`, `cpu-f64` or `gpu`.
    pub backend: String,
    /// Adapter of a GPU.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub adapter: Option<String>,
    /// Files that were read.
    pub inputs: Vec<InputFile>,
}

/// A file that a run read.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct InputFile {
    /// Path as it was opened.
    pub path: String,
    /// BLAKE3 hash of its contents, hexadecimal.
    pub blake3: String,
}

/// Names of a frame's files, relative to the sidecar.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Files {
    /// Grey picture; `None` if frames go into one sequence file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub image: Option<String>,
    /// Ground-truth layers.
    pub layers: Vec<LayerFile>,
    /// Whether depth scale, grey bar, mark and focus are drawn over the picture.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub overlay: bool,
}

/// File of one ground-truth layer.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LayerFile {
    /// Name of the layer: `label-value`, `label-index`, `sector`, `displacement`, `depth`, `needle`, `loss`, `organ`.
    pub name: String,
    /// Path of its file: a picture, or a sequence with one image per frame.
    pub path: String,
}

/// Geometry of a frame's pixels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ImagePlace {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Side of a pixel, mm.
    pub pixel_mm: f64,
    /// Transform from the image frame (pixels, orientation MF, integer coordinates at pixel centres) to the world.
    pub image_to_world: Rows,
}

/// Position of the needle in the world and in the picture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NeedlePlace {
    /// Tip in the world, mm.
    pub tip_mm: [f64; 3],
    /// Orthogonal projection of the tip onto the image plane: column and row, which may lie outside the picture.
    pub tip_px: [f64; 2],
    /// Signed distance of the tip from the image plane, mm, positive along the probe's z.
    pub tip_out_of_plane_mm: f64,
    /// Whether the projected tip lies within the picture.
    pub tip_in_picture: bool,
    /// Direction of the tip in the world.
    pub direction: [f64; 3],
    /// Shaft in the world, hub first, mm.
    pub shaft_mm: Vec<[f64; 3]>,
    /// Diameter, mm.
    pub diameter_mm: f64,
    /// Distance of the tip from the nearest critical structure in the anatomy at rest, mm; 0 inside one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub clearance_mm: Option<f64>,
}

impl ImagePlace {
    /// Returns the geometry of a grid for a probe pose.
    pub fn new(grid: &ImageGrid, pose: &Pose) -> Self {
        Self {
            width: grid.width(),
            height: grid.height(),
            pixel_mm: grid.pixel_mm(),
            image_to_world: Rows(image_to_world(grid, pose)),
        }
    }
}

/// Transform from the image frame (pixels) to the world (mm) for a probe pose.
pub fn image_to_world(grid: &ImageGrid, pose: &Pose) -> Matrix4<f64> {
    pose.probe_to_world() * grid.image_to_probe()
}

impl NeedlePlace {
    /// Returns the position of a needle in the world and in the pixels of a probe pose.
    pub fn new(needle: &NeedlePose, grid: &ImageGrid, pose: &Pose) -> Self {
        let tip = needle.tip_mm();
        let in_probe: Point3<f64> = pose.world_to_probe().transform_point(&tip);
        let tip_px = grid.to_pixel(in_probe.x, in_probe.y);
        let inside = |coordinate: f64, pixels: usize| coordinate >= -0.5 && coordinate < pixels as f64 - 0.5;
        Self {
            tip_mm: tip.into(),
            tip_px,
            tip_out_of_plane_mm: in_probe.z,
            tip_in_picture: inside(tip_px[0], grid.width()) && inside(tip_px[1], grid.height()),
            direction: needle.direction().into_inner().into(),
            shaft_mm: needle.nodes_mm().iter().map(|&node| node.into()).collect(),
            diameter_mm: needle.diameter_mm(),
            clearance_mm: None,
        }
    }
}

impl Sidecar {
    /// Writes the sidecar as indented JSON. The write is atomic.
    pub fn write(&self, path: &Path) -> Result<(), OutputError> {
        atomic::write(path, |file| {
            serde_json::to_writer_pretty(&mut *file, self).map_err(io::Error::from)?;
            file.write_all(b"\n")
        })
    }

    /// Path of the sidecar of a frame's picture: beside it, with the extension `json`.
    pub fn path_for(image: &Path) -> PathBuf {
        image.with_extension("json")
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;

    fn example() -> Sidecar {
        let pose = Pose::from_direction(Point3::new(10.0, -80.0, 5.0), Vector3::y(), Some(Vector3::x())).expect("pose");
        let grid = ImageGrid::new(200, 100, 0.5, [-49.75, 0.25]).expect("grid");
        let tip = Point3::new(20.0, -50.0, 8.0);
        let needle = NeedlePose::straight(tip, Vector3::new(1.0, 1.0, 0.0), 100.0, 1.2).expect("needle");
        Sidecar {
            version: VERSION,
            frame: 7,
            time_s: 0.7,
            seed: u64::MAX,
            frame_parameters: [("effects.tone.gain_db".to_owned(), 3.5.into())].into(),
            files: Files {
                image: Some("frame_0007.png".into()),
                layers: vec![LayerFile {
                    name: "depth".into(),
                    path: "frame_0007_depth.png".into(),
                }],
                overlay: false,
            },
            image: ImagePlace::new(&grid, &pose),
            probe_to_world: Rows(*pose.probe_to_world()),
            needle: Some(NeedlePlace::new(&needle, &grid, &pose)),
            parameters: Some(serde_json::json!({ "speckle": { "axial_mm": 0.4 } })),
            parameters_file: None,
            warnings: vec!["the probe is outside the volume".into()],
            made_by: Some(Provenance {
                program: "insonify".into(),
                version: "0.1.0".into(),
                commit: None,
                backend: "cpu".into(),
                adapter: None,
                inputs: vec![InputFile {
                    path: "labels.nii.gz".into(),
                    blake3: "af13".into(),
                }],
            }),
        }
    }

    #[test]
    fn a_written_sidecar_reads_back_equal() {
        let folder = tempfile::tempdir().expect("folder");
        let path = Sidecar::path_for(&folder.path().join("frame_0007.png"));
        let sidecar = example();
        sidecar.write(&path).expect("written");
        let text = std::fs::read_to_string(path.with_file_name("frame_0007.json")).expect("text");
        assert_eq!(serde_json::from_str::<Sidecar>(&text).expect("json"), sidecar);
    }

    #[test]
    fn the_tip_is_where_its_pixel_says() {
        let sidecar = example();
        let needle = sidecar.needle.expect("needle");
        // 10 mm towards the marked side and 30 mm deep, so 3 mm behind a plane whose z is x cross y.
        assert!((needle.tip_out_of_plane_mm - 3.0).abs() < 1e-12);
        assert!(needle.tip_in_picture);
        let [column, row] = needle.tip_px;
        assert!(
            (column - 119.5).abs() < 1e-9 && (row - 59.5).abs() < 1e-9,
            "{column} {row}"
        );
        let matrix = sidecar.image.image_to_world.0;
        let back = matrix.transform_point(&Point3::new(column, row, needle.tip_out_of_plane_mm / 0.5));
        assert!((back - Point3::from(needle.tip_mm)).norm() < 1e-9);
    }

    #[test]
    fn an_unwritable_place_is_an_error() {
        assert!(example().write(Path::new("/proc/none/frame.json")).is_err());
    }
}
