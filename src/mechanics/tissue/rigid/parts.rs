//! Parts of a mesh: tetrahedra connected across faces.

use insonify_mesh::{NO_ELEMENT, TetMesh};

/// Parts of a mesh, and the nodes that they share.
pub(super) struct Parts {
    /// Part of each element.
    of_element: Vec<usize>,
    /// Nodes of each part, ascending.
    nodes: Vec<Vec<u32>>,
    /// Parts of each node, ascending.
    sharing: Vec<Vec<usize>>,
}

impl Parts {
    pub(super) fn of(mesh: &TetMesh) -> Parts {
        let elements = mesh.elements();
        let mut of_element = vec![usize::MAX; elements.len()];
        let mut nodes: Vec<Vec<u32>> = Vec::new();
        let mut sharing: Vec<Vec<usize>> = vec![Vec::new(); mesh.nodes().len()];
        let mut waiting = Vec::new();
        for start in 0..elements.len() {
            if of_element[start] != usize::MAX {
                continue;
            }
            let part = nodes.len();
            let mut part_nodes = Vec::new();
            of_element[start] = part;
            waiting.push(start as u32);
            while let Some(element) = waiting.pop() {
                for &node in &elements[element as usize] {
                    let parts = &mut sharing[node as usize];
                    // Parts are filled one after the other: the last entry tells whether this one has the
                    // node already.
                    if parts.last() != Some(&part) {
                        parts.push(part);
                        part_nodes.push(node);
                    }
                }
                for &next in &mesh.neighbours()[element as usize] {
                    if next != NO_ELEMENT && of_element[next as usize] == usize::MAX {
                        of_element[next as usize] = part;
                        waiting.push(next);
                    }
                }
            }
            part_nodes.sort_unstable();
            nodes.push(part_nodes);
        }
        Parts {
            of_element,
            nodes,
            sharing,
        }
    }

    /// Number of parts.
    pub(super) fn len(&self) -> usize {
        self.nodes.len()
    }

    /// Nodes of a part, ascending.
    pub(super) fn nodes(&self, part: usize) -> &[u32] {
        &self.nodes[part]
    }

    /// Parts that a node belongs to, ascending.
    pub(super) fn sharing(&self, node: u32) -> &[usize] {
        &self.sharing[node as usize]
    }

    /// Nodes of no element, ascending.
    pub(crate) fn loose_nodes(&self) -> impl Iterator<Item = u32> + '_ {
        let nodes = self.sharing.iter().enumerate();
        nodes.filter(|(_, parts)| parts.is_empty()).map(|(node, _)| node as u32)
    }

    /// Regions of a part, ascending.
    pub(super) fn regions(&self, mesh: &TetMesh, part: usize) -> Vec<i32> {
        let elements = self.of_element.iter().zip(mesh.regions());
        let mut regions: Vec<i32> = elements
            .filter(|(part_of, _)| **part_of == part)
            .map(|(_, region)| *region)
            .collect();
        regions.sort_unstable();
        regions.dedup();
        regions
    }

    /// Volume of a part, mm^3.
    pub(super) fn volume_mm3(&self, mesh: &TetMesh, part: usize) -> f64 {
        let volumes = self.of_element.iter().zip(mesh.volumes(mesh.nodes()));
        volumes
            .filter(|(part_of, _)| **part_of == part)
            .map(|(_, volume)| volume)
            .sum()
    }

    /// Groups the parts selected by `wanted` with those that they share nodes with, directly or through others.
    pub(super) fn groups(&self, wanted: impl Fn(usize) -> bool) -> Vec<Vec<usize>> {
        let mut seen: Vec<bool> = (0..self.len()).map(|part| !wanted(part)).collect();
        let mut groups = Vec::new();
        for start in 0..self.len() {
            if seen[start] {
                continue;
            }
            seen[start] = true;
            let mut group = vec![start];
            let mut next = 0;
            while next < group.len() {
                for &node in self.nodes(group[next]) {
                    for &neighbour in self.sharing(node) {
                        if !seen[neighbour] {
                            seen[neighbour] = true;
                            group.push(neighbour);
                        }
                    }
                }
                next += 1;
            }
            group.sort_unstable();
            groups.push(group);
        }
        groups
    }
}
