//! Number types of image files.

/// Type of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Element {
    /// Unsigned integer of 8 bits.
    U8,
    /// Signed integer of 8 bits.
    I8,
    /// Unsigned integer of 16 bits.
    U16,
    /// Signed integer of 16 bits.
    I16,
    /// Unsigned integer of 32 bits.
    U32,
    /// Signed integer of 32 bits.
    I32,
    /// Unsigned integer of 64 bits.
    U64,
    /// Signed integer of 64 bits.
    I64,
    /// Floating-point number of 32 bits.
    F32,
    /// Floating-point number of 64 bits.
    F64,
}

impl Element {
    /// Bytes of one number.
    pub fn bytes(self) -> usize {
        with_sample!(self, T => T::BYTES)
    }

    /// Name for messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::U8 => "uint8",
            Self::I8 => "int8",
            Self::U16 => "uint16",
            Self::I16 => "int16",
            Self::U32 => "uint32",
            Self::I32 => "int32",
            Self::U64 => "uint64",
            Self::I64 => "int64",
            Self::F32 => "float32",
            Self::F64 => "float64",
        }
    }

    /// Smallest integer type that holds every value from `low` to `high`.
    pub fn smallest(low: i64, high: i64) -> Self {
        let holds = |min: i64, max: i64| low >= min && high <= max;
        if holds(0, u8::MAX.into()) {
            Self::U8
        } else if holds(i8::MIN.into(), i8::MAX.into()) {
            Self::I8
        } else if holds(i16::MIN.into(), i16::MAX.into()) {
            Self::I16
        } else if holds(0, u16::MAX.into()) {
            Self::U16
        } else if holds(i32::MIN.into(), i32::MAX.into()) {
            Self::I32
        } else if holds(0, u32::MAX.into()) {
            Self::U32
        } else {
            Self::I64
        }
    }

    /// Appends the number spelled by `text`, little-endian; `None` if it is not a number of this type.
    pub(crate) fn push_text(self, text: &str, out: &mut Vec<u8>) -> Option<()> {
        with_sample!(self, T => out.extend_from_slice(&text.parse::<T>().ok()?.to_le_bytes()));
        Some(())
    }
}

/// Byte order of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ByteOrder {
    /// Least significant byte first.
    Little,
    /// Most significant byte first.
    Big,
}

/// Linear scale of stored numbers: `slope * number + intercept`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    /// Name of the factor in the header.
    pub key: &'static str,
    /// Factor on the stored number.
    pub slope: f64,
    /// Value of a stored 0.
    pub intercept: f64,
}

impl Scale {
    /// Creates the scale; `None` for the identity.
    pub fn new(key: &'static str, slope: f64, intercept: f64) -> Option<Self> {
        (slope != 1.0 || intercept != 0.0).then_some(Self { key, slope, intercept })
    }

    /// Value that a stored number stands for.
    pub fn apply(self, stored: f64) -> f64 {
        self.slope * stored + self.intercept
    }
}

/// A number of a type known at compile time.
pub trait Sample: Copy {
    /// Bytes of one number.
    const BYTES: usize;
    /// Decodes the number in `bytes`, which must have length [`Self::BYTES`].
    fn decode(bytes: &[u8], order: ByteOrder) -> Self;
    /// Converts to the nearest double.
    fn as_f64(self) -> f64;
    /// An integer as a label value; `None` for other types, and if it needs more than 63 bits.
    fn as_label(self) -> Option<i64>;
}

macro_rules! sample {
    ($type:ty, $as_label:expr) => {
        impl Sample for $type {
            const BYTES: usize = size_of::<$type>();

            fn decode(bytes: &[u8], order: ByteOrder) -> Self {
                let mut array = [0; size_of::<$type>()];
                array.copy_from_slice(bytes);
                match order {
                    ByteOrder::Little => <$type>::from_le_bytes(array),
                    ByteOrder::Big => <$type>::from_be_bytes(array),
                }
            }

            fn as_f64(self) -> f64 {
                self as f64
            }

            fn as_label(self) -> Option<i64> {
                $as_label(self)
            }
        }
    };
}

sample!(u8, |n| Some(i64::from(n)));
sample!(i8, |n| Some(i64::from(n)));
sample!(u16, |n| Some(i64::from(n)));
sample!(i16, |n| Some(i64::from(n)));
sample!(u32, |n| Some(i64::from(n)));
sample!(i32, |n| Some(i64::from(n)));
sample!(u64, |n| i64::try_from(n).ok());
sample!(i64, Some);
sample!(f32, |_| None);
sample!(f64, |_| None);

/// Runs `$body` with `$type` bound to the Rust type of an [`Element`].
macro_rules! with_sample {
    ($element:expr, $type:ident => $body:expr) => {{
        use $crate::volume::element::Element;
        macro_rules! run {
            ($concrete:ty) => {{
                type $type = $concrete;
                $body
            }};
        }
        match $element {
            Element::U8 => run!(u8),
            Element::I8 => run!(i8),
            Element::U16 => run!(u16),
            Element::I16 => run!(i16),
            Element::U32 => run!(u32),
            Element::I32 => run!(i32),
            Element::U64 => run!(u64),
            Element::I64 => run!(i64),
            Element::F32 => run!(f32),
            Element::F64 => run!(f64),
        }
    }};
}
pub(crate) use with_sample;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn smallest_type_holds_both_ends() {
        assert_eq!(Element::smallest(0, 255), Element::U8);
        assert_eq!(Element::smallest(-1, 127), Element::I8);
        assert_eq!(Element::smallest(-1, 128), Element::I16);
        assert_eq!(Element::smallest(0, 32768), Element::U16);
        assert_eq!(Element::smallest(-1, 32768), Element::I32);
        assert_eq!(Element::smallest(0, 1 << 31), Element::U32);
        assert_eq!(Element::smallest(-1, 1 << 31), Element::I64);
    }

    #[test]
    fn integers_that_fit_are_labels() {
        assert_eq!((-3i8).as_label(), Some(-3));
        assert_eq!(7.0f32.as_label(), None);
        assert_eq!(u64::MAX.as_label(), None);
        assert_eq!(u16::decode(&[1, 2], ByteOrder::Big), 258);
        assert_eq!(u16::decode(&[1, 2], ByteOrder::Little), 513);
    }
}
