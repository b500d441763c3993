//! SVG picture of the slice.

use std::fmt::Write;

use super::liver::Liver;
use insonify_base::statistics::percentile;

/// Pixels per millimetre.
const PX_PER_MM: f64 = 6.0;
/// Space beside and below the slice, mm.
const MARGIN_MM: f64 = 8.0;
/// Space above the capsule for the needle, mm.
const ABOVE_MM: f64 = 12.0;

/// Share of the triangles of a picture whose stress its scale covers: beside the tip there are a few of much more.
const COVERED_SHARE: f64 = 0.99;
/// Width and height of the scale, pixels.
const SCALE_PX: [f64; 2] = [160.0, 12.0];
/// Steps of colour of the scale.
const SCALE_STEPS: usize = 32;

/// State of the slice to be drawn.
pub(super) struct SliceState {
    /// Name of the picture.
    pub name: String,
    /// Displacements, mm.
    pub displacement: Vec<f64>,
    /// Von Mises stress of each triangle, kPa.
    pub stress_kpa: Vec<f64>,
    /// Travel of the needle, mm.
    pub travel_mm: f64,
}

/// Stress shown in the darkest colour of all pictures, kPa: one, two or five times a power of ten.
pub(crate) fn darkest_kpa(states: &[SliceState]) -> f64 {
    let covered = states.iter().filter_map(|state| {
        let mut stress = state.stress_kpa.clone();
        stress.sort_by(f64::total_cmp);
        percentile(&stress, COVERED_SHARE)
    });
    let largest = covered.fold(f64::MIN_POSITIVE, f64::max);
    let power = 10f64.powf(largest.log10().floor());
    [1.0, 2.0, 5.0, 10.0]
        .map(|step| step * power)
        .into_iter()
        .find(|round| *round >= largest)
        .unwrap_or(largest)
}

/// Draws the displaced slice, coloured by its von Mises stress up to `darkest_kpa`, with the needle.
pub(super) fn slice(liver: &Liver, state: &SliceState, darkest_kpa: f64) -> String {
    let (displacement, travel_mm) = (&state.displacement, state.travel_mm);
    let nodes = liver.body.nodes();
    let position = |node: u32| {
        let index = node as usize;
        [0, 1].map(|axis: usize| nodes[index][axis] + displacement[2 * index + axis])
    };
    let fold = |axis: usize, start: f64, pick: fn(f64, f64) -> f64| nodes.iter().map(|p| p[axis]).fold(start, pick);
    let low = [0, 1].map(|axis| fold(axis, f64::INFINITY, f64::min) - MARGIN_MM);
    let high = [
        fold(0, f64::NEG_INFINITY, f64::max) + MARGIN_MM,
        fold(1, f64::NEG_INFINITY, f64::max) + ABOVE_MM,
    ];
    let [width, height] = [0, 1].map(|axis| PX_PER_MM * (high[axis] - low[axis]));
    let pixel = |p: [f64; 2]| [PX_PER_MM * (p[0] - low[0]), PX_PER_MM * (high[1] - p[1])];
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.0} {height:.0}\" width=\"{width:.0}\" \
         height=\"{height:.0}\">\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n"
    );
    for ((corners, kpa), vein) in liver.body.elements().iter().zip(&state.stress_kpa).zip(&liver.vein) {
        let points = corners.map(|node| pixel(position(node)));
        let fill = if *vein {
            "#3b1f6b".to_owned()
        } else {
            colour(kpa / darkest_kpa)
        };
        // Writing to a string in memory cannot fail.
        let _ = write!(text, "<path d=\"");
        for (index, [x, y]) in points.iter().enumerate() {
            let _ = write!(text, "{}{x:.1} {y:.1}", if index == 0 { "M" } else { "L" });
        }
        let _ = writeln!(text, "Z\" fill=\"{fill}\" stroke=\"{fill}\" stroke-width=\"0.4\"/>");
    }
    let [x, tip] = pixel([liver.entry[0], liver.entry[1] - travel_mm]);
    let _ = writeln!(
        text,
        "<path d=\"M{x:.1} 0L{x:.1} {tip:.1}\" stroke=\"#111\" stroke-width=\"3\"/>\n\
         <text x=\"12\" y=\"24\" font-family=\"sans-serif\" font-size=\"18\">{travel_mm:.1} mm</text>"
    );
    scale(&mut text, [width - SCALE_PX[0] - 30.0, 30.0], darkest_kpa);
    text + "</svg>\n"
}

/// Adds the scale of colours at a pixel.
fn scale(text: &mut String, [x, y]: [f64; 2], darkest_kpa: f64) {
    let _ = writeln!(
        text,
        "<g font-family=\"sans-serif\" font-size=\"14\"><text x=\"{x:.0}\" y=\"{:.0}\">von Mises stress, kPa</text>",
        y - 8.0
    );
    let wide = SCALE_PX[0] / SCALE_STEPS as f64;
    for step in 0..SCALE_STEPS {
        let fill = colour((step as f64 + 0.5) / SCALE_STEPS as f64);
        let left_px = x + step as f64 * wide;
        let _ = writeln!(
            text,
            "<path d=\"M{left_px:.1} {y:.1}h{wide:.1}v{:.1}h-{wide:.1}Z\" fill=\"{fill}\" stroke=\"{fill}\" stroke-width=\"0.4\"/>",
            SCALE_PX[1]
        );
    }
    for (share, suffix) in [(0.0, ""), (0.5, ""), (1.0, "+")] {
        let _ = writeln!(
            text,
            "<text x=\"{:.0}\" y=\"{:.0}\" text-anchor=\"middle\">{}{suffix}</text>",
            x + share * SCALE_PX[0],
            y + SCALE_PX[1] + 15.0,
            share * darkest_kpa
        );
    }
    text.push_str("</g>\n");
}

/// Returns a colour from pale to dark red for a share of the scale.
fn colour(share: f64) -> String {
    let share = share.clamp(0.0, 1.0);
    let mix = |from: f64, to: f64| (from + share * (to - from)).round() as u8;
    format!(
        "#{:02x}{:02x}{:02x}",
        mix(246.0, 120.0),
        mix(205.0, 10.0),
        mix(187.0, 20.0)
    )
}
