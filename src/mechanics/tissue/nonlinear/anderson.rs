//! Acceleration of iterations whose factor is kept (D. G. Anderson, Journal of the ACM 12, 1965): the changes that the last
//! iterations proposed, and what came of them, tell how the next should differ from what it proposes.

/// Steps taken and how much the proposals changed along them, newest last.
#[derive(Clone, Debug, Default)]
pub(super) struct Anderson {
    steps: Vec<Vec<f64>>,
    turns: Vec<Vec<f64>>,
    used: usize,
    last: Option<Last>,
    /// Orthonormal directions that span the turns, the steps that go with them, and what of the change they do not explain.
    directions: Vec<Vec<f64>>,
    moves: Vec<Vec<f64>>,
    rest: Vec<f64>,
}

#[derive(Clone, Debug)]
struct Last {
    proposal: Vec<f64>,
    step: Vec<f64>,
}

/// Part of a turn that the others do not explain, relative to it, below which it tells nothing new.
const NEW: f64 = 1e-8;

impl Anderson {
    /// Forgets what was: another problem or another factor.
    pub fn clear(&mut self) {
        self.used = 0;
        self.last = None;
    }

    /// Turns a proposed change into the one to make, from `memory` steps before at most.
    pub fn improve(&mut self, memory: usize, change: &mut [f64]) {
        if memory == 0 {
            return;
        }
        if let Some(last) = self.last.take() {
            if self.used == memory {
                self.steps.rotate_left(1);
                self.turns.rotate_left(1);
                self.used -= 1;
            }
            while self.steps.len() <= self.used {
                self.steps.push(Vec::new());
                self.turns.push(Vec::new());
                self.directions.push(Vec::new());
                self.moves.push(Vec::new());
            }
            self.steps[self.used].clone_from(&last.step);
            let turn = change.iter().zip(&last.proposal).map(|(now, before)| now - before);
            self.turns[self.used].clear();
            self.turns[self.used].extend(turn);
            self.used += 1;
            self.last = Some(last);
        }
        let last = self.last.get_or_insert_with(|| Last {
            proposal: Vec::new(),
            step: Vec::new(),
        });
        last.proposal.clear();
        last.proposal.extend_from_slice(change);
        self.combine(change);
        if let Some(last) = &mut self.last {
            last.step.clear();
            last.step.extend_from_slice(change);
        }
    }

    /// Takes from the change the combination of turns nearest to it, and of the steps that go with them.
    fn combine(&mut self, change: &mut [f64]) {
        // Newest first: where turns depend on each other the newest count. What is done to a turn is done to its step.
        self.rest.clear();
        self.rest.extend_from_slice(change);
        let mut spanned = 0;
        for at in (0..self.used).rev() {
            let (before, own) = self.directions.split_at_mut(spanned);
            let (moves, step) = self.moves.split_at_mut(spanned);
            let (direction, step) = (&mut own[0], &mut step[0]);
            direction.clone_from(&self.turns[at]);
            step.clone_from(&self.steps[at]);
            let whole = dot(direction, direction);
            for (other, by) in before.iter().zip(moves) {
                let share = dot(direction, other);
                subtract(direction, share, other);
                subtract(step, share, by);
            }
            let left = dot(direction, direction);
            if left > NEW * NEW * whole {
                let scale = 1.0 / left.sqrt();
                direction.iter_mut().for_each(|x| *x *= scale);
                step.iter_mut().for_each(|x| *x *= scale);
                let share = dot(&self.rest, direction);
                subtract(&mut self.rest, share, direction);
                subtract(change, share, direction);
                subtract(change, share, step);
                spanned += 1;
            }
        }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn subtract(from: &mut [f64], share: f64, what: &[f64]) {
    from.iter_mut().zip(what).for_each(|(x, y)| *x -= share * y);
}
