//! Surface of a mesh: faces of only one tetrahedron.

use super::{NO_ELEMENT, TetMesh};

/// A face on the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Face {
    /// Nodes of the face.
    pub nodes: [u32; 3],
    /// Tetrahedron of the face.
    pub element: u32,
    /// Region of the tetrahedron.
    pub region: i32,
    /// Outward normal in the reference state, with the area of the face as length, mm^2.
    pub area_mm2: [f64; 3],
}

impl TetMesh {
    /// Returns the faces on the surface, by element.
    pub fn surface(&self) -> impl Iterator<Item = Face> + '_ {
        (0..).zip(&self.neighbours).flat_map(move |(element, neighbours)| {
            let open = (0..4).filter(move |corner| neighbours[*corner] == NO_ELEMENT);
            open.map(move |corner| self.face(element, corner))
        })
    }

    /// Returns the faces between some regions and all others, and those of these regions on the surface, by element.
    pub fn surface_of<'a>(&'a self, regions: &'a [i32]) -> impl Iterator<Item = Face> + 'a {
        let is_of = move |element: u32| regions.contains(&self.regions[element as usize]);
        let of_regions = (0..).zip(&self.neighbours).filter(move |(element, _)| is_of(*element));
        of_regions.flat_map(move |(element, neighbours)| {
            let open = (0..4).filter(move |corner| neighbours[*corner] == NO_ELEMENT || !is_of(neighbours[*corner]));
            open.map(move |corner| self.face(element, corner))
        })
    }

    /// Returns the face of an element opposite to a corner.
    fn face(&self, element: u32, opposite: usize) -> Face {
        let corners = self.elements[element as usize];
        let nodes = [1, 2, 3].map(|next| corners[(opposite + next) % 4]);
        let [a, b, c, inside] = [nodes[0], nodes[1], nodes[2], corners[opposite]]
            .map(|node| nalgebra::Vector3::from(self.nodes[node as usize]));
        let area = 0.5 * (b - a).cross(&(c - a));
        let outward = if area.dot(&(inside - a)) > 0.0 { -area } else { area };
        Face {
            nodes,
            element,
            region: self.regions[element as usize],
            area_mm2: outward.into(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_faces_of_a_block_point_outward_and_close_it() {
        let mesh = TetMesh::over_box([1.0, 2.0, 3.0], [4.0, 4.0, 5.0], 60).unwrap();
        let faces: Vec<Face> = mesh.surface().collect();
        let sum = |weigh: &dyn Fn(&Face) -> f64| faces.iter().map(weigh).sum::<f64>();
        for axis in 0..3 {
            assert!(sum(&|face| face.area_mm2[axis]).abs() < 1e-12);
        }
        let area = sum(&|face| nalgebra::Vector3::from(face.area_mm2).norm());
        assert!((area - 32.0).abs() < 1e-12, "{area}");
        // The divergence theorem of the field x, for the volume.
        let middle = |face: &Face| {
            face.nodes
                .map(|node| mesh.nodes()[node as usize][0])
                .iter()
                .sum::<f64>()
                / 3.0
        };
        let volume = sum(&|face| middle(face) * face.area_mm2[0]);
        assert!((volume - 12.0).abs() < 1e-12, "{volume}");
    }
}
