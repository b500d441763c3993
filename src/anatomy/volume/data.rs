//! Image data: seeking, decompression and size checks, never more than the header promises.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::PathBuf;

use bzip2::bufread::BzDecoder;
use flate2::bufread::{GzDecoder, ZlibDecoder};

use super::element::Element;
use super::error::{At, VolumeError, quoted};
use super::header::{Encoding, Header, Skip};
use insonify_base::border::{EXPANSION, Guarded};
use insonify_base::memory::TooLarge;
use insonify_base::read;

/// Maximum number of bytes decompressed past the last needed one, to reach the checksum at the end.
pub(crate) const MAX_EXCESS: u64 = 64 << 20;

/// Maximum number of bytes skipped where each must be read: lines, and bytes of compressed data.
const MAX_SKIP: u64 = 256 << 20;

/// Longest word of text data, bytes: a double takes some 300 without an exponent.
const MAX_WORD: u64 = 1024;

/// Number of bytes decompressed at a time.
const CHUNK: usize = 64 << 10;

/// Reads the numbers of an image into values, one for each `group` of bytes. `push` appends those of a slice of
/// complete groups; numbers have the byte order of [`Header::data_order`].
pub(crate) fn read_into<V>(header: &mut Header, group: usize, push: Push<V>) -> Result<Vec<V>, VolumeError> {
    let (_, total) = header.extent()?;
    let files = std::mem::take(&mut header.data.more);
    let count = files.len() + 1;
    if !total.is_multiple_of(count) {
        let found = format!("{count} data files for {}", header.sizes());
        return Err(header.malformed(found, "files that share the image equally"));
    }
    let expected = total / count;
    let paths: Vec<PathBuf> = std::iter::once(header.data.path.clone()).chain(files).collect();
    // All files are looked at first: a header may name more of them than there are, and promise what no memory holds.
    let mut stored: u64 = 0;
    for path in &paths {
        header.data.path.clone_from(path);
        stored = stored.saturating_add(open(header, expected)?.2);
    }
    let capacity = match header.data.encoding {
        Encoding::Raw | Encoding::Text => total,
        Encoding::Gzip | Encoding::Zlib => total.min(stored.saturating_mul(EXPANSION) as usize),
        // Twice the run length of blocks.
        Encoding::Bzip2 => total.min(stored.saturating_mul(1 << 21) as usize),
    };
    let what = format!("an image of {}", header.sizes());
    let fail = |cause: TooLarge| header.unreadable(cause.into());
    let values = read::room(capacity / group, &what).map_err(fail)?;
    let part = read::room(group.min(capacity), &what).map_err(fail)?;
    let mut sink = Sink {
        skip: 0,
        wanted: 0,
        excess: 0,
        part,
        group,
        chunk: vec![0; CHUNK],
        values,
        push,
        failed: None,
    };
    for path in paths {
        header.data.path = path;
        (sink.skip, sink.wanted, sink.excess) = (0, expected, 0);
        let (reader, begin, stored) = open(header, expected)?;
        match header.data.encoding {
            Encoding::Raw => raw(header, reader, begin, stored, &mut sink)?,
            Encoding::Text => text(header, reader, begin, stored, &mut sink)?,
            Encoding::Gzip | Encoding::Zlib | Encoding::Bzip2 => unpack(header, reader, begin, expected, &mut sink)?,
        }
    }
    sink.failed.map_or(Ok(sink.values), Err)
}

/// Reads exactly the bytes required by an image's sizes and element type.
pub fn read(header: &mut Header) -> Result<Vec<u8>, VolumeError> {
    read_into(header, 1, &mut |bytes, all| {
        all.extend_from_slice(bytes);
        Ok(())
    })
}

/// Appends the values of a slice of bytes.
pub(super) type Push<'a, V> = &'a mut dyn FnMut(&[u8], &mut Vec<V>) -> Result<(), VolumeError>;

/// Opens the data file after the lines to skip, and returns its position and remaining length; an error if these cannot
/// hold `expected` bytes.
fn open(header: &Header, expected: usize) -> Result<(BufReader<File>, u64, u64), VolumeError> {
    let fail = |cause| header.unreadable(cause);
    let source = &header.data;
    let file = read::open(&source.path).map_err(fail)?;
    let end = file.metadata().map_err(fail)?.len();
    let mut reader = BufReader::new(file);
    reader.seek(SeekFrom::Start(source.start)).map_err(fail)?;
    let mut skipped = 0;
    for _ in 0..source.skip_lines {
        let left = MAX_SKIP - skipped;
        let line = (&mut reader).take(left).skip_until(b'\n').map_err(fail)? as u64;
        skipped += line;
        if line == left {
            let found = format!("more than {MAX_SKIP} bytes in the {} lines to skip", source.skip_lines);
            return Err(VolumeError::malformed(
                &source.path,
                At::Byte(source.start),
                found,
                "fewer",
            ));
        }
        // A shortage is detected below.
        if line == 0 {
            break;
        }
    }
    let begin = source.start + skipped;
    let stored = end.saturating_sub(begin);
    // In text, every number but the last takes at least a digit and a blank.
    let least = match source.encoding {
        Encoding::Raw => expected as u64,
        Encoding::Text => 2 * (expected / header.element()?.bytes()) as u64 - 1,
        _ => 0,
    };
    if stored < least {
        Err(short(header, end, stored, least))
    } else {
        Ok((reader, begin, stored))
    }
}

fn short(header: &Header, offset: u64, found: u64, expected: u64) -> VolumeError {
    let element = header.element.map_or("no type", Element::name);
    let part = match header.extent() {
        Ok((_, total)) if total as u64 > expected => "a share of ",
        _ => "",
    };
    VolumeError::malformed(
        &header.data.path,
        At::Byte(offset),
        format!("the end of the data after {found} bytes"),
        format!("{expected} bytes ({part}{} of {element})", header.sizes()),
    )
}

fn raw<V>(
    header: &Header,
    mut reader: BufReader<File>,
    begin: u64,
    stored: u64,
    sink: &mut Sink<V>,
) -> Result<(), VolumeError> {
    let wanted = sink.wanted as u64;
    let skip = match header.data.skip {
        Skip::Bytes(bytes) => bytes,
        Skip::AllButTheImage => stored.saturating_sub(wanted),
    };
    let available = stored.saturating_sub(skip);
    if available < wanted {
        return Err(short(header, begin + stored, available, wanted));
    }
    let fail = |cause| header.unreadable(cause);
    reader.seek(SeekFrom::Start(begin + skip)).map_err(fail)?;
    sink.drain(reader.take(wanted)).map_err(fail)?;
    match sink.wanted {
        0 => Ok(()),
        // The file has shrunk since its length was queried.
        left => Err(short(
            header,
            begin + skip + wanted - left as u64,
            wanted - left as u64,
            wanted,
        )),
    }
}

fn text<V>(
    header: &Header,
    mut reader: BufReader<File>,
    begin: u64,
    stored: u64,
    sink: &mut Sink<V>,
) -> Result<(), VolumeError> {
    let element = header.element()?;
    let Skip::Bytes(skip) = header.data.skip else {
        return Err(header.unsupported("a byte skip of -1 in text data", "it goes with raw data"));
    };
    let fail = |cause| header.unreadable(cause);
    let expected = sink.wanted;
    let mut offset = begin + skip.min(stored);
    reader.seek(SeekFrom::Start(offset)).map_err(fail)?;
    let (mut word, mut number) = (Vec::new(), Vec::new());
    let parts = |byte: u8| byte.is_ascii_whitespace() || byte == b',';
    while sink.wanted > 0 && sink.failed.is_none() {
        word.clear();
        let start = offset;
        for byte in (&mut reader).take(MAX_WORD).bytes() {
            let byte = byte.map_err(fail)?;
            offset += 1;
            if parts(byte) {
                break;
            }
            word.push(byte);
        }
        // Not even a separator was read: the file ends here. A word may be empty, between two separators.
        if offset == start {
            let read = (expected - sink.wanted) as u64;
            return Err(short(header, offset, read, expected as u64));
        }
        if word.is_empty() {
            continue;
        }
        number.clear();
        let text = String::from_utf8_lossy(&word);
        let parsed = element.push_text(&text, &mut number);
        // A word of the full length was cut off: what parses is only its beginning.
        parsed.filter(|()| word.len() < MAX_WORD as usize).ok_or_else(|| {
            let expected = format!("a number of type {}", element.name());
            VolumeError::malformed(&header.data.path, At::Byte(start), quoted(&text), expected)
        })?;
        sink.take(&number);
    }
    Ok(())
}

/// Receiver of decompressed bytes: drops the first `skip`, passes on the wanted ones and counts those after.
struct Sink<'a, V> {
    skip: u64,
    wanted: usize,
    excess: u64,
    /// Bytes of an incomplete group.
    part: Vec<u8>,
    group: usize,
    /// Bytes read at a time.
    chunk: Vec<u8>,
    values: Vec<V>,
    push: Push<'a, V>,
    /// First error of `push`: the data are still drained, since broken compression may be the cause.
    failed: Option<VolumeError>,
}

impl<V> Sink<'_, V> {
    fn take(&mut self, bytes: &[u8]) {
        let dropped = self.skip.min(bytes.len() as u64) as usize;
        self.skip -= dropped as u64;
        let rest = &bytes[dropped..];
        let (mut rest, excess) = rest.split_at(rest.len().min(self.wanted));
        self.excess += excess.len() as u64;
        self.wanted -= rest.len();
        if !self.part.is_empty() {
            let (end, after) = rest.split_at(rest.len().min(self.group - self.part.len()));
            self.part.extend_from_slice(end);
            rest = after;
            if self.part.len() < self.group {
                return;
            }
            let mut part = std::mem::take(&mut self.part);
            self.hand_on(&part);
            part.clear();
            self.part = part;
        }
        let (whole, part) = rest.split_at(rest.len() - rest.len() % self.group);
        self.part.extend_from_slice(part);
        self.hand_on(whole);
    }

    fn hand_on(&mut self, bytes: &[u8]) {
        if self.failed.is_none() {
            self.failed = (self.push)(bytes, &mut self.values).err();
        }
    }

    /// Drains a decoder to its end, where it verifies its checksum, unless that is too far away.
    fn drain(&mut self, mut decoder: impl Read) -> io::Result<()> {
        let mut chunk = std::mem::take(&mut self.chunk);
        let drained = loop {
            match decoder.read(&mut chunk) {
                Ok(read) if read > 0 && self.excess <= MAX_EXCESS => self.take(&chunk[..read]),
                Ok(_) => break Ok(()),
                Err(cause) if cause.kind() == io::ErrorKind::Interrupted => {}
                Err(cause) => break Err(cause),
            }
        };
        self.chunk = chunk;
        drained
    }
}

fn unpack<V>(
    header: &mut Header,
    mut reader: BufReader<File>,
    begin: u64,
    expected: usize,
    sink: &mut Sink<V>,
) -> Result<(), VolumeError> {
    sink.skip = match header.data.skip {
        Skip::Bytes(skip) if skip <= MAX_SKIP => skip,
        Skip::Bytes(skip) => {
            let found = format!("a skip of {skip} bytes in compressed data");
            return Err(header.unsupported(found, format!("at most {MAX_SKIP} are skipped")));
        }
        Skip::AllButTheImage => {
            return Err(header.unsupported("a byte skip of -1 in compressed data", "it goes with raw data"));
        }
    };
    let encoding = header.data.encoding;
    loop {
        let drained = match encoding {
            Encoding::Bzip2 => sink.drain(Guarded(BzDecoder::new(&mut reader))),
            Encoding::Zlib => sink.drain(Guarded(ZlibDecoder::new(&mut reader))),
            _ => sink.drain(Guarded(GzDecoder::new(&mut reader))),
        };
        let offset = reader.stream_position().unwrap_or(begin);
        if let Err(cause) = drained {
            return Err(broken(header, offset, expected - sink.wanted, expected, &cause));
        }
        let more = reader.fill_buf().map_err(|cause| header.unreadable(cause))?;
        // Parallel compressors write several gzip or bzip2 streams in a row; a decoder stops after one.
        let another_member = match encoding {
            Encoding::Bzip2 => more.starts_with(b"BZh"),
            Encoding::Zlib => false,
            _ => more.starts_with(&[0x1f, 0x8b]),
        };
        if sink.excess > 0 || !another_member {
            break;
        }
    }
    if sink.wanted > 0 {
        let offset = reader.stream_position().unwrap_or(begin);
        return Err(short(header, offset, (expected - sink.wanted) as u64, expected as u64));
    }
    if sink.excess > 0 {
        let warning =
            format!("the data go on past the {expected} bytes that the header calls for; the rest is ignored");
        header.warnings.push(warning);
    }
    Ok(())
}

fn broken(header: &Header, offset: u64, unpacked: usize, expected: usize, cause: &io::Error) -> VolumeError {
    if !is_corrupt_data(cause) {
        return header.unreadable(io::Error::new(cause.kind(), cause.to_string()));
    }
    let wanted = if unpacked == expected {
        "an intact end of the compressed data".to_owned()
    } else {
        format!("{expected} bytes unpacked")
    };
    let found = format!("broken compressed data ({cause}) after {unpacked} bytes unpacked");
    VolumeError::malformed(&header.data.path, At::Byte(offset), found, wanted)
}

/// Whether an error of a decoder is due to the data rather than the system.
pub(crate) fn is_corrupt_data(cause: &io::Error) -> bool {
    use io::ErrorKind as Kind;
    matches!(
        cause.kind(),
        Kind::UnexpectedEof | Kind::InvalidInput | Kind::InvalidData | Kind::Other
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Groups are handed on whole, however the bytes arrive.
    #[test]
    fn groups_are_whole_in_pieces_of_any_size() {
        let bytes: Vec<u8> = (0..60).collect();
        for pieces in [1, 2, 3, 5, 7, 60] {
            let mut push = |part: &[u8], values: &mut Vec<Vec<u8>>| {
                assert_eq!(part.len() % 6, 0);
                values.extend(part.chunks(6).map(<[u8]>::to_vec));
                Ok(())
            };
            let mut sink = Sink {
                skip: 4,
                wanted: 48,
                excess: 0,
                part: Vec::new(),
                group: 6,
                chunk: Vec::new(),
                values: Vec::new(),
                push: &mut push,
                failed: None,
            };
            bytes.chunks(pieces).for_each(|piece| sink.take(piece));
            assert_eq!(sink.values.concat(), bytes[4..52], "{pieces}");
            assert_eq!((sink.wanted, sink.excess), (0, 8));
        }
    }
}
