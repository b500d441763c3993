//! Bytes out of base64 and zlib blocks.

use std::io::Read;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;

use super::Fault;
use super::data::Encoding;

/// Zlib shrinks by 1032 to 1 at best: a block that claims more is a broken or hostile header.
const ZLIB_RATIO: usize = 1032;

/// Encoded bytes.
#[derive(Clone, Copy)]
pub(super) enum Source<'a> {
    Base64(&'a [u8]),
    Raw(&'a [u8]),
}

impl Source<'_> {
    /// The first `count` bytes, and how far into the source they and any base64 padding reach.
    fn take(&self, at: usize, skip: usize, count: usize) -> Result<(Vec<u8>, usize), Fault> {
        let short = |held: usize| {
            Fault::at(
                at + skip,
                format!("{} encoded bytes to the end", held.saturating_sub(skip)),
                format!("{count} bytes of data"),
            )
        };
        match self {
            Source::Raw(bytes) => {
                let end = skip.checked_add(count).ok_or_else(|| short(bytes.len()))?;
                let data = bytes.get(skip..end).ok_or_else(|| short(bytes.len()))?;
                Ok((data.to_vec(), end))
            }
            Source::Base64(bytes) => {
                let end = count.div_ceil(3).checked_mul(4).and_then(|size| size.checked_add(skip));
                let text = end
                    .and_then(|end| bytes.get(skip..end))
                    .ok_or_else(|| short(bytes.len()))?;
                let mut data = STANDARD
                    .decode(text)
                    .map_err(|error| Fault::at(at + skip, format!("broken base64 ({error})"), "base64 data"))?;
                if data.len() < count {
                    return Err(short(bytes.len()));
                }
                data.truncate(count);
                Ok((data, skip + text.len()))
            }
        }
    }
}

/// Uncompressed: the byte count, then the bytes, encoded as one.
pub(super) fn plain(at: usize, source: Source, file: &Encoding) -> Result<Vec<u8>, Fault> {
    let header = file.header_size();
    let (count, _) = source.take(at, 0, header)?;
    let count = usize::try_from(file.word(&count))
        .ok()
        .and_then(|count| count.checked_add(header));
    let count = count.ok_or_else(|| Fault::at(at, "a byte count beyond memory", "the size of the array"))?;
    let (mut bytes, _) = source.take(at, 0, count)?;
    bytes.drain(..header);
    Ok(bytes)
}

/// Compressed: the number of blocks, their size, the size of the last partial block (0: none), the compressed sizes; then,
/// encoded apart, the blocks.
pub(super) fn inflate(at: usize, source: Source, file: &Encoding) -> Result<Vec<u8>, Fault> {
    let width = file.header_size();
    let words = |bytes: &[u8]| -> Option<Vec<usize>> {
        bytes
            .chunks_exact(width)
            .map(|word| usize::try_from(file.word(word)).ok())
            .collect()
    };
    let beyond = || Fault::at(at, "block sizes beyond memory", "the sizes of compressed blocks");
    let blocks = words(&source.take(at, 0, width)?.0).ok_or_else(beyond)?[0];
    if blocks == 0 {
        return Ok(Vec::new());
    }
    let size = blocks
        .checked_add(3)
        .and_then(|words| words.checked_mul(width))
        .ok_or_else(beyond)?;
    let (header, mut skip) = source.take(at, 0, size)?;
    let header = words(&header).ok_or_else(beyond)?;
    let (full, partial, sizes) = (header[1], header[2], &header[3..]);
    let packed = sizes
        .iter()
        .try_fold(0usize, |sum, size| sum.checked_add(*size))
        .ok_or_else(beyond)?;
    let (packed, _) = source.take(at, skip, packed)?;
    let mut rest = packed.as_slice();
    let mut out = Vec::new();
    for (block, &size) in sizes.iter().enumerate() {
        let (data, tail) = rest.split_at(size);
        let expected = if block + 1 == blocks && partial > 0 {
            partial
        } else {
            full
        };
        if expected > size.saturating_mul(ZLIB_RATIO) {
            return Err(Fault::at(
                at + skip,
                format!("block {block} of {size} bytes claiming {expected}"),
                "a zlib block",
            ));
        }
        let before = out.len();
        flate2::read::ZlibDecoder::new(data)
            .take(expected as u64 + 1)
            .read_to_end(&mut out)
            .map_err(|error| {
                Fault::at(
                    at + skip,
                    format!("broken zlib data in block {block} ({error})"),
                    "a zlib block",
                )
            })?;
        if out.len() - before != expected {
            let found = format!("{} bytes in block {block}", out.len() - before);
            return Err(Fault::at(at + skip, found, format!("{expected}")));
        }
        skip += if matches!(source, Source::Raw(_)) { size } else { 0 };
        rest = tail;
    }
    Ok(out)
}
