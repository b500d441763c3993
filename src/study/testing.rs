//! Small scene and small study for tests.

use std::collections::BTreeMap;
use std::sync::{Arc, OnceLock};

use crate::anatomy::acoustics::{Preset, TissueTable};
use crate::anatomy::phantom::{Phantom, PhantomOptions, default_pose, make};
use crate::imaging::effects::{Effects, blur::Blur, noise::Noise};
use crate::imaging::synth::FrameState;
use crate::imaging::synth::tables::{Anatomy, Settings};
use crate::study::tradeoff::Study;
use crate::study::tradeoff::insertion::{InsertionOptions, Part, study};
use crate::tracking::probe::{Probe, ProbeShape};

/// Study of insertions into a block of some 300 nodes, made once: levels, thinning, links and elements.
pub fn insertions() -> &'static Study {
    static STUDY: OnceLock<Study> = OnceLock::new();
    STUDY.get_or_init(|| {
        let options = InsertionOptions {
            nodes: 300,
            depth_mm: 12.0,
            bevel_depth_mm: 20.0,
            passes: 1,
            parts: vec![Part::Levels, Part::Thinning, Part::Links, Part::Elements],
            ..InsertionOptions::default()
        };
        study(&options, &mut |_, _| {}).unwrap()
    })
}

/// Returns the two-layer phantom at 3 mm resolution under a linear probe, with all default effects and noise.
pub fn scene() -> (Anatomy, Settings, FrameState) {
    let coarse = PhantomOptions {
        resolution_mm: Some(3.0),
        seed: 1,
    };
    let volume = make(Phantom::TwoLayer, &coarse).unwrap();
    let (tissues, _) = TissueTable::resolve(volume.labels(), &[], Preset::Auto).unwrap();
    let anatomy = Anatomy {
        volume: Arc::new(volume),
        tissues: Arc::new(tissues),
        textures: BTreeMap::new(),
        mesh: None,
    };
    let shape = ProbeShape::Linear { width_mm: 38.0 };
    let mut probe = Probe::new(shape, 60.0).unwrap();
    (probe.lines, probe.samples) = (64, 32);
    let mut effects = Effects::usual();
    effects.blur = Some(Blur {
        width_mm: Some(0.6),
        growth_mm_cm: Some(0.06),
    });
    effects.noise = Some(Noise::default());
    let settings = Settings {
        seed: 1,
        ..Settings::new(probe, [32, 24], effects)
    };
    (anatomy, settings, FrameState::at(default_pose(Phantom::TwoLayer)))
}
