//! Layout of pixels by the header of a DICOM file, checked against the pixels before any are decoded.

use dicom_dictionary_std::tags;
use dicom_object::{DefaultDicomObject, InMemDicomObject, Tag};

use super::super::{JPEG_START, MAX_SIDE_PX, jpeg_sizes};

/// Transfer syntaxes that are read (PS3.6 A): pixels as they are, RLE, and JPEG with 8 and 12 bits and without loss.
const PLAIN: [&str; 5] = [
    "1.2.840.10008.1.2",
    "1.2.840.10008.1.2.1",
    "1.2.840.10008.1.2.1.98",
    "1.2.840.10008.1.2.1.99",
    "1.2.840.10008.1.2.2",
];
const RLE: &str = "1.2.840.10008.1.2.5";
const JPEG: [&str; 4] = [
    "1.2.840.10008.1.2.4.50",
    "1.2.840.10008.1.2.4.51",
    "1.2.840.10008.1.2.4.57",
    "1.2.840.10008.1.2.4.70",
];

/// Bytes of the header of an RLE frame: the number of segments and 15 offsets (PS3.5 G.5).
const RLE_HEADER: usize = 64;

/// Frames whose sizes agree with what is stored.
pub(super) struct Layout {
    pub frames: usize,
    /// Decoded bytes of a frame.
    pub bytes: usize,
    /// Stored bytes of all frames.
    pub stored: usize,
}

/// Sizes of a frame.
struct Size {
    columns: usize,
    rows: usize,
    samples: usize,
    bytes_per_sample: usize,
}

impl Layout {
    /// Reads the layout; the error says what cannot be decoded, or does not agree.
    pub(super) fn new(object: &DefaultDicomObject) -> Result<Self, String> {
        let whole = |tag: Tag| whole(object, tag);
        let [columns, rows] = [tags::COLUMNS, tags::ROWS].map(|tag| whole(tag).unwrap_or(0));
        let sides = 1..=MAX_SIDE_PX as usize;
        if !sides.contains(&columns) || !sides.contains(&rows) {
            return Err(format!("images of {columns} x {rows} pixels"));
        }
        let samples = whole(tags::SAMPLES_PER_PIXEL).unwrap_or(1);
        if ![1, 3].contains(&samples) {
            return Err(format!("images with {samples} samples a pixel"));
        }
        let allocated = whole(tags::BITS_ALLOCATED).unwrap_or(0);
        let stored_bits = whole(tags::BITS_STORED).unwrap_or(allocated);
        let high_bit = whole(tags::HIGH_BIT).unwrap_or(stored_bits.saturating_sub(1));
        if ![8, 16].contains(&allocated) || !(1..=allocated).contains(&stored_bits) || high_bit + 1 < stored_bits {
            return Err(format!(
                "pixels of {stored_bits} bits in {allocated}, the highest {high_bit}"
            ));
        }
        if high_bit >= allocated {
            return Err(format!("a highest bit {high_bit} of {allocated}"));
        }
        let size = Size {
            columns,
            rows,
            samples,
            bytes_per_sample: allocated / 8,
        };
        let frames = whole(tags::NUMBER_OF_FRAMES).map_or(1, |count| count.max(1));
        let element = object.get(tags::PIXEL_DATA).ok_or("no pixels")?;
        let syntax = object.meta().transfer_syntax();
        let bytes = columns * rows * samples * (allocated / 8);
        let Some(fragments) = element.fragments() else {
            let stored = element
                .value()
                .primitive()
                .map_or(0, |pixels| pixels.calculate_byte_len());
            if !PLAIN.contains(&syntax) {
                return Err(format!("pixels that are not packed in transfer syntax {syntax}"));
            }
            let is_there = frames.checked_mul(bytes).is_some_and(|all| all <= stored);
            return if is_there {
                Ok(Self { frames, bytes, stored })
            } else {
                Err(format!(
                    "{frames} frames of {bytes} bytes, and {stored} bytes of pixels"
                ))
            };
        };
        if frames > fragments.len() {
            return Err(format!("{frames} frames in {} fragments", fragments.len()));
        }
        for (index, fragment) in fragments.iter().enumerate() {
            let fault = match syntax {
                RLE => size.rle_fault(fragment),
                _ if JPEG.contains(&syntax) => size.jpeg_fault(fragment),
                _ if PLAIN.contains(&syntax) => None,
                _ => return Err(format!("pixels in transfer syntax {syntax}")),
            };
            if let Some(fault) = fault {
                return Err(format!("fragment {index} with {fault}"));
            }
        }
        let stored = fragments.iter().map(Vec::len).sum();
        Ok(Self { frames, bytes, stored })
    }
}

impl Size {
    /// Fault of a fragment of RLE, which is one frame (PS3.5 G): its segments must unpack to a byte of each pixel.
    fn rle_fault(&self, fragment: &[u8]) -> Option<String> {
        let word = |index: usize| {
            let bytes = fragment.get(4 * index..)?.first_chunk()?;
            Some(u32::from_le_bytes(*bytes) as usize)
        };
        let expected = self.samples * self.bytes_per_sample;
        let segments = word(0).filter(|_| fragment.len() >= RLE_HEADER).unwrap_or(0);
        if segments != expected {
            return Some(format!("{segments} segments of RLE where {expected} are needed"));
        }
        let pixels = self.rows * self.columns;
        for segment in 0..segments {
            let start = word(segment + 1).unwrap_or(0);
            let end = if segment + 1 == segments {
                fragment.len()
            } else {
                word(segment + 2).unwrap_or(0)
            };
            let packed = fragment.get(start..end).filter(|_| start >= RLE_HEADER);
            let unpacked = packed.map_or(0, unpacked_bytes);
            // Some encoders pad; the decoder unpacks all of it.
            if !(pixels..=2 * pixels + RLE_HEADER).contains(&unpacked) {
                return Some(format!("{unpacked} bytes in segment {segment} for {pixels} pixels"));
            }
        }
        None
    }

    /// Fault of a fragment that begins a JPEG image: its own header must state the same sizes.
    fn jpeg_fault(&self, fragment: &[u8]) -> Option<String> {
        // Else it goes on with an image that another one began.
        if !fragment.starts_with(&JPEG_START) {
            return None;
        }
        let Some([columns, rows, samples, bits]) = jpeg_sizes(fragment) else {
            return Some("a JPEG image without sizes".to_owned());
        };
        let differs = [columns, rows, samples] != [self.columns, self.rows, self.samples];
        (differs || bits > 8 * self.bytes_per_sample)
            .then(|| format!("a JPEG image of {columns} x {rows} pixels with {samples} samples of {bits} bits"))
    }
}

/// Bytes that a segment of RLE unpacks to (PS3.5 G.3.2); none if it ends before the byte of a run.
fn unpacked_bytes(mut packed: &[u8]) -> usize {
    let mut unpacked = 0;
    while let [count, rest @ ..] = packed {
        let (length, stored) = match count {
            0..=127 => [rest.len().min(usize::from(*count) + 1); 2].into(),
            128 => (0, 0),
            129..=255 => (257 - usize::from(*count), 1),
        };
        let Some(rest) = rest.get(stored..) else { return 0 };
        (packed, unpacked) = (rest, unpacked + length);
    }
    unpacked
}

fn whole(object: &InMemDicomObject, tag: Tag) -> Option<usize> {
    object.get(tag)?.to_int().ok()
}
