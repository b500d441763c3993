//! Automatic pose of a probe without a stated one.

use nalgebra::{Point3, Vector3};

use super::At;
use super::check::Framing;
use super::file::SceneFile;
use insonify_anatomy::acoustics::{RIGID_KPA, TissueTable};
use insonify_anatomy::phantom;
use insonify_anatomy::volume::{Label, LabelVolume};
use insonify_base::document::{InputError, InvalidFile, Names, RegionName, nearest, plain};
use insonify_base::matrix::Rows;
use insonify_base::note::{Note, Notes};
use insonify_base::text::{MESSAGE, clipped, some_of};
use insonify_tracking::placement::{Meaning, PlacementOptions, deepest_mm, place};
use insonify_tracking::pose::{Pose, PoseSpec};
use insonify_tracking::probe::{BeamGrid, Site};

/// Largest depth that is chosen for a target, over the usual one.
const DEEPEST: f64 = 1.6;

/// Labels of the body and their tissues.
pub struct Body<'a> {
    /// Volume that holds the labels.
    pub volume: &'a LabelVolume,
    /// Tissues, and the tissue of each label.
    pub tissues: &'a TissueTable,
}

impl SceneFile {
    /// Constant pose of the probe, with the assumptions made.
    pub(super) fn fixed_pose(
        &self,
        body: &Body<'_>,
        framing: &Framing,
        notes: &mut Notes,
        warnings: &mut Vec<String>,
    ) -> Result<Pose, InputError> {
        let probe = &framing.probe;
        let table = self.pose.clone().unwrap_or_default();
        let invalid = |error: insonify_tracking::TrackingError| {
            let key = error
                .key()
                .map_or_else(|| "pose".to_owned(), |key| format!("pose.{key}"));
            self.fault(key, error)
        };
        if table.is_explicit() {
            if table.target.is_some() || table.plane.is_some() {
                let found = "both where the probe is and `target` or `plane` to place it by";
                return Err(self.wrong_keys("pose", found, "one of them"));
            }
            return table.pose().pose(None).map_err(invalid);
        }
        if table.world.is_some() {
            let expected = "`position_mm` with `direction`, or `matrix`, beside it";
            return Err(self.wrong_keys("pose.world", "`world` without a pose that is stated", expected));
        }
        // The default pose of a phantom is outside the body, where a probe for lumens cannot be.
        let phantom = self.volume.as_ref().and_then(|volume| volume.phantom);
        let base = match phantom {
            Some(phantom)
                if table.target.is_none() && table.plane.is_none() && probe.shape.kind().site() != Site::Lumen =>
            {
                let pose = Pose::from_matrix(&phantom::default_pose(phantom)).map_err(invalid)?;
                notes.push("the scene states no pose: the probe is at the default pose of this phantom".to_owned());
                pose
            }
            _ => self.placed(body, framing, notes, warnings)?,
        };
        let turned = PoseSpec {
            matrix: Some(Rows(*base.probe_to_world())),
            ..table.pose()
        };
        turned.pose(None).map_err(invalid)
    }

    /// Deepens an image whose depth is left open so that all of a stated target is in it, as far as bone and gas let it
    /// be seen, and notes so; of a stated depth it notes what is cut off.
    pub(super) fn deepen(
        &self,
        body: &Body<'_>,
        pose: &Pose,
        framing: &mut Framing,
        notes: &mut Notes,
    ) -> Result<(), InputError> {
        let target = self.pose.as_ref().and_then(|pose| pose.target.as_ref());
        let label = target.and_then(|target| body.named(target));
        let Some(label) = label.filter(|_| framing.probe.shape.kind().site() == Site::Skin) else {
            return Ok(());
        };
        let probe = &mut framing.probe;
        let before_mm = probe.depth_mm;
        let most_mm = DEEPEST * before_mm;
        let field = (&framing.grid, most_mm);
        let reached_mm = deepest_mm(
            body.volume,
            label,
            &|label| body.hides(label),
            pose.probe_to_world(),
            field,
        )
        .unwrap_or(0.0);
        if reached_mm < before_mm {
            return Ok(());
        }
        let name = body.name(label);
        if framing.open_depth {
            probe.depth_mm = (10.0 * (reached_mm / 10.0).ceil() + 10.0).min(most_mm);
            framing.grid = BeamGrid::new(probe).at(self, "probe")?;
            notes.push(format!(
                "the image is {:.0} mm deep, so that it holds {name} ({before_mm} mm would cut it off)",
                probe.depth_mm
            ));
        }
        if probe.depth_mm <= reached_mm + 1.0 || !framing.open_depth {
            notes.push(format!(
                "{name} is cut off by the lower edge: it goes on below the depth of {} mm",
                probe.depth_mm
            ));
        }
        Ok(())
    }

    /// Error about a target that matches no label, with the most similar labels and the warnings about labels.
    pub(super) fn no_target(&self, target: &str, body: &Body<'_>, warnings: &[String]) -> InputError {
        let entries = body.entries().into_iter();
        let (present, empty): (Vec<_>, Vec<_>) = entries.partition(|entry| body.volume.holds(usize::from(entry.0)));
        let is_empty = !Names::new(empty).all(&RegionName::Name(target.to_owned())).is_empty();
        let names = Names::new(present).known();
        let meant = nearest(target, names.iter().map(String::as_str)).map(|meant| format!("did you mean \"{meant}\"?"));
        let of_file = body.volume.labels().iter().skip(1).filter(|label| label.voxels > 0);
        let name = |label: &Label| label.name.clone().unwrap_or_else(|| label.value.to_string());
        let mut like: Vec<String> = of_file.map(name).collect();
        like.sort_by(|a, b| strsim::jaro_winkler(b, target).total_cmp(&strsim::jaro_winkler(a, target)));
        let labels = some_of(&like);
        let expected =
            format!("a label such as {labels}, a part of its name, or its value; `insonify info FILE` lists them");
        let wrong = if is_empty {
            InvalidFile::Unknown(format!("the label \"{target}\" has no voxels; expected {expected}"))
        } else {
            InvalidFile::name(target, &expected)
        };
        let error = self.fault("pose.target", wrong);
        let help: Vec<String> = meant.into_iter().chain(warnings.iter().cloned()).collect();
        error.with_help((!help.is_empty()).then(|| clipped(&help.join("; "), MESSAGE)))
    }

    /// Whether a mesh moves the tissue, which then gives way to the probe as the mesh does.
    pub(super) fn moves_tissue(&self) -> bool {
        let motion = self.motion.as_ref();
        self.deform.is_some() || motion.is_some_and(|motion| motion.is_alive() || motion.press.is_some())
    }

    fn placed(
        &self,
        body: &Body<'_>,
        framing: &Framing,
        notes: &mut Notes,
        warnings: &mut Vec<String>,
    ) -> Result<Pose, InputError> {
        let probe = &framing.probe;
        let table = self.pose.clone().unwrap_or_default();
        let label = match &table.target {
            Some(target) => {
                let label = body.named(target);
                let label = label.ok_or_else(|| self.no_target(target, body, warnings))?;
                let matching = body.matching(target);
                let of_file = matching
                    .iter()
                    .filter(|label| body.volume.drawn_into(usize::from(**label)).is_none());
                let names: Vec<String> = of_file.map(|label| body.name(*label)).collect();
                if names.len() > 1 {
                    let found = some_of(&names);
                    notes.push(format!("the target \"{target}\" is the largest of {found}"));
                }
                label
            }
            None if probe.shape.kind().site() == Site::Lumen => {
                let found = format!(
                    "no target of a {} probe, which lies in a vessel or an airway",
                    probe.shape.kind()
                );
                return Err(self.wrong_keys("pose.target", found, "its label, or a pose that is stated"));
            }
            None => body.largest_organ().ok_or_else(|| {
                let expected = "labelled tissue, or a `[pose]`";
                self.wrong_keys(
                    "volume",
                    "nothing to place the probe over: no voxel is labelled",
                    expected,
                )
            })?,
        };
        let options = PlacementOptions {
            plane: table.plane,
            shape: probe.shape,
            depth_mm: probe.depth_mm,
            reach_mm: framing.effects.contact.as_ref().map_or(0.0, |contact| contact.reach_mm),
            may_press: framing.effects.contact.is_some() && !self.moves_tissue() && !self.gets_mesh,
        };
        let name = body.name_with_value(label);
        let meaning = Meaning {
            is_body: &|label| !body.is_outside(label),
            is_bone_or_gas: &|label| body.hides(label),
        };
        let mut placed = place(body.volume, &[label], &meaning, &options);
        let usual = PlacementOptions {
            depth_mm: probe.shape.kind().usual().depth_mm,
            ..options
        };
        // Too deep for a stated depth: it is better shown where it lies than nowhere.
        if let (Err(_), true) = (&placed, options.depth_mm < usual.depth_mm)
            && let Ok(deeper) = place(body.volume, &[label], &meaning, &usual)
        {
            warnings.push(format!(
                "{name} is nowhere within {} mm of the skin in sight: under the probe it begins at {:.0} mm",
                options.depth_mm, deeper.target_depth_mm
            ));
            placed = Ok(deeper);
        }
        match placed {
            Ok(placement) => {
                let position = if probe.shape.kind().site() == Site::Lumen {
                    "in"
                } else {
                    "over"
                };
                let mut note = placement.note.about(format_args!("placed {position} {name}"));
                let axial = placement.probe_to_world.column(1);
                if position == "over" && axial.y < axial.x.abs() && body.has_drawn_skin() {
                    let head = format!(
                        "{}; the skin there is invented: check the position with --overview",
                        note.head()
                    );
                    note = Note::new(head, note.details().unwrap_or_default());
                }
                notes.push(note);
                Pose::from_matrix(&placement.probe_to_world).map_err(|error| self.fault("pose", error))
            }
            // Inside the body there is no place to fall back to; on the skin a picture from the front of the volume is
            // better than none.
            Err(error) if probe.shape.kind().site() == Site::Lumen => {
                let key = error
                    .key()
                    .map_or("pose.target".to_owned(), |key| format!("pose.{key}"));
                Err(self.fault(key, error))
            }
            Err(error) => {
                warnings.push(format!(
                    "{error}. The probe is put before {name} at the front of the volume instead"
                ));
                body.before(label).map_err(|error| self.fault("pose", error))
            }
        }
    }
}

impl Body<'_> {
    /// Whether the tissue of a label is as stiff as bone.
    pub fn is_bone(&self, label: u8) -> bool {
        self.tissues.tissue(label).young_kpa >= RIGID_KPA
    }

    /// Whether the tissue of a label hides what lies behind it, as bone and gas do.
    pub(super) fn hides(&self, label: u8) -> bool {
        self.tissues.tissue(label).occlusion_per_mm > 0.0
    }

    /// Properties of each label's tissue on which the place of a probe depends, besides names.
    pub fn placing(&self) -> Vec<[bool; 2]> {
        let property = |label: u8| [self.hides(label), self.tissues.tissue(label).soft_organ];
        (0..=u8::MAX).take(self.volume.labels().len()).map(property).collect()
    }

    /// Whether a label is the air around the body.
    pub fn is_outside(&self, label: u8) -> bool {
        matches!(self.tissues.tissue(label).name.as_ref(), "background" | "air")
    }

    /// Label at a point of the body (world, mm); `None` in air and outside the volume.
    pub fn label_at(&self, point: &Point3<f64>) -> Option<u8> {
        let label = self.volume.label_index_at(point);
        label.filter(|label| *label > 0 && !self.is_outside(*label))
    }

    fn counts(&self) -> [u64; 256] {
        let mut counts = [0; 256];
        for &label in self.volume.voxels() {
            counts[usize::from(label)] += 1;
        }
        counts
    }

    /// Labels of the volume accepted by `wanted`, the largest first.
    fn by_size(&self, wanted: impl Fn(u8, &Label) -> bool) -> Vec<u8> {
        let counts = self.counts();
        let mut labels: Vec<u8> = (0u8..=255)
            .zip(self.volume.labels())
            .skip(1)
            .filter(|(label, entry)| counts[usize::from(*label)] > 0 && wanted(*label, entry))
            .map(|(label, _)| label)
            .collect();
        labels.sort_by_key(|label| std::cmp::Reverse(counts[usize::from(*label)]));
        labels
    }

    fn largest(&self, wanted: impl Fn(u8, &Label) -> bool) -> Option<u8> {
        self.by_size(wanted).first().copied()
    }

    /// Largest soft organ, or else the largest label from the file itself.
    fn largest_organ(&self) -> Option<u8> {
        self.largest(|label, _| self.tissues.tissue(label).soft_organ)
            .or_else(|| self.largest(|label, entry| entry.voxels > 0 && !self.is_outside(label)))
            .or_else(|| self.largest(|label, _| !self.is_outside(label)))
    }

    /// Largest label that matches a target.
    pub fn named(&self, target: &str) -> Option<u8> {
        self.matching(target).first().copied()
    }

    /// Labels that match a target, those of the file before drawn ones and the largest first: by value, by complete name,
    /// or by a part of a name.
    pub(super) fn matching(&self, target: &str) -> Vec<u8> {
        let meant = Names::new(self.entries()).all(&RegionName::Name(target.to_owned()));
        let mut labels = self.by_size(|label, _| meant.contains(&label));
        labels.sort_by_key(|label| self.volume.drawn_into(usize::from(*label)).is_some());
        labels
    }

    /// Whether the skin is that of a body closed around labels.
    fn has_drawn_skin(&self) -> bool {
        let mut skins = (0..).zip(self.volume.labels());
        skins.any(|(label, entry)| {
            entry.voxels == 0 && entry.name.as_deref() == Some("skin") && self.volume.holds(label)
        })
    }

    /// Every label except the background, with its value and names.
    pub fn entries(&self) -> Vec<(u8, i64, Vec<String>)> {
        let labels = (0u8..=255).zip(self.volume.labels()).skip(1);
        labels
            .map(|(label, entry)| (label, entry.value, self.names_of(label, entry)))
            .collect()
    }

    fn names_of(&self, label: u8, entry: &Label) -> Vec<String> {
        let stated = entry.name.as_deref().into_iter();
        stated
            .chain([self.tissues.tissue(label).name.as_ref()])
            .map(plain)
            .collect()
    }

    /// The name of a label, or its value.
    pub fn name(&self, label: u8) -> String {
        let entry = &self.volume.labels()[usize::from(label)];
        self.names_of(label, entry)
            .into_iter()
            .next()
            .unwrap_or_else(|| entry.value.to_string())
    }

    /// The name of a label, or its value with the name of its tissue.
    fn name_with_value(&self, label: u8) -> String {
        let entry = &self.volume.labels()[usize::from(label)];
        match entry.name {
            Some(_) => self.name(label),
            None => format!("label {} ({})", entry.value, self.tissues.tissue(label).name),
        }
    }

    /// Pose at the front face of the volume, in front of the centre of a label, directed backwards.
    fn before(&self, label: u8) -> Result<Pose, insonify_tracking::TrackingError> {
        let [nx, ny, nz] = self.volume.size();
        let to_world = self.volume.index_to_world();
        let (mut sum, mut count) = (Vector3::zeros(), 0.0);
        for (voxel, _) in self
            .volume
            .voxels()
            .iter()
            .enumerate()
            .filter(|(_, voxel)| **voxel == label)
        {
            sum += Vector3::new(
                (voxel % nx) as f64,
                (voxel / nx % ny) as f64,
                (voxel / (nx * ny)) as f64,
            );
            count += 1.0;
        }
        let middle = to_world.transform_point(&Point3::from(sum / f64::max(count, 1.0)));
        let ends = [nx, ny, nz].map(|n| [0.0, n as f64 - 1.0]);
        let front = (0..8)
            .map(|corner| Point3::new(ends[0][corner & 1], ends[1][corner >> 1 & 1], ends[2][corner >> 2]))
            .map(|corner| to_world.transform_point(&corner).y)
            .fold(f64::INFINITY, f64::min);
        Pose::from_direction(Point3::new(middle.x, front, middle.z), Vector3::y(), None)
    }
}
