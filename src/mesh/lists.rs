//! Adjacency lists.

/// Lists of different lengths in one allocation, such as the elements of each node.
#[derive(Clone, Debug)]
pub struct Lists {
    starts: Vec<u32>,
    items: Vec<u32>,
}

impl Lists {
    /// Groups `pairs` (list, item) into `count` lists; items keep their order.
    pub fn new(count: usize, pairs: impl Iterator<Item = (u32, u32)> + Clone) -> Self {
        let mut starts = vec![0; count + 1];
        for (list, _) in pairs.clone() {
            starts[list as usize + 1] += 1;
        }
        for list in 0..count {
            starts[list + 1] += starts[list];
        }
        let mut next = starts.clone();
        let mut items = vec![0; starts[count] as usize];
        for (list, item) in pairs {
            items[next[list as usize] as usize] = item;
            next[list as usize] += 1;
        }
        Self { starts, items }
    }

    /// Corners of each node, in the order of elements; a corner is four times its element plus its place there.
    pub fn corners(elements: &[[u32; 4]], nodes: usize) -> Self {
        let corners = elements.as_flattened().iter().zip(0..);
        Self::new(nodes, corners.map(|(&node, corner)| (node, corner)))
    }

    /// A list.
    pub fn get(&self, list: u32) -> &[u32] {
        let list = list as usize;
        &self.items[self.starts[list] as usize..self.starts[list + 1] as usize]
    }
}
