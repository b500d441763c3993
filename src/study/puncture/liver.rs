//! Slice through a liver with a vein: triangles in plane strain.

use std::f64::consts::PI;
use std::sync::Arc;

use super::PunctureOptions;
use insonify::Error;
use insonify_mechanics::insertion::pushing::PathLayer;
use insonify_mechanics::tissue::material::Material;
use insonify_mechanics::tissue::nonlinear::{Sheet, Stiffening, Supports};

/// Width of the slice, mm.
const WIDTH_MM: f64 = 140.0;

/// Columns and rows of quadrilaterals, each split into two triangles.
const CELLS: [usize; 2] = [64, 40];

/// Position of the entry along the width, mm.
const NEEDLE_MM: f64 = 68.0;
/// Depth of the vein's centre below the entry, mm.
const VEIN_DEPTH_MM: f64 = 26.0;

/// Semi-axes of the vein, across and along the needle, mm.
const VEIN_MM: [f64; 2] = [10.0, 6.0];

/// Modulus of blood as a share of the liver's. Blood moves away along the vein, out of the slice: it is soft and does
/// not preserve its volume. A relative modulus keeps all forces proportional to the liver's.
const BLOOD_SHARE: f64 = 0.01;
/// Relative strain from which blood stiffens: little of the vein's height is left, its walls touch.
const CLOSED_STRAIN: f64 = 0.7;
/// Rate of the stiffening of blood: until it is no softer than the walls.
const CLOSED_STIFFENING: f64 = 4e3;

/// Slice of liver and the layers on the needle's path.
pub(super) struct Liver {
    /// Finite-element sheet of the slice.
    pub body: Arc<Sheet>,
    /// Supports: the dorsal nodes do not move (section 4.2.2 of Kobayashi et al. 2010).
    pub supports: Supports<2>,
    /// Whether each triangle is in the vein.
    pub vein: Vec<bool>,
    /// Entry point of the needle, mm.
    pub entry: [f64; 2],
    /// Layers on the needle's path: liver, the vein, liver behind it.
    pub layers: Vec<PathLayer>,
}

/// Returns the lower and upper outline at a position along the width, mm.
fn outline(x: f64) -> [f64; 2] {
    let phase = PI * x / WIDTH_MM;
    let half = 9.0 + 25.0 * phase.sin().max(0.0).powf(0.7);
    let middle = 40.0 + 7.0 * phase.cos();
    [middle - half, middle + half]
}

impl Liver {
    /// Creates the slice with the given properties.
    pub(super) fn new(options: &PunctureOptions) -> Result<Liver, Error> {
        let [columns, rows] = CELLS;
        let top = outline(NEEDLE_MM)[1];
        let centre = [NEEDLE_MM, top - VEIN_DEPTH_MM];
        let mut nodes = vec![[0.0; 2]; (columns + 1) * (rows + 1)];
        for i in 0..=columns {
            let x = column(i as f64 / columns as f64);
            for (j, y) in heights(x, centre).into_iter().enumerate() {
                nodes[j * (columns + 1) + i] = [x, y];
            }
        }
        let node_at = |i: usize, j: usize| (j * (columns + 1) + i) as u32;
        let mut triangles = Vec::new();
        for j in 0..rows {
            for i in 0..columns {
                let [a, b, c, d] = [
                    node_at(i, j),
                    node_at(i + 1, j),
                    node_at(i + 1, j + 1),
                    node_at(i, j + 1),
                ];
                // Diagonals follow the wall of the vein; elsewhere they are mirrored about the needle.
                let wall = |node: u32| (radius(nodes[node as usize], centre) - 1.0).abs() < 1e-9;
                let is_left = nodes[a as usize][0] < NEEDLE_MM - 1e-9;
                if wall(a) && wall(c) || !(is_left || wall(b) && wall(d)) {
                    triangles.extend([[a, b, c], [a, c, d]]);
                } else {
                    triangles.extend([[a, b, d], [b, c, d]]);
                }
            }
        }
        let inside = |corners: &[u32; 3]| {
            corners
                .iter()
                .all(|node| radius(nodes[*node as usize], centre) < 1.0 + 1e-9)
        };
        let vein: Vec<bool> = triangles.iter().map(inside).collect();
        let tissue = Material::new(options.young_kpa, options.poisson)?;
        let tissue = Stiffening::new(tissue, options.knee_strain, options.stiffening)?;
        let blood = Stiffening::new(
            Material::new(BLOOD_SHARE * options.young_kpa, 0.0)?,
            CLOSED_STRAIN,
            CLOSED_STIFFENING,
        )?;
        let laws: Vec<Stiffening> = vein.iter().map(|vein| if *vein { blood } else { tissue }).collect();
        let fixed_dofs = (0..=columns as u32).flat_map(|node| [(node, 0), (node, 1)]);
        let supports = Supports::new(nodes.len(), fixed_dofs);
        let layer = |from_mm, membrane_n, share: f64| PathLayer {
            from_mm,
            membrane_n,
            cutting_n: share * options.cutting_n,
            friction_n_per_mm: share * options.friction_n_per_mm,
            static_ratio: 1.0,
            peak: None,
        };
        Ok(Liver {
            body: Arc::new(Sheet::plane_strain(nodes, triangles, &laws, options.thickness_mm)?),
            supports,
            vein,
            entry: [NEEDLE_MM, top],
            layers: vec![
                layer(0.0, options.capsule_n, 1.0),
                layer(VEIN_DEPTH_MM - VEIN_MM[1], options.wall_n, 0.0),
                layer(VEIN_DEPTH_MM + VEIN_MM[1], options.wall_n, 1.0),
            ],
        })
    }
}

/// Returns the position of a column, mm: columns are denser near the needle, and one lies on its path.
fn column(share: f64) -> f64 {
    let middle = 0.5;
    let distance = share - middle;
    // Cubic: a third of the mean spacing at the needle.
    let bent = distance * (1.0 + 8.0 * distance * distance) / 3.0;
    if distance < 0.0 {
        NEEDLE_MM + 2.0 * bent * NEEDLE_MM
    } else {
        NEEDLE_MM + 2.0 * bent * (WIDTH_MM - NEEDLE_MM)
    }
}

/// Returns the elliptic radius: 1 on the vein's wall, less inside.
fn radius(p: [f64; 2], centre: [f64; 2]) -> f64 {
    ((p[0] - centre[0]) / VEIN_MM[0]).hypot((p[1] - centre[1]) / VEIN_MM[1])
}

/// Returns the heights of a column's nodes: evenly spaced from the lower to the upper outline, except for two on the
/// vein's wall where the column crosses it. Triangles have a vertical edge and a corner in the next column, so none
/// inverts as long as nodes keep their order.
fn heights(x: f64, centre: [f64; 2]) -> Vec<f64> {
    let [low, high] = outline(x);
    let row = (high - low) / CELLS[1] as f64;
    let mut heights: Vec<f64> = (0..=CELLS[1]).map(|j| low + row * j as f64).collect();
    let across = (x - centre[0]) / VEIN_MM[0];
    let half = VEIN_MM[1] * (1.0 - across * across).max(0.0).sqrt();
    if half > row {
        for wall in [centre[1] - half, centre[1] + half] {
            let nearest = ((wall - low) / row).round() as usize;
            heights[nearest.clamp(1, CELLS[1] - 1)] = wall;
        }
    }
    heights
}
