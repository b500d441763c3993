//! Face adjacency of elements.

use super::{InvalidMesh, NONE};

/// Local corners of the face opposite each corner.
const OPPOSITE: [[usize; 3]; 4] = [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]];

/// Returns, for each element and corner, the element across the opposite face, or [`NONE`].
pub(super) fn neighbours(elements: &[[u32; 4]]) -> Result<Vec<[u32; 4]>, InvalidMesh> {
    let mut faces: Vec<([u32; 3], u32, u8)> = Vec::with_capacity(4 * elements.len());
    for (element, corners) in elements.iter().enumerate() {
        for (place, opposite) in OPPOSITE.iter().enumerate() {
            let mut face = opposite.map(|corner| corners[corner]);
            face.sort_unstable();
            faces.push((face, element as u32, place as u8));
        }
    }
    faces.sort_unstable();
    let mut neighbours = vec![[NONE; 4]; elements.len()];
    for shared in faces.chunk_by(|a, b| a.0 == b.0) {
        match shared {
            [_] => {}
            [a, b] => {
                neighbours[a.1 as usize][a.2 as usize] = b.1;
                neighbours[b.1 as usize][b.2 as usize] = a.1;
            }
            [a, b, c, ..] => {
                let sharing = [a.1, b.1, c.1];
                return Err(repeated(elements, sharing).unwrap_or(InvalidMesh::SharedFace {
                    face: a.0,
                    elements: sharing,
                }));
            }
            [] => {}
        }
    }
    Ok(neighbours)
}

/// Returns the error for two of these elements having the same corners, if any.
fn repeated(elements: &[[u32; 4]], among: [u32; 3]) -> Option<InvalidMesh> {
    let corners = among.map(|element| {
        let mut corners = elements[element as usize];
        corners.sort_unstable();
        corners
    });
    let (first, second) = [(0, 1), (0, 2), (1, 2)]
        .into_iter()
        .find(|(first, second)| corners[*first] == corners[*second])?;
    Some(InvalidMesh::Repeated {
        corners: corners[first],
        elements: [among[first], among[second]],
    })
}
