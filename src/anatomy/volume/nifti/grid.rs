//! Axes of a NIfTI image in the world.

use std::path::Path;

use nalgebra::{Matrix3x4, Point3, Quaternion, UnitQuaternion, Vector3};

use super::fields::Fields;
use crate::volume::error::{At, VolumeError};
use crate::volume::header::Axis;
use crate::volume::unit::millimetres;

/// Relative deviation of the sform's steps from the voxel sizes that is told. Rounding in single precision stays below.
const SAME_STEP: f64 = 0.01;

/// Index axes and origin in LPS mm, from sform, else qform, else the voxel sizes alone (`nifti1.h`, methods 3, 2, 1).
pub(super) fn axes(
    path: &Path,
    raw: &Fields,
    warnings: &mut Vec<String>,
) -> Result<(Vec<Axis>, Vector3<f64>), VolumeError> {
    let sizes = sizes(path, raw)?;
    let mm = unit(raw).and_then(millimetres).unwrap_or(1.0);
    let sform = Matrix3x4::from_fn(|row, column| raw.srow[row][column]);
    let is_flat = (0..sizes.len().min(3)).any(|axis| (axis < 2 || sizes[axis] > 1) && sform.column(axis).norm() == 0.0);
    if raw.sform_code > 0 && is_flat {
        let other = if raw.qform_code > 0 {
            "qform is"
        } else {
            "voxel sizes are"
        };
        warnings.push(format!("the sform spans no volume: the {other} used"));
    }
    let by_sform = raw.sform_code > 0 && !is_flat;
    let affine = if by_sform {
        let mut affine = sform;
        warnings.extend(take_missing_scale(raw, &sizes, &mut affine, mm));
        warnings.extend(contradiction(raw, &sizes, &affine, mm));
        affine
    } else {
        let spacing = spacing(path, raw, sizes.len())?;
        if raw.qform_code > 0 {
            qform(raw, spacing)
        } else {
            warnings.push("no sform and no qform: placed by its voxel sizes alone, taken as RAS".to_owned());
            let [x, y, z] = spacing;
            #[rustfmt::skip]
            let base = Matrix3x4::new(
                x, 0.0, 0.0, 0.0,
                0.0, y, 0.0, 0.0,
                0.0, 0.0, z, 0.0,
            );
            base
        }
    };
    let lps = |column: usize| {
        let ras = affine.column(column) * mm;
        Vector3::new(-ras.x, -ras.y, ras.z)
    };
    let axes = sizes
        .iter()
        .enumerate()
        .map(|(number, &size)| {
            let direction = (number < 3).then(|| lps(number));
            // A single slice may leave its own direction empty; it then gets the normal of the other two.
            let is_unstated = |d: Vector3<f64>| d.norm() == 0.0 || (!by_sform && raw.pixdim[3] == 0.0);
            let empty = size == 1 && number == 2 && direction.is_some_and(is_unstated);
            Axis {
                size,
                direction: direction.filter(|_| !empty),
            }
        })
        .collect();
    Ok((axes, lps(3)))
}

/// Unit of length in the low three bits of xyzt_units (`nifti1.h`); `None` if unknown.
pub(super) fn unit(raw: &Fields) -> Option<&'static str> {
    match raw.xyzt_units & 7 {
        1 => Some("m"),
        2 => Some("mm"),
        3 => Some("um"),
        _ => None,
    }
}

/// Sizes of the axes that the header has.
fn sizes(path: &Path, raw: &Fields) -> Result<Vec<usize>, VolumeError> {
    let sizes = usize::try_from(raw.dim[0])
        .ok()
        .filter(|dimensions| (1..=7).contains(dimensions))
        .and_then(|dimensions| {
            let sizes = raw.dim[1..=dimensions].iter();
            sizes
                .map(|&size| usize::try_from(size).ok().filter(|&size| size > 0))
                .collect()
        });
    sizes.ok_or_else(|| {
        let found = format!("dim {:?}", raw.dim);
        let byte = At::Byte(raw.layout.dim as u64);
        VolumeError::malformed(path, byte, found, "1 to 7 dimensions, each of at least 1 voxel")
    })
}

fn spacing(path: &Path, raw: &Fields, dimensions: usize) -> Result<[f64; 3], VolumeError> {
    let mut spacing = [1.0; 3];
    for (axis, value) in spacing.iter_mut().enumerate().take(dimensions) {
        let found = raw.pixdim[axis + 1];
        let unused = found == 0.0 && raw.dim[axis + 1] == 1;
        if !(unused || found > 0.0 && found.is_finite()) {
            let text = format!("pixdim {:?}", &raw.pixdim[1..4]);
            let byte = At::Byte(raw.layout.pixdim as u64);
            return Err(VolumeError::malformed(
                path,
                byte,
                text,
                "voxel sizes above 0 and finite",
            ));
        }
        if !unused {
            *value = found;
        }
    }
    Ok(spacing)
}

/// `nifti1.h`, method 2: a unit quaternion whose real part is implied, and a handedness in `pixdim[0]`.
fn qform(raw: &Fields, spacing: [f64; 3]) -> Matrix3x4<f64> {
    let [b, c, d, ..] = raw.quatern;
    let real = (1.0 - (b * b + c * c + d * d)).max(0.0).sqrt();
    let rotation = UnitQuaternion::from_quaternion(Quaternion::new(real, b, c, d)).to_rotation_matrix();
    let handedness = if raw.pixdim[0] < 0.0 { -1.0 } else { 1.0 };
    let scale = [spacing[0], spacing[1], spacing[2] * handedness];
    Matrix3x4::from_fn(|row, column| {
        if column < 3 {
            rotation[(row, column)] * scale[column]
        } else {
            raw.quatern[3 + row]
        }
    })
}

/// Whether a number differs from another by more than rounding in single precision does.
fn differs(number: f64, other: f64) -> bool {
    (number / other - 1.0).abs() > SAME_STEP
}

/// Whether pixdim states the voxel size of an axis. Of one voxel neither it nor the sform says anything.
fn states_size(raw: &Fields, sizes: &[usize], axis: usize) -> bool {
    let size = raw.pixdim[axis + 1];
    sizes[axis] > 1 && size > 0.0 && size.is_finite()
}

/// Words for the voxels of the sform and those of pixdim, if they differ.
fn two_sizes(raw: &Fields, sizes: &[usize], sform: &Matrix3x4<f64>, mm: f64) -> Option<String> {
    let axes = 0..sizes.len().min(3);
    let step = |axis: usize| sform.column(axis).norm();
    let size = |axis: usize| raw.pixdim[axis + 1];
    let list = |value: &dyn Fn(usize) -> f64| {
        let values: Vec<String> = axes.clone().map(|axis| short(value(axis) * mm)).collect();
        values.join(" x ")
    };
    axes.clone()
        .any(|axis| states_size(raw, sizes, axis) && differs(step(axis), size(axis)))
        .then(|| {
            format!(
                "the sform has voxels of {} mm, pixdim says {} mm",
                list(&step),
                list(&size)
            )
        })
}

/// Scales the axes of an sform whose steps are all 1 by the voxel sizes: some programs write directions alone, and
/// those that are made with ITK read voxel sizes from pixdim. Returns a warning.
fn take_missing_scale(raw: &Fields, sizes: &[usize], sform: &mut Matrix3x4<f64>, mm: f64) -> Option<String> {
    let text = two_sizes(raw, sizes, sform, mm)?;
    let axes = 0..sizes.len().min(3);
    let is_bare =
        |axis: usize| sizes[axis] == 1 || (states_size(raw, sizes, axis) && !differs(sform.column(axis).norm(), 1.0));
    if !axes.clone().all(is_bare) {
        return None;
    }
    for axis in axes.filter(|axis| states_size(raw, sizes, *axis)) {
        sform.column_mut(axis).scale_mut(raw.pixdim[axis + 1]);
    }
    Some(format!(
        "{text}: the sform has directions alone, and the voxel sizes of pixdim are used"
    ))
}

/// Warning where the sform contradicts the voxel sizes, or else the qform by more than a voxel at a corner.
fn contradiction(raw: &Fields, sizes: &[usize], sform: &Matrix3x4<f64>, mm: f64) -> Option<String> {
    if let Some(text) = two_sizes(raw, sizes, sform, mm) {
        return Some(format!(
            "{text}: the sform is used; if organs have a wrong size, mend the sform"
        ));
    }
    let axes = 0..sizes.len().min(3);
    let step = |axis: usize| sform.column(axis).norm();
    let size = |axis: usize| raw.pixdim[axis + 1];
    if raw.qform_code <= 0
        || !axes
            .clone()
            .all(|axis| states_size(raw, sizes, axis) || sizes[axis] == 1)
    {
        return None;
    }
    let spacing = [0, 1, 2].map(|axis| if size(axis) > 0.0 { size(axis) } else { 1.0 });
    let qform = qform(raw, spacing);
    let last = |axis: usize| sizes.get(axis).map_or(0.0, |&size| size as f64 - 1.0);
    let corners = (0..8).map(|corner| {
        let index = [0, 1, 2].map(|axis| if corner >> axis & 1 == 1 { last(axis) } else { 0.0 });
        let [x, y, z] = index;
        let world = |affine: &Matrix3x4<f64>| {
            let ras = affine * nalgebra::Vector4::new(x, y, z, 1.0) * mm;
            Point3::new(-ras.x, -ras.y, ras.z)
        };
        (index, world(sform), world(&qform))
    });
    let apart = |corner: &([f64; 3], Point3<f64>, Point3<f64>)| (corner.1 - corner.2).norm();
    let farthest = corners.reduce(|best, next| if apart(&next) > apart(&best) { next } else { best })?;
    // A qform cannot hold a shear, which moves corners by itself.
    let unit = |axis: usize| sform.column(axis).normalize();
    let pairs = [(0, 1), (1, 2), (0, 2)].map(|(one, other)| unit(one).dot(&unit(other)).abs());
    let shear = pairs
        .into_iter()
        .filter(|cosine| cosine.is_finite())
        .fold(0.0, f64::max);
    let diagonal = axes.clone().map(|axis| step(axis) * last(axis)).fold(0.0, f64::hypot);
    let allowed = (axes.map(step).fold(0.0, f64::max) + shear * diagonal) * mm;
    let [x, y, z] = farthest.0;
    let position = |point: &Point3<f64>| point.coords.map(short).as_slice().join(", ");
    (apart(&farthest) > allowed).then(|| {
        format!(
            "sform and qform differ: voxel ({x}, {y}, {z}) lies at ({}) mm by the sform and at ({}) mm by the qform, {} mm apart (LPS); \
             the sform is used",
            position(&farthest.1),
            position(&farthest.2),
            short(apart(&farthest))
        )
    })
}

/// A number with three decimals at most.
fn short(value: f64) -> String {
    let rounded = (value * 1000.0).round() / 1000.0;
    format!("{}", rounded + 0.0)
}
