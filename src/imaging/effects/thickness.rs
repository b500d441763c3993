//! Thickness: the tissues that the beam meets beside the scan plane, as far as it is wide across the plane.
//!
//! Labels of the nearest voxels are read on parallel sub-planes, nearer where the beam is narrow. Scatterers of
//! different sub-planes are incoherent: power is averaged, weighted by the energy of the beam around each. Where a
//! sub-plane has the label of the plane its echo is that of the plane, elsewhere that of its tissue without texture. By
//! default the width of the beam follows from the elements and the lens of the probe at every depth. Shadows and
//! speckle are those of the plane.
//!
//! ```toml
//! effects.thickness = { width_mm = 2.0 }
//! ```

#[cfg(any(test, feature = "analysis"))]
pub(crate) mod bound;
#[cfg(test)]
mod parity;
#[cfg(test)]
mod physics;

use std::f64::consts::SQRT_2;

use glam::Vec4;

use super::buffers::{AMPLITUDE, Buffer, ELEMENT, ELEMENT_MAPS, LABEL, POSITION, VOXELS, bytes_of};
use super::common::{elevation, rows};
use super::pass::{Band, Grid, ParamBlock, Pass, Use, Use::*, View, block, bound, reference};
use super::point_spread::{Attenuation, PointSpread, Profile};
use super::slice::{BLOCK, Beyond, LabelReader};
use super::{
    Effect, EffectTables, OutOfRange, Parameters, Stage,
    Wanted::{self, No, Yes},
};
use crate::synth::SynthError;
use crate::synth::store::Store;
use crate::synth::tables::{Anatomy, Settings, Tables};
use insonify_anatomy::acoustics::TissueTable;
use insonify_base::parallel::{chunks, chunks_mut, for_each};
use insonify_base::range::{check, parameters};
use insonify_base::real::{Numbers, Real};
use insonify_base::simd::{Kernel, map};
use insonify_mesh::NO_ELEMENT;
use insonify_mesh::element::Carry;
use insonify_tracking::probe::BeamGrid;

parameters! {
    /// Elevational thickness of the scan plane.
    pub struct Thickness {
        /// Full width at half maximum of the beam's elevational power profile, mm. Default: by depth, that of the lens
        /// of the probe.
        #[serde(skip_serializing_if = "Option::is_none")]
        width_mm: Option<f64>, in 0.1..=20;
        /// Number of sub-planes, odd.
        planes: u32 = 7, in 3..=9;
    }
}

impl Parameters for Thickness {
    fn check_others(&self) -> Result<(), OutOfRange> {
        let holds = self.planes % 2 == 1;
        let expected = "an odd number from 3 to 9";
        check("planes", f64::from(self.planes), holds, expected)
    }
}

/// Distance of the outermost sub-plane from the plane, in lengths of the amplitude: at most the first, where the
/// profile of a lens has its shoulder, and less for few of them, which would miss what is near.
const OUTERMOST: [f64; 2] = [1.6, 0.55];

/// Growth of the distances: nearer sub-planes, which weigh more, lie closer together.
const GROWTH: f64 = 1.45;

impl Thickness {
    /// Number of sub-planes on either side.
    fn on_side(&self) -> usize {
        self.planes as usize / 2
    }

    /// Weight of the plane, then distance (mm) and weight of the sub-planes on either side, from the nearest on. The
    /// weights of all add up to 1.
    fn weighted(&self, profile: &Profile) -> Vec<f64> {
        let count = self.on_side();
        let outermost = OUTERMOST[0].min(OUTERMOST[1] * count as f64) * profile.length_mm;
        let distance = |number: usize| outermost * (number as f64 / count as f64).powf(GROWTH);
        // Of each the energy that is nearer to it than to others.
        let up_to = |number: usize| match number {
            _ if number == count => 1.0,
            _ => profile.within(0.5 * (distance(number) + distance(number + 1))),
        };
        let beside = (1..=count).flat_map(|number| [distance(number), 0.5 * (up_to(number) - up_to(number - 1))]);
        [up_to(0)].into_iter().chain(beside).collect()
    }
}

/// Registry entry.
pub(crate) const EFFECT: Effect = Effect {
    name: "thickness",
    stage: Stage::Tissue,
    example: "effects.thickness = { width_mm = 2.0 }",
    wanted,
    passes: |tables| match tables.anatomy.mesh {
        None => vec![&FLAT],
        Some(_) => vec![&WARPED],
    },
    buffers: &[&SUB_PLANES],
    remove: Some(|_, settings| settings.effects.thickness = None),
    ..Effect::PLAIN
};

/// Sub-planes of a thickness; empty without one.
#[derive(Clone, Debug, Default)]
pub struct Derived {
    /// Rows over the sample depths: weight of the plane, then distance (mm) and weight of each sub-plane on either
    /// side.
    pub rows: Numbers,
    /// Number of sub-planes on either side.
    pub on_side: usize,
    /// Width of the beam's power profile at the array, the least, and at the lowest depth, mm.
    pub widths_mm: [f64; 3],
    /// Mean echo of each label.
    pub echoes: Numbers,
}

/// Settings on which the sub-planes depend.
pub(crate) type Key<'a> = (
    Option<&'a Thickness>,
    Option<PointSpread>,
    &'a TissueTable,
    &'a BeamGrid,
);

/// Takes parameters, tissues, grid and, if the width is not stated, the point spread.
pub(crate) fn key<'a>(tissues: &'a TissueTable, settings: &'a Settings, grid: &'a BeamGrid) -> Key<'a> {
    let thickness = settings.effects.thickness.as_ref();
    let spread = thickness.filter(|thickness| thickness.width_mm.is_none()).map(|_| {
        let speckle = settings.effects.speckle.clone().unwrap_or_default();
        PointSpread::new(&speckle, &settings.probe, Attenuation::of(tissues, settings))
    });
    (thickness, spread, tissues, grid)
}

/// Places the sub-planes.
pub(crate) fn derive(anatomy: &Anatomy, (thickness, spread, tissues, grid): &Key) -> Result<Derived, SynthError> {
    let Some(thickness) = thickness else {
        return Ok(Derived::default());
    };
    let profile = |sample: usize| match (thickness.width_mm, spread) {
        (None, Some(spread)) => spread.elevation_at(grid.sample_depth_mm(sample)),
        (width_mm, _) => Profile::gaussian(SQRT_2 * width_mm.unwrap_or_default()),
    };
    let samples = grid.samples();
    let on_side = thickness.on_side();
    let mut rows = vec![0.0; (1 + 2 * on_side) * samples];
    let mut widths_mm = Vec::with_capacity(samples);
    for sample in 0..samples {
        let profile = profile(sample);
        widths_mm.push(profile.length_mm / SQRT_2);
        for (row, number) in thickness.weighted(&profile).into_iter().enumerate() {
            rows[row * samples + sample] = number;
        }
    }
    let least = widths_mm.iter().copied().fold(f64::INFINITY, f64::min);
    let echo = |label: usize| 10f64.powf(tissues.tissue(label as u8).echogenicity_db / 20.0);
    Ok(Derived {
        rows: Numbers::new(rows),
        on_side,
        widths_mm: [widths_mm[0], least, widths_mm[samples - 1]],
        echoes: Numbers::new((0..anatomy.volume.labels().len()).map(echo).collect()),
    })
}

/// Data of [`Derived::rows`], then of [`Derived::echoes`] (`f32`).
static SUB_PLANES: Buffer = Buffer::new(125, "SubPlanes", 4, |tables| sub_planes(&tables.effects).len())
    .derived(|_, derived| bytes_of(&sub_planes(derived)));

fn sub_planes(derived: &EffectTables) -> Vec<f32> {
    let Derived { rows, echoes, .. } = &derived.thickness;
    [rows.of::<f32>(), echoes.of()].concat()
}

const FLAT: Pass = pass(
    "main",
    const {
        &[
            (&POSITION, ReadOwn),
            (&VOXELS, Read),
            (&LABEL, ReadOwn),
            (&SUB_PLANES, Read),
            (&AMPLITUDE, WriteOwn),
        ]
    },
);

/// The pass for a deforming mesh, with which the sub-planes bend.
const WARPED: Pass = pass(
    "warped",
    const {
        &[
            (&POSITION, ReadOwn),
            (&VOXELS, Read),
            (&LABEL, ReadOwn),
            (&SUB_PLANES, Read),
            (&AMPLITUDE, WriteOwn),
            (&ELEMENT, ReadOwn),
            (&ELEMENT_MAPS, Read),
        ]
    },
);

const fn pass(entry: &'static str, bindings: &'static [(&'static Buffer, Use)]) -> Pass {
    Pass {
        name: "thickness",
        shader: include_str!("../../../shaders/thickness.wgsl"),
        entry,
        bindings,
        params,
        grid: Grid::Samples,
        flips: false,
        cpu: reference!(run),
        bound: bound!(By(bound::carry)),
    }
}

fn wanted(tables: &Tables) -> Wanted {
    let Some(thickness) = &tables.settings.effects.thickness else {
        return No("the scene names no elevational thickness".into());
    };
    let [at_array, least, lowest] = tables.effects.thickness.widths_mm;
    let width = match thickness.width_mm {
        Some(width_mm) => format!("{width_mm} mm"),
        None => format!(
            "{at_array:.1} mm at the array, {least:.1} at the focus of the lens and {lowest:.1} at the lowest depth"
        ),
    };
    Yes(format!(
        "the scan plane is {width} thick: {} sub-planes",
        thickness.planes
    ))
}

block! {
    /// Parameter block of `thickness.wgsl`.
    struct ThicknessParams {
        /// First three rows of the world-to-index transform.
        world_to_index: [Vec4; 3],
        /// Out-of-plane direction in the world; the fourth component is unused.
        elevation: Vec4,
        /// Voxels along each axis.
        size: [u32; 3],
        /// Offset of the world-to-reference maps of the deformed elements, in vec4.
        carries_at: u32,
        /// 1 to continue the body beyond the volume.
        mirrored: u32,
        /// Samples along a scanline.
        samples: u32,
        /// Sub-planes on either side.
        on_side: u32,
        /// Padding to a multiple of 16 bytes.
        unused: u32,
    }
}

fn params(view: &View, _: Band) -> ParamBlock {
    let tables = view.tables;
    let slice = &tables.settings.effects.slice;
    let [x, y, z] = elevation::<f32>(view.state);
    ParamBlock::of(&ThicknessParams {
        world_to_index: rows::<f32>(tables.volume.world_to_index()).map(Vec4::from),
        elevation: Vec4::new(x, y, z, 0.0),
        size: tables.volume.size().map(|n| n as u32),
        mirrored: u32::from(slice.beyond == Beyond::Continue),
        samples: tables.samples() as u32,
        on_side: tables.effects.thickness.on_side as u32,
        carries_at: view.slab.map_or(0, |slab| slab.maps_at[2]),
        unused: 0,
    })
}

fn run<T: Real>(view: &View, store: &mut Store<T>) {
    let tables = view.tables;
    let samples = tables.samples();
    let planes = &tables.effects.thickness;
    let mut echo = [T::zero(); 256];
    echo.iter_mut()
        .zip(planes.echoes.of::<T>())
        .for_each(|(echo, of_label)| *echo = *of_label);
    let reader = LabelReader::<T>::new(tables);
    let elevation = elevation(view.state);
    let deformed = store
        .slab
        .as_ref()
        .map(|slab| (&slab.deformed.carries[..], &store.element[..]));
    for_each(
        (
            0..,
            chunks_mut(&mut store.amplitude, samples),
            chunks(&store.position, samples),
            chunks(&store.label, samples),
        ),
        &|(line, amplitudes, positions, labels)| {
            T::vectorised(Scanline {
                reader: &reader,
                echo: &echo,
                planes,
                elevation,
                deformed: deformed.map(|(carries, elements)| (carries, &elements[line * samples..][..samples])),
                positions,
                labels,
                amplitudes,
            });
        },
    );
}

/// A scanline and its neighbours on the sub-planes.
struct Scanline<'a, T> {
    reader: &'a LabelReader<'a, T>,
    echo: &'a [T; 256],
    planes: &'a Derived,
    /// Out-of-plane direction in the world.
    elevation: [T; 3],
    /// Maps of the deformed elements to the reference state, and the slot of each sample.
    deformed: Option<(&'a [Carry<T>], &'a [u32])>,
    positions: &'a [[T; 4]],
    labels: &'a [u8],
    amplitudes: &'a mut [T],
}

impl<T: Real> Kernel for Scanline<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let samples = self.labels.len();
        let rows = self.planes.rows.of::<T>();
        let to_index = self.reader.rows();
        let blocks = self.positions.chunks(BLOCK).zip(self.labels.chunks(BLOCK));
        for (block, ((positions, labels), amplitudes)) in blocks.zip(self.amplitudes.chunks_mut(BLOCK)).enumerate() {
            let start = block * BLOCK;
            let row = |row: usize| &rows[row * samples + start..][..labels.len()];
            // Places in the plane and directions away from it, in voxels.
            let mut places = [[T::zero(); BLOCK]; 3];
            for axis in 0..3 {
                let row = to_index[axis];
                for (place, position) in places[axis].iter_mut().zip(positions) {
                    *place = row[0] * position[0] + row[1] * position[1] + row[2] * position[2] + row[3] + T::of(0.5);
                }
            }
            let turned = |[x, y, z]: [T; 3]| map(*to_index, |row| row[0] * x + row[1] * y + row[2] * z);
            let straight = turned(self.elevation);
            let mut away = map(straight, |along| [along; BLOCK]);
            if let Some((carries, elements)) = self.deformed {
                let [x, y, z] = self.elevation;
                for (i, slot) in elements[start..].iter().take(labels.len()).enumerate() {
                    if *slot != NO_ELEMENT {
                        let carried = map(carries[*slot as usize], |row| row[0] * x + row[1] * y + row[2] * z);
                        (0..3).for_each(|axis| away[axis][i] = turned(carried)[axis]);
                    }
                }
            }
            let mut power = [T::zero(); BLOCK];
            for (i, weight) in row(0).iter().enumerate() {
                power[i] = *weight * amplitudes[i] * amplitudes[i];
            }
            for number in 0..2 * self.planes.on_side {
                let pair = 1 + number / 2 * 2;
                let (distances, weights) = (row(pair), row(pair + 1));
                let side = if number % 2 == 0 { T::one() } else { -T::one() };
                let mut beside = places;
                for axis in 0..3 {
                    for (i, distance) in distances.iter().enumerate() {
                        beside[axis][i] += side * *distance * away[axis][i];
                    }
                }
                let mut others = [0; BLOCK];
                self.reader.nearest_to(&beside, &mut others[..labels.len()]);
                let in_plane = labels.iter().zip(&*amplitudes);
                for ((power, weight), (other, (label, amplitude))) in
                    power.iter_mut().zip(weights).zip(others.iter().zip(in_plane))
                {
                    let echo = self.echo[usize::from(*other)];
                    let amplitude = if other == label { *amplitude } else { echo };
                    *power += *weight * amplitude * amplitude;
                }
            }
            // Background where tissue has moved away is background beside the plane, too.
            for (power, (position, amplitude)) in power.iter_mut().zip(positions.iter().zip(&*amplitudes)) {
                if position[3] == T::one() {
                    *power = *amplitude * *amplitude;
                }
            }
            for (amplitude, power) in amplitudes.iter_mut().zip(power) {
                *amplitude = power.sqrt();
            }
        }
    }
}
