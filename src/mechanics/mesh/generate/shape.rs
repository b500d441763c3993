//! Shape measures of a tetrahedron for the generator: fast, and independent of its orientation.

/// Corners of the face opposite each corner.
pub(super) const FACES: [[usize; 3]; 4] = [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]];

pub(super) fn sub(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

pub(super) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(super) fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

pub(super) fn norm(a: [f64; 3]) -> f64 {
    dot(a, a).sqrt()
}

/// Returns six times the signed volume, mm^3.
pub(super) fn six_volumes(corners: &[[f64; 3]; 4]) -> f64 {
    let [a, b, c] = [1, 2, 3].map(|corner: usize| sub(corners[corner], corners[0]));
    dot(a, cross(b, c))
}

/// Returns the cosine of the smallest dihedral angle: the smaller the better; 1 for a flat element.
pub(super) fn sharpest_cosine(corners: &[[f64; 3]; 4]) -> f64 {
    let [a, b, c] = [1, 2, 3].map(|corner: usize| sub(corners[corner], corners[0]));
    // Normals of the faces opposite corners 1, 2, 3 and 0, all inwards or all outwards.
    let faces = [cross(b, c), cross(c, a), cross(a, b)];
    let last = [0, 1, 2].map(|axis| -(faces[0][axis] + faces[1][axis] + faces[2][axis]));
    let faces = [faces[0], faces[1], faces[2], last];
    let scales = faces.map(|face| 1.0 / norm(face));
    let mut sharpest = -1.0f64;
    for i in 0..4 {
        for j in 0..i {
            let cosine = -dot(faces[i], faces[j]) * scales[i] * scales[j];
            // NaN where a face has no area.
            if cosine.is_nan() {
                return 1.0;
            }
            sharpest = sharpest.max(cosine);
        }
    }
    sharpest
}
