//! Scanner overlay of a picture: a depth scale, a bar of the grey map, the side of the probe's mark, and the focus;
//! lines in colour.

use image::{Rgb, RgbImage};
use nalgebra::{Matrix4, Point3};

use super::canvas::{self, Colour, Point};
use crate::effects::point_spread::{Attenuation, PointSpread};
use crate::effects::tone::Tone;
use crate::synth::tables::Tables;

/// Colours of a workspace and of a path in it.
const REACH: Colour = [64, 220, 120];
const PATH: Colour = [90, 215, 255];
const INK: Colour = [235; 3];
const RIM: Colour = [0; 3];
/// Tick spacings of the scale, mm: the smallest with ticks at least [`APART`] pixels apart is used. Each fifth tick
/// is long and labelled with its depth in cm.
const TICKS_MM: [f64; 3] = [2.0, 10.0, 50.0];
const APART: f64 = 7.0;
/// Lengths of a short and a long tick, pixels.
const TICK: [f64; 2] = [4.0, 8.0];
/// Distance of marks from the edge of the picture, pixels.
const EDGE: u32 = 8;

/// Draws the marks over a grey picture, row by row, of the size in the tables. Marks outside it are clipped.
pub fn draw(pixels: &mut [u8], tables: &Tables) {
    let (width, height) = (tables.width() as u32, tables.height() as u32);
    let grey = pixels.iter().flat_map(|&grey| [grey; 3]).collect();
    let Some(mut picture) = RgbImage::from_raw(width, height, grey) else {
        return;
    };
    bar(&mut picture, tables.settings.effects.tone.as_ref());
    scale(&mut picture, tables);
    mark(&mut picture, tables);
    for (grey, Rgb([value, ..])) in pixels.iter_mut().zip(picture.pixels()) {
        *grey = *value;
    }
}

/// Tints the part of a grey picture whose points in the plane of the probe (lateral, axial, mm) a needle reaches,
/// outlines it, and draws a path of the needle's tip with a disc at its end.
pub fn workspace(pixels: &[u8], tables: &Tables, reaches: impl Fn([f64; 2]) -> bool, path: &[[f64; 2]]) -> RgbImage {
    let (width, height) = (tables.width() as u32, tables.height() as u32);
    let grid = &tables.image_grid;
    let within = |column: u32, row: u32| {
        let reaches_at = |column: f64, row: f64| reaches(grid.to_plane(column, row));
        [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]
            .map(|[right, down]| reaches_at(f64::from(column) + right, f64::from(row) + down))
    };
    let mut picture = RgbImage::from_fn(width, height, |column, row| {
        let grey = f64::from(pixels[(row * width + column) as usize]);
        let [here, right, below] = within(column, row);
        let share = match (here == right && here == below, here) {
            (false, _) => 0.9,
            (true, true) => 0.18,
            (true, false) => 0.0,
        };
        Rgb(REACH.map(|colour| (grey * (1.0 - share) + f64::from(colour) * share).round() as u8))
    });
    let points: Vec<Point> = path.iter().map(|[x, y]| grid.to_pixel(*x, *y)).collect();
    for (width, colour, share) in [(3.6, RIM, 0.7), (1.8, PATH, 1.0)] {
        for pair in points.windows(2) {
            canvas::line(&mut picture, [pair[0], pair[1]], width, colour, share);
        }
    }
    if let Some(end) = points.last() {
        canvas::disc(&mut picture, *end, 4.0, RIM);
        canvas::disc(&mut picture, *end, 3.0, PATH);
    }
    picture
}

/// A line in the world to draw over a picture.
#[derive(Clone, Debug)]
pub struct Line {
    /// Corners, mm.
    pub points: Vec<Point3<f64>>,
    /// Colour, sRGB.
    pub colour: [u8; 3],
    /// Width, pixels.
    pub width: f64,
}

/// Returns a grey picture of the size in the tables with lines over it, projected square onto the image plane, and a
/// cross at each of the `marks` (mm).
pub fn lines(
    pixels: &[u8],
    tables: &Tables,
    world_to_probe: &Matrix4<f64>,
    lines: &[Line],
    marks: &[Point3<f64>],
) -> RgbImage {
    let (width, height) = (tables.width() as u32, tables.height() as u32);
    let grey = pixels.iter().flat_map(|&grey| [grey; 3]).collect();
    let mut picture = RgbImage::from_raw(width, height, grey).unwrap_or_else(|| RgbImage::new(width, height));
    let pixel = |point: &Point3<f64>| {
        let point = world_to_probe.transform_point(point);
        tables.image_grid.to_pixel(point.x, point.y)
    };
    for line in lines {
        for pair in line.points.windows(2) {
            let ends = [pixel(&pair[0]), pixel(&pair[1])];
            canvas::line(&mut picture, ends, line.width + 1.6, RIM, 0.6);
            canvas::line(&mut picture, ends, line.width, line.colour, 1.0);
        }
    }
    for mark in marks {
        let [x, y] = pixel(mark);
        for (size, colour) in [(3.4, RIM), (1.6, [255, 214, 64])] {
            canvas::line(&mut picture, [[x - 6.0, y], [x + 6.0, y]], size, colour, 1.0);
            canvas::line(&mut picture, [[x, y - 6.0], [x, y + 6.0]], size, colour, 1.0);
        }
    }
    picture
}

/// Draws the greys of the dynamic range, the brightest on top.
fn bar(picture: &mut RgbImage, tone: Option<&Tone>) {
    let [left, top, wide, high] = [EDGE, EDGE, 10, picture.height() / 4].map(f64::from);
    let outline = [
        [left - 1.0, top - 1.0],
        [left + wide, top - 1.0],
        [left + wide, top + high],
        [left - 1.0, top + high],
    ];
    canvas::outline(picture, &outline, 1.0, INK);
    for row in 0..high as u32 {
        let share = 1.0 - (f64::from(row) + 0.5) / high;
        let grey = (255.0 * tone.map_or(share, |tone| tone.shown(share))).round() as u8;
        let y = top + f64::from(row);
        canvas::line(picture, [[left, y], [left + wide - 1.0, y]], 1.0, [grey; 3], 1.0);
    }
}

/// Draws the depth below the middle of the array along the right edge, and a triangle at the focus.
fn scale(picture: &mut RgbImage, tables: &Tables) {
    let row = |depth_mm: f64| tables.image_grid.to_pixel(0.0, depth_mm)[1];
    let right = f64::from(picture.width()) - 1.0;
    let distance_px = |tick_mm: f64| (row(tick_mm) - row(0.0)).abs();
    let [.., largest] = TICKS_MM;
    let tick_mm = TICKS_MM
        .into_iter()
        .find(|&tick_mm| distance_px(tick_mm) >= APART)
        .unwrap_or(largest);
    let [_, high] = canvas::text_size("0", 1);
    for tick in 0..=(tables.grid.depth_mm() / tick_mm) as u32 {
        let y = row(tick_mm * f64::from(tick));
        let length = TICK[usize::from(tick % 5 == 0)];
        canvas::line(picture, [[right - length, y], [right, y]], 3.0, RIM, 1.0);
        canvas::line(picture, [[right - length, y], [right, y]], 1.0, INK, 1.0);
        if tick % 5 == 0 && tick > 0 {
            let text = format!("{} cm", tick_mm * f64::from(tick) / 10.0);
            let [wide, _] = canvas::text_size(&text, 1);
            let corner = [right - TICK[1] - 4.0 - f64::from(wide), y - f64::from(high / 2)];
            if corner.iter().all(|&x| x >= 1.0) {
                canvas::text(picture, corner.map(|x| x.round() as u32), &text, 1, INK);
            }
        }
    }
    let settings = &tables.settings;
    if let Some(speckle) = &settings.effects.speckle {
        let y = row(PointSpread::new(speckle, &settings.probe, Attenuation::default()).focus_mm);
        let [wide, _] = canvas::text_size("100 cm", 1);
        let tip = right - TICK[1] - 6.0 - f64::from(wide);
        arrow(picture, [tip, y]);
    }
}

/// Draws a triangle that points to the right.
fn arrow(picture: &mut RgbImage, [x, y]: Point) {
    for (size, colour) in [(6.0, RIM), (4.0, INK)] {
        let corners = [
            [x - 2.0 * size + 4.0, y - size],
            [x - 2.0 * size + 4.0, y + size],
            [x + size - 4.0, y],
        ];
        canvas::fill(picture, &corners, colour, 1.0);
    }
}

/// Draws a disc beside the marked end of the array.
fn mark(picture: &mut RgbImage, tables: &Tables) {
    let [x, y] = tables.grid.to_plane(tables.lines() as f64 - 0.5, -0.5);
    let within = |coordinate: f64, side: u32| coordinate.clamp(f64::from(EDGE), f64::from(side.max(2 * EDGE) - EDGE));
    let [column, row] = tables.image_grid.to_pixel(x, y);
    let centre = [within(column + 10.0, picture.width()), within(row, picture.height())];
    canvas::disc(picture, centre, 5.0, RIM);
    canvas::disc(picture, centre, 4.0, INK);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::anatomies::two_layers as scene;

    fn tables(width: usize, height: usize) -> Tables {
        let (anatomy, mut settings, _) = scene();
        (settings.image.width, settings.image.height) = (width, height);
        Tables::new(anatomy, settings).unwrap()
    }

    /// On black: 6 cm of depth under a linear probe, in ticks of 2 mm, the focus at 3 cm, and the bar of the grey map.
    #[test]
    fn marks_are_where_their_depths_are() {
        let tables = tables(320, 240);
        let mut pixels = vec![0; 320 * 240];
        draw(&mut pixels, &tables);
        let at = |column: f64, row: f64| pixels[row.round() as usize * 320 + column.round() as usize];
        let row = |depth_mm: f64| tables.image_grid.to_pixel(0.0, depth_mm)[1];
        for tick in 0..30 {
            assert!(at(318.0, row(2.0 * f64::from(tick))) > 100, "tick {tick}");
            assert!(at(318.0, row(2.0 * f64::from(tick) + 1.0)) < 20, "between ticks {tick}");
            assert_eq!(at(312.0, row(2.0 * f64::from(tick))) > 100, tick % 5 == 0);
        }
        let [wide, _] = canvas::text_size("100 cm", 1);
        assert!(at(319.0 - 8.0 - 6.0 - f64::from(wide) - 2.0, row(30.0)) > 200, "focus");
        let tone = Tone::default();
        for (share, line) in [(1.0 - 0.5 / 60.0, 8.0), (0.5 / 60.0, 67.0)] {
            let expected = 255.0 * tone.shown(share);
            assert!((f64::from(at(12.0, line)) - expected).abs() <= 1.0, "{share}");
        }
        let marked = tables.image_grid.to_pixel(19.0, 0.0);
        assert!(at(marked[0] + 10.0, marked[1].max(8.0)) > 200);
    }

    /// Left of the middle in reach, and a path down the middle of the right half.
    #[test]
    fn a_workspace_is_tinted_and_its_path_drawn() {
        let tables = tables(320, 240);
        let right = tables.image_grid.to_plane(240.0, 0.0)[0];
        let picture = workspace(
            &vec![40; 320 * 240],
            &tables,
            |[x, _]| x < 0.0,
            &[[right, 10.0], [right, 30.0]],
        );
        let at = |column: u32, row: u32| picture.get_pixel(column, row).0;
        let middle = tables.image_grid.to_pixel(0.0, 0.0)[0];
        let [left, border] = [middle as u32 / 2, middle.ceil() as u32 - 1];
        let tinted = at(left, 120);
        assert!(tinted[1] > tinted[0] && tinted[1] > 60, "{tinted:?}");
        assert!(at(border, 120)[1] > 180 && at(border + 20, 120) == [40; 3]);
        let row = tables.image_grid.to_pixel(right, 20.0)[1].round() as u32;
        assert_eq!(at(240, row), PATH);
    }

    #[test]
    fn small_pictures_are_marked_as_far_as_they_go() {
        for (width, height) in [(1, 1), (3, 40), (40, 3), (16, 16)] {
            let mut pixels = vec![9; width * height];
            draw(&mut pixels, &tables(width, height));
            assert_eq!(pixels.len(), width * height);
        }
    }
}
