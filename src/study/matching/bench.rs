//! Measurement bench: a real frame resampled to scanlines by samples, its windows, and phantoms rendered at its pixels.

use super::model::rounded;
use super::outline::{Outline, Shape};
use super::{DepthMeasurements, WindowMeasurements, refuse};
use crate::realism::picture::Picture;
use crate::realism::texture::{Patch, Texture, Window, uniform_windows};
use insonify::Error;
use insonify_base::parallel;
use insonify_base::statistics::{mean, median, std};
use insonify_imaging::anatomies::{Acoustics, uniform};
use insonify_imaging::effects::Effects;
use insonify_imaging::effects::shadow::SOFT_TISSUE_DB_CM_MHZ;
use insonify_imaging::synth::tables::Settings;
use insonify_imaging::synth::{Backend, FrameState, SynthError, Synthesizer};
use insonify_tracking::probe::{BeamGrid, ImageGrid, Linear, Probe, ProbeShape};

/// Size of a window in scanlines and samples.
pub(super) const WINDOW: [usize; 2] = [48, 40];
/// Radius of the array, as a share of the far radius, below which a fan that shows no array counts as starting in one
/// point.
const PHASED: f64 = 0.05;
/// Ratio of rendered to measured scanlines and samples (measured a pixel apart): scan conversion would blur coarser
/// grids.
const FINER: f64 = 1.5;
/// Maximum number of rendered scanlines and samples.
const FINEST: [f64; 2] = [1024.0, 2048.0];
/// Number of phantoms per round, with different speckle: with only as many windows as the frame they would scatter as
/// much.
const PHANTOMS: u64 = 3;
/// Number of depths with windows.
pub(super) const DEPTHS: usize = 5;
/// Number of windows at each depth.
pub(super) const WINDOWS: usize = 5;
/// Accepted mean grey levels of windows: in-vivo frames have a median of 18 to 24, and much of a darker window is
/// black.
const GREY: [f64; 2] = [20.0, 200.0];
/// Largest unevenness of a uniform window: range of means, plus range of standard deviations, of its quarters, in its
/// own standard deviations. Quarters of 20 to 30 speckle cells range over 0.7 by chance, steps and layers over 1.5 and
/// more.
pub(super) const UNEVEN: f64 = 1.3;

/// A real frame and its measurement grid.
pub(super) struct Bench<'a> {
    pub picture: &'a Picture,
    pub mask: Vec<bool>,
    pub probe: Probe,
    pub grid: BeamGrid,
    pub image: ImageGrid,
    pub seed: u64,
    /// Dynamic range that is not estimated, dB: stated, or the default where the frame does not tell it.
    pub range_db: Option<f64>,
    /// Windows by depth, in scanlines and samples.
    pub windows: Vec<Vec<Window>>,
}

impl<'a> Bench<'a> {
    pub(super) fn new(
        picture: &'a Picture,
        mask: Vec<bool>,
        outline: Outline,
        mm: f64,
        range_db: Option<f64>,
        seed: u64,
    ) -> Result<Self, Error> {
        let (probe_shape, depth, across, origin) = match outline.shape {
            Shape::Rectangle { columns, rows } => {
                let width = columns[1] - columns[0];
                let shape = ProbeShape::Linear(Linear {
                    width_mm: rounded(width * mm),
                });
                (
                    shape,
                    rows[1] - rows[0],
                    width,
                    [0.5 * (columns[0] + columns[1]), rows[0]],
                )
            }
            Shape::Fan { apex, radii, half } => {
                let angle_deg = rounded(2.0 * half.to_degrees());
                // A phased array fans out from a point and shows no array surface.
                let phased = !outline.seen[0] && radii[0] < PHASED * radii[1];
                let start = if phased { 0.0 } else { radii[0] };
                let shape = ProbeShape::sector(rounded(start * mm), angle_deg);
                (
                    shape,
                    radii[1] - start,
                    half * (start + radii[1]),
                    [apex[0], apex[1] + start],
                )
            }
        };
        // Measured one pixel apart, with scanlines at the mid-depth of the sector.
        let [lines, samples] = [across, depth].map(|pixels| pixels.max(64.0).round());
        let measured = Probe {
            shape: probe_shape,
            depth_mm: rounded(depth * mm),
            frequency_mhz: probe_shape.kind().usual_frequency_mhz(),
            lines: lines as u32,
            samples: samples as u32,
            aperture: Default::default(),
        };
        let probe = Probe {
            lines: (FINER * lines).min(FINEST[0]) as u32,
            samples: (FINER * samples).min(FINEST[1]) as u32,
            ..measured
        };
        let grid = BeamGrid::new(&measured).map_err(|error| {
            refuse(
                picture,
                &format!("a sector whose {error}"),
                "the size of a pixel, or the depth, to be that of this frame",
            )
        })?;
        let image = ImageGrid::new(picture.width, picture.height, mm, origin.map(|pixel| -pixel * mm));
        let image = image.map_err(SynthError::from)?;
        let mut bench = Self {
            picture,
            mask,
            probe,
            grid,
            image,
            seed,
            range_db,
            windows: Vec::new(),
        };
        bench.windows = bench.uniform_windows();
        Ok(bench)
    }

    /// Windows of uniform tissue in the real frame, by depth.
    fn uniform_windows(&self) -> Vec<Vec<Window>> {
        let (beam, inside) = self.beam(self.picture);
        let band = self.grid.samples() / self.bands();
        let mut windows: Vec<Vec<Window>> = (0..self.bands())
            .map(|level| {
                let rows = level * band..(level + 1) * band;
                let mask: Vec<bool> = (0..inside.len())
                    .map(|pixel| inside[pixel] && rows.contains(&(pixel / beam.width)))
                    .collect();
                uniform_windows(&beam, &mask, WINDOW, WINDOWS, GREY)
            })
            .collect();
        let uniform = |window: &Window| unevenness(&Patch::of(&beam.grey, beam.width, *window)) <= UNEVEN;
        if windows.iter().flatten().any(uniform) {
            windows.iter_mut().for_each(|windows| windows.retain(uniform));
        }
        windows.retain(|windows| !windows.is_empty());
        windows
    }

    pub(super) fn bands(&self) -> usize {
        (self.grid.samples() / (WINDOW[1] + 8)).clamp(1, DEPTHS)
    }

    /// Resamples a frame to scanlines by samples, with a mask of those inside the sector of the real frame and not
    /// under its overlay.
    pub(super) fn beam(&self, frame: &Picture) -> (Picture, Vec<bool>) {
        let (lines, samples) = (self.grid.lines(), self.grid.samples());
        let (mut grey, mut inside) = (Vec::with_capacity(lines * samples), Vec::with_capacity(lines * samples));
        for (sample, line) in (0..samples).flat_map(|sample| (0..lines).map(move |line| (sample, line))) {
            let [x, y] = self.grid.to_plane(line as f64, sample as f64);
            let [x, y] = self.image.to_pixel(x, y);
            let is_inside = x >= 0.0 && y >= 0.0 && x < (frame.width - 1) as f64 && y < (frame.height - 1) as f64;
            if !is_inside {
                grey.push(0.0);
                inside.push(false);
                continue;
            }
            let (across, below) = (x.fract(), y.fract());
            let pixel = y as usize * frame.width + x as usize;
            let row = |pixel: usize| frame.grey[pixel] * (1.0 - across) + frame.grey[pixel + 1] * across;
            grey.push(row(pixel) * (1.0 - below) + row(pixel + frame.width) * below);
            // All four pixels that the sample was made of: one of them under the overlay would tint it.
            let corners = [pixel, pixel + 1, pixel + frame.width, pixel + frame.width + 1];
            let hidden = |pixel: &usize| self.picture.overlay.get(*pixel).copied().unwrap_or(false);
            inside.push(corners.iter().all(|&pixel| self.mask[pixel]) && !corners.iter().any(hidden));
        }
        let beam = Picture {
            width: lines,
            height: samples,
            grey,
            ..Picture::default()
        };
        (beam, inside)
    }

    /// Renders frames of one tissue at the pixels of the real frame.
    pub(super) fn phantoms(
        &self,
        probe: Probe,
        effects: &Effects,
        acoustics: Acoustics,
    ) -> Result<Vec<Picture>, SynthError> {
        let mut settings = Settings::new(probe, [self.picture.width, self.picture.height], effects.clone());
        settings.seed = self.seed;
        settings.image.placed = Some(self.image);
        let tissue = Acoustics {
            attenuation_db_cm_mhz: SOFT_TISSUE_DB_CM_MHZ,
            ..acoustics
        };
        let mut synth = Synthesizer::new(uniform(tissue), settings.clone(), Backend::Cpu)?;
        let seeds = (0..PHANTOMS).map(|n| self.seed.wrapping_add(n));
        let frame = |seed| {
            synth.set(Settings {
                seed,
                ..settings.clone()
            })?;
            let frame = synth.render(&FrameState::at(nalgebra::Matrix4::identity()))?;
            Ok(Picture {
                width: frame.width,
                height: frame.height,
                grey: frame.pixels.iter().map(|&grey| f64::from(grey)).collect(),
                ..Picture::default()
            })
        };
        seeds.map(frame).collect()
    }

    pub(super) fn depth_mm(&self, window: Window) -> f64 {
        (window.y as f64 + window.height as f64 / 2.0) * self.grid.sample_spacing_mm()
    }

    /// Returns the widths of the autocorrelation in a window, mm.
    pub(super) fn widths(&self, texture: &Texture, depth_mm: f64) -> [Option<f64>; 2] {
        let spacing = [self.grid.sample_spacing_mm(), self.grid.lateral_spacing_mm(depth_mm)];
        [0, 1].map(|axis| Some(texture.fwhm[axis]? * spacing[axis]))
    }

    /// Measures frames, of which there must be at least one.
    pub(super) fn measure(&self, mut frames: Vec<Picture>) -> WindowMeasurements {
        let beams: Vec<Picture> = frames.iter().map(|frame| self.beam(frame).0).collect();
        let (mut windows, mut grey, mut depths) = (Vec::new(), Vec::new(), Vec::new());
        // Medians, as a window may hold a vessel.
        for group in &self.windows {
            let places: Vec<f64> = group.iter().map(|&window| self.depth_mm(window)).collect();
            let patch = |beam: &Picture, window: Window| Patch::of(&beam.grey, beam.width, window);
            let patches = beams
                .iter()
                .flat_map(|beam| group.iter().map(move |&window| patch(beam, window)));
            let patches: Vec<Patch> = patches.collect();
            let textures: Vec<Texture> = parallel::map(&patches[..], &Patch::texture);
            grey.extend(patches.into_iter().flat_map(|patch| patch.values));
            let median_of =
                |value: &dyn Fn(usize) -> Option<f64>| median((0..textures.len()).filter_map(value).collect());
            let width =
                |axis: usize| median_of(&|window| self.widths(&textures[window], places[window % places.len()])[axis]);
            depths.push(DepthMeasurements {
                depth_mm: mean(&places),
                windows: group.len(),
                grey: median_of(&|window| Some(textures[window].mean)).unwrap_or_default(),
                grey_std: median_of(&|window| Some(textures[window].std)).unwrap_or_default(),
                axial_mm: width(0),
                lateral_mm: width(1),
            });
            windows.push(textures);
        }
        let inside = |frame: &Picture| -> Vec<f64> {
            let pixels = frame.grey.iter().zip(&self.mask).filter(|(_, inside)| **inside);
            pixels.map(|(grey, _)| *grey).collect()
        };
        let lags = |axis: usize| {
            let correlation = |lag: usize| {
                let correlations = windows
                    .iter()
                    .flatten()
                    .map(|texture: &Texture| texture.autocorrelation[axis][lag]);
                mean(&correlations.collect::<Vec<f64>>())
            };
            (0..WINDOW[0].min(WINDOW[1]) / 2).map(correlation).collect()
        };
        WindowMeasurements {
            depths,
            histogram: histogram(&grey),
            sector_histogram: histogram(&frames.iter().flat_map(inside).collect::<Vec<f64>>()),
            autocorrelation_axial: lags(0),
            autocorrelation_lateral: lags(1),
            windows,
            frame: frames.swap_remove(0),
        }
    }
}

/// Returns the range of means, plus the range of standard deviations, of the quarters of a window, in its own standard
/// deviations.
pub(super) fn unevenness(patch: &Patch) -> f64 {
    let (width, height) = (patch.width / 2, patch.height / 2);
    let quarters = [(0, 0), (width, 0), (0, height), (width, height)];
    let values = quarters.map(|(x, y)| Patch::of(&patch.values, patch.width, Window { x, y, width, height }).values);
    let range = |statistic: fn(&[f64]) -> f64| {
        let statistics = values.each_ref().map(|values| statistic(values));
        statistics.iter().fold(f64::MIN, |a, b| a.max(*b)) - statistics.iter().fold(f64::MAX, |a, b| a.min(*b))
    };
    (range(mean) + range(std)) / std(&patch.values)
}

/// Returns the shares of grey levels 0 to 255.
pub(super) fn histogram(greys: &[f64]) -> Vec<f64> {
    let mut shares = vec![0.0; 256];
    greys
        .iter()
        .for_each(|grey| shares[grey.round().clamp(0.0, 255.0) as usize] += 1.0 / greys.len() as f64);
    shares
}
