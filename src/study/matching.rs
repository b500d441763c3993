//! Analysis by synthesis: probe and effects with which frames look like a real one, estimated from that frame alone.
//!
//! The sector's outline gives the probe ([`outline`]). The frame is resampled to scanlines by samples, and its most uniform windows over depth are
//! measured: standard deviation of grey levels, widths of the autocorrelation, mean. A uniform phantom is rendered under the same probe, resampled
//! to the same windows and measured in the same way, and parameters are corrected by the ratios of the figures until these agree: dynamic range
//! by that of standard deviations, lengths of the point spread by those of widths, the gain at each depth by the difference of means. Then
//! dark windows are put against those of a phantom that does not echo, for noise and clutter. Whatever a window, a log scale or a blur does to a figure
//! it does to both sides.
//!
//! Automatic gain is off and the curve straight: both depend on what is in the frame, and a straight curve is the one under which a spread of grey
//! levels is a dynamic range. Compensation is twice 0.5 dB/cm/MHz of soft tissue plus what the frame departs from that, so that other tissue keeps
//! its own loss.

pub mod outline;
mod report;

use serde::Serialize;

use super::anatomies::{Acoustics, PLAIN, SILENT, uniform};
use super::realism::picture::Picture;
use super::realism::texture::{Patch, Texture, Window, dark_windows, uniform_windows};
use super::realism::{DARK_WINDOW, sector_of};
use super::spread::percentile;
use super::statistics::{mean, slope, std};
use crate::effects::point_spread::{self, PointSpread};
use crate::effects::receiver::Receiver;
use crate::effects::tone::{MID_GREY, SOFT_TISSUE_DB_CM_MHZ, Tone};
use crate::effects::{Effects, blur::Blur, speckle::Speckle};
use crate::error::Error;
use crate::phantom::Phantom;
use crate::scene::{ImageSpec, SceneFile, VolumeSpec};
use crate::synth::tables::{ImageSize, Settings};
use crate::synth::{Backend, FrameState, SynthError, Synthesizer};
use crate::tracking::probe::{BeamGrid, ImageGrid, Probe, ProbeKind, ProbeShape, ProbeSpec};
use crate::volume::{At, VolumeError};
use outline::{Outline, Shape};

/// Scanlines and samples of a window.
const WINDOW: [usize; 2] = [48, 40];
/// Depths at which windows are sought, and windows at each.
const DEPTHS: usize = 5;
const WINDOWS: usize = 5;
/// Mean grey levels of windows: in-vivo frames have a median of 18 to 24, and of darker windows much is black.
const GREY: [f64; 2] = [20.0, 200.0];
/// Range of means, plus range of standard deviations, of the quarters of a window, in its own standard deviations, up to which it counts as
/// uniform. Quarters of 20 to 30 speckle cells range over 0.7 by chance, steps and layers over 1.5 and more.
const UNEVEN: f64 = 1.3;
/// Rounds of correction at most, and the change in all figures below which they end (gain: as many tenths of a dB).
const ROUNDS: usize = 8;
const SETTLED: f64 = 0.01;
/// Corrections of noise and clutter.
const DARK_ROUNDS: usize = 3;
/// Width of the blur, as the default has it over the lateral length: 2.1 mm over 5.25 mm at 1 MHz, and 0.21 mm/cm.
const BLUR: [f64; 2] = [0.4, 0.04];
/// Spread of lateral widths over depth up to which they are taken for constant, share.
const CONSTANT: f64 = 0.05;
/// How much wider the beam must be at either end of the windows for its focus to count as seen.
const FOCUSED: f64 = 1.1;
/// Difference in depth over which a fading of clutter is fitted, mm.
const FADING_MM: f64 = 10.0;

/// A figure of the frame.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Figure {
    /// Its key in a scene.
    pub key: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// Its value.
    pub value: f64,
    /// Its standard deviation over windows; none of a figure that is not made of windows.
    pub spread: Option<f64>,
}

/// What the frame does not tell.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Unidentified {
    /// What.
    pub what: &'static str,
    /// Why, and what stands in the scene.
    pub why: String,
}

/// Means over the windows at one depth.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AtDepth {
    /// Their mean depth, mm.
    pub depth_mm: f64,
    /// How many there are.
    pub windows: usize,
    /// Mean grey level.
    pub grey: f64,
    /// Standard deviation of grey levels, a trend removed.
    pub grey_std: f64,
    /// Full width at half maximum of the autocorrelation along the beam, mm; none where it stays above one half.
    pub axial_mm: Option<f64>,
    /// The same across.
    pub lateral_mm: Option<f64>,
}

/// What windows of one frame come to.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Side {
    /// By depth.
    pub depths: Vec<AtDepth>,
    /// Shares of the windows at each grey level.
    pub histogram: Vec<f64>,
    /// The same of the sector.
    pub sector_histogram: Vec<f64>,
    /// Mean autocorrelation along the beam, each sample.
    pub autocorrelation_axial: Vec<f64>,
    /// The same across, each scanline.
    pub autocorrelation_lateral: Vec<f64>,
    #[serde(skip)]
    windows: Vec<Texture>,
    #[serde(skip)]
    frame: Picture,
}

/// Distance of histograms of grey levels from those of the real frame (Wasserstein-1: mean difference of equal quantiles), grey levels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Score {
    /// Of the windows.
    pub windows: f64,
    /// Of the whole sector, whose anatomy a uniform phantom has not.
    pub sector: f64,
}

/// A real frame and what it is matched by.
#[derive(Clone, Debug, Serialize)]
pub struct Match {
    /// The frame.
    pub name: String,
    /// Side of a pixel, mm.
    pub mm_per_pixel: f64,
    /// The sector in pixels.
    pub sector: Outline,
    /// Rounds of correction, and the last change, share.
    pub rounds: usize,
    /// The largest share by which a figure changed in the last round.
    pub residual: f64,
    /// Every figure.
    pub figures: Vec<Figure>,
    /// What the frame does not tell.
    pub unidentified: Vec<Unidentified>,
    /// What is doubtful about this frame.
    pub notes: Vec<String>,
    /// The real frame.
    pub real: Side,
    /// The uniform phantom with the figures found.
    pub matched: Side,
    /// The uniform phantom with the default effects of the kind of probe.
    pub default: Side,
    /// How far the phantom with the figures found is from the real frame.
    pub score: Score,
    /// How far that with default effects is.
    pub default_score: Score,
    /// A scene that can be rendered: the figures, under a phantom to be replaced.
    pub scene: String,
}

/// The parameters that are looked for.
#[derive(Clone, Debug)]
struct Model {
    axial_mm: f64,
    lateral_mm: f64,
    focus_mm: f64,
    focal_zone_mm: f64,
    tone: Tone,
    receiver: Receiver,
}

/// A value to four significant digits, as files show it.
fn rounded(value: f64) -> f64 {
    let digits = (3.0 - value.abs().max(1e-3).log10().floor()) as i32;
    let scale = 10f64.powi(digits);
    (value * scale).round() / scale
}

impl Model {
    /// Effects as by default under a probe, but for automatic gain and the curve.
    fn start(probe: &Probe) -> Self {
        let spread = PointSpread::new(&Speckle::default(), probe);
        Self {
            axial_mm: spread.axial_mm,
            lateral_mm: spread.lateral_mm,
            focus_mm: spread.focus_mm,
            focal_zone_mm: 1e4,
            tone: Tone::linear(),
            receiver: Receiver::default(),
        }
    }

    /// The frequency whose default point spread has this axial length, MHz, within those of clinical probes.
    fn frequency_mhz(&self) -> f64 {
        rounded((point_spread::AXIAL_MM / self.axial_mm).clamp(1.0, 20.0))
    }

    fn tgc_db_cm(&self) -> f64 {
        2.0 * SOFT_TISSUE_DB_CM_MHZ * self.frequency_mhz()
    }

    fn probe(&self, probe: Probe) -> Probe {
        let frequency_mhz = self.frequency_mhz();
        Probe { frequency_mhz, ..probe }
    }

    /// The usual effects with these parameters, rounded as they are written.
    fn effects(&self) -> Effects {
        let [lateral, axial] = [self.lateral_mm, self.axial_mm].map(rounded);
        let tone = Tone {
            gain_db: rounded(self.tone.gain_db),
            tgc_db_cm: Some(self.tgc_db_cm()),
            tgc_points: self.tone.tgc_points.iter().map(|point| point.map(rounded)).collect(),
            dynamic_range_db: rounded(self.tone.dynamic_range_db),
            ..self.tone.clone()
        };
        Effects {
            speckle: Some(Speckle {
                axial_mm: Some(axial),
                lateral_mm: Some(lateral),
                elevational_mm: None,
                focus_mm: Some(rounded(self.focus_mm)),
                focal_zone_mm: Some(rounded(self.focal_zone_mm)),
            }),
            blur: Some(Blur {
                width_mm: Some(rounded(BLUR[0] * lateral)),
                growth_mm_cm: Some(rounded(BLUR[1] * lateral).min(5.0)),
            }),
            receiver: Some(Receiver {
                noise_db: rounded(self.receiver.noise_db),
                clutter_db: rounded(self.receiver.clutter_db),
                clutter_decay_db_cm: rounded(self.receiver.clutter_decay_db_cm),
                ..self.receiver
            }),
            tone: Some(tone),
            ..Effects::usual()
        }
    }

    fn spread(&self, probe: &Probe) -> PointSpread {
        PointSpread::new(&self.effects().speckle.unwrap_or_default(), probe)
    }

    /// Gain and compensation at a depth, dB.
    fn gain_db(&self, depth_mm: f64) -> f64 {
        self.effects()
            .tone
            .map_or(0.0, |tone| tone.gain_at_db(depth_mm, 0.0, None))
    }

    /// Level of a grey before gain, dB relative to the echo of liver at the array.
    fn level_db(&self, grey: f64, depth_mm: f64) -> f64 {
        self.shown_db(grey) - self.gain_db(depth_mm)
    }

    /// Level of a grey after gain, dB.
    fn shown_db(&self, grey: f64) -> f64 {
        (grey / 255.0 - MID_GREY) * self.tone.dynamic_range_db
    }

    /// Takes the lateral lengths at some depths for those of a Gaussian beam about its focus, by least squares of their logarithms.
    fn focus(&mut self, depths: &[[f64; 2]], depth_mm: f64) {
        let fit = |focus: f64, zone: f64| {
            let shape = |depth: f64| (1.0 + ((depth - focus) / zone).powi(2)).sqrt().ln();
            let rest: Vec<f64> = depths.iter().map(|[depth, width]| width.ln() - shape(*depth)).collect();
            let middle = mean(&rest);
            (
                rest.iter().map(|r| (r - middle).powi(2)).sum::<f64>(),
                middle.exp(),
                focus,
                zone,
            )
        };
        let mut best = fit(depth_mm / 2.0, 1e4);
        if best.0 > depths.len() as f64 * CONSTANT * CONSTANT && depths.len() > 2 {
            for focus in (0..=40).map(|n| f64::from(n) / 40.0 * depth_mm) {
                // From a fiftieth of the depth to twice of it.
                for zone in (0..=40).map(|n| 0.02 * 100f64.powf(f64::from(n) / 40.0) * depth_mm) {
                    let tried = fit(focus, zone.max(1.0));
                    if tried.0 < best.0 {
                        best = tried;
                    }
                }
            }
        }
        (self.lateral_mm, self.focus_mm, self.focal_zone_mm) = (best.1.clamp(0.05, 20.0), best.2, best.3);
    }
}

/// A real frame, and where on it is measured.
struct Bench<'a> {
    picture: &'a Picture,
    mask: Vec<bool>,
    probe: Probe,
    grid: BeamGrid,
    image: ImageGrid,
    seed: u64,
    /// Windows by depth, of scanlines and samples.
    windows: Vec<Vec<Window>>,
}

impl<'a> Bench<'a> {
    fn new(picture: &'a Picture, mask: Vec<bool>, shape: Shape, mm: f64, seed: u64) -> Result<Self, Error> {
        let (probe_shape, depth, across, origin) = match shape {
            Shape::Rectangle { columns, rows } => {
                let width = columns[1] - columns[0];
                let shape = ProbeShape::Linear {
                    width_mm: rounded(width * mm),
                };
                (
                    shape,
                    rows[1] - rows[0],
                    width,
                    [0.5 * (columns[0] + columns[1]), rows[0]],
                )
            }
            Shape::Fan { apex, radii, half } => {
                let angle_deg = rounded(2.0 * half.to_degrees());
                let radius_mm = rounded(radii[0] * mm);
                // A convex array has a radius of 2 mm at least; scanlines that meet nearer than that come from a phased one.
                let (shape, start) = match radius_mm < 2.0 {
                    true => (ProbeShape::Phased { angle_deg }, 0.0),
                    false => (ProbeShape::Curvilinear { radius_mm, angle_deg }, radii[0]),
                };
                (
                    shape,
                    radii[1] - start,
                    half * (start + radii[1]),
                    [apex[0], apex[1] + start],
                )
            }
        };
        let probe = Probe {
            shape: probe_shape,
            depth_mm: rounded(depth * mm),
            frequency_mhz: probe_shape.kind().usual_frequency_mhz(),
            // A pixel apart in the middle of the sector.
            lines: across.round().clamp(64.0, 1024.0) as u32,
            samples: depth.round().clamp(64.0, 2048.0) as u32,
        };
        let grid = BeamGrid::new(&probe).map_err(|error| {
            refuse(
                picture,
                &format!("a sector whose {error}"),
                "the size of a pixel, or the depth, to be that of this frame",
            )
        })?;
        let image = ImageGrid::new(picture.width, picture.height, mm, origin.map(|place| -place * mm));
        let image = image.map_err(SynthError::from)?;
        let mut bench = Self {
            picture,
            mask,
            probe,
            grid,
            image,
            seed,
            windows: Vec::new(),
        };
        let (beam, inside) = bench.beam(picture);
        let band = bench.grid.samples() / bench.bands();
        bench.windows = (0..bench.bands())
            .map(|at| {
                let rows = at * band..(at + 1) * band;
                let mask: Vec<bool> = (0..inside.len())
                    .map(|at| inside[at] && rows.contains(&(at / beam.width)))
                    .collect();
                uniform_windows(&beam, &mask, WINDOW, WINDOWS, GREY)
            })
            .collect();
        let uniform = |window: &Window| unevenness(&Patch::of(&beam.grey, beam.width, *window)) <= UNEVEN;
        if bench.windows.iter().flatten().any(uniform) {
            bench.windows.iter_mut().for_each(|windows| windows.retain(uniform));
        }
        bench.windows.retain(|windows| !windows.is_empty());
        Ok(bench)
    }

    fn bands(&self) -> usize {
        (self.grid.samples() / (WINDOW[1] + 8)).clamp(1, DEPTHS)
    }

    /// A frame as scanlines by samples, and which of these lie in the sector of the real frame, and not under an overlay of it.
    fn beam(&self, frame: &Picture) -> (Picture, Vec<bool>) {
        let (lines, samples) = (self.grid.lines(), self.grid.samples());
        let (mut grey, mut inside) = (Vec::with_capacity(lines * samples), Vec::with_capacity(lines * samples));
        for (sample, line) in (0..samples).flat_map(|sample| (0..lines).map(move |line| (sample, line))) {
            let [x, y] = self.grid.to_plane(line as f64, sample as f64);
            let [x, y] = self.image.to_pixel(x, y);
            let within = x >= 0.0 && y >= 0.0 && x < (frame.width - 1) as f64 && y < (frame.height - 1) as f64;
            if !within {
                grey.push(0.0);
                inside.push(false);
                continue;
            }
            let (across, down) = (x.fract(), y.fract());
            let at = y as usize * frame.width + x as usize;
            let row = |at: usize| frame.grey[at] * (1.0 - across) + frame.grey[at + 1] * across;
            grey.push(row(at) * (1.0 - down) + row(at + frame.width) * down);
            let corners = [at, at + 1, at + frame.width, at + frame.width + 1];
            let hidden = |at: &usize| self.picture.overlay.get(*at).copied().unwrap_or(false);
            inside.push(corners.iter().all(|&at| self.mask[at]) && !corners.iter().any(hidden));
        }
        let beam = Picture {
            width: lines,
            height: samples,
            grey,
            ..Picture::default()
        };
        (beam, inside)
    }

    /// A frame of one tissue at the pixels of the real one.
    fn render(&self, probe: Probe, effects: Effects, acoustics: Acoustics) -> Result<Picture, SynthError> {
        let settings = Settings {
            seed: self.seed,
            probe,
            image: ImageSize {
                width: self.picture.width,
                height: self.picture.height,
                margin: 0.0,
                fill: 0,
                placed: Some(self.image),
            },
            effects,
            has_needle: false,
        };
        let soft = Acoustics {
            attenuation_db_cm_mhz: SOFT_TISSUE_DB_CM_MHZ,
            ..acoustics
        };
        let mut synth = Synthesizer::new(uniform(soft), settings, Backend::Cpu)?;
        let frame = synth.render(&FrameState::at(nalgebra::Matrix4::identity()))?;
        Ok(Picture {
            width: frame.width,
            height: frame.height,
            grey: frame.pixels.iter().map(|&grey| f64::from(grey)).collect(),
            ..Picture::default()
        })
    }

    fn depth_mm(&self, window: Window) -> f64 {
        (window.y as f64 + window.height as f64 / 2.0) * self.grid.sample_spacing_mm()
    }

    /// Widths of the autocorrelation in a window, mm.
    fn widths(&self, texture: &Texture, depth_mm: f64) -> [Option<f64>; 2] {
        let spacing = [self.grid.sample_spacing_mm(), self.grid.lateral_spacing_mm(depth_mm)];
        [0, 1].map(|axis| Some(texture.fwhm[axis]? * spacing[axis]))
    }

    fn side(&self, frame: Picture) -> Side {
        let (beam, _) = self.beam(&frame);
        let mut windows = Vec::new();
        let mut grey = Vec::new();
        let mut depths = Vec::new();
        for group in &self.windows {
            let patches: Vec<Patch> = group
                .iter()
                .map(|&window| Patch::of(&beam.grey, beam.width, window))
                .collect();
            let textures: Vec<Texture> = patches.iter().map(Patch::texture).collect();
            grey.extend(patches.into_iter().flat_map(|patch| patch.values));
            let over = |of: &dyn Fn(usize) -> Option<f64>| median((0..group.len()).filter_map(of).collect());
            let places: Vec<f64> = group.iter().map(|&window| self.depth_mm(window)).collect();
            let width = |axis: usize| over(&|at| self.widths(&textures[at], places[at])[axis]);
            depths.push(AtDepth {
                depth_mm: mean(&places),
                windows: group.len(),
                grey: over(&|at| Some(textures[at].mean)).unwrap_or_default(),
                grey_std: over(&|at| Some(textures[at].std)).unwrap_or_default(),
                axial_mm: width(0),
                lateral_mm: width(1),
            });
            windows.extend(textures);
        }
        let sector = frame
            .grey
            .iter()
            .zip(&self.mask)
            .filter(|(_, inside)| **inside)
            .map(|(grey, _)| *grey);
        let lags = |axis: usize| {
            let at = |lag: usize| {
                mean(
                    &windows
                        .iter()
                        .map(|it| it.autocorrelation[axis][lag])
                        .collect::<Vec<f64>>(),
                )
            };
            (0..WINDOW[0].min(WINDOW[1]) / 2).map(at).collect()
        };
        Side {
            depths,
            histogram: histogram(&grey),
            sector_histogram: histogram(&sector.collect::<Vec<f64>>()),
            autocorrelation_axial: lags(0),
            autocorrelation_lateral: lags(1),
            windows,
            frame,
        }
    }

    fn phantom(&self, model: &Model) -> Result<Side, SynthError> {
        Ok(self.side(self.render(model.probe(self.probe), model.effects(), PLAIN)?))
    }

    /// One round: corrects a model by its phantom. The largest change, as a share.
    fn correct(&self, model: &mut Model, real: &Side, own: &Side) -> f64 {
        let before = model.clone();
        let pairs = || real.windows.iter().zip(&own.windows);
        let ratio = |of: &dyn Fn(&Texture) -> Option<f64>| {
            median(
                pairs()
                    .filter_map(|(real, own)| Some(of(real)? / of(own)?))
                    .filter(|r| r.is_finite() && *r > 0.0)
                    .collect(),
            )
        };
        let range = before.tone.dynamic_range_db / ratio(&|it| Some(it.std)).unwrap_or(1.0);
        model.tone.dynamic_range_db = range.clamp(10.0, 120.0);
        let axial = before.axial_mm * ratio(&|it| it.fwhm[0]).unwrap_or(1.0);
        model.axial_mm = axial.clamp(0.05, 10.0);
        let spread = before.spread(&before.probe(self.probe));
        let lengths = real.depths.iter().zip(&own.depths).filter_map(|(real, own)| {
            let length = spread.lateral_at(real.depth_mm) * real.lateral_mm? / own.lateral_mm?;
            Some([real.depth_mm, length])
        });
        let lengths: Vec<[f64; 2]> = lengths.collect();
        if !lengths.is_empty() {
            model.focus(&lengths, self.probe.depth_mm);
        }
        // Greys of the phantom follow from gain and range, so the gain can be solved for.
        let gains = real.depths.iter().zip(&own.depths).map(|(real, own)| {
            let compensation = before.gain_db(real.depth_mm) - before.tgc_db_cm() * real.depth_mm / 10.0;
            [
                real.depth_mm,
                model.shown_db(real.grey) - before.shown_db(own.grey) + compensation,
            ]
        });
        let gains: Vec<[f64; 2]> = gains.collect();
        let middle = mean(&gains.iter().map(|it| it[1]).collect::<Vec<f64>>());
        let moved = gains.iter().map(|&[depth, gain]| {
            let before = before.gain_db(depth) - before.tgc_db_cm() * depth / 10.0;
            (gain - before).abs()
        });
        let moved = moved.fold(0.0, f64::max);
        model.tone.gain_db = middle.clamp(-60.0, 60.0);
        model.tone.tgc_points = match gains.len() {
            1 => Vec::new(),
            _ => gains.iter().map(|[depth, gain]| [*depth, gain - middle]).collect(),
        };
        let at = |model: &Model, depth: f64| model.spread(&model.probe(self.probe)).lateral_at(depth);
        let lateral = real
            .depths
            .iter()
            .map(|it| at(model, it.depth_mm) / at(&before, it.depth_mm));
        let shares = [
            model.tone.dynamic_range_db / before.tone.dynamic_range_db,
            model.axial_mm / before.axial_mm,
        ];
        let changes = shares.into_iter().chain(lateral).map(|share| share.ln().abs());
        changes.fold(0.1 * moved, f64::max)
    }

    /// Sets noise and clutter by the dark windows of the real frame. What was found.
    fn darkness(&self, model: &mut Model) -> Result<Dark, SynthError> {
        let (beam, inside) = self.beam(self.picture);
        let mut found = Dark::default();
        // Noise shows at no depth above the darkest 2 % of its row.
        let mut bound = f64::INFINITY;
        for sample in 0..beam.height {
            let row = sample * beam.width..(sample + 1) * beam.width;
            let mut greys: Vec<f64> = row.filter(|&at| inside[at]).map(|at| beam.grey[at]).collect();
            greys.sort_by(f64::total_cmp);
            if let Some(grey) = percentile(&greys, 0.02).filter(|_| 2 * greys.len() > beam.width) {
                bound = bound.min(model.level_db(grey, self.grid.sample_depth_mm(sample)));
            }
        }
        found.bound_db = bound.clamp(-200.0, 20.0);
        let spread = model.spread(&model.probe(self.probe));
        let mut windows: [Vec<Window>; 2] = Default::default();
        for window in dark_windows(&beam, &inside, [DARK_WINDOW; 2], DEPTHS * WINDOWS) {
            let depth = self.depth_mm(window);
            let width = self.widths(&Patch::of(&beam.grey, beam.width, window).texture(), depth)[1];
            // Clutter is sound and at least as wide as the beam; noise is not.
            windows[usize::from(width.is_none_or(|width| width >= spread.lateral_at(depth)))].push(window);
        }
        let greys = |frame: &Picture, windows: &[Window]| -> Vec<f64> {
            windows
                .iter()
                .map(|&window| mean(&Patch::of(&frame.grey, frame.width, window).values))
                .collect()
        };
        let real = [0, 1].map(|kind| greys(&beam, &windows[kind]));
        let depths = [0, 1].map(|kind| {
            windows[kind]
                .iter()
                .map(|&window| self.depth_mm(window))
                .collect::<Vec<f64>>()
        });
        found.windows = [windows[0].len(), windows[1].len()];
        let usual = Receiver::default();
        model.receiver.noise_db = usual.noise_db.min(found.bound_db);
        let level = |model: &Model, kind: usize, greys: &[f64]| -> Vec<f64> {
            greys
                .iter()
                .zip(&depths[kind])
                .map(|(grey, depth)| model.level_db(*grey, *depth))
                .collect()
        };
        if !windows[0].is_empty() {
            model.receiver.noise_db = mean(&level(model, 0, &real[0])).clamp(-200.0, 20.0);
        }
        let fade = |model: &Model, depth: f64| model.tgc_db_cm() * depth / 10.0;
        if !windows[1].is_empty() {
            // Level at the array, but for the loss in tissue.
            let levels = level(model, 1, &real[1]);
            let lossless: Vec<f64> = levels
                .iter()
                .zip(&depths[1])
                .map(|(level, depth)| level + fade(model, *depth))
                .collect();
            let extent = depths[1]
                .iter()
                .fold(0.0, |most: f64, d| most.max((d - depths[1][0]).abs()));
            if extent >= FADING_MM {
                found.fades = true;
                model.receiver.clutter_decay_db_cm = (-10.0 * slope(&depths[1], &lossless)).clamp(0.0, 50.0);
            }
            let decay = model.receiver.clutter_decay_db_cm;
            let at_array = lossless
                .iter()
                .zip(&depths[1])
                .map(|(level, depth)| level + decay * depth / 10.0);
            model.receiver.clutter_db = mean(&at_array.collect::<Vec<f64>>()).clamp(-200.0, 20.0);
        }
        // Logarithms, sparse echoes and black make a mean grey of a power: what is left is taken off by the phantom that does not echo.
        for _ in 0..DARK_ROUNDS {
            if windows.iter().all(Vec::is_empty) {
                break;
            }
            let silent = self.render(model.probe(self.probe), model.effects(), SILENT)?;
            let (silent, _) = self.beam(&silent);
            let off = [0, 1].map(|kind| -> Vec<f64> {
                let own = greys(&silent, &windows[kind]);
                let pairs = level(model, kind, &real[kind])
                    .into_iter()
                    .zip(level(model, kind, &own));
                pairs.map(|(real, own)| real - own).collect()
            });
            found.spread_db = [0, 1].map(|kind| (off[kind].len() > 1).then(|| std(&off[kind])));
            if !off[0].is_empty() {
                model.receiver.noise_db = (model.receiver.noise_db + mean(&off[0])).clamp(-200.0, 20.0);
            }
            if !off[1].is_empty() {
                model.receiver.clutter_db = (model.receiver.clutter_db + mean(&off[1])).clamp(-200.0, 20.0);
            }
        }
        Ok(found)
    }
}

/// What dark windows told.
#[derive(Clone, Copy, Debug, Default)]
struct Dark {
    /// Windows of noise and of clutter.
    windows: [usize; 2],
    /// Spread of what they come to, dB.
    spread_db: [Option<f64>; 2],
    /// Whether the fading of clutter was fitted.
    fades: bool,
    /// Level that noise does not exceed, dB.
    bound_db: f64,
}

/// Range of means, plus range of standard deviations, of the quarters of a window, in its own standard deviations.
fn unevenness(patch: &Patch) -> f64 {
    let (width, height) = (patch.width / 2, patch.height / 2);
    let quarters = [(0, 0), (width, 0), (0, height), (width, height)];
    let values = quarters.map(|(x, y)| Patch::of(&patch.values, patch.width, Window { x, y, width, height }).values);
    let range = |of: fn(&[f64]) -> f64| {
        let all = values.each_ref().map(|values| of(values));
        all.iter().fold(f64::MIN, |a, b| a.max(*b)) - all.iter().fold(f64::MAX, |a, b| a.min(*b))
    };
    (range(mean) + range(std)) / std(&patch.values)
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let (low, high) = (
        values.get(values.len().saturating_sub(1) / 2)?,
        values.get(values.len() / 2)?,
    );
    Some(0.5 * (low + high))
}

/// Shares of grey levels 0 to 255.
fn histogram(greys: &[f64]) -> Vec<f64> {
    let mut shares = vec![0.0; 256];
    greys
        .iter()
        .for_each(|grey| shares[grey.round().clamp(0.0, 255.0) as usize] += 1.0 / greys.len() as f64);
    shares
}

/// Wasserstein-1 distance of two histograms: the area between their sums.
fn distance(a: &[f64], b: &[f64]) -> f64 {
    let mut ahead = 0.0;
    let steps = a.iter().zip(b).map(|(a, b)| {
        ahead += a - b;
        f64::abs(ahead)
    });
    steps.sum()
}

fn refuse(picture: &Picture, found: &str, expected: &str) -> VolumeError {
    VolumeError::malformed(picture.name.as_ref(), At::Pixels, found, expected)
}

/// Estimates probe and effects from a frame with its array at the top. The size of a pixel is the frame's, or follows from the depth that its
/// middle scanline shows, mm.
///
/// # Errors
/// [`VolumeError`] for a frame that is too small, has no sector of lines and arcs, no speckle, or no size of its pixels.
pub fn fit(picture: &Picture, depth_mm: Option<f64>, seed: u64) -> Result<Match, Error> {
    let mask = sector_of(picture)?;
    let Some(outline) = Outline::of(&mask, picture.width) else {
        let expected =
            "a fan or a rectangle, the array at the top: turn frames with the array at the bottom upside down";
        return Err(refuse(picture, "a sector whose edges are no lines and arcs", expected).into());
    };
    let shown = match outline.shape {
        Shape::Rectangle { rows, .. } => rows[1] - rows[0],
        Shape::Fan { apex, radii, .. } => radii[1].min(picture.height as f64 - 0.5 - apex[1]) - radii[0],
    };
    let mm = match (depth_mm, picture.mm) {
        (Some(depth_mm), _) => depth_mm / shown,
        (None, Some([x, y])) if (x / y - 1.0).abs() < 0.01 => 0.5 * (x + y),
        (None, Some([x, y])) => {
            return Err(refuse(
                picture,
                &format!("pixels of {x} x {y} mm"),
                "square ones: scale the frame",
            )
            .into());
        }
        (None, None) => {
            let expected =
                "--mm-per-pixel, --depth-mm, or a sidecar beside the frame (scales in the picture are not read)";
            return Err(refuse(picture, "no size of its pixels", expected).into());
        }
    };
    let bench = Bench::new(picture, mask, outline.shape, mm, seed)?;
    if bench.windows.is_empty() {
        let found = "no window of speckle in the sector";
        let expected = format!(
            "one of {} scanlines by {} samples of mean grey 20 to 200",
            WINDOW[0], WINDOW[1]
        );
        return Err(refuse(picture, found, &expected).into());
    }
    let real = bench.side(picture.clone());
    let mut model = Model::start(&bench.probe);
    let default = Effects {
        needle: None,
        ..Effects::usual()
    };
    let default = bench.side(bench.render(bench.probe, default, PLAIN)?);
    let (mut rounds, mut residual) = (0, f64::INFINITY);
    while rounds < ROUNDS && residual > SETTLED {
        let own = bench.phantom(&model)?;
        residual = bench.correct(&mut model, &real, &own);
        rounds += 1;
    }
    let dark = bench.darkness(&mut model)?;
    let matched = bench.phantom(&model)?;
    let score = |side: &Side| Score {
        windows: distance(&side.histogram, &real.histogram),
        sector: distance(&side.sector_histogram, &real.sector_histogram),
    };
    let (score, default_score) = (score(&matched), score(&default));
    let mut found = Match {
        name: picture.name.clone(),
        mm_per_pixel: mm,
        sector: outline,
        rounds,
        residual,
        figures: bench.figures(&model, &real, &matched, dark),
        unidentified: bench.unidentified(&model, &real, outline, dark),
        notes: bench.notes(&real, residual),
        real,
        matched,
        default,
        score,
        default_score,
        scene: String::new(),
    };
    found.scene = found.written(&bench.scene(&model));
    Ok(found)
}

impl Bench<'_> {
    /// The model as a scene.
    fn scene(&self, model: &Model) -> SceneFile {
        let bounds = self.grid.bounds_mm();
        let pixels = |axis: usize| ((bounds.max[axis] - bounds.min[axis]) / self.image.pixel_mm()).ceil() as u32;
        let mut scene = SceneFile::default();
        scene.version = Some(crate::document::Version);
        scene.seed = self.seed;
        scene.volume = Some(VolumeSpec {
            phantom: Some(Phantom::Abdomen),
            ..VolumeSpec::default()
        });
        scene.probe = Some(ProbeSpec::from(model.probe(self.probe)));
        scene.image = Some(ImageSpec {
            width: pixels(0),
            height: pixels(1),
            margin: 0.0,
            ..ImageSpec::default()
        });
        scene.effects = Some(model.effects());
        scene
    }

    fn figures(&self, model: &Model, real: &Side, own: &Side, dark: Dark) -> Vec<Figure> {
        let figure = |key, unit, value, spread| Figure {
            key,
            unit,
            value: rounded(value),
            spread,
        };
        let probe = ProbeSpec::from(self.probe);
        let shape = [
            ("probe.width_mm", "mm", probe.width_mm),
            ("probe.radius_mm", "mm", probe.radius_mm),
            ("probe.angle_deg", "degrees", probe.angle_deg),
            ("probe.depth_mm", "mm", probe.depth_mm),
        ];
        let mut figures: Vec<Figure> = shape
            .into_iter()
            .filter_map(|(key, unit, value)| Some(figure(key, unit, value?, None)))
            .collect();
        // A ratio of windows scatters as the figure that it corrects.
        let scatter = |of: &dyn Fn(&Texture) -> Option<f64>| {
            let pairs = real.windows.iter().zip(&own.windows);
            let ratios: Vec<f64> = pairs
                .filter_map(|(real, own)| Some((of(real)? / of(own)?).ln()))
                .collect();
            (ratios.len() > 1).then(|| std(&ratios))
        };
        let share = |value: f64, spread: Option<f64>| spread.map(|spread| rounded(value * spread));
        let range = model.tone.dynamic_range_db;
        let gain = scatter(&|it| Some((it.mean / 255.0 * range).exp())).map(rounded);
        let receiver = &model.receiver;
        figures.extend([
            figure(
                "effects.tone.dynamic_range_db",
                "dB",
                range,
                share(range, scatter(&|it| Some(it.std))),
            ),
            figure("effects.tone.gain_db", "dB", model.tone.gain_db, gain),
            figure(
                "effects.speckle.axial_mm",
                "mm",
                model.axial_mm,
                share(model.axial_mm, scatter(&|it| it.fwhm[0])),
            ),
            figure(
                "effects.speckle.lateral_mm",
                "mm",
                model.lateral_mm,
                share(model.lateral_mm, scatter(&|it| it.fwhm[1])),
            ),
            figure("effects.speckle.focus_mm", "mm", model.focus_mm, None),
            figure("effects.speckle.focal_zone_mm", "mm", model.focal_zone_mm, None),
            figure(
                "effects.receiver.noise_db",
                "dB",
                receiver.noise_db,
                dark.spread_db[0].map(rounded),
            ),
            figure(
                "effects.receiver.clutter_db",
                "dB",
                receiver.clutter_db,
                dark.spread_db[1].map(rounded),
            ),
            figure(
                "effects.receiver.clutter_decay_db_cm",
                "dB/cm",
                receiver.clutter_decay_db_cm,
                None,
            ),
        ]);
        figures
    }

    fn unidentified(&self, model: &Model, real: &Side, outline: Outline, dark: Dark) -> Vec<Unidentified> {
        let mut list = Vec::new();
        let mut tell = |what, why: &str| {
            list.push(Unidentified {
                what,
                why: why.to_owned(),
            })
        };
        tell(
            "frequency",
            "an axial length is that of a bandwidth, at any frequency; frequency_mhz is the one whose default point spread is as long",
        );
        tell(
            "attenuation",
            "tissue that attenuates more looks like less time-gain compensation; the curve takes 0.5 dB/cm/MHz for the tissue",
        );
        tell(
            "echogenicity",
            "brighter tissue looks like more gain; the gain takes the windows for tissue of 0 dB, as liver",
        );
        tell(
            "dynamic range by itself",
            "range, compounding and the scanner's grey map make one spread of grey levels; the range is that of a straight curve and a blur of 0.4 lateral lengths",
        );
        tell("elevational width", "a frame shows one plane; it follows the frequency");
        tell("ring-down", "it lies above the windows; it has its default");
        let spread = model.spread(&model.probe(self.probe));
        let ends =
            [real.depths.first(), real.depths.last()].map(|it| it.map_or(0.0, |it| spread.lateral_at(it.depth_mm)));
        if ends.iter().any(|end| *end < FOCUSED * model.lateral_mm) {
            tell(
                "focus",
                "the lateral width has no minimum within the windows; focus_mm and focal_zone_mm only give its course there",
            );
        }
        if real.depths.iter().all(|it| it.lateral_mm.is_none()) {
            tell(
                "lateral width",
                "the autocorrelation across stays above one half in all windows: layers, no speckle; it has its default",
            );
        }
        for (seen, what) in outline.seen.iter().zip(["array", "depth", "field of view"]) {
            if !seen {
                tell(
                    what,
                    "no line or arc at this edge of the sector: it reaches as far as the frame shows echoes",
                );
            }
        }
        if dark.windows[0] == 0 {
            let most = rounded(dark.bound_db);
            tell(
                "noise",
                &format!(
                    "no dark window with grain narrower than the beam; by the darkest 2 % of each depth it is at most {most} dB"
                ),
            );
        }
        if dark.windows[1] == 0 {
            tell(
                "clutter",
                "no dark window with grain as wide as the beam; it has its default",
            );
        }
        if !dark.fades {
            tell(
                "fading of clutter",
                "dark windows of clutter lie at one depth, or there are none; it has its default",
            );
        }
        list
    }

    /// What is doubtful.
    fn notes(&self, real: &Side, residual: f64) -> Vec<String> {
        let mut notes = Vec::new();
        let (beam, _) = self.beam(self.picture);
        let uneven = |window: &Window| unevenness(&Patch::of(&beam.grey, beam.width, *window)) > UNEVEN;
        if self.windows.iter().flatten().any(uneven) {
            notes.push("no window is uniform: figures are those of structure, not of speckle".to_owned());
        }
        if real.depths.len() < self.bands() {
            let (found, all) = (real.depths.len(), self.bands());
            notes.push(format!(
                "uniform windows at {found} of {all} depths: between and beyond them the gain goes on as it is there"
            ));
        }
        if residual > SETTLED {
            let percent = 100.0 * residual;
            notes.push(format!("figures still change by {percent:.1} % after {ROUNDS} rounds"));
        }
        if self.probe.shape.kind() == ProbeKind::Phased && real.depths.len() < 2 {
            notes.push("windows at one depth do not tell how a phased beam widens".to_owned());
        }
        notes
    }
}

#[cfg(test)]
mod tests;
