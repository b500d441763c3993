//! Reader of the numbers of a Gmsh file, ASCII or binary.

use super::{Cursor, Fault, quote};

/// Encoding of the numbers.
#[derive(Clone, Copy)]
enum Encoding {
    Ascii,
    /// `wide`: whether sizes and tags have eight bytes rather than four.
    Binary {
        big_endian: bool,
        wide: bool,
    },
}

/// Reader of the three number types of the format: `int`, `size_t` and `double`.
pub(super) struct Reader<'a> {
    pub cursor: Cursor<'a>,
    encoding: Encoding,
}

/// Least numbers that make up an item.
#[derive(Clone, Copy, Default)]
pub(super) struct Item {
    pub ints: usize,
    pub sizes: usize,
    pub floats: usize,
}

impl<'a> Reader<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Reader<'a> {
        Reader {
            cursor: Cursor::new(bytes),
            encoding: Encoding::Ascii,
        }
    }

    pub(crate) fn set_binary(&mut self, big_endian: bool, wide: bool) {
        self.encoding = Encoding::Binary { big_endian, wide };
    }

    pub(crate) fn is_binary(&self) -> bool {
        matches!(self.encoding, Encoding::Binary { .. })
    }

    /// Skips the end of a line of text, after which binary data begin; does nothing in an ASCII file.
    pub(crate) fn start_data(&mut self) {
        if self.is_binary() {
            self.cursor.line();
        }
    }

    pub(super) fn int(&mut self) -> Result<i32, Fault> {
        match self.encoding {
            Encoding::Ascii => self.cursor.number(|| "a whole number of 32 bits".to_owned()),
            Encoding::Binary { big_endian, .. } => {
                let bytes = self.bytes()?;
                Ok(if big_endian {
                    i32::from_be_bytes(bytes)
                } else {
                    i32::from_le_bytes(bytes)
                })
            }
        }
    }

    /// Reads a size or a tag.
    pub(super) fn size(&mut self) -> Result<u64, Fault> {
        match self.encoding {
            Encoding::Ascii => self.cursor.number(|| "a whole number from 0".to_owned()),
            Encoding::Binary { big_endian, wide: true } => {
                let bytes = self.bytes()?;
                Ok(if big_endian {
                    u64::from_be_bytes(bytes)
                } else {
                    u64::from_le_bytes(bytes)
                })
            }
            Encoding::Binary {
                big_endian,
                wide: false,
            } => {
                let bytes = self.bytes()?;
                Ok(u64::from(if big_endian {
                    u32::from_be_bytes(bytes)
                } else {
                    u32::from_le_bytes(bytes)
                }))
            }
        }
    }

    pub(super) fn float(&mut self) -> Result<f64, Fault> {
        match self.encoding {
            Encoding::Ascii => self.cursor.number(|| "a number".to_owned()),
            Encoding::Binary { big_endian, .. } => {
                let bytes = self.bytes()?;
                Ok(if big_endian {
                    f64::from_be_bytes(bytes)
                } else {
                    f64::from_le_bytes(bytes)
                })
            }
        }
    }

    /// Reads the number of repetitions of `item`. The rest of the file must have room for them, so that a count never
    /// allocates more memory than the file can fill.
    pub(super) fn count(&mut self, item: Item) -> Result<usize, Fault> {
        let start = self.cursor.at;
        let count = self.size()?;
        self.room(start, count, item)
    }

    /// Checks a count found at `offset` as [`Reader::count`] does.
    pub(super) fn room(&self, offset: usize, count: u64, item: Item) -> Result<usize, Fault> {
        let left = self.cursor.rest().len();
        let (least, left) = match self.encoding {
            // A digit and a space each; the last number of a file may lack the space.
            Encoding::Ascii => (2 * (item.ints + item.sizes + item.floats), left + 1),
            Encoding::Binary { wide, .. } => {
                let size = if wide { 8 } else { 4 };
                (4 * item.ints + size * item.sizes + 8 * item.floats, left)
            }
        };
        let count = usize::try_from(count).ok();
        let fits = count.filter(|count| count.checked_mul(least).is_some_and(|bytes| bytes <= left));
        fits.ok_or_else(|| {
            Fault::at(
                offset,
                format!(
                    "{} items, of at least {least} bytes each",
                    count.map_or("too many".to_owned(), |n| n.to_string())
                ),
                format!("at most what the {left} bytes to the end of the file can hold"),
            )
        })
    }

    pub(crate) fn skip_ints(&mut self, count: usize) -> Result<(), Fault> {
        (0..count).try_for_each(|_| self.int().map(drop))
    }

    pub(crate) fn skip_sizes(&mut self, count: usize) -> Result<(), Fault> {
        (0..count).try_for_each(|_| self.size().map(drop))
    }

    pub(crate) fn skip_floats(&mut self, count: usize) -> Result<(), Fault> {
        (0..count).try_for_each(|_| self.float().map(drop))
    }

    /// Reads three coordinates.
    pub(super) fn position(&mut self, tag: u64) -> Result<[f64; 3], Fault> {
        let mut position = [0.0; 3];
        for x in &mut position {
            let start = self.cursor.at;
            *x = self.float()?;
            if !x.is_finite() {
                return Err(Fault::at(
                    start,
                    format!("{x}"),
                    format!("a finite coordinate of node {tag}"),
                ));
            }
        }
        Ok(position)
    }

    fn bytes<const N: usize>(&mut self) -> Result<[u8; N], Fault> {
        let bytes = self.cursor.take(N).and_then(|bytes| bytes.first_chunk::<N>());
        bytes.copied().ok_or_else(|| {
            let found = format!("{} bytes to the end of the file", self.cursor.rest().len());
            Fault::at(self.cursor.at, found, format!("a number of {N} bytes"))
        })
    }
}

/// Reads a name in quotes to the end of the line.
pub(super) fn quoted(cursor: &mut Cursor) -> Result<String, Fault> {
    let start = cursor.at;
    let line = cursor.line().trim_ascii();
    let inside = line.strip_prefix(b"\"").and_then(|rest| rest.strip_suffix(b"\""));
    let inside = inside.ok_or_else(|| Fault::at(start, quote(line), "a name in quotes"))?;
    Ok(String::from_utf8_lossy(inside).into_owned())
}
