//! Kinematic tissue deformation: analytic fields, displacements from a mesh file, respiration, or pulsation, on a mesh
//! over the volume.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use nalgebra::{Matrix4, Vector3};
use schemars::JsonSchema;
use serde::Deserialize;
use serde::de::value::{MapAccessDeserializer, SeqAccessDeserializer};
use serde::de::{Deserializer, MapAccess, SeqAccess, Visitor};

use super::At;
use super::breathing::{Inspired, LONGEST_MM, inspired};
use super::file::SceneFile;
use super::paths::{BreathingSpec, MotionSpec, PulseSpec};
use super::pulse::{Artery, WIDEST_MM, WIDEST_SHARE, Widened, widened};
use super::target::Body;
use insonify_anatomy::volume::LabelVolume;
use insonify_base::document::{InputError, InvalidFile};
use insonify_base::note::Notes;
use insonify_base::range::parameters;
use insonify_base::text::some_of;
use insonify_mesh::file::{ReadOptions, read_mesh};
use insonify_mesh::{Displacement, TetMesh};

/// Default number of nodes of a mesh over the volume.
pub const DEFAULT_NODES: u32 = 5000;
parameters! {
    /// A deformation of the tissue: `field`, `mesh`, or both.
    pub struct DeformSpec {
        /// Approximate number of nodes of the mesh over the volume. Default 5000; not with `mesh`.
        #[serde(skip_serializing_if = "Option::is_none")]
        nodes: Option<u32>, in 8..=1000000 "nodes";
        /// A displacement field, or a list of fields whose displacements add up.
        #[serde(deserialize_with = "one_or_more", skip_serializing_if = "Vec::is_empty")]
        #[schemars(with = "OneOrMore")]
        field: Vec<Displacement>;
        /// Tetrahedral mesh (`.vtu`, `.vtk`, `.msh`; LPS, mm) in place of one over the volume.
        #[serde(skip_serializing_if = "Option::is_none")]
        mesh: Option<PathBuf>;
        /// Name of the point array of `mesh` that holds displacements in mm. Default `displacement`.
        #[serde(skip_serializing_if = "Option::is_none")]
        array: Option<String>;
        /// Duration of the ramp from no deformation to full deformation. Default: full deformation at all times.
        #[serde(skip_serializing_if = "Option::is_none")]
        ramp_s: Option<f64>, above 0..=1e9 "s";
        /// In place of `ramp_s`: points `[time_s, fraction]` in ascending time, with linear interpolation of the
        /// fraction of the deformation between them and constant values outside.
        #[serde(skip_serializing_if = "Option::is_none")]
        amplitude: Option<Vec<[f64; 2]>>;
    }
}

/// Forms in which `field` may be written.
#[derive(JsonSchema)]
#[serde(untagged)]
#[expect(
    dead_code,
    reason = "it only describes the format; `one_or_more` reads it and keeps places in the file"
)]
enum OneOrMore {
    One(Displacement),
    More(Vec<Displacement>),
}

fn one_or_more<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<Displacement>, D::Error> {
    struct Fields;
    impl<'de> Visitor<'de> for Fields {
        type Value = Vec<Displacement>;

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str("a displacement field or a list of some")
        }

        fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Self::Value, A::Error> {
            Displacement::deserialize(MapAccessDeserializer::new(map)).map(|field| vec![field])
        }

        fn visit_seq<A: SeqAccess<'de>>(self, list: A) -> Result<Self::Value, A::Error> {
            Vec::deserialize(SeqAccessDeserializer::new(list))
        }
    }
    deserializer.deserialize_any(Fields)
}

/// A position or displacement for each node, mm.
pub type Nodes = Vec<[f64; 3]>;

/// A mesh and its motions, whose displacements add up.
#[derive(Clone, Debug)]
pub(super) struct Deformation {
    pub mesh: Arc<TetMesh>,
    motions: Vec<Motion>,
}

/// Motion of the nodes of a mesh.
#[derive(Clone, Debug)]
pub struct Motion {
    /// Displacement of each node at an amplitude of 1, mm.
    pub displacements: Nodes,
    course: Course,
}

impl Motion {
    /// A motion of full amplitude at all times.
    pub(super) fn constant(displacements: Nodes) -> Self {
        let course = Course::Points(vec![[0.0, 1.0]]);
        Self { displacements, course }
    }

    /// Number of elements that fold at its greatest amplitude.
    pub(super) fn folded(&self, mesh: &TetMesh) -> usize {
        most_folded(mesh, std::slice::from_ref(self))
    }

    /// Amplitude at a time, s.
    pub fn at(&self, time_s: f64) -> f64 {
        self.course.at(time_s)
    }

    /// Adds the displacements at an amplitude to the positions of nodes.
    fn add(&self, amplitude: f64, nodes: &mut Nodes) {
        for (node, by) in nodes.iter_mut().zip(&self.displacements) {
            *node = [0, 1, 2].map(|axis| node[axis] + amplitude * by[axis]);
        }
    }
}

/// Amplitude of a motion over time.
#[derive(Clone, Debug)]
enum Course {
    /// Points of time (s) and amplitude, in ascending time; one or more.
    Points(Vec<[f64; 2]>),
    Breathing(BreathingSpec),
    Pulse(PulseSpec),
}

impl Course {
    /// Least and greatest amplitude.
    fn ends(&self) -> [f64; 2] {
        let Course::Points(points) = self else {
            return [0.0, 1.0];
        };
        let amplitudes = || points.iter().map(|point| point[1]);
        [
            amplitudes().fold(f64::INFINITY, f64::min),
            amplitudes().fold(f64::NEG_INFINITY, f64::max),
        ]
    }

    /// Amplitude at a time, s.
    fn at(&self, time_s: f64) -> f64 {
        let points = match self {
            Course::Breathing(spec) => return spec.share_at(time_s),
            Course::Pulse(spec) => return spec.share_at(time_s),
            Course::Points(points) => points,
        };
        let after = points.partition_point(|point| point[0] <= time_s);
        let before = after.checked_sub(1).and_then(|index| points.get(index));
        match (before, points.get(after)) {
            (Some(a), Some(b)) => a[1] + (b[1] - a[1]) * ((time_s - a[0]) / (b[0] - a[0])),
            (Some(point), None) | (None, Some(point)) => point[1],
            (None, None) => 1.0,
        }
    }
}

impl Deformation {
    /// Returns the times of the first and last change of a deformation, s, and the times of one breath, or of one beat
    /// without breathing; `None` where there is no such motion.
    pub(super) fn spans_s(&self) -> [Option<[f64; 2]>; 2] {
        let mut spans = [None; 2];
        for motion in &self.motions {
            match &motion.course {
                Course::Points(points) => {
                    if let [first, .., last] = points[..] {
                        spans[0] = Some([first[0], last[0]]);
                    }
                }
                Course::Breathing(spec) => spans[1] = Some([0.0, spec.period_s()]),
                Course::Pulse(spec) => spans[1] = spans[1].or(Some([0.0, spec.period_s()])),
            }
        }
        spans
    }

    /// Writes the current node positions at a time into `nodes`, reusing its memory.
    pub(crate) fn nodes_at(&self, time_s: f64, nodes: &mut Nodes) {
        nodes.clear();
        nodes.extend_from_slice(self.mesh.nodes());
        for motion in &self.motions {
            motion.add(motion.at(time_s), nodes);
        }
    }
}

impl SceneFile {
    /// Returns the deformation of the scene, if it has one: of `[deform]`, respiration and pulsation.
    pub(super) fn deformation(
        &self,
        body: &Body<'_>,
        base: &Path,
        pressing: Option<(TetMesh, Motion)>,
        notes: &mut Notes,
        warnings: &mut Vec<String>,
    ) -> Result<Option<Deformation>, InputError> {
        let is_alive = self.motion.as_ref().is_some_and(MotionSpec::is_alive);
        let usual = DeformSpec::default();
        let spec = match &self.deform {
            Some(spec) => spec,
            None if is_alive || pressing.is_some() => &usual,
            None => return Ok(None),
        };
        self.in_ranges("deform", spec)?;
        for (index, field) in spec.field.iter().enumerate() {
            field
                .validate()
                .map_err(|error| self.fault(format!("deform.field[{index}].{}", error.key), error))?;
        }
        let is_still = spec.field.is_empty() && spec.mesh.is_none();
        if is_still && !is_alive && pressing.is_none() {
            return Err(self.wrong_keys("deform", "neither `field` nor `mesh`", "what deforms the tissue"));
        }
        let (pressed, press) = pressing.unzip();
        let (mesh, mut displacements) = match (pressed, &spec.mesh) {
            (Some(mesh), _) => (mesh, None),
            (None, None) => (self.mesh_over(body.volume, spec)?, None),
            (None, Some(path)) => self.mesh_file(&base.join(path), spec)?,
        };
        let mut sum = displacements
            .take()
            .unwrap_or_else(|| vec![[0.0; 3]; mesh.nodes().len()]);
        for (node, total) in mesh.nodes().iter().zip(&mut sum) {
            for field in &spec.field {
                let by = field.apply(*node);
                *total = [0, 1, 2].map(|axis| total[axis] + by[axis]);
            }
        }
        let mut motions: Vec<Motion> = press.into_iter().collect();
        if !is_still {
            motions.push(Motion {
                displacements: sum,
                course: Course::Points(self.amplitude(spec)?),
            });
        }
        // A mesh over the volume ends in the midst of the body, one of a file where it is meant to.
        let surface = mesh.surface().filter(|_| spec.mesh.is_none());
        let ends: Vec<u32> = surface.flat_map(|face| face.nodes).collect();
        let finer = format!("`deform.nodes` = {} or more gives finer ones", 8 * mesh.nodes().len());
        let motions = self.living(motions, &mesh, body, (&ends, &finer), notes, warnings)?;
        let mesh = Arc::new(mesh);
        Ok(Some(Deformation { mesh, motions }))
    }

    /// Adds respiration and pulsation of the scene to `motions` of a mesh of which the `held` nodes do not breathe; `finer`
    /// says in words how there are more nodes. Warns of elements that fold as they add up.
    ///
    /// # Errors
    /// [`InputError`] with the key and its place in the file.
    pub fn living(
        &self,
        mut motions: Vec<Motion>,
        mesh: &TetMesh,
        body: &Body<'_>,
        (held, finer): (&[u32], &str),
        notes: &mut Notes,
        warnings: &mut Vec<String>,
    ) -> Result<Vec<Motion>, InputError> {
        if let Some(spec) = self.motion.as_ref().and_then(|motion| motion.breathing.as_ref()) {
            motions.push(Motion {
                displacements: self.inspired(spec, mesh, body, (held, finer), notes, warnings)?,
                course: Course::Breathing(spec.clone()),
            });
        }
        if let Some(spec) = self.motion.as_ref().and_then(|motion| motion.pulse.as_ref()) {
            motions.push(Motion {
                displacements: self.widened(spec, mesh, body, finer, notes, warnings)?,
                course: Course::Pulse(spec.clone()),
            });
        }
        let folded = if motions.len() > 1 {
            most_folded(mesh, &motions)
        } else {
            0
        };
        if folded > 0 {
            warnings.push(format!(
                "{folded} of {} elements of the mesh fold where its motions add up: there the picture shows tissue twice; \
                 smaller motions, or a finer mesh ({finer})",
                mesh.elements().len()
            ));
        }
        Ok(motions)
    }

    /// Displacements of a mesh's nodes at the end of inspiration, checked.
    fn inspired(
        &self,
        spec: &BreathingSpec,
        mesh: &TetMesh,
        body: &Body<'_>,
        (held, finer): (&[u32], &str),
        notes: &mut Notes,
        warnings: &mut Vec<String>,
    ) -> Result<Nodes, InputError> {
        let key = "motion.breathing";
        self.in_ranges(key, spec)?;
        for (organ, &travel_mm) in spec.travel_mm.iter().flatten() {
            if !(0.0..=LONGEST_MM).contains(&travel_mm) {
                let fault = InvalidFile::number(travel_mm, "a travel from 0 to 100 mm");
                return Err(self.fault(format!("{key}.travel_mm.{organ}"), fault));
            }
        }
        if let Some([from, to]) = spec.hold_s
            && !(from.is_finite() && to.is_finite() && from < to)
        {
            let found = format!("`hold_s` from {from} to {to}");
            return Err(self.wrong_keys(
                "motion.breathing.hold_s",
                found,
                "two times in s, the first before the second",
            ));
        }
        let Inspired {
            displacements,
            notes: new,
            absent,
        } = inspired(spec, mesh, body, held, finer);
        if let Some(organ) = absent.first() {
            let known = InvalidFile::name(organ, "a label of the volume, a part of its name, or a tissue");
            return Err(self.fault(format!("{key}.travel_mm.{organ}"), known));
        }
        if displacements.iter().all(|by| by[2] == 0.0) {
            warnings.push(format!(
                "{key} moves nothing: the volume has no organ that goes with the diaphragm; state `travel_mm`"
            ));
        }
        notes.extend(new);
        Ok(displacements)
    }

    /// Displacements of a mesh's nodes where arteries are widest, checked.
    fn widened(
        &self,
        spec: &PulseSpec,
        mesh: &TetMesh,
        body: &Body<'_>,
        finer: &str,
        notes: &mut Notes,
        warnings: &mut Vec<String>,
    ) -> Result<Nodes, InputError> {
        let key = "motion.pulse";
        self.in_ranges(key, spec)?;
        for (artery, &radial_mm) in spec.radial_mm.iter().flatten() {
            if !(0.0..=WIDEST_MM).contains(&radial_mm) {
                let fault = InvalidFile::number(radial_mm, "a displacement from 0 to 5 mm");
                return Err(self.fault(format!("{key}.radial_mm.{artery}"), fault));
            }
        }
        let Widened {
            displacements,
            arteries,
            absent,
        } = widened(spec, mesh, body);
        if let Some(artery) = absent.first() {
            let known = InvalidFile::name(artery, "a label of the volume, a part of its name, or a tissue");
            return Err(self.fault(format!("{key}.radial_mm.{artery}"), known));
        }
        let too_wide = arteries
            .iter()
            .find(|artery| artery.radial_mm > WIDEST_SHARE * artery.radius_mm);
        if let Some(Artery {
            name,
            radius_mm,
            radial_mm,
            ..
        }) = too_wide
        {
            let found = format!("{radial_mm} mm of {name}, whose radius is {radius_mm:.1} mm");
            return Err(self.wrong_keys("motion.pulse.radial_mm", found, "at most half of the radius"));
        }
        let widest: Nodes = mesh
            .nodes()
            .iter()
            .zip(&displacements)
            .map(|(node, by)| [0, 1, 2].map(|axis| node[axis] + by[axis]))
            .collect();
        let mut volumes = mesh.volumes(mesh.nodes()).zip(mesh.volumes(&widest));
        if volumes.any(|(rest, widest)| rest > 0.0 && widest <= 0.0) {
            let found = "a displacement by which elements of the mesh fold beside bone or skin";
            return Err(self.wrong_keys("motion.pulse.radial_mm", found, "a smaller one"));
        }
        if arteries.is_empty() {
            warnings.push(format!(
                "{key} moves nothing: no label is named aorta, artery or carotid; state `radial_mm`"
            ));
        }
        let without_node: Vec<String> = arteries
            .iter()
            .filter(|artery| !artery.has_node)
            .map(|artery| artery.name.clone())
            .collect();
        if !without_node.is_empty() {
            notes.push(format!(
                "no node of the mesh lies in {}, which may not be seen to pulsate ({finer})",
                some_of(&without_node)
            ));
        }
        if spec.radial_mm.is_none() && !arteries.is_empty() {
            let each: Vec<String> = arteries
                .iter()
                .map(|artery| format!("{} {:.2}", artery.name, artery.radial_mm))
                .collect();
            notes.push(format!("arteries widen by 9 % of their radius, mm: {}", some_of(&each)));
        }
        Ok(displacements)
    }

    fn mesh_over(&self, volume: &LabelVolume, spec: &DeformSpec) -> Result<TetMesh, InputError> {
        if spec.array.is_some() {
            return Err(self.wrong_keys(
                "deform.array",
                "`array` without `mesh`",
                "a mesh file that has the array",
            ));
        }
        let nodes = spec.nodes.unwrap_or(DEFAULT_NODES);
        TetMesh::over_affine_box(&box_of(volume), nodes as usize).at(self, "deform")
    }

    fn mesh_file(&self, path: &Path, spec: &DeformSpec) -> Result<(TetMesh, Option<Nodes>), InputError> {
        if spec.nodes.is_some() {
            return Err(self.wrong_keys(
                "deform.nodes",
                "`nodes` with `mesh`",
                "one of them: a file has its own nodes",
            ));
        }
        let options = ReadOptions {
            displacement: spec.array.as_deref(),
            ..ReadOptions::default()
        };
        let file = read_mesh(path, &options).at(self, "deform.mesh")?;
        let is_alive = self.motion.as_ref().is_some_and(MotionSpec::is_alive);
        if file.displacements.is_none() && spec.field.is_empty() && !is_alive {
            return Err(self.wrong_keys(
                "deform.mesh",
                format!("no point array `displacement` in {}", path.display()),
                "one, or its name in `array`, or a `field`",
            ));
        }
        Ok((file.mesh, file.displacements))
    }

    fn amplitude(&self, spec: &DeformSpec) -> Result<Vec<[f64; 2]>, InputError> {
        const LATEST_S: f64 = 1e9;
        let number = |key: &str, found: f64, expected| self.fault(key, InvalidFile::number(found, expected));
        match (spec.ramp_s, &spec.amplitude) {
            (None, None) => Ok(vec![[0.0, 1.0]]),
            (Some(_), Some(_)) => {
                Err(self.wrong_keys("deform.ramp_s", "both `ramp_s` and `amplitude`", "at most one of them"))
            }
            (Some(ramp), None) => Ok(vec![[0.0, 0.0], [ramp, 1.0]]),
            (None, Some(points)) => {
                if points.is_empty() {
                    return Err(self.wrong_keys("deform.amplitude", "no points", "at least one `[time_s, share]`"));
                }
                for (index, point) in points.iter().enumerate() {
                    let previous = index.checked_sub(1).map_or(f64::NEG_INFINITY, |index| points[index][0]);
                    if !(point[0].abs() <= LATEST_S && point[0] > previous) {
                        let expected = "a time in s after the one before, at most 1e9";
                        return Err(number(&format!("deform.amplitude[{index}][0]"), point[0], expected));
                    }
                    if point[1].is_nan() || point[1].abs() > 100.0 {
                        let expected = "a share from -100 to 100";
                        return Err(number(&format!("deform.amplitude[{index}][1]"), point[1], expected));
                    }
                }
                Ok(points.clone())
            }
        }
    }
}

/// Returns the most elements that are folded in any of the extremes of some motions, taken together.
fn most_folded(mesh: &TetMesh, motions: &[Motion]) -> usize {
    let ends: Vec<[f64; 2]> = motions.iter().map(|motion| motion.course.ends()).collect();
    let of_extremes = (0..1_usize << motions.len()).map(|bits| {
        let mut nodes: Nodes = mesh.nodes().to_vec();
        for (index, (motion, ends)) in motions.iter().zip(&ends).enumerate() {
            motion.add(ends[bits >> index & 1], &mut nodes);
        }
        let volumes = mesh.volumes(mesh.nodes()).zip(mesh.volumes(&nodes));
        volumes.filter(|(rest, moved)| *rest > 0.0 && *moved <= 0.0).count()
    });
    of_extremes.max().unwrap_or(0)
}

/// Affine map from the unit cube to the bounding box of the voxels.
fn box_of(volume: &LabelVolume) -> Matrix4<f64> {
    let size = volume.size().map(|n| n as f64);
    volume.index_to_world()
        * Matrix4::new_translation(&Vector3::repeat(-0.5))
        * Matrix4::new_nonuniform_scaling(&Vector3::from(size))
}
