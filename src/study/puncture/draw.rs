//! SVG picture of the slice.

use std::fmt::Write;

use super::liver::Liver;

/// Pixels per millimetre.
const SCALE: f64 = 6.0;
const MARGIN_MM: f64 = 8.0;
/// Space above the capsule for the needle, mm.
const ABOVE_MM: f64 = 12.0;

/// Relative strain shown in the darkest colour.
const DARKEST: f64 = 1.0;

/// Draws the displaced slice, coloured by its relative strain, with the needle after `travel_mm` of travel.
pub fn slice(liver: &Liver, displacement: &[f64], travel_mm: f64) -> String {
    let nodes = liver.body.nodes();
    let place = |node: u32| {
        let at = node as usize;
        [0, 1].map(|axis: usize| nodes[at][axis] + displacement[2 * at + axis])
    };
    let fold = |axis: usize, start: f64, pick: fn(f64, f64) -> f64| nodes.iter().map(|p| p[axis]).fold(start, pick);
    let low = [0, 1].map(|axis| fold(axis, f64::INFINITY, f64::min) - MARGIN_MM);
    let high = [
        fold(0, f64::NEG_INFINITY, f64::max) + MARGIN_MM,
        fold(1, f64::NEG_INFINITY, f64::max) + ABOVE_MM,
    ];
    let [width, height] = [0, 1].map(|axis| SCALE * (high[axis] - low[axis]));
    let pixel = |p: [f64; 2]| [SCALE * (p[0] - low[0]), SCALE * (high[1] - p[1])];
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.0} {height:.0}\" width=\"{width:.0}\" \
         height=\"{height:.0}\">\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n"
    );
    let strains = liver.body.relative_strains(displacement);
    for ((corners, strain), vein) in liver.body.elements().iter().zip(strains).zip(&liver.vein) {
        let points = corners.map(|node| pixel(place(node)));
        let fill = if *vein { "#3b1f6b".to_owned() } else { colour(strain) };
        // Writing to a string in memory cannot fail.
        let _ = write!(text, "<path d=\"");
        for (at, [x, y]) in points.iter().enumerate() {
            let _ = write!(text, "{}{x:.1} {y:.1}", if at == 0 { "M" } else { "L" });
        }
        let _ = writeln!(text, "Z\" fill=\"{fill}\" stroke=\"{fill}\" stroke-width=\"0.4\"/>");
    }
    let [x, tip] = pixel([liver.entry[0], liver.entry[1] - travel_mm]);
    let _ = writeln!(
        text,
        "<path d=\"M{x:.1} 0L{x:.1} {tip:.1}\" stroke=\"#111\" stroke-width=\"3\"/>\n\
         <text x=\"12\" y=\"24\" font-family=\"sans-serif\" font-size=\"18\">{travel_mm:.1} mm</text>\n</svg>"
    );
    text
}

/// Returns a colour from pale to dark red.
fn colour(strain: f64) -> String {
    let share = (strain / DARKEST).clamp(0.0, 1.0);
    let mix = |from: f64, to: f64| (from + share * (to - from)).round() as u8;
    format!(
        "#{:02x}{:02x}{:02x}",
        mix(246.0, 120.0),
        mix(205.0, 10.0),
        mix(187.0, 20.0)
    )
}
