//! Manifest of a run: what each frame shows, as `manifest.jsonl` and `manifest.csv`.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use insonify_base::matrix::Rows;
use insonify_base::output::{OutputError, atomic};
use insonify_base::read;
use insonify_imaging::scene::Parameters;
use insonify_imaging::sidecar::{InputFile, Provenance};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::backend::Chosen;

/// Rows as they are written, in a run that is not complete.
const ROWS: &str = "insonify-rows.jsonl";

/// Names of the manifest.
pub(crate) const MANIFESTS: [&str; 2] = ["manifest.jsonl", "manifest.csv"];

/// Contents of a frame, and its files.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Row {
    /// Frame number, from 0.
    pub frame: usize,
    /// Names of its files, by `image`, layer, `sidecar` and `overview`.
    pub files: BTreeMap<String, String>,
    /// Time, s.
    pub time_s: f64,
    /// Transform from the probe frame to the world, mm.
    pub probe_to_world: Rows,
    /// Target that the probe was placed over, if the scene names one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub target: Option<String>,
    /// Share of the field of view that shows the target, by area; 0 where the frame misses it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub target_share: Option<f64>,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Parameters of this frame alone.
    pub frame_parameters: Parameters,
    /// Doubts about this frame.
    pub warnings: Vec<String>,
}

/// Rows of a run into a folder.
pub(crate) struct Manifest {
    folder: PathBuf,
    journal: File,
    rows: BTreeMap<usize, Row>,
    provenance: Provenance,
}

impl Manifest {
    /// Opens the manifest in a folder, which may hold frames of a run that was cut off: [`Manifest::has`] those whose
    /// files are all there.
    pub(crate) fn open(folder: &Path, provenance: Provenance) -> Result<Self, OutputError> {
        let path = folder.join(ROWS);
        let known = fs::read_to_string(&path).unwrap_or_default();
        let whole = |row: &Row| {
            let mut files = row.files.values();
            files.all(|name| fs::metadata(folder.join(name)).is_ok_and(|file| file.len() > 0))
        };
        // The last line may be torn.
        let rows = known.lines().filter_map(|line| serde_json::from_str(line).ok());
        let rows: BTreeMap<usize, Row> = rows.filter(whole).map(|row: Row| (row.frame, row)).collect();
        let opened = (|| {
            let mut journal = File::create(&path)?;
            rows.values().try_for_each(|row| line(&mut journal, row))?;
            Ok(journal)
        })();
        let journal = opened.map_err(|cause| OutputError::write(&path, cause))?;
        Ok(Self {
            folder: folder.to_owned(),
            journal,
            rows,
            provenance,
        })
    }

    /// Whether a frame is there.
    pub(crate) fn has(&self, frame: usize) -> bool {
        self.rows.contains_key(&frame)
    }

    /// Adds a frame.
    pub(crate) fn add(&mut self, row: Row) -> Result<(), OutputError> {
        line(&mut self.journal, &row).map_err(|cause| OutputError::write(&self.folder.join(ROWS), cause))?;
        self.rows.insert(row.frame, row);
        Ok(())
    }

    /// Writes the manifest of all frames.
    pub(crate) fn finish(self) -> Result<(), OutputError> {
        let [lines, table] = MANIFESTS.map(|name| self.folder.join(name));
        atomic::write(&lines, |file| {
            line(file, &json!({ "made_by": self.provenance, "frames": self.rows.len() }))?;
            self.rows.values().try_for_each(|row| line(file, row))
        })?;
        atomic::write(&table, |file| file.write_all(self.table().as_bytes()))?;
        // It is in the manifest.
        let _ = fs::remove_file(self.folder.join(ROWS));
        Ok(())
    }

    /// Rows as CSV: the pose in the columns of a path, and each file and parameter in a column.
    fn table(&self) -> String {
        let files: BTreeSet<&str> = self
            .rows
            .values()
            .flat_map(|row| row.files.keys().map(String::as_str))
            .collect();
        let paths: BTreeSet<&str> = self
            .rows
            .values()
            .flat_map(|row| row.frame_parameters.keys().map(String::as_str))
            .filter(|path| !["seed", "pose.target"].contains(path))
            .collect();
        let pose = (0..16).map(|entry| format!("m{}{}", entry / 4, entry % 4));
        let mut head = vec!["frame".to_owned(), "time_s".to_owned()];
        head.extend(pose);
        head.extend(["target", "target_share", "seed"].map(str::to_owned));
        head.extend(paths.iter().chain(&files).map(|name| (*name).to_owned()));
        head.push("warnings".to_owned());
        let mut text = head.iter().map(|name| cell(name)).collect::<Vec<_>>().join(",") + "\n";
        for row in self.rows.values() {
            let mut cells = vec![row.frame.to_string(), row.time_s.to_string()];
            cells.extend(row.probe_to_world.0.transpose().iter().map(f64::to_string));
            cells.push(row.target.clone().unwrap_or_default());
            cells.push(row.target_share.map_or(String::new(), |share| share.to_string()));
            cells.push(row.seed.to_string());
            cells.extend(paths.iter().map(|path| match row.frame_parameters.get(*path) {
                Some(Value::String(word)) => word.clone(),
                value => value.map_or(String::new(), Value::to_string),
            }));
            cells.extend(
                files
                    .iter()
                    .map(|name| row.files.get(*name).cloned().unwrap_or_default()),
            );
            cells.push(row.warnings.join("; "));
            text += &(cells.iter().map(|text| cell(text)).collect::<Vec<_>>().join(",") + "\n");
        }
        text
    }
}

fn line(file: &mut impl Write, value: &impl Serialize) -> io::Result<()> {
    let mut text = serde_json::to_string(value)?;
    text.push('\n');
    file.write_all(text.as_bytes())
}

/// A cell of a CSV file.
fn cell(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.to_owned()
    }
}

/// Origin of the frames: program, backend, and the files that have been read since [`read::record`].
pub(crate) fn provenance(chosen: &Chosen) -> Result<Provenance, OutputError> {
    let inputs = read::recorded().into_iter().map(|path| {
        let hash = hash(&path).map_err(|cause| OutputError::write(&path, cause))?;
        Ok(InputFile {
            path: path.to_string_lossy().into_owned(),
            blake3: hash,
        })
    });
    Ok(Provenance {
        program: "insonify".to_owned(),
        version: insonify_base::VERSION.to_owned(),
        commit: option_env!("INSONIFY_COMMIT").map(str::to_owned),
        backend: chosen.synth.backend().to_owned(),
        adapter: chosen.adapter().map(str::to_owned),
        inputs: inputs.collect::<Result<_, OutputError>>()?,
    })
}

fn hash(path: &Path) -> io::Result<String> {
    let mut hasher = blake3::Hasher::new();
    io::copy(&mut File::open(path)?, &mut hasher)?;
    Ok(hasher.finalize().to_hex().to_string())
}
