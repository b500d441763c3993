//! Settings of a scene that are possible and seldom meant.

use nalgebra::Point3;

use super::Scene;
use super::motion::Needle;
use super::resolve::sees;
use super::target::Body;
use crate::effects::shadow::SOFT_TISSUE_DB_CM_MHZ;
use insonify_tracking::probe::{BeamGrid, Probe, Ray};

/// Field of view below which the angle may be in radians, degrees.
const NARROW_DEG: f64 = 5.0;
/// Loss of an echo, there and back, beyond which no scanner shows it, dB: the dynamic range of a receiver with focusing
/// and averaging.
const SILENT_DB: f64 = 130.0;
/// Length, over the usual one of the kind, up to which it may be in centimetres.
const OF_USUAL: f64 = 0.13;

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
    let small: Vec<[String; 2]> = pairs
        .filter(|((_, stated), (_, usual))| *stated <= OF_USUAL * usual)
        .map(|((key, stated), (_, usual))| [format!("probe.{key} = {stated}"), usual.to_string()])
        .collect();
    let all = |index: usize| {
        let parts: Vec<&str> = small.iter().map(|pair| pair[index].as_str()).collect();
        parts.join(" and ")
    };
    let mut doubts = Vec::new();
    if !small.is_empty() {
        doubts.push(format!("{}: in cm? Usual for a {kind} probe is {} mm", all(0), all(1)));
    }
    let lost_db = 2.0 * SOFT_TISSUE_DB_CM_MHZ * probe.frequency_mhz * probe.depth_mm / 10.0;
    if lost_db > SILENT_DB {
        let [mhz, depth_mm] = [probe.frequency_mhz, probe.depth_mm];
        doubts.push(format!(
            "at {mhz} MHz soft tissue takes {lost_db:.0} dB from an echo of {depth_mm} mm: below {:.0} mm there is nothing but noise",
            depth_mm * SILENT_DB / lost_db
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
