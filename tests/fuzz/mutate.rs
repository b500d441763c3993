//! Seeded mutations of files: of bytes, of numbers in binary fields, and of the numbers, words and lines of text.

use insonify_base::random::pcg3d;

/// Longest mutated file, bytes.
const LONGEST: usize = 200_000;

/// Numbers at and beyond the ends of their types and of what formats allow.
const NUMBERS: &[&str] = &[
    "0",
    "-1",
    "1",
    "2",
    "3",
    "7",
    "-0.0",
    "0.5",
    "1e-9",
    "1e-308",
    "1e308",
    "-1e308",
    "1e400",
    "nan",
    "inf",
    "-inf",
    "100",
    "127",
    "255",
    "256",
    "32768",
    "65535",
    "65536",
    "1000000",
    "2147483647",
    "-2147483648",
    "4294967295",
    "4294967296",
    "9223372036854775807",
    "-9223372036854775808",
    "18446744073709551615",
    "99999999999999999999999",
    "1_0",
    "0x10",
    "",
];

/// Pieces of syntax and what breaks terminals and text.
const PIECES: &[&str] = &[
    "\"",
    "'",
    "[",
    "]",
    "{",
    "}",
    "[[",
    "]]",
    "=",
    ":=",
    ":",
    ",",
    ";",
    "(",
    ")",
    "<",
    ">",
    "/>",
    "&amp;",
    "&#0;",
    "#",
    "\n",
    "\r",
    "\r\n",
    "\t",
    " ",
    "\0",
    "\u{1b}[2J",
    "\u{9b}31m",
    "\u{7}",
    "\u{202e}",
    "\u{feff}",
    "é",
    "漢",
    "true",
    "\"\"\"",
    "..",
    "/",
    "\\",
    "$End",
    "-",
];

/// A generator of random numbers, the same for the same words.
pub(crate) struct Dice {
    words: [u32; 2],
    count: u32,
}

impl Dice {
    /// That of a case.
    pub(crate) fn new(seed: u64, format: &str, case: u64) -> Self {
        let name = format
            .bytes()
            .fold(0, |sum: u32, byte| sum.wrapping_mul(31).wrapping_add(byte.into()));
        let [a, b, _] = pcg3d([
            seed as u32 ^ name,
            (seed >> 32) as u32 ^ (case >> 32) as u32,
            case as u32,
        ]);
        Self {
            words: [a, b],
            count: 0,
        }
    }

    /// A number from 0 to below `end`, 0 for none.
    pub(crate) fn below(&mut self, end: usize) -> usize {
        self.count += 1;
        let [word, ..] = pcg3d([self.words[0], self.words[1], self.count]);
        ((u64::from(word) * end as u64) >> 32) as usize
    }

    fn pick<'a, T>(&mut self, from: &'a [T]) -> &'a T {
        &from[self.below(from.len())]
    }
}

/// A file made of one of a corpus by one to a few mutations; the first case of each file is the file itself.
pub(crate) fn mutated(corpus: &[Vec<u8>], binary: bool, dice: &mut Dice) -> Vec<u8> {
    let mut bytes = dice.pick(corpus).clone();
    let mut left = 1;
    while left > 0 {
        match dice.below(if binary { 2 } else { 8 }) {
            0 => bytewise(&mut bytes, corpus, dice),
            _ => textual(&mut bytes, corpus, dice),
        }
        left = usize::from(dice.below(2) == 0);
    }
    bytes.truncate(LONGEST);
    bytes
}

/// A range of at most so many bytes.
fn range(length: usize, most: usize, dice: &mut Dice) -> std::ops::Range<usize> {
    let start = dice.below(length + 1);
    start..start + dice.below(most.min(length - start) + 1)
}

fn bytewise(bytes: &mut Vec<u8>, corpus: &[Vec<u8>], dice: &mut Dice) {
    let length = bytes.len();
    let at = dice.below(length);
    match dice.below(8) {
        0 => bytes.truncate(at),
        1 => drop(bytes.drain(range(length, 64, dice))),
        2 => {
            let copied = bytes[range(length, 64, dice)].to_vec();
            bytes.splice(at..at, copied);
        }
        3 => {
            let other = dice.pick(corpus).clone();
            bytes.truncate(at);
            bytes.extend_from_slice(&other[at.min(other.len())..]);
        }
        4 if length > 0 => bytes[at] ^= 1 << dice.below(8),
        5 if length > 0 => bytes[at] = *dice.pick(&[0, 1, 0x7f, 0x80, 0xfe, 0xff, b'\n', b' ']),
        _ => {
            let width = *dice.pick(&[2usize, 4, 8]);
            let float = *dice.pick(&[f64::NAN, f64::INFINITY, 1e300, -1.0, 0.0, 1e-300]);
            let value = match dice.below(8) {
                0 => float.to_bits(),
                1 => u64::from((float as f32).to_bits()),
                _ => *dice.pick(&[
                    0,
                    1,
                    2,
                    0x7f,
                    0x7fff,
                    0x8000,
                    0xffff,
                    1 << 20,
                    i32::MAX as u64,
                    1 << 31,
                    u64::MAX,
                    1 << 40,
                    1 << 63,
                ]),
            };
            let field = match dice.below(4) {
                0 => value.to_be_bytes()[8 - width..].to_vec(),
                _ => value.to_le_bytes()[..width].to_vec(),
            };
            let at = at & !(dice.below(2) * (width - 1));
            let end = (at + width).min(length);
            bytes[at..end].copy_from_slice(&field[..end - at]);
        }
    }
}

fn textual(bytes: &mut Vec<u8>, corpus: &[Vec<u8>], dice: &mut Dice) {
    let is_number = |byte: u8| byte.is_ascii_digit() || matches!(byte, b'-' | b'+' | b'.' | b'e');
    let is_word = |byte: u8| byte.is_ascii_alphanumeric() || byte == b'_' || byte >= 128;
    let is_line = |byte: u8| byte != b'\n';
    let start = dice.below(bytes.len());
    match dice.below(12) {
        0..4 => {
            let token = token(bytes, start, is_number);
            let new = match dice.below(6) {
                0 => bytes[token.clone()].repeat(2),
                _ => dice.pick(NUMBERS).as_bytes().to_vec(),
            };
            bytes.splice(token, new);
        }
        4 => {
            let (token, other) = (token(bytes, start, is_word), dice.pick(corpus));
            let from = dice.below(other.len());
            bytes.splice(token, other[self::token(other, from, is_word)].to_vec());
        }
        5 => {
            let at = start.min(bytes.len());
            let piece = dice.pick(PIECES).as_bytes();
            let times = if dice.below(16) == 0 { 70_000 / piece.len() } else { 1 };
            bytes.splice(at..at, piece.repeat(times));
        }
        6 => {
            let word = token(bytes, start, is_word);
            let at = word.start + dice.below(word.len());
            if let Some(byte) = bytes.get_mut(at) {
                *byte = byte.wrapping_add(1);
            }
        }
        7 => drop(bytes.drain(token(bytes, start, is_line))),
        8 => {
            let line = bytes[token(bytes, start, is_line)].to_vec();
            let at = dice.below(bytes.len());
            let line = [b"\n".as_slice(), &line, b"\n"].concat();
            let times = if dice.below(16) == 0 { LONGEST / line.len() } else { 1 };
            bytes.splice(at..at, line.repeat(times));
        }
        9 => {
            let other = dice.pick(corpus);
            let from = dice.below(other.len());
            let line = other[token(other, from, is_line)].to_vec();
            bytes.splice(token(bytes, start, is_line), line);
        }
        _ => {
            // The value of one key goes to another.
            let other = dice.below(bytes.len());
            let new = bytes[token(bytes, other, is_number)].to_vec();
            bytes.splice(token(bytes, start, is_number), new);
        }
    }
}

/// The first token of bytes of a kind at or after a place; empty at the end.
fn token(bytes: &[u8], at: usize, of_kind: impl Fn(u8) -> bool) -> std::ops::Range<usize> {
    let Some(first) = (at..bytes.len()).find(|&place| of_kind(bytes[place])) else {
        return bytes.len()..bytes.len();
    };
    let start = (0..first)
        .rev()
        .find(|&place| !of_kind(bytes[place]))
        .map_or(0, |place| place + 1);
    let end = (first..bytes.len())
        .find(|&place| !of_kind(bytes[place]))
        .unwrap_or(bytes.len());
    start..end
}
