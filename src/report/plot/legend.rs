//! Plot legend.

use plotters::coord::Shift;
use plotters::prelude::*;

use super::{Layout, MARK, Marker, PAGE, Plot, colour, marker};
use insonify_base::table;

/// Line spacing of the legend, and extra spacing between its parts, pixels.
const LINE: i32 = 24;
const GAP: i32 = 12;
/// Line spacing within a wrapped name, pixels.
const WRAPPED: i32 = 18;
/// Characters of a name that fit beside the axes or into half the width of a page, and into its full width: at most 8
/// pixels each.
const HALF: usize = 23;
const FULL: usize = 52;

/// Line of the legend: its marker (`None` for the front) and its name.
type Key<'a> = (Option<(Marker, RGBAColor)>, &'a str);

impl Plot {
    /// Draws colours, markers and the front: one below the other beside the axes, or in two columns below them if the
    /// names of a part are short.
    pub(super) fn legend<'a, DB: DrawingBackend + 'a>(
        &self,
        area: &DrawingArea<DB, Shift>,
        layout: Layout<'_>,
    ) -> Result<(), DrawingAreaErrorKind<DB::ErrorType>> {
        let dark = BLACK.mix(0.85);
        let style = TextStyle::from(("sans-serif", 15)).color(&dark);
        let mut top = match layout {
            Layout::Page => LINE / 2,
            _ => 64,
        };
        for part in self.keys() {
            let columns = columns(&part, layout);
            for row in part.chunks(columns) {
                for (column, (shape, name)) in (0..).zip(row) {
                    let centre = (14 + column * PAGE[0] as i32 / 2, top);
                    match shape {
                        Some((shape, colour)) => area.draw(&marker(centre, *shape, *colour))?,
                        None => area.draw(&Circle::new(centre, MARK + 4, BLACK.mix(0.35).stroke_width(2)))?,
                    }
                    for (below, line) in (0..).zip(wrapped(name, layout)) {
                        area.draw_text(&line, &style, (centre.0 + 18, centre.1 - 8 + WRAPPED * below))?;
                    }
                }
                top += height(row, layout);
            }
            top += GAP;
        }
        Ok(())
    }

    /// Returns the parts of the legend: meanings of colours, meanings of markers, and the front, which has no marker.
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

    /// Returns the height of the legend below the axes, pixels.
    pub(super) fn legend_height(&self) -> i32 {
        let rows = |part: &Vec<Key<'_>>| -> i32 {
            let rows = part.chunks(columns(part, Layout::Page));
            rows.map(|row| height(row, Layout::Page)).sum()
        };
        self.keys().iter().map(|part| rows(part) + GAP).sum()
    }
}

/// Returns the height of a row of the legend, pixels.
fn height(row: &[Key<'_>], layout: Layout<'_>) -> i32 {
    let lines = row.iter().map(|(_, name)| wrapped(name, layout).len() as i32);
    LINE + WRAPPED * (lines.max().unwrap_or(1) - 1)
}

/// Wraps a name into lines that fit, between words if possible.
fn wrapped(name: &str, layout: Layout<'_>) -> Vec<String> {
    let width = match layout {
        Layout::Page => FULL,
        _ => HALF,
    };
    table::wrapped(name, width, true)
}

/// Returns the number of columns of a part of the legend.
fn columns(part: &[Key<'_>], layout: Layout<'_>) -> usize {
    let short = part.iter().all(|(_, name)| name.chars().count() <= HALF);
    if layout == Layout::Page && short { 2 } else { 1 }
}
