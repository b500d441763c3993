//! Adjacency of edges, nodes and elements in a mesh of tetrahedra whose elements never change.

/// Lists of different lengths in one allocation.
#[derive(Clone, Debug)]
pub(super) struct Lists {
    starts: Vec<u32>,
    items: Vec<u32>,
}

impl Lists {
    /// Groups `pairs` (list, item) into `count` lists; items keep their order.
    fn new(count: usize, pairs: impl Iterator<Item = (u32, u32)> + Clone) -> Lists {
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
        Lists { starts, items }
    }

    pub fn of(&self, list: u32) -> &[u32] {
        let list = list as usize;
        &self.items[self.starts[list] as usize..self.starts[list + 1] as usize]
    }
}

/// Corners of an element's six edges.
const EDGES: [[usize; 2]; 6] = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];

/// Edges, and the adjacency of nodes, edges and elements.
#[derive(Clone, Debug)]
pub(super) struct Topology {
    /// Ends of each edge, lower number first, in ascending order.
    pub edges: Vec<[u32; 2]>,
    pub edges_of_element: Vec<[u32; 6]>,
    pub elements_of_edge: Lists,
    pub elements_of_node: Lists,
    pub edges_of_node: Lists,
}

impl Topology {
    pub fn new(nodes: usize, elements: &[[u32; 4]]) -> Topology {
        let ends = |element: &[u32; 4]| EDGES.map(|[a, b]| [element[a].min(element[b]), element[a].max(element[b])]);
        let mut edges: Vec<[u32; 2]> = elements.iter().flat_map(ends).collect();
        edges.sort_unstable();
        edges.dedup();
        let number = |edge: [u32; 2]| edges.partition_point(|other| *other < edge) as u32;
        let edges_of_element: Vec<[u32; 6]> = elements.iter().map(|element| ends(element).map(number)).collect();
        let of_element = (0u32..).zip(&edges_of_element);
        let elements_of_edge = of_element.flat_map(|(element, edges)| edges.map(|edge| (edge, element)));
        let corners = (0u32..).zip(elements);
        let elements_of_node = corners.flat_map(|(element, corners)| corners.map(|corner| (corner, element)));
        let edges_of_node = (0u32..)
            .zip(&edges)
            .flat_map(|(edge, ends)| ends.map(|end| (end, edge)));
        Topology {
            elements_of_edge: Lists::new(edges.len(), elements_of_edge),
            elements_of_node: Lists::new(nodes, elements_of_node),
            edges_of_node: Lists::new(nodes, edges_of_node),
            edges_of_element,
            edges,
        }
    }
}
