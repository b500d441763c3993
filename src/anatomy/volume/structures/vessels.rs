//! Synthetic vessel trees in an organ, grown from its contact with a labelled vessel.
//!
//! Terminals fill the organ at even distances and join the tree one by one, each where the length of the new branch
//! plus `BALANCE` times the path back to the root is least (H. Cuntz et al., "One rule to grow them all", PLoS Comput.
//! Biol. 6(8), 2010). Radii follow Murray's law, r0^3 = r1^3 + r2^3 (C. D. Murray, PNAS 12, 1926); the trunk of a liver
//! of 1.5 l reaches `WIDEST_MM` (portal veins measure 10 to 13 mm across).

use nalgebra::{Point3, Vector3};

use super::organ::Organ;
use crate::volume::LabelVolume;
use insonify_base::random::{hash3, seed_words, unit};

/// Distance between the terminals of a tree, mm.
const SPACING_MM: f64 = 16.0;
/// Radius of a terminal, mm.
const TERMINAL_MM: f64 = 1.0;
/// Largest radius, mm.
const WIDEST_MM: f64 = 5.5;
/// Weight of the path to the root against the length of a new branch: 0 gives the shortest tree, 1 straight paths.
const BALANCE: f64 = 0.35;
/// Minimum depth of terminals below the surface of an organ, mm.
const CLEAR_MM: f64 = 4.0;
/// Distance from a vessel within which an organ counts as touched, mm.
const TOUCH_MM: f64 = 4.0;
/// Minimum radius of drawn branches, voxels: about two voxels across.
const DRAWN: f64 = 0.8;
/// Distance between painted balls, voxels.
const STEP: f64 = 0.4;

/// Choice of the root among the contacts of a vessel with the organ.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Root {
    /// The highest contact: veins into the vena cava.
    Highest,
    /// The contact nearest to the centre of the organ: its hilum.
    Innermost,
}

/// A branch that ends at a node.
struct Node {
    at: Point3<f64>,
    parent: usize,
    radius_mm: f64,
}

/// A tree of vessels: the first node is its root.
pub(super) struct Tree {
    nodes: Vec<Node>,
}

impl Tree {
    /// Grows a tree that fills an organ from its contact with a vessel; `None` without contact, or if no terminal
    /// fits.
    pub(super) fn grown(
        volume: &LabelVolume,
        organ: &Organ,
        vessel: impl Fn(u8) -> bool,
        root: Root,
        stream: u32,
    ) -> Option<Self> {
        let root = touching(volume, organ, vessel, root)?;
        let mut left: Vec<Point3<f64>> = terminals(volume, organ, stream);
        if left.is_empty() {
            return None;
        }
        let mut nodes = vec![Node {
            at: root,
            parent: 0,
            radius_mm: 0.0,
        }];
        let mut paths = vec![0.0];
        // For each terminal, the node that is cheapest to join, and the cost.
        let mut best: Vec<(usize, f64)> = left.iter().map(|terminal| (0, (terminal - root).norm())).collect();
        while !left.is_empty() {
            let next = (0..left.len()).reduce(|a, b| if best[b].1 < best[a].1 { b } else { a })?;
            let (terminal, (parent, _)) = (left.swap_remove(next), best.swap_remove(next));
            let path = paths[parent] + (terminal - nodes[parent].at).norm();
            let node = nodes.len();
            nodes.push(Node {
                at: terminal,
                parent,
                radius_mm: 0.0,
            });
            paths.push(path);
            for (at_other, best) in left.iter().zip(&mut best) {
                let cost = (at_other - terminal).norm() + BALANCE * path;
                if cost < best.1 {
                    *best = (node, cost);
                }
            }
        }
        // Children come after their parents: cubes of radii are summed from the end.
        let mut cubes = vec![0.0; nodes.len()];
        for node in (1..nodes.len()).rev() {
            if cubes[node] == 0.0 {
                cubes[node] = TERMINAL_MM.powi(3);
            }
            cubes[nodes[node].parent] += cubes[node];
        }
        for (node, cube) in nodes.iter_mut().zip(&cubes) {
            node.radius_mm = f64::min(cube.cbrt(), WIDEST_MM);
        }
        Some(Self { nodes })
    }

    /// Calls `paint` with the indices of the voxels in branches wide enough for voxels.
    pub(super) fn paint(&self, volume: &LabelVolume, mut paint: impl FnMut(usize)) {
        let spacing = volume.spacing_mm();
        let widest = spacing.iter().copied().fold(0.0, f64::max);
        let least = spacing.iter().copied().fold(f64::INFINITY, f64::min);
        let mut along: Vec<Vector3<f64>> = vec![Vector3::zeros(); self.nodes.len()];
        // Direction at a node: from its parent to its widest child, so that branches bend and do not kink.
        let mut child = vec![0; self.nodes.len()];
        for (node, branch) in self.nodes.iter().enumerate().skip(1) {
            let known = child[branch.parent];
            if known == 0 || self.nodes[known].radius_mm < branch.radius_mm {
                child[branch.parent] = node;
            }
        }
        for (node, branch) in self.nodes.iter().enumerate() {
            let end = if child[node] == 0 {
                branch
            } else {
                &self.nodes[child[node]]
            };
            along[node] = 0.5 * (end.at - self.nodes[branch.parent].at);
        }
        for (node, branch) in self
            .nodes
            .iter()
            .enumerate()
            .skip(1)
            .filter(|(_, node)| node.radius_mm >= DRAWN * widest)
        {
            let [from, to] = [self.nodes[branch.parent].at, branch.at];
            let pieces = ((to - from).norm() / (STEP * least)).ceil().max(1.0) as usize;
            for piece in 0..=pieces {
                let t = piece as f64 / pieces as f64;
                // Cubic Hermite interpolation.
                let (a, b) = (t * t * (3.0 - 2.0 * t), t * (1.0 - t));
                let middle =
                    from.coords.lerp(&to.coords, a) + along[branch.parent] * (b * (1.0 - t)) - along[node] * (b * t);
                ball(volume, &middle.into(), branch.radius_mm, &mut paint);
            }
        }
    }
}

/// Calls `paint` with the voxels whose centres lie in a ball.
fn ball(volume: &LabelVolume, middle: &Point3<f64>, radius_mm: f64, paint: &mut impl FnMut(usize)) {
    let (size, spacing) = (volume.size(), volume.spacing_mm());
    let centre = volume.world_to_index().transform_point(middle);
    let reach = [0, 1, 2].map(|axis| radius_mm / spacing[axis]);
    let low = [0, 1, 2].map(|axis| (centre[axis] - reach[axis]).ceil().max(0.0) as usize);
    let high =
        [0, 1, 2].map(|axis| ((centre[axis] + reach[axis]).floor() + 1.0).clamp(0.0, size[axis] as f64) as usize);
    for k in low[2]..high[2] {
        for j in low[1]..high[1] {
            for i in low[0]..high[0] {
                let voxel = [i, j, k];
                let from = [0, 1, 2].map(|axis| (voxel[axis] as f64 - centre[axis]) * spacing[axis]);
                if Vector3::from(from).norm_squared() <= radius_mm * radius_mm {
                    paint(volume.offset(voxel));
                }
            }
        }
    }
}

/// Root of a tree in the world, mm.
fn touching(volume: &LabelVolume, organ: &Organ, vessel: impl Fn(u8) -> bool, root: Root) -> Option<Point3<f64>> {
    let near = Organ::around(volume, vessel, TOUCH_MM)?;
    let (mut sum, mut count) = (Vector3::zeros(), 0.0);
    let mut touching = Vec::new();
    for (voxel, _) in organ.voxels() {
        let world = volume
            .index_to_world()
            .transform_point(&Point3::from(voxel.map(|index| index as f64)));
        sum += world.coords;
        count += 1.0;
        if near.holds(voxel) {
            touching.push(world);
        }
    }
    let middle = Point3::from(sum / f64::max(count, 1.0));
    let cost = |point: &Point3<f64>| match root {
        Root::Highest => -point.z,
        Root::Innermost => (point - middle).norm(),
    };
    touching.into_iter().min_by(|a, b| cost(a).total_cmp(&cost(b)))
}

/// Points of a jittered lattice inside an organ, in the world, mm: one for each cell whose point lies in the organ.
fn terminals(volume: &LabelVolume, organ: &Organ, stream: u32) -> Vec<Point3<f64>> {
    let seed = seed_words(u64::from(stream));
    let cell_of = |point: &Point3<f64>| point.coords.map(|x| (x / SPACING_MM).floor() as i32);
    let world = |voxel: [usize; 3]| {
        volume
            .index_to_world()
            .transform_point(&Point3::from(voxel.map(|index| index as f64)))
    };
    let mut cells: Vec<[i32; 3]> = organ.voxels().map(|(voxel, _)| cell_of(&world(voxel)).into()).collect();
    cells.sort_unstable();
    cells.dedup();
    let inside = |point: &Point3<f64>| {
        let index = volume.world_to_index().transform_point(point);
        let voxel = [0, 1, 2].map(|axis| index[axis].round());
        voxel.iter().all(|coordinate| *coordinate >= 0.0)
            && organ.depth_mm(voxel.map(|coordinate| coordinate as usize)) > CLEAR_MM
    };
    let point = |cell: [i32; 3]| {
        let draw = hash3(cell, seed);
        let point = [0, 1, 2].map(|axis| (f64::from(cell[axis]) + f64::from(unit(draw[axis]))) * SPACING_MM);
        Some(Point3::from(point)).filter(inside)
    };
    cells.into_iter().filter_map(point).collect()
}

#[cfg(test)]
impl Tree {
    /// Position (world, mm), parent and radius (mm) of each node.
    pub(super) fn nodes(&self) -> Vec<(Point3<f64>, usize, f64)> {
        self.nodes
            .iter()
            .map(|node| (node.at, node.parent, node.radius_mm))
            .collect()
    }
}
