//! Kinematic tissue deformation: analytic fields, or displacements from a mesh file, on a mesh over the volume.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use nalgebra::{Matrix4, Vector3};
use schemars::JsonSchema;
use serde::Deserialize;
use serde::de::value::{MapAccessDeserializer, SeqAccessDeserializer};
use serde::de::{Deserializer, MapAccess, SeqAccess, Visitor};

use super::At;
use super::file::SceneFile;
use insonify_anatomy::volume::LabelVolume;
use insonify_base::document::{InputError, InvalidFile};
use insonify_base::range::parameters;
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
type Nodes = Vec<[f64; 3]>;

/// A mesh and its motion.
#[derive(Clone, Debug)]
pub(super) struct Deformation {
    pub mesh: Arc<TetMesh>,
    /// Displacement of each node at an amplitude of 1, mm.
    displacements: Nodes,
    /// Points of time (s) and amplitude, in ascending time; one or more.
    amplitude: Vec<[f64; 2]>,
}

impl Deformation {
    /// Times of the first and last change, s; `None` if the deformation is constant.
    pub(super) fn span_s(&self) -> Option<[f64; 2]> {
        match self.amplitude[..] {
            [first, .., last] => Some([first[0], last[0]]),
            _ => None,
        }
    }

    /// Amplitude of the deformation at a time, s.
    fn amplitude_at(&self, time_s: f64) -> f64 {
        let after = self.amplitude.partition_point(|point| point[0] <= time_s);
        match (
            after.checked_sub(1).and_then(|index| self.amplitude.get(index)),
            self.amplitude.get(after),
        ) {
            (Some(a), Some(b)) => a[1] + (b[1] - a[1]) * ((time_s - a[0]) / (b[0] - a[0])),
            (Some(point), None) | (None, Some(point)) => point[1],
            (None, None) => 1.0,
        }
    }

    /// Writes the current node positions at a time into `nodes`, reusing its memory.
    pub(crate) fn nodes_at(&self, time_s: f64, nodes: &mut Nodes) {
        let amplitude = self.amplitude_at(time_s);
        nodes.clear();
        nodes.extend(
            self.mesh
                .nodes()
                .iter()
                .zip(&self.displacements)
                .map(|(node, by)| [0, 1, 2].map(|axis| node[axis] + amplitude * by[axis])),
        );
    }
}

impl SceneFile {
    /// Returns the deformation of the scene, if it has one.
    pub(super) fn deformation(&self, volume: &LabelVolume, base: &Path) -> Result<Option<Deformation>, InputError> {
        let Some(spec) = &self.deform else { return Ok(None) };
        self.in_ranges("deform", spec)?;
        for (index, field) in spec.field.iter().enumerate() {
            field
                .validate()
                .map_err(|error| self.fault(format!("deform.field[{index}].{}", error.key), error))?;
        }
        if spec.field.is_empty() && spec.mesh.is_none() {
            return Err(self.wrong_keys("deform", "neither `field` nor `mesh`", "what deforms the tissue"));
        }
        let (mesh, mut displacements) = match &spec.mesh {
            None => (self.mesh_over(volume, spec)?, None),
            Some(path) => self.mesh_file(&base.join(path), spec)?,
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
        Ok(Some(Deformation {
            mesh: Arc::new(mesh),
            displacements: sum,
            amplitude: self.amplitude(spec)?,
        }))
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
        if file.displacements.is_none() && spec.field.is_empty() {
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

/// Affine map from the unit cube to the bounding box of the voxels.
fn box_of(volume: &LabelVolume) -> Matrix4<f64> {
    let size = volume.size().map(|n| n as f64);
    volume.index_to_world()
        * Matrix4::new_translation(&Vector3::repeat(-0.5))
        * Matrix4::new_nonuniform_scaling(&Vector3::from(size))
}
