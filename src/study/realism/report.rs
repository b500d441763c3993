//! Output of the comparison as text and as a page.

use std::fmt;

use image::{GrayImage, imageops};

use super::picture::Picture;
use super::{BIN_LEVELS, FrameReport, GroupComparison, LIMIT, LikenessReport, LikenessVerdict, MeasureComparison};
use insonify_base::number::fixed;
use insonify_base::output::OutputError;
use insonify_base::table::{Cell, Table};
use insonify_base::text;
use insonify_base::text::escape;
use insonify_report::page::Page;
use insonify_report::plot::{Axis, Plot, Series};

/// Largest width of the pictures on a page, pixels.
const MAX_PICTURE_PX: u32 = 480;

impl MeasureComparison {
    /// Returns name with unit, both sides, difference and verdict.
    fn words(&self) -> [String; 5] {
        let name = match self.measure.unit {
            "" => self.measure.name.to_owned(),
            unit => format!("{}, {unit}", self.measure.name),
        };
        let side = |figure: &Option<super::MeasureSummary>| match figure {
            None => "-".to_owned(),
            Some(figure) => match figure.spread {
                None => fixed(figure.mean),
                Some(spread) => format!("{} +- {}", fixed(figure.mean), fixed(spread)),
            },
        };
        let difference = self.difference.map_or("-".to_owned(), |d| format!("{d:+.1}"));
        let verdict = self.verdict.map_or("-", LikenessVerdict::word);
        [
            name,
            side(&self.frames),
            side(&self.real),
            difference,
            verdict.to_owned(),
        ]
    }
}

impl LikenessVerdict {
    fn word(self) -> &'static str {
        match self {
            Self::Inside => "inside",
            Self::Outside => "outside",
        }
    }
}

impl GroupComparison {
    /// States how many measures are inside and outside.
    fn summary(&self) -> String {
        let count = |verdict| self.measures.iter().filter(|row| row.verdict == Some(verdict)).count();
        let (inside, outside) = (count(LikenessVerdict::Inside), count(LikenessVerdict::Outside));
        let group = named(&self.group);
        let sides = format!("({} frames against {})", self.frames.len(), self.real.len());
        match inside + outside {
            0 => format!("{group}: no verdict {sides}"),
            all => format!(
                "{group}: {inside} of {all} measures lie within {LIMIT} standard deviations of the real frames {sides}"
            ),
        }
    }

    /// Appends pictures of both sides, the table, plots and the lists of frames.
    fn put(&self, page: &mut Page, frames: &[Picture], real: &[Picture]) -> Result<(), OutputError> {
        page.put(format_args!("<h2>{}</h2>", escape(&named(&self.group))));
        page.paragraph("", &(self.summary() + "."));
        let sides = [("frames", &self.frames, frames), ("real frames", &self.real, real)];
        let example = sides.map(|(side, reports, pictures)| {
            let first = reports.first()?;
            let picture = pictures.iter().find(|picture| picture.name == first.name)?;
            Some((small(picture)?, format!("{side}: {}", named(&picture.name))))
        });
        page.pictures(
            example
                .iter()
                .flatten()
                .map(|(picture, caption)| (picture, caption.clone())),
        );
        let [ours, real, difference, floor] = ["frames", "real frames", "difference", "floor"].map(Cell::number);
        let head = [Cell::from("measure"), ours, real, difference, floor, Cell::from("")];
        let rows = self.measures.iter().map(|row| {
            let [name, ours, real, difference, verdict] = row.words();
            let tag = match row.verdict {
                Some(LikenessVerdict::Inside) => vec![("good", verdict)],
                Some(LikenessVerdict::Outside) => vec![("bad", verdict)],
                None => Vec::new(),
            };
            let name = Cell::Pair(name, row.measure.definition.to_owned());
            let numbers = [ours, real, difference, row.measure.floor.to_string()].map(Cell::Number);
            std::iter::once(name).chain(numbers).chain([Cell::Tags(tag)])
        });
        page.stacked(&Table::new(head).with(rows));
        page.plots(&self.plots())?;
        for (side, frames) in [("Frames", &self.frames), ("Real frames", &self.real)] {
            page.put(format_args!("<h3>{side}</h3><ul>"));
            for frame in frames {
                let size = frame
                    .mm_per_pixel
                    .map_or("size of pixels unknown".to_owned(), |[axial, lateral]| {
                        format!("{} x {} mm a pixel", fixed(lateral), fixed(axial))
                    });
                page.put(format_args!("<li>{}: {size}</li>", escape(&named(&frame.name))));
            }
            page.put("</ul>");
        }
        Ok(())
    }

    /// Plots histogram and autocorrelations, one line per frame.
    fn plots(&self) -> [Plot; 3] {
        let all_frames = || self.frames.iter().chain(&self.real);
        // Millimetres only if every frame has a scale: lags in pixels on the same axis would not compare.
        let scaled = all_frames().all(|frame| frame.mm_per_pixel.is_some());
        let plot = |title: &str, [x, y]: [&str; 2], points: &dyn Fn(&FrameReport) -> Vec<[f64; 2]>| {
            let side = |name: &'static str, colour: usize, frames: &[FrameReport]| -> Vec<Series> {
                let line = |frame: &FrameReport| Series::line(name, colour, points(frame));
                frames.iter().map(line).collect()
            };
            // Real frames are the range to compare with: they come first, under the lines of the others.
            let series = [side("real frames", 1, &self.real), side("frames", 0, &self.frames)].concat();
            Plot::new(title, Axis::linear(x), Axis::linear(y), series)
        };
        let lag = if scaled { "lag, mm" } else { "lag, pixels" };
        let lags = |axis: usize| {
            move |frame: &FrameReport| {
                let step = frame.mm_per_pixel.filter(|_| scaled).map_or(1.0, |mm| mm[axis]);
                let values = [&frame.autocorrelation_axial, &frame.autocorrelation_lateral][axis];
                values
                    .iter()
                    .enumerate()
                    .map(|(lag, value)| [lag as f64 * step, *value])
                    .collect()
            }
        };
        let classes = |frame: &FrameReport| {
            let middle = |class: usize| ((class * BIN_LEVELS) as f64) + 0.5 * (BIN_LEVELS as f64 - 1.0);
            frame
                .histogram
                .iter()
                .enumerate()
                .map(|(class, share)| [middle(class), *share])
                .collect()
        };
        [
            plot(
                "Grey levels of the sector",
                ["grey level", "share in 4 grey levels"],
                &classes,
            ),
            plot(
                "Autocorrelation along depth in uniform windows",
                [lag, "autocorrelation"],
                &lags(0),
            ),
            plot(
                "Autocorrelation across in uniform windows",
                [lag, "autocorrelation"],
                &lags(1),
            ),
        ]
    }
}

impl LikenessReport {
    /// Returns the report as one self-contained HTML document, with a picture of each side of each group.
    ///
    /// # Errors
    /// [`OutputError`] if a plot cannot be drawn.
    pub fn page(&self, frames: &[Picture], real: &[Picture]) -> Result<String, OutputError> {
        let mut page = Page::new("Frames against real frames");
        for group in self.groups.iter().filter(|_| self.groups.len() > 1) {
            page.paragraph("", &(group.summary() + "."));
        }
        for note in &self.notes {
            page.paragraph("warning", &(note.clone() + "."));
        }
        page.paragraph(
            "soft",
            "Mean and standard deviation over the frames. A difference is that of the means in standard deviations of the real frames; a \
             deviation below the floor of a measure counts as the floor.",
        );
        for group in &self.groups {
            group.put(&mut page, frames, real)?;
        }
        Ok(page.finish())
    }
}

/// Shortens a name from a file to one line.
pub(crate) fn named(name: &str) -> String {
    text::tail(name, 2 * text::WIDEST_NAME)
}

/// Returns a reduced copy of a frame; `None` if the number of pixels does not match its size.
pub(crate) fn small(picture: &Picture) -> Option<GrayImage> {
    let (width, height) = (u32::try_from(picture.width).ok()?, u32::try_from(picture.height).ok()?);
    let pixels = picture.grey.iter().map(|&grey| grey as u8).collect();
    let picture = GrayImage::from_raw(width, height, pixels)?;
    Some(if width > MAX_PICTURE_PX {
        imageops::thumbnail(&picture, MAX_PICTURE_PX, (height * MAX_PICTURE_PX / width).max(1))
    } else {
        picture
    })
}

impl fmt::Display for GroupComparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", named(&self.group))?;
        for (side, frames) in [("frames", &self.frames), ("real frames", &self.real)] {
            let names: Vec<String> = frames
                .iter()
                .map(|frame| text::tail(&frame.name, text::WIDEST_NAME))
                .collect();
            writeln!(f, "{side}: {}", text::some_of(&names))?;
        }
        let [ours, real, difference] = ["frames", "real frames", "difference"].map(Cell::number);
        let head = [Cell::from("measure"), ours, real, difference, Cell::from("verdict")];
        let table = Table::new(head).with(self.measures.iter().map(MeasureComparison::words));
        writeln!(f, "\n{}", table.text("  ", &[0, 16, 16, 10]))
    }
}

impl fmt::Display for LikenessReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.groups.iter().try_for_each(|group| group.fmt(f))?;
        for group in &self.groups {
            writeln!(f, "{}", group.summary())?;
        }
        for note in &self.notes {
            writeln!(f, "note: {note}")?;
        }
        Ok(())
    }
}
