//! Anderson acceleration of iterations with a reused factor (D. G. Anderson, Journal of the ACM 12, 1965): the changes
//! proposed in the last iterations, and their effects, correct the next proposal.

/// Steps taken, and the changes of the proposal along them ("turns"), newest last.
#[derive(Clone, Debug, Default)]
pub(super) struct Anderson {
    steps: Vec<Vec<f64>>,
    turns: Vec<Vec<f64>>,
    used: usize,
    last: Option<Last>,
    /// Orthonormal directions that span the turns; `moves` are the corresponding steps, `unexplained` the part of
    /// the change that they leave.
    directions: Vec<Vec<f64>>,
    moves: Vec<Vec<f64>>,
    unexplained: Vec<f64>,
}

#[derive(Clone, Debug)]
struct Last {
    proposal: Vec<f64>,
    step: Vec<f64>,
}

/// Smallest part of a turn, relative to its length, that counts as independent of the others.
const NEW: f64 = 1e-8;

impl Anderson {
    /// Clears the history, for another problem or factor.
    pub(super) fn clear(&mut self) {
        self.used = 0;
        self.last = None;
    }

    /// Replaces a proposed change by the accelerated one, from at most `memory` earlier steps.
    pub(crate) fn accelerate(&mut self, memory: usize, change: &mut [f64]) {
        if memory == 0 {
            return;
        }
        if let Some(last) = self.last.take() {
            // The oldest step gives its memory to the newest: iterations do not allocate.
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

    /// Subtracts from the change the combination of turns nearest to it, and the corresponding steps.
    fn combine(&mut self, change: &mut [f64]) {
        // Newest first: of dependent turns the newest are used. Each operation on a turn is also applied to its step.
        self.unexplained.clear();
        self.unexplained.extend_from_slice(change);
        let mut spanned = 0;
        for index in (0..self.used).rev() {
            let (before, unused) = self.directions.split_at_mut(spanned);
            let (moves, step) = self.moves.split_at_mut(spanned);
            let (direction, step) = (&mut unused[0], &mut step[0]);
            direction.clone_from(&self.turns[index]);
            step.clone_from(&self.steps[index]);
            let whole = dot(direction, direction);
            for (direction_before, move_before) in before.iter().zip(moves) {
                let share = dot(direction, direction_before);
                subtract(direction, share, direction_before);
                subtract(step, share, move_before);
            }
            let left = dot(direction, direction);
            if left > NEW * NEW * whole {
                let scale = 1.0 / left.sqrt();
                direction.iter_mut().for_each(|x| *x *= scale);
                step.iter_mut().for_each(|x| *x *= scale);
                let share = dot(&self.unexplained, direction);
                subtract(&mut self.unexplained, share, direction);
                subtract(change, share, direction);
                subtract(change, share, step);
                spanned += 1;
            }
        }
    }
}

/// Scalar product of vectors of degrees of freedom.
pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn subtract(from: &mut [f64], share: f64, what: &[f64]) {
    from.iter_mut().zip(what).for_each(|(x, y)| *x -= share * y);
}
