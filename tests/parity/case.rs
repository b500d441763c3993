//! Scenes that are compared on every backend.

pub(crate) use insonify_imaging::parity::Case;
use insonify_imaging::parity::{check, check_lossy};
pub(crate) use insonify_testing::lossy::BIASES;

use insonify_imaging::synth::tables::Settings;

use super::scenes;
use crate::support::gpu::gpu_or_skip;
use crate::support::image::assert_within;

/// Labels drawn anew at every voxel, under an oblique probe.
pub(crate) fn random(name: impl Into<String>, settings: Settings) -> Case {
    Case::new(name, scenes::random_anatomy(), settings, scenes::oblique_pose())
}

/// Compares the twins with the reference after every pass and at the pixels, for each of the cases.
pub(crate) fn check_all(cases: &[Case]) {
    let gpus: Vec<_> = gpu_or_skip().into_iter().collect();
    for case in cases {
        let verdicts = check(case, &gpus).unwrap_or_else(|error| panic!("{}: {error}", case.name));
        assert_eq!(verdicts.len(), 1 + gpus.len(), "{}: a verdict a backend", case.name);
        let lossy = check_lossy(case, &BIASES).unwrap_or_else(|error| panic!("{}: {error}", case.name));
        for verdict in verdicts.into_iter().chain(lossy) {
            let name = format!("{} on {}", case.name, verdict.backend);
            println!("{name}: {:.2} of the bounds", verdict.share);
            let pixels = &verdict.pixels;
            let faults = &verdict.faults[..verdict.faults.len().min(5)];
            if pixels.outside() == 0 || faults.len() > 1 {
                assert!(
                    faults.is_empty(),
                    "{name}: {} departures: {faults:#?}",
                    verdict.faults.len()
                );
            }
            assert_within(
                &format!("{name}, pixels"),
                pixels.size,
                &pixels.found,
                &pixels.expected,
                &pixels.allowed,
            );
        }
    }
}
