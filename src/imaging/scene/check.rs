//! Validation of a scene file that requires no other file.

use super::At;
use super::doubts;
use super::file::{SceneFile, VolumeSpec};
use crate::effects::table::{Contradiction, Origin, Origins};
use crate::effects::{Effects, Scanner};
use crate::synth::tables::ImageSize;
use insonify_anatomy::phantom::{self, Phantom};
use insonify_base::document::InputError;
use insonify_base::note::Notes;
use insonify_tracking::TrackingError;
use insonify_tracking::plus::PlusConfig;
use insonify_tracking::probe::{BeamGrid, ImageGrid, Probe, ProbeKind, ProbeSpec, Sampling};

/// Frame settings of a scene, independent of its content.
pub(super) struct Framing {
    pub probe: Probe,
    /// Whether the numbers of scanlines and samples are left open.
    pub open_grid: [bool; 2],
    /// Whether the depth is left open, over a volume of any depth.
    pub open_depth: bool,
    pub grid: BeamGrid,
    pub image: ImageSize,
    pub scanner: Scanner,
    pub effects: Effects,
    pub origins: Origins,
}

impl SceneFile {
    /// Checks probe, image, effects and the number of frames, and fills in open keys: those of the probe first from
    /// the configuration of a recording.
    pub(super) fn framing(
        &self,
        plus: Option<&PlusConfig>,
        notes: &mut Notes,
        warnings: &mut Vec<String>,
    ) -> Result<Framing, InputError> {
        self.in_ranges("quality", self.quality.as_ref())?;
        self.in_ranges("motion", self.motion.as_ref())?;
        let volume = self.volume()?;
        self.in_ranges("volume", volume)?;
        self.in_ranges("needle", self.needle.as_ref())?;
        let table = self.probe_table(plus, notes, warnings);
        let stated = table.as_ref().map(|table| table.sampling).unwrap_or_default();
        // What a recording has been made with is not guessed.
        let is_recorded = plus.is_some_and(|plus| plus.probe().kind.is_some());
        let probe = self.probe(table, volume.phantom, is_recorded, notes)?;
        if !is_recorded {
            warnings.extend(doubts::of_probe(&probe));
        }
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
        let (scanner, effects, origins) = self.called_for(probe.shape.kind(), notes)?;
        effects
            .validate()
            .map_err(|error| self.fault(format!("effects.{}", error.key), error))?;
        Ok(Framing {
            probe,
            open_grid: [stated.lines.is_none(), stated.samples.is_none()],
            open_depth: stated.depth_mm.is_none() && volume.phantom.is_none(),
            grid,
            image,
            scanner,
            effects,
            origins,
        })
    }

    /// The probe of a table. Keys that it leaves open are those of the usual probe of its kind or, if it states no
    /// kind, of the phantom; a table that `is_whole` is taken as it is.
    fn probe(
        &self,
        table: Option<ProbeSpec>,
        phantom: Option<Phantom>,
        is_whole: bool,
        notes: &mut Notes,
    ) -> Result<Probe, InputError> {
        let invalid = |error: TrackingError| self.fault(format!("probe.{}", error.key().unwrap_or_default()), error);
        let usual = usual_probe(phantom).map_err(invalid)?;
        let table = match table {
            None => return Ok(usual),
            Some(table) if is_whole => return Probe::try_from(table).map_err(invalid),
            Some(table) => table,
        };
        let kind = table.kind;
        let (table, taken) = table.filled_from(&kind.map_or(usual, ProbeKind::usual).shape_and_depth());
        if !taken.is_empty() {
            notes.push(format!(
                "the probe has {}, which `[probe]` leaves open",
                taken.join(", ")
            ));
        }
        let of_usual = usual.shape.numbers();
        let is_foreign = |(key, _): &(&str, f64)| of_usual.iter().all(|(other, _)| other != key);
        let is_of_another = kind.is_none() && table.shape.iter().any(is_foreign);
        Probe::try_from(table).map_err(|error| {
            invalid(error).with_help(is_of_another.then(|| "or state the `kind` that has it".to_owned()))
        })
    }

    /// Scanner and effects that the scene calls for, and their origins.
    fn called_for(&self, kind: ProbeKind, notes: &mut Notes) -> Result<(Scanner, Effects, Origins), InputError> {
        let table = self.effects.clone().unwrap_or_default();
        // Without `[effects]` a scene of any version has the usual ones: keys that are only set change those alone.
        let is_stated = self.effects.is_some() && self.source.as_ref().is_none_or(|source| source.states("effects"));
        let is_old = self.version.is_some_and(|version| version.number() == 1);
        let excluding = is_stated && is_old;
        let scanner = self.scanner.unwrap_or(match kind {
            _ if is_old || table.only.is_some() => Scanner::Raw,
            ProbeKind::Curvilinear | ProbeKind::Linear => Scanner::Clinical,
            _ => Scanner::Raw,
        });
        let (effects, origins) = table
            .resolve((!excluding).then_some((scanner, kind)))
            .map_err(|error| self.contradiction(error))?;
        if is_stated && self.version.is_none() {
            notes.extend(table.formerly((scanner, kind)));
        }
        let exact = match &table.only {
            Some(_) => Some("`effects.only` lists all effects"),
            None => excluding.then_some("with `version = 1` `[effects]` names all effects"),
        };
        if let (Some(Scanner::Clinical), Some(exact)) = (self.scanner, exact) {
            notes.push(format!("`scanner = \"clinical\"` adds nothing, as {exact}"));
        }
        // A picture without log compression looks like a fault; who says `tone = false` means it.
        let is_left_out = matches!(origins.get("tone"), Some(Origin::Unlisted | Origin::Unnamed));
        if is_left_out && origins.values().any(|origin| origin.is_on()) {
            notes.push(
                "the log compression of `tone` is off, as `[effects]` names others: grey levels are linear in amplitude".to_owned(),
            );
        }
        Ok((scanner, effects, origins))
    }

    fn contradiction(&self, Contradiction { effect, is_listed }: Contradiction) -> InputError {
        let line = self.source.as_ref().and_then(|source| source.line_of("effects.only"));
        let only = line.map_or("`only`".to_owned(), |line| format!("`only` (line {line})"));
        let (found, expected) = if is_listed {
            (
                format!("`{effect} = false`, and \"{effect}\" in {only}"),
                "one of them".to_owned(),
            )
        } else {
            (
                format!("`{effect}`, which {only} does not list"),
                format!("\"{effect}\" in `only` too, or nothing of it"),
            )
        };
        self.wrong_keys(format!("effects.{effect}"), found, expected)
    }

    /// Returns the volume table after checking that it names exactly one volume and no key that does not apply to
    /// it.
    pub(super) fn volume(&self) -> Result<&VolumeSpec, InputError> {
        const EXPECTED: &str = "exactly one of `phantom = \"abdomen\"` (or another) and `file = \"labels.nii.gz\"`";
        let volume = self.volume.as_ref();
        let with_kind = volume.and_then(|volume| Some((volume, volume.kind()?)));
        let (volume, kind) = with_kind.ok_or_else(|| {
            let found = match volume.and_then(|volume| volume.phantom) {
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
        ..ProbeSpec::default()
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
