//! Truth: layers for training models, with label, depth and other properties of each sample.
//!
//! Frames have the layers that are asked for (`insonify render --layers`). They are made from the samples of the
//! central plane, and read at the nearest one to each pixel. The GPU's differ by at most one unit from those in double
//! precision where both have the same label.

#[cfg(test)]
mod parity;

use glam::Vec4;
use nalgebra::Point3;

use super::buffers::{Buffer, LABEL, LOSS, NEEDLE_MASK, POSITION, RAYS, UNITS_PER_DB, beam, bytes_of, columns};
use super::common::rows;
use super::pass::{Band, Grid, ParamBlock, Pass, Reference, Use, Use::*, View, block, bound, reference};
use super::{
    Effect, Stage,
    Wanted::{self, No, Yes},
    needle, shadow,
};
use crate::synth::layers::{Layer, world_position};
use crate::synth::store::Store;
use crate::synth::tables::Tables;
use insonify_anatomy::volume::LabelVolume;
use insonify_base::parallel::{chunks_mut, for_each};
use insonify_base::real::Real;

/// Registry entry.
pub(crate) const EFFECT: Effect = Effect {
    name: "truth",
    stage: Stage::Display,
    wanted,
    passes: |tables| {
        tables
            .settings
            .layers
            .iter()
            .filter_map(|&layer| pass_of(layer, tables))
            .collect()
    },
    buffers: &[&LAYERS, &LABEL_VALUES, &ORGAN_VALUES],
    remove: Some(|_, settings| settings.layers.clear()),
    needed_by: |_, _| Some("the layers"),
    ..Effect::PLAIN
};

fn wanted(tables: &Tables) -> Wanted {
    let layers = &tables.settings.layers;
    let names: Vec<&str> = layers.iter().map(|layer| layer.name()).collect();
    match names.is_empty() {
        true => No("no ground truth is asked for".into()),
        false if layers.iter().all(|&layer| pass_of(layer, tables).is_none()) => {
            No(format!("{}: one value in the sector of this scene", names.join(", ")))
        }
        false => Yes(format!("ground truth is asked for: {}", names.join(", "))),
    }
}

/// Pass of a layer; `None` for one that needs none, as all its values are constant.
fn pass_of(layer: Layer, tables: &Tables) -> Option<&'static Pass> {
    let called_for = |effect: &Effect| matches!((effect.wanted)(tables), Yes(_));
    match layer {
        Layer::LabelValue => Some(&VALUE),
        Layer::LabelIndex => Some(&INDEX),
        Layer::Sector => None,
        Layer::Beyond => Some(&BEYOND),
        Layer::Displacement => Some(&DISPLACEMENT),
        Layer::Depth => Some(&DEPTH),
        Layer::Needle => called_for(&needle::EFFECT).then_some(&NEEDLE),
        Layer::Loss => called_for(&shadow::EFFECT).then_some(&LOSS_DOWN),
        Layer::Organ => Some(&ORGAN),
    }
}

/// Per layer and sample: its value (`u32`); an even number of them.
pub static LAYERS: Buffer = Buffer::new(340, "Layers", 4, |tables| {
    (beam(tables) * tables.settings.layers.len()).next_multiple_of(2)
});

/// Per label index: its value in the label file, at most 65,535 (`u32`).
static LABEL_VALUES: Buffer = Buffer::new(350, "LabelValues", 4, |tables| tables.volume.labels().len())
    .derived(|anatomy, _| values_of(&anatomy.volume, |volume, index| volume.labels()[index].value));

/// Per label index: the value in the label file of what it was drawn into, or its own, at most 65,535 (`u32`).
static ORGAN_VALUES: Buffer = Buffer::new(360, "OrganValues", 4, |tables| tables.volume.labels().len())
    .derived(|anatomy, _| values_of(&anatomy.volume, LabelVolume::organ));

fn values_of(volume: &LabelVolume, value_of: fn(&LabelVolume, usize) -> i64) -> Vec<u8> {
    let indices = 0..volume.labels().len();
    let values: Vec<u32> = indices.map(|index| word(value_of(volume, index)).into()).collect();
    bytes_of(&values)
}

fn word(value: i64) -> u16 {
    u16::try_from(value).unwrap_or(u16::MAX)
}

columns! {
    /// Vectors of the ground truth.
    pub struct Columns {
        /// Data of [`LAYERS`].
        layers: [u16; |tables| beam(tables) * tables.settings.layers.len()] = 0, LAYERS;
    }
}

const VALUE: Pass = pass(
    "truth_label_value",
    "label_value",
    const { &[(&LAYERS, WriteOwn), (&LABEL, ReadOwn), (&LABEL_VALUES, Read)] },
    reference!(label_values),
);

const ORGAN: Pass = pass(
    "truth_organ",
    "organ",
    const { &[(&LAYERS, WriteOwn), (&LABEL, ReadOwn), (&ORGAN_VALUES, Read)] },
    reference!(organs),
);

const INDEX: Pass = pass(
    "truth_label_index",
    "label_index",
    const { &[(&LAYERS, WriteOwn), (&LABEL, ReadOwn)] },
    reference!(label_indices),
);

const BEYOND: Pass = pass(
    "truth_beyond",
    "beyond",
    const { &[(&LAYERS, WriteOwn), (&LABEL, ReadOwn), (&POSITION, ReadOwn)] },
    reference!(beyond),
);

const DISPLACEMENT: Pass = pass(
    "truth_displacement",
    "displacement",
    const { &[(&LAYERS, WriteOwn), (&RAYS, Read), (&POSITION, ReadOwn)] },
    reference!(displacements),
);

const DEPTH: Pass = Pass {
    grid: Grid::Scanlines,
    ..pass(
        "truth_depth",
        "depth",
        const { &[(&LAYERS, WriteLine), (&LABEL, ReadLine)] },
        reference!(depths),
    )
};

const NEEDLE: Pass = pass(
    "truth_needle",
    "needle",
    const { &[(&LAYERS, WriteOwn), (&NEEDLE_MASK, ReadOwn)] },
    reference!(needle_shares),
);

const LOSS_DOWN: Pass = pass(
    "truth_loss",
    "loss",
    const { &[(&LAYERS, WriteOwn), (&LOSS, ReadOwn)] },
    reference!(losses),
);

const fn pass(
    name: &'static str,
    entry: &'static str,
    bindings: &'static [(&'static Buffer, Use)],
    cpu: Reference,
) -> Pass {
    Pass {
        name,
        shader: include_str!("../../../shaders/truth.wgsl"),
        entry,
        bindings,
        params,
        grid: Grid::Samples,
        flips: false,
        cpu,
        bound: bound!(Covered("as layers are compared with those of the reference")),
    }
}

block! {
    /// Parameter block of `truth.wgsl`.
    struct TruthParams {
        /// First three rows of the probe-to-world transform.
        probe_to_world: [Vec4; 3],
        /// First three rows of the transform from the world to voxels.
        world_to_index: [Vec4; 3],
        /// Place of each layer among those asked for.
        places: [u32; 12],
        /// Voxels along each axis.
        size: [u32; 3],
        /// Distance between samples, mm.
        sample_mm: f32,
        /// Scanlines.
        lines: u32,
        /// Samples along a scanline.
        samples: u32,
        /// Padding to a multiple of 16 bytes.
        unused: [u32; 2],
    }
}

fn place(layer: Layer, tables: &Tables) -> usize {
    let layers = &tables.settings.layers;
    layers.iter().position(|&other| other == layer).unwrap_or(0)
}

fn params(view: &View, _: Band) -> ParamBlock {
    let tables = view.tables;
    ParamBlock::of(&TruthParams {
        probe_to_world: rows::<f32>(&view.state.probe_to_world).map(Vec4::from),
        world_to_index: rows::<f32>(tables.volume.world_to_index()).map(Vec4::from),
        places: std::array::from_fn(|index| Layer::ALL.get(index).map_or(0, |layer| place(*layer, tables) as u32)),
        size: tables.volume.size().map(|n| n as u32),
        sample_mm: tables.sample_mm() as f32,
        lines: tables.lines() as u32,
        samples: tables.samples() as u32,
        unused: [0; 2],
    })
}

/// Fills a layer, scanline by scanline, from the rest of the store.
fn fill<T: Real>(layer: Layer, view: &View, store: &mut Store<T>, line: impl Fn(&Store<T>, usize, &mut [u16]) + Sync) {
    let (lines, samples) = (view.tables.lines(), view.tables.samples());
    let mut layers = std::mem::take(&mut store.effects.truth.layers);
    let values = &mut layers[place(layer, view.tables) * lines * samples..][..lines * samples];
    for_each((0.., chunks_mut(values, samples)), &|(row, values)| {
        line(store, row, values)
    });
    store.effects.truth.layers = layers;
}

/// Fills a layer from the place of each sample.
fn fill_each<T: Real>(
    layer: Layer,
    view: &View,
    store: &mut Store<T>,
    value_of: impl Fn(&Store<T>, usize) -> u16 + Sync,
) {
    fill(layer, view, store, |store, line, values| {
        let first = line * values.len();
        (first..)
            .zip(values)
            .for_each(|(index, value)| *value = value_of(store, index));
    });
}

fn fixed(value: f64) -> u16 {
    value.round().clamp(0.0, f64::from(u16::MAX)) as u16
}

fn label_values<T: Real>(view: &View, store: &mut Store<T>) {
    let labels = view.tables.volume.labels();
    fill_each(Layer::LabelValue, view, store, |store, index| {
        word(labels[usize::from(store.label[index])].value)
    });
}

fn organs<T: Real>(view: &View, store: &mut Store<T>) {
    let volume = &view.tables.volume;
    fill_each(Layer::Organ, view, store, |store, index| {
        word(volume.organ(store.label[index].into()))
    });
}

fn label_indices<T: Real>(view: &View, store: &mut Store<T>) {
    fill_each(Layer::LabelIndex, view, store, |store, index| {
        u16::from(store.label[index])
    });
}

fn point<T: Real>(store: &Store<T>, index: usize) -> Point3<f64> {
    let [x, y, z, _] = store.position[index].map(Real::wide);
    Point3::new(x, y, z)
}

fn beyond<T: Real>(view: &View, store: &mut Store<T>) {
    let volume = &view.tables.volume;
    fill_each(Layer::Beyond, view, store, |store, index| {
        u16::from(store.label[index] > 0 && volume.label_index_at(&point(store, index)).is_none())
    });
}

fn displacements<T: Real>(view: &View, store: &mut Store<T>) {
    let samples = view.tables.samples();
    fill_each(Layer::Displacement, view, store, |store, index| {
        let world = world_position(
            view.tables,
            &view.state.probe_to_world,
            index / samples,
            index % samples,
        );
        fixed(100.0 * (world - point(store, index)).norm())
    });
}

fn depths<T: Real>(view: &View, store: &mut Store<T>) {
    let sample_mm = view.tables.sample_mm();
    fill(Layer::Depth, view, store, |store, line, values| {
        let (mut passed, first) = (0.0, line * values.len());
        for (value, &label) in values.iter_mut().zip(&store.label[first..]) {
            passed += f64::from(u8::from(label != 0));
            *value = fixed(10.0 * passed * sample_mm);
        }
    });
}

fn needle_shares<T: Real>(view: &View, store: &mut Store<T>) {
    fill_each(Layer::Needle, view, store, |store, index| {
        fixed(255.0 * store.needle_mask[index][0].wide())
    });
}

fn losses<T: Real>(view: &View, store: &mut Store<T>) {
    fill_each(Layer::Loss, view, store, |store, index| {
        fixed(100.0 * f64::from(store.loss[index]) / UNITS_PER_DB)
    });
}

/// Makes the images of all layers asked for, from their values, sample by sample.
pub fn images<V: Copy>(tables: &Tables, values: &[V], as_u16: impl Fn(V) -> u16 + Sync, images: &mut Vec<Vec<u16>>) {
    let (count, samples) = (beam(tables), tables.samples());
    images.resize_with(tables.settings.layers.len(), Vec::new);
    for (number, (image, &layer)) in images.iter_mut().zip(&tables.settings.layers).enumerate() {
        // A layer without a pass has one value.
        let of_layer = pass_of(layer, tables).and_then(|_| values.get(number * count..));
        let inside = u16::from(layer == Layer::Sector);
        let pixel = |beam_position: &[f32; 2]| match of_layer {
            _ if beam_position[0] < 0.0 => 0,
            Some(values) => {
                as_u16(values[(beam_position[0] + 0.5) as usize * samples + (beam_position[1] + 0.5) as usize])
            }
            None => inside,
        };
        image.clear();
        image.extend(tables.scan_map.iter().map(pixel));
    }
}
