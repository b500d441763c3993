//! Force along the needle (Goksel et al. 2011, figure 4), of the deepest step on the way in and of the strongest pull.

use crate::run::Step;
use insonify_report::plot::{Axis, Plot, Series};

/// Length below which a load acts at a point, mm.
const POINT_MM: f64 = 1e-9;
/// Least increase of the depth by which a step replaces the deepest, mm: a resting needle creeps.
const DEEPER_MM: f64 = 0.05;

/// Forces along the needle of a step.
#[derive(Clone, Debug, Default)]
struct Profile {
    time_s: f64,
    /// Depth of the step inward, pull of the one outward: the step of the largest is kept.
    largest: f64,
    /// Ends of lengths of shaft (arc from the hub, mm), and force on them against the insertion, N.
    loads: Vec<[f64; 3]>,
}

impl Profile {
    fn keep(&mut self, step: &Step<'_>, value: f64) {
        let axis = step.base.rotation * nalgebra::Vector3::z();
        (self.time_s, self.largest) = (step.time_s, value);
        self.loads.clear();
        let loads = step.loads.iter();
        self.loads
            .extend(loads.map(|load| [load.from_mm, load.to_mm, -load.force_n.dot(&axis)]));
    }

    /// Steps of the force per length, with the sum of the forces at points in the name; `None` without loads.
    fn series(&self, name: &str, colour: usize) -> Option<Series> {
        let is_spread = |[from, to, _]: &&[f64; 3]| to - from > POINT_MM;
        let mut points = vec![[0.0; 2]];
        for [from, to, force_n] in self.loads.iter().filter(is_spread) {
            // Between loads, as before the first, nothing touches the shaft.
            let end = points[points.len() - 1][0];
            if *from > end + POINT_MM {
                points.extend([[end, 0.0], [*from, 0.0]]);
            }
            let density = force_n / (to - from);
            points.extend([[*from, density], [*to, density]]);
        }
        let end = points[points.len() - 1][0];
        points.push([end, 0.0]);
        let at_points: f64 = self
            .loads
            .iter()
            .filter(|load| !is_spread(load))
            .map(|load| load[2])
            .sum();
        // Rounding has a sign.
        let at_points = if at_points.abs() < 5e-4 { 0.0 } else { at_points };
        let name = format!("{name}, {:.2} s (at the tip {at_points:.3} N)", self.time_s);
        (!self.loads.is_empty()).then(|| Series::line(name, colour, points))
    }
}

/// Profiles of a run.
#[derive(Clone, Debug, Default)]
pub(super) struct Profiles {
    inward: Profile,
    outward: Profile,
}

impl Profiles {
    pub(super) fn add(&mut self, step: &Step<'_>) {
        let (depth, pull) = (
            step.outcome.inserted_mm,
            step.outcome.on_hand.in_frame(&step.base).force_n.z,
        );
        if pull < 0.0 && depth > self.inward.largest + DEEPER_MM {
            self.inward.keep(step, depth);
        }
        if pull > self.outward.largest {
            self.outward.keep(step, pull);
        }
    }

    /// Plot of both; `None` if no tissue was met.
    pub(super) fn plot(&self) -> Option<Plot> {
        let named = [
            (&self.inward, "deepest on the way in"),
            (&self.outward, "strongest pull"),
        ]
        .into_iter();
        let series = named
            .enumerate()
            .filter_map(|(index, (profile, name))| profile.series(name, index));
        let series: Vec<Series> = series.collect();
        let title = "Force of the tissue along the needle (positive against the insertion)";
        let x = Axis::linear("distance from the hub, mm");
        let y = Axis::linear("force per length, N/mm");
        (!series.is_empty()).then(|| Plot::new(title, x, y, series))
    }
}
