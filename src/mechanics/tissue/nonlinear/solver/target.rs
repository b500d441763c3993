//! Target of an increment.

use super::super::{NO_DOF, NonlinearError, Supports};

/// Target of an increment: all values at its end.
#[derive(Clone, Copy, Debug)]
pub struct Target<'a> {
    /// Force on each degree of freedom, N; at a prescribed one it changes only the reaction.
    pub loads: &'a [f64],
    /// Displacement of each prescribed degree of freedom, in the order of [`Supports::prescribed`], mm.
    pub prescribed: &'a [f64],
    /// Point with a prescribed displacement along a direction.
    pub contact: Option<&'a Contact>,
    /// Displacements (mm) without stress, which is E(e_r(u)) D epsilon(u - offset).
    pub offset: Option<&'a [f64]>,
}

/// Point of the body that is pushed to a place: sum of weights times displacements.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Contact {
    /// Degrees of freedom and their weights: barycentric weights of the point times the direction.
    pub weights: Vec<(u32, f64)>,
    /// Displacement of the point along the direction, mm.
    pub place_mm: f64,
}

impl Contact {
    /// Returns the displacement along the direction, mm.
    pub fn along(&self, displacement: &[f64]) -> f64 {
        self.weights
            .iter()
            .map(|&(dof, weight)| weight * displacement[dof as usize])
            .sum()
    }

    /// Adds a force along the direction to the forces on all degrees of freedom, N.
    pub fn add(&self, force: f64, forces: &mut [f64]) {
        self.weights
            .iter()
            .for_each(|&(dof, weight)| forces[dof as usize] += force * weight);
    }

    pub(super) fn add_free<const D: usize>(&self, force: f64, supports: &Supports<D>, free: &mut [f64]) {
        for &(dof, weight) in &self.weights {
            let number = supports.number(dof as usize);
            if number != NO_DOF {
                free[number as usize] += force * weight;
            }
        }
    }

    pub(super) fn along_free<const D: usize>(&self, supports: &Supports<D>, free: &[f64]) -> f64 {
        let share = |&(dof, weight): &(u32, f64)| match supports.number(dof as usize) {
            NO_DOF => 0.0,
            number => weight * free[number as usize],
        };
        self.weights.iter().map(share).sum()
    }
}

impl Target<'_> {
    pub(in super::super) fn check<const D: usize>(&self, supports: &Supports<D>) -> Result<(), NonlinearError> {
        let (dof_count, prescribed) = (supports.all(), supports.prescribed().len());
        list("loads", self.loads, dof_count)?;
        list("prescribed displacements", self.prescribed, prescribed)?;
        if let Some(offset) = self.offset {
            list("offsets", offset, dof_count)?;
        }
        let Some(contact) = self.contact else { return Ok(()) };
        if let Some(&(dof, _)) = contact.weights.iter().find(|(dof, _)| *dof as usize >= dof_count) {
            return Err(NonlinearError::Length {
                what: "as a degree of freedom of the contact",
                found: dof as usize,
                expected: dof_count,
            });
        }
        let weights = contact.weights.iter().map(|(_, weight)| *weight);
        match weights
            .chain([contact.place_mm])
            .enumerate()
            .find(|(_, value)| !value.is_finite())
        {
            Some((at, found)) => Err(NonlinearError::NotFinite {
                what: "contact value",
                at,
                found,
            }),
            None => Ok(()),
        }
    }
}

pub(super) fn list(what: &'static str, values: &[f64], expected: usize) -> Result<(), NonlinearError> {
    if values.len() != expected {
        return Err(NonlinearError::Length {
            what,
            found: values.len(),
            expected,
        });
    }
    match values.iter().enumerate().find(|(_, value)| !value.is_finite()) {
        Some((at, &found)) => Err(NonlinearError::NotFinite { what, at, found }),
        None => Ok(()),
    }
}
