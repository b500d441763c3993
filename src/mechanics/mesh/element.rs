//! Barycentric data of one element for point location, prepared from its current and reference corners.

use nalgebra::{Matrix3, Vector3};

use crate::base::real::Real;

/// Map from world to barycentric coordinates, sixteen scalars: `[origin, slack]`, `[row 1, clear]`, `[row 2, inverted]`,
/// `[row 3, 0]`.
///
/// With `d = p - origin` (the current position of corner 0), coordinate `i` is `row i . d` and coordinate 0 is 1 minus the
/// others: near the element `d` is small, so nothing cancels however far from the world's origin it lies. `slack` is the
/// rounding error of the coordinates, -1 in an element that is never hit; `clear` is the margin beyond which no other
/// element of an unfolded mesh can contain the point; `inverted` is 1 or 0.
pub type Frame<T> = [[T; 4]; 4];

/// Map from world to reference: row `k` holds the gradient of reference coordinate `k` over `d` and the reference corner 0.
pub type Carry<T> = [[T; 4]; 3];

/// Bound on the rounding error of a barycentric coordinate, in machine epsilons per (1 + aspect), where aspect is the
/// element's diameter over its least height. Rounding a row, `d` and the dot product costs at most 5 half epsilons of `|row|
/// |d|`; coordinate 0 adds up three such errors and its own: below 8. Twice that leaves room for fused or reordered
/// arithmetic on other backends.
const SLACK_EPSILONS: f64 = 16.0;
/// Bound on the rounding error of the point, in epsilons of its largest coordinate; rounding moves it by at most 0.9: a
/// point meant to lie on a face belongs to both of its sides, and one on the surface of the mesh is not lost.
const POINT_EPSILONS: f64 = 2.0;
/// Slack of elements so thin that the bound above is meaningless.
const SLACK_MAX: f64 = 1.0 / 64.0;
/// Bound on how far points that test as inside lie outside an element along an axis, in extents of the element along it: see [`prepare`].
pub const MAX_REACH: f64 = 6.0 * SLACK_MAX;
/// Flatness in epsilons of its largest coordinate below which an element has no orientation resolved by the scalar.
const FLAT_EPSILONS: f64 = 4.0;

/// Kind of an element in the current state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Kind {
    #[default]
    Sound,
    Inverted,
    /// No volume, or thinner than the scalar resolves.
    Flat,
    /// A corner is NaN or infinite, in the current or the reference state.
    NotFinite,
}

/// Properties of an element used by the grid and the margins.
#[derive(Clone, Copy, Debug, Default)]
pub struct Outline<T> {
    /// Axis-aligned box of all points that can test as inside: low corner, high corner; low above high if it is never hit.
    pub bounds: [[T; 3]; 2],
    /// Maximum distance from the element of points that test as inside, mm.
    pub reach: T,
    /// Absolute volume, mm^3; 0 if the element is never hit.
    pub volume: f64,
    pub kind: Kind,
}

/// Returns the edge vectors from corner 0 as columns.
pub fn edges(corners: &[[f64; 3]; 4]) -> Matrix3<f64> {
    let origin = Vector3::from(corners[0]);
    Matrix3::from_columns(&[1, 2, 3].map(|corner: usize| Vector3::from(corners[corner]) - origin))
}

/// Prepares the element with these corners. The current corners are in the precision of `T`, so that neighbours agree
/// exactly on their common face.
pub fn prepare<T: Real>(current: [[T; 3]; 4], reference: &[[f64; 3]; 4]) -> (Frame<T>, Carry<T>, Outline<T>) {
    let corners = current.map(|corner| corner.map(T::wide));
    if corners.iter().chain(reference).flatten().any(|x| !x.is_finite()) {
        return excluded(Kind::NotFinite);
    }
    let edges_now = edges(&corners);
    let volume = edges_now.determinant();
    let largest = corners.iter().flatten().fold(0.0f64, |a, x| a.max(x.abs()));
    let diameter = diameter(&edges_now);
    let thinnest = FLAT_EPSILONS * T::epsilon().wide() * largest.max(diameter);
    let (e1, e2, e3) = (edges_now.column(0), edges_now.column(1), edges_now.column(2));
    let cross = [e2.cross(&e3), e3.cross(&e1), e1.cross(&e2)];
    let opposite = cross[0] + cross[1] + cross[2];
    let widest = [cross[0], cross[1], cross[2], opposite]
        .iter()
        .fold(0.0f64, |a, face| a.max(face.norm_squared()))
        .sqrt();
    // Volume over face area is height.
    if volume.abs() <= thinnest * widest || !(volume / widest).is_finite() {
        return excluded(Kind::Flat);
    }
    let rows = cross.map(|face| face / volume);
    let aspect = diameter * widest / volume.abs();
    let errors = SLACK_EPSILONS * (1.0 + aspect) + POINT_EPSILONS * largest * widest / volume.abs();
    let slack = (errors * T::epsilon().wide()).min(SLACK_MAX);
    // Coordinates of at least -s are the element scaled about its centroid by 1 + 4 s; no corner moves by more than 3 s
    // diameters. Twice that, since the tested coordinates carry an error of up to s themselves.
    let reach = 6.0 * slack * diameter;
    let inverted = volume < 0.0;

    let mut frame = [[T::zero(); 4]; 4];
    frame[0] = [current[0][0], current[0][1], current[0][2], T::of(slack)];
    for (place, row) in rows.iter().enumerate() {
        frame[place + 1] = [T::of(row.x), T::of(row.y), T::of(row.z), T::zero()];
    }
    frame[1][3] = T::of(widest / volume.abs());
    frame[2][3] = if inverted { T::one() } else { T::zero() };
    let gradient =
        edges(reference) * Matrix3::from_rows(&[rows[0].transpose(), rows[1].transpose(), rows[2].transpose()]);
    let carry = std::array::from_fn(|k| {
        [
            T::of(gradient[(k, 0)]),
            T::of(gradient[(k, 1)]),
            T::of(gradient[(k, 2)]),
            T::of(reference[0][k]),
        ]
    });
    let reach = T::of(reach);
    let mut bounds = [current[0]; 2];
    for axis in 0..3 {
        for corner in &current[1..] {
            bounds[0][axis] = bounds[0][axis].min(corner[axis]);
            bounds[1][axis] = bounds[1][axis].max(corner[axis]);
        }
        bounds[0][axis] -= reach;
        bounds[1][axis] += reach;
    }
    let kind = if inverted { Kind::Inverted } else { Kind::Sound };
    let volume = volume.abs() / 6.0;
    (
        frame,
        carry,
        Outline {
            bounds,
            reach,
            volume,
            kind,
        },
    )
}

/// Sets the margin of a prepared frame, whose `clear` still holds the inverse of the element's least height, from the reach
/// of the elements around it (mm).
pub fn set_clear<T: Real>(frame: &mut Frame<T>, reach: T) {
    frame[1][3] = frame[0][3] + reach * frame[1][3];
}

/// Returns the barycentric coordinates of `p`.
#[inline(always)]
pub fn barycentric<T: Real>(frame: &Frame<T>, p: [T; 3]) -> [T; 4] {
    let d = [p[0] - frame[0][0], p[1] - frame[0][1], p[2] - frame[0][2]];
    let b1 = frame[1][0] * d[0] + frame[1][1] * d[1] + frame[1][2] * d[2];
    let b2 = frame[2][0] * d[0] + frame[2][1] * d[1] + frame[2][2] * d[2];
    let b3 = frame[3][0] * d[0] + frame[3][1] * d[1] + frame[3][2] * d[2];
    [T::one() - b1 - b2 - b3, b1, b2, b3]
}

/// Returns the index and value of the least coordinate; of ties the first.
#[inline(always)]
pub fn least<T: Real>(coordinates: &[T; 4]) -> (usize, T) {
    let mut place = 0;
    let mut value = coordinates[0];
    for (other, &coordinate) in coordinates.iter().enumerate().skip(1) {
        if coordinate < value {
            place = other;
            value = coordinate;
        }
    }
    (place, value)
}

#[inline(always)]
pub fn slack<T: Real>(frame: &Frame<T>) -> T {
    frame[0][3]
}

#[inline(always)]
pub fn clear<T: Real>(frame: &Frame<T>) -> T {
    frame[1][3]
}

#[inline(always)]
pub fn is_inverted<T: Real>(frame: &Frame<T>) -> bool {
    frame[2][3] != T::zero()
}

/// Whether an element holds a position, whose fourth component does not matter.
#[inline(always)]
pub fn holds<T: Real>(frame: &Frame<T>, position: &[T; 4]) -> bool {
    let [x, y, z, _] = *position;
    least(&barycentric(frame, [x, y, z])).1 >= -slack(frame)
}

/// Returns the reference position of `p` under the affine map of one element.
#[inline(always)]
pub fn carry_to_reference<T: Real>(frame: &Frame<T>, carry: &Carry<T>, p: [T; 3]) -> [T; 3] {
    let d = [p[0] - frame[0][0], p[1] - frame[0][1], p[2] - frame[0][2]];
    carry.map(|row| row[3] + (row[0] * d[0] + row[1] * d[1] + row[2] * d[2]))
}

fn diameter(edges: &Matrix3<f64>) -> f64 {
    let (e1, e2, e3) = (edges.column(0), edges.column(1), edges.column(2));
    let squares = [
        e1.norm_squared(),
        e2.norm_squared(),
        e3.norm_squared(),
        (e2 - e1).norm_squared(),
        (e3 - e1).norm_squared(),
        (e3 - e2).norm_squared(),
    ];
    squares.iter().fold(0.0f64, |a, b| a.max(*b)).sqrt()
}

/// Returns an element that is never hit: its coordinates are (1, 0, 0, 0), and none below 1 passes a slack of -1.
fn excluded<T: Real>(kind: Kind) -> (Frame<T>, Carry<T>, Outline<T>) {
    let mut frame = [[T::zero(); 4]; 4];
    frame[0][3] = -T::one();
    let bounds = [[T::infinity(); 3], [T::neg_infinity(); 3]];
    let outline = Outline {
        bounds,
        reach: T::zero(),
        volume: 0.0,
        kind,
    };
    (frame, [[T::zero(); 4]; 3], outline)
}
