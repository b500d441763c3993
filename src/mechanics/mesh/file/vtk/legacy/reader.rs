//! Reader of names, types and numbers of a legacy file.

use super::{Cursor, Fault, Kind, quote, word};
use crate::base::read;

pub(super) struct Reader<'a> {
    pub cursor: Cursor<'a>,
    pub binary: bool,
}

impl Reader<'_> {
    pub fn keyword(&mut self, expected: &str) -> Result<(), Fault> {
        let (at, word) = self.cursor.word();
        match word.eq_ignore_ascii_case(expected.as_bytes()) {
            true => Ok(()),
            false => Err(Fault::at(at, quote(word), expected)),
        }
    }

    /// Returns whether the next word is this one.
    pub fn is_next(&self, keyword: &str) -> bool {
        self.cursor.peek().1.eq_ignore_ascii_case(keyword.as_bytes())
    }

    /// Reads a name, resolving the `%20` escapes of the format.
    pub fn name(&mut self) -> Result<String, Fault> {
        let (at, word) = self.cursor.word();
        if word.is_empty() {
            return Err(Fault::at(at, quote(word), "a name"));
        }
        let mut name = Vec::with_capacity(word.len());
        let mut rest = word;
        while let Some((&first, tail)) = rest.split_first() {
            let code = tail.get(..2).and_then(|hex| std::str::from_utf8(hex).ok());
            let code = code
                .filter(|_| first == b'%')
                .and_then(|hex| u8::from_str_radix(hex, 16).ok());
            name.push(code.unwrap_or(first));
            rest = if code.is_some() { &tail[2..] } else { tail };
        }
        Ok(String::from_utf8_lossy(&name).into_owned())
    }

    pub fn kind(&mut self) -> Result<Kind, Fault> {
        let (at, word) = self.cursor.word();
        Ok(match word.to_ascii_lowercase().as_slice() {
            b"float" => Kind::F32,
            b"double" => Kind::F64,
            b"char" | b"vtktypeint8" => Kind::I8,
            b"unsigned_char" | b"vtktypeuint8" => Kind::U8,
            b"short" | b"vtktypeint16" => Kind::I16,
            b"unsigned_short" | b"vtktypeuint16" => Kind::U16,
            b"int" | b"vtktypeint32" | b"vtkidtype" => Kind::I32,
            b"unsigned_int" | b"vtktypeuint32" => Kind::U32,
            b"long" | b"vtktypeint64" => Kind::I64,
            b"unsigned_long" | b"vtktypeuint64" => Kind::U64,
            _ => {
                return Err(Fault::at(
                    at,
                    quote(word),
                    "a VTK data type such as float, double or vtktypeint64",
                ));
            }
        })
    }

    pub fn numbers(&mut self, count: usize, kind: Kind) -> Result<Vec<f64>, Fault> {
        if self.binary {
            self.binary_numbers(count, kind)
        } else {
            self.ascii_numbers(count)
        }
    }

    fn ascii_numbers(&mut self, count: usize) -> Result<Vec<f64>, Fault> {
        // Every number takes at least two bytes, so the file bounds the allocation.
        let mut values = read::room(count.min(self.cursor.rest().len() / 2 + 1), "an array of a mesh")?;
        for index in 0..count {
            values.push(self.cursor.number(|| format!("number {index} of {count}"))?);
        }
        Ok(values)
    }

    fn binary_numbers(&mut self, count: usize, kind: Kind) -> Result<Vec<f64>, Fault> {
        self.cursor.line();
        let size = kind.size();
        let data = count.checked_mul(size).and_then(|bytes| self.cursor.take(bytes));
        let data = data.ok_or_else(|| {
            let found = format!("{} bytes to the end of the file", self.cursor.rest().len());
            Fault::at(self.cursor.at, found, format!("{count} binary values of {size} bytes"))
        })?;
        let mut values = read::room(count, "an array of a mesh")?;
        values.extend(data.chunks_exact(size).map(|bytes| kind.value(word(bytes, true))));
        Ok(values)
    }

    /// Skips metadata, which end at the next blank line.
    pub fn skip_metadata(&mut self) {
        self.cursor.line();
        while !self.cursor.rest().is_empty() && !self.cursor.line().trim_ascii().is_empty() {}
    }
}
