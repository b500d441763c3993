//! Pressing the probe: its face, pushed into the skin, displaces the nodes of a mesh of the labels.
//!
//! Tissue is linear elastic, with the moduli of its labels; bone and the ends of the volume are fixed. The face is rigid
//! and without friction: nodes u of the skin in front of it, at distances g along the beam, and the forces f on them
//! satisfy, at a way d of the face,
//!
//! ```text
//! u - (d - g) >= 0,   f >= 0,   f (u - (d - g)) = 0:
//! ```
//!
//! the face pushes and does not pull. Nodes that violate it are exchanged, all at once or, where that does not settle,
//! the last of them alone (Júdice and Pires 1994). The displacement is that of small strain, so that it stays in
//! proportion once the whole face touches.

use nalgebra::{Matrix3, Point3, Unit, Vector3};

use super::SceneFile;
use super::deform::{DEFAULT_NODES, Motion, Nodes};
use super::paths::MotionSpec;
use super::pulse::{ARTERY_KPA, arteries};
use super::stiffness::Stiffness;
use super::target::Body;
use insonify_anatomy::acoustics::{Tissue, presets};
use insonify_base::document::InputError;
use insonify_base::note::Notes;
use insonify_mesh::TetMesh;
use insonify_mesh::generate::{GenerateError, GenerateOptions, LabelGrid, generate};
use insonify_tracking::pose::Pose;
use insonify_tracking::probe::{BeamGrid, Probe, Site};

/// Thickness of a usual face across the image, mm.
const USUAL_WIDTH_MM: f64 = 10.0;
/// Component of a surface's outward normal against the beam from which on it is in front of the face.
const FACING: f64 = 0.3;
/// Exchanges of all nodes that violate the contact before one is exchanged at a time, and exchanges after which it
/// counts as settled: more are rounding.
const AT_ONCE: usize = 20;
const MAX_EXCHANGES: usize = 100;
/// Relative force, and way (mm), that is rounding.
const ROUNDING: f64 = 1e-6;
/// Relative error of a force, and searches for it.
const FORCE_TOLERANCE: f64 = 1e-3;
const MAX_SEARCHES: usize = 30;
/// Longest way of a face, and from it to skin that it meets, mm.
const LONGEST_MM: f64 = 50.0;

/// A pressed body.
pub(super) struct Pressing {
    pub mesh: TetMesh,
    pub motion: Motion,
    /// Pose of the probe.
    pub pose: Pose,
}

impl SceneFile {
    /// Returns the body under the probe at a pose, if the scene presses it.
    pub(super) fn pressing(
        &self,
        body: &Body<'_>,
        (pose, probe, grid): (&Pose, &Probe, &BeamGrid),
        notes: &mut Notes,
        warnings: &mut Vec<String>,
    ) -> Result<Option<Pressing>, InputError> {
        let Some(spec) = self.motion.as_ref().and_then(|motion| motion.press.as_ref()) else {
            return Ok(None);
        };
        let key = "motion.press";
        self.in_ranges(key, spec)?;
        if self.motion.as_ref().is_some_and(MotionSpec::moves_probe) {
            let found = "`motion.press` of a probe that moves";
            return Err(self.wrong_keys(key, found, "a probe at rest: `[pose]`"));
        }
        if probe.shape.kind().site() != Site::Skin {
            let found = format!("a {} probe, which is not pressed into skin", probe.shape.kind());
            return Err(self.wrong_keys(key, found, "a probe on the skin"));
        }
        if self.deform.as_ref().is_some_and(|deform| deform.mesh.is_some()) {
            let found = "`motion.press` with `deform.mesh`";
            return Err(self.wrong_keys(key, found, "one of them: pressing needs a mesh of the labels"));
        }
        let face = Face::new(pose, grid, spec.face_mm.unwrap_or(USUAL_WIDTH_MM));
        let nodes = self
            .deform
            .as_ref()
            .and_then(|deform| deform.nodes)
            .unwrap_or(DEFAULT_NODES);
        let mesh = mesh_of_labels(body, nodes as usize, &face).map_err(|error| self.fault("deform.nodes", error))?;
        let press = Press::new(body, &mesh, &face);
        let pressed = match (spec.indent_mm, spec.force_n) {
            (Some(depth_mm), None) => press.to_depth(depth_mm),
            (None, Some(force_n)) => press.with_force(force_n),
            _ => {
                let found = "neither or both of `indent_mm` and `force_n`";
                return Err(self.wrong_keys(key, found, "one of them"));
            }
        };
        let Some(pressed) = pressed else {
            let found = format!("a face that meets no skin within {LONGEST_MM} mm, or not with this force");
            return Err(self.wrong_keys(key, found, "a probe whose array is at the skin, pressed less or deeper"));
        };
        notes.push(format!(
            "the probe, pressed by {:.1} mm, pushes with {:.1} N ({} of {} nodes of the skin under it touch it)",
            pressed.depth_mm,
            pressed.force_n,
            pressed.touching,
            press.in_front.len()
        ));
        let motion = Motion::constant(pressed.displacements);
        let folded = motion.folded(&mesh);
        if folded > 0 {
            warnings.push(format!(
                "{folded} of {} elements fold under the probe: press it less, or state more `deform.nodes`",
                mesh.elements().len()
            ));
        }
        let mut matrix = *pose.probe_to_world();
        let shift = pose.axial().into_inner() * pressed.depth_mm;
        (0..3).for_each(|axis| matrix[(axis, 3)] += shift[axis]);
        let pose = Pose::from_matrix(&matrix).map_err(|error| self.fault(key, error))?;
        Ok(Some(Pressing { mesh, motion, pose }))
    }
}

/// The face of a probe at a pose.
struct Face<'a> {
    pose: &'a Pose,
    /// Points of the array, from side to side, mm.
    array: Vec<[f64; 2]>,
    half_width_mm: f64,
}

impl<'a> Face<'a> {
    fn new(pose: &'a Pose, grid: &BeamGrid, width_mm: f64) -> Self {
        let mut array: Vec<[f64; 2]> = grid.rays().iter().map(|ray| ray.origin).collect();
        array.sort_by(|a, b| a[0].total_cmp(&b[0]));
        // Scanlines of a phased array all begin in one point.
        if let [[left, y], .., [right, _]] = array[..]
            && right - left < width_mm
        {
            let middle = 0.5 * (left + right);
            array = [-0.5, 0.5].map(|side| [middle + side * width_mm, y]).into();
        }
        Self {
            pose,
            array,
            half_width_mm: 0.5 * width_mm,
        }
    }

    /// Distance of a point beyond the face along the beam, mm; `None` beside it.
    fn distance_mm(&self, point: &Point3<f64>) -> Option<f64> {
        let point = self.pose.world_to_probe().transform_point(point);
        let after = self.array.partition_point(|place| place[0] <= point.x);
        let (before, after) = (self.array.get(after.checked_sub(1)?)?, self.array.get(after)?);
        let share = (point.x - before[0]) / (after[0] - before[0]);
        let surface = before[1] + share * (after[1] - before[1]);
        (point.z.abs() <= self.half_width_mm).then_some(point.y - surface)
    }

    /// Segments from both ends and the middle of the array into the body, about as far as a pressed face is felt.
    fn segments(&self) -> Vec<[[f64; 3]; 2]> {
        let to_world = self.pose.probe_to_world();
        let ends = [0, self.array.len() / 2, self.array.len() - 1].map(|index| self.array[index]);
        let reach_mm = ends[2][0] - ends[0][0];
        let segment = |[x, y]: [f64; 2]| {
            [y, y + reach_mm].map(|y| <[f64; 3]>::from(to_world.transform_point(&Point3::new(x, y, 0.0))))
        };
        ends.map(segment).into()
    }
}

/// Tissue in front of a face.
struct Press {
    stiffness: Stiffness<3>,
    /// Whether nodes of bone, and of the surface at the ends of the volume, are fixed.
    is_fixed: Vec<bool>,
    along: Unit<Vector3<f64>>,
    /// Nodes of the skin in front of the face, with their distances from it, mm.
    in_front: Vec<(usize, f64)>,
}

/// Tissue under a pressed face.
struct Pressed {
    /// Way of the face, mm.
    depth_mm: f64,
    force_n: f64,
    /// Number of nodes that the face touches.
    touching: usize,
    displacements: Nodes,
}

impl Press {
    fn new(body: &Body<'_>, mesh: &TetMesh, face: &Face<'_>) -> Self {
        let place = |node: u32| Point3::from(mesh.nodes()[node as usize]);
        let (mut faces, mut is_fixed) = (vec![false; mesh.nodes().len()], vec![false; mesh.nodes().len()]);
        let label = |region: &i32| u8::try_from(*region).unwrap_or_default();
        for (corners, region) in mesh.elements().iter().zip(mesh.regions()) {
            if body.is_bone(label(region)) {
                corners.iter().for_each(|node| is_fixed[*node as usize] = true);
            }
        }
        let along = face.pose.axial();
        let step_mm = body.volume.spacing_mm().into_iter().fold(0.0, f64::max);
        for triangle in mesh.surface() {
            let [a, b, c] = triangle.nodes.map(place);
            let corners = mesh.elements()[triangle.element as usize].map(place);
            let middle = Point3::from((a.coords + b.coords + c.coords) / 3.0);
            let inside = corners.iter().map(|corner| corner.coords).sum::<Vector3<f64>>() / 4.0;
            let normal = (b - a).cross(&(c - a)).normalize();
            let outwards = normal * normal.dot(&(middle.coords - inside)).signum();
            let list = if outwards.dot(&along) < -FACING {
                &mut faces
            } else if body.volume.label_index_at(&(middle + outwards * step_mm)).is_none() {
                &mut is_fixed
            } else {
                continue;
            };
            triangle.nodes.iter().for_each(|node| list[*node as usize] = true);
        }
        let of_label = moduli(body);
        let moduli: Vec<[f64; 2]> = mesh
            .regions()
            .iter()
            .map(|region| of_label[usize::from(label(region))])
            .collect();
        let of_skin = (0..mesh.nodes().len()).filter(|&node| faces[node] && !is_fixed[node]);
        let in_front = of_skin
            .filter_map(|node| Some((node, face.distance_mm(&mesh.nodes()[node].into())?)))
            .filter(|(_, distance_mm)| distance_mm.abs() <= LONGEST_MM);
        Self {
            stiffness: Stiffness::elastic(mesh, &moduli),
            in_front: in_front.collect(),
            is_fixed,
            along,
        }
    }

    /// Presses the face by a depth, mm; `None` if it touches nothing.
    fn to_depth(&self, depth_mm: f64) -> Option<Pressed> {
        let mut values = vec![Vector3::zeros(); self.is_fixed.len()];
        self.press(depth_mm, &mut values)
    }

    /// Presses the face with a force, N; `None` if it meets no skin, or not as much force within [`LONGEST_MM`].
    fn with_force(&self, force_n: f64) -> Option<Pressed> {
        let first_mm = self.in_front.iter().map(|(_, distance)| *distance).reduce(f64::min)?;
        let mut values = vec![Vector3::zeros(); self.is_fixed.len()];
        // The force grows with the way, the faster the more of the face touches.
        let [mut less, mut more] = [(first_mm, 0.0), (f64::INFINITY, f64::INFINITY)];
        let mut depth_mm = first_mm + 1.0;
        for _ in 0..MAX_SEARCHES {
            let pressed = self.press(depth_mm, &mut values)?;
            if (pressed.force_n / force_n - 1.0).abs() < FORCE_TOLERANCE {
                return (depth_mm <= LONGEST_MM).then_some(pressed);
            }
            let end = if pressed.force_n < force_n {
                &mut less
            } else {
                &mut more
            };
            *end = (depth_mm, pressed.force_n);
            depth_mm = if more.0.is_finite() {
                less.0 + (more.0 - less.0) * (force_n - less.1) / (more.1 - less.1)
            } else {
                first_mm + 2.0 * (depth_mm - first_mm)
            };
            if less.0 > LONGEST_MM {
                break;
            }
        }
        None
    }

    /// Presses the face by a depth (mm), from displacements that are near.
    fn press(&self, depth_mm: f64, values: &mut [Vector3<f64>]) -> Option<Pressed> {
        let along = &self.along;
        let across = Matrix3::identity() - along.into_inner() * along.transpose();
        let mut touches: Vec<bool> = self.in_front.iter().map(|(_, distance)| *distance < depth_mm).collect();
        let (mut forces, mut all_forces) = (vec![0.0; touches.len()], Vec::new());
        let is_free = |is_fixed: &bool| {
            if *is_fixed {
                Matrix3::zeros()
            } else {
                Matrix3::identity()
            }
        };
        for round in 0..MAX_EXCHANGES {
            let mut free: Vec<Matrix3<f64>> = self.is_fixed.iter().map(is_free).collect();
            let pairs = || {
                self.in_front
                    .iter()
                    .zip(&touches)
                    .map(|((node, distance), touches)| (*node, depth_mm - distance, *touches))
            };
            for (node, way_mm, _) in pairs().filter(|(.., touches)| *touches) {
                free[node] = across;
                values[node] += along.into_inner() * (way_mm - values[node].dot(along));
            }
            self.stiffness.solve(&free, values);
            self.stiffness.forces(values, &mut all_forces);
            // mN to N.
            let at_touching = pairs().map(|(node, _, touches)| {
                if touches {
                    1e-3 * all_forces[node].dot(along)
                } else {
                    0.0
                }
            });
            forces = at_touching.collect();
            let strong = ROUNDING * forces.iter().copied().fold(0.0, f64::max);
            let violates = |(index, (node, way_mm, touches)): &(usize, (usize, f64, bool))| {
                if *touches {
                    forces[*index] < -strong
                } else {
                    values[*node].dot(along) < way_mm - ROUNDING
                }
            };
            let violating: Vec<usize> = pairs().enumerate().filter(violates).map(|(index, _)| index).collect();
            let Some(last) = violating.last() else { break };
            if round < AT_ONCE {
                violating.iter().for_each(|index| touches[*index] = !touches[*index]);
            } else {
                touches[*last] = !touches[*last];
            }
        }
        let force_n = forces.iter().sum();
        (force_n > 0.0).then(|| Pressed {
            depth_mm,
            force_n,
            touching: touches.iter().filter(|touches| **touches).count(),
            displacements: values.iter().map(|value| (*value).into()).collect(),
        })
    }
}

/// Young's modulus (kPa) and Poisson's ratio of each label. Blood is under pressure in arteries and moves away in all
/// other vessels, unless a scene states its moduli.
fn moduli(body: &Body<'_>) -> Vec<[f64; 2]> {
    let blood = presets::get("blood");
    let arteries: Vec<u8> = arteries(body).collect();
    let of_label = |label: u8| {
        let tissue = body.tissues.tissue(label);
        let is = |other: &Tissue| {
            (&tissue.texture, tissue.young_kpa, tissue.poisson) == (&other.texture, other.young_kpa, other.poisson)
        };
        match (blood.is_some_and(is), arteries.contains(&label)) {
            (true, true) => [ARTERY_KPA, tissue.poisson],
            (true, false) => [tissue.young_kpa, 0.0],
            (false, _) => [tissue.young_kpa, tissue.poisson],
        }
    };
    (0..=u8::MAX).take(body.volume.labels().len()).map(of_label).collect()
}

/// Mesh of the labels of a body, finer under a face.
fn mesh_of_labels(body: &Body<'_>, nodes: usize, face: &Face<'_>) -> Result<TetMesh, GenerateError> {
    let volume = body.volume.undivided();
    let labels = 1..volume.labels().len().min(256);
    let regions: Vec<(u8, i32)> = labels
        .filter(|label| volume.holds(*label) && !body.is_outside(*label as u8))
        .map(|label| (label as u8, label as i32))
        .collect();
    let grid = LabelGrid {
        labels: volume.voxels(),
        size: volume.size(),
        index_to_world: *volume.index_to_world(),
        regions: &regions,
    };
    let segments = face.segments();
    let options = GenerateOptions {
        path: &segments,
        along_path: true,
        ..GenerateOptions::default()
    };
    generate(&grid, nodes, &options, |_| ()).map(|generated| generated.mesh)
}

#[cfg(test)]
mod tests {
    use super::*;

    const YOUNG_KPA: f64 = 10.0;
    const POISSON: f64 = 0.3;

    /// A block whose far end is fixed, in front of a face along z that is at `distance` from points of its near end.
    fn block(extent: [f64; 3], cells: [usize; 3], distance: impl Fn(f64, f64) -> Option<f64>) -> Press {
        let mesh = TetMesh::lattice(cells, &nalgebra::Matrix4::new_nonuniform_scaling(&extent.into())).expect("a mesh");
        let nodes = mesh.nodes().iter().enumerate().filter(|(_, [.., z])| *z == 0.0);
        Press {
            stiffness: Stiffness::elastic(&mesh, &vec![[YOUNG_KPA, POISSON]; mesh.elements().len()]),
            is_fixed: mesh.nodes().iter().map(|[.., z]| *z == extent[2]).collect(),
            along: Vector3::z_axis(),
            in_front: nodes
                .filter_map(|(index, [x, y, _])| Some((index, distance(*x, *y)?)))
                .collect(),
        }
    }

    /// A flat round punch on a half-space, F = 2 a E d / (1 - nu^2) (Johnson 1985, "Contact Mechanics", section 3.4), to
    /// which blocks come nearer with smaller elements; by a depth as by the force of it.
    #[test]
    fn a_punch_sinks_in_as_into_a_half_space() {
        let (radius_mm, depth_mm) = (20.0, 2.0);
        let punch_n = 2e-3 * radius_mm * YOUNG_KPA / (1.0 - POISSON * POISSON) * depth_mm;
        let mut before = f64::INFINITY;
        for cells in [16, 32] {
            let is_under = |x: f64, y: f64| (x - 80.0).hypot(y - 80.0) < radius_mm + 1e-9;
            let press = block([160.0, 160.0, 120.0], [cells, cells, 3 * cells / 4], |x, y| {
                is_under(x, y).then_some(0.0)
            });
            let pressed = press.to_depth(depth_mm).expect("contact");
            let error = (pressed.force_n / punch_n - 1.0).abs();
            println!("{cells} cells: {} N for {punch_n}", pressed.force_n);
            assert!(
                error < 0.2 && error < before,
                "{cells} cells: {} N for {punch_n}",
                pressed.force_n
            );
            before = error;
            for (node, _) in &press.in_front {
                assert!((pressed.displacements[*node][2] - depth_mm).abs() < 1e-6);
            }
            let by_force = press.with_force(pressed.force_n).expect("contact");
            assert!((by_force.depth_mm - depth_mm).abs() < 2.0 * FORCE_TOLERANCE * depth_mm);
        }
        assert!(before < 0.12, "{before}");
    }

    /// A round face touches more the deeper it goes, pulls nowhere, and none of the skin lies behind it.
    #[test]
    fn a_round_face_touches_what_it_reaches() {
        let round = |x: f64, y: f64| Some(((x - 40.0).powi(2) + (y - 40.0).powi(2)) / 80.0);
        let press = block([80.0, 80.0, 60.0], [16, 16, 12], round);
        let mut touching = 0;
        for depth_mm in [0.5, 2.0, 5.0] {
            let pressed = press.to_depth(depth_mm).expect("contact");
            assert!(pressed.touching > touching, "{depth_mm} mm: {}", pressed.touching);
            touching = pressed.touching;
            for (node, distance) in &press.in_front {
                let way_mm = pressed.displacements[*node][2];
                assert!(
                    way_mm > depth_mm - distance - 1e-5,
                    "{depth_mm} {distance}: {way_mm} mm"
                );
            }
        }
        assert!(touching < press.in_front.len() / 2);
        assert!(press.to_depth(0.0).is_none() && press.with_force(1e6).is_none());
    }
}
