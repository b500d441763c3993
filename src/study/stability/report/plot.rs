//! SVG plot of the margin of every case.

use std::fmt::Write;

use super::{CaseReport, Report};
use crate::base::report::page::escape;
use crate::study::stability::record::Measure;

/// Widths of names, scale, exact results and border, and line height, pixels.
const NAMES: f64 = 340.0;
const SCALE: f64 = 480.0;
const EXACT: f64 = 60.0;
const EDGE: f64 = 14.0;
const LINE: f64 = 17.0;
/// Powers of ten of the margin at the ends of the scale; values beyond are drawn at the ends.
const POWERS: [i32; 2] = [-1, 12];
/// Colours of passed and failed figures.
const HOLDS: &str = "#1a6fb0";
const FAILS: &str = "#c22f2f";

impl Report {
    /// Plots the margin of each figure that has a limit: one line per case, with the figure nearest to its limit drawn large.
    pub fn plot(&self) -> String {
        let groups = self.groups();
        let lines = self.cases.len() + 2 * groups.len() + 2;
        let [width, height] = [NAMES + SCALE + EXACT + 2.0 * EDGE, LINE * lines as f64 + 2.0 * EDGE];
        let mut drawing = Drawing {
            text: format!(
                "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.0} {height:.0}\" width=\"{width:.0}\" \
                 height=\"{height:.0}\" font-family=\"sans-serif\" font-size=\"12\">\n\
                 <rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n"
            ),
            y: EDGE + LINE,
            bottom: height - EDGE,
        };
        drawing.scale();
        for group in groups {
            drawing.y += LINE;
            drawing.words(EDGE, "start", "bold", group);
            drawing.y += LINE;
            for case in self.of_group(group) {
                drawing.case(case);
                drawing.y += LINE;
            }
        }
        drawing.text.push_str("</svg>\n");
        drawing.text
    }
}

struct Drawing {
    text: String,
    /// Baseline of the current line.
    y: f64,
    bottom: f64,
}

impl Drawing {
    fn put(&mut self, markup: std::fmt::Arguments<'_>) {
        // Writing to a string in memory cannot fail.
        let _ = self.text.write_fmt(markup);
    }

    fn words(&mut self, x: f64, anchor: &str, weight: &str, words: &str) {
        let (y, words) = (self.y, escape(words));
        self.put(format_args!(
            "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\" font-weight=\"{weight}\">{words}</text>\n"
        ));
    }

    fn scale(&mut self) {
        let (top, bottom) = (self.y + 0.4 * LINE, self.bottom);
        for power in POWERS[0]..=POWERS[1] {
            let x = place(10_f64.powi(power));
            let (colour, thick) = if power == 0 { (FAILS, 1.5) } else { ("#ddd", 1.0) };
            self.put(format_args!(
                "<path d=\"M{x:.1} {top:.1}V{bottom:.1}\" stroke=\"{colour}\" stroke-width=\"{thick}\"/>\n"
            ));
            if power % 3 == 0 {
                let name = match power {
                    0 => "limit".to_owned(),
                    _ => format!("1e{power}x"),
                };
                self.words(x, "middle", "normal", &name);
            }
        }
        self.words(NAMES + SCALE + EDGE + 0.5 * EXACT, "middle", "normal", "exact");
    }

    fn case(&mut self, case: &CaseReport) {
        let weight = if case.holds { "normal" } else { "bold" };
        self.words(NAMES, "end", weight, &case.name);
        let worst = case.worst();
        for measure in &case.measures {
            let large = worst.is_some_and(|worst| std::ptr::eq(worst, measure));
            self.figure(measure, if large { (5.0, 1.0) } else { (2.5, 0.45) });
        }
    }

    fn figure(&mut self, measure: &Measure, (radius, opacity): (f64, f64)) {
        if measure.limit.is_none() && measure.holds {
            return;
        }
        let colour = if measure.holds { HOLDS } else { FAILS };
        let x = match measure.margin {
            Some(margin) => place(margin),
            None if measure.holds => NAMES + SCALE + EDGE + 0.5 * EXACT,
            None => place(0.0),
        };
        let y = self.y - 4.0;
        let what = escape(&measure.what);
        self.put(format_args!(
            "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius}\" fill=\"{colour}\" fill-opacity=\"{opacity}\"><title>{what}</title></circle>\n"
        ));
    }
}

/// Returns the position of a margin on the scale.
fn place(margin: f64) -> f64 {
    let [low, high] = POWERS.map(f64::from);
    let share = (margin.log10().clamp(low, high) - low) / (high - low);
    NAMES + EDGE + share * (SCALE - EDGE)
}
