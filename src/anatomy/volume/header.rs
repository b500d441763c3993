//! Common header of image files of all formats.

use std::collections::BTreeMap;
use std::io;
use std::path::PathBuf;

use nalgebra::{Matrix3, Matrix4, Vector3};

use super::element::{ByteOrder, Element, Scale};
use super::error::{At, VolumeError};
use insonify_base::matrix::FARTHEST_MM;

/// Largest image, bytes of decoded data. A header that requires more is considered broken.
const MAX_DATA_BYTES: u64 = 16 << 30;

/// Determinant of the unit axis directions below which the axes are considered coplanar.
const MIN_DETERMINANT: f64 = 1e-6;

/// Largest spacing, mm: ten metres, far beyond any body, so that coordinates of a volume of any size are finite.
const MAX_SPACING_MM: f64 = 1e4;

/// Deviation from a right angle between axes above which a transform is reported as sheared, degrees. Rounded direction
/// cosines of real scanners stay below.
const SHEAR_DEG: f64 = 0.1;

/// An index axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axis {
    /// Number of samples along the axis.
    pub size: usize,
    /// Step from one sample to the next, LPS mm; `None` if the axis is not spatial.
    pub direction: Option<Vector3<f64>>,
}

/// Encoding of the data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// Binary numbers, not compressed.
    Raw,
    /// Binary numbers, compressed with gzip.
    Gzip,
    /// Binary numbers, compressed with zlib.
    Zlib,
    /// Binary numbers, compressed with bzip2.
    Bzip2,
    /// Numbers as text, separated by white space or commas.
    Text,
}

/// Bytes between the start of the encoded data and the first number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Skip {
    /// A number of bytes, counted after decompression.
    Bytes(u64),
    /// All but as many bytes as the image needs, counted from the end.
    AllButTheImage,
}

/// Location of the data.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DataPlace {
    /// File that holds the data, or the first part of them.
    pub path: PathBuf,
    /// Files with the other parts, all of one size, in order.
    pub more: Vec<PathBuf>,
    /// Position in the header of the name of that file, if it is a separate one.
    pub named: Option<At>,
    /// Offset in that file of the data, or of the lines to skip, bytes.
    pub start: u64,
    /// Number of lines to skip before decompression.
    pub skip_lines: usize,
    /// Bytes to skip before the first number.
    pub skip: Skip,
    /// How the numbers are stored.
    pub encoding: Encoding,
}

/// A parsed image header.
#[derive(Clone, Debug)]
pub struct Header {
    /// File that holds the header.
    pub path: PathBuf,
    /// Index axes, fastest first.
    pub axes: Vec<Axis>,
    /// Centre of the first voxel, LPS mm.
    pub origin: Vector3<f64>,
    /// Unit of length that the file states; `None` if it states none that is known, and mm were taken.
    pub unit: Option<String>,
    /// Type of the numbers; `None` if the file states that it holds no image.
    pub element: Option<Element>,
    /// Byte order of binary numbers.
    pub order: ByteOrder,
    /// Scale from stored numbers to values; `None` if they are the values.
    pub scale: Option<Scale>,
    /// Where the numbers are stored.
    pub data: DataPlace,
    /// User-defined keys and values, in file order.
    pub key_values: Vec<(String, String)>,
    /// Names of label values.
    pub names: BTreeMap<i64, String>,
    /// Warnings about the file, for the user.
    pub warnings: Vec<String>,
}

/// Size and position of a three-dimensional image.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    /// Number of voxels along each axis.
    pub size: [usize; 3],
    /// Transform from voxel index to LPS mm.
    pub index_to_world: Matrix4<f64>,
    /// Largest deviation of the axes from right angles, degrees, if they are not perpendicular.
    pub shear_deg: Option<f64>,
}

impl Header {
    /// Sizes as text, fastest axis first.
    pub fn sizes(&self) -> String {
        let sizes: Vec<String> = self.axes.iter().map(|axis| axis.size.to_string()).collect();
        sizes.join(" x ")
    }

    /// An error about an invalid value in the header.
    pub fn malformed(&self, found: impl Into<String>, expected: impl Into<String>) -> VolumeError {
        VolumeError::malformed(&self.path, At::Header, found, expected)
    }

    /// An error about an unsupported feature in the header.
    pub fn unsupported(&self, found: impl Into<String>, expected: impl Into<String>) -> VolumeError {
        VolumeError::unsupported(&self.path, At::Header, found, expected)
    }

    /// An error about the data file.
    pub fn unreadable(&self, cause: io::Error) -> VolumeError {
        match self.data.named {
            None => VolumeError::read(&self.path, cause),
            Some(link) => VolumeError::Data {
                path: self.path.clone(),
                at: link,
                data: self.data.path.clone(),
                cause,
            },
        }
    }

    /// Byte order of the decompressed numbers; numbers in text become little-endian.
    pub(crate) fn data_order(&self) -> ByteOrder {
        match self.data.encoding {
            Encoding::Text => ByteOrder::Little,
            _ => self.order,
        }
    }

    /// Type of the numbers.
    pub fn element(&self) -> Result<Element, VolumeError> {
        self.element.ok_or_else(|| {
            self.malformed(
                format!("no image (sizes {})", self.sizes()),
                "an image: this looks like a sequence of tracked poses alone",
            )
        })
    }

    /// Number of elements and bytes of the complete image.
    pub fn extent(&self) -> Result<(usize, usize), VolumeError> {
        let element = self.element()?;
        if self.axes.is_empty() || self.axes.iter().any(|axis| axis.size == 0) {
            return Err(self.malformed(
                format!("sizes {}", self.sizes()),
                "at least one sample along every axis",
            ));
        }
        self.axes
            .iter()
            .try_fold(1usize, |product, axis| product.checked_mul(axis.size))
            .and_then(|count| Some((count, count.checked_mul(element.bytes())?)))
            .filter(|&(_, bytes)| bytes as u64 <= MAX_DATA_BYTES)
            .ok_or_else(|| {
                self.malformed(
                    format!("sizes {} of {}", self.sizes(), element.name()),
                    format!("at most {} GiB of data", MAX_DATA_BYTES >> 30),
                )
            })
    }

    /// Grid of the image. A two-dimensional image is one slice of 1 mm.
    pub fn grid(&self) -> Result<Grid, VolumeError> {
        let mut size = [1; 3];
        let mut directions: Vec<Vector3<f64>> = Vec::with_capacity(3);
        for (number, axis) in self.axes.iter().enumerate() {
            match axis.direction {
                Some(direction) if directions.len() < 3 => {
                    size[directions.len()] = axis.size;
                    directions.push(direction);
                }
                _ if axis.size == 1 => {}
                Some(_) => {
                    return Err(self.unsupported(
                        format!("a {}-D image ({})", self.axes.len(), self.sizes()),
                        "volumes have three dimensions of space",
                    ));
                }
                None => {
                    return Err(self.unsupported(
                        format!("axis {number} of {} entries that is no direction of space", axis.size),
                        format!("volumes have three dimensions of space, this image is {}", self.sizes()),
                    ));
                }
            }
        }
        if directions.len() == 2 {
            let normal = directions[0].cross(&directions[1]);
            directions.push(normal.try_normalize(0.0).unwrap_or_else(Vector3::zeros));
        }
        let [x, y, z] = directions[..] else {
            return Err(self.unsupported(
                format!("an image with {} dimension of space", directions.len()),
                "volumes have two or three",
            ));
        };
        let linear = Matrix3::from_columns(&[x, y, z]);
        if !linear.iter().chain(self.origin.iter()).all(|n| n.is_finite()) {
            return Err(self.malformed(
                "a number that is not finite in the transform to the world",
                "finite spacing, directions and origin",
            ));
        }
        let steps = [x, y, z].map(|direction| direction.norm());
        if let Some(step) = steps.into_iter().find(|step| *step > MAX_SPACING_MM) {
            return Err(self.malformed(
                format!("a spacing of {step:e} mm"),
                format!("at most {MAX_SPACING_MM} mm; check the unit of the spacing"),
            ));
        }
        let units = [x, y, z].map(|direction| direction.try_normalize(0.0).unwrap_or_else(Vector3::zeros));
        let determinant = Matrix3::from_columns(&units).determinant().abs();
        // Written so that a NaN from an overflowing norm fails too.
        if !(determinant > MIN_DETERMINANT && linear.try_inverse().is_some()) {
            return Err(self.malformed(
                format!(
                    "axis steps ({}) mm, which span no volume",
                    [x, y, z]
                        // Adding 0 makes a 0 of -0.
                        .map(|d| format!("{} {} {}", d.x + 0.0, d.y + 0.0, d.z + 0.0))
                        .join(") (")
                ),
                "three independent directions with spacing above 0",
            ));
        }
        let mut index_to_world = linear.to_homogeneous();
        index_to_world.fixed_view_mut::<3, 1>(0, 3).copy_from(&self.origin);
        let last = Vector3::from(size.map(|n| n as f64 - 1.0));
        let farthest = self.origin.abs() + linear.abs() * last;
        if farthest.max() > FARTHEST_MM {
            return Err(self.malformed(
                format!("voxels up to {:e} mm from the origin of the world", farthest.max()),
                format!("at most {FARTHEST_MM:e} mm along each axis"),
            ));
        }
        let off_square = |a: usize, b: usize| units[a].dot(&units[b]).clamp(-1.0, 1.0).asin().to_degrees().abs();
        let worst = off_square(0, 1).max(off_square(1, 2)).max(off_square(0, 2));
        Ok(Grid {
            size,
            index_to_world,
            shear_deg: (worst > SHEAR_DEG).then_some(worst),
        })
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    pub(crate) fn header(axes: Vec<Axis>) -> Header {
        Header {
            path: PathBuf::from("test"),
            axes,
            origin: Vector3::zeros(),
            unit: None,
            element: Some(Element::F64),
            order: ByteOrder::Little,
            scale: None,
            data: DataPlace {
                path: PathBuf::from("test"),
                more: Vec::new(),
                named: None,
                start: 0,
                skip_lines: 0,
                skip: Skip::Bytes(0),
                encoding: Encoding::Raw,
            },
            key_values: Vec::new(),
            names: BTreeMap::new(),
            warnings: Vec::new(),
        }
    }

    fn axis(size: usize, x: f64, y: f64, z: f64) -> Axis {
        Axis {
            size,
            direction: Some(Vector3::new(x, y, z)),
        }
    }

    #[test]
    fn sizes_that_overflow_or_exceed_the_cap_are_refused() {
        for sizes in [[usize::MAX, 2, 2], [1 << 31, 1 << 31, 1], [1 << 12, 1 << 12, 1 << 8]] {
            let axes = sizes.map(|n| axis(n, 1.0, 0.0, 0.0)).to_vec();
            let message = header(axes).extent().unwrap_err().to_string();
            assert!(message.contains("expected at most 16 GiB"), "{message}");
        }
        let axes = vec![axis(4, 1.0, 0.0, 0.0), axis(0, 0.0, 1.0, 0.0)];
        assert!(
            header(axes)
                .extent()
                .unwrap_err()
                .to_string()
                .contains("at least one sample")
        );
    }

    #[test]
    fn slices_get_a_normal_and_lists_are_no_volume() {
        let flat = header(vec![axis(4, 0.0, 2.0, 0.0), axis(5, 2.0, 0.0, 0.0)])
            .grid()
            .unwrap();
        assert_eq!(flat.size, [4, 5, 1]);
        assert_eq!(flat.index_to_world.column(2).z, -1.0);
        let list = Axis {
            size: 7,
            direction: None,
        };
        let message = header(vec![axis(4, 1.0, 0.0, 0.0), axis(4, 0.0, 1.0, 0.0), list])
            .grid()
            .unwrap_err()
            .to_string();
        assert!(message.contains("axis 2 of 7 entries"), "{message}");
    }

    #[test]
    fn zero_nan_and_coplanar_directions_are_refused_and_shear_is_measured() {
        let with = |third: Axis| header(vec![axis(2, 1.0, 0.0, 0.0), axis(2, 0.0, 1.0, 0.0), third]).grid();
        assert!(
            with(axis(2, 0.0, 0.0, 0.0))
                .unwrap_err()
                .to_string()
                .contains("span no volume")
        );
        assert!(
            with(axis(2, 1.0, 1.0, 1e-9))
                .unwrap_err()
                .to_string()
                .contains("span no volume")
        );
        assert!(
            with(axis(2, 0.0, 0.0, f64::NAN))
                .unwrap_err()
                .to_string()
                .contains("not finite")
        );
        assert!(with(axis(2, 0.0, 0.0, 1e-200)).is_err());
        assert_eq!(with(axis(2, 0.0, 0.0, 3.0)).unwrap().shear_deg, None);
        let sheared = with(axis(2, 0.0, 1.0, 1.0)).unwrap().shear_deg.unwrap();
        assert!((sheared - 45.0).abs() < 1e-9, "{sheared}");
    }

    #[test]
    fn far_voxels_are_refused() {
        let mut far = header(vec![
            axis(16, 5.0, 0.0, 0.0),
            axis(2, 0.0, 1.0, 0.0),
            axis(2, 0.0, 0.0, 1.0),
        ]);
        for (x, refused) in [(-1e6, true), (1e6 - 75.0, false), (1e6 - 74.0, true), (1e20, true)] {
            far.origin.x = x;
            let grid = far.grid();
            assert_eq!(grid.is_err(), refused, "{x}: {grid:?}");
        }
        let message = far.grid().unwrap_err().to_string();
        assert!(
            message.contains("voxels up to 1e20 mm") && message.contains("at most 1e6 mm"),
            "{message}"
        );
    }
}
