//! Sampling density: samples along a shadow, scanlines across a blur.

use super::compare::{Apart, inside, picture, values};
use super::scene::{Subject, coarsened};
use super::{ImageError, ImageOptions, PICTURE, Table, factor};
use crate::imaging::effects::Effects;
use crate::imaging::effects::tone::Tone;
use crate::imaging::synth::Backend;
use crate::imaging::synth::tables::Settings;
use crate::study::tradeoff::{GREY_LEVELS, Goal};

/// One effect on its own over slices, and the grids that refine its sums.
struct Variant {
    name: &'static str,
    keep: fn(&Effects) -> Effects,
    /// Grids from coarse to fine; the last is the gold standard.
    grids: [[u32; 2]; 6],
}

const SAMPLES: [[u32; 2]; 6] = [[256, 64], [256, 128], [256, 256], [256, 512], [256, 1024], [256, 4096]];
const LINES: [[u32; 2]; 6] = [[32, 512], [64, 512], [128, 512], [256, 512], [512, 512], [1024, 512]];

fn bare(effects: &Effects) -> Effects {
    Effects {
        tone: effects.tone.as_ref().map(|_| Tone::linear()),
        ..Effects::default()
    }
}

const WAYS: [Variant; 3] = [
    Variant {
        name: "shadow, soft edges",
        keep: |effects| Effects {
            shadow: effects.shadow.clone(),
            ..bare(effects)
        },
        grids: SAMPLES,
    },
    Variant {
        name: "shadow, hard edges",
        keep: |effects| Effects {
            shadow: effects
                .shadow
                .clone()
                .map(|shadow| crate::imaging::effects::shadow::Shadow { beam_mm: 0.0, ..shadow }),
            ..bare(effects)
        },
        grids: SAMPLES,
    },
    Variant {
        name: "blur",
        keep: |effects| Effects {
            blur: effects.blur.clone(),
            ..bare(effects)
        },
        grids: LINES,
    },
];

pub fn sampling(options: &ImageOptions, _: &mut Vec<String>) -> Result<Vec<Table>, ImageError> {
    let subject = Subject::new(options.voxel_mm)?;
    let factors = [factor("effect", "effect"), factor("grid", "grid")];
    let title =
        "Sampling of shadow (samples) and blur (scanlines), each by itself, against the finest in double precision";
    let goal = Goal::new("median_ms", "rms_grey", GREY_LEVELS).choosing("sampling of one effect");
    let mut table = Table::new("image_sampling", title, &factors, &PICTURE)
        .against("the finest grid of each, in double precision")
        .seeking(goal.each(&["effect"]).beside(&["p95_ms", "p99_grey", "memory_mb"]));
    for way in WAYS {
        let settings = |grid| -> Settings {
            let own = subject.grid(grid);
            Settings {
                effects: (way.keep)(&own.effects),
                ..own
            }
        };
        let [grids @ .., finest] = way.grids.map(|grid| coarsened(options, grid));
        let mut gold = subject.on(settings(finest), Backend::CpuF64)?;
        let standard = gold.render(&subject.state)?.pixels.clone();
        let inside = inside(&gold);
        let mut coarser: Option<Apart> = None;
        for grid in grids {
            let mut synth = subject.on(settings(grid), Backend::Cpu)?;
            let found = picture(&mut synth, &subject.state, options.patience / 2)?;
            let apart = Apart::of(&standard, &found.pixels, &inside);
            let name = format!("{} x {}", grid[0], grid[1]);
            table.push(
                vec![way.name.to_owned(), name],
                values(&found, Some(&apart)),
                apart.flag(coarser.as_ref()),
            );
            coarser = Some(apart);
        }
    }
    Ok(vec![table])
}
