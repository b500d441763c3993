//! Output of a plan: tables, series, plots, a picture of all lines, a page, and the best path as a scenario.

use image::RgbImage;
use nalgebra::Point3;

use super::correct::Corrected;
use super::insertion::{APPROACH_MM, Sample};
use super::{Candidate, PathPlan};
use insonify::input::scenario::plan::TargetSpec;
use insonify::input::scenario::{Scenario, ScenarioText};
use insonify_base::number::fixed;
use insonify_base::output::OutputError;
use insonify_base::table::{Cell, Table};
use insonify_imaging::overlay;
use insonify_imaging::synth::Synthesizer;
use insonify_report::page::Page;
use insonify_report::plot::{Axis, Marker, Plot, Series};
use insonify_tracking::needle::NeedlePose;

/// Files of a plan.
pub const FILES: &[&str] = &[
    "index.html",
    "lines.csv",
    "lines.png",
    "lines.svg",
    "overview.png",
    "scenario.toml",
    "summary.json",
    "target.csv",
    "target.svg",
];

/// Colours of lines: the best, other simulated ones, excluded ones.
const COLOURS: [[u8; 3]; 3] = [[64, 220, 120], [90, 215, 255], [170, 110, 90]];
/// Length of a drawn line that has no entry, mm.
const DRAWN_MM: f64 = 60.0;

impl PathPlan {
    /// The best path.
    pub fn best(&self) -> Option<(&Candidate, &Corrected)> {
        let best = self.lines.first()?;
        best.path.as_ref().map(|path| (best, path))
    }

    /// One sentence about the best path.
    pub fn text(&self) -> String {
        let Some((line, path)) = self.best() else {
            return "no path".to_owned();
        };
        let entry = line.entry_mm.map_or(String::new(), |entry| {
            let [x, y, z] = entry.map(|x| format!("{x:.1}"));
            format!(" from ({x}, {y}, {z}) mm")
        });
        let by_guide = line.guide.map_or(String::new(), |guide| {
            format!(
                ", guide at {:.2} mm, {:.2} degrees and {:.2} mm (position, posture, insertion)",
                guide.position_mm, guide.posture_deg, guide.insertion_mm
            )
        });
        let drawn_back = if path.back_mm > 0.0 {
            format!(" and {:.1} mm back", path.back_mm)
        } else {
            String::new()
        };
        format!(
            "best of {} lines: {:.1} degrees to the beam{entry}, {:.1} mm deep{drawn_back}{by_guide}; misses {} by {:.2} mm, uncorrected by {:.2} mm; force up \
             to {:.2} N, clearance {} mm",
            self.lines.len(),
            line.angle_deg,
            path.insertion_mm,
            self.target,
            path.miss_mm,
            path.miss_before_mm,
            path.max_force_n,
            clearance(path)
        )
    }

    /// Table of all lines.
    pub fn table(&self) -> Table {
        let heads = [
            "line",
            "angle, deg",
            "entry, mm",
            "depth, mm",
            "back, mm",
            "turn, deg",
            "miss before, mm",
            "miss, mm",
            "clearance, mm",
            "force, N",
            "runs",
        ];
        let heads = heads.map(Cell::number).into_iter().chain([Cell::from("excluded")]);
        let rows = self.lines.iter().map(|line| {
            let entry = line
                .entry_mm
                .map_or(String::new(), |position| position.map(|x| format!("{x:.1}")).join(" "));
            let mut cells = vec![line.number.to_string(), format!("{:.1}", line.angle_deg), entry];
            // An excluded line has no path: empty cells keep the reason in the last column.
            cells.extend(match &line.path {
                Some(path) => vec![
                    format!("{:.2}", path.insertion_mm),
                    format!("{:.2}", path.back_mm),
                    format!("{:.2}", path.turn_deg),
                    format!("{:.3}", path.miss_before_mm),
                    format!("{:.3}", path.miss_mm),
                    clearance(path),
                    format!("{:.3}", path.max_force_n),
                    path.runs.to_string(),
                ],
                None => vec![String::new(); 8],
            });
            cells.push(line.excluded.unwrap_or_default().to_owned());
            cells
        });
        Table::new(heads).with(rows)
    }

    /// All lines as comma-separated values, in the order of their ranks.
    pub fn csv(&self) -> String {
        let mut text = "line,angle_deg,entry_x_mm,entry_y_mm,entry_z_mm,direction_x,direction_y,direction_z,depth_mm,back_mm,turn_deg,\
                        miss_before_mm,miss_mm,target_along_mm,target_aside_mm,clearance_mm,max_force_n,punctures,runs,"
            .to_owned();
        let is_guided = self.lines.iter().any(|line| line.guide.is_some());
        if is_guided {
            text += "guide_position_mm,guide_posture_deg,guide_insertion_mm,";
        }
        text += "excluded\n";
        for line in &self.lines {
            let list = |values: [f64; 3]| values.map(|x| x.to_string()).join(",");
            let entry = line.entry_mm.map_or(",,".to_owned(), list);
            let direction = line.path.as_ref().map_or(line.along.into(), |path| path.direction);
            let result = line.path.as_ref().map_or(",".repeat(9), |path| {
                let [along_mm, aside_mm] = path.displacement_mm;
                format!(
                    "{},{},{},{},{},{along_mm},{aside_mm},{},{},{}",
                    path.insertion_mm,
                    path.back_mm,
                    path.turn_deg,
                    path.miss_before_mm,
                    path.miss_mm,
                    path.clearance_mm.map_or(String::new(), |mm| mm.to_string()),
                    path.max_force_n,
                    path.punctures
                )
            });
            let runs = line.path.as_ref().map_or(String::new(), |path| path.runs.to_string());
            let (number, angle, excluded) = (line.number, line.angle_deg, line.excluded.unwrap_or_default());
            let guide = match &line.guide {
                _ if !is_guided => String::new(),
                None => ",".repeat(3),
                Some(guide) => list([guide.position_mm, guide.posture_deg, guide.insertion_mm]) + ",",
            };
            text += &format!(
                "{number},{angle},{entry},{},{result},{runs},{guide}{excluded}\n",
                list(direction)
            );
        }
        text
    }

    /// Places of tip and target while the needle of the best line goes in, uncorrected and corrected.
    pub fn series(&self) -> String {
        let mut text =
            "run,time_s,travel_mm,tip_x_mm,tip_y_mm,tip_z_mm,target_x_mm,target_y_mm,target_z_mm,target_along_mm,\
                        target_aside_mm,distance_mm,force_n\n"
                .to_owned();
        let Some((_, path)) = self.best() else { return text };
        for (name, trial) in [("uncorrected", &path.first), ("corrected", &path.last)] {
            for sample in &trial.samples {
                let position = |point: &Point3<f64>| <[f64; 3]>::from(*point).map(|x| format!("{x:.4}")).join(",");
                let [along_mm, aside_mm] = self.moved(path, sample);
                text += &format!(
                    "{name},{:.4},{:.4},{},{},{along_mm:.4},{aside_mm:.4},{:.4},{:.5}\n",
                    sample.time_s,
                    sample.travel_mm,
                    position(&sample.tip),
                    position(&sample.target),
                    sample.miss.norm(),
                    sample.force_n
                );
            }
        }
        text
    }

    /// Displacement of the target along and across the needle, mm.
    fn moved(&self, path: &Corrected, sample: &Sample) -> [f64; 2] {
        let displacement = sample.target - Point3::from(self.target_mm);
        let along_mm = displacement.dot(&path.course.along);
        [along_mm, (displacement - path.course.along * along_mm).norm()]
    }

    /// Displacement of the target while the needle of the best line goes in.
    pub fn target_plot(&self) -> Plot {
        let mut series = Vec::new();
        if let Some((_, path)) = self.best() {
            for (index, (name, trial)) in [("uncorrected", &path.first), ("corrected", &path.last)]
                .into_iter()
                .enumerate()
            {
                for (component, axis) in ["along the needle", "across it"].into_iter().enumerate() {
                    let points = trial
                        .samples
                        .iter()
                        .map(|sample| [sample.travel_mm, self.moved(path, sample)[component]]);
                    series.push(Series::line(
                        format!("{axis}, {name}"),
                        2 * index + component,
                        points.collect(),
                    ));
                }
            }
        }
        let x = Axis::linear("travel of the tip beyond the entry, mm");
        Plot::new("Displacement of the target", x, Axis::linear("mm"), series)
    }

    /// Distance of the tip from the target at the end of every line.
    pub fn lines_plot(&self) -> Plot {
        let points = |figure: fn(&Corrected) -> f64| {
            let angles = self
                .lines
                .iter()
                .filter_map(|line| Some([line.angle_deg, figure(line.path.as_ref()?)]));
            angles.collect::<Vec<_>>()
        };
        let series = vec![
            Series::points("uncorrected", 1, Marker::Ring, points(|path| path.miss_before_mm)),
            Series::points("corrected", 0, Marker::Disc, points(|path| path.miss_mm)),
        ];
        let x = Axis::linear("angle to the beam, degrees");
        Plot::new("Distance of the tip from the target", x, Axis::log("mm"), series)
    }

    /// The image at rest with all lines over it: the best green, other simulated ones blue, excluded ones brown.
    pub fn picture(&self, synth: &Synthesizer, scenario: &Scenario) -> RgbImage {
        let pose = scenario.scene.probe_path().at(scenario.timing.start_s);
        let target = Point3::from(self.target_mm);
        let lines = self.lines.iter().enumerate().rev().map(|(rank, line)| {
            let (tip, direction) = match &line.path {
                Some(path) => (path.course.end(), path.course.along),
                None => (target, line.along),
            };
            let from = line.entry_mm.map_or(target - direction * DRAWN_MM, |entry| {
                Point3::from(entry) - direction * APPROACH_MM
            });
            let kind = if line.path.is_none() { 2 } else { usize::from(rank > 0) };
            overlay::Line {
                points: vec![from, tip],
                colour: COLOURS[kind],
                width: if kind == 0 { 3.0 } else { 1.5 },
            }
        });
        let lines: Vec<_> = lines.collect();
        let to_probe = pose.world_to_probe();
        overlay::lines(&synth.frame().pixels, synth.tables(), &to_probe, &lines, &[target])
    }

    /// The needle at the end of the best path.
    pub fn needle(&self, scenario: &Scenario) -> Option<NeedlePose> {
        let (_, path) = self.best()?;
        let needle = &scenario.needle;
        NeedlePose::straight(
            path.course.end(),
            path.course.along,
            needle.length_mm,
            needle.diameter_mm,
        )
        .ok()
    }

    /// Self-contained page.
    ///
    /// # Errors
    /// [`OutputError`] if a plot cannot be drawn.
    pub fn page(&self, picture: &RgbImage, overview: &RgbImage) -> Result<String, OutputError> {
        let mut page = Page::new(&format!("Needle path to {}", self.target));
        for warning in &self.warnings {
            page.paragraph("warning", warning);
        }
        page.paragraph("", &(self.text() + "."));
        if let Some((_, path)) = self.best() {
            let [along_mm, aside_mm] = path.displacement_mm;
            page.paragraph(
                "",
                &format!(
                    "At its end the target lies {} mm along the needle and {} mm across it from where it is at rest; {} surfaces were \
                     punctured. The correction turned the line by {} degrees.",
                    fixed(along_mm),
                    fixed(aside_mm),
                    path.punctures,
                    fixed(path.turn_deg)
                ),
            );
        }
        let caption = "Lines over the image at rest, projected onto its plane: the best green, other simulated ones blue, excluded ones brown; \
                       the cross is the target at rest.";
        page.pictures([
            (picture, caption.to_owned()),
            (overview, "The best path in the anatomy.".to_owned()),
        ]);
        for plot in [self.target_plot(), self.lines_plot()] {
            // The title becomes the caption: inside the picture it would stand twice.
            let untitled = Plot {
                title: String::new(),
                ..plot.clone()
            };
            page.wide_figure(&untitled.svg()?, &plot.title);
        }
        page.put("<h2>All lines</h2>");
        page.table(&self.table());
        let tissue = match self.thickness_mm {
            Some(mm) => format!("a section by the image plane, {mm} mm thick, in plane strain"),
            None => "that of the scenario".to_owned(),
        };
        page.paragraph(
            "soft",
            &format!(
                "Tissue: {tissue}. Speed {} mm/s. Ranked by miss (within {} mm all are equal), clearance from bone and critical structures (to 1 mm, \
                 at least {} mm) and force. Before the correction the needle is sent to where the target is at rest.",
                fixed(self.speed_mm_s),
                self.tolerance_mm,
                self.least_clearance_mm
            ),
        );
        page.put("<p><a href=\"scenario.toml\">scenario.toml</a>, <a href=\"lines.csv\">lines.csv</a>, <a href=\"target.csv\">target.csv</a></p>");
        Ok(page.finish())
    }

    /// The best path as a scenario: the text of `base` with its motion and the target.
    ///
    /// # Errors
    /// The reason if a part of `base` that is replaced is no table.
    pub fn scenario(&self, base: &str, scenario: &Scenario) -> Result<String, String> {
        let Some((_, path)) = self.best() else {
            return Err("no path was found".to_owned());
        };
        let keyframes = path.course.keys(scenario);
        let target = TargetSpec {
            name: self.target.clone(),
            at_mm: self.target_mm,
            radius_mm: 0.0,
        };
        let mut text = ScenarioText::parse(base)?
            .with_needle_path(&keyframes, &target)?
            .with_mesh(scenario.meshed_mm(), scenario.along_path())?;
        if scenario.scene.probe_path().keys().len() > 1 {
            let pose = scenario.scene.probe_path().at(scenario.timing.start_s);
            let [direction, lateral] = [pose.axial(), pose.lateral()].map(|axis| axis.into_inner().into());
            text = text.with_probe([pose.position_mm().into(), direction, lateral])?;
        }
        let text = text.text()?;
        Ok(format!(
            "# A path planned by `insonify path`: {}.\n\n{text}",
            self.text()
        ))
    }
}

fn clearance(path: &Corrected) -> String {
    path.clearance_mm.map_or("over 30".to_owned(), |mm| format!("{mm:.1}"))
}
