//! Anti-aliased drawing on an sRGB picture, clipped to its bounds.

use image::{Rgb, RgbImage};

pub(crate) type Colour = [u8; 3];
pub(super) type Point = [f64; 2];

/// Blends `colour` over a pixel with an opacity of 0 to 1.
fn blend(picture: &mut RgbImage, x: u32, y: u32, colour: Colour, opacity: f64) {
    let Rgb(under) = picture.get_pixel_mut(x, y);
    for (under, over) in under.iter_mut().zip(colour) {
        *under = (f64::from(*under) * (1.0 - opacity) + f64::from(over) * opacity).round() as u8;
    }
}

/// Visits the pixels within a rectangle of corners `low` and `high`.
fn each_pixel(picture: &mut RgbImage, low: Point, high: Point, mut mark: impl FnMut(&mut RgbImage, u32, u32)) {
    let range = |low: f64, high: f64, side: u32| {
        let clip = |x: f64| x.clamp(0.0, f64::from(side)) as u32;
        clip(low.floor())..clip(high.ceil() + 1.0)
    };
    let (columns, rows) = (
        range(low[0], high[0], picture.width()),
        range(low[1], high[1], picture.height()),
    );
    for y in rows {
        for x in columns.clone() {
            mark(picture, x, y);
        }
    }
}

/// Draws a line with round ends and the given width in pixels.
pub(super) fn line(picture: &mut RgbImage, [a, b]: [Point; 2], width: f64, colour: Colour, opacity: f64) {
    let reach = width / 2.0 + 1.0;
    let low = [0, 1].map(|i| a[i].min(b[i]) - reach);
    let high = [0, 1].map(|i| a[i].max(b[i]) + reach);
    let along = [b[0] - a[0], b[1] - a[1]];
    let squared = along[0] * along[0] + along[1] * along[1];
    each_pixel(picture, low, high, |picture, x, y| {
        let to = [f64::from(x) - a[0], f64::from(y) - a[1]];
        let share = if squared > 0.0 {
            ((to[0] * along[0] + to[1] * along[1]) / squared).clamp(0.0, 1.0)
        } else {
            0.0
        };
        let distance = (to[0] - share * along[0]).hypot(to[1] - share * along[1]);
        let cover = (width / 2.0 + 0.5 - distance).clamp(0.0, 1.0);
        if cover > 0.0 {
            blend(picture, x, y, colour, cover * opacity);
        }
    });
}

/// Draws a closed outline.
pub(super) fn outline(picture: &mut RgbImage, polygon: &[Point], width: f64, colour: Colour) {
    for (i, &a) in polygon.iter().enumerate() {
        line(picture, [a, polygon[(i + 1) % polygon.len()]], width, colour, 1.0);
    }
}

/// Fills a polygon by the even-odd rule.
pub(super) fn fill(picture: &mut RgbImage, polygon: &[Point], colour: Colour, opacity: f64) {
    let extreme =
        |axis: usize, pick: fn(f64, f64) -> f64, start: f64| polygon.iter().map(|point| point[axis]).fold(start, pick);
    let low = [0, 1].map(|axis| extreme(axis, f64::min, f64::INFINITY));
    let high = [0, 1].map(|axis| extreme(axis, f64::max, f64::NEG_INFINITY));
    each_pixel(picture, low, high, |picture, x, y| {
        let centre = [f64::from(x), f64::from(y)];
        let mut inside = false;
        for (i, a) in polygon.iter().enumerate() {
            let b = polygon[(i + 1) % polygon.len()];
            if (a[1] > centre[1]) != (b[1] > centre[1]) {
                inside ^= centre[0] < a[0] + (centre[1] - a[1]) / (b[1] - a[1]) * (b[0] - a[0]);
            }
        }
        if inside {
            blend(picture, x, y, colour, opacity);
        }
    });
}

/// Draws a filled disc.
pub(super) fn disc(picture: &mut RgbImage, centre: Point, radius: f64, colour: Colour) {
    line(picture, [centre, centre], 2.0 * radius, colour, 1.0);
}

/// Rows of a glyph of 5 x 7 dots, the leftmost dot in the highest of five bits.
fn glyph(letter: char) -> [u8; 7] {
    match letter {
        'L' => [0b10000, 0b10000, 0b10000, 0b10000, 0b10000, 0b10000, 0b11111],
        'R' => [0b11110, 0b10001, 0b10001, 0b11110, 0b10100, 0b10010, 0b10001],
        'A' => [0b01110, 0b10001, 0b10001, 0b11111, 0b10001, 0b10001, 0b10001],
        'P' => [0b11110, 0b10001, 0b10001, 0b11110, 0b10000, 0b10000, 0b10000],
        'H' => [0b10001, 0b10001, 0b10001, 0b11111, 0b10001, 0b10001, 0b10001],
        'F' => [0b11111, 0b10000, 0b10000, 0b11110, 0b10000, 0b10000, 0b10000],
        'm' => [0b00000, 0b00000, 0b11010, 0b10101, 0b10101, 0b10101, 0b10101],
        '0' => [0b01110, 0b10001, 0b10011, 0b10101, 0b11001, 0b10001, 0b01110],
        '1' => [0b00100, 0b01100, 0b00100, 0b00100, 0b00100, 0b00100, 0b01110],
        '2' => [0b01110, 0b10001, 0b00001, 0b00110, 0b01000, 0b10000, 0b11111],
        '3' => [0b01110, 0b10001, 0b00001, 0b00110, 0b00001, 0b10001, 0b01110],
        '4' => [0b00010, 0b00110, 0b01010, 0b10010, 0b11111, 0b00010, 0b00010],
        '5' => [0b11111, 0b10000, 0b11110, 0b00001, 0b00001, 0b10001, 0b01110],
        '6' => [0b01110, 0b10000, 0b10000, 0b11110, 0b10001, 0b10001, 0b01110],
        '7' => [0b11111, 0b00001, 0b00010, 0b00100, 0b01000, 0b01000, 0b01000],
        '8' => [0b01110, 0b10001, 0b10001, 0b01110, 0b10001, 0b10001, 0b01110],
        '9' => [0b01110, 0b10001, 0b10001, 0b01111, 0b00001, 0b00001, 0b01110],
        'u' => [0b00000, 0b00000, 0b10001, 0b10001, 0b10001, 0b10011, 0b01101],
        '%' => [0b11001, 0b11010, 0b00010, 0b00100, 0b01000, 0b01011, 0b10011],
        '-' => [0b00000, 0b00000, 0b00000, 0b11111, 0b00000, 0b00000, 0b00000],
        '.' => [0b00000, 0b00000, 0b00000, 0b00000, 0b00000, 0b01100, 0b01100],
        'c' => [0b00000, 0b00000, 0b01110, 0b10001, 0b10000, 0b10001, 0b01110],
        _ => [0; 7],
    }
}

/// Width and height of a text, pixels.
pub fn text_size(text: &str, dot: u32) -> [u32; 2] {
    let letters = text.chars().count() as u32;
    [(letters * 6).saturating_sub(1) * dot, 7 * dot]
}

/// Draws a text whose upper left dot is at `corner`, with dots of `dot` pixels and a dark rim.
pub fn text(picture: &mut RgbImage, corner: [u32; 2], text: &str, dot: u32, colour: Colour) {
    for (rim, ink) in [(1i64, [0, 0, 0]), (0, colour)] {
        for (index, letter) in text.chars().enumerate() {
            for (row, bits) in glyph(letter).into_iter().enumerate() {
                for column in (0..5).filter(|column| bits >> (4 - column) & 1 == 1) {
                    let x = i64::from(corner[0]) + (index as i64 * 6 + column) * i64::from(dot);
                    let y = i64::from(corner[1]) + row as i64 * i64::from(dot);
                    square(picture, [x - rim, y - rim], i64::from(dot) + 2 * rim, ink);
                }
            }
        }
    }
}

fn square(picture: &mut RgbImage, [left, top]: [i64; 2], side: i64, colour: Colour) {
    for y in top.max(0)..(top + side).min(i64::from(picture.height())) {
        for x in left.max(0)..(left + side).min(i64::from(picture.width())) {
            picture.put_pixel(x as u32, y as u32, Rgb(colour));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WHITE: Colour = [255; 3];

    fn lit(picture: &RgbImage) -> f64 {
        picture.pixels().map(|pixel| f64::from(pixel.0[0]) / 255.0).sum()
    }

    #[test]
    fn marks_cover_their_area() {
        let mut picture = RgbImage::new(100, 100);
        disc(&mut picture, [50.0, 50.0], 20.0, WHITE);
        assert!((lit(&picture) / (std::f64::consts::PI * 400.0) - 1.0).abs() < 0.01);
        let mut picture = RgbImage::new(100, 100);
        fill(&mut picture, &[[10.2, 10.2], [60.2, 10.2], [10.2, 60.2]], WHITE, 1.0);
        assert!((lit(&picture) / 1250.0 - 1.0).abs() < 0.05);
        let mut picture = RgbImage::new(100, 100);
        line(&mut picture, [[20.0, 30.0], [80.0, 30.0]], 3.0, WHITE, 0.5);
        assert!(
            (lit(&picture) - (60.0 * 3.0 + 2.25 * std::f64::consts::PI) / 2.0).abs() < 3.0,
            "{}",
            lit(&picture)
        );
    }

    #[test]
    fn marks_beyond_the_picture_are_clipped() {
        let mut picture = RgbImage::new(10, 10);
        for far in [-1e12, 1e12, f64::MAX] {
            line(&mut picture, [[far, far], [far, 5.0]], 2.0, WHITE, 1.0);
            fill(&mut picture, &[[far, 0.0], [far, 5.0], [far, 7.0]], WHITE, 1.0);
            disc(&mut picture, [far, far], 2.0, WHITE);
        }
        assert_eq!(lit(&picture), 0.0);
        text(&mut picture, [8, 8], "R", 2, WHITE);
        assert!(lit(&picture) > 0.0);
    }
}
