//! Newton's method on the beam, with a line search and load steps.

use nalgebra::Vector2;

use super::foundation::{self, Load};
use super::problem::{Base, Bed, Division, Problem};
use super::shape::Shape;
use super::spec::BaseSpec;
use super::sweep::{self, Change, Element, Push, Sweep};
use super::{BeamError, TOLERANCE};
use insonify_base::range::{OutOfRange, Ranges};

/// Size of corrections relative to the deflections below which the beam counts as solved too: rounding allows no better
/// balance.
const ROUNDING: f64 = 1e-13;
/// Maximum number of Newton steps of one load step.
const STEPS: usize = 40;
/// Smallest share of a Newton step, and of the base motion, that is tried.
const SHORTEST: f64 = 1e-3;

/// Crushed tissue that ended a trial.
#[derive(Clone, Copy, Debug)]
struct Crush {
    element: usize,
}

/// Base and angles of a beam, and derived values.
#[derive(Clone, Debug, Default)]
struct State {
    /// Displacement of the base, or of the axis about which it turns freely, mm.
    driven: f64,
    angles: Vec<Vector2<f64>>,
    nodes: Vec<Vector2<f64>>,
    loads: Vec<Load>,
}

/// A needle in tissue, divided into elements and ready to be moved. Solutions depend only on the given motion; buffers
/// are kept.
#[derive(Clone, Debug)]
pub struct FoundationBeam {
    problem: Problem,
    division: Division,
    elements: Vec<Element>,
    beds: Vec<Bed>,
    supported: bool,
    state: State,
    trial: State,
    reached: State,
    sweep: Sweep,
    change: Change,
    next: Change,
}

impl FoundationBeam {
    /// Checks a problem and divides it into elements.
    ///
    /// # Errors
    /// [`OutOfRange`] with the key of the number that is out of range.
    pub fn new(problem: &Problem) -> Result<Self, OutOfRange> {
        problem.layers.iter().try_for_each(|layer| layer.check())?;
        problem.check()?;
        let division = Division::new(problem);
        let elements = (0..division.layers.len()).map(|index| Element {
            length: division.length_mm(index),
            bending: problem.bending_nmm2,
        });
        let beds: Vec<Bed> = problem.layers.iter().map(Bed::new).collect();
        let stiff = |layer: &Option<usize>| layer.is_some_and(|layer| beds[layer].law.at(1.0).tangent_kpa > 0.0);
        Ok(Self {
            supported: division.layers.iter().any(stiff),
            elements: elements.collect(),
            beds,
            problem: problem.clone(),
            division,
            state: State::default(),
            trial: State::default(),
            reached: State::default(),
            sweep: Sweep::default(),
            change: Change::default(),
            next: Change::default(),
        })
    }

    /// Returns the problem.
    pub fn problem(&self) -> &Problem {
        &self.problem
    }

    /// Returns the shape of the needle after a motion of its base.
    ///
    /// # Errors
    /// [`BeamError`].
    pub fn solve(&mut self, base: &Base) -> Result<Shape, BeamError> {
        BaseSpec::check_number("displacement_mm", base.displacement_mm)?;
        BaseSpec::check_number("slope", base.slope.unwrap_or(0.0))?;
        if base.slope.is_none() && !self.supported {
            return Err(BeamError::Unheld);
        }
        self.rest();
        // The whole motion at once; load steps only where Newton's method does not follow, as near crushed tissue.
        let (mut share, mut step, mut iterations) = (0.0, 1.0, 0);
        while share < 1.0 {
            let goal = if share + step >= 1.0 { 1.0 } else { share + step };
            self.reached.clone_from(&self.state);
            match self.reach(base, goal, &mut iterations) {
                Ok(()) => {
                    share = goal;
                    step *= 2.0;
                }
                Err(crush) => {
                    // By four, since success doubles: the next two steps then end short of the motion that failed.
                    step /= 4.0;
                    if step < SHORTEST {
                        return Err(self.failed(crush, share, iterations));
                    }
                    self.state.clone_from(&self.reached);
                }
            }
        }
        Ok(self.shape(base, iterations))
    }

    fn rest(&mut self) {
        let count = self.elements.len();
        self.state.driven = 0.0;
        self.state.angles.clear();
        self.state.angles.resize(count, Vector2::zeros());
        self.state.nodes.clear();
        self.state.nodes.push(Vector2::zeros());
        // Tissue at rest is not crushed, and has no force.
        let _ = follow(&self.division, &self.elements, &self.beds, &mut self.state);
    }

    /// Makes Newton steps to a share of the base's motion.
    fn reach(&mut self, base: &Base, share: f64, iterations: &mut usize) -> Result<(), Option<Crush>> {
        let arm = self.arm(base);
        let goal = Vector2::new(base.displacement_mm, base.slope.unwrap_or(0.0)) * share;
        for _ in 0..STEPS {
            let mut by = goal - Vector2::new(self.state.driven, self.state.nodes[0].y);
            // The slope of a base that turns freely is an unknown, not a goal.
            if arm.is_some() {
                by.y = 0.0;
            }
            let arrived = by == Vector2::zeros();
            if arrived && *iterations > 0 && self.residual(arm) <= TOLERANCE {
                return Ok(());
            }
            *iterations += 1;
            let State { loads, angles, .. } = &self.state;
            let push = Push { by, arm };
            // The base moves within the same Newton step: elements bend with it from the first step on.
            let solved = self.sweep.factor(&self.elements, loads).and_then(|()| {
                let (sweep, change) = (&mut self.sweep, &mut self.change);
                sweep.solve(&self.elements, loads, angles, &push, change)
            });
            solved.ok_or(None)?;
            let extent = self
                .state
                .nodes
                .iter()
                .fold(0.0, |most: f64, node| most.max(node.x.abs()));
            if arrived && self.change.largest <= ROUNDING * extent {
                return Ok(());
            }
            self.search(&push, &goal)?;
        }
        Err(None)
    }

    /// Moves along a Newton step as far as it improves the solution: the next step with the same stiffness must be
    /// shorter (the natural monotonicity test; P. Deuflhard, "Newton Methods for Nonlinear Problems", section 3.3). The
    /// remaining motion of the base counts as part of that step.
    fn search(&mut self, push: &Push, goal: &Vector2<f64>) -> Result<(), Option<Crush>> {
        let (mut part, mut crush) = (1.0, None);
        while part >= SHORTEST {
            self.trial.clone_from(&self.state);
            let (state, change) = (&mut self.trial, &self.change);
            state.nodes[0].y += change.base.y * part;
            state.driven += push.by.x * part;
            // A whole step ends at the goal to the last bit: `reach` compares with it exactly.
            if part == 1.0 {
                state.driven = goal.x;
                state.nodes[0].y = if push.arm.is_some() { state.nodes[0].y } else { goal.y };
            }
            state.nodes[0].x = state.driven + push.arm.unwrap_or(0.0) * state.nodes[0].y;
            let changes = state.angles.iter_mut().zip(&change.angles);
            changes.for_each(|(angles, by)| *angles += by * part);
            match follow(&self.division, &self.elements, &self.beds, state) {
                Err(crushed) => crush = Some(crushed),
                Ok(()) => {
                    crush = None;
                    let push = Push {
                        by: push.by * (1.0 - part),
                        arm: push.arm,
                    };
                    let State { loads, angles, .. } = &self.trial;
                    let next = &mut self.next;
                    let solved = self.sweep.solve(&self.elements, loads, angles, &push, next);
                    if solved.is_some() && next.largest <= (1.0 - part / 4.0) * self.change.largest {
                        std::mem::swap(&mut self.state, &mut self.trial);
                        return Ok(());
                    }
                }
            }
            part /= 2.0;
        }
        Err(crush)
    }

    /// Returns the distance of the axis of a base that turns freely.
    fn arm(&self, base: &Base) -> Option<f64> {
        base.slope.is_none().then_some(self.problem.pivot_mm)
    }

    /// Returns the largest residual moment, as a share of the largest moment.
    fn residual(&self, arm: Option<f64>) -> f64 {
        let (mut out, scale, base) = sweep::balance(&self.elements, &self.state.loads, &self.state.angles);
        if let Some(arm) = arm {
            out = out.max((base.y + arm * base.x).abs());
        }
        if out == 0.0 { 0.0 } else { out / scale }
    }

    fn failed(&self, crush: Option<Crush>, share: f64, iterations: usize) -> BeamError {
        let share_percent = 100.0 * share;
        let layer = crush.and_then(|crush| Some((crush.element, self.division.layers[crush.element]?)));
        match layer {
            Some((element, layer)) => BeamError::Crushed {
                depth_mm: self.division.nodes[element],
                deflection_mm: self.trial.nodes[element].x,
                initial_length_mm: self.beds[layer].initial_length_mm,
                share_percent,
            },
            None => BeamError::NotConverged {
                share_percent,
                residual: self.residual(None),
                iterations,
            },
        }
    }

    fn shape(&self, base: &Base, iterations: usize) -> Shape {
        let loads = (&self.state.loads, &self.state.angles);
        let (_, _, hold) = sweep::balance(&self.elements, loads.0, loads.1);
        let energy = self.elements.iter().zip(&self.state.angles);
        let energy = energy.map(|(element, angles)| 0.5 * angles.dot(&element.moments(angles)));
        let forces = self.state.loads.iter().map(|load| load.force[0].x + load.force[1].x);
        Shape::new(
            &self.division,
            &self.beds,
            &self.state.nodes,
            &forces.collect::<Vec<_>>(),
            [hold.x, hold.y, energy.sum()],
            (self.residual(self.arm(base)), iterations),
        )
    }
}

/// Computes nodes and loads from the base and the angles of a state.
fn follow(division: &Division, elements: &[Element], beds: &[Bed], state: &mut State) -> Result<(), Crush> {
    let mut near = state.nodes[0];
    state.nodes.truncate(1);
    state.loads.clear();
    for (index, (element, angles)) in elements.iter().zip(&state.angles).enumerate() {
        let far = element.far(&near, angles);
        state.nodes.push(far);
        let load = match division.layers[index] {
            None => Load::ZERO,
            Some(layer) => {
                foundation::load(&beds[layer], element.length, [near, far]).ok_or(Crush { element: index })?
            }
        };
        state.loads.push(load);
        near = far;
    }
    Ok(())
}
