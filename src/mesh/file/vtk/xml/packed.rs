//! Unpacking of base64 and zlib blocks.

use std::io::Read;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;

use super::Fault;
use super::data::Encoding;
use insonify_base::border::{EXPANSION, Guarded};
use insonify_base::read;

/// Encoded bytes.
#[derive(Clone, Copy)]
pub(super) enum Source<'a> {
    Base64(&'a [u8]),
    Raw(&'a [u8]),
}

impl Source<'_> {
    /// Returns the first `count` bytes, and the length of the source that they and any base64 padding occupy.
    fn take(&self, offset: usize, skip: usize, count: usize) -> Result<(Vec<u8>, usize), Fault> {
        let short = |left: usize| {
            let found = match self {
                Source::Raw(_) => format!("{left} bytes to the end"),
                Source::Base64(_) => format!("{left} base64 characters to the end, of {} bytes", left / 4 * 3),
            };
            Fault::at(offset + skip, found, format!("{count} bytes of data"))
        };
        let left = match self {
            Source::Raw(bytes) | Source::Base64(bytes) => bytes.len().saturating_sub(skip),
        };
        match self {
            Source::Raw(bytes) => {
                let end = skip.checked_add(count).ok_or_else(|| short(left))?;
                let data = bytes.get(skip..end).ok_or_else(|| short(left))?;
                Ok((data.to_vec(), end))
            }
            Source::Base64(bytes) => {
                let end = count.div_ceil(3).checked_mul(4).and_then(|size| size.checked_add(skip));
                let text = end.and_then(|end| bytes.get(skip..end)).ok_or_else(|| short(left))?;
                let mut data = STANDARD
                    .decode(text)
                    .map_err(|error| Fault::at(offset + skip, format!("broken base64 ({error})"), "base64 data"))?;
                if data.len() < count {
                    return Err(short(left));
                }
                data.truncate(count);
                Ok((data, skip + text.len()))
            }
        }
    }
}

/// Bytes of an array before they are unpacked.
pub(super) struct Packed<'a> {
    /// Unpacked size according to the header, bytes.
    pub size: usize,
    at: usize,
    source: Source<'a>,
    /// Length of the source before the first block, bytes.
    skip: usize,
    /// Packed and unpacked size of each block; `None` without compression.
    blocks: Option<Vec<(usize, usize)>>,
}

impl<'a> Packed<'a> {
    /// Reads an uncompressed array: the byte count, then the bytes, encoded as one.
    pub(super) fn plain(start: usize, source: Source<'a>, file: &Encoding) -> Result<Self, Fault> {
        let (count, _) = source.take(start, 0, file.header_size())?;
        let size = usize::try_from(file.word(&count)).ok();
        Ok(Packed {
            size: size.ok_or_else(|| Fault::at(start, "a byte count beyond memory", "the size of the array"))?,
            at: start,
            source,
            skip: file.header_size(),
            blocks: None,
        })
    }

    /// Reads a compressed array: the number of blocks, their size, the size of the last partial block (0: none), the
    /// compressed sizes; then, encoded separately, the blocks.
    pub(crate) fn zlib(start: usize, source: Source<'a>, file: &Encoding) -> Result<Self, Fault> {
        let width = file.header_size();
        let word = |bytes: &[u8]| usize::try_from(file.word(bytes)).ok();
        let beyond = || Fault::at(start, "block sizes beyond memory", "the sizes of compressed blocks");
        let count = word(&source.take(start, 0, width)?.0).ok_or_else(beyond)?;
        let mut packed = Packed {
            size: 0,
            at: start,
            source,
            skip: width,
            blocks: Some(Vec::new()),
        };
        if count == 0 {
            return Ok(packed);
        }
        let words = count.checked_add(3).and_then(|words| words.checked_mul(width));
        let (header, skip) = source.take(start, 0, words.ok_or_else(beyond)?)?;
        let header: Option<Vec<usize>> = header.chunks_exact(width).map(word).collect();
        let header = header.ok_or_else(beyond)?;
        let (full, partial) = (header[1], header[2]);
        let last = if partial > 0 { partial } else { full };
        let unpacked = (0..count).map(|block| if block + 1 == count { last } else { full });
        let blocks: Vec<_> = header[3..].iter().copied().zip(unpacked).collect();
        for (block, &(size, unpacked)) in blocks.iter().enumerate() {
            if unpacked > size.saturating_mul(EXPANSION as usize) {
                let found = format!("block {block} of {size} bytes claiming {unpacked}");
                return Err(Fault::at(start, found, "a zlib block"));
            }
            packed.size = packed.size.checked_add(unpacked).ok_or_else(beyond)?;
        }
        (packed.skip, packed.blocks) = (skip, Some(blocks));
        Ok(packed)
    }

    /// Returns the bytes, exactly as many as the header states.
    pub(super) fn bytes(&self) -> Result<Vec<u8>, Fault> {
        let Some(blocks) = &self.blocks else {
            let beyond = || Fault::at(self.at, "a byte count beyond memory", "the size of the array");
            let all = self.size.checked_add(self.skip).ok_or_else(beyond)?;
            let (mut bytes, _) = self.source.take(self.at, 0, all)?;
            bytes.drain(..self.skip);
            return Ok(bytes);
        };
        let beyond = || Fault::at(self.at, "block sizes beyond memory", "the sizes of compressed blocks");
        let sizes = blocks.iter().try_fold(0usize, |sum, (size, _)| sum.checked_add(*size));
        let (packed, _) = self.source.take(self.at, self.skip, sizes.ok_or_else(beyond)?)?;
        let (mut rest, mut offset) = (packed.as_slice(), self.at + self.skip);
        let mut out = read::room(self.size, "an array of a mesh")?;
        for (block, &(size, expected)) in blocks.iter().enumerate() {
            let (data, tail) = rest.split_at(size);
            let before = out.len();
            let inflated = Guarded(flate2::read::ZlibDecoder::new(data))
                .take(expected as u64 + 1)
                .read_to_end(&mut out);
            if let Err(error) = inflated {
                let found = format!("broken zlib data in block {block} ({error})");
                return Err(Fault::at(offset, found, "a zlib block"));
            }
            if out.len() - before != expected {
                let found = format!("{} bytes in block {block}", out.len() - before);
                return Err(Fault::at(offset, found, format!("{expected}")));
            }
            offset += if matches!(self.source, Source::Raw(_)) { size } else { 0 };
            rest = tail;
        }
        Ok(out)
    }
}
