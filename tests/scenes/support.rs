//! Small scenes and what tests do with them.

use insonify_anatomy::volume::{Label, LabelVolume, save};
use insonify_base::document::InputError;
use std::path::Path;

use insonify_imaging::effects::EffectName;
use insonify_imaging::effects::table::Stated;
use insonify_imaging::scene::{DEFAULT, Scene, SceneFile};
use insonify_imaging::synth::{Backend, Frame, FrameState, Synthesizer};
use nalgebra::{Matrix4, Point3};

/// A phantom scene that resolves in milliseconds, with more text behind it.
pub(super) fn small(more: &str) -> String {
    format!("version = 2\n[volume]\nphantom = \"abdomen\"\nresolution_mm = 5\n{more}\n")
}

pub(super) fn parse(text: &str) -> Result<SceneFile, InputError> {
    SceneFile::parse(text, "test.toml")
}

pub(super) fn resolve(text: &str) -> Result<Scene, InputError> {
    parse(text).and_then(|file| file.resolve(Path::new(".")))
}

/// The error of a scene that must have one.
pub(super) fn fault(text: &str) -> InputError {
    match resolve(text) {
        Ok(_) => panic!("no error for:\n{text}"),
        Err(error) => error,
    }
}

/// Coarse enough for a frame in well under a second.
pub(super) fn shrink(file: &mut SceneFile) {
    if let Some(volume) = &mut file.volume
        && volume.phantom.is_some()
    {
        volume.resolution_mm = Some(3.0);
    }
    if let Some(probe) = &mut file.probe {
        (probe.sampling.lines, probe.sampling.samples) = (Some(64), Some(128));
    }
    let image = file.image.get_or_insert_default();
    (image.width, image.height) = (120, 90);
}

/// Takes the solid textures away, which take seconds to make.
pub(super) fn without_textures(file: &mut SceneFile) {
    let effects = file.effects.get_or_insert_default();
    match &mut effects.only {
        Some(only) => only.retain(|effect| *effect != EffectName::texture),
        None => effects.texture = Some(Stated::Switch(false)),
    }
}

pub(super) fn synthesizer(scene: &Scene) -> Synthesizer {
    Synthesizer::new(scene.anatomy.clone(), scene.settings.clone(), Backend::Cpu).expect("synthesizer")
}

pub(super) fn render(scene: &Scene, synthesizer: &mut Synthesizer, frame: usize, of: usize) -> Frame {
    let mut state = FrameState::at(Matrix4::identity());
    scene.state(frame, of, &mut state).expect("state");
    synthesizer.render(&state).expect("frame").clone()
}

pub(super) use insonify_testing::shared as data;

/// The default scene with every key that it shows in a comment put in force.
pub(super) fn uncommented() -> String {
    let reveal = |line: &str| match line.strip_prefix('#') {
        Some(rest) if rest.starts_with(|c: char| c.is_ascii_lowercase() || c == '[') => rest.to_owned(),
        _ => line.to_owned(),
    };
    DEFAULT.lines().map(reveal).collect::<Vec<_>>().join("\n")
}

/// A label file in a folder of its own.
pub(super) struct Labelled(tempfile::TempDir);

impl Labelled {
    /// A scene of the file, with more text behind it.
    pub(super) fn scene(&self, more: &str) -> String {
        let path = self.0.path().join("labels.nrrd").display().to_string();
        let (volume, tables) = more.split_at(more.find('[').unwrap_or(more.len()));
        format!("version = 2\n[volume]\nfile = {path:?}\n{volume}\n{tables}\n")
    }
}

/// Saves a volume of some extent and spacing (mm) about the origin whose labels 1, 2, ... have these names; one
/// without a name is left out.
pub(super) fn labelled(
    extent_mm: [f64; 3],
    spacing_mm: f64,
    names: &[&str],
    label_at: impl Fn(Point3<f64>) -> u8,
) -> Labelled {
    let size = extent_mm.map(|mm| (mm / spacing_mm) as usize);
    let first = extent_mm.map(|mm| 0.5 * (spacing_mm - mm));
    let voxels = (0..size.iter().product::<usize>()).map(|voxel| {
        let index = [voxel % size[0], voxel / size[0] % size[1], voxel / (size[0] * size[1])];
        let label = label_at(
            [0, 1, 2]
                .map(|axis| first[axis] + spacing_mm * index[axis] as f64)
                .into(),
        );
        if label > 0 && names[usize::from(label) - 1].is_empty() {
            0
        } else {
            label
        }
    });
    let voxels: Vec<u8> = voxels.collect();
    let labels = (0u8..).zip([""].iter().chain(names)).map(|(label, name)| Label {
        value: i64::from(label),
        name: (!name.is_empty()).then(|| (*name).to_owned()),
        voxels: voxels.iter().filter(|voxel| **voxel == label).count() as u64,
    });
    let labels = labels.collect();
    let to_world = Matrix4::new_translation(&first.into()) * Matrix4::new_scaling(spacing_mm);
    let volume = LabelVolume::new(size, voxels, labels, to_world).expect("a volume");
    let folder = tempfile::tempdir().expect("a folder");
    save(&volume, &folder.path().join("labels.nrrd")).expect("saved");
    Labelled(folder)
}
