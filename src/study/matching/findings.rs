//! Findings of a match: figures with their spread, parameters not identified, doubts, and the scene.

use super::bench::{Bench, UNEVEN, unevenness};
use super::correct::DarkFindings;
use super::model::{Model, rounded};
use super::outline::Outline;
use super::{EstimatedParameter, ROUNDS, SETTLED, Unidentified, WindowMeasurements};
use crate::realism::texture::{Patch, Texture, Window};
use insonify_anatomy::phantom::Phantom;
use insonify_base::statistics::{median, std};
use insonify_imaging::effects::Scanner;
use insonify_imaging::effects::receiver::CLUTTER_DB;
use insonify_imaging::scene::{ImageSpec, SceneFile, Version, VolumeSpec};
use insonify_tracking::probe::ProbeSpec;

/// Scatter of the windows' standard deviation above which they hold more than one tissue or no speckle; in fully
/// developed speckle it is 0.06.
const MAX_SCATTER: f64 = 0.15;
/// Least widening of the beam at both ends of the windows for its focus to count as seen.
const MIN_WIDENING: f64 = 1.1;

/// Returns the standard deviation of the logarithm of a figure over the real windows, relative to those of the phantom
/// at their depth: a ratio of windows scatters like the parameter that it corrects. `None` for fewer than two windows.
fn scatter(
    real: &WindowMeasurements,
    phantom: &WindowMeasurements,
    measure: &dyn Fn(&Texture) -> Option<f64>,
) -> Option<f64> {
    let at_depth = |(real, phantom): (&Vec<Texture>, &Vec<Texture>)| -> Vec<f64> {
        let phantom = median(phantom.iter().filter_map(measure).collect());
        real.iter()
            .filter_map(|texture| Some((measure(texture)? / phantom?).ln()))
            .collect()
    };
    let ratios: Vec<f64> = real.windows.iter().zip(&phantom.windows).flat_map(at_depth).collect();
    (ratios.len() > 1).then(|| std(&ratios))
}

impl Bench<'_> {
    /// Returns the model as a scene.
    pub(super) fn scene(&self, model: &Model) -> SceneFile {
        let bounds = self.grid.bounds_mm();
        let pixels = |axis: usize| ((bounds.max[axis] - bounds.min[axis]) / self.image.pixel_mm()).ceil() as u32;
        let mut scene = SceneFile::default();
        scene.version = Some(Version::NEWEST);
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
        scene.scanner = Some(Scanner::Raw);
        scene.effects = Some((&model.effects()).into());
        scene
    }

    pub(super) fn figures(
        &self,
        model: &Model,
        real: &WindowMeasurements,
        phantom: &WindowMeasurements,
        dark: DarkFindings,
    ) -> Vec<EstimatedParameter> {
        let figure = |key, unit, value, spread| EstimatedParameter {
            key,
            unit,
            value: rounded(value),
            spread,
        };
        let probe = ProbeSpec::from(self.probe);
        let shape = [
            ("probe.width_mm", "mm", probe.number("width_mm")),
            ("probe.radius_mm", "mm", probe.number("radius_mm")),
            ("probe.angle_deg", "degrees", probe.number("angle_deg")),
            ("probe.depth_mm", "mm", probe.sampling.depth_mm),
        ];
        let mut figures: Vec<EstimatedParameter> = shape
            .into_iter()
            .filter_map(|(key, unit, value)| Some(figure(key, unit, value?, None)))
            .collect();
        let scatter = |measure: &dyn Fn(&Texture) -> Option<f64>| scatter(real, phantom, measure);
        let share = |value: f64, spread: Option<f64>| spread.map(|spread| rounded(value * spread));
        let range = model.tone.dynamic_range_db;
        // Grey levels are decibels already: the exponential undoes the logarithm in `scatter`.
        let gain = scatter(&|texture| Some((texture.mean / 255.0 * range).exp())).map(rounded);
        let receiver = &model.receiver;
        figures.extend([
            figure(
                "effects.tone.dynamic_range_db",
                "dB",
                range,
                share(range, scatter(&|texture| Some(texture.std))).filter(|_| self.range_db.is_none()),
            ),
            figure("effects.tone.gain_db", "dB", model.tone.gain_db, gain),
            figure(
                "effects.speckle.axial_mm",
                "mm",
                model.axial_mm,
                share(model.axial_mm, scatter(&|texture| texture.fwhm[0])),
            ),
            figure(
                "effects.speckle.lateral_mm",
                "mm",
                model.lateral_mm,
                share(model.lateral_mm, scatter(&|texture| texture.fwhm[1])),
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
                receiver.clutter_db.unwrap_or(CLUTTER_DB),
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

    pub(super) fn unidentified(
        &self,
        model: &Model,
        real: &WindowMeasurements,
        outline: Outline,
        dark: DarkFindings,
    ) -> Vec<Unidentified> {
        let mut list = Vec::new();
        let mut add = |parameter, why: &str| {
            list.push(Unidentified {
                what: parameter,
                why: why.to_owned(),
            })
        };
        add(
            "frequency",
            "an axial length is that of a bandwidth, at any frequency; frequency_mhz is the one at which frames of scanners are as long",
        );
        add(
            "attenuation",
            "tissue that attenuates more looks like less time-gain compensation; the curve takes 0.5 dB/cm/MHz for the tissue",
        );
        add(
            "echogenicity",
            "brighter tissue looks like more gain; the gain takes the windows for tissue of 0 dB, as liver",
        );
        if self.range_db.is_none() {
            add(
                "dynamic range by itself",
                "range, compounding and the scanner's grey map make one spread of grey levels; the range is that of a straight curve without blur",
            );
        }
        add("elevational width", "a frame shows one plane; it follows the frequency");
        add("ring-down", "it lies above the windows; it has its default");
        let spread = model.spread(&model.probe(self.probe));
        // Both ends must be wider: a beam that only widens or only narrows has its waist outside the windows.
        let ends = [real.depths.first(), real.depths.last()]
            .map(|depth| depth.map_or(0.0, |depth| spread.lateral_at(depth.depth_mm)));
        if ends.iter().any(|end| *end < MIN_WIDENING * model.lateral_mm) {
            add(
                "focus",
                "the lateral width has no minimum within the windows; focus_mm and focal_zone_mm only give its course there",
            );
        }
        if real.depths.iter().all(|depth| depth.lateral_mm.is_none()) {
            add(
                "lateral width",
                "the autocorrelation across stays above one half in all windows: layers, no speckle; it has its default",
            );
        }
        for (is_seen, parameter) in outline.seen.iter().zip(["array", "depth", "field of view"]) {
            if !is_seen {
                add(
                    parameter,
                    "no line or arc at this edge of the sector: it reaches as far as the frame shows echoes",
                );
            }
        }
        if dark.windows[0] == 0 {
            let bound_db = rounded(dark.bound_db);
            add(
                "noise",
                &format!(
                    "no dark window with grain narrower than the beam; by the darkest 2 % of each depth it is at most {bound_db} dB"
                ),
            );
        }
        if dark.windows[1] == 0 {
            add(
                "clutter",
                "no dark window with grain as wide as the beam; it has its default",
            );
        }
        if !dark.fades {
            add(
                "fading of clutter",
                "dark windows of clutter lie at one depth, or there are none; it has its default",
            );
        }
        list
    }

    /// Lists reasons to doubt the match.
    pub(super) fn notes(&self, real: &WindowMeasurements, phantom: &WindowMeasurements, residual: f64) -> Vec<String> {
        let mut notes = Vec::new();
        let (beam, _) = self.beam(self.picture);
        let uneven = |window: &Window| unevenness(&Patch::of(&beam.grey, beam.width, *window)) > UNEVEN;
        if self.windows.iter().flatten().any(uneven) {
            notes.push("no window is uniform: figures are those of structure, not of speckle".to_owned());
        }
        if let Some(spread) =
            scatter(real, phantom, &|texture| Some(texture.std)).filter(|spread| *spread > MAX_SCATTER)
        {
            let percent = 100.0 * spread;
            notes.push(format!(
                "the spread of grey levels varies by {percent:.0} % between windows (one tissue: 6 %): dynamic range and gain are uncertain"
            ));
        }
        if real.depths.len() < self.bands() {
            let (measured, bands) = (real.depths.len(), self.bands());
            notes.push(format!(
                "uniform windows at {measured} of {bands} depths: the gain is interpolated between them and constant beyond"
            ));
        }
        if residual > SETTLED {
            let percent = 100.0 * residual;
            notes.push(format!(
                "figures still change by {percent:.1} % after {} rounds",
                ROUNDS + 1
            ));
        }
        if self.probe.shape.kind().shared_aperture_mm().is_some() && real.depths.len() < 2 {
            notes.push("windows at one depth do not tell how a phased beam widens".to_owned());
        }
        notes
    }
}
