//! The data of an image: skipped to, unpacked and counted, never more than the header promises.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom};

use bzip2::bufread::BzDecoder;
use flate2::bufread::{GzDecoder, ZlibDecoder};

use super::element::{ByteOrder, Element};
use super::error::{At, VolumeError, quoted};
use super::header::{Encoding, Header, Skip};
use crate::memory;

/// Bytes unpacked past the last that is needed, in search of the checksum at the end.
pub(crate) const MAX_EXCESS: u64 = 64 << 20;

/// Bytes unpacked at a time.
const CHUNK: usize = 64 << 10;

/// Reads the numbers of an image: exactly the bytes that its sizes and element type need. Text is stored in
/// little-endian order, which the header then says.
pub(crate) fn read(header: &mut Header) -> Result<Vec<u8>, VolumeError> {
    let (count, expected) = header.extent()?;
    let place = header.data.clone();
    let fail = |cause| VolumeError::read(&place.path, cause);
    let file = File::open(&place.path).map_err(fail)?;
    let end = file.metadata().map_err(fail)?.len();
    let mut reader = BufReader::new(file);
    reader.seek(SeekFrom::Start(place.start)).map_err(fail)?;
    for _ in 0..place.skip_lines {
        // A line longer than the file cannot be; what is left over is found short below.
        if reader.skip_until(b'\n').map_err(fail)? == 0 {
            break;
        }
    }
    let begin = reader.stream_position().map_err(fail)?;
    let stored = end.saturating_sub(begin);
    // Data that are not all there are reported as such. Of each number at least a byte is made.
    let readable = match place.encoding {
        Encoding::Raw | Encoding::Text => stored.min(expected as u64),
        _ => expected as u64,
    };
    memory::check(
        readable.saturating_add(count as u64),
        &format!("an image of {}", header.sizes()),
    )
    .map_err(|error| fail(error.into()))?;
    match place.encoding {
        Encoding::Raw => raw(header, &mut reader, begin, stored, expected),
        Encoding::Text => text(header, &mut reader, begin, stored),
        Encoding::Gzip | Encoding::Zlib | Encoding::Bzip2 => unpack(header, &mut reader, begin, expected),
    }
}

fn short(header: &Header, at: u64, found: u64, expected: u64) -> VolumeError {
    let element = header.element.map_or("no type", Element::name);
    VolumeError::malformed(
        &header.data.path,
        At::Byte(at),
        format!("the end of the data after {found} bytes"),
        format!("{expected} bytes ({} of {element})", header.sizes()),
    )
}

fn raw(
    header: &Header,
    reader: &mut BufReader<File>,
    begin: u64,
    stored: u64,
    expected: usize,
) -> Result<Vec<u8>, VolumeError> {
    let wanted = expected as u64;
    let skip = match header.data.skip {
        Skip::Bytes(bytes) => bytes,
        Skip::AllButTheImage => stored.saturating_sub(wanted),
    };
    let available = stored.saturating_sub(skip);
    if available < wanted {
        return Err(short(header, begin + stored, available, wanted));
    }
    let mut bytes = vec![0; expected];
    reader
        .seek(SeekFrom::Start(begin + skip))
        .and_then(|_| reader.read_exact(&mut bytes))
        .map_err(|cause| VolumeError::read(&header.data.path, cause))?;
    Ok(bytes)
}

fn text(header: &mut Header, reader: &mut BufReader<File>, begin: u64, stored: u64) -> Result<Vec<u8>, VolumeError> {
    let (count, expected) = header.extent()?;
    let element = header.element()?;
    // Every number but the last takes at least a digit and a blank.
    if stored < 2 * count as u64 - 1 {
        return Err(short(header, begin + stored, stored, 2 * count as u64 - 1));
    }
    let Skip::Bytes(skip) = header.data.skip else {
        return Err(header.unsupported("a byte skip of -1 in text data", "it goes with raw data"));
    };
    let fail = |cause| VolumeError::read(&header.data.path, cause);
    reader.seek_relative(skip.min(stored) as i64).map_err(fail)?;
    let mut bytes = Vec::with_capacity(expected);
    let mut read = 0;
    let mut line = Vec::new();
    let mut at = begin + skip;
    while read < count {
        line.clear();
        let taken = reader.read_until(b'\n', &mut line).map_err(fail)?;
        if taken == 0 {
            return Err(short(header, at, bytes.len() as u64, expected as u64));
        }
        let words = String::from_utf8_lossy(&line);
        for word in words
            .split(|c: char| c.is_whitespace() || c == ',')
            .filter(|word| !word.is_empty())
        {
            if read == count {
                break;
            }
            element.push_text(word, &mut bytes).ok_or_else(|| {
                VolumeError::malformed(
                    &header.data.path,
                    At::Byte(at),
                    quoted(word),
                    format!("a number of type {}", element.name()),
                )
            })?;
            read += 1;
        }
        at += taken as u64;
    }
    header.order = ByteOrder::Little;
    Ok(bytes)
}

/// Takes unpacked bytes: drops the first `skip`, keeps `wanted` and counts those that come after.
struct Sink {
    skip: u64,
    wanted: usize,
    kept: Vec<u8>,
    excess: u64,
}

impl Sink {
    fn take(&mut self, bytes: &[u8]) {
        let dropped = self.skip.min(bytes.len() as u64) as usize;
        self.skip -= dropped as u64;
        let rest = &bytes[dropped..];
        let room = self.wanted - self.kept.len();
        self.kept.extend_from_slice(&rest[..rest.len().min(room)]);
        self.excess += rest.len().saturating_sub(room) as u64;
    }

    /// Drains a decoder to its end, where it checks its sum, unless that is too far away.
    fn drain(&mut self, mut decoder: impl Read) -> io::Result<()> {
        let mut chunk = vec![0; CHUNK];
        while self.excess <= MAX_EXCESS {
            match decoder.read(&mut chunk) {
                Ok(0) => break,
                Ok(read) => self.take(&chunk[..read]),
                Err(cause) if cause.kind() == io::ErrorKind::Interrupted => {}
                Err(cause) => return Err(cause),
            }
        }
        Ok(())
    }
}

fn unpack(
    header: &mut Header,
    reader: &mut BufReader<File>,
    begin: u64,
    expected: usize,
) -> Result<Vec<u8>, VolumeError> {
    let Skip::Bytes(skip) = header.data.skip else {
        return Err(header.unsupported("a byte skip of -1 in compressed data", "it goes with raw data"));
    };
    let encoding = header.data.encoding;
    let mut sink = Sink {
        skip,
        wanted: expected,
        kept: Vec::with_capacity(expected),
        excess: 0,
    };
    loop {
        let drained = match encoding {
            Encoding::Bzip2 => sink.drain(BzDecoder::new(&mut *reader)),
            Encoding::Zlib => sink.drain(ZlibDecoder::new(&mut *reader)),
            _ => sink.drain(GzDecoder::new(&mut *reader)),
        };
        let at = reader.stream_position().unwrap_or(begin);
        if let Err(cause) = drained {
            return Err(broken(header, at, sink.kept.len(), expected, &cause));
        }
        let more = reader
            .fill_buf()
            .map_err(|cause| VolumeError::read(&header.data.path, cause))?;
        let another_member = match encoding {
            Encoding::Bzip2 => more.starts_with(b"BZh"),
            Encoding::Zlib => false,
            _ => more.starts_with(&[0x1f, 0x8b]),
        };
        if sink.excess > 0 || !another_member {
            break;
        }
    }
    if sink.kept.len() < expected {
        let at = reader.stream_position().unwrap_or(begin);
        return Err(short(header, at, sink.kept.len() as u64, expected as u64));
    }
    if sink.excess > 0 {
        let warning =
            format!("the data go on past the {expected} bytes that the header calls for; the rest is ignored");
        header.warnings.push(warning);
    }
    Ok(sink.kept)
}

fn broken(header: &Header, at: u64, unpacked: usize, expected: usize, cause: &io::Error) -> VolumeError {
    let path = &header.data.path;
    if says_broken(cause) {
        VolumeError::malformed(
            path,
            At::Byte(at),
            format!("broken compressed data ({cause}) after {unpacked} bytes unpacked"),
            format!("{expected} bytes unpacked"),
        )
    } else {
        VolumeError::read(path, io::Error::new(cause.kind(), cause.to_string()))
    }
}

/// Whether an error of a decoder blames the data rather than the system.
pub(crate) fn says_broken(cause: &io::Error) -> bool {
    use io::ErrorKind as Kind;
    matches!(
        cause.kind(),
        Kind::UnexpectedEof | Kind::InvalidInput | Kind::InvalidData | Kind::Other
    )
}
