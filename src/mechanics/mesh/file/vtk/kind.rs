//! Number types of VTK files.

/// Number type.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Kind {
    F32,
    F64,
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
}

impl Kind {
    /// Returns the size of a value, bytes.
    pub fn size(self) -> usize {
        match self {
            Kind::I8 | Kind::U8 => 1,
            Kind::I16 | Kind::U16 => 2,
            Kind::F32 | Kind::I32 | Kind::U32 => 4,
            Kind::F64 | Kind::I64 | Kind::U64 => 8,
        }
    }

    /// Returns the value whose bytes are the low ones of `word`.
    pub fn value(self, word: u64) -> f64 {
        match self {
            Kind::F32 => f64::from(f32::from_bits(word as u32)),
            Kind::F64 => f64::from_bits(word),
            Kind::I8 => f64::from(word as i8),
            Kind::I16 => f64::from(word as i16),
            Kind::I32 => f64::from(word as i32),
            Kind::I64 => word as i64 as f64,
            Kind::U8 | Kind::U16 | Kind::U32 | Kind::U64 => word as f64,
        }
    }
}

/// Reads an unsigned word of up to eight bytes.
pub(super) fn word(bytes: &[u8], big_endian: bool) -> u64 {
    let shift = |word: u64, byte: &u8| word << 8 | u64::from(*byte);
    if big_endian {
        bytes.iter().fold(0, shift)
    } else {
        bytes.iter().rev().fold(0, shift)
    }
}
