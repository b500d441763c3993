//! Submission of frames, and read-back: of pixels and ground truth in flight, and of the results along the beam.

use super::{GpuExecutor, Submission};
use crate::effects::buffers::{self, AMPLITUDE, Buffer, ELEMENT, LABEL, LOSS, NEEDLE_MASK, PIXELS, POSITION};
use crate::effects::truth::{self, LAYERS};
use crate::plan::Plan;
use crate::synth::layers::{Beam, numbered};
use crate::synth::tables::Tables;
use crate::synth::{Frame, SynthError};
use insonify_gpu::{GpuError, Readback, StorageBuffer};

impl GpuExecutor {
    /// Keeps read-backs and the host's texture as long as the image size does not change.
    pub(super) fn fit_outputs(&mut self, tables: &Tables) -> Result<(), GpuError> {
        let sizes = self.read_back_sizes(tables);
        let kept = self
            .ring
            .first()
            .is_some_and(|first| sizes.into_iter().eq(first.iter().map(Readback::bytes)));
        if !kept {
            self.ring.clear();
            self.reserve_place(tables, 0)?;
        }
        let size = (tables.width() as u32, tables.height() as u32);
        self.texture
            .take_if(|kept| (kept.texture().width(), kept.texture().height()) != size);
        Ok(())
    }

    /// Bytes that come back from a submission: the pixels of each band, and behind them the ground truth, if there is
    /// any.
    fn read_back_sizes(&self, tables: &Tables) -> Vec<u64> {
        let row_bytes = (self.frames * tables.words_per_row() * 4) as u64;
        let pixels = self.bands.iter().map(|band| u64::from(band.rows) * row_bytes);
        let layers = self.buffers.get(&(&LAYERS, 0)).map(StorageBuffer::bytes);
        pixels.chain(layers).collect()
    }

    /// Makes read-backs for the places of the ring up to one.
    fn reserve_place(&mut self, tables: &Tables, place: usize) -> Result<(), GpuError> {
        while self.ring.len() <= place {
            let sizes = self.read_back_sizes(tables).into_iter();
            let readbacks = sizes.map(|bytes| Readback::new(&self.gpu, "frame", bytes));
            self.ring.push(readbacks.collect::<Result<_, _>>()?);
        }
        Ok(())
    }

    /// Submits the frames that have been staged, whose pixels are asked for at a place of the ring.
    pub(crate) fn submit(&mut self, tables: &Tables, count: usize, place: usize) -> Result<Submission, SynthError> {
        let gpu = self.gpu.clone();
        let submitted = gpu.scoped("frame", || {
            self.reserve_place(tables, place)?;
            self.upload(self.timers.is_some())?;
            let submission = gpu.submit("frame", |recorder| {
                self.run_all(recorder, count)?;
                let pixels = (0..self.bands.len()).map(|part| (&PIXELS, part));
                for (source, readback) in pixels.chain([(&LAYERS, 0)]).zip(&self.ring[place]) {
                    let bytes = readback.bytes() / self.frames as u64 * count as u64;
                    recorder.read_back_part(&self.buffers[&source], 0..bytes, readback)?;
                }
                Ok(())
            })?;
            self.ring[place].iter().for_each(Readback::request);
            Ok(submission)
        });
        if submitted.is_err() {
            self.release(place);
        }
        // The maps of several frames lie elsewhere than those of one.
        self.resend |= submitted.is_err() || count > 1;
        submitted
    }

    /// Whether the pixels of a place have come; never waits.
    pub(crate) fn is_ready(&self, place: usize) -> Result<bool, SynthError> {
        self.gpu.poll_once()?;
        Ok(self.ring[place].iter().all(Readback::is_ready))
    }

    /// Waits for a submission, and copies the pixels of its frames.
    pub(crate) fn take(
        &mut self,
        (plan, tables): (&Plan, &Tables),
        submission: Submission,
        place: usize,
        frames: &mut [Frame],
    ) -> Result<(), SynthError> {
        let gpu = self.gpu.clone();
        gpu.scoped("pixels", || {
            let waited = gpu.wait_for("a frame", Some(submission));
            let (width, stride) = (tables.width(), tables.words_per_row() * 4);
            let copied = waited.and_then(|()| {
                for (at, frame) in frames.iter_mut().enumerate() {
                    for (band, readback) in self.bands.iter().zip(&self.ring[place]) {
                        let rows = &mut frame.pixels[band.first_row as usize * width..][..band.rows as usize * width];
                        readback.copy_rows(at * band.rows as usize * stride, rows, width, stride)?;
                    }
                    if let Some(readback) = self.ring[place].get(self.bands.len()) {
                        let bytes = readback.bytes() as usize / self.frames;
                        self.layers.resize(bytes / 4, 0);
                        readback.copy_rows(at * bytes, bytemuck::cast_slice_mut(&mut self.layers), bytes, bytes)?;
                    }
                    truth::images(tables, &self.layers, |value| value as u16, &mut frame.layers);
                }
                Ok(())
            });
            self.release(place);
            copied?;
            self.read_times(plan)
        })
    }

    /// Gives up the pixels of a place.
    pub(crate) fn release(&self, place: usize) {
        for readback in self.ring.get(place).into_iter().flatten() {
            readback.release(&self.gpu);
        }
    }

    /// Reads the beam-space results of the last frame, relative to the local origin, as they were after the last
    /// executed pass.
    pub(crate) fn beam(&self, flipped: bool, tables: &Tables) -> Result<Beam, SynthError> {
        let count = tables.lines() * tables.samples();
        let words = |buffer: &'static Buffer, per_sample: usize| -> Result<Vec<u32>, GpuError> {
            // Scenes without the passes that bind a buffer have none; its field of the beam stays empty.
            let Some(buffer) = self.buffers.get(&(buffer, 0)) else {
                return Ok(Vec::new());
            };
            let mut readback = Readback::new(&self.gpu, "beam", (count * per_sample * 4) as u64)?;
            let mut words = vec![0u32; count * per_sample];
            // Frames of a submission lie one behind the other in the buffer.
            let (start, bytes) = (self.last as u64 * buffer.bytes() / self.frames as u64, readback.bytes());
            self.gpu.submit("beam", |recorder| {
                recorder.read_back_part(buffer, start..start + bytes, &readback)
            })?;
            readback.read(&self.gpu, &mut words)?;
            Ok(words)
        };
        let numbers =
            |words: Vec<u32>| -> Vec<f64> { words.into_iter().map(|word| f64::from(f32::from_bits(word))).collect() };
        let mask = numbers(words(&NEEDLE_MASK, 2)?);
        let elements = self
            .slabs
            .get(self.last)
            .map_or(&[][..], |slab| &slab.deformed.elements);
        Ok(Beam {
            lines: tables.lines(),
            samples: tables.samples(),
            position: numbers(words(&POSITION, 4)?)
                .chunks_exact(4)
                .map(|p| [p[0], p[1], p[2], p[3]])
                .collect(),
            element: numbered(elements, words(&ELEMENT, 1)?),
            label: words(&LABEL, 1)?.into_iter().map(|word| word as u8).collect(),
            amplitude: numbers(words(buffers::bound(&AMPLITUDE, flipped), 1)?),
            needle: mask.iter().step_by(2).copied().collect(),
            shade: mask.iter().skip(1).step_by(2).copied().collect(),
            loss: words(&LOSS, 1)?,
        })
    }
}
