//! `[plan]` of a scenario: template, needles and targets, and the motion and seeds of the insertions through the
//! template.

use nalgebra::{Point3, Unit};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::file::ScenarioFile;
use super::planning_study::PlannedImageSpec;
use insonify_base::document::InputError;
use insonify_base::range::parameters;
use insonify_imaging::scene::NeedleKeyframe;
use insonify_tracking::template::Template;

/// Default distance between holes, mm: that of brachytherapy templates.
const DEFAULT_SPACING_MM: f64 = 5.0;
/// Largest deviation of the axes of a template from perpendicular, as a cosine.
const SQUARE: f64 = 1e-3;

parameters! {
    /// Plan of insertions: template, needles and targets.
    pub struct PlanSpec {
        /// Template that guides the needles.
        template: Option<TemplateSpec>;
        /// Speed of needles that state none, and of `needle.target`.
        speed_mm_s: f64 = 10.0, above 0..=1000 "mm/s";
        /// Pause at full depth, and outside between insertions.
        pause_s: f64 = 0.5, in 0.01..=1000 "s";
        /// Start of the first insertion.
        start_s: f64 = 0.0, in 0..=1e6 "s";
        /// Insertions through the template, in sequence, in place of `needle.motion` and `needle.target`.
        needle: Vec<PlannedNeedle>;
        /// Targets of needles or seeds, for the report.
        target: Vec<TargetSpec>;
        /// Images of the planning study, which the probe is to show again.
        image: Vec<PlannedImageSpec>;
    }
}

parameters! {
    /// A plate with rows and columns of holes, perpendicular to the needles that it guides.
    pub struct TemplateSpec with required keys {
        /// Hole of the first column and row, in the world (LPS), mm. Depths are measured from here; it lies outside the
        /// body.
        origin_mm: [f64; 3];
        /// Direction from column to column; any length.
        x_axis: [f64; 3];
        /// Direction from row to row, perpendicular to `x_axis`; any length.
        y_axis: [f64; 3];
        /// Direction of needles. Default: `x_axis` cross `y_axis`; if given, it must be that or its opposite.
        direction: Option<[f64; 3]>;
        /// Distance between holes. Default 5 mm.
        spacing_mm: Option<f64>, above 0..=100 "mm";
        /// Whether the hole constrains the needle laterally; otherwise, the template only defines the needle paths.
        /// Default true.
        holds: Option<bool>;
        /// Names of columns and rows: hole `C2` is that of column `C` and row `2`.
        names: TemplateNames;
    }
}

/// Names of the columns and rows of a template.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TemplateNames {
    /// Column names, in the order of `x_axis`.
    pub columns: Vec<String>,
    /// Row names, in the order of `y_axis`.
    pub rows: Vec<String>,
}

parameters! {
    /// An insertion to a depth and back, depositing seeds on withdrawal.
    pub struct PlannedNeedle with required keys {
        /// Hole: the name of a column followed by that of a row.
        hole: String;
        /// Depth of the tip beyond the template, mm (above 0, less than the needle's length).
        depth_mm: f64;
        /// Speed of insertion and withdrawal. Default: that of the plan.
        speed_mm_s: Option<f64>, above 0..=1000 "mm/s";
        /// Depths at which a seed is deposited during withdrawal, mm (0 to `depth_mm`), in any order.
        #[serde(default)]
        seeds_mm: Vec<f64>;
        /// Roll about the shaft, degrees: it turns a bevel. Default 0.
        roll_deg: Option<f64>;
    }
}

parameters! {
    /// A target of needles or seeds.
    pub struct TargetSpec with required keys {
        /// Name in the report.
        name: String;
        /// Position in the anatomy at rest (LPS), mm.
        at_mm: [f64; 3];
        /// Radius: an image within this distance shows the target. Default 0.
        #[serde(default)]
        radius_mm: f64, in 0..=100 "mm";
    }
}

/// A target of a needle or a seed.
#[derive(Clone, Debug, PartialEq)]
pub struct Target {
    /// Name of the target.
    pub name: String,
    /// Position in the anatomy at rest, mm.
    pub at_mm: Point3<f64>,
    /// Radius, mm.
    pub radius_mm: f64,
}

/// A seed to be deposited.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Deposit {
    /// Time of deposition, s.
    pub time_s: f64,
    /// Planned position in the anatomy at rest, mm.
    pub planned_mm: Option<Point3<f64>>,
}

/// Motion, seeds and guides of a planned needle.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Insertions {
    pub keyframes: Vec<NeedleKeyframe>,
    pub deposits: Vec<Deposit>,
    pub guides: Vec<Guide>,
}

/// A template hole, and the period in which a needle runs through it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Guide {
    /// Start and end of the period, s.
    pub during_s: [f64; 2],
    /// Centre of the hole, mm.
    pub at_mm: Point3<f64>,
}

impl ScenarioFile {
    /// Targets of the plan.
    pub(crate) fn targets(&self) -> Result<Vec<Target>, InputError> {
        let specs = self.plan.iter().flat_map(|plan| &plan.target);
        let target = |(index, spec): (usize, &TargetSpec)| {
            let table = format!("plan.target[{index}]");
            self.in_ranges(&table, spec)?;
            Ok(Target {
                name: spec.name.clone(),
                at_mm: self.place(&format!("{table}.at_mm"), spec.at_mm)?,
                radius_mm: spec.radius_mm,
            })
        };
        specs.enumerate().map(target).collect()
    }

    /// Planned insertions of a needle of the given length (mm), if there are any.
    pub(crate) fn insertions(&self, length_mm: f64) -> Result<Option<Insertions>, InputError> {
        let Some(plan) = &self.plan else { return Ok(None) };
        // The template is checked whether or not a needle uses it.
        let template = self.template()?;
        let [mut now_s, speed_mm_s, pause_s] = self.pace()?;
        if plan.needle.is_empty() {
            return Ok(None);
        }
        let Some(template) = template else {
            return Err(self.wrong_keys(
                "plan",
                "`plan.needle` without `plan.template`",
                "the template of its holes",
            ));
        };
        let mut insertions = Insertions::default();
        for (index, needle) in plan.needle.iter().enumerate() {
            let usual = [length_mm, speed_mm_s, pause_s];
            self.insertion(&template, (index, needle), usual, &mut now_s, &mut insertions)?;
        }
        Ok(Some(insertions))
    }

    /// Start (s), and default speed (mm/s) and pause at full depth (s) of the needles.
    pub(crate) fn pace(&self) -> Result<[f64; 3], InputError> {
        self.in_ranges("plan", self.plan.as_ref())?;
        let plan = self.plan.clone().unwrap_or_default();
        Ok([plan.start_s, plan.speed_mm_s, plan.pause_s])
    }

    /// One insertion, given the length of the needle (mm), the default speed (mm/s), and the pause (s) after each
    /// stroke.
    fn insertion(
        &self,
        template: &Template,
        (at, needle): (usize, &PlannedNeedle),
        [length_mm, speed_mm_s, pause_s]: [f64; 3],
        now_s: &mut f64,
        insertions: &mut Insertions,
    ) -> Result<(), InputError> {
        let table = format!("plan.needle[{at}]");
        let key = |key: &str| format!("{table}.{key}");
        self.in_ranges(&table, needle)?;
        let hole = template.hole(&needle.hole).map_err(|unknown| {
            let help = unknown.meant.map(|meant| format!("did you mean \"{meant}\"?"));
            let found = format!("\"{}\"", unknown.found);
            self.wrong_keys(key("hole"), found, unknown.expected).with_help(help)
        })?;
        let reach = |x: f64| x > 0.0 && x < length_mm;
        let depth = self.number(
            key("depth_mm"),
            needle.depth_mm,
            reach,
            "above 0 and less than the needle's length, mm",
        )?;
        let speed = needle.speed_mm_s.unwrap_or(speed_mm_s);
        let direction = template.direction.into_inner();
        let mut frame = |time_s: f64, depth: f64| {
            insertions.keyframes.push(NeedleKeyframe {
                time_s,
                tip_mm: (hole + direction * depth).into(),
                direction: direction.into(),
                roll_deg: needle.roll_deg,
            });
        };
        let travel_s = depth / speed;
        let back_s = *now_s + travel_s + pause_s;
        frame(*now_s, 0.0);
        frame(*now_s + travel_s, depth);
        frame(back_s, depth);
        frame(back_s + travel_s, 0.0);
        let spec = self.plan.as_ref().and_then(|plan| plan.template.as_ref());
        if spec.and_then(|spec| spec.holds).unwrap_or(true) {
            insertions.guides.push(Guide {
                during_s: [*now_s, back_s + travel_s],
                at_mm: hole,
            });
        }
        *now_s = back_s + travel_s + pause_s;
        let mut seeds = Vec::with_capacity(needle.seeds_mm.len());
        for (index, seed) in needle.seeds_mm.iter().enumerate() {
            let key = key(&format!("seeds_mm[{index}]"));
            seeds.push(self.number(key, *seed, |x| (0.0..=depth).contains(&x), "0 to `depth_mm`")?);
        }
        // On the way back the deepest comes first.
        seeds.sort_by(|a, b| b.total_cmp(a));
        insertions.deposits.extend(seeds.into_iter().map(|seed| Deposit {
            time_s: back_s + (depth - seed) / speed,
            planned_mm: Some(hole + direction * seed),
        }));
        Ok(())
    }

    /// Returns the template of the plan, if it has one.
    ///
    /// # Errors
    /// [`InputError`] at the invalid key.
    pub(crate) fn template(&self) -> Result<Option<Template>, InputError> {
        let Some(spec) = self.plan.as_ref().and_then(|plan| plan.template.as_ref()) else {
            return Ok(None);
        };
        let key = |key: &str| format!("plan.template.{key}");
        let origin = self.place(&key("origin_mm"), spec.origin_mm)?;
        let x = self.direction(&key("x_axis"), spec.x_axis)?;
        let y = self.direction(&key("y_axis"), spec.y_axis)?;
        if x.dot(&y).abs() > SQUARE {
            let found = format!("{:?}", spec.y_axis);
            return Err(self.wrong_keys(key("y_axis"), found, "a direction square to `x_axis`"));
        }
        let normal = Unit::new_normalize(x.cross(&y));
        let direction = match spec.direction {
            None => normal,
            Some(direction) => self.direction(&key("direction"), direction)?,
        };
        // Parallel or opposite: the cross product points out of the body where rows are counted the other
        // way.
        if direction.cross(&normal).norm() > SQUARE {
            let found = format!("{:?}", spec.direction.unwrap_or_default());
            return Err(self.wrong_keys(key("direction"), found, "`x_axis` cross `y_axis`, or its opposite"));
        }
        self.in_ranges("plan.template", spec)?;
        let spacing = spec.spacing_mm.unwrap_or(DEFAULT_SPACING_MM);
        for (list, names) in [("columns", &spec.names.columns), ("rows", &spec.names.rows)] {
            let odd =
                (0..names.len()).find(|index| names[*index].is_empty() || names[..*index].contains(&names[*index]));
            let key = key(&format!("names.{list}"));
            match odd {
                _ if names.is_empty() => return Err(self.wrong_keys(key, "no names", "at least one")),
                Some(index) => {
                    let found = format!("the name \"{}\"", names[index]);
                    return Err(self.wrong_keys(key, found, "names of one letter or more, each once"));
                }
                None => {}
            }
        }
        Ok(Some(Template {
            origin_mm: origin,
            steps_mm: [x.scale(spacing), y.scale(spacing)],
            direction,
            columns: spec.names.columns.clone(),
            rows: spec.names.rows.clone(),
        }))
    }
}
