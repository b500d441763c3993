//! Naming of labels by their values, and doubts about names.

use super::evidence::Fit;
use super::extent::Extents;
use super::{Naming, Segmentation};
use crate::acoustics::{Preset, known, numbering};
use crate::volume::LabelVolume;
use crate::volume::complete::has_body_values;
use insonify_base::text::some_of;

/// Number of labels with evidence for their organ from which a numbering is accepted without a warning.
pub(super) const ENOUGH: usize = 3;

/// Difference of scores below which a numbering fits as well as another.
const MARGIN: f64 = 1.0;

/// Score of a numbering that the file's name states.
const STATED: f64 = 3.0;

/// Tangent of the angle by which a body may be turned about its long axis before its orientation is questioned: 27
/// degrees.
const SLANT: f64 = 0.5;

/// Number of names that show how a numbering reads labels.
const FEW: usize = 4;

/// Number of faults of the usual numbering that tell why another was chosen.
const EXAMPLES: usize = 3;

/// Remedy for labels without names.
const REMEDY: &str = "name the labels with --names FILE or volume.names, choose another volume.preset, or write [[tissue]] with name and \
                      labels = [VALUE, ...]";

/// Whether a value is common in masks and thus carries no information.
pub(super) fn is_mask(value: i64) -> bool {
    matches!(value, 1 | 255)
}

/// A numbering that knows all labels without names.
struct Reading {
    preset: Preset,
    names: Vec<(usize, String)>,
    fit: Fit,
    /// Whether the file's name states the numbering.
    is_stated: bool,
}

impl Reading {
    fn is_sure(&self) -> bool {
        self.is_stated || (self.fit.sound.len() >= ENOUGH && 3 * self.fit.odd.len() < self.fit.sound.len())
    }

    fn name(&self, label: usize) -> Option<&str> {
        let mut names = self.names.iter();
        names.find(|(index, _)| *index == label).map(|(_, name)| name.as_str())
    }
}

impl Segmentation {
    /// Organ of a label by its value. Body values, which TotalSegmentator does not have, count only in a file that has
    /// a body.
    fn organ(&self, preset: Preset, index: usize) -> Option<&'static str> {
        let value = self.volume.labels()[index].value;
        let of_body = numbering::body().iter().any(|class| class.value == value);
        preset
            .organ(value)
            .filter(|_| !of_body || has_body_values(&self.volume))
    }

    /// Readings of labels by the numberings that know all of them, the most common first.
    fn readings(&self, nameless: &[usize], stem: Option<&str>, extents: &Extents) -> Vec<Reading> {
        let reading = |&preset: &Preset| {
            let organ = |&index: &usize| Some((index, self.organ(preset, index)?.to_owned()));
            let names: Vec<_> = nameless.iter().map(organ).collect::<Option<_>>()?;
            let mut fit = Fit::of(self.volume.labels(), extents, &names, 0.0);
            let is_stated = stem.is_some_and(|stem| preset.is_stated_by(stem));
            fit.score += if is_stated { STATED } else { 0.0 };
            Some(Reading {
                preset,
                names,
                fit,
                is_stated,
            })
        };
        Preset::NUMBERINGS.iter().filter_map(reading).collect()
    }

    /// Names the unnamed labels by their values, in the numbering that fits best. Without enough evidence they stay
    /// without a name, as do those of which as good a numbering makes another tissue. `stem` is the file's name without
    /// its ending.
    pub(super) fn read_values(&mut self, naming: &Naming, stem: Option<&str>, extents: &Extents) {
        let all: Vec<usize> = self.nameless(naming).collect();
        if naming.preset != Preset::Auto {
            return self.read_as(naming.preset, &all, &[]);
        }
        // Values unknown to every numbering do not prevent naming the others, if these give plausible organs.
        let numbered = |index: &usize| self.organ(Preset::TotalSegmentator, *index).is_some();
        let (nameless, strange): (Vec<usize>, Vec<usize>) = all.iter().partition(|index| numbered(index));
        let only_mask = self.volume.labels().len() == 2 && is_mask(self.volume.labels()[1].value);
        if only_mask {
            return;
        }
        let readings = self.readings(&nameless, stem, extents);
        let first = readings.first();
        let Some(best) = first
            .map(|first| readings.iter().fold(first, better))
            .filter(|_| !nameless.is_empty())
        else {
            return self.read_as(Preset::TotalSegmentator, &[], &strange);
        };
        let is_sure = best.is_sure();
        if !strange.is_empty() && !is_sure {
            return self.read_as(Preset::TotalSegmentator, &[], &strange);
        }
        let rivals: Vec<&Reading> = readings
            .iter()
            .filter(|rival| rival.names != best.names && rival.fit.score > best.fit.score - MARGIN)
            .collect();
        let tissue = |name: &str| known(name).map(|(tissue, _)| &tissue.name);
        let is_certain = |&label: &usize| {
            let agrees = |rival: &&Reading| rival.name(label).and_then(tissue) == best.name(label).and_then(tissue);
            is_sure && rivals.iter().all(agrees)
        };
        let (certain, doubtful): (Vec<usize>, Vec<usize>) = nameless.iter().partition(|label| is_certain(label));
        let verdict = Verdict {
            volume: &self.volume,
            best,
            rivals: &rivals,
            usual: readings.first().filter(|usual| usual.preset != best.preset),
            certain: &certain,
            doubtful: &doubtful,
        };
        if is_sure && doubtful.is_empty() {
            self.notes.push(verdict.note());
        } else {
            self.warnings.push(verdict.warning(is_sure));
        }
        let preset = best.preset;
        self.read_as(preset, &certain, &strange);
    }

    /// Names labels by the values of a numbering, with a warning about unknown values.
    fn read_as(&mut self, preset: Preset, nameless: &[usize], unknown: &[usize]) {
        let organs: Vec<_> = nameless.iter().map(|index| self.organ(preset, *index)).collect();
        let (mut values, mut strange) = (Vec::new(), unknown.to_vec());
        for (&index, organ) in nameless.iter().zip(organs) {
            match organ {
                Some(organ) => {
                    self.volume.name(index, organ.to_owned());
                    values.push(self.volume.labels()[index].value);
                }
                None => strange.push(index),
            }
        }
        if !strange.is_empty() && Preset::NUMBERINGS.contains(&preset) {
            let shown = |index: &usize| {
                let label = &self.volume.labels()[*index];
                let ml = label.voxels as f64 * self.volume.voxel_mm3() / 1000.0;
                format!("{} ({ml:.2} ml)", label.value)
            };
            let strange: Vec<String> = strange.iter().map(shown).collect();
            let (title, plural) = (preset.title(), if strange.len() == 1 { "" } else { "s" });
            self.warnings
                .push(format!("{title} has no label{plural} {}", some_of(&strange)));
        }
        if !values.is_empty() {
            self.by_value = Some((preset, values));
        }
    }

    /// Warnings about labels that are implausible for their names, and about a file that is turned or scaled.
    pub(super) fn doubts(&self, extents: &Extents) -> Vec<String> {
        let labels = self.volume.labels().iter().enumerate().skip(1);
        let names: Vec<(usize, String)> = labels
            .filter_map(|(index, label)| Some((index, label.name.clone()?)))
            .collect();
        let Fit {
            odd, turned, scaled, ..
        } = Fit::of(self.volume.labels(), extents, &names, SLANT);
        let remedy = match self.by_value {
            Some(_) => "name the labels with --names FILE, or choose another volume.preset",
            None => "check names, voxel spacing and orientation",
        };
        let odd: Vec<String> = odd.into_iter().map(|(_, odd)| odd).collect();
        let odd = (!odd.is_empty()).then(|| format!("{}: {remedy}", odd.join(", ")));
        let turned = turned.map(|turned| format!("{turned}: check its orientation, not its names"));
        let scaled = scaled.map(|scaled| format!("{scaled}: check the voxel spacing and its unit, not the names"));
        scaled.into_iter().chain(turned).chain(odd).collect()
    }
}

/// The reading with the higher score, or of equal ones the first.
fn better<'a>(best: &'a Reading, next: &'a Reading) -> &'a Reading {
    if next.fit.score > best.fit.score { next } else { best }
}

/// The numbering that labels without names are read by, with what speaks for and against it.
struct Verdict<'a> {
    volume: &'a LabelVolume,
    best: &'a Reading,
    /// Readings that fit as well and give other names.
    rivals: &'a [&'a Reading],
    /// Reading by the most common numbering, unless it is the best.
    usual: Option<&'a Reading>,
    /// Labels that are named, and those that stay without a name.
    certain: &'a [usize],
    doubtful: &'a [usize],
}

impl Verdict<'_> {
    fn reads_by(&self) -> String {
        let nameless = self.certain.len() + self.doubtful.len();
        let count = match nameless {
            1 => "1 label without a name".to_owned(),
            n => format!("{n} labels without names"),
        };
        let verb = match (self.certain.len(), nameless) {
            (0, _) => "may have",
            (_, 1) => "is read by",
            _ => "are read by",
        };
        format!("{count} {verb} the numbers of {}", self.best.preset.title())
    }

    /// Note about labels that are all named, with the reason if the numbering is not the usual one.
    fn note(&self) -> String {
        let by = self.reads_by();
        let Some(usual) = self.usual else {
            return by;
        };
        let (odd, title) = (&usual.fit.odd, usual.preset.title());
        if !odd.is_empty() {
            let examples: Vec<&str> = odd.iter().take(EXAMPLES).map(|(_, odd)| odd.as_str()).collect();
            let more = match odd.len() - examples.len() {
                0 => String::new(),
                n => format!(" and {n} more"),
            };
            format!("{by}: by those of {title}, {}{more}", examples.join(", "))
        } else if self.best.is_stated {
            format!("{by}, which the file's name states")
        } else {
            format!("{by}: they fit better than those of {title}")
        }
    }

    /// Warning about labels of which some or all stay without a name.
    fn warning(&self, is_sure: bool) -> String {
        let Self { best, rivals, .. } = self;
        let shown = |label: usize, name: &str| format!("{} {name}", self.volume.labels()[label].value);
        let names: Vec<String> = best.names.iter().map(|(label, name)| shown(*label, name)).collect();
        let more = if names.len() > FEW { ", ..." } else { "" };
        let names = names[..names.len().min(FEW)].join(", ");
        let mut text = format!("{} ({names}{more})", self.reads_by());
        if !is_sure {
            text.push_str(" on weak evidence");
        }
        if !rivals.is_empty() {
            let titles: Vec<String> = rivals.iter().map(|rival| rival.preset.title().to_owned()).collect();
            text.push_str(&format!("; those of {} fit as well", some_of(&titles)));
        }
        if !self.doubtful.is_empty() {
            let kept = if self.certain.is_empty() {
                "all stay"
            } else {
                "in doubt stay"
            };
            text.push_str(&format!("; {kept} without a name, as soft tissue"));
        }
        if !self.doubtful.is_empty() && !rivals.is_empty() {
            let unnamed: Vec<String> = self
                .doubtful
                .iter()
                .map(|&label| shown(label, &self.meanings(label).join(" or ")))
                .collect();
            text.push_str(&format!(": {}", some_of(&unnamed)));
        }
        format!("{text}: {REMEDY}")
    }

    /// Names that the best numbering and its rivals give a label.
    fn meanings(&self, label: usize) -> Vec<&str> {
        let mut meanings: Vec<&str> = Vec::new();
        for reading in std::iter::once(self.best).chain(self.rivals.iter().copied()) {
            let name = reading.name(label).unwrap_or_default();
            if !meanings.contains(&name) {
                meanings.push(name);
            }
        }
        meanings
    }
}
