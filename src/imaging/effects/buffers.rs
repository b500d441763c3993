//! Declaration of buffers, and the buffers that several effects share. Those of one effect alone are in its own file.

use std::cmp::Ordering;
use std::fmt;

use bytemuck::Pod;

use super::EffectTables;
use super::pass::Band;
use crate::synth::FrameState;
use crate::synth::tables::{Anatomy, LabelRow, Tables};

/// Contents of a buffer.
#[derive(Clone, Copy)]
pub enum Contents {
    /// Bytes of a buffer that effects share, from the tables; for a buffer of pixels, those of a band of rows.
    /// [`Tables::set`] names the shared buffers that change with the settings.
    Shared(fn(&Tables, Band) -> Vec<u8>),
    /// Bytes of a buffer of one effect, from the tables that it derives, and so from no settings but those of its key.
    Derived(fn(&Anatomy, &EffectTables) -> Vec<u8>),
}

impl Contents {
    /// Computes the bytes; of a per-pixel buffer, those of a band of rows.
    pub fn bytes(self, tables: &Tables, band: Band) -> Vec<u8> {
        match self {
            Self::Shared(bytes) => bytes(tables, band),
            Self::Derived(bytes) => bytes(&tables.anatomy, &tables.effects),
        }
    }
}

/// Computes the contents of a buffer for a frame.
type PerFrame = fn(&Tables, &FrameState, &mut Vec<f32>);

/// A buffer shared by passes. On the CPU it is a vector of [`Store`](crate::synth::store::Store) or a table; on the GPU
/// a storage buffer.
pub struct Buffer {
    /// Name, unique over all effects: by it buffers are told apart.
    pub name: &'static str,
    /// Order in the lists of plans; those of the same number are listed by name. A number, as buffers that effects
    /// share and those of one effect alternate there, in another order than that of their first use.
    order: u32,
    /// Size of an element on the GPU, bytes.
    pub element: usize,
    /// Number of elements on the GPU.
    pub len: fn(&Tables) -> usize,
    /// Contents before the first frame, and after a change of what they depend on; `None` if passes write them.
    pub contents: Option<Contents>,
    /// Contents before every frame, if they follow its state.
    pub per_frame: Option<PerFrame>,
    /// Whether its size is proportional to the pixels of the image, so that a large one is processed in bands of rows.
    pub is_per_pixel: bool,
    /// Whether the frames of a submission are packed: stored consecutively, each with only the size that it needs.
    pub is_packed: bool,
}

impl Buffer {
    /// A buffer that passes write.
    pub const fn new(order: u32, name: &'static str, element: usize, len: fn(&Tables) -> usize) -> Self {
        Self {
            name,
            order,
            element,
            len,
            contents: None,
            per_frame: None,
            is_per_pixel: false,
            is_packed: false,
        }
    }

    /// The buffer, filled from the tables.
    const fn shared(self, bytes: fn(&Tables, Band) -> Vec<u8>) -> Self {
        let contents = Some(Contents::Shared(bytes));
        Self { contents, ..self }
    }

    /// The buffer of an effect, filled from what the effect derives.
    pub(crate) const fn derived(self, bytes: fn(&Anatomy, &EffectTables) -> Vec<u8>) -> Self {
        let contents = Some(Contents::Derived(bytes));
        Self { contents, ..self }
    }

    /// The buffer, filled before every frame.
    pub(crate) const fn per_frame(self, numbers: PerFrame) -> Self {
        let per_frame = Some(numbers);
        Self { per_frame, ..self }
    }

    const fn per_pixel(self) -> Self {
        let is_per_pixel = true;
        Self { is_per_pixel, ..self }
    }

    const fn packed(self) -> Self {
        let is_packed = true;
        Self { is_packed, ..self }
    }

    /// Size on the GPU, bytes.
    pub fn bytes(&self, tables: &Tables) -> u64 {
        (self.element * (self.len)(tables)) as u64
    }
}

impl PartialEq for Buffer {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

impl Eq for Buffer {}

impl PartialOrd for Buffer {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Buffer {
    fn cmp(&self, other: &Self) -> Ordering {
        (self.order, self.name).cmp(&(other.order, other.name))
    }
}

impl fmt::Debug for Buffer {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(self.name)
    }
}

impl serde::Serialize for Buffer {
    /// The name in snake case.
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut name = String::new();
        for letter in self.name.chars() {
            if letter.is_uppercase() && !name.is_empty() {
                name.push('_');
            }
            name.push(letter.to_ascii_lowercase());
        }
        serializer.serialize_str(&name)
    }
}

/// Bytes of plain values.
pub fn bytes_of<P: Pod>(values: &[P]) -> Vec<u8> {
    bytemuck::cast_slice(values).to_vec()
}

/// Number of samples of a frame.
pub fn beam(tables: &Tables) -> usize {
    tables.lines() * tables.samples()
}

fn pixels(tables: &Tables) -> usize {
    tables.width() * tables.height()
}

/// Fixed-point units of [`LOSS`] per decibel.
pub const UNITS_PER_DB: f64 = 1_048_576.0;

/// Per scanline: origin and direction in the probe plane (`vec4<f32>`).
pub static RAYS: Buffer = Buffer::new(0, "Rays", 16, Tables::lines).shared(|tables, _| {
    let rays: Vec<f32> = tables.rays.iter().flatten().map(|&x| x as f32).collect();
    bytes_of(&rays)
});

/// Per sample: current, then reference position, relative to the local origin, and a flag (`vec4<f32>`).
pub static POSITION: Buffer = Buffer::new(20, "Position", 16, beam);

/// Per sample: slot of the element that contains it among those in the slab (`u32`).
pub static ELEMENT: Buffer = Buffer::new(30, "Element", 4, beam);

/// Affine maps of the elements in the slab: of the reference state four each, of the deformed state four and three
/// (`vec4<f32>`).
pub(crate) static ELEMENT_MAPS: Buffer = Buffer::new(40, "ElementMaps", 16, |tables| {
    11 * tables.mesh.as_ref().map_or(0, |mesh| mesh.elements().len())
})
.packed();

/// Per sample, during the warp on a GPU: complement of the lowest slot that contains it, and flags
/// (`vec2<u32>`); cleared before every frame.
pub(crate) static HITS: Buffer = Buffer::new(50, "Hits", 8, beam);

/// Label indices of the volume, four to a `u32`.
pub(crate) static VOXELS: Buffer = Buffer::new(80, "Voxels", 4, |tables| tables.volume.voxels().len().div_ceil(4))
    .shared(|tables, _| {
        let mut bytes = tables.volume.voxels().to_vec();
        bytes.resize(bytes.len().next_multiple_of(4), 0);
        bytes
    });

/// Per label index: its imaging properties ([`LabelRow`]).
pub(crate) static LABEL_ROWS: Buffer =
    Buffer::new(90, "LabelRows", size_of::<LabelRow>(), |tables| tables.label_rows.len())
        .shared(|tables, _| bytes_of(&tables.label_rows));

/// Per sample: label index (`u32`).
pub(crate) static LABEL: Buffer = Buffer::new(120, "Label", 4, beam);

/// Per sample: echo amplitude; after tone, grey level (`f32`).
pub static AMPLITUDE: Buffer = Buffer::new(130, "Amplitude", 4, beam);

/// Second buffer of the pair that [`AMPLITUDE`] is swapped with (`f32`).
pub(crate) static AMPLITUDE_NEXT: Buffer = Buffer::new(140, "AmplitudeNext", 4, beam);

/// Per sample: complex echo of surfaces and needles, before the point spread (`vec2<f32>`).
pub(crate) static SPECULAR: Buffer = Buffer::new(150, "Specular", 8, beam);

/// Per sample: fractions of the scan plane's thickness and of the beam filled by needle and seeds (`vec2<f32>`).
pub(crate) static NEEDLE_MASK: Buffer = Buffer::new(230, "NeedleMask", 8, beam);

/// Per sample: two-way loss down to it, in units of [`UNITS_PER_DB`] (`u32`).
pub static LOSS: Buffer = Buffer::new(240, "Loss", 4, beam);

/// Per pixel: scanline and sample coordinates, or -1 (`vec2<f32>`).
pub static SCAN_MAP: Buffer = Buffer::new(310, "ScanMap", 8, pixels)
    .per_pixel()
    .shared(|tables, band| {
        let first = band.first_row as usize * tables.width();
        bytes_of(&tables.scan_map[first..][..band.rows as usize * tables.width()])
    });

/// Per pixel: grey level (`f32`).
pub static IMAGE: Buffer = Buffer::new(320, "Image", 4, pixels).per_pixel();

/// Per pixel: grey level, four to a `u32`.
pub static PIXELS: Buffer =
    Buffer::new(330, "Pixels", 4, |tables| tables.words_per_row() * tables.height()).per_pixel();

/// Buffer that is bound in place of one, given whether passes have swapped the amplitudes an odd number of times.
pub fn bound(buffer: &'static Buffer, flipped: bool) -> &'static Buffer {
    match flipped {
        true if *buffer == AMPLITUDE => &AMPLITUDE_NEXT,
        true if *buffer == AMPLITUDE_NEXT => &AMPLITUDE,
        _ => buffer,
    }
}

/// Declares the vectors of an effect on the CPU: each with its element, the buffer without which it is empty, its
/// length and its first value.
macro_rules! columns {
    ($(#[$doc:meta])* pub struct $name:ident $(<$t:ident>)? {
        $($(#[$field_doc:meta])* $field:ident: [$type:ty; $len:expr] = $fill:expr, $buffer:ident;)+
    }) => {
        $(#[$doc])*
        #[derive(Debug, Default)]
        pub struct $name $(<$t>)? {
            $($(#[$field_doc])* pub $field: Vec<$type>,)+
        }

        impl $(<$t: insonify_base::real::Real>)? $name $(<$t>)? {
            /// Allocates what a plan uses and frees the rest.
            pub fn fit(&mut self, plan: &crate::plan::Plan, tables: &crate::synth::tables::Tables) {
                $(
                    let len: fn(&crate::synth::tables::Tables) -> usize = $len;
                    let len = if plan.uses(&$buffer) { len(tables) } else { 0 };
                    crate::synth::store::resize(&mut self.$field, len, $fill);
                )+
            }

            /// Memory in use, bytes.
            pub fn bytes(&self) -> usize {
                0 $(+ self.$field.capacity() * size_of::<$type>())+
            }
        }
    };
}
pub(crate) use columns;
