//! Barycentric data of one element for point location, prepared from its current and reference corners.

use nalgebra::{Matrix3, Vector3};

use insonify_base::real::Real;
use insonify_base::simd::{Pack, array, map};

/// Map from world to barycentric coordinates, sixteen scalars: `[origin, slack]`, `[row 1, clear]`,
/// `[row 2, inverted]`, `[row 3, 0]`.
///
/// With `d = p - origin` (the current position of corner 0), coordinate `i` is `row i . d` and coordinate 0 is 1 minus
/// the others: near the element `d` is small, so nothing cancels however far from the world's origin it lies. `slack`
/// is the rounding error of the coordinates, -1 in an element that is never hit; `clear` is the margin beyond which no
/// other element of an unfolded mesh can contain the point; `inverted` is 1 or 0.
pub type Frame<T> = [[T; 4]; 4];

/// Map from world to reference: row `k` holds the gradient of reference coordinate `k` over `d` and the reference
/// corner 0.
pub type Carry<T> = [[T; 4]; 3];

/// Bound on the rounding error of a barycentric coordinate, in machine epsilons per (1 + aspect), where aspect is the
/// element's diameter over its least height. Rounding a row, `d` and the dot product costs at most 5 half epsilons of
/// `|row| |d|`; coordinate 0 adds up three such errors and its own: below 8. Twice that leaves room for fused or
/// reordered arithmetic on other backends.
const SLACK_EPSILONS: f64 = 16.0;
/// Bound on the rounding error of the point, in epsilons of its largest coordinate; rounding moves it by at most 0.9: a
/// point meant to lie on a face belongs to both of its sides, and one on the surface of the mesh is not lost.
const POINT_EPSILONS: f64 = 2.0;
/// Slack of elements so thin that the bound above is meaningless.
const SLACK_MAX: f64 = 1.0 / 64.0;
/// Bound on how far points that test as inside lie outside an element along an axis, in extents of the element along
/// it: see [`prepare`].
pub const MAX_REACH: f64 = 6.0 * SLACK_MAX;
/// Flatness in epsilons of its largest coordinate below which an element has no orientation resolved by the scalar.
const FLAT_EPSILONS: f64 = 4.0;

/// Kind of an element in the current state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Kind {
    /// Positive volume.
    #[default]
    Sound,
    /// Negative volume: the element is turned inside out.
    Inverted,
    /// No volume, or thinner than the scalar resolves.
    Flat,
    /// A corner is NaN or infinite, in the current or the reference state.
    NotFinite,
}

/// Properties of an element used by the grid and the margins.
#[derive(Clone, Copy, Debug, Default)]
pub struct Outline<T> {
    /// Axis-aligned box of all points that can test as inside: low corner, high corner; low above high if it is never
    /// hit.
    pub bounds: [[T; 3]; 2],
    /// Maximum distance from the element of points that test as inside, mm.
    pub reach: T,
    /// Absolute volume, mm^3; 0 if the element is never hit.
    pub volume: f64,
    /// Kind in the current state.
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
    let lanes = prepare_lanes(
        &current.map(|corner| corner.map(|x| [x])),
        &reference.map(|corner| corner.map(|x| Pack([x]))),
    );
    let (frame, carry) = lanes.of_lane(0);
    let ([reach], [kind]) = (lanes.reach, lanes.kind);
    let mut outline = Outline {
        bounds: [[T::infinity(); 3], [T::neg_infinity(); 3]],
        reach,
        volume: lanes.volume.0[0],
        kind,
    };
    if is_hit(kind) {
        for axis in 0..3 {
            let coordinates = current.map(|corner| corner[axis]);
            outline.bounds[0][axis] = coordinates.into_iter().fold(coordinates[0], T::min) - reach;
            outline.bounds[1][axis] = coordinates.into_iter().fold(coordinates[0], T::max) + reach;
        }
    }
    (frame, carry, outline)
}

/// Prepared elements, one per lane: [`Frame`], [`Carry`] and parts of [`Outline`].
pub struct Prepared<T, const N: usize> {
    frame: [[[T; N]; 4]; 4],
    carry: [[[T; N]; 4]; 3],
    /// Maximum distance from the element of points that test as inside, mm.
    pub reach: [T; N],
    volume: Pack<N>,
    /// Kind in the current state.
    pub kind: [Kind; N],
}

impl<T: Real, const N: usize> Prepared<T, N> {
    /// Maps of an element to barycentric coordinates and to the reference state.
    #[inline(always)]
    pub fn of_lane(&self, lane: usize) -> (Frame<T>, Carry<T>) {
        let row = |row: [[T; N]; 4]| map(row, |x| x[lane]);
        (map(self.frame, row), map(self.carry, row))
    }
}

/// True for kinds of elements that can contain points: neither flat nor with corners that are not finite.
#[inline(always)]
pub fn is_hit(kind: Kind) -> bool {
    matches!(kind, Kind::Sound | Kind::Inverted)
}

/// Prepares one element per lane, as [`prepare`] does.
#[inline(always)]
pub fn prepare_lanes<T: Real, const N: usize>(
    current: &[[[T; N]; 3]; 4],
    reference: &[[Pack<N>; 3]; 4],
) -> Prepared<T, N> {
    let corners = map(*current, |corner| map(corner, |x| Pack(map(x, T::wide))));
    let edges = |corners: &[[Pack<N>; 3]; 4]| -> [[Pack<N>; 3]; 3] {
        array(|edge| array(|axis| corners[edge + 1][axis] - corners[0][axis]))
    };
    let [e1, e2, e3] = edges(&corners);
    let volume = e1[0] * (e2[1] * e3[2] - e2[2] * e3[1]) - e2[0] * (e1[1] * e3[2] - e1[2] * e3[1])
        + e3[0] * (e1[1] * e2[2] - e1[2] * e2[1]);
    let size = volume.abs();
    let (mut largest, mut zero) = (Pack::splat(0.0), Pack::splat(0.0));
    for corner in 0..4 {
        for axis in 0..3 {
            largest = largest.max(corners[corner][axis].abs());
            // NaN if one of them is not finite.
            zero = zero + corners[corner][axis] * 0.0 + reference[corner][axis] * 0.0;
        }
    }
    let squares = [e1, e2, e3, minus(e2, e1), minus(e3, e1), minus(e3, e2)];
    let diameter = greatest(map(squares, norm_squared)).sqrt();
    let thinnest = largest.max(diameter) * (FLAT_EPSILONS * T::epsilon().wide());
    let faces = [cross(e2, e3), cross(e3, e1), cross(e1, e2)];
    let opposite = array(|axis| faces[0][axis] + faces[1][axis] + faces[2][axis]);
    let widest = greatest(map([faces[0], faces[1], faces[2], opposite], norm_squared)).sqrt();
    // Volume over face area is height.
    let height = volume / widest;
    let kind = array(|lane| match () {
        () if zero.0[lane].is_nan() => Kind::NotFinite,
        () if size.0[lane] <= thinnest.0[lane] * widest.0[lane] || !height.0[lane].is_finite() => Kind::Flat,
        () if volume.0[lane] < 0.0 => Kind::Inverted,
        () => Kind::Sound,
    });
    let rows: [[Pack<N>; 3]; 3] = map(faces, |face| map(face, |x| x / volume));
    let aspect = diameter * widest / size;
    let errors = (aspect + 1.0) * SLACK_EPSILONS + largest * POINT_EPSILONS * widest / size;
    let slack = (errors * T::epsilon().wide()).min(Pack::splat(SLACK_MAX));
    // Coordinates of at least -s are the element scaled about its centroid by 1 + 4 s; no corner moves by more than 3 s
    // diameters. Twice that, since the tested coordinates carry an error of up to s themselves.
    let reach = slack * 6.0 * diameter;
    // Coordinates (1, 0, 0, 0) where points are never hit: none below 1 passes a slack of -1.
    let kept = |values: Pack<N>, otherwise: T| -> [T; N] {
        array(|lane| {
            if is_hit(kind[lane]) {
                T::of(values.0[lane])
            } else {
                otherwise
            }
        })
    };
    let kept_or_zero = |values| kept(values, T::zero());
    let row = |[x, y, z]: [Pack<N>; 3], last: [T; N]| [kept_or_zero(x), kept_or_zero(y), kept_or_zero(z), last];
    let inverted = array(|lane| {
        if kind[lane] == Kind::Inverted {
            T::one()
        } else {
            T::zero()
        }
    });
    let frame = [
        row(corners[0], kept(slack, -T::one())),
        row(rows[0], kept_or_zero(widest / size)),
        row(rows[1], inverted),
        row(rows[2], [T::zero(); N]),
    ];
    let [r1, r2, r3] = edges(reference);
    let carry = array(|k| {
        let gradient = array(|axis| r1[k] * rows[0][axis] + r2[k] * rows[1][axis] + r3[k] * rows[2][axis]);
        row(gradient, kept_or_zero(reference[0][k]))
    });
    Prepared {
        frame,
        carry,
        reach: kept_or_zero(reach),
        volume: Pack(array(|lane| if is_hit(kind[lane]) { size.0[lane] / 6.0 } else { 0.0 })),
        kind,
    }
}

#[inline(always)]
fn minus<const N: usize>(a: [Pack<N>; 3], b: [Pack<N>; 3]) -> [Pack<N>; 3] {
    array(|axis| a[axis] - b[axis])
}

#[inline(always)]
fn cross<const N: usize>(a: [Pack<N>; 3], b: [Pack<N>; 3]) -> [Pack<N>; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

#[inline(always)]
fn norm_squared<const N: usize>(a: [Pack<N>; 3]) -> Pack<N> {
    a[0] * a[0] + a[1] * a[1] + a[2] * a[2]
}

#[inline(always)]
fn greatest<const N: usize, const M: usize>(values: [Pack<N>; M]) -> Pack<N> {
    let mut greatest = Pack::splat(0.0);
    for value in values {
        greatest = greatest.max(value);
    }
    greatest
}

/// Sets the margin of a prepared frame, whose `clear` still holds the inverse of the element's least height, from the
/// reach of the elements around it (mm).
pub(crate) fn set_clear<T: Real>(frame: &mut Frame<T>, reach: T) {
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
    let mut index = 0;
    let mut value = coordinates[0];
    for (other, &coordinate) in coordinates.iter().enumerate().skip(1) {
        if coordinate < value {
            index = other;
            value = coordinate;
        }
    }
    (index, value)
}

/// Returns the rounding error of the barycentric coordinates; -1 in an element that is never hit.
#[inline(always)]
pub fn slack<T: Real>(frame: &Frame<T>) -> T {
    frame[0][3]
}

/// Returns the margin: a point whose coordinates all exceed it lies in no other element of an unfolded mesh.
#[inline(always)]
pub fn clear<T: Real>(frame: &Frame<T>) -> T {
    frame[1][3]
}

/// Whether the element is inverted in the current state.
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
