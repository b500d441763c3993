//! Cost and visible difference of each effect: frames without it, or with a simpler form, against the full frame.

use super::compare::{Apart, inside, picture, values};
use super::scene::{Subject, coarsened};
use super::{ImageError, ImageOptions, PICTURE, Table, factor};
use crate::imaging::effects::Effects;
use crate::imaging::effects::slice::{Beyond, Boundary};
use crate::imaging::synth::Backend;
use crate::study::tradeoff::{GREY_LEVELS, Goal};

/// Simplification of a frame: its name and the change of effects.
type Simpler = (&'static str, fn(&mut Effects));

const SIMPLER: [Simpler; 18] = [
    ("every usual effect", |_| {}),
    ("without contact", |effects| effects.contact = None),
    ("body ends at the volume", |effects| effects.slice.beyond = Beyond::Void),
    ("labels voted", |effects| effects.slice.boundary = Boundary::Vote),
    ("labels of the nearest voxel", |effects| {
        effects.slice.boundary = Boundary::Nearest
    }),
    ("without texture", |effects| effects.texture = None),
    ("without interfaces", |effects| effects.interface = None),
    ("interfaces without roughness", |effects| {
        if let Some(interface) = &mut effects.interface {
            interface.roughness = 0.0;
        }
    }),
    ("without speckle", |effects| effects.speckle = None),
    ("without shadow", |effects| effects.shadow = None),
    ("shadows straight down", |effects| {
        if let Some(shadow) = &mut effects.shadow {
            shadow.f_number = 0.0;
        }
    }),
    ("without reverberation", |effects| {
        if let Some(shadow) = &mut effects.shadow {
            shadow.reverberation = 0.0;
        }
    }),
    ("without mirror images", |effects| {
        if let Some(shadow) = &mut effects.shadow {
            shadow.mirror = 0.0;
        }
    }),
    ("without refraction", |effects| effects.refraction = None),
    ("without blur", |effects| effects.blur = None),
    ("without receiver", |effects| effects.receiver = None),
    ("without automatic gain", |effects| {
        if let Some(tone) = &mut effects.tone {
            tone.auto_gain = 0.0;
        }
    }),
    ("tone alone on labels", |effects| {
        *effects = Effects {
            tone: effects.tone.clone(),
            ..Effects::default()
        };
    }),
];

pub fn effects(options: &ImageOptions, _: &mut Vec<String>) -> Result<Vec<Table>, ImageError> {
    let subject = Subject::new(options.voxel_mm)?;
    let own = subject.grid(coarsened(options, [256, 512]));
    let goal = Goal::new("median_ms", "rms_grey", GREY_LEVELS).choosing("effects");
    let mut table = Table::new(
        "image_effects",
        "Effects: what a frame without one saves, and by how much it differs from the frame with all",
        &[factor("effects", "effects")],
        &PICTURE,
    )
    .against("every usual effect in double precision")
    .seeking(goal.beside(&["p95_ms", "p99_grey", "memory_mb"]));
    let mut gold = subject.on(own.clone(), Backend::CpuF64)?;
    let standard = gold.render(&subject.state)?.pixels.clone();
    let inside = inside(&gold);
    let mut synth = subject.on(own.clone(), Backend::Cpu)?;
    for (name, simplify) in SIMPLER {
        let mut settings = own.clone();
        simplify(&mut settings.effects);
        synth.set(settings)?;
        let found = picture(&mut synth, &subject.state, options.patience)?;
        let apart = Apart::of(&standard, &found.pixels, &inside);
        // Removing an effect may change the frame as a whole, so no row is flagged.
        table.push(vec![name.to_owned()], values(&found, Some(&apart)), None);
    }
    Ok(vec![table])
}
