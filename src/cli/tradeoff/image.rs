//! `insonify tradeoff image`: cost of imaging options.

use std::time::Duration;

use clap::Args;
use insonify_study::tradeoff::gather::Devices;
use insonify_study::tradeoff::image::{ImageOptions, study};

use crate::backend::{BackendArgs, BackendName};
use crate::failure::{Error, usage};
use crate::study::Printed;

const TEACHING: &str = "\
Each table has a gold standard, made in the same run, and says which:

  beam grid   64 x 128 to 1024 x 2048 scanlines by samples, against 2048 x 4096 in double precision
  backends    double and single precision on the CPU, each GPU, against double precision
  labels      nearest voxel or voted, against boundaries of a closed form (mm) and voxels of 0.25 mm (grey levels)
  sampling    samples of a shadow, scanlines of a blur, against the finest
  texture     trilinear look-ups or a constant echo, against double precision
  grain       no grain, additive noise or developed speckle, against the statistics of speckle
  location    a walk from the last frame, a search grid or every element, against every element

Errors are of grey levels (of 255) on the scan-converted picture, or mm. A row with a star is a best choice: no other of its kind
is both faster and nearer to the truth. A row marked WRONG is not a valid approximation: it has a uniform offset, a larger error
than a coarser level, or differs where it must not.

Examples:
  insonify tradeoff image --quick                a first look, in half a minute
  insonify tradeoff image -o study               everything, with tables and plots: minutes
  insonify tradeoff image --backend cpu --json   without a GPU, for programs";

/// Imaging options: time and memory against grey levels and millimetres, for grids, labels, sampling, grain and backends
#[derive(Args)]
#[command(after_help = TEACHING)]
pub(super) struct Image {
    /// Coarser phantoms, fewer frames, no grid above 512 x 1024
    #[arg(long)]
    quick: bool,
    /// Time limit for each option, s, after at least three frames [default: 1.2; with --quick 0.12]
    #[arg(long, alias = "patience-s", value_name = "S", value_parser = super::super::bench::seconds)]
    time_limit_s: Option<f64>,
    #[command(flatten)]
    backend: BackendArgs,
    #[command(flatten)]
    printed: Printed,
}

impl Image {
    pub(super) fn run(&self) -> Result<(), Error> {
        self.backend.check()?;
        self.printed.check()?;
        if matches!(self.backend.backend, BackendName::CpuF64) {
            return Err(usage(
                "--backend cpu-f64: double precision is what all else is compared with",
                "ask for auto, cpu or gpu",
            ));
        }
        let Devices { gpus, missing } = self.backend.gpus()?;
        let mut options = match self.quick {
            true => ImageOptions::quick(gpus),
            false => ImageOptions::full(gpus),
        };
        if let Some(seconds) = self.time_limit_s {
            options.patience = Duration::from_secs_f64(seconds);
        }
        self.printed.run(|progress| {
            let mut study = study(&options, progress)?;
            study.notes.extend(missing);
            Ok(study)
        })
    }
}
