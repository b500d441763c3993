//! Linear equations of a Newton step, solved in two sweeps.
//!
//! Nodes have deflection and slope, q = (u, s). An element is bent by the slopes at its ends relative to its chord, a =
//! (a1, a2); with its length h the far node follows from the near one as `q2 = T q1 + G a`:
//!
//! ```text
//! T = [1 h]   G = [-h 0]   bending moments  B a,  B = (E I/h) [4 2]
//!     [0 1]       [-1 1]                                      [2 4]
//! ```
//!
//! These are the Hermite elements, in variables that are small where bending is: the state of the beam is its base and
//! `a`, to which corrections are added, so rounding does not grow with the cube of the number of elements, as it does
//! where bending is a difference of deflections. Balance is `B a + G' p = 0` for each element, with `p` the force and
//! the moment on its far node from everything beyond. From the tip to the base, `p` is written as a linear function of
//! the change of the near node, element by element; from the base to the tip the changes follow. Nothing is subtracted
//! that exceeds the result by more than the ratio of the foundation's stiffness to that of an element, so weak tissue
//! and free bases do no harm.

use nalgebra::{Matrix2, Vector2};

use super::foundation::Load;

/// Length and bending stiffness of an element.
#[derive(Clone, Copy, Debug)]
pub(super) struct Element {
    pub length: f64,
    /// Bending stiffness E I, N mm^2.
    pub bending: f64,
}

impl Element {
    fn bend(&self) -> Matrix2<f64> {
        let unit = self.bending / self.length;
        Matrix2::new(4.0 * unit, 2.0 * unit, 2.0 * unit, 4.0 * unit)
    }

    /// Returns the moments at the ends, N mm.
    pub(super) fn moments(&self, angles: &Vector2<f64>) -> Vector2<f64> {
        self.bend() * angles
    }

    fn carry(&self) -> Matrix2<f64> {
        Matrix2::new(1.0, self.length, 0.0, 1.0)
    }

    fn swing(&self) -> Matrix2<f64> {
        Matrix2::new(-self.length, 0.0, -1.0, 1.0)
    }

    /// Returns the far node from the near one.
    pub(super) fn far(&self, near: &Vector2<f64>, angles: &Vector2<f64>) -> Vector2<f64> {
        let chord = near.y - angles.x;
        Vector2::new(near.x + self.length * chord, chord + angles.y)
    }

    /// Carries force and moment on the far node to the near one.
    fn back(&self, far: &Vector2<f64>) -> Vector2<f64> {
        Vector2::new(far.x, far.y + self.length * far.x)
    }

    /// Returns the bending moments due to force and moment on the far node.
    fn bent_by(&self, far: &Vector2<f64>) -> Vector2<f64> {
        Vector2::new(-self.length * far.x - far.y, far.y)
    }
}

/// Contribution of one element to the sweeps.
#[derive(Clone, Copy, Debug)]
struct Gain {
    /// (B + G' P G)^-1.
    yielding: Matrix2<f64>,
    /// Change of `a` by change of the near node, negated.
    follow: Matrix2<f64>,
    /// Force and moment on the near node by change of `a`.
    feed: Matrix2<f64>,
}

/// Factored equations of one state, for any residual and any motion of the base.
#[derive(Clone, Debug, Default)]
pub(super) struct Sweep {
    gains: Vec<Gain>,
    /// Stiffness at the base.
    base: Matrix2<f64>,
    steps: Vec<Vector2<f64>>,
}

/// Change of the base, and of the angles of each element.
#[derive(Clone, Debug, Default)]
pub(super) struct Change {
    pub base: Vector2<f64>,
    pub angles: Vec<Vector2<f64>>,
    /// Largest change of a deflection, mm.
    pub largest: f64,
}

/// Increment of the base motion.
#[derive(Clone, Copy, Debug)]
pub(super) struct Push {
    /// Displacement and slope; of a free base, displacement of its axis and 0.
    pub by: Vector2<f64>,
    /// Distance from a base that turns freely back to its axis, mm; `None` if the slope is prescribed.
    pub arm: Option<f64>,
}

impl Sweep {
    /// Factors the stiffness of all elements. Returns `None` if they have no stable equilibrium.
    pub(super) fn factor(&mut self, elements: &[Element], loads: &[Load]) -> Option<()> {
        self.gains.clear();
        // `beyond` is P, the change of force and moment on a node by its own, due to everything beyond it: none at the
        // tip. Eliminating `a` from the balance of each element makes that of its near node.
        let mut beyond = Matrix2::zeros();
        for (element, load) in elements.iter().zip(loads).rev() {
            let [[near, mixed], [back, far]] = load.stiffness;
            let (carry, swing) = (element.carry(), element.swing());
            let whole = beyond + far;
            let inner = element.bend() + swing.transpose() * whole * swing;
            let yielding = inner
                .try_inverse()
                .filter(|inverse| inverse.iter().all(|x| x.is_finite()))?;
            let reach = whole * carry + back;
            let follow = yielding * swing.transpose() * reach;
            let feed = mixed * swing + carry.transpose() * whole * swing;
            beyond = near + mixed * carry + carry.transpose() * reach - feed * follow;
            self.gains.push(Gain { yielding, follow, feed });
        }
        self.gains.reverse();
        self.base = beyond;
        beyond.iter().all(|x| x.is_finite()).then_some(())
    }

    /// Returns the change that balances the state with these angles and loads, with the factored stiffness, or `None`
    /// if the slope of the base is undetermined.
    pub(super) fn solve(
        &mut self,
        elements: &[Element],
        loads: &[Load],
        angles: &[Vector2<f64>],
        push: &Push,
        change: &mut Change,
    ) -> Option<()> {
        // From the tip: forces beyond each node, as if it stayed, and the bending that balances them.
        let mut beyond = Vector2::zeros();
        self.steps.clear();
        let all = elements.iter().zip(loads).zip(angles).zip(&self.gains).rev();
        for (((element, load), angles), gain) in all {
            let far = beyond + load.force[1];
            let step = gain.yielding * (element.moments(angles) + element.bent_by(&far));
            self.steps.push(step);
            beyond = load.force[0] + element.back(&far) - gain.feed * step;
        }
        let mut node = push.by;
        if let Some(arm) = push.arm {
            // No moment about the axis, M + arm V = 0, with u = axis + arm u' at the base.
            let k = &self.base;
            let turning = k[(1, 1)] + arm * (k[(0, 1)] + k[(1, 0)] + arm * k[(0, 0)]);
            node.y = -(beyond.y + arm * beyond.x + (k[(1, 0)] + arm * k[(0, 0)]) * node.x) / turning;
            node.x += arm * node.y;
        }
        if !(node.x.is_finite() && node.y.is_finite()) {
            return None;
        }
        // From the base, whose change is now known: each node moves the next.
        change.base = node;
        change.angles.clear();
        change.largest = node.x.abs();
        for ((element, gain), step) in elements.iter().zip(&self.gains).zip(self.steps.iter().rev()) {
            let angles = -step - gain.follow * node;
            node = element.far(&node, &angles);
            change.angles.push(angles);
            change.largest = change.largest.max(node.x.abs());
        }
        change.largest.is_finite().then_some(())
    }
}

/// Returns the largest residual moment, the largest moment (N mm), and force and moment of the tissue on the base.
pub(super) fn balance(elements: &[Element], loads: &[Load], angles: &[Vector2<f64>]) -> (f64, f64, Vector2<f64>) {
    let (mut out, mut scale, mut beyond) = (0.0f64, 0.0f64, Vector2::zeros());
    for ((element, load), angles) in elements.iter().zip(loads).zip(angles).rev() {
        let far = beyond + load.force[1];
        let (bent, by) = (element.moments(angles), element.bent_by(&far));
        out = out.max((bent + by).amax());
        scale = scale.max(bent.amax()).max(by.amax());
        beyond = load.force[0] + element.back(&far);
    }
    (out, scale, beyond)
}
