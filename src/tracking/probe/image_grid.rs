//! Pixel grid of a frame, and its mapping to beam space.

use std::ops::Range;

use insonify_base::parallel::{chunks_mut, for_each};
use nalgebra::Matrix4;

use super::{BeamGrid, Bounds, ImageSpec};
use crate::error::{TrackingError, in_range};

/// Value in [`scan_map`] for a pixel outside the sector. Inside it the line coordinate is never negative.
pub const OUTSIDE: [f32; 2] = [-1.0, -1.0];

/// Pixels of a frame in the probe's plane: columns towards the marked side (x), rows away from the transducer (y),
/// which is PLUS's orientation MF. Integer coordinates are pixel centres. Pixels are square, except those of a
/// calibrated recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImageGrid {
    width: usize,
    height: usize,
    /// Steps from one column, and from one row, to the next.
    steps_mm: [[f64; 2]; 2],
    origin_mm: [f64; 2],
}

impl ImageGrid {
    /// Creates a grid of `width` by `height` pixels of size `pixel_mm` whose pixel (0, 0) is centred at `origin_mm` in
    /// the probe's plane.
    pub fn new(width: usize, height: usize, pixel_mm: f64, origin_mm: [f64; 2]) -> Result<Self, TrackingError> {
        Self::skewed(width, height, [[pixel_mm, 0.0], [0.0, pixel_mm]], origin_mm)
    }

    /// Creates a grid as [`ImageGrid::new`] does, with the steps (x, y) from one column and from one row to the
    /// next, mm.
    pub fn skewed(
        width: usize,
        height: usize,
        steps_mm: [[f64; 2]; 2],
        origin_mm: [f64; 2],
    ) -> Result<Self, TrackingError> {
        in_range::<ImageSpec>("image", "width", width as f64)?;
        in_range::<ImageSpec>("image", "height", height as f64)?;
        let grid = Self {
            width,
            height,
            steps_mm,
            origin_mm,
        };
        let area = grid.area_mm2();
        if !(area.is_finite() && area > 0.0 && origin_mm.iter().all(|x| x.is_finite())) {
            return Err(TrackingError::new(format!(
                "pixels in steps of {steps_mm:?} mm at origin {origin_mm:?} mm; expected finite numbers that span a plane"
            )));
        }
        Ok(grid)
    }

    /// Creates the largest view of the complete sector: centred laterally, its near edge at the top as on scanners,
    /// with a `margin` (fraction of the width and of the height) on each side.
    pub fn fit(beam: &BeamGrid, width: usize, height: usize, margin: f64) -> Result<Self, TrackingError> {
        in_range::<ImageSpec>("image", "margin", margin)?;
        let Bounds { min, max } = beam.bounds_mm();
        let room = [width, height].map(|pixels| pixels as f64 * (1.0 - 2.0 * margin));
        let pixel = ((max[0] - min[0]) / room[0]).max((max[1] - min[1]) / room[1]);
        let left = (min[0] + max[0]) / 2.0 - width as f64 * pixel / 2.0;
        let top = min[1] - height as f64 * margin * pixel;
        Self::new(width, height, pixel, [left + pixel / 2.0, top + pixel / 2.0])
    }

    /// Columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Pixel size, mm; that of a square of the same area if pixels are not square.
    pub fn pixel_mm(&self) -> f64 {
        self.area_mm2().sqrt()
    }

    fn area_mm2(&self) -> f64 {
        let [column, row] = self.steps_mm;
        column[0] * row[1] - column[1] * row[0]
    }

    /// Centre of pixel (0, 0) in the probe's plane, mm.
    pub fn origin_mm(&self) -> [f64; 2] {
        self.origin_mm
    }

    /// Point of the probe's plane (mm) at a column and row.
    pub fn to_plane(&self, column: f64, row: f64) -> [f64; 2] {
        [0, 1].map(|axis| self.origin_mm[axis] + column * self.steps_mm[0][axis] + row * self.steps_mm[1][axis])
    }

    /// Column and row of a point of the probe's plane (mm). Also defined outside the image.
    pub fn to_pixel(&self, x: f64, y: f64) -> [f64; 2] {
        let [x, y] = [x - self.origin_mm[0], y - self.origin_mm[1]];
        let [column, row] = self.steps_mm;
        [x * row[1] - y * row[0], y * column[0] - x * column[1]].map(|share| share / self.area_mm2())
    }

    /// Transform from the image frame (pixels) to the probe frame (mm), PLUS's `ImageToTransducer`: including spacing,
    /// with the third axis scaled like the others so that the matrix is invertible.
    pub fn image_to_probe(&self) -> Matrix4<f64> {
        let mut matrix = Matrix4::identity();
        for (column, vector) in [(0, self.steps_mm[0]), (1, self.steps_mm[1]), (3, self.origin_mm)] {
            matrix[(0, column)] = vector[0];
            matrix[(1, column)] = vector[1];
        }
        matrix[(2, 2)] = self.pixel_mm();
        matrix
    }
}

/// Computes the (line, sample) coordinates shown by each pixel of some rows, row by row; [`OUTSIDE`] if a pixel's
/// centre lies outside the sector. Rows outside the image are omitted. Computed in double precision.
///
/// A complete 8192 x 8192 image takes 512 MiB: process it in bands of rows.
pub fn scan_map(beam: &BeamGrid, image: &ImageGrid, rows: Range<usize>) -> Vec<[f32; 2]> {
    let first = rows.start.min(image.height);
    let rows = rows.end.clamp(first, image.height) - first;
    let mut map = vec![OUTSIDE; rows * image.width];
    for_each((0.., chunks_mut(&mut map, image.width)), &|(row, pixels)| {
        for (column, pixel) in pixels.iter_mut().enumerate() {
            let [x, y] = image.to_plane(column as f64, (first + row) as f64);
            if let Some((line, sample)) = beam.to_beam(x, y) {
                *pixel = [line as f32, sample as f32];
            }
        }
    });
    map
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::tests::one_of_each;
    use super::super::{Linear, Probe};
    use super::*;
    use crate::error::key;

    fn counted_area(beam: &BeamGrid, side: usize) -> f64 {
        let image = ImageGrid::fit(beam, side, side, 0.03).expect("image");
        let inside = scan_map(beam, &image, 0..side)
            .iter()
            .filter(|p| **p != OUTSIDE)
            .count();
        inside as f64 * image.pixel_mm().powi(2)
    }

    #[test]
    fn counted_pixels_converge_to_the_area_of_the_sector() {
        for probe in one_of_each() {
            let beam = BeamGrid::new(&probe).expect("beam");
            let area = beam.sector_area_mm2();
            let errors = [64, 1024].map(|side| (counted_area(&beam, side) / area - 1.0).abs());
            assert!(errors[0] < 0.04 && errors[1] < 0.0025, "{:?} {errors:?}", probe.shape);
        }
    }

    #[test]
    fn the_sector_fits_with_its_margin_and_touches_it() {
        for probe in one_of_each() {
            let beam = BeamGrid::new(&probe).expect("beam");
            for (width, height) in [(640, 480), (100, 900), (1, 1)] {
                let image = ImageGrid::fit(&beam, width, height, 0.1).expect("image");
                let bounds = beam.bounds_mm();
                let [left, top] = image.to_pixel(bounds.min[0], bounds.min[1]).map(|x| x + 0.5);
                let [right, bottom] = image.to_pixel(bounds.max[0], bounds.max[1]).map(|x| x + 0.5);
                let (w, h) = (width as f64, height as f64);
                assert!((top - 0.1 * h).abs() < 1e-9);
                assert!(left >= 0.1 * w - 1e-9 && right <= 0.9 * w + 1e-9 && bottom <= 0.9 * h + 1e-9);
                assert!((left + right - w).abs() < 1e-9);
                assert!((left - 0.1 * w).abs() < 1e-9 || (bottom - 0.9 * h).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn the_first_pixel_is_the_unmarked_near_corner() {
        let probe = Probe {
            shape: Linear { width_mm: 40.0 }.into(),
            ..one_of_each()[0]
        };
        let beam = BeamGrid::new(&probe).expect("beam");
        let image = ImageGrid::fit(&beam, 400, 800, 0.0).expect("image");
        assert!((image.pixel_mm() - 0.1).abs() < 1e-12);
        let map = scan_map(&beam, &image, 0..800);
        let (first, last) = (map[0], map[map.len() - 1]);
        assert!(first[0] < 0.1 && first[1] < 0.0, "{first:?}");
        assert!(last[0] > 31.9 && last[1] > 39.0, "{last:?}");
        let corner = image.image_to_probe() * nalgebra::Vector4::new(0.0, 0.0, 0.0, 1.0);
        assert!((corner.x + 19.95).abs() < 1e-12 && (corner.y - 0.05).abs() < 1e-12);
    }

    #[test]
    fn bands_join_to_the_whole_map() {
        let beam = BeamGrid::new(&one_of_each()[3]).expect("beam");
        let image = ImageGrid::fit(&beam, 57, 43, 0.0).expect("image");
        let mut joined = scan_map(&beam, &image, 0..10);
        joined.extend(scan_map(&beam, &image, 10..43));
        assert_eq!(joined, scan_map(&beam, &image, 0..usize::MAX));
        assert!(scan_map(&beam, &image, 50..60).is_empty());
    }

    #[test]
    fn one_pixel_and_very_many_pixels_work() {
        for probe in one_of_each() {
            let beam = BeamGrid::new(&probe).expect("beam");
            let one = ImageGrid::fit(&beam, 1, 1, 0.0).expect("image");
            let map = scan_map(&beam, &one, 0..1);
            // The middle of a full circle is the probe itself.
            let [x, y] = one.to_plane(0.0, 0.0);
            assert_eq!(map[0] == OUTSIDE, beam.to_beam(x, y).is_none(), "{:?}", probe.shape);
            assert_eq!(map[0] == OUTSIDE, probe.shape.kind().name() == "radial");
            let many = ImageGrid::fit(&beam, 8192, 8192, 0.0).expect("image");
            let map = scan_map(&beam, &many, 8000..8002);
            assert_eq!(map.len(), 2 * 8192);
            assert!(map.iter().flatten().all(|x| x.is_finite()));
        }
    }

    #[test]
    fn skewed_pixels_lie_at_their_steps() {
        let grid = ImageGrid::skewed(8, 6, [[0.2, 0.01], [-0.02, 0.3]], [-1.0, 2.0]).expect("grid");
        assert!((grid.pixel_mm().powi(2) - (0.2 * 0.3 + 0.01 * 0.02)).abs() < 1e-12);
        let [x, y] = grid.to_plane(3.0, 5.0);
        assert!((x - (-1.0 + 0.6 - 0.1)).abs() < 1e-12 && (y - (2.0 + 0.03 + 1.5)).abs() < 1e-12);
        let [column, row] = grid.to_pixel(x, y);
        assert!((column - 3.0).abs() < 1e-9 && (row - 5.0).abs() < 1e-9);
        let point = grid.image_to_probe() * nalgebra::Vector4::new(3.0, 5.0, 0.0, 1.0);
        assert!((point.x - x).abs() < 1e-12 && (point.y - y).abs() < 1e-12);
        let flat = ImageGrid::skewed(8, 6, [[0.2, 0.1], [0.4, 0.2]], [0.0; 2]);
        assert_eq!(key(flat), None);
    }

    #[test]
    fn sizes_and_margins_out_of_range_are_refused() {
        let beam = BeamGrid::new(&one_of_each()[0]).expect("beam");
        assert_eq!(key(ImageGrid::fit(&beam, 0, 5, 0.0)), Some("width"));
        assert_eq!(key(ImageGrid::fit(&beam, 5, usize::MAX, 0.0)), Some("height"));
        assert_eq!(key(ImageGrid::fit(&beam, 5, 5, 0.5)), Some("margin"));
        assert_eq!(key(ImageGrid::fit(&beam, 5, 5, f64::NAN)), Some("margin"));
        assert_eq!(key(ImageGrid::new(5, 5, 0.0, [0.0; 2])), None);
    }

    proptest! {
        #[test]
        fn pixel_to_beam_to_pixel_returns(kind in 0..one_of_each().len(), column in 0usize..320, row in 0usize..240) {
            let beam = BeamGrid::new(&one_of_each()[kind]).expect("beam");
            let image = ImageGrid::fit(&beam, 320, 240, 0.02).expect("image");
            let [x, y] = image.to_plane(column as f64, row as f64);
            if let Some((line, sample)) = beam.to_beam(x, y) {
                let [x, y] = beam.to_plane(line, sample);
                let [column_back, row_back] = image.to_pixel(x, y);
                prop_assert!((column_back - column as f64).abs() < 1e-9 && (row_back - row as f64).abs() < 1e-9);
            }
        }
    }
}
