//! The legend of a plot.

use plotters::coord::Shift;
use plotters::prelude::*;

use super::{Layout, MARK, Marker, PAGE, Plot, colour, marker};

/// Distance of the lines of a legend, and of its parts beyond that, pixels.
const LINE: i32 = 24;
const GAP: i32 = 12;
/// Distance of the lines of one name, pixels.
const WRAPPED: i32 = 18;
/// Characters of a name that fit beside the axes or into half the width of a page, and into all of it: 8 pixels each at most.
const HALF: usize = 23;
const FULL: usize = 52;

/// A line of the legend: its shape, or none for that of the front; and its name.
type Key<'a> = (Option<(Marker, RGBAColor)>, &'a str);

impl Plot {
    /// Colours, shapes and the front: one below the other beside the axes, or in two columns below them where the names of a part are short.
    pub(super) fn legend<'a, DB: DrawingBackend + 'a>(
        &self,
        area: &DrawingArea<DB, Shift>,
        layout: Layout,
    ) -> Result<(), DrawingAreaErrorKind<DB::ErrorType>> {
        let dark = BLACK.mix(0.85);
        let style = TextStyle::from(("sans-serif", 15)).color(&dark);
        let mut top = match layout {
            Layout::Alone => 64,
            Layout::Page => LINE / 2,
        };
        for part in self.keys() {
            let columns = columns(&part, layout);
            for row in part.chunks(columns) {
                for (column, (shape, name)) in (0..).zip(row) {
                    let at = (14 + column * PAGE[0] as i32 / 2, top);
                    match shape {
                        Some((shape, colour)) => area.draw(&marker(at, *shape, *colour))?,
                        None => area.draw(&Circle::new(at, MARK + 4, BLACK.mix(0.35).stroke_width(2)))?,
                    }
                    for (below, line) in (0..).zip(wrapped(name, layout)) {
                        area.draw_text(&line, &style, (at.0 + 18, at.1 - 8 + WRAPPED * below))?;
                    }
                }
                top += height(row, layout);
            }
            top += GAP;
        }
        Ok(())
    }

    /// The parts of the legend: what each colour means, what each shape does, and the front, which has no shape of a point.
    fn keys(&self) -> Vec<Vec<Key<'_>>> {
        let mut named: Vec<usize> = Vec::new();
        let mut colours = Vec::new();
        for series in &self.series {
            if !named.contains(&series.colour) {
                named.push(series.colour);
                colours.push((Some((Marker::Disc, colour(series.colour))), series.name.as_str()));
            }
        }
        let grey = BLACK.mix(0.6).to_rgba();
        let shapes = self.markers.iter().enumerate();
        let shapes = shapes.map(|(n, name)| (Some((Marker::nth(n), grey)), name.as_str()));
        let front = (!self.front.is_empty()).then_some((None, "best: none beats them"));
        let parts = [colours, shapes.collect(), front.into_iter().collect()];
        parts.into_iter().filter(|part| !part.is_empty()).collect()
    }

    /// Height of the legend below the axes, pixels.
    pub(super) fn legend_height(&self) -> i32 {
        let rows = |part: &Vec<Key<'_>>| -> i32 {
            let rows = part.chunks(columns(part, Layout::Page));
            rows.map(|row| height(row, Layout::Page)).sum()
        };
        self.keys().iter().map(|part| rows(part) + GAP).sum()
    }
}

/// Height of a row of the legend, pixels.
fn height(row: &[Key<'_>], layout: Layout) -> i32 {
    let lines = row.iter().map(|(_, name)| wrapped(name, layout).len() as i32);
    LINE + WRAPPED * (lines.max().unwrap_or(1) - 1)
}

/// A name in lines that fit, broken between words where it can be.
fn wrapped(name: &str, layout: Layout) -> Vec<String> {
    let most = match layout {
        Layout::Alone => HALF,
        Layout::Page => FULL,
    };
    let mut lines: Vec<String> = vec![String::new()];
    for word in name.split(' ') {
        let mut letters = word.chars().peekable();
        while letters.peek().is_some() {
            let piece: String = letters.by_ref().take(most).collect();
            match lines.last_mut() {
                Some(line) if line.is_empty() => line.push_str(&piece),
                Some(line) if line.chars().count() + 1 + piece.chars().count() <= most => {
                    line.push(' ');
                    line.push_str(&piece);
                }
                _ => lines.push(piece),
            }
        }
    }
    lines
}

/// Columns of a part of the legend.
fn columns(part: &[Key<'_>], layout: Layout) -> usize {
    let short = part.iter().all(|(_, name)| name.chars().count() <= HALF);
    if layout == Layout::Page && short { 2 } else { 1 }
}
