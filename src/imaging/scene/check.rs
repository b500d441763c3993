//! Validation of a scene file that requires no other file.

use super::At;
use super::file::{SceneFile, VolumeSpec};
use crate::effects::Effects;
use crate::synth::tables::ImageSize;
use insonify_anatomy::phantom::{self, Phantom};
use insonify_base::document::InputError;
use insonify_tracking::TrackingError;
use insonify_tracking::plus::PlusConfig;
use insonify_tracking::probe::{BeamGrid, ImageGrid, Probe, ProbeKind, ProbeSpec, Sampling};

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

/// Default probe: the one that matches a phantom's default pose; for files that of the default phantom, deep and
/// curvilinear.
fn usual_probe(phantom: Option<Phantom>) -> Result<Probe, TrackingError> {
    let usual = phantom::usual_probe(phantom.unwrap_or_default());
    let mut kinds = ProbeKind::ALL.iter().copied();
    Probe::try_from(ProbeSpec {
        kind: kinds.find(|kind| kind.name() == usual.kind),
        shape: usual.numbers.to_vec(),
        sampling: Sampling {
            depth_mm: Some(usual.depth_mm),
            ..Sampling::default()
        },
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_phantom_names_a_probe_that_there_is() {
        for &phantom in Phantom::ALL {
            let probe = usual_probe(Some(phantom)).unwrap_or_else(|error| panic!("{phantom:?}: {error}"));
            let kind = phantom::usual_probe(phantom).kind;
            assert_eq!(probe.shape.kind().name(), kind, "{phantom:?}");
        }
    }
}
