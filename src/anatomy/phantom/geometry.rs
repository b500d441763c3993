//! Solid shapes by signed distance: negative inside, millimetres, close to exact near the surface.

use nalgebra::{Unit, Vector3};

use insonify_base::random::noise::Noise;

/// A point or direction in the world, LPS mm.
pub(super) type Point = Vector3<f64>;

/// An axis-aligned box in the world, mm.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bounds {
    /// Lowest corner.
    pub(super) min: Point,
    /// Highest corner.
    pub(super) max: Point,
}

impl Bounds {
    /// Returns the box enlarged by `margin` millimetres on every side.
    pub(super) fn grown(&self, margin: f64) -> Self {
        Self {
            min: self.min.add_scalar(-margin),
            max: self.max.add_scalar(margin),
        }
    }

    /// Whether two boxes intersect.
    pub(super) fn meets(&self, other: &Self) -> bool {
        (0..3).all(|axis| self.min[axis] <= other.max[axis] && other.min[axis] <= self.max[axis])
    }
}

/// A solid with a signed distance.
pub(super) trait Shape: Send + Sync {
    /// Returns a box that contains every point of non-positive distance.
    fn bounds(&self) -> Bounds;
    /// Signed distance to the surface, mm (negative inside).
    fn distance(&self, p: &Point) -> f64;
}

/// A straight tube with round ends whose radius varies linearly along it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tube {
    /// Centre of each end, mm.
    pub(super) ends: [Point; 2],
    /// Radius at each end, mm.
    pub(super) radii: [f64; 2],
}

impl Shape for Tube {
    fn bounds(&self) -> Bounds {
        let [a, b] = self.ends;
        Bounds {
            min: a.inf(&b),
            max: a.sup(&b),
        }
        .grown(self.radii[0].max(self.radii[1]))
    }

    fn distance(&self, p: &Point) -> f64 {
        let [a, b] = self.ends;
        let axis = b - a;
        let t = ((p - a).dot(&axis) / axis.norm_squared().max(1e-12)).clamp(0.0, 1.0);
        (p - a - axis * t).norm() - (self.radii[0] + (self.radii[1] - self.radii[0]) * t)
    }
}

/// An ellipsoid with its own axes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ellipsoid {
    /// Centre, mm.
    pub(super) centre: Point,
    /// Orthonormal axes.
    pub(super) axes: [Point; 3],
    /// Half length along each axis, mm.
    pub(super) radii: [f64; 3],
}

impl Ellipsoid {
    /// An ellipsoid aligned with the world's axes.
    pub(super) const fn upright([x, y, z]: [f64; 3], radii: [f64; 3]) -> Self {
        Self {
            centre: Point::new(x, y, z),
            axes: [
                Point::new(1.0, 0.0, 0.0),
                Point::new(0.0, 1.0, 0.0),
                Point::new(0.0, 0.0, 1.0),
            ],
            radii,
        }
    }

    /// Coordinates along the axes in units of the half lengths: length 1 on the surface.
    pub(super) fn local(&self, p: &Point) -> Point {
        let offset = p - self.centre;
        Point::from_fn(|axis, _| offset.dot(&self.axes[axis]) / self.radii[axis])
    }
}

impl Shape for Ellipsoid {
    fn bounds(&self) -> Bounds {
        let half = Point::from_fn(|row, _| {
            (0..3)
                .map(|axis| (self.axes[axis][row] * self.radii[axis]).powi(2))
                .sum::<f64>()
                .sqrt()
        });
        Bounds {
            min: self.centre - half,
            max: self.centre + half,
        }
    }

    fn distance(&self, p: &Point) -> f64 {
        let local = self.local(p);
        let level = local.norm();
        if level < 1e-9 {
            return -self.radii.iter().copied().fold(f64::INFINITY, f64::min);
        }
        let slope = Point::from_fn(|axis, _| local[axis] / self.radii[axis]).norm() / level;
        (level - 1.0) / slope
    }
}

/// A box with its own axes and rounded edges.
#[derive(Clone, Copy, Debug)]
pub(super) struct Block {
    /// Centre, mm.
    pub(super) centre: Point,
    /// Orthonormal axes.
    pub(super) axes: [Point; 3],
    /// Half length along each axis, rounding included, mm.
    pub(super) half: [f64; 3],
    /// Radius of the edges, mm.
    pub(super) round: f64,
}

impl Shape for Block {
    fn bounds(&self) -> Bounds {
        let half = Point::from_fn(|row, _| (0..3).map(|axis| (self.axes[axis][row] * self.half[axis]).abs()).sum());
        Bounds {
            min: self.centre - half,
            max: self.centre + half,
        }
    }

    fn distance(&self, p: &Point) -> f64 {
        let offset = p - self.centre;
        let q = Point::from_fn(|axis, _| offset.dot(&self.axes[axis]).abs() - self.half[axis] + self.round);
        q.sup(&Point::zeros()).norm() + q.max().min(0.0) - self.round
    }
}

/// A shape whose surface is perturbed by smooth noise.
pub(super) struct Uneven<S> {
    /// Unperturbed shape.
    pub(super) shape: S,
    /// Noise that displaces the surface.
    pub(super) noise: Noise,
    /// Largest displacement of the surface, mm.
    pub(super) amplitude_mm: f64,
}

impl<S: Shape> Shape for Uneven<S> {
    fn bounds(&self) -> Bounds {
        self.shape.bounds().grown(self.amplitude_mm)
    }

    fn distance(&self, p: &Point) -> f64 {
        let even = self.shape.distance(p);
        if even.abs() > 4.0 * self.amplitude_mm {
            even
        } else {
            even + self.amplitude_mm * self.noise.at(p)
        }
    }
}

/// A shape given by a function and its box.
pub(super) struct Solid<F> {
    /// Bounding box of the shape.
    pub(super) bounds: Bounds,
    /// Signed distance.
    pub(super) distance: F,
}

impl<F: Fn(&Point) -> f64 + Send + Sync> Shape for Solid<F> {
    fn bounds(&self) -> Bounds {
        self.bounds
    }

    fn distance(&self, p: &Point) -> f64 {
        (self.distance)(p)
    }
}

/// Smooth intersection: maximum of two distances with the edge between them rounded over `k` millimetres.
pub(super) fn smooth_max(a: f64, b: f64, k: f64) -> f64 {
    let h = (k - (a - b).abs()).max(0.0) / k;
    a.max(b) + h * h * k / 4.0
}

/// Smooth union: minimum of two distances with the crease between them filled over `k` millimetres.
pub(super) fn smooth_min(a: f64, b: f64, k: f64) -> f64 {
    -smooth_max(-a, -b, k)
}

/// Smooth step from 0 at `low` to 1 at `high`.
pub(super) fn step(low: f64, high: f64, x: f64) -> f64 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Value at `x` of the smooth piecewise monotone curve through `knots` (ascending in x), constant beyond its ends.
pub(super) fn curve(knots: &[[f64; 2]], x: f64) -> f64 {
    let after = knots.partition_point(|knot| knot[0] < x);
    match (after.checked_sub(1).and_then(|i| knots.get(i)), knots.get(after)) {
        (Some(a), Some(b)) => {
            let slope = |i: usize| {
                let (left, right) = (knots[i.saturating_sub(1)], knots[(i + 1).min(knots.len() - 1)]);
                (right[1] - left[1]) / (right[0] - left[0])
            };
            let width = b[0] - a[0];
            let t = (x - a[0]) / width;
            let (m0, m1) = (slope(after - 1) * width, slope(after) * width);
            let (t2, t3) = (t * t, t * t * t);
            a[1] * (2.0 * t3 - 3.0 * t2 + 1.0)
                + m0 * (t3 - 2.0 * t2 + t)
                + b[1] * (3.0 * t2 - 2.0 * t3)
                + m1 * (t3 - t2)
        }
        (Some(end), None) | (None, Some(end)) => end[1],
        (None, None) => 0.0,
    }
}

/// Centre and radius at a point of a path, mm.
pub(super) type Knot = ([f64; 3], f64);

/// Tubes along a smooth path through `points` (each a centre and a radius), `pieces` per interval.
pub(super) fn path(points: &[Knot], pieces: usize) -> Vec<Tube> {
    let sample = |s: f64| {
        let knots = |f: &dyn Fn(&Knot) -> f64| {
            let list: Vec<[f64; 2]> = points.iter().enumerate().map(|(i, p)| [i as f64, f(p)]).collect();
            curve(&list, s)
        };
        (
            Point::new(knots(&|p| p.0[0]), knots(&|p| p.0[1]), knots(&|p| p.0[2])),
            knots(&|p| p.1),
        )
    };
    let count = (points.len().saturating_sub(1)) * pieces;
    (0..count)
        .map(|i| {
            let (a, ra) = sample(i as f64 / pieces as f64);
            let (b, rb) = sample((i + 1) as f64 / pieces as f64);
            Tube {
                ends: [a, b],
                radii: [ra, rb],
            }
        })
        .collect()
}

/// Three orthonormal axes: the first along `long`, the second as close to `side` as possible.
pub(super) fn frame(long: Point, side: Point) -> [Point; 3] {
    let long = Unit::new_normalize(long).into_inner();
    let side = Unit::new_normalize(side - long * side.dot(&long)).into_inner();
    [long, side, long.cross(&side)]
}
