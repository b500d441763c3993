//! Automatic placement of a probe: on the skin over a target, or inside it.
//!
//! Rays are cast outwards from points inside the target; where one leaves the body for air, not through a face of the
//! volume that cuts the body, the probe could stand. Each such position is scored by a fan of rays: how many reach the
//! target before bone or gas, how much of the target they see, how much of the sector shows nothing, how far away the
//! target is and how perpendicular the probe is to the skin. From the best positions the probe is slid over the skin,
//! rocked and tilted, as a hand does it, as long as the score rises. If it may be, the array is pressed in so far that
//! its ends come within reach of the skin. A position from which an end lies off the skin, or past a face that cuts the
//! body, is taken only where there is no other.

mod lumen;

use insonify_base::note::Note;
use insonify_base::parallel;
use nalgebra::{Matrix4, Point3, Vector3};

use super::TrackingError;
use super::probe::{BeamGrid, Curvilinear, Probe, ProbeShape, Site};
use insonify_anatomy::volume::LabelVolume;

/// Number of rays of the fan that scores a position.
pub const RAYS: usize = 15;
/// Step along rays, mm.
const STEP_MM: f64 = 1.5;
/// Least indentation of the skin at the array's centre, mm.
const PRESS_MM: f64 = 0.5;
/// Largest indentation, mm: a firm press of an abdomen.
const MAX_PRESS_MM: f64 = 10.0;
/// Share of the widest gap at the ends by which the array is pressed in: the skin gives way as much as it comes nearer.
const PRESSED: f64 = 0.5;
/// Number of positions from which the probe is moved, and of rounds; in each it moves by half as much as before.
const STARTS: usize = 6;
const ROUNDS: i32 = 3;
/// First moves: degrees about the aim, by which the probe slides over the skin, and of rocking and tilting.
const SLIDE_DEG: f64 = 5.0;
const LEAN_DEG: f64 = 8.0;
/// Thickness of air required outside the skin before the edge of the volume, mm.
const AIR_MM: f64 = 3.0;
/// Number of target points that the probe is aimed at: the innermost one and some around it.
const AIMS: usize = 7;
/// Step in which gaps are found, mm.
const GAP_STEP_MM: f64 = 0.5;
/// Radius of the neighbourhood for estimating the skin's normal, mm.
const NORMAL_MM: f64 = 10.0;

/// Orientation of the scan plane.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ScanPlane {
    /// Across the body: from in front and behind, image columns run towards the patient's left; from the patient's
    /// right side, towards the front.
    #[default]
    Transverse,
    /// Along the body: image columns run towards the feet.
    Sagittal,
}

/// Options of a placement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlacementOptions {
    /// Orientation of the scan plane; `None` tries both.
    pub plane: Option<ScanPlane>,
    /// Field of view of the probe. Its array's centre, the point of a convex array that touches first, lies on the
    /// skin.
    pub shape: ProbeShape,
    /// Imaging depth, mm.
    pub depth_mm: f64,
    /// Widest gap between array and skin that counts as contact, mm.
    pub reach_mm: f64,
    /// Whether the array may be pressed in, and moved off bone and gas.
    pub may_press: bool,
}

impl Default for PlacementOptions {
    fn default() -> Self {
        Self {
            plane: None,
            shape: ProbeShape::Curvilinear(Curvilinear {
                radius_mm: 60.0,
                angle_deg: 70.0,
            }),
            depth_mm: 150.0,
            reach_mm: 12.0,
            may_press: true,
        }
    }
}

/// Classification of labels for a placement, by label index.
pub struct Meaning<'a> {
    /// Whether a label is part of the body, skin included (air around it is not; gas inside it is).
    pub is_body: &'a (dyn Fn(u8) -> bool + Sync),
    /// Whether a label is bone or gas: nothing is visible behind it.
    pub is_bone_or_gas: &'a (dyn Fn(u8) -> bool + Sync),
}

/// A position for a probe.
#[derive(Clone, Debug, PartialEq)]
pub struct Placement {
    /// Probe-to-world transform, LPS mm.
    pub probe_to_world: Matrix4<f64>,
    /// Fraction of the fan's rays that reach the target before bone or gas (0 to 1).
    pub rays_on_target: f64,
    /// Fraction of the target within the fan that is not hidden behind bone or gas (0 to 1).
    pub visible: f64,
    /// Depth at which the middle ray or its nearest neighbour enters the target, mm.
    pub target_depth_mm: f64,
    /// Score of this position; larger is better, comparable within one target only.
    pub score: f64,
    /// Description of the choice, for the user.
    pub note: Note,
}

/// Places a probe on the skin over the labels `target` (indices), from the front or the side where possible; one whose
/// [`Site`] is a lumen in the middle of the target, across its axis.
///
/// # Errors
/// [`TrackingError`]: no such voxels, no skin in reach, a depth that is not positive, or a lumen that is too narrow.
pub fn place(
    volume: &LabelVolume,
    target: &[u8],
    meaning: &Meaning<'_>,
    options: &PlacementOptions,
) -> Result<Placement, TrackingError> {
    if !(options.depth_mm > 0.0 && options.depth_mm.is_finite()) {
        let text = format!("imaging depth {} mm; expected a positive number", options.depth_mm);
        return Err(TrackingError::at("depth_mm", text));
    }
    let aims = aims(volume, target).ok_or_else(|| {
        TrackingError::new(format!(
            "the target has no voxels in the volume (label indices {target:?})"
        ))
    })?;
    if options.shape.kind().site() == Site::Lumen {
        return lumen::place(volume, target, options);
    }
    let mut in_target = [false; 256];
    for &label in target {
        in_target[usize::from(label)] = true;
    }
    let probe = Probe {
        lines: RAYS as u32,
        samples: 1,
        ..Probe::new(options.shape, options.depth_mm)?
    };
    let search = Search {
        volume,
        in_target,
        meaning,
        options,
        fan: BeamGrid::new(&probe)?,
    };
    // From the front and the sides, up to ten degrees behind them; all round only if that finds nothing.
    let mut cut = None;
    for widest in [100, 180] {
        match search.best(&aims, widest) {
            Some(best) if best.beyond == 0.0 => return Ok(best.placement),
            other => cut = cut.or(other),
        }
    }
    if let Some(best) = cut {
        return Ok(best.placement);
    }
    Err(if search.finds_skin(&aims) {
        TrackingError::new(format!(
            "the target is hidden: from every place on the skin in reach it lies behind bone or gas or deeper than \
             {} mm. Give the probe's pose, or a larger depth",
            options.depth_mm
        ))
    } else {
        TrackingError::new(
            "no skin is in reach of the target: in every direction the body ends at the edge of the volume. Complete the \
             body (unlabelled = \"auto\") or give the probe's pose",
        )
    })
}

/// Greatest depth, up to `limit_mm`, at which a ray of a field meets the label `target` (index) before one that
/// `is_hiding` all behind it, mm.
pub fn deepest_mm(
    volume: &LabelVolume,
    target: u8,
    is_hiding: &dyn Fn(u8) -> bool,
    probe_to_world: &Matrix4<f64>,
    (grid, limit_mm): (&BeamGrid, f64),
) -> Option<f64> {
    let mut deepest: Option<f64> = None;
    let stride = (grid.lines() / RAYS).max(1);
    for ray in grid.rays().iter().step_by(stride) {
        let start = probe_to_world.transform_point(&Point3::new(ray.origin[0], ray.origin[1], 0.0));
        let direction = probe_to_world.transform_vector(&Vector3::new(ray.direction[0], ray.direction[1], 0.0));
        let mut depth = 0.5 * STEP_MM;
        while depth < limit_mm {
            if let Some(label) = volume.label_index_at(&(start + direction * depth)) {
                if label == target {
                    deepest = Some(deepest.map_or(depth, |before| before.max(depth)));
                } else if is_hiding(label) {
                    break;
                }
            }
            depth += STEP_MM;
        }
    }
    deepest
}

/// A position of the probe: where a ray outwards from a point leaves the body, and how the probe stands there.
#[derive(Clone, Copy)]
struct Position {
    aim: Point3<f64>,
    outward: Vector3<f64>,
    /// Lean of the probe from the direction to the aim, in the plane and out of it, degrees.
    lean_deg: [f64; 2],
    plane: ScanPlane,
}

impl Position {
    /// Axes of the probe.
    fn axes(&self) -> [Vector3<f64>; 3] {
        let [x, axial, z] = axes(-self.outward, self.plane);
        let [rock, tilt] = self.lean_deg.map(|degrees| degrees.to_radians().tan());
        axes((axial + x * rock + z * tilt).normalize(), self.plane)
    }

    /// The probe slid, rocked and tilted by a share of the first moves.
    fn moved(&self, [slide, slide_out, rock, tilt]: [f64; 4]) -> Self {
        let [x, _, z] = axes(-self.outward, self.plane);
        let [slide, slide_out] = [slide, slide_out].map(|share| (share * SLIDE_DEG).to_radians().tan());
        Self {
            outward: (self.outward + x * slide + z * slide_out).normalize(),
            lean_deg: [self.lean_deg[0] + rock * LEAN_DEG, self.lean_deg[1] + tilt * LEAN_DEG],
            ..*self
        }
    }
}

/// A placement that may be chosen.
#[derive(Clone)]
struct Candidate {
    position: Position,
    placement: Placement,
    /// Fraction of the array past a face that cuts the body.
    beyond: f64,
    /// Whether both ends of the array touch the skin, or nothing makes them.
    touches: bool,
}

impl Candidate {
    fn rank(&self) -> (bool, bool, f64) {
        (self.beyond == 0.0, self.touches, self.placement.score)
    }
}

struct Search<'a> {
    volume: &'a LabelVolume,
    in_target: [bool; 256],
    meaning: &'a Meaning<'a>,
    options: &'a PlacementOptions,
    /// The rays that score a position.
    fan: BeamGrid,
}

impl Search<'_> {
    /// Best position over all aims and directions up to `widest` degrees from the front.
    fn best(&self, aims: &[Point3<f64>], widest: i32) -> Option<Candidate> {
        let candidates = parallel::map(&outwards(aims, widest)[..], &|&(aim, outward)| {
            let planes = match self.options.plane {
                Some(plane) => vec![plane],
                None => vec![ScanPlane::Transverse, ScanPlane::Sagittal],
            };
            let position = |plane| Position {
                aim,
                outward,
                lean_deg: [0.0; 2],
                plane,
            };
            let candidates = planes.into_iter().filter_map(|plane| self.candidate(&position(plane)));
            candidates.collect::<Vec<_>>()
        });
        let mut candidates: Vec<Candidate> = candidates.into_iter().flatten().collect();
        // The first of equal ones: the same at any number of threads.
        candidates.sort_by(|a, b| b.rank().partial_cmp(&a.rank()).unwrap_or(std::cmp::Ordering::Equal));
        // Without pressing, the array stays where a direction led it: an insertion begins beside it.
        if !self.options.may_press {
            return candidates.into_iter().next();
        }
        candidates.truncate(STARTS);
        let moved = parallel::map(&candidates[..], &|candidate| self.moved(candidate.clone()));
        let better = |best: Candidate, next: Candidate| if next.rank() > best.rank() { next } else { best };
        moved.into_iter().reduce(better)
    }

    /// The position that small moves lead to.
    fn moved(&self, start: Candidate) -> Candidate {
        let mut best = start;
        for round in 0..ROUNDS {
            let share = 0.5f64.powi(round);
            loop {
                let moves = (0..8).map(|number| {
                    let mut by = [0.0; 4];
                    by[number / 2] = if number % 2 == 0 { share } else { -share };
                    best.position.moved(by)
                });
                let nearby: Vec<Candidate> = moves.filter_map(|position| self.candidate(&position)).collect();
                let next = nearby
                    .into_iter()
                    .reduce(|a, b| if b.rank() > a.rank() { b } else { a });
                match next {
                    Some(next) if next.rank() > best.rank() => best = next,
                    _ => break,
                }
            }
        }
        best
    }

    /// Whether any ray reaches skin.
    fn finds_skin(&self, aims: &[Point3<f64>]) -> bool {
        outwards(aims, 180)
            .iter()
            .any(|(aim, outward)| self.skin(aim, outward).is_some())
    }

    fn candidate(&self, position: &Position) -> Option<Candidate> {
        let skin = self.skin(&position.aim, &position.outward)?;
        let axes = position.axes();
        let axial = axes[1];
        let inward = self.inward_normal(&skin)?;
        let upright = axial.dot(&inward);
        // More than 53 degrees off the skin's normal the array would stand on its edge.
        if upright < 0.6 {
            return None;
        }
        let mut pressed_mm = PRESS_MM;
        let mut pose = pose(skin + axial * pressed_mm, &axes);
        if self.options.may_press {
            let gap_mm = self.end_gap_mm(&pose);
            // Without skin below an end, no press helps.
            let wanted_mm = if gap_mm.is_finite() { PRESSED * gap_mm } else { 0.0 };
            pressed_mm = wanted_mm.min(MAX_PRESS_MM).min(self.options.reach_mm).max(PRESS_MM);
            pose = self::pose(skin + axial * pressed_mm, &axes);
        }
        let above_mm = if self.options.may_press { pressed_mm } else { 0.0 };
        let fan = self.look(&pose, above_mm);
        if fan.seen <= 0.0 {
            return None;
        }
        let touches = !self.options.may_press || self.end_gap_mm(&pose) <= self.options.reach_mm;
        let visible = fan.seen / (fan.seen + fan.hidden);
        let from_behind = axial.y.min(0.0).abs();
        let size = fan.seen.sqrt() / self.options.depth_mm;
        let depth = fan.depth_mm / self.options.depth_mm;
        let dark = if self.options.may_press {
            PER_DARK * fan.dark
        } else {
            PER_OUTSIDE * fan.outside + PER_BLOCKED * fan.blocked
        };
        let score = fan.share + visible + PER_SIZE * size
            - PER_DEPTH * depth
            - PER_TILT * (1.0 - upright)
            - FROM_BEHIND * from_behind
            - dark
            - GAP_PER_MM * fan.gap_mm;
        let side = match (axial.x, axial.y) {
            (x, y) if y.abs() >= x.abs() => {
                if y > 0.0 {
                    "front"
                } else {
                    "back"
                }
            }
            (x, _) if x > 0.0 => "right side",
            _ => "left side",
        };
        let mut head = format!(
            "from the {side}, {:.0} mm deep, {:.0} % of the rays reach the target",
            fan.depth_mm,
            100.0 * fan.share
        );
        let hidden_percent = 100.0 * (1.0 - visible);
        if hidden_percent >= 0.5 {
            head.push_str(&format!(
                "; {hidden_percent:.0} % of it in view lies behind bone or gas"
            ));
        }
        if fan.beyond > 0.0 {
            head.push_str(&format!(
                "; {:.0} % of the array lies past a face of the volume that cuts the body",
                100.0 * fan.beyond
            ));
        }
        let placement = Placement {
            probe_to_world: pose,
            rays_on_target: fan.share,
            visible,
            target_depth_mm: fan.depth_mm,
            score,
            note: Note::new(
                head,
                format_args!(
                    "probe on the skin at ({:.0}, {:.0}, {:.0}) mm, pressed in by {pressed_mm:.1} mm",
                    skin.x, skin.y, skin.z
                ),
            ),
        };
        Some(Candidate {
            position: *position,
            placement,
            beyond: fan.beyond,
            touches,
        })
    }

    fn is_body(&self, p: &Point3<f64>) -> Option<bool> {
        self.volume.label_index_at(p).map(|label| (self.meaning.is_body)(label))
    }

    /// Whether the body is cut by the face of the volume beside a point outside it.
    fn is_cut_beside(&self, p: &Point3<f64>) -> bool {
        let index = self.volume.world_to_index().transform_point(p);
        let inside = [0, 1, 2].map(|axis| index[axis].clamp(0.0, self.volume.size()[axis] as f64 - 1.0));
        self.volume.label_at_index(inside).is_some_and(self.meaning.is_body)
    }

    /// Point where a ray from inside leaves the body for the last time; `None` if it leaves through a face of the
    /// volume.
    fn skin(&self, from: &Point3<f64>, outward: &Vector3<f64>) -> Option<Point3<f64>> {
        let mut last_inside = None;
        let mut travelled = 0.0;
        // To the end of the volume, not to the first air: gaps within the body are not its skin.
        while let Some(body) = self.is_body(&(from + outward * travelled)) {
            if body {
                last_inside = Some(travelled);
            }
            travelled += STEP_MM;
        }
        let inside = last_inside.filter(|inside| travelled - inside >= AIR_MM + STEP_MM)?;
        let (mut low, mut high) = (inside, inside + STEP_MM);
        for _ in 0..6 {
            let middle = 0.5 * (low + high);
            if self.is_body(&(from + outward * middle))? {
                low = middle;
            } else {
                high = middle;
            }
        }
        Some(from + outward * low)
    }

    /// Direction from a point of the skin towards the centre of the body around it.
    fn inward_normal(&self, skin: &Point3<f64>) -> Option<Vector3<f64>> {
        let mut sum = Vector3::zeros();
        for a in -4..=4 {
            for b in -4..=4 {
                for c in -4..=4 {
                    let offset = Vector3::new(f64::from(a), f64::from(b), f64::from(c)) * (NORMAL_MM / 4.0);
                    if offset.norm() <= NORMAL_MM && self.is_body(&(skin + offset)) == Some(true) {
                        sum += offset;
                    }
                }
            }
        }
        sum.try_normalize(1e-9)
    }

    /// Wider of the gaps between the ends of the array and the skin, mm; infinite where there is no skin.
    fn end_gap_mm(&self, pose: &Matrix4<f64>) -> f64 {
        let ends = [0, RAYS - 1].map(|ray| {
            let ray = self.fan.rays()[ray];
            let start = pose.transform_point(&Point3::new(ray.origin[0], ray.origin[1], 0.0));
            let direction = pose.transform_vector(&Vector3::new(ray.direction[0], ray.direction[1], 0.0));
            let steps = (self.options.depth_mm / GAP_STEP_MM) as usize;
            let gaps = (0..steps).map(|step| step as f64 * GAP_STEP_MM);
            let mut gaps = gaps.filter(|gap| self.is_body(&(start + direction * *gap)) == Some(true));
            gaps.next().unwrap_or(f64::INFINITY)
        });
        ends[0].max(ends[1])
    }

    /// Evaluates the fan of rays of a pose, and what lies above it where the array is pressed in.
    fn look(&self, pose: &Matrix4<f64>, above_mm: f64) -> Fan {
        let mut fan = Fan::default();
        let mut all = 0.0;
        let middle = (RAYS - 1) as f64 / 2.0;
        let mut nearest_to_middle = f64::INFINITY;
        for (ray_index, ray) in self.fan.rays().iter().enumerate() {
            let across = (ray_index as f64 - middle) / middle;
            let start = pose.transform_point(&Point3::new(ray.origin[0], ray.origin[1], 0.0));
            let direction = pose.transform_vector(&Vector3::new(ray.direction[0], ray.direction[1], 0.0));
            let (mut blocked, mut reached, mut touched, mut beyond) = (false, None, false, false);
            // Tissue that gives way to the array lies before it all the same.
            let mut depth = 0.5 * STEP_MM - above_mm;
            while depth < 0.0 {
                let label = self.volume.label_index_at(&(start + direction * depth));
                blocked |= label.is_some_and(self.meaning.is_bone_or_gas);
                depth += STEP_MM;
            }
            while depth < self.options.depth_mm {
                let point = start + direction * depth;
                let area = STEP_MM * self.fan.lateral_spacing_mm(depth);
                all += area;
                let Some(label) = self.volume.label_index_at(&point) else {
                    beyond = beyond || (!touched && self.is_cut_beside(&point));
                    fan.dark += area;
                    fan.outside += STEP_MM / (self.options.depth_mm * RAYS as f64);
                    depth += STEP_MM;
                    continue;
                };
                // A gap before the skin is lost contact; gas behind it is anatomy.
                touched |= (self.meaning.is_body)(label);
                if !touched {
                    fan.gap_mm += STEP_MM / RAYS as f64;
                }
                if blocked || (touched && !(self.meaning.is_body)(label)) {
                    fan.dark += area;
                }
                if self.in_target[usize::from(label)] {
                    if blocked {
                        fan.hidden += area;
                    } else {
                        fan.seen += area;
                        reached.get_or_insert(depth);
                    }
                } else if (self.meaning.is_bone_or_gas)(label) && !blocked {
                    blocked = true;
                    fan.blocked += (1.0 - depth / self.options.depth_mm) / RAYS as f64;
                }
                depth += STEP_MM;
            }
            fan.beyond += if beyond { 1.0 / RAYS as f64 } else { 0.0 };
            if let Some(reached) = reached {
                fan.share += 1.0 / RAYS as f64;
                if across.abs() < nearest_to_middle {
                    nearest_to_middle = across.abs();
                    fan.depth_mm = reached;
                }
            }
        }
        fan.dark /= all;
        fan
    }
}

/// Rays from every aim, ten degrees apart around the body and eight along it.
fn outwards(aims: &[Point3<f64>], widest: i32) -> Vec<(Point3<f64>, Vector3<f64>)> {
    aims.iter()
        .flat_map(|&aim| {
            (-widest / 10..=widest / 10).flat_map(move |round| {
                (-4..=4).map(move |tilt| {
                    let (sin, cos) = f64::from(round * 10).to_radians().sin_cos();
                    let (up, level) = f64::from(tilt * 8).to_radians().sin_cos();
                    (aim, Vector3::new(sin * level, -cos * level, up))
                })
            })
        })
        .collect()
}

// Weights of the score. The unit is the share of the rays that reach the target; its visible part counts as much.

/// Weight of the target's size, the side of the square of its seen area over the imaging depth: of two views without
/// bone or gas in the way, the larger section.
const PER_SIZE: f64 = 1.5;
/// Weight of the depth of the target over the imaging depth: echoes weaken on the way, and beams widen.
const PER_DEPTH: f64 = 0.8;
/// Weight of 1 minus the cosine of the angle to the skin's normal: 10 degrees cost a tenth, as a hand tilts a probe
/// freely so far, 30 degrees most of a full view, as one end of the array lifts off.
const PER_TILT: f64 = 6.0;
/// Weight of the direction from behind: a patient lies on the back.
const FROM_BEHIND: f64 = 0.7;
/// Weight of the share of the sector that shows nothing: outside the volume, behind bone or gas, in air.
const PER_DARK: f64 = 2.0;
/// Weights of the shares of the rays outside the volume, and behind bone or gas, where the array is not pressed in.
const PER_OUTSIDE: f64 = 0.4;
const PER_BLOCKED: f64 = 0.5;
/// Score penalty per millimetre of air between array and skin: a convex array on flat skin has about 4 mm, and one with
/// an end in the air twice that and more.
const GAP_PER_MM: f64 = 0.06;

/// Result of casting a fan of rays.
#[derive(Default)]
struct Fan {
    /// Fraction of the rays that reach the target.
    share: f64,
    /// Area of the target in the scan plane in front of and behind bone or gas, mm^2.
    seen: f64,
    hidden: f64,
    /// Fraction of the sector that shows nothing.
    dark: f64,
    /// Fractions of the rays outside the volume, and behind bone or gas.
    outside: f64,
    blocked: f64,
    /// Fraction of the rays that meet no skin before they are past a face that cuts the body.
    beyond: f64,
    /// Gap of air between array and skin, mm, averaged over the rays.
    gap_mm: f64,
    /// Depth of the target near the middle ray, mm.
    depth_mm: f64,
}

/// Axes of a probe for a direction into the body.
fn axes(axial: Vector3<f64>, plane: ScanPlane) -> [Vector3<f64>; 3] {
    let lateral = match plane {
        // Continuous around the body, so that the same side of the probe stays marked; not upside down from behind.
        ScanPlane::Transverse => {
            let x = axial.cross(&Vector3::z());
            if x.x < -0.2 { -x } else { x }
        }
        ScanPlane::Sagittal => -Vector3::z(),
    };
    let x = (lateral - axial * lateral.dot(&axial)).normalize();
    [x, axial, x.cross(&axial)]
}

/// Probe-to-world transform for an array centre and the axes of a probe.
fn pose(origin: Point3<f64>, [x, axial, z]: &[Vector3<f64>; 3]) -> Matrix4<f64> {
    Matrix4::new(
        x.x, axial.x, z.x, origin.x, //
        x.y, axial.y, z.y, origin.y, //
        x.z, axial.z, z.z, origin.z, //
        0.0, 0.0, 0.0, 1.0,
    )
}

/// Points of the target to aim at: the voxel nearest to its centre, then voxels spread through it. `None` without
/// voxels.
pub fn aims(volume: &LabelVolume, target: &[u8]) -> Option<Vec<Point3<f64>>> {
    let [nx, ny, _] = volume.size();
    let voxels: Vec<usize> = volume
        .voxels()
        .iter()
        .enumerate()
        .filter_map(|(voxel, label)| target.contains(label).then_some(voxel))
        .collect();
    let world = |voxel: usize| {
        let index = Point3::new(
            (voxel % nx) as f64,
            (voxel / nx % ny) as f64,
            (voxel / (nx * ny)) as f64,
        );
        volume.index_to_world().transform_point(&index)
    };
    let sum: Vector3<f64> = voxels.iter().map(|&voxel| world(voxel).coords).sum();
    let middle = Point3::from(sum / voxels.len() as f64);
    let nearest = voxels
        .iter()
        .map(|&voxel| world(voxel))
        .min_by(|a, b| (a - middle).norm_squared().total_cmp(&(b - middle).norm_squared()))?;
    // The others lie halfway from the centre to evenly spaced voxels of the list, moved onto the target.
    let mut aims = vec![nearest];
    for part in 1..AIMS {
        let far = world(voxels[voxels.len() * part / AIMS]);
        let half_way = nearest + (far - nearest) * 0.5;
        let inside = volume
            .label_index_at(&half_way)
            .is_some_and(|label| target.contains(&label));
        aims.push(if inside { half_way } else { far });
    }
    Some(aims)
}

#[cfg(test)]
mod tests;
