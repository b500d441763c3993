//! Settings of a scene that are possible and seldom meant.

use nalgebra::Point3;

use super::Scene;
use super::motion::Needle;
use super::paths::NeedleTable;
use super::resolve::{UNITS, scaled, sees};
use super::target::Body;
use crate::effects::compound;
use crate::effects::shadow::SOFT_TISSUE_DB_CM_MHZ;
use crate::effects::shadow::downshift::Downshift;
use crate::effects::table::Origin;
use insonify_anatomy::volume::LabelVolume;
use insonify_base::parallel;
use insonify_base::text::some_of;
use insonify_tracking::needle::NeedlePose;
use insonify_tracking::pose::Pose;
use insonify_tracking::probe::{BeamGrid, Probe, Ray};
use insonify_tracking::trajectory::Trajectory;

/// Field of view below which the angle may be in radians, degrees.
const NARROW_DEG: f64 = 5.0;
/// Loss of an echo, there and back, beyond which no scanner shows it, dB: the dynamic range of a receiver with focusing
/// and averaging.
const SILENT_DB: f64 = 130.0;
/// Length, over the usual one of the kind, up to which it may be in centimetres.
const OF_USUAL: f64 = 0.13;

/// Distance behind the tip at which a reversed needle lies in the body, and distance beyond it at which it does not,
/// mm.
const WITHIN_MM: f64 = 10.0;
const BEYOND_MM: f64 = 2.0;

/// Distance of a needle's tip from a point of its shaft up to which they may be in another unit, mm.
const APART_MM: f64 = 1.0;

/// Depth of tissue behind an array from which it lies within the body, mm: more than indented skin.
const BEHIND_MM: f64 = 20.0;

/// Share of the voxels of bone or gas whose smooth label is another, from which that is told, and the fewest voxels. In
/// segmentations at 3 mm up to 0.19 of a rib that the scan cuts is lost.
const THIN: f64 = 0.25;
const FEWEST_VOXELS: u64 = 50;

/// Doubt about the unit of poses most of which lie within the body, where in another unit most would lie on it.
pub(super) fn of_positions(body: &Body<'_>, grid: &BeamGrid, path: &Trajectory) -> Option<String> {
    let poses = path.keys().len();
    let behind = Point3::new(0.0, -BEHIND_MM, 0.0);
    let is_within = |pose: &Pose| body.label_at(&pose.probe_to_world().transform_point(&behind)).is_some();
    let within = path.keys().iter().filter(|key| is_within(&key.pose)).count();
    if 2 * within <= poses {
        return None;
    }
    let on_body = |factor: f64| {
        let poses = path.keys().iter().filter_map(|key| scaled(&key.pose, factor));
        poses.filter(|pose| !is_within(pose) && sees(body, grid, pose)).count()
    };
    let (unit, on) = UNITS
        .map(|(unit, factor)| (unit, on_body(factor)))
        .into_iter()
        .max_by_key(|(_, on)| *on)?;
    (2 * on > poses).then(|| {
        format!(
            "the probe lies within the body in {within} of {poses} poses. Are the positions in {unit}? In mm as expected it \
             would lie on the body in {on}"
        )
    })
}

/// Note about bone and gas so thin that smooth boundaries lose much of it.
pub(super) fn thin_parts(body: &Body<'_>) -> Option<String> {
    let volume = body.volume;
    let labels = volume.labels().len();
    let hides: Vec<bool> = (0..labels).map(|label| label > 0 && body.hides(label as u8)).collect();
    let [width, height, depth] = volume.size();
    let slices: Vec<usize> = (0..depth).collect();
    // Voxels of each label in a slice, and how many of them are lost.
    let count = |&k: &usize| {
        let mut counts = vec![[0u64; 2]; labels];
        for pixel in 0..width * height {
            let index = [pixel % width, pixel / width, k];
            let label = volume.voxels()[volume.offset(index)];
            if hides[usize::from(label)] {
                let [all, lost] = &mut counts[usize::from(label)];
                *all += 1;
                *lost += u64::from(!keeps(volume, index));
            }
        }
        counts
    };
    let counts = parallel::map(&slices[..], &count);
    let sum = |label: usize, kind: usize| counts.iter().map(|slice| slice[label][kind]).sum::<u64>();
    let thin = |label: usize| {
        let [all, lost] = [0, 1].map(|kind| sum(label, kind));
        let share = lost as f64 / all as f64;
        let name = body.name(label as u8);
        (all >= FEWEST_VOXELS && share >= THIN).then(|| format!("{:.0} % of {name}", 100.0 * share))
    };
    let thin: Vec<String> = (1..labels).filter_map(thin).collect();
    (!thin.is_empty()).then(|| {
        format!(
            "smooth boundaries lose what is a voxel thin: {}; `effects.slice.boundary = \"nearest\"` keeps it",
            some_of(&thin)
        )
    })
}

/// Returns whether a voxel keeps its label by the weights of cubic B-splines at its centre, of which the largest counts
/// and of equals that of the lowest label.
fn keeps(volume: &LabelVolume, index: [usize; 3]) -> bool {
    let size = volume.size();
    let label_at = |index: [usize; 3]| volume.voxels()[volume.offset(index)];
    let around: [(u8, u16); 27] = std::array::from_fn(|neighbour| {
        let steps = [neighbour % 3, neighbour / 3 % 3, neighbour / 9];
        let near = [0, 1, 2].map(|axis| (index[axis] + steps[axis]).clamp(1, size[axis]) - 1);
        (label_at(near), steps.map(|step| [1, 4, 1][step]).iter().product())
    });
    let label = label_at(index);
    let weight = |label: u8| -> u16 {
        let same = around.iter().filter(|(other, _)| *other == label);
        same.map(|(_, weight)| weight).sum()
    };
    let own = weight(label);
    // The weights sum to 216: more than half of them is the largest.
    own > 108
        || around.iter().all(|(other, _)| {
            let more = weight(*other);
            more < own || (more == own && *other >= label)
        })
}

/// Doubts about the units of a probe.
pub(super) fn of_probe(probe: &Probe) -> Vec<String> {
    let kind = probe.shape.kind();
    let usual = kind.usual();
    let lengths = |probe: &Probe| {
        let mut numbers = probe.shape.numbers();
        numbers.push(("depth_mm", probe.depth_mm));
        numbers.retain(|(key, _)| key.ends_with("_mm"));
        numbers
    };
    let pairs = lengths(probe).into_iter().zip(lengths(&usual));
    let small = pairs.filter(|((_, stated), (_, usual))| *stated <= OF_USUAL * usual);
    let small: Vec<_> = small.collect();
    // As many times the length as the usual one is: nearer to the 1000 of metres than to the 10 of centimetres.
    let unit = if small.iter().all(|((_, stated), (_, usual))| usual / stated > 100.0) {
        "m"
    } else {
        "cm"
    };
    let small: Vec<[String; 2]> = small
        .into_iter()
        .map(|((key, stated), (_, usual))| [format!("probe.{key} = {stated}"), usual.to_string()])
        .collect();
    let all = |index: usize| {
        let parts: Vec<&str> = small.iter().map(|pair| pair[index].as_str()).collect();
        parts.join(" and ")
    };
    let mut doubts = Vec::new();
    if !small.is_empty() {
        doubts.push(format!(
            "{}: in {unit}? Usual for a {kind} probe is {} mm",
            all(0),
            all(1)
        ));
    }
    let downshift = Downshift::new(probe.transducer().bandwidth);
    let lost_db =
        |depth_mm: f64| downshift.felt_db(2.0 * SOFT_TISSUE_DB_CM_MHZ * probe.frequency_mhz * depth_mm / 10.0);
    let silent_mm = (1..=probe.depth_mm as u32).find(|depth_mm| lost_db(f64::from(*depth_mm)) > SILENT_DB);
    if let Some(silent_mm) = silent_mm {
        let [mhz, depth_mm] = [probe.frequency_mhz, probe.depth_mm];
        doubts.push(format!(
            "at {mhz} MHz soft tissue takes {:.0} dB from an echo of {depth_mm} mm: below {silent_mm} mm there is nothing but noise",
            lost_db(depth_mm)
        ));
    }
    for (key, angle) in probe.shape.numbers() {
        if key.ends_with("_deg") && angle < NARROW_DEG {
            doubts.push(format!(
                "probe.{key} = {angle} is a very narrow field: in radians? These are {:.0} degrees",
                angle.to_degrees()
            ));
        }
    }
    doubts
}

/// Doubt about the unit of a needle's points.
pub(super) fn of_needle(needle: &NeedleTable) -> Option<String> {
    let distance_mm = (Point3::from(needle.tip_mm?) - Point3::from(needle.entry_mm?)).norm();
    (distance_mm < APART_MM)
        .then(|| format!("needle.entry_mm and tip_mm are {distance_mm:.2} mm apart: in m or cm? They are taken in mm"))
}

impl Scene {
    /// Reason why no frame shows anything of the volume; `None` if one does.
    pub fn blind(&self) -> Option<&str> {
        let reason = self.blind.as_deref()?;
        let grid = BeamGrid::new(&self.settings.probe).ok()?;
        let frames = self.frames();
        let body = Body {
            volume: &self.anatomy.volume,
            tissues: &self.anatomy.tissues,
        };
        let shows = |frame| sees(&body, &grid, &self.probe_pose(frame, frames));
        (!(0..frames).any(shows)).then_some(reason)
    }

    /// Doubt about a needle that comes from within the body and ends at its surface, at rest or at a pose of its path.
    pub(super) fn reversed_needle(&self) -> Option<String> {
        let shafts = match self.needle.as_ref()? {
            Needle::Still(pose) => vec![pose.clone()],
            Needle::Moving { path, .. } => path.tip().keys().iter().map(|key| path.at(key.time_s)).collect(),
        };
        let body = self.body();
        let is_reversed = |shaft: &NeedlePose| {
            let along = |mm: f64| shaft.tip_mm() + shaft.direction().into_inner() * mm;
            body.label_at(&along(-WITHIN_MM)).is_some() && body.label_at(&along(BEYOND_MM)).is_none()
        };
        shafts.iter().any(is_reversed).then(|| {
            "the needle comes from within the body and points out of it: are its entry and its tip exchanged?"
                .to_owned()
        })
    }

    /// Doubt about compounding that the scene calls for by name or by a scanner `is_stated`, and cannot have.
    pub(super) fn idle_compounding(&self, is_stated: bool) -> Option<String> {
        let is_called_for = match self.origins.get("compound") {
            Some(Origin::Named) => true,
            Some(Origin::Scanner) => is_stated,
            _ => false,
        };
        if !is_called_for {
            return None;
        }
        let grid = BeamGrid::new(&self.settings.probe).ok()?;
        let obstacle = compound::obstacle(&self.settings, &grid)?;
        Some(format!(
            "`effects.compound` does nothing: {obstacle}; it compounds speckle of linear and curved arrays"
        ))
    }

    /// Doubt about a needle that no frame shows, as it stays beside what is imaged.
    pub fn unseen_needle(&self) -> Option<String> {
        let needle = self.needle.as_ref()?;
        let grid = BeamGrid::new(&self.settings.probe).ok()?;
        let field = Field::of(&grid);
        let frames = self.frames();
        let mut nearest = f64::INFINITY;
        // At the ends of its strokes, too: an insertion sets its own times of frames.
        let keys = match needle {
            Needle::Still(_) => &[],
            Needle::Moving { path, .. } => path.tip().keys(),
        };
        let times = (0..frames).map(|frame| self.time_s(frame, frames));
        for time_s in times.chain(keys.iter().map(|key| key.time_s)) {
            let shaft = match needle {
                Needle::Still(pose) => pose.clone(),
                Needle::Moving { path, .. } => path.at(time_s),
            };
            let shaft = shaft.transformed(&self.probe.at(time_s).world_to_probe());
            nearest = shaft.segments_mm().map(|ends| field.gap(&ends)).fold(nearest, f64::min);
            let echo = self.settings.effects.needle.as_ref();
            let thickness_mm = echo.and_then(|echo| echo.thickness_mm);
            let reach = (shaft.diameter_mm() + thickness_mm.unwrap_or(shaft.diameter_mm())) / 2.0;
            if nearest <= reach {
                return None;
            }
        }
        let mut doubt =
            format!("the needle never meets the scan plane: it stays {nearest:.1} mm or more from the image");
        if matches!(needle, Needle::Moving { recorded: true, .. }) {
            doubt.push_str(&format!(
                " in all {frames} frames. Do its path and that of the probe lead to the same world?"
            ));
        }
        Some(doubt)
    }
}

/// Rectangle around what is imaged, in the scan plane: x and y of the probe, mm.
struct Field {
    low: [f64; 2],
    high: [f64; 2],
}

impl Field {
    fn of(grid: &BeamGrid) -> Self {
        let depth_mm = grid.samples() as f64 * grid.sample_spacing_mm();
        let end = |ray: &Ray, along: f64| [0, 1].map(|axis| ray.origin[axis] + along * ray.direction[axis]);
        let points = grid.rays().iter().flat_map(|ray| [end(ray, 0.0), end(ray, depth_mm)]);
        let mut field = Self {
            low: [f64::INFINITY; 2],
            high: [f64::NEG_INFINITY; 2],
        };
        for point in points {
            for axis in 0..2 {
                field.low[axis] = field.low[axis].min(point[axis]);
                field.high[axis] = field.high[axis].max(point[axis]);
            }
        }
        field
    }

    fn distance(&self, point: &Point3<f64>) -> f64 {
        let beside = |axis: usize| {
            (self.low[axis] - point[axis])
                .max(point[axis] - self.high[axis])
                .max(0.0)
        };
        beside(0).hypot(beside(1)).hypot(point.z)
    }

    /// Distance of a straight piece from the rectangle, mm. It is convex along the piece.
    fn gap(&self, [a, b]: &[Point3<f64>; 2]) -> f64 {
        let at = |share: f64| self.distance(&(a + (b - a) * share));
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..60 {
            let third = (high - low) / 3.0;
            if at(low + third) < at(high - third) {
                high -= third;
            } else {
                low += third;
            }
        }
        at(0.5 * (low + high)).min(at(0.0)).min(at(1.0))
    }
}

#[cfg(test)]
mod tests {
    use insonify_anatomy::acoustics::{Preset, TissueTable};
    use insonify_anatomy::volume::Label;
    use nalgebra::Matrix4;

    use super::*;

    /// Note on a cube of 20 voxels a side with bone where `is_bone`.
    fn note(is_bone: &dyn Fn([usize; 3]) -> bool) -> Option<String> {
        let index = |voxel: usize| [voxel % 20, voxel / 20 % 20, voxel / 400];
        let voxels: Vec<u8> = (0..8000).map(|voxel| u8::from(is_bone(index(voxel)))).collect();
        let label = |value: i64, name: &str| Label {
            value,
            name: Some(name.to_owned()),
            voxels: 1,
        };
        let labels = vec![label(0, "background"), label(7, "rib_left_1")];
        let volume = LabelVolume::new([20; 3], voxels, labels, Matrix4::identity()).expect("a volume");
        let (tissues, _) = TissueTable::resolve(volume.labels(), &[], Preset::Auto).expect("tissues");
        thin_parts(&Body {
            volume: &volume,
            tissues: &tissues,
        })
    }

    #[test]
    fn bone_a_voxel_thin_is_told_where_smooth_boundaries_lose_it() {
        let rods = note(&|[x, y, _]| (x, y) == (5, 5) || (x, y) == (9, 14) || (x, y) == (15, 3));
        let told = rods.expect("a note");
        assert!(
            told.contains("lose what is a voxel thin: 100 % of rib_left_1;"),
            "{told}"
        );
        // Near misses: a sheet, which keeps two thirds of the weight, a rod of two voxels, and too few voxels.
        assert_eq!(note(&|[x, ..]| x == 5), None);
        assert_eq!(note(&|[x, y, _]| (5..7).contains(&x) && (5..7).contains(&y)), None);
        assert_eq!(note(&|[x, y, _]| (x, y) == (5, 5)), None);
    }
}
