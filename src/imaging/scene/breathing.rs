//! Respiration: organs that go with the diaphragm, as displacements of the nodes of a mesh.
//!
//! The volume shows the end of expiration, at time 0. Breathing in, organs go towards the feet, along -z of the world,
//! and back: by sin^4(pi t / T) of their travel in a breath of T seconds. Even powers of a sine, which rest longer at
//! the end of expiration than of inspiration, are the course of Lujan et al. 1999, "A method for incorporating organ
//! motion due to breathing into 3D dose calculations". Nodes in organs move by their travel; those in the air around
//! the body, on the border of a mesh over the volume, and at the ends of edges that cross bone, cartilage or skin,
//! rest; between them the displacement solves Laplace's equation by linear elements. Organs slide past ribs, which a
//! mesh cannot: where an element would fold, nodes of organs go free.

use std::collections::BTreeMap;
use std::f64::consts::PI;

use nalgebra::{Matrix1, Point3, Vector1};

use super::deform::Nodes;
use super::paths::BreathingSpec;
use super::stiffness::Stiffness;
use super::target::Body;
use insonify_base::text::some_of;
use insonify_mesh::TetMesh;

/// Travel of organs from end to end of a breath, mm: centres of gravity of twelve persons in dynamic MRI (Bussels et
/// al. 2003, "Respiration-induced movement of the upper abdominal organs"), the mean of both kidneys; the spleen, which
/// lies on the diaphragm as the liver does, with the liver.
const TRAVEL_MM: [(&str, f64); 4] = [("liver", 24.4), ("spleen", 24.4), ("pancreas", 23.7), ("kidney", 16.5)];

/// Longest travel of an organ, mm.
pub(super) const LONGEST_MM: f64 = 100.0;

/// Least volume of an element, over that at rest.
const LEAST_VOLUME: f64 = 0.1;
/// Rounds of freeing nodes, and rings of elements around a folded one that are searched for a node to free.
const MAX_ROUNDS: usize = 100;
const MAX_RINGS: usize = 6;
/// Parts of an edge between which labels are looked up.
const SAMPLES: u8 = 6;
/// Share of its travel that an organ must go on average, or it is told.
const TOLD_BELOW: f64 = 0.9;

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
    /// Notes on travels that differ from those stated.
    pub notes: Vec<String>,
    /// Organs that are stated and are not in the volume.
    pub absent: Vec<String>,
}

/// Computes the displacements of a mesh's nodes at the end of inspiration, 0 at those that are `held`; `finer` says in
/// words how there are more nodes.
pub(super) fn inspired(spec: &BreathingSpec, mesh: &TetMesh, body: &Body<'_>, held: &[u32], finer: &str) -> Inspired {
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
    let volume = body.volume.undivided();
    let labels: Vec<u8> = mesh
        .nodes()
        .iter()
        .map(|node| volume.label_index_at(&(*node).into()).unwrap_or(0))
        .collect();
    let laplace = Stiffness::laplace(mesh);
    let is_of_organ = |node: u32| travel_of.contains_key(&labels[node as usize]);
    let is_air = |node: u32| body.is_outside(labels[node as usize]);
    // Air that is beside organs is no air but tissue without labels.
    let beside = laplace.edges.iter().filter_map(|([a, b], _)| {
        let pair = [(*a, *b), (*b, *a)];
        pair.into_iter()
            .find(|(organ, other)| is_of_organ(*organ) && !is_of_organ(*other))
            .map(|(_, other)| is_air(other))
    });
    let [of_air, all] = beside.fold([0, 0], |[of_air, all], is_air| [of_air + usize::from(is_air), all + 1]);
    let is_filled = 2 * of_air <= all;
    let is_fixed =
        |label: u8| body.is_bone(label) || matches!(body.tissues.tissue(label).name.as_ref(), "skin" | "cartilage");
    let mut rests: Vec<bool> = (0..)
        .zip(&labels)
        .map(|(node, &label)| is_fixed(label) || (is_filled && is_air(node)))
        .collect();
    // Ribs and skin are thinner than elements: what an edge crosses rests with both of its nodes.
    for (edge, _) in &laplace.edges {
        let [a, b] = edge.map(|node| Point3::from(mesh.nodes()[node as usize]));
        let crossed = (1..SAMPLES).map(|sample| a + (b - a) * (f64::from(sample) / f64::from(SAMPLES)));
        let mut crossed = crossed.filter_map(|point| volume.label_index_at(&point));
        if crossed.any(is_fixed) {
            edge.iter().for_each(|node| rests[*node as usize] = true);
        }
    }
    held.iter().for_each(|node| rests[*node as usize] = true);
    let travel_at = |(label, rests): (&u8, &bool)| {
        let travel_mm = travel_of.get(label).map(|(_, travel_mm)| *travel_mm);
        if *rests { Some(0.0) } else { travel_mm }
    };
    let prescribed = labels.iter().zip(&rests).map(travel_at).collect();
    let reached = unfolded(mesh, &laplace, prescribed, &rests);

    let (mut unresolved, mut shortened, mut notes) = (Vec::new(), Vec::new(), Vec::new());
    for (organ, travel_mm) in &travels {
        let is_of_this = |label: &u8| travel_of.get(label).is_some_and(|(name, _)| *name == organ);
        let pairs = labels.iter().zip(&reached).filter(|(label, _)| is_of_this(label));
        let (sum, count) = pairs.fold((0.0, 0_u32), |(sum, count), (_, mm)| (sum + mm, count + 1));
        let mean_mm = sum / f64::from(count.max(1));
        if count == 0 && travel_of.values().any(|(name, _)| *name == organ) {
            unresolved.push(organ.clone());
        } else if count > 0 && mean_mm < TOLD_BELOW * travel_mm {
            shortened.push(format!("{organ} by {mean_mm:.1} of {travel_mm} mm on average"));
        }
    }
    if !unresolved.is_empty() {
        notes.push(format!(
            "no node of the mesh lies in {}: it goes with what surrounds it ({finer})",
            some_of(&unresolved)
        ));
    }
    if !shortened.is_empty() {
        notes.push(format!(
            "breathing in, organs go less far than stated, as what is beside them rests: {}",
            some_of(&shortened)
        ));
    }
    if !is_filled {
        notes.push("what surrounds the organs has no labels and goes with the breath, too".to_owned());
    }
    Inspired {
        displacements: reached.into_iter().map(|mm| [0.0, 0.0, -mm]).collect(),
        notes,
        absent,
    }
}

/// Continues prescribed travels to all nodes, without a folded element.
fn unfolded(mesh: &TetMesh, laplace: &Stiffness<1>, mut prescribed: Vec<Option<f64>>, rests: &[bool]) -> Vec<f64> {
    let at_rest: Vec<f64> = mesh.volumes(mesh.nodes()).collect();
    let mut travels = vec![0.0; prescribed.len()];
    for round in 0.. {
        let pairs = prescribed.iter().zip(&travels);
        let mut values: Vec<Vector1<f64>> = pairs.map(|(stated, mm)| Vector1::new(stated.unwrap_or(*mm))).collect();
        let is_free = |stated: &Option<f64>| {
            if stated.is_none() {
                Matrix1::identity()
            } else {
                Matrix1::zeros()
            }
        };
        laplace.solve(&prescribed.iter().map(is_free).collect::<Vec<_>>(), &mut values);
        travels.iter_mut().zip(values).for_each(|(mm, value)| *mm = value.x);
        let pairs = mesh.nodes().iter().zip(&travels);
        let moved: Nodes = pairs.map(|(&[x, y, z], mm)| [x, y, z - mm]).collect();
        let volumes = mesh.volumes(&moved).zip(&at_rest).enumerate();
        let folded: Vec<(usize, [f64; 2])> = volumes
            .filter(|(_, (moved, rest))| **rest > 0.0 && *moved < LEAST_VOLUME * **rest)
            .map(|(element, (moved, rest))| (element, [moved, *rest]))
            .collect();
        if folded.is_empty() {
            break;
        }
        if round == MAX_ROUNDS || !set_free(mesh, &folded, &travels, &mut prescribed, rests) {
            // Along one axis volumes are linear in the travel.
            let shares = folded
                .iter()
                .map(|(_, [moved, rest])| (1.0 - LEAST_VOLUME) * rest / (rest - moved));
            let share = shares.fold(1.0, f64::min);
            travels.iter_mut().for_each(|mm| *mm *= share);
            break;
        }
    }
    travels
}

/// Sets free what goes farthest in each folded element, or else what is nearest to them, but for what rests; `false` if
/// there is nothing.
fn set_free(
    mesh: &TetMesh,
    folded: &[(usize, [f64; 2])],
    travels: &[f64],
    prescribed: &mut [Option<f64>],
    rests: &[bool],
) -> bool {
    let corners = |element: usize| mesh.elements()[element].map(|node| node as usize);
    let mut is_any_free = false;
    let mut is_near = vec![false; prescribed.len()];
    for nodes in folded.iter().map(|(element, _)| corners(*element)) {
        let farthest = nodes.into_iter().max_by(|a, b| travels[*a].total_cmp(&travels[*b]));
        if let Some(node) = farthest.filter(|node| !rests[*node]) {
            is_any_free |= prescribed[node].take().is_some();
        }
        nodes.into_iter().for_each(|node| is_near[node] = true);
    }
    for _ in 0..MAX_RINGS {
        if is_any_free {
            break;
        }
        for node in (0..prescribed.len()).filter(|node| is_near[*node] && !rests[*node]) {
            is_any_free |= prescribed[node].take().is_some();
        }
        let inner = is_near.clone();
        let ring = (0..mesh.elements().len())
            .map(corners)
            .filter(|nodes| nodes.iter().any(|node| inner[*node]));
        ring.flatten().for_each(|node| is_near[node] = true);
    }
    is_any_free
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

    fn lattice() -> TetMesh {
        TetMesh::lattice([3, 3, 12], &nalgebra::Matrix4::new_scaling(60.0)).expect("a mesh")
    }

    /// An organ from 30 mm on that goes 24 mm towards a floor goes all of it, and one that would fold what is below
    /// goes free there; what rests does so in any case.
    #[test]
    fn no_element_folds_however_far_an_organ_goes() {
        let mesh = lattice();
        let laplace = Stiffness::laplace(&mesh);
        let rests: Vec<bool> = mesh.nodes().iter().map(|node| node[2] == 0.0).collect();
        for (travel_mm, from_mm, is_whole) in [(24.0, 30.0, true), (24.0, 20.0, false), (50.0, 5.0, false)] {
            let at = |node: &[f64; 3]| match node[2] {
                0.0 => Some(0.0),
                z => (z >= from_mm).then_some(travel_mm),
            };
            let prescribed: Vec<Option<f64>> = mesh.nodes().iter().map(at).collect();
            let travels = unfolded(&mesh, &laplace, prescribed, &rests);
            let pairs = || mesh.nodes().iter().zip(&travels);
            let moved: Nodes = pairs().map(|(&[x, y, z], mm)| [x, y, z - mm]).collect();
            let mut volumes = mesh.volumes(&moved).zip(mesh.volumes(mesh.nodes()));
            assert!(volumes.all(|(moved, rest)| moved > 0.99 * LEAST_VOLUME * rest));
            assert!(pairs().all(|(node, mm)| node[2] > 0.0 || *mm == 0.0));
            let goes_whole = pairs().all(|(node, mm)| node[2] < from_mm || *mm == travel_mm);
            assert_eq!(goes_whole, is_whole, "{travel_mm} mm from {from_mm} mm");
            let farthest = travels.iter().copied().fold(0.0, f64::max);
            assert!(farthest > 0.9 * travel_mm.min(50.0), "{farthest} of {travel_mm} mm");
        }
    }
}
