//! Thumbnail frames of a run for its report page.

use image::{GrayImage, imageops};

use insonify_imaging::synth::Frame;

/// Maximum number of frames of the slider.
const MAX: u64 = 60;
/// Largest width of a thumbnail, pixels.
const WIDE: usize = 320;
/// Grey levels are reduced to this many bits: finer ones only enlarge the file.
const BITS: u32 = 6;

/// A recorded frame.
#[derive(Clone, Debug)]
pub(super) struct Shot {
    /// Frame number from 0, and time, s.
    pub number: u64,
    pub time_s: f64,
    /// Depth of the tip, and its distance from the nearest target, mm.
    pub inserted_mm: f64,
    pub target_mm: Option<f64>,
    pub picture: GrayImage,
}

/// Frames recorded during a run: the first, the deepest, the nearest to a target, and evenly spaced ones for a slider.
#[derive(Clone, Debug, Default)]
pub(super) struct Film {
    every: u64,
    /// Frames of the slider.
    pub shots: Vec<Shot>,
    deepest: Option<Shot>,
    nearest: Option<Shot>,
}

impl Film {
    /// Creates a film for a run of `frames` frames.
    pub(super) fn new(frames: u64) -> Self {
        Self {
            every: frames.div_ceil(MAX).max(1),
            ..Self::default()
        }
    }

    pub(super) fn add(&mut self, frame: &Frame, number: u64, time_s: f64, inserted_mm: f64, target_mm: Option<f64>) {
        let slides = number.is_multiple_of(self.every);
        let deeper = self
            .deepest
            .as_ref()
            .is_none_or(|deepest| inserted_mm > deepest.inserted_mm);
        let distance = target_mm.unwrap_or(f64::INFINITY);
        let nearer = self
            .nearest
            .as_ref()
            .is_none_or(|least| distance < least.target_mm.unwrap_or(f64::INFINITY));
        if !(slides || deeper || nearer) {
            return;
        }
        let Some(picture) = small(frame) else { return };
        let shot = Shot {
            number,
            time_s,
            inserted_mm,
            target_mm,
            picture,
        };
        if nearer && target_mm.is_some() {
            self.nearest = Some(shot.clone());
        }
        if deeper {
            self.deepest = Some(shot.clone());
        }
        if slides {
            self.shots.push(shot);
        }
    }

    /// First and deepest frame and the one nearest to a target, labelled.
    pub(super) fn chosen(&self) -> Vec<(&'static str, &Shot)> {
        let shots = [
            ("first", self.shots.first()),
            ("deepest", self.deepest.as_ref()),
            ("closest to the target", self.nearest.as_ref()),
        ];
        shots
            .into_iter()
            .filter_map(|(name, shot)| Some((name, shot?)))
            .collect()
    }
}

impl Shot {
    /// Caption of the frame.
    pub(super) fn caption(&self) -> String {
        let target = self
            .target_mm
            .map_or(String::new(), |mm| format!(", {mm:.1} mm from the target"));
        format!(
            "frame {}, {:.2} s: tip {:.1} mm deep{target}",
            self.number, self.time_s, self.inserted_mm
        )
    }
}

/// Downscales a frame; `None` if its pixels do not match its size.
fn small(frame: &Frame) -> Option<GrayImage> {
    let (width, height) = (u32::try_from(frame.width).ok()?, u32::try_from(frame.height).ok()?);
    let whole = GrayImage::from_raw(width, height, frame.pixels.clone())?;
    let share = WIDE as f64 / f64::from(width);
    let mut picture = if share < 1.0 {
        imageops::thumbnail(&whole, WIDE as u32, (f64::from(height) * share).round().max(1.0) as u32)
    } else {
        whole
    };
    let low = 8 - BITS;
    picture
        .iter_mut()
        .for_each(|grey| *grey = *grey >> low << low | *grey >> BITS);
    Some(picture)
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix4;

    use super::*;

    #[test]
    fn a_long_run_keeps_few_frames_and_those_that_matter() {
        let mut film = Film::new(500);
        let mut frame = Frame {
            pixels: vec![200; 640 * 480],
            width: 640,
            height: 480,
            image_to_world: Matrix4::identity(),
            pixel_mm: 0.3,
            needle: None,
            left_out: 0,
            layers: Vec::new(),
        };
        for number in 0..500u64 {
            frame.pixels.fill(number as u8);
            // Inserted until frame 251, past the target at 201, and withdrawn.
            let depth = 251.0 - (number as f64 - 251.0).abs();
            film.add(&frame, number, number as f64 * 0.04, depth, Some((depth - 201.0).abs()));
        }
        assert!(film.shots.len() <= 60 && film.shots.len() > 50, "{}", film.shots.len());
        let chosen: Vec<_> = film.chosen().iter().map(|(name, shot)| (*name, shot.number)).collect();
        assert_eq!(chosen, [("first", 0), ("deepest", 251), ("closest to the target", 201)]);
        let shot = &film.shots[1];
        assert_eq!(shot.picture.dimensions(), (320, 240));
        let address = insonify_report::page::address(&shot.picture).expect("a picture");
        assert!(address.starts_with("data:image/png;base64,iVBOR"));
    }
}
