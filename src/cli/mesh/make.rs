//! `insonify mesh make`: a tetrahedral mesh from a labelled volume.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use insonify_anatomy::phantom::{self, Phantom, PhantomOptions};
use insonify_anatomy::segmentation::{self, Segmentation};
use insonify_anatomy::volume::complete::{CompleteOptions, complete};
use insonify_anatomy::volume::{Label, LabelVolume};
use insonify_base::note::Notes;
use insonify_base::stage;
use insonify_base::text::column;
use insonify_mesh::file::write_vtu_with;
use insonify_mesh::generate::{GenerateOptions, GenerateReport, LabelGrid, generate};
use serde::Serialize;

use crate::failure::{Error, usage};
use crate::input::NamesArg;
use crate::output::Force;
use crate::terminal;
use crate::variants::variants;

const EXAMPLES: &str = "\
Examples:
  insonify mesh make labels.nii.gz --nodes 3300 -o body.vtu          the body completed around the organs, one region a label
  insonify mesh make labels.nii.gz --nodes 1000 --labels 5 -o liver.vtu
  insonify mesh make labels.nii.gz --nodes 10000 --no-complete -o organs.vtu --json
  insonify mesh make --phantom abdomen --nodes 3300 -o abdomen.vtu

Regions carry the label values of the volume in the cell array `region`, their names in the field array `region_names`.
A finer mesh follows thin tissue better: `mislabelled` is the
share of the tissue that lies in elements of another region. About 3,000 nodes suit a simulator's loop, 10,000 a study.
`insonify mesh info FILE` describes the result.";

/// Volume below which the volume error of a region is not checked, ml.
const LARGE_ML: f64 = 50.0;
/// Volume error of a larger region above which a warning is given, per cent.
const WORST_PERCENT: f64 = 3.0;
/// Percentage of the tissue in the wrong region above which a warning is given.
const WRONG_PERCENT: f64 = 50.0;

/// Makes a tetrahedral mesh from a labelled volume: conforming, one region per label, fine where tissues meet
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Make {
    /// Label file, or a folder of binary masks named by their files
    #[arg(
        value_name = "VOLUME",
        required_unless_present = "phantom",
        conflicts_with = "phantom"
    )]
    volume: Option<PathBuf>,
    #[command(flatten)]
    names: NamesArg,
    /// A built-in phantom in place of a file
    #[arg(long, value_name = "NAME", value_parser = variants::<Phantom>())]
    phantom: Option<Phantom>,
    /// Maximum number of nodes; the mesh has nearly as many
    #[arg(long, value_name = "N")]
    nodes: usize,
    /// File to write (.vtu)
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    #[command(flatten)]
    force: Force,
    /// Label values to mesh, without anything around them [default: all]
    #[arg(long, value_name = "VALUE,...", value_delimiter = ',', allow_hyphen_values = true)]
    labels: Vec<i64>,
    /// Fill the unlabelled body around the organs as `render` does; the default without --labels
    #[arg(long, conflicts_with_all = ["no_complete", "labels", "phantom"])]
    complete: bool,
    /// Mesh labelled voxels only: organs that do not touch become separate parts
    #[arg(long)]
    no_complete: bool,
    /// Minimum dihedral angle of an element, degrees (0 to 30): smaller values follow interfaces more closely
    #[arg(long, value_name = "DEG", default_value_t = GenerateOptions::default().min_dihedral_deg)]
    min_dihedral_deg: f64,
    /// Longest edge within tissue before nodes are moved to interfaces, mm [default: determined by the number of
    /// nodes]
    #[arg(long, value_name = "MM")]
    max_edge_mm: Option<f64>,
    /// Print one JSON object to standard output
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct MakeReport {
    nodes: usize,
    elements: usize,
    parts: usize,
    min_dihedral_deg: f64,
    max_jacobian_condition: f64,
    mislabelled_percent: f64,
    regions: Vec<RegionReport>,
    seconds: f64,
    notes: Notes,
    warnings: Vec<String>,
}

#[derive(Serialize)]
struct RegionReport {
    value: i64,
    name: String,
    voxels_ml: f64,
    mesh_ml: f64,
    error_percent: f64,
}

impl Make {
    pub(super) fn run(&self) -> Result<(), Error> {
        let inputs: Vec<PathBuf> = self.volume.iter().cloned().collect();
        self.force.check_ending([&self.output], "vtu", "meshes", &inputs)?;
        let Segmentation {
            mut volume,
            mut notes,
            mut warnings,
            ..
        } = self.segmentation()?;
        // Unlabelled voxels within a body would be holes in its mesh. Labels that were chosen are meshed
        // alone, and what surrounds them is outside.
        if self.phantom.is_some() {
            notes.push("the phantom is meshed as it is, outside left out".to_owned());
        } else if self.labels.is_empty() && !self.no_complete {
            let completed = stage::during("completing the body", || complete(&volume, &CompleteOptions::default()));
            let path = inputs.first().map_or(Path::new(""), PathBuf::as_path);
            let completed = completed.map_err(|error| error.in_file(path))?;
            volume = completed.volume.undivided().clone();
            notes.push(completed.note);
            warnings.extend(completed.warning);
        } else {
            notes.push("unlabelled voxels are outside, as asked: nothing was filled".to_owned());
        }
        terminal::notes(&notes);
        let regions = self.regions(&volume)?;
        let grid = LabelGrid {
            labels: volume.voxels(),
            size: volume.size(),
            index_to_world: *volume.index_to_world(),
            regions: &regions,
        };
        let options = GenerateOptions {
            min_dihedral_deg: self.min_dihedral_deg,
            max_edge_mm: self.max_edge_mm,
            ..GenerateOptions::default()
        };
        let start = Instant::now();
        let generated = terminal::with_share("making the mesh", |progress| {
            generate(&grid, self.nodes, &options, |share| progress(f64::from(share)))
        })?;
        let seconds = start.elapsed().as_secs_f64();
        let report = MakeReport::new(&generated.report, volume.labels(), seconds, notes, &mut warnings);
        let named = report.regions.iter().filter(|region| !region.name.is_empty());
        let names = named.map(|region| (region.value as i32, region.name.clone())).collect();
        write_vtu_with(&self.output, &generated.mesh, &names, &[], &[])?;

        report.warnings.iter().for_each(terminal::warn);
        terminal::show(&report, self.json, || report.table(&self.output))
    }

    /// Returns the volume to mesh.
    fn segmentation(&self) -> Result<Segmentation, Error> {
        match (self.phantom, &self.volume) {
            (None, Some(file)) => {
                let naming = self.names.naming()?;
                Ok(stage::during("reading labels", || segmentation::open(file, &naming))?)
            }
            (phantom, _) => Ok(phantom::make(phantom.unwrap_or_default(), &PhantomOptions::default())?.into()),
        }
    }

    /// Name of the input, for a message.
    fn name(&self) -> String {
        match &self.volume {
            Some(file) => file.display().to_string(),
            None => "the phantom".to_owned(),
        }
    }

    /// Labels to mesh, each with its value as region number.
    fn regions(&self, volume: &LabelVolume) -> Result<Vec<(u8, i32)>, Error> {
        let labels = volume.labels();
        let occupied: Vec<usize> = (1..labels.len()).filter(|index| volume.holds(*index)).collect();
        if occupied.is_empty() {
            let found = format!("{}: no voxel is labelled", self.name());
            return Err(usage(found, "give a volume with labels other than 0"));
        }
        let mut chosen = Vec::new();
        for value in &self.labels {
            match occupied.iter().find(|index| labels[**index].value == *value) {
                Some(&index) if !chosen.contains(&index) => chosen.push(index),
                Some(_) => {}
                None => {
                    let found = format!("{}: no voxel has label {value}", self.name());
                    return Err(usage(
                        found,
                        format!("it holds the labels {}", listed(labels, &occupied)),
                    ));
                }
            }
        }
        if self.labels.is_empty() {
            chosen = occupied;
        }
        chosen
            .into_iter()
            .map(|index| {
                let value = labels[index].value;
                let number = i32::try_from(value).map_err(|_| {
                    let found = format!("label {value} cannot be a region number");
                    usage(found, "region numbers have 32 bits: renumber the label")
                })?;
                Ok((index as u8, number))
            })
            .collect()
    }
}

/// Lists label values with their names, for a message.
fn listed(labels: &[Label], which: &[usize]) -> String {
    let described = |&index: &usize| match &labels[index].name {
        Some(name) => format!("{} ({name})", labels[index].value),
        None => labels[index].value.to_string(),
    };
    which.iter().map(described).collect::<Vec<_>>().join(", ")
}

impl MakeReport {
    fn new(
        generated: &GenerateReport,
        labels: &[Label],
        seconds: f64,
        notes: Notes,
        warnings: &mut Vec<String>,
    ) -> Self {
        let name = |value: i64| {
            labels
                .iter()
                .find(|label| label.value == value)
                .and_then(|label| label.name.clone())
        };
        let regions: Vec<RegionReport> = generated
            .regions
            .iter()
            .map(|region| RegionReport {
                value: i64::from(region.region),
                name: name(i64::from(region.region)).unwrap_or_default(),
                voxels_ml: region.voxel_ml,
                mesh_ml: region.mesh_ml,
                error_percent: region.error_percent,
            })
            .collect();
        let values = |which: &dyn Fn(&RegionReport) -> bool| -> Vec<String> {
            regions
                .iter()
                .filter(|region| which(region))
                .map(|region| region.value.to_string())
                .collect()
        };
        let lost = values(&|region| region.mesh_ml == 0.0);
        if !lost.is_empty() {
            warnings.push(format!(
                "no element is fine enough for the labels {}: they are not in the mesh",
                lost.join(", ")
            ));
        }
        // A small region has too few elements to match its voxels; only in a large one does the error speak
        // of nodes.
        let inexact = values(&|region| region.voxels_ml > LARGE_ML && region.error_percent.abs() > WORST_PERCENT);
        if !inexact.is_empty() {
            warnings.push(format!(
                "regions {} of more than {LARGE_ML} ml are off by more than {WORST_PERCENT} % in volume: more nodes would help",
                inexact.join(", ")
            ));
        }
        if generated.mislabelled_percent > WRONG_PERCENT {
            warnings.push(format!(
                "{:.0} % of the tissue lies in another region than its own: most of it is thinner than the elements; more nodes would help",
                generated.mislabelled_percent
            ));
        }
        if generated.parts > 1 {
            warnings.push(format!(
                "the mesh has {} parts that do not touch: each needs fixed nodes of its own",
                generated.parts
            ));
        }
        MakeReport {
            nodes: generated.nodes,
            elements: generated.elements,
            parts: generated.parts,
            min_dihedral_deg: generated.min_dihedral_deg,
            max_jacobian_condition: generated.max_jacobian_condition,
            mislabelled_percent: generated.mislabelled_percent,
            regions,
            seconds,
            notes,
            warnings: std::mem::take(warnings),
        }
    }

    fn table(&self, output: &Path) -> String {
        let mut text = format!(
            "wrote {}: {} nodes, {} tetrahedra, made in {:.1} s\n\
             least dihedral angle {:.1} degrees, largest Jacobian condition {:.1}, {:.1} % of the tissue mislabelled\n\n",
            output.display(),
            self.nodes,
            self.elements,
            self.seconds,
            self.min_dihedral_deg,
            self.max_jacobian_condition,
            self.mislabelled_percent,
        );
        let names = column("name", self.regions.iter().map(|region| region.name.as_str()));
        // Writing to a string does not fail.
        let _ = writeln!(
            text,
            "{:>6}  {}  {:>10}  {:>10}  {:>8}",
            "region", names[0], "voxels ml", "mesh ml", "error %"
        );
        for (region, name) in self.regions.iter().zip(&names[1..]) {
            let _ = writeln!(
                text,
                "{:>6}  {name}  {:>10.2}  {:>10.2}  {:>8.2}",
                region.value, region.voxels_ml, region.mesh_ml, region.error_percent
            );
        }
        text
    }
}
