//! Backends and scenes shared by the image cases.

use nalgebra::Matrix4;

use super::super::record::{Record, Unexpected};
use crate::gpu::{AdapterChoice, Gpu, Needs, adapter};
use crate::imaging::effects::Effects;
use crate::imaging::synth::tables::{Anatomy, ImageSize, Settings};
use crate::imaging::synth::{Backend, FrameState, SynthError, Synthesizer};
use crate::study::parity::{Case, Verdict};
use crate::tracking::probe::{Probe, ProbeShape};

/// Opens every adapter of the machine and records how many there are. An adapter that cannot be opened is reported but is no failure, as it
/// renders nothing.
pub fn gpus(record: &mut Record<'_>) -> Vec<Gpu> {
    let mut found = Vec::new();
    for adapter in adapter::list() {
        let choice = AdapterChoice::named(format!("{} ({})", adapter.name, adapter.backend));
        match Gpu::open(&choice, &Needs::default()) {
            Ok(gpu) => found.push(gpu),
            Err(error) => record.report(format!("adapter that does not open ({error})"), 1.0),
        }
    }
    let what = match found.len() {
        0 => "GPU adapters: none, so this holds of the CPU alone",
        _ => "GPU adapters",
    };
    record.report(what, found.len() as f64);
    found
}

/// Returns the backend name of a synthesizer: `cpu`, `cpu-f64` or the adapter's name.
pub fn name(synth: &Synthesizer) -> String {
    let adapter = synth.gpu().map(|gpu| gpu.report().name.clone());
    adapter.unwrap_or_else(|| synth.backend().to_owned())
}

/// Creates synthesizers of a scene in both precisions of the CPU, the reference first, and on each GPU.
pub fn everywhere(anatomy: &Anatomy, settings: &Settings, gpus: &[Gpu]) -> Result<Vec<Synthesizer>, SynthError> {
    let on_gpus = gpus.iter().map(|gpu| Backend::Gpu(Box::new(gpu.clone())));
    let backends = [Backend::CpuF64, Backend::Cpu].into_iter().chain(on_gpus);
    backends
        .map(|backend| Synthesizer::new(anatomy.clone(), settings.clone(), backend))
        .collect()
}

/// Returns settings for images of 64 x 48 pixels.
pub fn settings(shape: ProbeShape, depth_mm: f64, [lines, samples]: [u32; 2], effects: Effects) -> Settings {
    Settings {
        seed: 0x5eed_0000_0001,
        probe: Probe {
            shape,
            depth_mm,
            frequency_mhz: 5.0,
            lines,
            samples,
        },
        image: ImageSize {
            width: 64,
            height: 48,
            margin: 0.03,
            fill: 7,
            placed: None,
        },
        effects,
        has_needle: false,
    }
}

/// Returns a frame state with the probe at the origin, looking along +y.
pub fn straight() -> FrameState {
    FrameState::at(Matrix4::identity())
}

/// Totals of the comparisons on one backend.
#[derive(Default)]
struct Sum {
    backend: String,
    samples: usize,
    labels_apart: usize,
    share: f64,
    faults: usize,
    first: Option<String>,
}

/// Verdicts totalled by backend.
#[derive(Default)]
pub struct Tally(Vec<Sum>);

impl Tally {
    /// Adds the verdicts on a scene.
    pub fn add(&mut self, case: &Case, verdicts: Vec<Verdict>) {
        for (at, verdict) in verdicts.into_iter().enumerate() {
            if self.0.len() <= at {
                self.0.push(Sum {
                    backend: verdict.backend.clone(),
                    ..Sum::default()
                });
            }
            let sum = &mut self.0[at];
            sum.samples += verdict.samples;
            sum.labels_apart += verdict.labels_apart;
            sum.share = sum.share.max(verdict.share);
            sum.faults += verdict.faults.len();
            if let (None, Some(fault)) = (&sum.first, verdict.faults.first()) {
                sum.first = Some(format!("{}: {fault}", case.name));
            }
        }
    }

    /// Records the totals.
    pub fn note(self, record: &mut Record<'_>) -> Result<(), Unexpected> {
        if self.0.is_empty() {
            return Err(Unexpected::new("nothing was compared"));
        }
        for sum in self.0 {
            let Sum { backend, .. } = &sum;
            record.report(
                format!("{backend}: samples compared after every pass"),
                sum.samples as f64,
            );
            record.report(
                format!("{backend}: labels apart, each within rounding of a face"),
                sum.labels_apart as f64,
            );
            record.under(
                format!("{backend}: largest departure over what rounding allows"),
                sum.share,
                1.0,
            );
            let first = sum.first.as_ref().map_or(String::new(), |fault| format!(" ({fault})"));
            record.zero(
                format!("{backend}: departures that rounding cannot explain{first}"),
                sum.faults as f64,
            );
        }
        Ok(())
    }
}
