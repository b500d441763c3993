//! Tables, figures, page and scenario of an identification.

use std::fmt;
use std::path::Path;

use super::{Identification, Identified, errors_by_depth};
use insonify_base::document::{Names, RegionName};
use insonify_base::number::{decimal, significant};
use insonify_base::output::OutputError;
use insonify_base::table::{Cell, Table};
use insonify_report::page::Page;
use insonify_report::plot::{Axis, Marker, Plot, Series};
use nalgebra::Vector3;
use toml::Value;

impl Identified {
    /// Name of the identification among several.
    fn name(&self) -> String {
        match self.poisson {
            Some(poisson) => format!("Poisson's ratio {poisson}"),
            None => "simulated".to_owned(),
        }
    }
}

impl Identification {
    /// Parameters of the layers: Table II of Dehghan et al. 2008.
    fn parameters(&self) -> Table {
        let head = ["Poisson's ratio", "f_p, N/m", "f_s, N/m", "w, mm", "E, kPa"].map(Cell::number);
        let mut table = Table::new([Cell::from("layer")].into_iter().chain(head));
        for result in &self.results {
            for layer in &result.layers {
                let known = if layer.young_known { " (known)" } else { "" };
                table.row(
                    "",
                    [
                        layer.region_name.clone(),
                        decimal(layer.poisson, 3),
                        decimal(1e3 * layer.peak_n_per_mm, 1),
                        decimal(1e3 * layer.shaft_n_per_mm, 1),
                        decimal(layer.width_mm, 2),
                        decimal(layer.young_kpa, 2) + known,
                    ],
                );
            }
        }
        table
    }

    /// Errors of the simulations: Table III of Dehghan et al. 2008, and those of the force.
    fn errors(&self) -> Table {
        let head = [
            "largest mean error, mm",
            "largest SD of the error, mm",
            "RMS error of the force, N",
            "largest error of the force, N",
            "insertions simulated",
        ];
        let head = head.map(Cell::number);
        let mut table = Table::new([Cell::from("")].into_iter().chain(head));
        for result in &self.results {
            let motion_errors = result
                .motion
                .map(|errors| [errors.largest_mean_mm, errors.largest_sd_mm]);
            let [mean, sd] = motion_errors.map_or([String::new(), String::new()], |errors| errors.map(significant));
            let numbers = [
                mean,
                sd,
                significant(result.force.rms_n),
                significant(result.force.largest_n),
                result.insertions.to_string(),
            ];
            table.row("", [result.name()].into_iter().chain(numbers));
        }
        table
    }

    /// Regions of the measured force.
    fn regions(&self) -> Table {
        let head = ["from, mm", "to, mm", "slope, N/mm"].map(Cell::number);
        let mut table = Table::new([Cell::from("region")].into_iter().chain(head));
        for (index, slope) in self.force_model.slopes_n_per_mm.iter().enumerate() {
            let layer = &self.case.layers[index / 2].name;
            let phase = if index % 2 == 0 { "punctured" } else { "penetrated" };
            let [start, end] = self.force_model.ends(index).map(|end| decimal(end, 2));
            let name = format!("{}: {layer} {phase}", index + 1);
            table.row("", [name, start, end, decimal(*slope, 4)]);
        }
        table
    }

    /// The Poisson's ratio whose simulation comes closest to the measured displacements, if there are several.
    fn closest(&self) -> Option<String> {
        let error = |result: &Identified| {
            result
                .motion
                .map(|motion| motion.largest_mean_mm.hypot(motion.largest_sd_mm))
        };
        let mut by_error: Vec<_> = self
            .results
            .iter()
            .filter_map(|result| Some((error(result)?, result)))
            .collect();
        by_error.sort_by(|a, b| a.0.total_cmp(&b.0));
        let [(least, best), (next, _), ..] = by_error[..] else {
            return None;
        };
        Some(format!(
            "{} comes closest to the measured displacements: the next is {:.1} times as far off. Certainty is that of a modulus given the ratio.",
            best.name(),
            next / least
        ))
    }

    /// Cost beside the moduli found; empty where all are known.
    fn beside(&self) -> Table {
        let mut table = Table::new(
            ["", "layer"]
                .map(Cell::from)
                .into_iter()
                .chain(["E changed by", "cost over the least"].map(Cell::number)),
        );
        for result in &self.results {
            for sensitivity in &result.beside {
                let change = format!("{:+.0} %", 100.0 * (sensitivity.factor - 1.0));
                let cost = significant(sensitivity.cost_ratio);
                table.row("", [result.name(), sensitivity.region_name.clone(), change, cost]);
            }
        }
        table
    }

    /// Figures 12, 14 and 15 of Dehghan et al. 2008 and the errors of the displacements over the depth, by file name.
    pub fn plots(&self) -> Vec<(String, Plot)> {
        let mut plots = vec![
            ("figure-12".to_owned(), self.figure_12()),
            ("figure-14".to_owned(), self.figure_14()),
        ];
        if let Some(motion) = &self.data.motion {
            let series = self.results.iter().enumerate().flat_map(|(index, result)| {
                let errors = errors_by_depth(motion, &result.course);
                let curve = |column: usize| errors.iter().map(|row| [row[0], row[column]]).collect();
                [
                    Series::line(format!("{}, mean", result.name()), 2 * index, curve(1)),
                    Series::line(format!("{}, SD", result.name()), 2 * index + 1, curve(2)),
                ]
            });
            let axes = [Axis::linear("depth of the tip, mm"), Axis::linear("error, mm")];
            let [x, y] = axes;
            let plot = Plot::new("Errors of the simulated displacements", x, y, series.collect());
            plots.push(("errors".to_owned(), plot));
            let has_several = self.results.len() > 1;
            for result in &self.results {
                let name = match (has_several, result.poisson) {
                    (true, Some(poisson)) => format!("figure-15-{poisson}"),
                    _ => "figure-15".to_owned(),
                };
                plots.extend(self.figure_15(result).map(|plot| (name, plot)));
            }
        }
        plots
    }

    fn figure_12(&self) -> Plot {
        let model = &self.force_model;
        let corners = [0.0]
            .into_iter()
            .chain(model.breaks_mm.iter().copied())
            .chain([model.end_mm]);
        Plot::new(
            "Measured force and its piecewise-linear model",
            Axis::linear("depth of the tip, mm"),
            Axis::linear("force, N"),
            vec![
                Series::line("measured", 1, self.data.force.clone()),
                Series::line("model", 0, corners.map(|depth| [depth, model.at(depth)]).collect()),
            ],
        )
    }

    fn figure_14(&self) -> Plot {
        let mut series = vec![Series::line("measured", 1, self.data.force.clone())];
        let colour = |index: usize| if index == 0 { 0 } else { index + 1 };
        let simulated = self.results.iter().enumerate();
        series.extend(
            simulated.map(|(index, result)| Series::line(result.name(), colour(index), result.course.force.clone())),
        );
        let axes = [Axis::linear("depth of the tip, mm"), Axis::linear("force, N")];
        let [x, y] = axes;
        Plot::new("Measured and simulated force", x, y, series)
    }

    /// Places of the points in the plane of the needle's direction and the direction across in which they are spread
    /// most, with the deepest needle; only measured components of the displacement.
    fn figure_15(&self, result: &Identified) -> Option<Plot> {
        let motion = self.data.motion.as_ref()?;
        let (simulated, measured) = (result.course.moved_mm.last()?, motion.measured_mm.last()?);
        let direction = self.case.direction.into_inner();
        let spread = |across: &Vector3<f64>| {
            let places = motion.points.iter().map(|(point, _)| point.coords.dot(across));
            let (low, high) = places.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), offset| {
                (low.min(offset), high.max(offset))
            });
            high - low
        };
        let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
        // An axis almost parallel to the needle has no well-defined part across it.
        let across = axes
            .into_iter()
            .filter_map(|axis| (axis - direction * axis.dot(&direction)).try_normalize(0.1));
        let across = across.max_by(|a, b| spread(a).total_cmp(&spread(b)))?;
        let drawn = |point: usize, displacement: f64| {
            let (rest_mm, axis) = motion.points[point];
            let moved_mm = rest_mm + axis * displacement - self.case.entry;
            [moved_mm.dot(&direction), moved_mm.dot(&across)]
        };
        let both_finite =
            (0..motion.points.len()).filter(|point| measured[*point].is_finite() && simulated[*point].is_finite());
        let points: Vec<usize> = both_finite.collect();
        let drawn_points = |displacement: &dyn Fn(usize) -> f64| {
            points
                .iter()
                .map(|point| drawn(*point, displacement(*point)))
                .collect::<Vec<_>>()
        };
        let depth = *motion.depths_mm.last()?;
        Some(
            Plot::new(
                format!("Places in the tissue at a depth of {depth:.1} mm: {}", result.name()),
                Axis::linear("along the needle, mm"),
                Axis::linear("across, mm"),
                vec![
                    Series::points("at rest", 6, Marker::Frame, drawn_points(&|_| 0.0)),
                    Series::points("measured", 1, Marker::Ring, drawn_points(&|point| measured[point])),
                    Series::points("simulated", 0, Marker::Cross, drawn_points(&|point| simulated[point])),
                    Series::line("needle", 2, vec![[0.0, 0.0], [depth, 0.0]]),
                ],
            )
            .equal(),
        )
    }

    /// One self-contained HTML document.
    ///
    /// # Errors
    /// [`OutputError`] if a plot cannot be drawn.
    pub fn page(&self) -> Result<String, OutputError> {
        let mut page = Page::new("Identified tissue layers");
        for result in &self.results {
            for note in &result.notes {
                page.paragraph("warning", &format!("{}: {note}.", result.name()));
            }
        }
        page.put("<h2>Parameters</h2>");
        page.table(&self.parameters());
        page.paragraph(
            "soft",
            "f_p: force per length within w of the tip; f_s: behind it; E: Young's modulus (Dehghan et al. 2008, Table II).",
        );
        page.put("<h2>Errors</h2>");
        page.table(&self.errors());
        page.paragraph(
            "soft",
            "Mean and standard deviation of the error are taken over all measured places at a depth of the tip; the largest over all depths counts (Table III).",
        );
        self.closest().iter().for_each(|closest| page.paragraph("", closest));
        let sensitivities = self.beside();
        if !sensitivities.is_empty() {
            page.put("<h2>Certainty</h2>");
            page.table(&sensitivities);
            page.paragraph(
                "soft",
                "How far the cost rises where one modulus is changed and the forces are matched again: the less, the less certain the modulus.",
            );
        }
        page.put("<h2>Regions of the force</h2>");
        page.table(&self.regions());
        page.plots(self.plots().iter().map(|(_, plot)| plot))?;
        Ok(page.finish())
    }

    /// Scenarios with the parameters found, by file name. Paths of existing files are made absolute.
    pub fn scenarios(&self) -> Vec<(String, String)> {
        let has_several = self.results.len() > 1;
        let summary = |result: &Identified| {
            let name = match (has_several, result.poisson) {
                (true, Some(poisson)) => format!("scenario-{poisson}.toml"),
                _ => "scenario.toml".to_owned(),
            };
            (name, self.scenario(result))
        };
        self.results.iter().map(summary).collect()
    }

    fn scenario(&self, result: &Identified) -> String {
        let (text, folder) = &self.case.text;
        // The case was resolved from this text.
        let mut table: toml::Table = text.parse().unwrap_or_default();
        for value in table.iter_mut().map(|(_, value)| value) {
            make_absolute(value, folder);
        }
        let tissue = table
            .entry("tissue")
            .or_insert_with(|| Value::Table(toml::Table::new()));
        if let Value::Table(tissue) = tissue {
            let materials = tissue.entry("material").or_insert_with(|| Value::Array(Vec::new()));
            if let Value::Array(materials) = materials {
                self.split(materials);
                result.layers.iter().for_each(|layer| set(materials, layer));
            }
        }
        let head = "# Parameters of the layers on the needle's line were identified by `insonify identify` from a measured insertion.\n\n";
        head.to_owned() + &toml::to_string(&table).unwrap_or_default()
    }

    /// Gives every region of a table for several its own, named by its number.
    fn split(&self, materials: &mut Vec<Value>) {
        let regions = self.case.scenario.region_names.iter();
        let names = Names::new(regions.map(|(region, name)| (*region, i64::from(*region), vec![name.clone()])));
        let mut split = Vec::new();
        for material in materials.drain(..) {
            let wanted = material.get("region").and_then(|region| match region {
                Value::Integer(number) => Some(RegionName::Value(*number)),
                Value::String(name) => Some(RegionName::Name(name.clone())),
                _ => None,
            });
            let regions = wanted.map(|wanted| names.all(&wanted)).unwrap_or_default();
            if regions.is_empty() {
                split.push(material);
                continue;
            }
            for region in regions {
                let mut single = material.clone();
                if let Value::Table(single) = &mut single {
                    single.insert("region".to_owned(), Value::Integer(i64::from(region)));
                }
                split.push(single);
            }
        }
        *materials = split;
    }
}

/// Writes the parameters of a layer into the table of its region.
fn set(materials: &mut Vec<Value>, layer: &super::LayerParameters) {
    let number = Value::Integer(i64::from(layer.region));
    let index = materials
        .iter()
        .position(|material| material.get("region") == Some(&number));
    let index = index.unwrap_or_else(|| {
        let unnamed = materials.iter().find(|material| material.get("region").is_none());
        let template = unnamed.cloned().unwrap_or_else(|| Value::Table(toml::Table::new()));
        materials.push(template);
        materials.len() - 1
    });
    let Value::Table(table) = &mut materials[index] else {
        return;
    };
    let mut peak = toml::Table::new();
    peak.insert("density_n_per_mm".to_owned(), Value::Float(layer.peak_n_per_mm));
    peak.insert("width_mm".to_owned(), Value::Float(layer.width_mm));
    for (key, value) in [
        ("region", number),
        ("young_kpa", Value::Float(layer.young_kpa)),
        ("poisson", Value::Float(layer.poisson)),
        ("friction_n_per_mm", Value::Float(layer.shaft_n_per_mm)),
        ("peak", Value::Table(peak)),
    ] {
        table.insert(key.to_owned(), value);
    }
}

fn make_absolute(value: &mut Value, folder: &Path) {
    match value {
        Value::Table(table) => table.iter_mut().for_each(|(_, value)| make_absolute(value, folder)),
        Value::Array(array) => array.iter_mut().for_each(|value| make_absolute(value, folder)),
        Value::String(name) if folder.join(&*name).is_file() => {
            if let Ok(path) = folder.join(&*name).canonicalize() {
                *name = path.display().to_string();
            }
        }
        _ => {}
    }
}

impl fmt::Display for Identification {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.parameters().text("  ", &[]))?;
        writeln!(f, "{}", self.errors().text("  ", &[]))?;
        if let Some(closest) = self.closest() {
            writeln!(f, "  {closest}\n")?;
        }
        if !self.beside().is_empty() {
            writeln!(f, "{}", self.beside().text("  ", &[]))?;
        }
        f.write_str(&self.regions().text("  ", &[]))
    }
}
