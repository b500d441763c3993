//! Validation of a scene file that requires no other file.

use super::At;
use super::file::{SceneFile, VolumeSpec};
use crate::effects::Effects;
use crate::synth::tables::ImageSize;
use insonify_anatomy::phantom::Phantom;
use insonify_base::document::InputError;
use insonify_tracking::plus::PlusConfig;
use insonify_tracking::probe::{BeamGrid, Curvilinear, ImageGrid, Linear, Probe, ProbeShape, TrusTransverse};

/// Frame settings of a scene, independent of its content.
pub(super) struct Framing {
    pub probe: Probe,
    /// Whether the numbers of scanlines and samples are left open.
    pub open_grid: [bool; 2],
    pub grid: BeamGrid,
    pub image: ImageSize,
    pub effects: Effects,
}

impl SceneFile {
    /// Checks probe, image, effects and the number of frames, and fills in open keys: those of the probe first from
    /// the configuration of a recording.
    pub(super) fn framing(
        &self,
        plus: Option<&PlusConfig>,
        notes: &mut Vec<String>,
        warnings: &mut Vec<String>,
    ) -> Result<Framing, InputError> {
        self.in_ranges("quality", self.quality.as_ref())?;
        self.in_ranges("motion", self.motion.as_ref())?;
        let volume = self.volume()?;
        self.in_ranges("volume", volume)?;
        self.in_ranges("needle", self.needle.as_ref())?;
        let table = self.probe_table(plus, notes, warnings);
        let stated = table.as_ref().map(|table| table.sampling).unwrap_or_default();
        let probe = match table {
            Some(spec) => Probe::try_from(spec),
            None => usual_probe(volume.phantom),
        };
        let probe = probe.map_err(|error| self.fault(format!("probe.{}", error.key().unwrap_or_default()), error))?;
        let grid = BeamGrid::new(&probe).at(self, "probe")?;
        let image = self.image.unwrap_or_default();
        let image = ImageSize {
            width: image.width as usize,
            height: image.height as usize,
            margin: image.margin,
            fill: image.fill,
            placed: None,
        };
        // For its error alone: a fault here names a key of the scene, one while rendering could not.
        ImageGrid::fit(&grid, image.width, image.height, image.margin).map_err(|error| {
            let key = error.key().map_or("image".to_owned(), |key| format!("image.{key}"));
            self.fault(key, error)
        })?;
        let effects = self.effects.clone().unwrap_or_else(Effects::usual);
        // Naming one effect switches the others off; a picture without log compression looks like a fault.
        if effects.tone.is_none() && effects != Effects::default() {
            notes.push(
                "effects that `[effects]` does not name are off, the log compression of `tone` among them: grey levels are linear \
                 in amplitude"
                    .to_owned(),
            );
        }
        effects
            .validate()
            .map_err(|error| self.fault(format!("effects.{}", error.key), error))?;
        Ok(Framing {
            probe,
            open_grid: [stated.lines.is_none(), stated.samples.is_none()],
            grid,
            image,
            effects,
        })
    }

    /// Returns the volume table after checking that it names exactly one volume and no key that does not apply to
    /// it.
    pub(super) fn volume(&self) -> Result<&VolumeSpec, InputError> {
        const EXPECTED: &str = "exactly one of `phantom = \"abdomen\"` (or another) and `file = \"labels.nii.gz\"`";
        let Some(volume) = &self.volume else {
            return Err(self.wrong_keys("volume", "no `[volume]`", EXPECTED));
        };
        let kind = volume.kind().ok_or_else(|| {
            let found = match volume.phantom {
                Some(_) => "both `phantom` and `file`",
                None => "neither `phantom` nor `file`",
            };
            self.wrong_keys("volume", found, EXPECTED)
        })?;
        self.of_kind("volume", volume, kind)?;
        Ok(volume)
    }
}

/// Default probe: the one that matches a phantom's default pose, and a deep curvilinear one for files.
fn usual_probe(phantom: Option<Phantom>) -> Result<Probe, insonify_tracking::TrackingError> {
    let (shape, depth_mm) = match phantom {
        None | Some(Phantom::Abdomen) => {
            let (radius_mm, angle_deg) = (60.0, 70.0);
            (ProbeShape::Curvilinear(Curvilinear { radius_mm, angle_deg }), 150.0)
        }
        Some(Phantom::Prostate) => {
            let (radius_mm, angle_deg) = (10.0, 160.0);
            (
                ProbeShape::TrusTransverse(TrusTransverse { radius_mm, angle_deg }),
                60.0,
            )
        }
        Some(Phantom::Spine) => {
            let (radius_mm, angle_deg) = (60.0, 60.0);
            (ProbeShape::Curvilinear(Curvilinear { radius_mm, angle_deg }), 100.0)
        }
        Some(Phantom::LiverVein) => {
            let (radius_mm, angle_deg) = (20.0, 75.0);
            (ProbeShape::Curvilinear(Curvilinear { radius_mm, angle_deg }), 62.0)
        }
        Some(Phantom::TwoLayer) => (ProbeShape::Linear(Linear { width_mm: 38.0 }), 75.0),
    };
    Probe::new(shape, depth_mm)
}
