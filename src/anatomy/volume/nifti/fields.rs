//! Fields of a NIfTI header at their byte positions (`nifti1.h`, `nifti2.h`).

use crate::volume::element::{ByteOrder, Sample};

/// Byte positions in the header of a version.
pub(super) struct Layout {
    /// Name in messages.
    pub(super) name: &'static str,
    /// Size of the header (`sizeof_hdr`).
    pub(super) bytes: usize,
    /// Marks of a file that holds its data, and of one that does not.
    pub(super) magics: [&'static [u8]; 2],
    pub(super) magic: usize,
    pub(super) dim: usize,
    pub(super) datatype: usize,
    pub(super) pixdim: usize,
    pub(super) vox_offset: usize,
    slope: usize,
    intercept: usize,
    qform_code: usize,
    sform_code: usize,
    quatern: usize,
    srow: usize,
    xyzt_units: usize,
}

/// NIfTI-1 and NIfTI-2.
pub(super) const LAYOUTS: [Layout; 2] = [
    Layout {
        name: "NIfTI-1",
        bytes: super::HEADER_BYTES,
        magics: [b"n+1\0", b"ni1\0"],
        magic: 344,
        dim: 40,
        datatype: 70,
        pixdim: 76,
        vox_offset: 108,
        slope: 112,
        intercept: 116,
        qform_code: 252,
        sform_code: 254,
        quatern: 256,
        srow: 280,
        xyzt_units: 123,
    },
    Layout {
        name: "NIfTI-2",
        bytes: 540,
        magics: [b"n+2\0\r\n\x1a\n", b"ni2\0\r\n\x1a\n"],
        magic: 4,
        dim: 16,
        datatype: 12,
        pixdim: 104,
        vox_offset: 168,
        slope: 176,
        intercept: 184,
        qform_code: 344,
        sform_code: 348,
        quatern: 352,
        srow: 400,
        xyzt_units: 500,
    },
];

/// The fields that place an image and its numbers.
pub(super) struct Fields {
    pub(super) layout: &'static Layout,
    pub(super) dim: [i64; 8],
    pub(super) datatype: i16,
    pub(super) pixdim: [f64; 8],
    pub(super) vox_offset: f64,
    pub(super) slope: f64,
    pub(super) intercept: f64,
    pub(super) qform_code: i32,
    pub(super) sform_code: i32,
    /// `quatern_b`, `_c` and `_d`, and the offsets along x, y and z.
    pub(super) quatern: [f64; 6],
    pub(super) srow: [[f64; 4]; 3],
    pub(super) xyzt_units: u8,
}

impl Fields {
    /// Decodes a header of the full size of its layout.
    pub(super) fn read(layout: &'static Layout, order: ByteOrder, header: &[u8]) -> Self {
        let wide = layout.bytes != super::HEADER_BYTES;
        let number = |start: usize, index: usize| {
            if wide {
                decode::<f64>(header, order, start, index)
            } else {
                decode::<f32>(header, order, start, index).into()
            }
        };
        let code = |start: usize| {
            if wide {
                decode::<i32>(header, order, start, 0)
            } else {
                decode::<i16>(header, order, start, 0).into()
            }
        };
        let size = |index: usize| {
            if wide {
                decode::<i64>(header, order, layout.dim, index)
            } else {
                decode::<i16>(header, order, layout.dim, index).into()
            }
        };
        let (vox_offset, xyzt_units) = if wide {
            let offset = decode::<i64>(header, order, layout.vox_offset, 0);
            (offset as f64, decode::<i32>(header, order, layout.xyzt_units, 0) as u8)
        } else {
            (number(layout.vox_offset, 0), header[layout.xyzt_units])
        };
        Self {
            layout,
            dim: std::array::from_fn(size),
            datatype: decode(header, order, layout.datatype, 0),
            pixdim: std::array::from_fn(|index| number(layout.pixdim, index)),
            vox_offset,
            slope: number(layout.slope, 0),
            intercept: number(layout.intercept, 0),
            qform_code: code(layout.qform_code),
            sform_code: code(layout.sform_code),
            quatern: std::array::from_fn(|index| number(layout.quatern, index)),
            srow: std::array::from_fn(|row| std::array::from_fn(|column| number(layout.srow, 4 * row + column))),
            xyzt_units,
        }
    }
}

/// The number of that index in the array that starts at a byte.
fn decode<T: Sample>(header: &[u8], order: ByteOrder, start: usize, index: usize) -> T {
    T::decode(&header[start + index * T::BYTES..][..T::BYTES], order)
}
