//! B-mode frames from echoes: envelope, log compression, scan conversion.

use std::ops::RangeInclusive;

use insonify_base::parallel;

use super::file::Echoes;
use super::signal::Lines;
use insonify_tracking::probe::{BeamGrid, ImageGrid, OUTSIDE, scan_map};

/// Dynamic ranges, dB.
pub const RANGE_DB: RangeInclusive<f64> = 10.0..=200.0;
/// Share of the samples that may be brighter than white.
const SATURATED: f64 = 0.001;

/// Envelope of a frame, line by line.
pub fn envelope(echoes: &Echoes, frame: usize) -> Vec<f32> {
    let values = &echoes.frames[frame];
    if echoes.baseband {
        values.chunks_exact(2).map(|iq| iq[0].hypot(iq[1])).collect()
    } else {
        Lines::new(echoes.samples).envelope(values)
    }
}

/// Envelope that becomes white: that of the brightest thousandth of the samples.
pub fn white(envelope: &[f32]) -> f32 {
    let mut sorted = envelope.to_vec();
    let rank = ((1.0 - SATURATED) * sorted.len() as f64) as usize;
    let (_, level, _) = sorted.select_nth_unstable_by(rank.min(envelope.len() - 1), f32::total_cmp);
    level.max(f32::MIN_POSITIVE)
}

/// Grey levels of an envelope, line by line: 255 at `white`, 0 at `range_db` below.
pub fn grey(envelope: &[f32], white: f32, range_db: f64) -> Vec<f32> {
    let level = |value: &f32| 20.0 * (value / white).max(1e-20).log10();
    let grey = |db: f32| (255.0 * (1.0 + f64::from(db) / range_db)).clamp(0.0, 255.0) as f32;
    parallel::map(envelope, &|value| grey(level(value)))
}

/// Scan conversion of grey levels, bilinear between lines and samples; `fill` outside the sector. Lines with more
/// samples than pixels are averaged along their depth first.
pub fn scan_converted(grey: &[f32], beam: &BeamGrid, image: &ImageGrid, fill: u8) -> Vec<u8> {
    let (lines, samples) = (beam.lines(), grey.len() / beam.lines());
    let wide = ((image.pixel_mm() / (beam.depth_mm() / samples as f64)).round() as usize).max(1);
    let rows = samples / wide;
    let mean = |row: usize| {
        let start = row / rows * samples + row % rows * wide;
        grey[start..start + wide].iter().sum::<f32>() / wide as f32
    };
    let averaged: Vec<f32> = (0..lines * rows).map(mean).collect();
    let scale = rows as f32 / beam.samples() as f32;
    // Positions count samples of the beam's grid, averages cover `wide` echoes each: both are centred on half samples.
    let value = |[line, sample]: [f32; 2]| {
        let sample = (sample + 0.5) * scale - 0.5;
        let neighbours = |position: f32, count: usize| {
            let position = position.clamp(0.0, (count - 1) as f32);
            let low = (position as usize).min(count.saturating_sub(2));
            (low, position - low as f32, (low + 1).min(count - 1))
        };
        let ((l0, u, l1), (s0, v, s1)) = (neighbours(line, lines), neighbours(sample, rows));
        let along = |l: usize| averaged[l * rows + s0] * (1.0 - v) + averaged[l * rows + s1] * v;
        (along(l0) * (1.0 - u) + along(l1) * u).round() as u8
    };
    let map = scan_map(beam, image, 0..image.height());
    let pixel = |position: &[f32; 2]| if *position == OUTSIDE { fill } else { value(*position) };
    parallel::map(&map[..], &pixel)
}
