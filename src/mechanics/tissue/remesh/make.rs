//! Construction of remeshers.

use std::sync::Arc;

use super::adapted::AdaptedMesh;
use super::exact::Exact;
use super::levels::Levels;
use super::{Level, Precision, RemeshError, Remesher, RemesherOptions};
use crate::tissue::columns::Columns;
use crate::tissue::compliance::Compliance;
use crate::tissue::symmetric::{Scalar, Symmetric};

/// Source of the base compliance. A clone shares large data.
#[derive(Clone, Debug)]
pub enum Source {
    /// Dense inverse in `f32`.
    Single(Arc<Symmetric<f32>>),
    /// Dense inverse in `f64`.
    Double(Arc<Symmetric<f64>>),
    /// Columns solved from the factor on demand. The capacity should cover those of S and of the contacts.
    Columns(Columns),
}

impl Source {
    /// Precision of the entries.
    pub fn precision(&self) -> Precision {
        match self {
            Source::Single(_) => Precision::Single,
            Source::Double(_) | Source::Columns(_) => Precision::Double,
        }
    }

    /// Converts the source to a compliance.
    fn into_compliance(self) -> Box<dyn Compliance + Send> {
        match self {
            Source::Single(inverse) => Box::new(inverse),
            Source::Double(inverse) => Box::new(inverse),
            Source::Columns(columns) => Box::new(columns),
        }
    }
}

/// Entry type of a dense inverse.
pub trait Entry: Scalar {
    /// Precision of the type.
    const PRECISION: Precision;
}

impl Entry for f32 {
    const PRECISION: Precision = Precision::Single;
}

impl Entry for f64 {
    const PRECISION: Precision = Precision::Double;
}

/// Constructor of remeshers with the interface of [`make`], possibly on a device.
pub type Maker = Box<
    dyn Fn(Level, Precision, &Source, &AdaptedMesh, RemesherOptions) -> Result<Box<dyn Remesher>, RemeshError> + Send,
>;

/// Creates a remesher at `level` from the current state of `mesh` and the compliance of its base. Levels I to IV need a
/// dense inverse, and use the requested precision if the source has it or a higher one; the exact level accepts any
/// source and reads it unchanged.
///
/// # Errors
/// [`RemeshError::Unsuited`] where the source lacks what is needed, f32 does not suffice for the materials, or, at the
/// exact level, the source leaves a residual above a tenth of `residual_single` of `options` (as when its mesh is
/// barely supported); otherwise those of [`Levels::new`] and [`Exact::new`].
pub fn make(
    level: Level,
    precision: Precision,
    source: &Source,
    mesh: &AdaptedMesh,
    options: RemesherOptions,
) -> Result<Box<dyn Remesher>, RemeshError> {
    let unsuited = |reason: &str| RemeshError::Unsuited {
        level,
        precision,
        reason: reason.to_owned(),
    };
    if precision == Precision::Double && source.precision() == Precision::Single {
        return Err(unsuited("the inverse at hand is in f32; compute one in f64"));
    }
    Ok(match (level, source, precision) {
        (Level::Exact, source, _) => {
            let compliance = source.clone().into_compliance();
            let mut exact = Exact::new(mesh, compliance, source.precision(), options)?;
            let size = mesh.dofs().free();
            let sampled: Vec<usize> = [size / 3, 2 * size / 3].into_iter().filter(|dof| *dof < size).collect();
            let (residual, limit) = (exact.residual(mesh, &sampled)?, 0.1 * options.residual_single);
            // The exact level corrects only moves of nodes, and amplifies errors of the base. In f64, rounding beside
            // stiff inclusions may leave more than the limit of level I, without harm.
            if residual > limit {
                return Err(unsuited(&format!(
                    "the inverse of the base leaves a residual |K X e - e| of {residual:.0e}, at most {limit:.0e} is expected; \
                     hold more of the mesh, or compute it in f64"
                )));
            }
            Box::new(exact)
        }
        (_, Source::Single(inverse), _) => Box::new(Levels::new(mesh, inverse.clone(), level, options)?),
        (_, Source::Double(inverse), Precision::Double) => {
            Box::new(Levels::new(mesh, inverse.clone(), level, options)?)
        }
        (_, Source::Double(inverse), Precision::Single) => {
            Box::new(Levels::<f32>::new(mesh, Arc::new(inverse.cast()), level, options)?)
        }
        (_, Source::Columns(_), _) => {
            return Err(unsuited(
                "it needs a dense inverse, and only columns on demand are at hand",
            ));
        }
    })
}

#[cfg(test)]
mod tests;
