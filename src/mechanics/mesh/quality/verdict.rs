//! Verdict on a mesh that is unusable for computation.

use std::fmt;

use super::{CONDITION_LIMIT, Quality};

/// Elements that make a mesh unusable for computation.
#[derive(Clone, Debug, PartialEq)]
pub struct UnusableMesh {
    /// Elements of negative volume.
    pub inverted: Vec<u32>,
    /// Elements whose volume is within rounding of 0.
    pub flat: Vec<u32>,
    /// Elements with a corner that is NaN or infinite.
    pub not_finite: Vec<u32>,
    /// Elements whose condition exceeds [`CONDITION_LIMIT`].
    pub slivers: Vec<u32>,
    /// Elements with the corners of an earlier one.
    pub duplicates: Vec<u32>,
}

impl UnusableMesh {
    pub(super) fn of(quality: &Quality) -> Option<UnusableMesh> {
        let unusable = UnusableMesh {
            inverted: quality.inverted.clone(),
            flat: quality.flat.clone(),
            not_finite: quality.not_finite.clone(),
            slivers: quality.slivers.clone(),
            duplicates: quality.duplicates.iter().map(|[_, element]| *element).collect(),
        };
        let faults = unusable.faults();
        faults
            .iter()
            .any(|(elements, _)| !elements.is_empty())
            .then_some(unusable)
    }

    fn faults(&self) -> [(&[u32], &'static str); 5] {
        [
            (&self.inverted, "inverted"),
            (&self.flat, "flat"),
            (&self.not_finite, "not finite at a corner"),
            (&self.slivers, "too thin"),
            (&self.duplicates, "there a second time"),
        ]
    }
}

impl fmt::Display for UnusableMesh {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        const NAMED: usize = 10;
        write!(f, "the mesh cannot be calculated on:")?;
        let faults = self.faults().into_iter().filter(|(elements, _)| !elements.is_empty());
        for (place, (elements, what)) in faults.enumerate() {
            let named: Vec<String> = elements.iter().take(NAMED).map(u32::to_string).collect();
            let (noun, verb) = if elements.len() == 1 {
                ("tetrahedron", "is")
            } else {
                ("tetrahedra", "are")
            };
            write!(f, "{} {noun} {}", if place == 0 { "" } else { ";" }, named.join(", "))?;
            if elements.len() > NAMED {
                write!(f, " and {} more", elements.len() - NAMED)?;
            }
            write!(f, " {verb} {what}")?;
        }
        if !self.slivers.is_empty() {
            write!(f, " (a Jacobian condition beyond {CONDITION_LIMIT:.1e})")?;
        }
        write!(f, "; tetrahedra are numbered from 0")
    }
}
