//! Lengths in DICOM files (PS3.5 7), checked before a decoder takes memory by them.

use std::io::{self, Read, Write};

use flate2::read::DeflateDecoder;

use crate::border::{EXPANSION, Guarded, MOST};
use crate::read;

/// Refusal of pixels that a decoder must not be given.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// Offset of the element in the file.
    pub offset: usize,
    /// Statement of the file.
    pub found: String,
    /// Statement that would be right.
    pub expected: &'static str,
}

/// Largest number of sequences within each other: decoders descend into each one.
const DEEPEST: usize = 32;

/// Transfer syntax whose data set is deflated as a whole (PS3.5 A.5).
const DEFLATED: &[u8] = b"1.2.840.10008.1.2.1.99";

/// Length of what ends with a delimiter.
const UNDEFINED: u32 = u32::MAX;

/// Value representations whose length has two bytes (PS3.5 7.1.2).
const SHORT: [&[u8; 2]; 21] = [
    b"AE", b"AS", b"AT", b"CS", b"DA", b"DS", b"DT", b"FD", b"FL", b"IS", b"LO", b"LT", b"PN", b"SH", b"SL", b"SS",
    b"ST", b"TM", b"UI", b"UL", b"US",
];

/// Group of items and delimiters.
const ITEMS: u16 = 0xfffe;

/// Element of the group of items that begins one.
const ITEM: u16 = 0xe000;

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

/// Checks that no element of a file is longer than the rest of it, that sequences lie in each other only so deep, and
/// that a deflated data set stays within the limit of memory.
///
/// # Errors
/// The first fault.
pub fn check(file: &[u8]) -> Result<(), Fault> {
    let in_meta = file.get(128..132) == Some(b"DICM");
    let explicit = Syntax {
        explicit: true,
        big_endian: false,
    };
    walk(file, if in_meta { 132 } else { 0 }, in_meta, explicit)
}

/// Checks a data set that is deflated as a whole; offsets count in the inflated one.
fn check_deflated(packed: &[u8], offset: usize, syntax: Syntax) -> Result<(), Fault> {
    let most = (packed.len() as u64).saturating_mul(EXPANSION).min(MOST);
    let inflated = || Guarded(DeflateDecoder::new(packed)).take(most + 1);
    let too_large = |found: String| Fault {
        offset,
        found,
        expected: "a smaller one",
    };
    // Counted before memory is taken. What is broken in it is for the decoder to say.
    let mut count = Count(0);
    let _ = io::copy(&mut inflated(), &mut count);
    if count.0 as u64 > most {
        return Err(too_large(format!("a deflated data set of more than {most} bytes")));
    }
    let room = read::room(count.0, "a deflated data set");
    let mut data_set: Vec<u8> = room.map_err(|cause| too_large(cause.to_string()))?;
    let _ = inflated().read_to_end(&mut data_set);
    walk(&data_set, 0, false, syntax)
}

/// Counts the bytes written to it.
struct Count(usize);

impl Write for Count {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0 += bytes.len();
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

fn walk(file: &[u8], start: usize, mut in_meta: bool, mut syntax: Syntax) -> Result<(), Fault> {
    let mut position = start;
    let (mut data_set, mut is_deflated, mut in_fragments) = (syntax, false, false);
    // Ends of the sequences and items around the position; the largest number where only a delimiter tells.
    let mut ends: Vec<usize> = Vec::new();
    while let Some(head) = file.get(position..position + 8) {
        let offset = position;
        ends.truncate(ends.iter().position(|end| *end <= offset).unwrap_or(ends.len()));
        if in_meta && head[..2] != [2, 0] {
            (in_meta, syntax) = (false, data_set);
            if is_deflated {
                return check_deflated(&file[offset..], offset, syntax);
            }
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
        let (group, element, kind) = (short(head), short(&head[2..]), &head[4..6]);
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
        if is_item && element != ITEM {
            ends.pop_if(|end| *end == usize::MAX);
        } else if length == UNDEFINED {
            ends.push(usize::MAX);
        } else if is_item && !in_fragments || !is_item && holds_items {
            ends.push(position.saturating_add(length as usize));
        }
        if ends.len() > 2 * DEEPEST {
            return Err(Fault {
                offset,
                found: format!("more than {DEEPEST} sequences within each other"),
                expected: "fewer",
            });
        }
        if length == UNDEFINED {
            in_fragments |= group == PIXELS;
            continue;
        }
        // Sequences, too: decoders take what holds items for bytes where its kind is not `SQ`.
        if length as usize > rest.len() {
            return Err(Fault {
                offset,
                found: format!("an element of {length} bytes"),
                expected: "one that ends in the file",
            });
        }
        if is_item && !in_fragments || !is_item && holds_items {
            continue;
        }
        in_fragments &= length > 0 || element != END_OF_SEQUENCE;
        let value = &rest[..length as usize];
        position += length as usize;
        if in_meta && head[..4] == [2, 0, 0x10, 0] {
            let name = value.trim_ascii_end();
            let name = name.strip_suffix(b"\0").unwrap_or(name);
            data_set.explicit = name != b"1.2.840.10008.1.2";
            data_set.big_endian = name == b"1.2.840.10008.1.2.2";
            is_deflated = name == DEFLATED;
        }
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
        // What begins as a sequence does, of no known kind: decoders take it for bytes.
        let unknown = |stated: u32| element([0xe0, 0x7f, 0x10, 0], b"O\0", stated, &item(6, &[7; 6]));
        for (sound, broken, offset) in [
            (pixels(6), pixels(0x4000_0000), 10),
            (nested(2), nested(3), 20),
            (packed(4), packed(0x7000_0000), 20),
            (unknown(14), unknown(0xffff_ffbf), 0),
        ] {
            assert_eq!(check(&file(EXPLICIT, &sound)), Ok(()));
            let error = check(&file(EXPLICIT, &broken)).expect_err("too long");
            assert_eq!(error.offset, start + offset);
        }
        // Group 0028, element 0010, two bytes; no kind.
        let implicit = |stated: u8| file(IMPLICIT, &[0x28, 0, 0x10, 0, stated, 0, 0, 0, 4, 0]);
        assert_eq!(check(&implicit(2)), Ok(()));
        assert_eq!(
            check(&implicit(3)).expect_err("too long").found,
            "an element of 3 bytes"
        );
        for start in [&b""[..], b"DICM", &[0; 132]] {
            assert_eq!(check(start), Ok(()));
        }
    }

    /// Elements within `depth` sequences, each of one item, of stated length or up to a delimiter.
    fn nested(depth: usize, stated: bool) -> Vec<u8> {
        let inner = element([8, 0, 0, 1], b"LO", 2, b"ab");
        (0..depth).fold(inner, |inner, _| {
            let delimiter = |element: u8| [0xfe, 0xff, element, 0xe0, 0, 0, 0, 0];
            if stated {
                let items = item(inner.len() as u32, &inner);
                element([8, 0, 0x40, 0x11], b"SQ", items.len() as u32, &items)
            } else {
                let items = [item(UNDEFINED, &inner), delimiter(0x0d).into(), delimiter(0xdd).into()].concat();
                element([8, 0, 0x40, 0x11], b"SQ", UNDEFINED, &items)
            }
        })
    }

    #[test]
    fn sequences_lie_in_each_other_only_so_deep() {
        for stated in [true, false] {
            // Those beside each other count once.
            let sound = nested(DEEPEST, stated).repeat(3);
            assert_eq!(check(&file(EXPLICIT, &sound)), Ok(()));
            let error = check(&file(EXPLICIT, &nested(DEEPEST + 1, stated))).expect_err("too deep");
            assert_eq!(error.found, "more than 32 sequences within each other");
        }
    }

    #[test]
    fn a_deflated_data_set_is_checked_as_others() {
        let deflated = |data_set: &[u8]| {
            let mut packer = flate2::write::DeflateEncoder::new(Vec::new(), flate2::Compression::fast());
            packer.write_all(data_set).unwrap();
            file(b"1.2.840.10008.1.2.1.99", &packer.finish().unwrap())
        };
        assert_eq!(check(&deflated(&nested(1, true))), Ok(()));
        let error = check(&deflated(&element([0x28, 0, 0x10, 0], b"UT", 0x7000_0000, b"ab"))).expect_err("too long");
        assert_eq!(error.found, "an element of 1879048192 bytes");
        assert!(check(&deflated(&nested(DEEPEST + 1, true))).is_err());
    }
}
