//! Spatial calibration: from calibrated images to the simulated transducer.
//!
//! Trackers report the pose of a marker fixed to the probe, which PLUS calls `Probe`. A spatial calibration gives the
//! `Image` frame (pixels) in that frame, as `ImageToProbe`. The probe frame of insonify is PLUS's `Transducer`: the
//! origin at the centre of the array, x towards the marked side, y into the body, mm. In an image of orientation MF its
//! axes run along the columns and the rows, so a calibration and the pixel of the array's centre give the transducer in
//! the marker's frame ([`Calibration`]).

use nalgebra::{Matrix4, Vector3, Vector4};

use super::TrackingError;
use super::probe::ImageGrid;
use insonify_base::matrix;

/// Largest deviation of image axes from perpendicular, rad: the worst calibration among the configurations of
/// PlusLibData (`SpinePhantomFreehandReconstructionOnly`) is off by 0.05.
const SKEW: f64 = 0.1;

/// Relative difference of pixel sizes above which a warning is given.
const PIXEL_SHARE: f64 = 0.05;

/// Range of pixel sizes in a calibration, mm.
const PIXEL_MM: [f64; 2] = [1e-4, 100.0];

/// A calibrated image: the transform of the transducer, and the pixels in its plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration {
    transducer_to_probe: Matrix4<f64>,
    /// Steps of a column and of a row in the transducer's plane, mm.
    steps_mm: [[f64; 2]; 2],
    /// Lengths of the three axes, mm.
    lengths_mm: [f64; 3],
    /// Deviation of the image axes from perpendicular, rad.
    skew: f64,
    array_centre_px: [f64; 2],
}

impl Calibration {
    /// Creates a calibration from an image-to-probe matrix (MF orientation, pixels to mm) and the pixel (column, row)
    /// of the centre of the array. The transducer's axes are the image's, orthogonalised symmetrically. The third
    /// column of the matrix is not used, since a planar calibration does not measure it.
    pub fn new(image_to_probe: &Matrix4<f64>, array_centre_px: [f64; 2]) -> Result<Self, TrackingError> {
        let wrong = |text: String| TrackingError::new(format!("image-to-probe calibration: {text}"));
        if !array_centre_px.iter().all(|x| x.is_finite()) {
            return Err(TrackingError::new(format!(
                "transducer centre pixel {array_centre_px:?}; expected finite numbers"
            )));
        }
        let column = |axis| image_to_probe.fixed_view::<3, 1>(0, axis).into_owned();
        let lengths_mm = [0, 1, 2].map(|axis| column(axis).norm());
        let mut axes = [Vector3::zeros(); 2];
        for (axis, unit) in axes.iter_mut().enumerate() {
            let pixel_mm = lengths_mm[axis];
            if !(PIXEL_MM[0]..=PIXEL_MM[1]).contains(&pixel_mm) {
                let expected = format!("expected {:e} to {}", PIXEL_MM[0], PIXEL_MM[1]);
                return Err(wrong(format!("image axis {axis} is {pixel_mm} mm a pixel; {expected}")));
            }
            *unit = column(axis) / pixel_mm;
        }
        let skew = -axes[0].dot(&axes[1]).asin();
        if skew.abs() > SKEW {
            let [angle, limit] = [skew.abs(), SKEW].map(f64::to_degrees);
            let text = format!("the image axes are {angle:.2} degrees off square; expected at most {limit:.2}");
            return Err(wrong(text));
        }
        matrix::affine(image_to_probe).map_err(wrong)?;
        // Sum and difference of unit vectors are perpendicular whatever the angle between these: halves of them are the
        // nearest square axes.
        let [sum, difference] = [axes[0] + axes[1], axes[0] - axes[1]].map(|v| v.normalize());
        let (x, y) = ((sum + difference).normalize(), (sum - difference).normalize());
        let z = x.cross(&y);
        let origin = image_to_probe * Vector4::new(array_centre_px[0], array_centre_px[1], 0.0, 1.0);
        let mut transform = Matrix4::identity();
        for (column, axis) in [x, y, z, origin.xyz()].iter().enumerate() {
            transform.fixed_view_mut::<3, 1>(0, column).copy_from(axis);
        }
        Ok(Self {
            transducer_to_probe: matrix::rigid(&transform).map_err(wrong)?,
            steps_mm: [0, 1].map(|axis| [x, y].map(|along| lengths_mm[axis] * axes[axis].dot(&along))),
            lengths_mm,
            skew,
            array_centre_px,
        })
    }

    /// Calibration of the images that `crop` makes of these by a shift and a positive scale along columns and rows.
    pub fn cropped(&self, crop: &Matrix4<f64>) -> Self {
        let scale = [crop[(0, 0)], crop[(1, 1)]];
        let [columns, rows, planes] = self.lengths_mm;
        Self {
            steps_mm: [0, 1].map(|axis| self.steps_mm[axis].map(|step| step / scale[axis])),
            lengths_mm: [columns / scale[0], rows / scale[1], planes],
            array_centre_px: [0, 1].map(|axis| scale[axis] * self.array_centre_px[axis] + crop[(axis, 3)]),
            ..*self
        }
    }

    /// Rigid transform from the transducer to the frame of the marker on the probe, mm.
    pub fn transducer_to_probe(&self) -> &Matrix4<f64> {
        &self.transducer_to_probe
    }

    /// Pixel grid of the calibrated image in the transducer's plane.
    pub fn grid(&self, [width, height]: [usize; 2]) -> Result<ImageGrid, TrackingError> {
        let origin = self.beyond_centre_mm([0.0, 0.0]);
        ImageGrid::skewed(width, height, self.steps_mm, origin)
    }

    fn beyond_centre_mm(&self, pixel: [f64; 2]) -> [f64; 2] {
        let [column, row] = [0, 1].map(|axis| pixel[axis] - self.array_centre_px[axis]);
        [0, 1].map(|axis| column * self.steps_mm[0][axis] + row * self.steps_mm[1][axis])
    }

    /// Warning if the centre of the array lies outside images of this size by more than half of it.
    pub fn far_centre(&self, size: [usize; 2]) -> Option<String> {
        let [column, row] = self.array_centre_px;
        let is_far = |(pixel, side): (f64, usize)| !(-0.5..=1.5).contains(&(pixel / side as f64));
        let [width, height] = size;
        [(column, width), (row, height)].into_iter().any(is_far).then(|| {
            format!("the centre of the array is at pixel ({column}, {row}), far outside the images of {width} x {height}: is it meant?")
        })
    }

    /// Lengths of the columns of the calibration, mm: a pixel's width, its height, and the distance of planes.
    pub fn lengths_mm(&self) -> [f64; 3] {
        self.lengths_mm
    }

    /// Angle between the image axes, degrees.
    pub fn axes_apart_deg(&self) -> f64 {
        90.0 + self.skew.to_degrees()
    }

    /// Warning if a pixel size stated elsewhere (width, height, mm) differs by more than a twentieth.
    pub fn other_pixels(&self, stated_mm: [f64; 2]) -> Option<String> {
        let [columns, rows, _] = self.lengths_mm;
        let differ = |calibrated: f64, stated: f64| (calibrated / stated - 1.0).abs() > PIXEL_SHARE;
        (differ(columns, stated_mm[0]) || differ(rows, stated_mm[1])).then(|| {
            let [width, height] = stated_mm;
            format!("pixels are {columns:.4} x {rows:.4} mm by the calibration, and stated as {width} x {height} mm")
        })
    }

    /// Warning if the image axes are so far from perpendicular that orthogonalising them moves a pixel of an image of
    /// this size by half a pixel or more.
    pub fn skew_warning(&self, size: [usize; 2]) -> Option<String> {
        let (farthest, pixels) = self.moved(size)?;
        let [columns, rows, planes] = self.lengths_mm;
        let ([width, height], [angle, tilt]) = (size, self.apart_deg());
        Some(format!(
            "the image axes of the calibration are {angle:.2} degrees apart, not 90 (its columns are {columns:.4}, {rows:.4} and \
             {planes:.4} mm long). The transducer's axes are squared up, {tilt:.2} degrees off each of them: that moves pixels \
             of an image of {width} x {height} by up to {farthest:.2} mm ({pixels:.0} pixels), unless frames are made on \
             the recorded grid (`image.grid = \"recorded\"`)"
        ))
    }

    /// Note as [`Calibration::skew_warning`], for frames on the recorded grid, in which no pixel moves.
    pub fn skew_note(&self, size: [usize; 2]) -> Option<String> {
        let [angle, tilt] = self.apart_deg();
        self.moved(size).map(|_| {
            format!(
                "the image axes of the calibration are {angle:.2} degrees apart, not 90: pixels stay where it puts them, and the \
                 outline of the sector is tilted by {tilt:.2} degrees in the image"
            )
        })
    }

    /// Angles in degrees between the image axes, and between each of them and the transducer's.
    fn apart_deg(&self) -> [f64; 2] {
        [self.axes_apart_deg(), self.skew.abs().to_degrees() / 2.0]
    }

    /// Largest pixel displacement due to orthogonalisation in an image of this size, mm and pixels, if at least half a
    /// pixel.
    fn moved(&self, [width, height]: [usize; 2]) -> Option<(f64, f64)> {
        let corners = [[0, 0], [width, 0], [0, height], [width, height]];
        let moved_mm = corners.map(|corner| {
            let pixel = corner.map(|coordinate| coordinate as f64);
            let squared = [0, 1].map(|axis| self.lengths_mm[axis] * (pixel[axis] - self.array_centre_px[axis]));
            let [x, y] = self.beyond_centre_mm(pixel);
            (x - squared[0]).hypot(y - squared[1])
        });
        let farthest = moved_mm.into_iter().fold(0.0, f64::max);
        let pixels = farthest / (self.lengths_mm[0] * self.lengths_mm[1]).sqrt();
        (pixels >= 0.5).then_some((farthest, pixels))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Calibration of `BoneUltrasound_L14` of PlusLibData.
    fn tilted() -> Matrix4<f64> {
        Matrix4::from_row_slice(&[
            0.000_796_231,
            0.085_427_2,
            0.000_850_194,
            12.74,
            -0.085_399_9,
            0.000_772_721,
            0.002_336_53,
            50.76,
            0.002_328_63,
            -0.000_871_617,
            0.085_399_2,
            -0.5,
            0.0,
            0.0,
            0.0,
            1.0,
        ])
    }

    #[test]
    fn a_tilted_calibration_gives_a_square_transducer() {
        let image = tilted();
        let calibration = Calibration::new(&image, [410.0, 0.0]).expect("calibration");
        let transducer = calibration.transducer_to_probe();
        assert!((transducer[(0, 3)] - (12.74 + 410.0 * 0.000796231)).abs() < 1e-9);
        assert!((transducer[(1, 3)] - (50.76 - 410.0 * 0.0853999)).abs() < 1e-9);
        // A pixel 100 rows down the middle lies 100 pixel sizes along the transducer's y.
        let deep = image * Vector4::new(410.0, 100.0, 0.0, 1.0);
        let y = matrix::inverse_rigid(transducer) * deep;
        assert!(
            (y.y - 100.0 * 0.0854).abs() < 0.01 && y.x.abs() < 0.02 && y.z.abs() < 0.02,
            "{y}"
        );
        assert_eq!(calibration.skew_warning([820, 616]), None);
        assert_eq!(calibration.far_centre([820, 616]), None);
        let far = Calibration::new(&image, [4100.0, 0.0]).expect("calibration");
        let warning = far.far_centre([820, 616]).expect("a warning");
        assert!(
            warning.contains("(4100, 0), far outside the images of 820 x 616"),
            "{warning}"
        );
    }

    #[test]
    fn pixels_of_a_grid_lie_where_the_calibration_puts_them() {
        let mut image = tilted();
        // Three degrees off perpendicular, with pixels that are not square.
        for row in 0..3 {
            image[(row, 1)] = 0.9 * image[(row, 1)] + 0.05 * image[(row, 0)];
        }
        let calibration = Calibration::new(&image, [300.5, 20.0]).expect("calibration");
        let grid = calibration.grid([820, 616]).expect("grid");
        let through = calibration.transducer_to_probe() * grid.image_to_probe();
        for pixel in [[0.0, 0.0], [819.0, 0.0], [12.0, 600.0], [300.5, 20.0]] {
            let pixel = Vector4::new(pixel[0], pixel[1], 0.0, 1.0);
            assert!((through * pixel - image * pixel).amax() < 1e-9, "{pixel}");
        }
        let crop = Matrix4::from_row_slice(&[
            2.0, 0.0, 0.0, -670.0, 0.0, 0.5, 0.0, -90.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0,
        ]);
        let cropped = calibration.cropped(&crop);
        assert_eq!(cropped.transducer_to_probe(), calibration.transducer_to_probe());
        let grid = cropped.grid([100, 80]).expect("grid");
        let place = cropped.transducer_to_probe() * grid.image_to_probe() * Vector4::new(10.0, 6.0, 0.0, 1.0);
        assert!(
            (place - image * Vector4::new(340.0, 192.0, 0.0, 1.0)).amax() < 1e-9,
            "{place}"
        );
        let warning = calibration.skew_warning([820, 616]).expect("a warning");
        assert!(warning.contains("86.82 degrees apart"), "{warning}");
    }

    #[test]
    fn calibrations_that_make_no_sense_are_refused() {
        let centre = [0.0, 0.0];
        let flat = Matrix4::zeros();
        let refused = |matrix: &Matrix4<f64>, centre, reason: &str| {
            let error = Calibration::new(matrix, centre).expect_err(reason).to_string();
            assert!(error.contains(reason), "{error}");
        };
        refused(&flat, centre, "image axis 0 is 0 mm a pixel");
        let nan = Matrix4::from_element(f64::NAN);
        refused(&nan, centre, "mm a pixel");
        let mut skewed = Matrix4::new_scaling(0.1);
        skewed[(0, 1)] = 0.05;
        refused(&skewed, centre, "26.57 degrees off square; expected at most 5.73");
        let fine = Matrix4::new_scaling(0.1);
        let transposed = Matrix4::new_translation(&Vector3::new(12.7, 50.8, -0.5)).transpose() * fine;
        refused(&transposed, centre, "is the matrix transposed");
        refused(&fine, [f64::NAN, 0.0], "transducer centre pixel");
        refused(&fine, [1e9, 0.0], "farther than 1e6 mm");
    }
}
