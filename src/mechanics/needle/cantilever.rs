//! A flexible needle as a beam that its base holds.

#[cfg(test)]
mod tests;

use faer::Mat;
use nalgebra::{Isometry3, Matrix3, Matrix6, Point3, Translation3, UnitQuaternion, Vector3, Vector6};

use super::chain::{Beyond, Chain, limited};
use super::shaft::check;
use super::{Bevel, CentreLine, Entry, InvalidNeedleModel, Load, Needle, Row, Shaft, Stiffness};

/// Usual length of an element, mm.
pub const ELEMENT_MM: f64 = 5.0;

/// Most elements of a needle.
const MAX_ELEMENTS: f64 = 1000.0;

/// A needle as an Euler-Bernoulli beam in space: Hermite cubic elements, each in a frame that goes with its chord.
///
/// An element of length `h` bends by the moments at its ends, `a1 = -(h/6EI) (2 M1 + M2)` and `a2 = (h/6EI) (M1 + 2 M2)`, the
/// angles of its ends against its chord. Moments follow from the loads beyond, with their levers on the bent shaft. So at a node
/// the chords turn by `(h/6EI) (M_before + 4 M + M_beyond)`, at the base by `(h/6EI) (2 M + M_beyond)`: nodes lie where beam
/// theory has them whatever `h`, as long as forces act at nodes. Between nodes the shaft is its chord, which a force there sees:
/// that leaves out at most `F h^3/(48 EI)`, 0.0004 mm for 1 N and 5 mm. (Springs, whose joints are the midpoint rule of the same
/// integrals, are off by `h^2/(4 L^2)` of the deflection.)
///
/// Rotations of the whole may be large: frames are carried along, levers are those of the bent needle, and lengths stay. Within
/// an element the chord is as long as the arc, which is off by `a^2/10` of it for ends that turn by `a`; a node turns by at most 45
/// degrees. There is no torsion, as for the other models. For a needle on a hyperelastic foundation of its own see
/// [`beam`](super::beam); here tissue acts through the loads.
#[derive(Clone, Debug)]
pub struct Cantilever {
    chain: Chain,
    radius_mm: f64,
    /// h/6EI, 1/(N mm).
    compliance: f64,
    beyond: Vec<Beyond>,
    /// For the first elements together, the flexibility by moment about the base and direction.
    together: Vec<Matrix6<f64>>,
    /// Where the line's nodes of base and joints are, and the planes across the elements beyond them.
    nodes: Vec<(Vector3<f64>, Matrix3<f64>)>,
    rows: Vec<Twist>,
}

/// A row of a flexibility, on its way.
#[derive(Clone, Copy, Debug)]
struct Twist {
    /// The element that it lies on.
    element: usize,
    /// Moment about the base, and direction.
    row: Vector6<f64>,
    /// What the elements before its own make of that.
    moved: Vector6<f64>,
}

impl Twist {
    /// Moment about a point beside the base.
    fn about(&self, point: &Vector3<f64>) -> Vector3<f64> {
        let direction = self.row.fixed_rows::<3>(3).into_owned();
        self.row.fixed_rows::<3>(0) - point.cross(&direction)
    }
}

impl Cantilever {
    /// A needle of elements about `element_mm` long (above 0, at most the needle, at most 1000 elements): as many as make up its
    /// length.
    ///
    /// # Errors
    /// [`InvalidNeedleModel`].
    pub fn new(
        shaft: Shaft,
        stiffness: Stiffness,
        element_mm: f64,
        bevel: Option<Bevel>,
    ) -> Result<Self, InvalidNeedleModel> {
        shaft.check()?;
        stiffness.check()?;
        bevel.map_or(Ok(()), |bevel| bevel.check(&shaft))?;
        let length = shaft.length_mm;
        let elements = (length / element_mm).round();
        let holds = element_mm <= length && (1.0..=MAX_ELEMENTS).contains(&elements);
        let expected = "above 0, at most the length of the needle, at least a thousandth of it";
        check("element_mm", element_mm, holds, expected)?;
        let part = length / elements;
        let joints: Vec<f64> = (1..elements as usize).map(|node| part * node as f64).collect();
        Ok(Self {
            chain: Chain::new(length, &joints, bevel.as_ref()),
            radius_mm: shaft.radius_mm,
            compliance: part / (6.0 * stiffness.bending_nmm2()),
            beyond: Vec::new(),
            together: Vec::new(),
            nodes: Vec::new(),
            rows: Vec::new(),
        })
    }

    /// Takes what the flexibility needs of a line: nodes, planes, and sums over elements.
    fn survey(&mut self, line: &CentreLine) {
        let points = line.nodes();
        let base = points[0].1;
        let nodes = std::iter::once(&0).chain(self.chain.joints()).map(|&node| {
            let along = (points[node + 1].1 - points[node].1).normalize();
            (points[node].1 - base, Matrix3::identity() - along * along.transpose())
        });
        self.nodes.clear();
        self.nodes.extend(nodes);
        self.together.clear();
        let mut sum = Matrix6::zeros();
        self.together.push(sum);
        for pair in self.nodes.windows(2) {
            let [(near, across), (far, _)] = [pair[0], pair[1]];
            let levers = [near.cross_matrix(), far.cross_matrix()];
            // (M1, M2) by [[2, 1], [1, 2]], each M = m - x n.
            for (i, j, weight) in [(0, 0, 2.0), (0, 1, 1.0), (1, 0, 1.0), (1, 1, 2.0)] {
                let plane = across * (weight * self.compliance);
                let [left, right] = [levers[i].transpose() * plane, plane * levers[j]];
                let mut add = |row: usize, column: usize, part: Matrix3<f64>| {
                    let mut block = sum.fixed_view_mut::<3, 3>(row, column);
                    block += part;
                };
                add(0, 0, plane);
                add(0, 3, -right);
                add(3, 0, -left);
                add(3, 3, levers[i].transpose() * right);
            }
            self.together.push(sum);
        }
    }

    /// What the element of `near` adds to a pair of rows, of which `far` lies on it or beyond: the moment of `near` is 0 at its far end.
    fn last(&self, near: &Twist, far: &Twist) -> f64 {
        let (start, across) = &self.nodes[near.element];
        let mut moment = 2.0 * far.about(start);
        if let Some((end, _)) = self.nodes.get(near.element + 1).filter(|_| far.element > near.element) {
            moment += far.about(end);
        }
        self.compliance * near.about(start).dot(&(across * moment))
    }
}

impl Needle for Cantilever {
    fn length_mm(&self) -> f64 {
        self.chain.length_mm()
    }

    fn radius_mm(&self) -> f64 {
        self.radius_mm
    }

    fn is_flexible(&self) -> bool {
        true
    }

    fn place(&mut self, base: &Isometry3<f64>, _entry: Option<&Entry>, loads: &[Load], line: &mut CentreLine) {
        if !self.chain.fits(line) {
            self.chain.place(base, line, |_, _| Vector3::zeros());
        }
        self.chain.gather(loads, line, &mut self.beyond);
        let (beyond, compliance) = (&self.beyond, self.compliance);
        let moment = |node: usize| beyond.get(node).map_or(Vector3::zeros(), |beyond| beyond.1);
        let turn =
            |along: &Vector3<f64>, moment: Vector3<f64>| limited((moment - along * along.dot(&moment)) * compliance);
        let along = base.rotation * Vector3::z();
        let first = turn(&along, moment(0) * 2.0 + moment(1));
        let mut root = *base;
        if first != Vector3::zeros() {
            let rotation = UnitQuaternion::from_scaled_axis(first) * base.rotation;
            root = Isometry3::from_parts(Translation3::from(base.translation.vector), rotation);
        }
        self.chain.place(&root, line, |joint, along| {
            turn(along, moment(joint) + moment(joint + 1) * 4.0 + moment(joint + 2))
        });
    }

    fn flexibility(&mut self, line: &CentreLine, rows: &[Row], out: &mut Mat<f64>) {
        if !self.chain.fits(line) {
            return;
        }
        self.survey(line);
        let base: Point3<f64> = line.nodes()[0].1;
        self.rows.clear();
        let (chain, together) = (&self.chain, &self.together);
        self.rows.extend(rows.iter().map(|row| {
            let element = chain.joints_before(row.arc_mm);
            let moment = (line.at(row.arc_mm).point_mm - base).cross(&row.direction);
            let [m, n] = [moment, row.direction];
            let row = Vector6::new(m.x, m.y, m.z, n.x, n.y, n.z);
            Twist {
                element,
                row,
                moved: together[element] * row,
            }
        }));
        // Of two rows the one with fewer elements before it says what both share.
        for (i, a) in self.rows.iter().enumerate() {
            for (j, b) in self.rows[..=i].iter().enumerate() {
                let (near, far) = if a.element < b.element { (a, b) } else { (b, a) };
                let share = near.moved.dot(&far.row) + self.last(near, far);
                out[(i, j)] += share;
                if i != j {
                    out[(j, i)] += share;
                }
            }
        }
    }
}
