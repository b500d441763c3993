//! Respiration: organs that go with the diaphragm, as displacements of the nodes of a mesh.
//!
//! The volume shows the end of expiration, at time 0. Breathing in, organs go towards the feet, along -z of the world,
//! and back: by sin^4(pi t / T) of their travel in a breath of T seconds, so that they rest longer at the end of
//! expiration than of inspiration (Lujan et al. 1999, "A method for incorporating organ motion due to breathing into 3D
//! dose calculations", with n = 2). Nodes in organs move by their travel; those in bone, skin and air do not; between
//! them the displacement solves Laplace's equation on the edges of the mesh.

use std::collections::BTreeMap;
use std::f64::consts::PI;

use super::deform::Nodes;
use super::target::Body;
use insonify_base::range::parameters;
use insonify_mesh::TetMesh;

/// Travel of organs from end to end of a breath, mm: centres of gravity of twelve persons in dynamic MRI (Bussels et
/// al. 2003, "Respiration-induced movement of the upper abdominal organs"); the spleen, which lies on the diaphragm as
/// the liver does, with the liver.
const TRAVEL_MM: [(&str, f64); 4] = [("liver", 24.4), ("spleen", 24.4), ("pancreas", 23.7), ("kidney", 16.5)];

/// Longest travel of an organ, mm.
pub(super) const LONGEST_MM: f64 = 100.0;

/// Residual, over that of no displacement, at which Laplace's equation is solved.
const TOLERANCE: f64 = 1e-6;
const MAX_ITERATIONS: usize = 2000;

parameters! {
    /// Respiration: organs move towards the feet (-z of the world) and back; bone, skin and air rest. The volume shows
    /// the end of expiration.
    pub struct BreathingSpec {
        /// Breaths per minute.
        rate_per_min: f64 = 15.0, in 1..=60 "per minute";
        /// Travel of organs between the ends of expiration and inspiration, mm (0 to 100), by the name of a label, a
        /// tissue, or a part of one such as `kidney`. Default: liver and spleen 24.4, pancreas 23.7, kidneys 16.5.
        #[serde(skip_serializing_if = "Option::is_none")]
        travel_mm: Option<BTreeMap<String, f64>>;
        /// Times between which the breath is held, s.
        #[serde(skip_serializing_if = "Option::is_none")]
        hold_s: Option<[f64; 2]>;
    }
}

impl BreathingSpec {
    /// Duration of a breath, s.
    pub(super) fn period_s(&self) -> f64 {
        60.0 / self.rate_per_min
    }

    /// Share of the travel at a time (s): 0 at the end of expiration, 1 at that of inspiration.
    pub(super) fn share_at(&self, time_s: f64) -> f64 {
        let held_s = self.hold_s.map_or(0.0, |[from, to]| time_s.clamp(from, to) - from);
        ((time_s - held_s) * PI / self.period_s()).sin().powi(4)
    }
}

/// Displacements at the end of inspiration.
pub(super) struct Inspired {
    /// Displacement of each node, mm.
    pub displacements: Nodes,
    /// Organs in which no node lies: they go with what surrounds them.
    pub unresolved: Vec<String>,
    /// Organs that are stated and are not in the volume.
    pub absent: Vec<String>,
}

/// Computes the displacements of a mesh's nodes at the end of inspiration.
pub(super) fn inspired(spec: &BreathingSpec, mesh: &TetMesh, body: &Body<'_>) -> Inspired {
    let usual = || TRAVEL_MM.map(|(organ, travel_mm)| (organ.to_owned(), travel_mm)).into();
    let travels: BTreeMap<String, f64> = spec.travel_mm.clone().unwrap_or_else(usual);
    let (mut travel_of, mut absent) = (BTreeMap::new(), Vec::new());
    for (organ, travel_mm) in &travels {
        let labels = body.matching(organ);
        if labels.is_empty() && spec.travel_mm.is_some() {
            absent.push(organ.clone());
        }
        travel_of.extend(labels.into_iter().map(|label| (label, (organ, *travel_mm))));
    }
    let mut without_node: BTreeMap<u8, &String> =
        travel_of.iter().map(|(label, (organ, _))| (*label, *organ)).collect();
    let volume = body.volume.undivided();
    let prescribed: Vec<Option<f64>> = mesh
        .nodes()
        .iter()
        .map(|node| {
            let label = volume.label_index_at(&(*node).into()).unwrap_or(0);
            if let Some((_, travel_mm)) = travel_of.get(&label) {
                without_node.remove(&label);
                return Some(*travel_mm);
            }
            let is_skin = body.tissues.tissue(label).name == "skin";
            (label == 0 || is_skin || body.is_outside(label) || body.is_bone(label)).then_some(0.0)
        })
        .collect();
    let mut unresolved: Vec<String> = without_node.into_values().cloned().collect();
    unresolved.dedup();
    Inspired {
        displacements: harmonic(mesh, &prescribed)
            .into_iter()
            .map(|mm| [0.0, 0.0, -mm])
            .collect(),
        unresolved,
        absent,
    }
}

/// Continues prescribed values to all nodes by Laplace's equation on the edges of the mesh. Nodes that no prescribed
/// one is joined to get 0.
fn harmonic(mesh: &TetMesh, prescribed: &[Option<f64>]) -> Vec<f64> {
    let mut edges: Vec<[u32; 2]> = Vec::with_capacity(6 * mesh.elements().len());
    for corners in mesh.elements() {
        for (index, &a) in corners.iter().enumerate() {
            edges.extend(corners[index + 1..].iter().map(|&b| [a.min(b), a.max(b)]));
        }
    }
    edges.sort_unstable();
    edges.dedup();
    let mut degree = vec![0.0; prescribed.len()];
    for [a, b] in &edges {
        degree[*a as usize] += 1.0;
        degree[*b as usize] += 1.0;
    }
    // Of free nodes: degree times the value, less those of the neighbours.
    let laplacian = |values: &[f64], out: &mut Vec<f64>| {
        out.clear();
        out.extend(degree.iter().zip(values).map(|(degree, value)| degree * value));
        for [a, b] in edges.iter().map(|edge| edge.map(|node| node as usize)) {
            out[a] -= values[b];
            out[b] -= values[a];
        }
        out.iter_mut()
            .zip(prescribed)
            .filter(|(_, prescribed)| prescribed.is_some())
            .for_each(|(out, _)| *out = 0.0);
    };
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let preconditioned = |residual: &[f64]| -> Vec<f64> {
        residual
            .iter()
            .zip(&degree)
            .map(|(r, degree)| r / degree.max(1.0))
            .collect()
    };
    // Conjugate gradients, from the prescribed values with 0 elsewhere; directions are 0 at prescribed nodes.
    let mut values: Vec<f64> = prescribed.iter().map(|value| value.unwrap_or(0.0)).collect();
    let mut image = Vec::new();
    laplacian(&values, &mut image);
    let mut residual: Vec<f64> = image.iter().map(|value| -value).collect();
    let mut direction = preconditioned(&residual);
    let mut energy = dot(&residual, &direction);
    let limit = TOLERANCE * TOLERANCE * energy;
    for _ in 0..MAX_ITERATIONS {
        if energy <= limit {
            break;
        }
        laplacian(&direction, &mut image);
        let step = energy / dot(&direction, &image);
        for node in 0..values.len() {
            values[node] += step * direction[node];
            residual[node] -= step * image[node];
        }
        let next = preconditioned(&residual);
        let next_energy = dot(&residual, &next);
        for (direction, next) in direction.iter_mut().zip(&next) {
            *direction = next + next_energy / energy * *direction;
        }
        energy = next_energy;
    }
    values
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_breath_begins_at_the_end_of_expiration_and_can_be_held() {
        let spec = BreathingSpec {
            rate_per_min: 12.0,
            hold_s: Some([7.5, 17.5]),
            ..BreathingSpec::default()
        };
        // Breaths of 5 s; the second is held where it is deepest.
        for (time_s, share) in [
            (0.0, 0.0),
            (1.25, 0.25),
            (2.5, 1.0),
            (5.0, 0.0),
            (7.5, 1.0),
            (12.0, 1.0),
            (17.5, 1.0),
            (20.0, 0.0),
        ] {
            assert!(
                (spec.share_at(time_s) - share).abs() < 1e-12,
                "{time_s} s: {}",
                spec.share_at(time_s)
            );
        }
    }

    /// Between a plane at rest and one that moves, the displacement is linear.
    #[test]
    fn displacements_are_harmonic_between_what_is_prescribed() {
        let mesh = TetMesh::lattice([3, 3, 12], &nalgebra::Matrix4::new_scaling(60.0)).expect("a mesh");
        let at_ends = |node: &[f64; 3]| (node[2] == 0.0 || node[2] == 60.0).then(|| node[2] / 3.0);
        let prescribed: Vec<Option<f64>> = mesh.nodes().iter().map(at_ends).collect();
        for (node, value) in mesh.nodes().iter().zip(harmonic(&mesh, &prescribed)) {
            assert!((value - node[2] / 3.0).abs() < 1e-4, "{node:?}: {value}");
        }
        let free = vec![None; mesh.nodes().len()];
        assert!(harmonic(&mesh, &free).iter().all(|value| *value == 0.0));
    }
}
