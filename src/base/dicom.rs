//! Lengths in DICOM files (PS3.5 7), checked before a decoder takes memory by them.

/// An element that promises more bytes than its file has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TooLong {
    /// Offset of the element in the file.
    pub offset: usize,
    /// Length that it states, bytes.
    pub length: u32,
}

/// Length of what ends with a delimiter.
const UNDEFINED: u32 = u32::MAX;

/// Value representations whose length has two bytes (PS3.5 7.1.2).
const SHORT: [&[u8; 2]; 21] = [
    b"AE", b"AS", b"AT", b"CS", b"DA", b"DS", b"DT", b"FD", b"FL", b"IS", b"LO", b"LT", b"PN", b"SH", b"SL", b"SS",
    b"ST", b"TM", b"UI", b"UL", b"US",
];

/// Group of items and delimiters.
const ITEMS: u16 = 0xfffe;

/// Element of the group of items that ends a sequence.
const END_OF_SEQUENCE: u16 = 0xe0dd;

/// Group of pixel data.
const PIXELS: u16 = 0x7fe0;

/// Encoding of a data set.
#[derive(Clone, Copy)]
struct Syntax {
    explicit: bool,
    big_endian: bool,
}

/// Checks that no element of a file is longer than the rest of it. Data sets that are packed as a whole are not looked into.
///
/// # Errors
/// The first such element.
pub fn check_lengths(file: &[u8]) -> Result<(), TooLong> {
    let mut syntax = Syntax {
        explicit: true,
        big_endian: false,
    };
    let mut in_meta = file.get(128..132) == Some(b"DICM");
    let mut position = if in_meta { 132 } else { 0 };
    let (mut data_set, mut in_fragments) = (syntax, false);
    while let Some(head) = file.get(position..position + 8) {
        let offset = position;
        if in_meta && head[..2] != [2, 0] {
            (in_meta, syntax) = (false, data_set);
        }
        let short = |bytes: &[u8]| {
            let pair = [bytes[0], bytes[1]];
            if syntax.big_endian {
                u16::from_be_bytes(pair)
            } else {
                u16::from_le_bytes(pair)
            }
        };
        let long = |bytes: &[u8]| {
            let four = [bytes[0], bytes[1], bytes[2], bytes[3]];
            if syntax.big_endian {
                u32::from_be_bytes(four)
            } else {
                u32::from_le_bytes(four)
            }
        };
        let (group, kind) = (short(head), &head[4..6]);
        let is_item = group == ITEMS;
        let length = if is_item || !syntax.explicit {
            position += 8;
            long(&head[4..])
        } else if SHORT.iter().any(|known| *known == kind) {
            position += 8;
            u32::from(short(&head[6..]))
        } else {
            position += 12;
            let Some(length) = file.get(offset + 8..offset + 12) else {
                return Ok(());
            };
            long(length)
        };
        // Sequences and items are walked into, but for the fragments of packed pixels.
        let rest = file.get(position..).unwrap_or_default();
        let holds_items = rest.starts_with(&[0xfe, 0xff, 0, 0xe0]) || rest.starts_with(&[0xff, 0xfe, 0xe0, 0]);
        if length == UNDEFINED {
            in_fragments |= group == PIXELS;
            continue;
        }
        if is_item && !in_fragments || !is_item && holds_items {
            continue;
        }
        in_fragments &= length > 0 || short(&head[2..]) != END_OF_SEQUENCE;
        if length as usize > rest.len() {
            return Err(TooLong { offset, length });
        }
        let value = &rest[..length as usize];
        if in_meta && head[..4] == [2, 0, 0x10, 0] {
            let name = value.trim_ascii_end();
            let name = name.strip_suffix(b"\0").unwrap_or(name);
            data_set.explicit = name != b"1.2.840.10008.1.2";
            data_set.big_endian = name == b"1.2.840.10008.1.2.2";
            if name == b"1.2.840.10008.1.2.1.99" {
                return Ok(());
            }
        }
        position += length as usize;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An element with a length of two bytes, or of four.
    fn element(tag: [u8; 4], kind: &[u8; 2], stated: u32, value: &[u8]) -> Vec<u8> {
        let mut bytes = tag.to_vec();
        bytes.extend_from_slice(kind);
        if SHORT.contains(&kind) {
            bytes.extend_from_slice(&(stated as u16).to_le_bytes());
        } else {
            bytes.extend_from_slice(&[0, 0]);
            bytes.extend_from_slice(&stated.to_le_bytes());
        }
        bytes.extend_from_slice(value);
        bytes
    }

    fn item(stated: u32, value: &[u8]) -> Vec<u8> {
        [&[0xfe, 0xff, 0, 0xe0], &stated.to_le_bytes()[..], value].concat()
    }

    fn file(syntax: &[u8], data_set: &[u8]) -> Vec<u8> {
        let meta = element([2, 0, 0x10, 0], b"UI", syntax.len() as u32, syntax);
        [&[0; 128][..], b"DICM", &meta, data_set].concat()
    }

    const EXPLICIT: &[u8] = b"1.2.840.10008.1.2.1\0";
    const IMPLICIT: &[u8] = b"1.2.840.10008.1.2\0";

    #[test]
    fn an_element_may_not_be_longer_than_the_rest_of_the_file() {
        let start = file(EXPLICIT, &[]).len();
        let rows = element([0x28, 0, 0x10, 0], b"US", 2, &[4, 0]);
        let end = [0xfe, 0xff, 0xdd, 0xe0, 0, 0, 0, 0];
        let pixels = |stated: u32| [rows.clone(), element([0xe0, 0x7f, 0x10, 0], b"OB", stated, &[7; 6])].concat();
        let nested = |stated: u32| {
            let inner = element([8, 0, 0, 1], b"LO", stated, b"ab");
            let items = item(inner.len() as u32, &inner);
            element([8, 0, 0x40, 0x11], b"SQ", items.len() as u32, &items)
        };
        let packed = |stated: u32| {
            let fragments = [item(0, &[]), item(stated, &[0xff, 0xd8, 0xff, 0xff]), end.to_vec()].concat();
            [
                element([0xe0, 0x7f, 0x10, 0], b"OB", UNDEFINED, &fragments),
                rows.clone(),
            ]
            .concat()
        };
        for (sound, broken, offset) in [
            (pixels(6), pixels(0x4000_0000), 10),
            (nested(2), nested(3), 20),
            (packed(4), packed(0x7000_0000), 20),
        ] {
            assert_eq!(check_lengths(&file(EXPLICIT, &sound)), Ok(()));
            let error = check_lengths(&file(EXPLICIT, &broken)).expect_err("too long");
            assert_eq!(error.offset, start + offset);
        }
        // Group 0028, element 0010, two bytes; no kind.
        let implicit = |stated: u8| file(IMPLICIT, &[0x28, 0, 0x10, 0, stated, 0, 0, 0, 4, 0]);
        assert_eq!(check_lengths(&implicit(2)), Ok(()));
        assert_eq!(check_lengths(&implicit(3)).map_err(|error| error.length), Err(3));
        for start in [&b""[..], b"DICM", &[0; 132]] {
            assert_eq!(check_lengths(start), Ok(()));
        }
    }
}
