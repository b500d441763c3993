//! Needles in tissue that several tests share.

use insonify_mechanics::needle::beam::material::Ogden;
use insonify_mechanics::needle::beam::{
    Base, BeamLayer, Compression, FoundationBeam, Material, Problem, Shape, bending_stiffness_nmm2,
};

/// Wang et al.'s phantom and its compression model.
pub(super) const PVC: (Material, Compression) = (
    Material::Ogden(Ogden {
        mu_kpa: 12.72,
        alpha: -1.0,
    }),
    Compression::UEng,
);

/// Wang et al.'s porcine muscle and its compression model.
pub(super) const PSM: (Material, Compression) = (
    Material::Ogden(Ogden {
        mu_kpa: 3.63,
        alpha: 8.74,
    }),
    Compression::UTru,
);

pub(super) fn layer((material, compression): (Material, Compression), thickness_mm: f64) -> BeamLayer {
    BeamLayer {
        thickness_mm,
        material,
        compression,
        initial_length_mm: 50.0,
        friction: 0.0,
        least_ratio: 0.0,
    }
}

/// Wang et al.'s needle, steel of 1 mm, in these layers to their full depth, with elements of 1 mm.
pub(super) fn problem(control_distance_mm: f64, layers: Vec<BeamLayer>) -> Problem {
    Problem {
        bending_nmm2: bending_stiffness_nmm2(200.0, 1.0),
        control_distance_mm,
        pivot_mm: 0.0,
        inserted_mm: layers.iter().map(|layer| layer.thickness_mm).sum(),
        layers,
        element_mm: 1.0,
    }
}

pub(super) fn base(displacement_mm: f64, slope: f64) -> Base {
    Base {
        displacement_mm,
        slope: Some(slope),
    }
}

pub(super) fn free(displacement_mm: f64) -> Base {
    Base {
        displacement_mm,
        slope: None,
    }
}

pub(super) fn solve(problem: &Problem, base: &Base) -> Shape {
    let mut beam = FoundationBeam::new(problem).expect("a problem");
    beam.solve(base).unwrap_or_else(|error| panic!("{error}"))
}

/// Largest distance between the points of a shape and a deflection (mm).
pub(super) fn distance(shape: &Shape, exact: impl Fn(f64) -> f64) -> f64 {
    let away = shape.points.iter().map(|point| (point.u_mm - exact(point.x_mm)).abs());
    away.fold(0.0, f64::max)
}
