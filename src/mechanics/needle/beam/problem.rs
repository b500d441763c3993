//! Beam problem: a needle in layers of tissue, and its division into elements.

use std::f64::consts::PI;

use super::material::{Compression, Law, Material};
use super::spec::{BaseSpec, LayerSpec, MeshSpec, NeedleSpec};
use insonify_base::range::{OutOfRange, Ranges, check};

/// Maximum number of elements of a needle.
const MAX_ELEMENTS: f64 = 1e5;

/// Returns the bending stiffness EI of a solid round rod, N mm^2, from Young's modulus (GPa) and diameter (mm). That of
/// a tube is the difference of two rods.
pub fn bending_stiffness_nmm2(young_gpa: f64, diameter_mm: f64) -> f64 {
    1e3 * young_gpa * PI * diameter_mm.powi(4) / 64.0
}

/// A layer of tissue between two planes across the needle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BeamLayer {
    /// Thickness of the layer, mm (above 0, at most 1e4).
    pub thickness_mm: f64,
    /// Material of the layer.
    pub material: Material,
    /// Constraint and kind of stress of the compressed tissue.
    pub compression: Compression,
    /// Initial length t0 of the tissue beside the needle, mm (above 0). Infinite: the tissue stays linear.
    pub initial_length_mm: f64,
    /// Friction between needle and tissue, gamma (0 to 1).
    pub friction: f64,
    /// Compression ratio below which the inverse problem rejects a motion of the base (0 to below 1; 0: no limit).
    pub least_ratio: f64,
}

/// Motion of the base.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Base {
    /// Displacement across the needle, mm: of the base, or of the axis about which it turns freely.
    pub displacement_mm: f64,
    /// Slope du/dx; `None` if the base turns freely.
    pub slope: Option<f64>,
}

/// A needle in tissue.
#[derive(Clone, Debug, PartialEq)]
pub struct Problem {
    /// Bending stiffness EI, N mm^2 (1e-6 to 1e12; see [`bending_stiffness_nmm2`]).
    pub bending_nmm2: f64,
    /// Distance from the base to the point of entry, mm (0 to 1e4).
    pub control_distance_mm: f64,
    /// Distance from the base back to the axis about which it turns freely, mm (0 to 1e4): the rotary stage of Wang et
    /// al. 2023. A rigid arm joins the two. A prescribed slope has no use for it.
    pub pivot_mm: f64,
    /// Depth of the tip, mm (0 to the sum of the layers).
    pub inserted_mm: f64,
    /// Layers, from the entry on.
    pub layers: Vec<BeamLayer>,
    /// Maximum length of an element, mm (above 0; Wang et al. 2023 use 1).
    pub element_mm: f64,
}

impl BeamLayer {
    /// Checks every number against its range.
    ///
    /// # Errors
    /// [`OutOfRange`] with the key of the number.
    pub fn check(&self) -> Result<(), OutOfRange> {
        LayerSpec::check_number("thickness_mm", self.thickness_mm)?;
        LayerSpec::check_number("friction", self.friction)?;
        LayerSpec::check_number("min_compression_ratio", self.least_ratio)?;
        let length = self.initial_length_mm;
        if length != f64::INFINITY {
            check("initial_length_mm", length, length > 0.0, "above 0 mm, or inf")?;
        }
        self.material.check()
    }
}

impl Problem {
    /// Checks the numbers that do not belong to a layer.
    ///
    /// # Errors
    /// [`OutOfRange`] with the key of the number.
    pub fn check(&self) -> Result<(), OutOfRange> {
        NeedleSpec::check_number("bending_stiffness_nmm2", self.bending_nmm2)?;
        BaseSpec::check_number("control_distance_mm", self.control_distance_mm)?;
        BaseSpec::check_number("pivot_mm", self.pivot_mm)?;
        let inserted = self.inserted_mm;
        let sum: f64 = self.layers.iter().map(|layer| layer.thickness_mm).sum();
        // Layers that a user adds up by hand may miss the sum by rounding.
        let holds = (0.0..=sum * (1.0 + 1e-12)).contains(&inserted);
        let expected = format!("0 to the sum of the layers, {sum} mm");
        check("inserted_mm", inserted, holds, expected)?;
        let element = self.element_mm;
        let most = self.control_distance_mm + inserted;
        MeshSpec::check_number("element_mm", element)?;
        let holds = most / element + self.layers.len() as f64 <= MAX_ELEMENTS;
        check(
            "element_mm",
            element,
            holds,
            format!("above 0, at most {MAX_ELEMENTS} elements"),
        )
    }
}

/// Elements from base to tip, with nodes at the entry and at layer boundaries.
#[derive(Clone, Debug)]
pub(super) struct Division {
    /// Positions of the nodes, mm.
    pub nodes: Vec<f64>,
    /// Layer of each element, if it is in tissue.
    pub layers: Vec<Option<usize>>,
    /// Index of the node at the entry.
    pub entry: usize,
}

impl Division {
    pub(super) fn new(problem: &Problem) -> Self {
        let mut division = Division {
            // Avoids a negative zero.
            nodes: vec![0.0 - problem.control_distance_mm],
            layers: Vec::new(),
            entry: 0,
        };
        division.add(0.0, None, problem.element_mm);
        division.entry = division.layers.len();
        let mut depth = 0.0;
        for (index, layer) in problem.layers.iter().enumerate() {
            depth += layer.thickness_mm;
            let last = index + 1 == problem.layers.len();
            let end = if last {
                problem.inserted_mm
            } else {
                depth.min(problem.inserted_mm)
            };
            division.add(end, Some(index), problem.element_mm);
        }
        division
    }

    /// Adds elements of equal length from the last node to `end`; none if `end` is not beyond it.
    fn add(&mut self, end: f64, layer: Option<usize>, element_mm: f64) {
        let start = self.nodes[self.nodes.len() - 1];
        let length = end - start;
        if length <= 0.0 {
            return;
        }
        // A length that is a multiple of the element up to rounding gets no additional element.
        let count = (length / element_mm - 1e-9).ceil().max(1.0);
        for part in 1..count as usize {
            self.nodes.push(start + length * (part as f64 / count));
        }
        self.nodes.push(end);
        self.layers.resize(self.nodes.len() - 1, layer);
    }

    pub(super) fn length_mm(&self, element: usize) -> f64 {
        self.nodes[element + 1] - self.nodes[element]
    }
}

/// A layer prepared for computation.
#[derive(Clone, Debug)]
pub(super) struct Bed {
    pub law: Law,
    pub initial_length_mm: f64,
    pub friction: f64,
}

impl Bed {
    pub(super) fn new(layer: &BeamLayer) -> Self {
        Bed {
            law: Law::new(&layer.material, layer.compression),
            initial_length_mm: layer.initial_length_mm,
            friction: layer.friction,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::needle::beam::material::NeoHookean;

    fn layer(thickness_mm: f64) -> BeamLayer {
        BeamLayer {
            thickness_mm,
            material: Material::NeoHookean(NeoHookean { mu_kpa: 5.0 }),
            compression: Compression::UEng,
            initial_length_mm: 50.0,
            friction: 0.0,
            least_ratio: 0.0,
        }
    }

    #[test]
    fn nodes_lie_at_the_entry_and_where_layers_meet() {
        let problem = Problem {
            bending_nmm2: 1e4,
            control_distance_mm: 4.0,
            pivot_mm: 0.0,
            inserted_mm: 7.3,
            layers: vec![layer(2.5), layer(0.3), layer(3.0), layer(5.0)],
            element_mm: 1.0,
        };
        let division = Division::new(&problem);
        assert_eq!(division.nodes[division.entry], 0.0);
        assert_eq!(division.layers.len() + 1, division.nodes.len());
        for depth in [-4.0, 2.5, 2.8, 5.8, 7.3] {
            assert!(
                division.nodes.iter().any(|node| (node - depth).abs() < 1e-12),
                "{depth}"
            );
        }
        assert!((0..division.layers.len()).all(|element| division.length_mm(element) <= 1.0 + 1e-9));
        let layer_at = |depth: f64| division.layers[division.nodes.partition_point(|node| *node <= depth) - 1];
        assert_eq!(
            [-1.0, 1.0, 2.6, 4.0, 7.0].map(layer_at),
            [None, Some(0), Some(1), Some(2), Some(3)]
        );
    }

    #[test]
    fn a_steel_needle_is_as_stiff_as_its_paper_says() {
        // 200 GPa, 1 mm: 200e3 N/mm^2 times pi/64 mm^4.
        assert!((bending_stiffness_nmm2(200.0, 1.0) - 9817.477).abs() < 1e-3);
        assert_eq!(
            bending_stiffness_nmm2(100.0, 2.0),
            8.0 * bending_stiffness_nmm2(200.0, 1.0)
        );
    }
}
