//! Reaction of the tissue on an element in the weak form, and its derivatives.

use nalgebra::{Matrix2, Matrix4, Vector2, Vector4};

use super::problem::Bed;

/// N/mm^2 per kPa: moduli are in kPa, forces per length in N/mm.
const NMM2_PER_KPA: f64 = 1e-3;

/// Compression ratio below which tissue counts as crushed.
const CRUSHED: f64 = 1e-9;

/// Points and weights of the Gauss rule on 0 to 1, exact to degree 7: the product of two cubics is integrated exactly.
const GAUSS: [(f64, f64); 4] = [
    (0.069_431_844_202_973_71, 0.173_927_422_568_726_93),
    (0.330_009_478_207_571_87, 0.326_072_577_431_273_07),
    (0.669_990_521_792_428_1, 0.326_072_577_431_273_07),
    (0.930_568_155_797_026_3, 0.173_927_422_568_726_93),
];

/// Reaction per length at a point, N/mm, along the deflection; and its derivatives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Reaction {
    pub force: f64,
    /// Derivative by deflection, N/mm^2.
    pub by_deflection: f64,
    /// Derivative by slope, N/mm.
    pub by_slope: f64,
}

/// Returns the compression ratio of tissue beside a needle that is deflected by `u` mm.
pub(super) fn ratio(bed: &Bed, u: f64) -> f64 {
    1.0 - u.abs() / bed.initial_length_mm
}

/// Returns whether tissue of a compression ratio is not crushed; false for NaN.
fn is_whole(ratio: f64) -> bool {
    ratio > CRUSHED
}

/// Returns the reaction at a point, or `None` where tissue is crushed or forces overflow.
pub(super) fn reaction(bed: &Bed, u: f64, slope: f64) -> Option<Reaction> {
    let ratio = ratio(bed, u);
    if !is_whole(ratio) {
        return None;
    }
    let response = bed.law.at(ratio);
    // sin^2(atan s) = s^2/(1 + s^2).
    let square = 1.0 + slope * slope;
    let hold = 1.0 - bed.friction * slope * slope / square;
    let modulus = NMM2_PER_KPA * response.tangent_kpa;
    let stiffening = NMM2_PER_KPA * response.rate_kpa * u.abs() / bed.initial_length_mm;
    let reaction = Reaction {
        force: modulus * u * hold,
        by_deflection: (modulus - stiffening) * hold,
        by_slope: -modulus * u * bed.friction * 2.0 * slope / (square * square),
    };
    let sum = reaction.force + reaction.by_deflection + reaction.by_slope;
    sum.is_finite().then_some(reaction)
}

/// Reaction on an element by its two nodes (force N, moment N mm; force, moment), and its derivatives.
#[derive(Clone, Copy, Debug)]
pub(super) struct Load {
    pub force: [Vector2<f64>; 2],
    pub stiffness: [[Matrix2<f64>; 2]; 2],
}

impl Load {
    pub(super) const ZERO: Load = Load {
        force: [Vector2::new(0.0, 0.0); 2],
        stiffness: [[Matrix2::new(0.0, 0.0, 0.0, 0.0); 2]; 2],
    };
}

/// Returns the four Hermite cubics and their slopes at a share of an element of a given length.
pub(super) fn cubics(length: f64, share: f64) -> (Vector4<f64>, Vector4<f64>) {
    let (s, h) = (share, length);
    let values = [
        1.0 - s * s * (3.0 - 2.0 * s),
        h * s * (1.0 - s) * (1.0 - s),
        s * s * (3.0 - 2.0 * s),
        h * s * s * (s - 1.0),
    ];
    let rise = 6.0 * s * (1.0 - s) / h;
    let slopes = [-rise, (1.0 - s) * (1.0 - 3.0 * s), rise, s * (3.0 * s - 2.0)];
    (values.into(), slopes.into())
}

/// Returns the load on an element of a length (mm) whose nodes have these deflections (mm) and slopes, or `None` where
/// tissue is crushed.
pub(super) fn load(bed: &Bed, length: f64, ends: [Vector2<f64>; 2]) -> Option<Load> {
    // Points of the rule lie within the element.
    if !ends.iter().all(|end| is_whole(ratio(bed, end.x))) {
        return None;
    }
    let ends = Vector4::new(ends[0].x, ends[0].y, ends[1].x, ends[1].y);
    // The virtual work of the reaction on each cubic; force and stiffness share the points of the rule, so that
    // Newton's method converges quadratically however coarse it is.
    let (mut force, mut stiffness) = (Vector4::zeros(), Matrix4::zeros());
    for (share, weight) in GAUSS {
        let (values, slopes) = cubics(length, share);
        let here = reaction(bed, values.dot(&ends), slopes.dot(&ends))?;
        let width = weight * length;
        force += values * (width * here.force);
        let change = values * (width * here.by_deflection) + slopes * (width * here.by_slope);
        stiffness += values * change.transpose();
    }
    let block = |i: usize, j: usize| stiffness.fixed_view::<2, 2>(2 * i, 2 * j).into_owned();
    Some(Load {
        force: [
            force.fixed_rows::<2>(0).into_owned(),
            force.fixed_rows::<2>(2).into_owned(),
        ],
        stiffness: [[block(0, 0), block(0, 1)], [block(1, 0), block(1, 1)]],
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::needle::beam::material::{Compression, Law, Material, Ogden};

    fn bed() -> Bed {
        let material = Material::Ogden(Ogden {
            mu_kpa: 3.63,
            alpha: 8.74,
        });
        Bed {
            law: Law::new(&material, Compression::CTru),
            initial_length_mm: 20.0,
            friction: 0.7,
        }
    }

    #[test]
    fn stiffness_is_the_slope_of_the_load() {
        let (bed, length) = (bed(), 1.3);
        for ends in [[9.0, -0.4, 8.4, -0.5], [-12.0, 0.3, -11.5, 0.35]] {
            let load_of = |ends: &[f64; 4]| {
                let [a, b, c, d] = *ends;
                load(&bed, length, [Vector2::new(a, b), Vector2::new(c, d)]).expect("a load")
            };
            let here = load_of(&ends);
            for j in 0..4 {
                let step = 1e-5;
                let [mut more, mut less] = [ends, ends];
                more[j] += step;
                less[j] -= step;
                let [more, less] = [load_of(&more), load_of(&less)];
                for i in 0..4 {
                    let expected = (more.force[i / 2][i % 2] - less.force[i / 2][i % 2]) / (2.0 * step);
                    let stiffness = here.stiffness[i / 2][j / 2][(i % 2, j % 2)];
                    // Central differences: 1e-10/6 of third derivatives of 30 N/mm^3, and rounding of 1e-13 N over the
                    // step.
                    assert!((stiffness - expected).abs() < 1e-7, "{i} {j}: {stiffness} {expected}");
                }
            }
        }
    }

    #[test]
    fn crushed_tissue_has_no_reaction() {
        let bed = bed();
        for u in [20.0, -20.0, 1e9, f64::NAN] {
            assert_eq!(reaction(&bed, u, 0.0), None);
            assert!(load(&bed, 1.0, [Vector2::zeros(), Vector2::new(u, 0.0)]).is_none());
        }
        assert!(reaction(&bed, 19.0, f64::MAX).is_none_or(|reaction| reaction.force.is_finite()));
    }
}
