//! Nodes of a Gmsh file, by tag.

use super::Fault;
use super::kinds::CORNERS;

/// Nodes in the order of their tags, which need not be consecutive.
pub(super) struct Nodes {
    tags: Vec<u64>,
    pub positions: Vec<[f64; 3]>,
}

impl Nodes {
    /// Builds the list from tags and positions in any order, which start at `at`.
    pub fn new(mut nodes: Vec<(u64, [f64; 3])>, at: usize) -> Result<Nodes, Fault> {
        nodes.sort_by_key(|node| node.0);
        if let Some(pair) = nodes.windows(2).find(|pair| pair[0].0 == pair[1].0) {
            return Err(Fault::at(
                at,
                format!("two nodes with the tag {}", pair[0].0),
                "a tag of its own for every node",
            ));
        }
        let (tags, positions) = nodes.into_iter().unzip();
        Ok(Nodes { tags, positions })
    }

    /// Returns the index of a node to which an element at `at` refers.
    pub fn index(&self, tag: u64, at: usize) -> Result<u32, Fault> {
        let first = self.tags.first().copied().unwrap_or_default();
        // Most files number their nodes without gaps.
        let guess = tag.checked_sub(first).and_then(|place| usize::try_from(place).ok());
        let place = guess
            .filter(|place| self.tags.get(*place) == Some(&tag))
            .or_else(|| self.tags.binary_search(&tag).ok());
        place.and_then(|place| u32::try_from(place).ok()).ok_or_else(|| {
            Fault::at(
                at,
                format!("a tetrahedron with the node {tag}"),
                format!("the tags of {CORNERS} of the {} nodes", self.tags.len()),
            )
        })
    }
}
