//! Output folder of a run.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use insonify::Summary;
use insonify::input::scenario::Scenario;
use insonify::input::scenario::reported_points::Displaced;
use insonify::run::deformed::{NeedlePoly, seeds_poly};
use insonify::run::record::Record;
use insonify::run::{Deformed, Moment, Observer, Requests, Step};
use insonify_base::output::{OutputError, numbered, png};
use insonify_base::stage::{self, Extent, Stage};
use insonify_mesh::TetMesh;
use insonify_mesh::file::{DISPLACEMENT, MeshFileError, Poly, Values, write_pvd, write_vtp, write_vtu_with};
use insonify_report::gif::Gif;
use insonify_report::plot::SIZE;
use serde::Serialize;

use super::Images;
use crate::backend::Chosen;
use crate::output::text;
use crate::render::extras::Extras;
use crate::render::output::{Output, Shot};
use crate::render::target::Target;
use crate::terminal;
use insonify::Error;

/// Files of a run, as [`insonify_base::output::folder::Folder::open`] takes them; plots are not checked for in advance.
pub(super) const FILES: &[&str] = &[
    "steps.csv",
    "points.csv",
    "index.html",
    "summary.json",
    "preview.gif",
    "frames.mha",
    "frames_",
    "frames/frame_",
    "frames/parameters.json",
    "mesh/mesh_",
    "mesh/mesh.pvd",
    "mesh/needle_",
    "mesh/needle.pvd",
    "mesh/probe_",
    "mesh/probe.pvd",
    "mesh/seeds_",
    "mesh/seeds.pvd",
    "mesh/needle.csv",
];

/// Header of the table of forces along the needle.
const FORCES: &str = "time_s,from_mm,to_mm,along_n,across_n,along_n_per_mm,across_n_per_mm";

/// Writes files during a run.
pub(super) struct Writer<'a> {
    scenario: &'a Scenario,
    folder: PathBuf,
    steps: BufWriter<File>,
    /// Table of displacements, if points are reported.
    points: Option<BufWriter<File>>,
    /// Table of forces along the needle, if meshes are written.
    forces: String,
    record: Record,
    stage: Stage,
    frames: Option<Rendering<'a>>,
    /// Number of expected meshes.
    mesh_count: usize,
    /// Kinds of series beside each other, with the time (s) and name of each file.
    series: BTreeMap<&'static str, Vec<(f64, String)>>,
}

/// Rendering of frames during a run.
struct Rendering<'a> {
    chosen: Chosen,
    output: Option<Output<'a>>,
    preview: Option<Gif>,
}

impl<'a> Writer<'a> {
    pub(super) fn new(scenario: &'a Scenario, folder: &Path, requests: Requests) -> Result<Self, Error> {
        let path = folder.join("steps.csv");
        let wrong = |cause| OutputError::write(&path, cause);
        let mut steps = BufWriter::new(File::create(&path).map_err(wrong)?);
        let record = Record::new(scenario);
        record.head(&mut steps).map_err(wrong)?;
        let path = folder.join("points.csv");
        let wrong = |cause| OutputError::write(&path, cause);
        let points = (!scenario.reports.is_empty()).then(|| File::create(&path).map(BufWriter::new));
        let mut points = points.transpose().map_err(wrong)?;
        if let Some(points) = &mut points {
            record.points_head(points).map_err(wrong)?;
        }
        Ok(Self {
            scenario,
            folder: folder.to_owned(),
            steps,
            points,
            forces: String::new(),
            record,
            stage: stage::enter("inserting the needle", Extent::Share(0.0)),
            frames: None,
            mesh_count: requests
                .mesh_s
                .map_or(0, |every_s| scenario.timing.moments(every_s) as usize),
            series: BTreeMap::new(),
        })
    }

    /// Enables rendering of frames, to files with their companion files, or for the preview alone.
    pub(super) fn render(
        &mut self,
        chosen: Chosen,
        images: Option<Images>,
        extras: &Extras,
        preview: bool,
    ) -> Result<(), Error> {
        let scenario = self.scenario;
        let size = scenario.scene.settings.image;
        let target = images.map(|images| match images {
            Images::Mha => Target::Sequence(self.folder.join("frames.mha"), self.folder.join("frames")),
            Images::Png => Target::Folder(self.folder.join("frames")),
        });
        let count = scenario.timing.moments(scenario.timing.frame_s) as usize;
        let output = target.map(|target| Output::open(target, extras, &scenario.scene, count));
        let path = self.folder.join("preview.gif");
        let preview = preview.then(|| Gif::preview(&path, size.width, size.height, self.scenario.timing.frame_s));
        self.frames = Some(Rendering {
            chosen,
            output: output.transpose()?,
            preview: preview.transpose()?,
        });
        Ok(())
    }

    /// Warnings about rendering.
    pub(super) fn warnings(&self) -> Vec<String> {
        let frames = self.frames.iter();
        frames
            .flat_map(|frames| frames.chosen.warnings.iter().cloned())
            .collect()
    }

    /// Finishes the table and writes plots, page and summary.
    pub(super) fn finish(mut self, title: &str, summary: &Summary, report: &impl Serialize) -> Result<(), Error> {
        self.stage.rename("writing plots and pages");
        let path = self.folder.join("steps.csv");
        self.steps.flush().map_err(|cause| OutputError::write(&path, cause))?;
        if let Some(points) = &mut self.points {
            let path = self.folder.join("points.csv");
            points.flush().map_err(|cause| OutputError::write(&path, cause))?;
        }
        if let Some(frames) = self.frames {
            frames.output.map_or(Ok(()), Output::finish)?;
            frames.preview.map_or(Ok(()), Gif::finish)?;
        }
        for (name, files) in &self.series {
            write_pvd(&self.folder.join("mesh").join(format!("{name}.pvd")), files)?;
        }
        if !self.series.is_empty() {
            let path = self.folder.join("mesh").join("needle.csv");
            text(&path, &format!("{FORCES}\n{}", self.forces))?;
        }
        let plots = make(&self.folder.join("plots"))?;
        for (name, plot) in self.record.plots() {
            text(&plots.join(format!("{name}.svg")), &plot.svg()?)?;
            let [width, height] = SIZE.map(|side| side as usize);
            png::write_rgb(&plots.join(format!("{name}.png")), width, height, &plot.rgb()?)?;
        }
        let others = [
            "frames.mha",
            "preview.gif",
            "mesh/mesh.pvd",
            "mesh/needle.csv",
            "points.csv",
            "steps.csv",
            "summary.json",
        ];
        // The page links the summary, which is written after it: it is listed although it does not exist yet.
        let others = others
            .into_iter()
            .filter(|name| *name == "summary.json" || self.folder.join(name).is_file());
        let page = self.record.page(title, summary, &others.collect::<Vec<_>>())?;
        text(&self.folder.join("index.html"), &page)?;
        let json = terminal::pretty(report)?;
        text(&self.folder.join("summary.json"), &format!("{json}\n"))
    }

    fn write_mesh(&mut self, deformed: &Deformed<'_>) -> Result<(), Error> {
        let path = self.next("mesh", "vtu", deformed)?;
        let tissue = deformed.tissue;
        let elements = deformed.elements.to_vec();
        let regions = if self.scenario.mesh.elements().len() == elements.len() {
            self.scenario.mesh.regions().to_vec()
        } else {
            vec![0; elements.len()]
        };
        let mesh = TetMesh::new(tissue.reference.clone(), elements, regions).map_err(|source| MeshFileError::Mesh {
            path: path.clone(),
            source,
        })?;
        let pairs = tissue.reference.iter().zip(&tissue.current);
        let moved: Vec<[f64; 3]> = pairs.map(|(a, b)| [0, 1, 2].map(|axis| b[axis] - a[axis])).collect();
        let of_nodes = [(DISPLACEMENT, Values::Vectors(&moved))];
        let stress = deformed
            .von_mises_kpa
            .map(|kpa| ("von_mises_kpa", Values::Scalars(kpa)));
        write_vtu_with(&path, &mesh, &BTreeMap::new(), &of_nodes, stress.as_slice())?;
        Ok(())
    }

    /// Path of the next file of a series, which is remembered.
    fn next(&mut self, series: &'static str, ending: &str, deformed: &Deformed<'_>) -> Result<PathBuf, Error> {
        let number = numbered(deformed.number as usize, self.mesh_count);
        let name = format!("{series}_{number}.{ending}");
        let path = make(&self.folder.join("mesh"))?.join(&name);
        self.series.entry(series).or_default().push((deformed.time_s, name));
        Ok(path)
    }

    /// Writes needle, probe and seeds beside a mesh, and the forces along the needle.
    fn write_instruments(&mut self, deformed: &Deformed<'_>) -> Result<(), Error> {
        let needle = NeedlePoly::new(deformed.needle, deformed.loads);
        let of_cells = [
            ("force_n", Values::Vectors(&needle.force_n)),
            ("along_n_per_mm", Values::Scalars(&needle.along_n_per_mm)),
            ("across_n_per_mm", Values::Scalars(&needle.across_n_per_mm)),
        ];
        let path = self.next("needle", "vtp", deformed)?;
        write_vtp(
            &path,
            &needle.poly,
            &[("arc_mm", Values::Scalars(&needle.arc_mm))],
            &of_cells,
        )?;
        let probe = self.scenario.probe_poly(&deformed.probe, deformed.contact.as_ref());
        let series: [(&str, Poly); 2] = [("probe", probe), ("seeds", seeds_poly(deformed.seeds))];
        // Seeds are written even before the first is left, so that their series has the times of the others.
        for (series, poly) in series {
            if series == "probe" || !self.scenario.deposits.is_empty() || !deformed.seeds.is_empty() {
                write_vtp(&self.next(series, "vtp", deformed)?, &poly, &[], &[])?;
            }
        }
        for load in deformed.loads {
            let middle = 0.5 * (load.from_mm + load.to_mm);
            let tangent = deformed.needle.point_at_arc(middle).tangent;
            let along_n = tangent.dot(&load.force_n);
            let across = (load.force_n - tangent.into_inner() * along_n).norm();
            let density = if load.length_mm() > 0.0 {
                format!("{:.6},{:.6}", along_n / load.length_mm(), across / load.length_mm())
            } else {
                ",".to_owned()
            };
            let ends = format!("{:.4},{:.4}", load.from_mm, load.to_mm);
            self.forces += &format!("{},{ends},{along_n:.6},{across:.6},{density}\n", deformed.time_s);
        }
        Ok(())
    }
}

impl Observer for Writer<'_> {
    type Error = Error;

    fn step(&mut self, step: &Step<'_>) -> Result<(), Error> {
        self.record
            .step(step, &mut self.steps)
            .map_err(|cause| OutputError::write(&self.folder.join("steps.csv"), cause))?;
        self.stage.share(step.number as f64 / self.scenario.timing.steps as f64);
        Ok(())
    }

    fn frame(&mut self, moment: &Moment<'_>) -> Result<(), Error> {
        let Some(frames) = &mut self.frames else {
            return Ok(());
        };
        let frame = frames.chosen.synth.render(moment.state)?;
        self.record.frame(moment, frame);
        if let Some(output) = &frames.output {
            let hit = moment.clearance_mm == Some(0.0);
            let warnings: Vec<String> = hit
                .then(|| "the tip is in a critical structure".to_owned())
                .into_iter()
                .collect();
            let shot = Shot {
                number: moment.number as usize,
                time_s: moment.time_s,
                state: moment.state,
                clearance_mm: moment.clearance_mm,
                warnings: &warnings,
            };
            output.write(output.take(&frames.chosen.synth, &shot)?)?;
        }
        if let Some(preview) = &mut frames.preview {
            preview.push(&frames.chosen.synth.frame().pixels)?;
        }
        Ok(())
    }

    fn mesh(&mut self, deformed: &Deformed<'_>) -> Result<(), Error> {
        self.write_mesh(deformed)?;
        self.write_instruments(deformed)
    }

    fn points(&mut self, displaced: &Displaced<'_>) -> Result<(), Error> {
        let Some(points) = &mut self.points else {
            return Ok(());
        };
        let written = self.record.points(displaced, points);
        written.map_err(|cause| OutputError::write(&self.folder.join("points.csv"), cause))?;
        Ok(())
    }
}

/// Creates a folder if it is missing.
fn make(folder: &Path) -> Result<PathBuf, Error> {
    fs::create_dir_all(folder).map_err(|cause| OutputError::write(folder, cause))?;
    Ok(folder.to_owned())
}
