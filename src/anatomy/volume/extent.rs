//! Extent of a body: whether its lengths can be millimetres.

use super::unit::millimetres;
use super::{LabelVolume, VolumeError};

/// Extents of labelled bodies and of parts of them, mm. No patient is beyond the upper end, and nothing that ultrasound
/// resolves below the lower.
const BODIES_MM: [f64; 2] = [1.0, 5000.0];

/// Extents that a torso or an organ has, mm, by which a unit is proposed.
const USUAL_MM: [f64; 2] = [20.0, 2500.0];

/// Units that a file without one may be in, and the factor on its lengths.
const UNITS: [(&str, f64); 5] = [
    ("m where mm were taken", 1e3),
    ("cm where mm were taken", 10.0),
    ("mm where cm were taken", 0.1),
    ("µm where mm were taken, or mm where m were", 1e-3),
    ("nm where mm were taken", 1e-6),
];

/// Units that a file may be in where it states another, and their millimetres.
const OTHER_UNITS: [(&str, f64); 5] = [("mm", 1.0), ("m", 1e3), ("cm", 10.0), ("µm", 1e-3), ("nm", 1e-6)];

/// Extent of the labelled voxels along each index axis, mm; that of the grid if there are none.
pub(crate) fn extent_mm(volume: &LabelVolume) -> [f64; 3] {
    let [x, y, _] = volume.size();
    let mut ends = [[usize::MAX; 3], [0; 3]];
    for (row, voxels) in volume.voxels().chunks_exact(x).enumerate() {
        let Some(first) = voxels.iter().position(|&label| label != 0) else {
            continue;
        };
        let last = voxels.iter().rposition(|&label| label != 0).unwrap_or(first);
        for (index, [low, high]) in [[first, last], [row % y; 2], [row / y; 2]].into_iter().enumerate() {
            ends[0][index] = ends[0][index].min(low);
            ends[1][index] = ends[1][index].max(high);
        }
    }
    let spacing = volume.spacing_mm();
    [0, 1, 2].map(|axis| {
        let voxels = match ends[1][axis].checked_sub(ends[0][axis]) {
            Some(steps) => steps + 1,
            None => volume.size()[axis],
        };
        voxels as f64 * spacing[axis]
    })
}

/// An error if the labels span what no body does; it names the unit that would fit, beside the one that the file states.
pub(super) fn check(volume: &LabelVolume, stated: Option<&str>) -> Result<(), VolumeError> {
    let extent = extent_mm(volume);
    let longest = extent.into_iter().fold(0.0, f64::max);
    if (BODIES_MM[0]..=BODIES_MM[1]).contains(&longest) {
        return Ok(());
    }
    let list = |factor: f64| extent.map(|side| significant(side * factor)).join(" x ");
    let fits = |factor: f64| (USUAL_MM[0]..=USUAL_MM[1]).contains(&(longest * factor));
    let stated = stated.and_then(|unit| Some((unit, millimetres(unit)?)));
    let fitting = match stated {
        Some((unit, taken_mm)) => OTHER_UNITS
            .iter()
            .map(|(other, mm)| (format!("{other} where the file states {unit}"), mm / taken_mm))
            .find(|(_, factor)| fits(*factor)),
        None => UNITS
            .iter()
            .map(|(words, factor)| ((*words).to_owned(), *factor))
            .find(|(_, factor)| fits(*factor)),
    };
    let advice = match fitting {
        Some((unit, factor)) => format!(
            "in {unit}, they are {} mm: set the unit in the header (NRRD: space units, NIfTI: xyzt_units, MetaImage: DistanceUnits) \
             or multiply spacing and origin by {factor}",
            list(factor)
        ),
        None => "check the spacing and its unit".to_owned(),
    };
    let [least, most] = BODIES_MM;
    Err(VolumeError::new(format!(
        "found labels over {} mm, expected a body or a part of one, {least} to {most} mm long: {advice}",
        list(1.0)
    )))
}

/// A number with three digits.
fn significant(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let digits = 2 - value.abs().log10().floor() as i32;
    if digits <= 0 {
        format!("{value:.0}")
    } else {
        format!("{value:.*}", digits as usize)
            .trim_end_matches('0')
            .trim_end_matches('.')
            .to_owned()
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix4;

    use super::*;
    use crate::volume::Label;

    fn cuboid(spacing_mm: f64) -> LabelVolume {
        let mut voxels = vec![0; 50 * 40 * 30];
        for voxel in 0..voxels.len() {
            let [i, j, k] = [voxel % 50, voxel / 50 % 40, voxel / 2000];
            voxels[voxel] = u8::from((1..49).contains(&i) && (2..38).contains(&j) && k < 30);
        }
        let label = |value| Label {
            value,
            name: None,
            voxels: 1,
        };
        let world = Matrix4::new_scaling(spacing_mm);
        LabelVolume::new([50, 40, 30], voxels, vec![label(0), label(1)], world).unwrap()
    }

    #[test]
    fn a_body_of_metres_or_of_tenths_of_millimetres_is_told_its_unit() {
        assert_eq!(extent_mm(&cuboid(7.0)), [336.0, 252.0, 210.0]);
        for (spacing, extent, unit) in [
            (
                7000.0,
                "336000 x 252000 x 210000 mm",
                "in µm where mm were taken, or mm where m were, they are 336 x 252 x 210 mm",
            ),
            (7e6, "336000000 x", "in nm where mm were taken, they are 336 x"),
            (
                0.007,
                "0.336 x 0.252 x 0.21 mm",
                "in m where mm were taken, they are 336 x 252 x 210 mm",
            ),
            (0.005, "0.24 x", "in m where mm were taken, they are 240 x"),
            (150.0, "7200 x", "mm where cm were taken, they are 720 x"),
        ] {
            let message = check(&cuboid(spacing), None).expect_err("no body").to_string();
            assert!(message.contains(extent) && message.contains(unit), "{message}");
        }
        // The unit that the file states is named.
        for (spacing, stated, words) in [
            (
                0.007,
                "um",
                "in mm where the file states um, they are 336 x 252 x 210 mm",
            ),
            (7000.0, "m", "in mm where the file states m, they are 336 x"),
            (0.007, "mm", "in m where the file states mm, they are 336 x"),
            (0.1e-3, "mm", "check the spacing"),
        ] {
            let message = check(&cuboid(spacing), Some(stated)).expect_err("no body").to_string();
            assert!(message.contains(words), "{message}");
        }
        // A vessel of a mouse, a torso, and a torso in centimetres, which the volumes of its organs show.
        for spacing in [0.03, 0.7, 7.0, 70.0] {
            check(&cuboid(spacing), None).unwrap();
        }
    }

    #[test]
    fn without_labels_the_grid_counts() {
        let label = Label {
            value: 0,
            name: None,
            voxels: 8,
        };
        let empty = LabelVolume::new([2, 2, 2], vec![0; 8], vec![label], Matrix4::new_scaling(3.0)).unwrap();
        assert_eq!(extent_mm(&empty), [6.0; 3]);
    }
}
