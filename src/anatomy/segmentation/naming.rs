//! Naming of labels by their values, and doubts about names.

use super::evidence::{Fit, Frame};
use super::extent::Extents;
use super::{Naming, Segmentation};
use crate::acoustics::{Preset, known, numbering};
use crate::volume::LabelVolume;
use crate::volume::complete::has_body_values;
use insonify_base::text::{first_of, some_of};

/// Number of labels with evidence for their organ from which a numbering is accepted without a warning.
pub(super) const ENOUGH: usize = 3;

/// Difference of scores below which a numbering fits as well as another.
const MARGIN: f64 = 1.0;

/// Score of a numbering that the file's name states, and of each label that a numbering does not have.
const STATED: f64 = 3.0;
const UNKNOWN: f64 = -2.0;

/// Ratio of labels that a numbering has to others from which it is considered.
const KNOWN: usize = 3;

/// Ratio of labels with evidence to contradicted ones from which a numbering is accepted, and from which even the
/// contradicted ones keep their names: organs vary.
const ACCEPTED: usize = 3;
const CERTAIN: usize = 8;

/// Largest number of numberings that have all values of a file at which these values are evidence.
const RARE: usize = 3;

/// Tangent of the angle by which a body may be turned about its long axis before its orientation is questioned: 27
/// degrees.
const SLANT: f64 = 0.5;

/// Tissues that any organ may have in it.
const LESIONS: [&str; 2] = ["lesion", "cyst"];

/// Number of names that show how a numbering reads labels.
const FEW: usize = 4;

/// Number of faults that tell what speaks against a numbering.
const EXAMPLES: usize = 3;

/// Whether a value is common in masks and thus carries no information.
pub(super) fn is_mask(value: i64) -> bool {
    matches!(value, 1 | 255)
}

/// Labels without names as a numbering has them.
struct Reading {
    preset: Preset,
    names: Vec<(usize, String)>,
    /// Labels that the numbering does not have.
    unknown: Vec<usize>,
    fit: Fit,
    /// Whether the file's name states the numbering.
    is_stated: bool,
}

impl Reading {
    fn is_sure(&self) -> bool {
        let odd = self.odd().len();
        if self.is_stated {
            return 2 * odd < self.names.len();
        }
        self.fit.sound.len() >= ENOUGH && ACCEPTED * odd < self.fit.sound.len() && !self.fit.is_scattered
    }

    /// Labels that contradict their names.
    fn odd(&self) -> Vec<usize> {
        let odd = self.fit.odd.iter().chain(&self.fit.elsewhere);
        let mut labels: Vec<usize> = odd.map(|(label, _)| *label).collect();
        labels.sort_unstable();
        labels.dedup();
        labels
    }

    /// What speaks against the names.
    fn against(&self) -> impl Iterator<Item = &str> {
        let odd = self.fit.odd.iter().chain(&self.fit.elsewhere);
        odd.map(|(_, text)| text.as_str())
    }

    fn name(&self, label: usize) -> Option<&str> {
        let mut names = self.names.iter();
        names.find(|(index, _)| *index == label).map(|(_, name)| name.as_str())
    }

    fn tissue(&self, label: usize) -> Option<&str> {
        self.name(label).and_then(known).map(|(tissue, _)| tissue.name.as_ref())
    }

    /// Labels that this best of the readings names: of a sure one, those on which its rivals agree and that do not
    /// contradict their names; otherwise, of values that few numberings have, those with evidence on which all agree
    /// that nothing contradicts.
    fn certain(&self, readings: &[Self], rivals: &[&Self]) -> Vec<usize> {
        let labels = self.names.iter().map(|(label, _)| *label);
        let agree = |label: usize, others: &[&Self]| {
            let tissue = self.tissue(label);
            others.iter().all(|other| other.tissue(label) == tissue)
        };
        let odd = self.odd();
        if self.is_sure() {
            let keeps_odd = self.fit.sound.len() >= CERTAIN * odd.len();
            return labels
                .filter(|&label| agree(label, rivals) && (keeps_odd || !odd.contains(&label)))
                .collect();
        }
        let believable: Vec<&Self> = readings.iter().filter(|reading| reading.odd().is_empty()).collect();
        let is_evident = odd.is_empty() && readings.len() <= RARE && self.fit.sound.len() >= 2;
        labels
            .filter(|&label| is_evident && self.fit.sound.contains(&label) && agree(label, &believable))
            .collect()
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

    /// Readings of labels by the numberings that have all of them, or enough, the most common first.
    fn readings(&self, nameless: &[usize], stem: Option<&str>, extents: &Extents) -> Vec<Reading> {
        let reading = |&preset: &Preset| {
            let (numbered, unknown): (Vec<usize>, Vec<usize>) =
                nameless.iter().partition(|index| self.organ(preset, **index).is_some());
            let organ = |&index: &usize| Some((index, self.organ(preset, index)?.to_owned()));
            let names: Vec<_> = numbered.iter().filter_map(organ).collect();
            // Files of TotalSegmentator are those that others add labels to.
            let knows_enough = names.len() >= KNOWN * unknown.len() || preset == Preset::TotalSegmentator;
            if names.is_empty() || !knows_enough {
                return None;
            }
            let is_stated = stem.is_some_and(|stem| preset.is_stated_by(stem));
            // Of lesions there is no evidence: where most labels are such, the file's name has to say so.
            let is_lesion = |name: &str| known(name).is_some_and(|(tissue, _)| LESIONS.contains(&&*tissue.name));
            let lesions = names.iter().filter(|(_, name)| is_lesion(name)).count();
            if 2 * lesions > names.len() && !is_stated {
                return None;
            }
            let mut fit = Fit::of(&self.volume, extents, &names, Frame::Body);
            fit.score += if is_stated { STATED } else { 0.0 } + UNKNOWN * unknown.len() as f64;
            Some(Reading {
                preset,
                names,
                unknown,
                fit,
                is_stated,
            })
        };
        Preset::NUMBERINGS.iter().filter_map(reading).collect()
    }

    /// Names the unnamed labels by their values, in the numbering that fits best. Without enough evidence they stay
    /// without a name, as do those of which as good a numbering makes another tissue, and those that contradict their
    /// names. `stem` is the file's name without its ending.
    pub(super) fn read_values(&mut self, naming: &Naming, stem: Option<&str>, extents: &Extents) {
        let nameless: Vec<usize> = self.nameless(naming).collect();
        if naming.preset != Preset::Auto {
            return self.read_as(naming.preset, &nameless, &[]);
        }
        // Values unknown to every numbering do not prevent naming the others, if these give plausible organs.
        let usual = Preset::TotalSegmentator;
        let is_strange = |index: &usize| self.organ(usual, *index).is_none();
        let strange: Vec<usize> = nameless.iter().copied().filter(is_strange).collect();
        let only_mask = self.volume.labels().len() == 2 && is_mask(self.volume.labels()[1].value);
        if only_mask {
            return;
        }
        let readings = self.readings(&nameless, stem, extents);
        let Some(best) = best(&readings).filter(|best| strange.is_empty() || best.is_sure()) else {
            return self.read_as(usual, &[], &strange);
        };
        let top = readings
            .iter()
            .map(|reading| reading.fit.score)
            .fold(best.fit.score, f64::max);
        let rivals: Vec<&Reading> = readings
            .iter()
            .filter(|rival| rival.names != best.names && rival.fit.score > top - MARGIN)
            .collect();
        let certain = best.certain(&readings, &rivals);
        let is_certain = |label: &usize| certain.contains(label) || best.unknown.contains(label);
        let doubtful: Vec<usize> = nameless.iter().copied().filter(|label| !is_certain(label)).collect();
        let verdict = Verdict {
            volume: &self.volume,
            best,
            rivals: &rivals,
            usual: readings
                .iter()
                .find(|reading| reading.preset == usual && best.preset != usual),
            certain: &certain,
            doubtful: &doubtful,
        };
        if best.is_sure() && doubtful.is_empty() {
            self.notes.push(verdict.note());
        } else {
            self.warnings.push(verdict.warning());
        }
        let preset = best.preset;
        let unknown = if certain.is_empty() {
            Vec::new()
        } else {
            best.unknown.clone()
        };
        self.read_as(preset, &certain, &unknown);
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
        } = Fit::of(&self.volume, extents, &names, Frame::File { slant: SLANT });
        let remedy = match self.by_value {
            Some(_) => "name the labels with --names FILE, or choose another volume.preset",
            None if self.is_of_surfaces => "check names, unit (taken as mm) and orientation",
            None => "check names, voxel spacing and orientation",
        };
        let scale = if self.is_of_surfaces {
            "the unit of the surfaces, which is taken as mm"
        } else {
            "the voxel spacing and its unit"
        };
        let odd: Vec<String> = odd.into_iter().map(|(_, odd)| odd).collect();
        let odd = (!odd.is_empty()).then(|| format!("{}: {remedy}", odd.join(", ")));
        let turned = turned.map(|turned| format!("{turned}: check its orientation, not its names"));
        let scaled = scaled.map(|scaled| format!("{scaled}: check {scale}, not the names"));
        scaled.into_iter().chain(turned).chain(odd).collect()
    }
}

/// The reading with the highest score, or that of the most common numbering if it fits as well, and as surely.
fn best(readings: &[Reading]) -> Option<&Reading> {
    let highest = readings
        .iter()
        .reduce(|best, next| if next.fit.score > best.fit.score { next } else { best })?;
    let usual = readings
        .iter()
        .find(|reading| reading.preset == Preset::TotalSegmentator);
    let is_as_good =
        |usual: &&Reading| usual.fit.score > highest.fit.score - MARGIN && (usual.is_sure() || !highest.is_sure());
    usual.filter(is_as_good).or(Some(highest))
}

/// The first descriptions and the number of the others; `None` if there is none.
fn examples<'a>(descriptions: impl Iterator<Item = &'a str>) -> Option<String> {
    let descriptions: Vec<String> = descriptions.map(str::to_owned).collect();
    (!descriptions.is_empty()).then(|| first_of(&descriptions, EXAMPLES, ", "))
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
        let title = usual.preset.title();
        if let Some(against) = examples(usual.against()) {
            format!("{by}: by those of {title}, {against}")
        } else if self.best.is_stated {
            format!("{by}, which the file's name states")
        } else {
            format!("{by}: they fit better than those of {title}")
        }
    }

    /// Warning about labels of which some or all stay without a name.
    fn warning(&self) -> String {
        let Self { best, rivals, .. } = self;
        let is_sure = best.is_sure();
        let shown = |label: usize, name: &str| format!("{} {name}", self.volume.labels()[label].value);
        let names: Vec<String> = best.names.iter().map(|(label, name)| shown(*label, name)).collect();
        let more = if names.len() > FEW { ", ..." } else { "" };
        let names = names[..names.len().min(FEW)].join(", ");
        let mut text = format!("{} ({names}{more})", self.reads_by());
        if !is_sure {
            text.push_str(" on weak evidence");
        }
        if let Some(against) = examples(best.against()) {
            text.push_str(&format!("; against them, {against}"));
        } else if best.fit.is_scattered {
            text.push_str("; they do not lie as these organs do");
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
        format!(
            "{text}: state volume.preset = \"{}\" if that is right, name the labels with --names FILE or volume.names, or write \
             [[tissue]] with name and labels = [VALUE, ...]",
            best.preset.stem()
        )
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
