//! Making remeshers.

use std::sync::Arc;

use super::adapted::AdaptedMesh;
use super::exact::Exact;
use super::levels::Levels;
use super::{Level, Options, Precision, RemeshError, Remesher};
use crate::mechanics::tissue::columns::Columns;
use crate::mechanics::tissue::compliance::Compliance;
use crate::mechanics::tissue::symmetric::{Scalar, Symmetric};

/// Where the compliance of the base comes from. A copy shares what is large.
#[derive(Clone, Debug)]
pub enum Source {
    /// A dense inverse in `f32`.
    Single(Arc<Symmetric<f32>>),
    /// A dense inverse in `f64`.
    Double(Arc<Symmetric<f64>>),
    /// Columns solved from the factor when they are needed. Keep room for those of S and of the contacts.
    Columns(Columns),
}

impl Source {
    /// Of its entries.
    pub fn precision(&self) -> Precision {
        match self {
            Source::Single(_) => Precision::Single,
            Source::Double(_) | Source::Columns(_) => Precision::Double,
        }
    }

    /// As a compliance.
    pub fn into_compliance(self) -> Box<dyn Compliance + Send> {
        match self {
            Source::Single(inverse) => Box::new(inverse),
            Source::Double(inverse) => Box::new(inverse),
            Source::Columns(columns) => Box::new(columns),
        }
    }
}

/// The entries of a dense inverse.
pub trait Entry: Scalar {
    /// As a choice.
    const PRECISION: Precision;

    /// The dense inverse of a source, if it has one in this precision.
    fn dense(source: &Source) -> Option<Arc<Symmetric<Self>>>;
}

impl Entry for f32 {
    const PRECISION: Precision = Precision::Single;

    fn dense(source: &Source) -> Option<Arc<Symmetric<f32>>> {
        match source {
            Source::Single(inverse) => Some(Arc::clone(inverse)),
            Source::Double(_) | Source::Columns(_) => None,
        }
    }
}

impl Entry for f64 {
    const PRECISION: Precision = Precision::Double;

    fn dense(source: &Source) -> Option<Arc<Symmetric<f64>>> {
        match source {
            Source::Double(inverse) => Some(Arc::clone(inverse)),
            Source::Single(_) | Source::Columns(_) => None,
        }
    }
}

/// Something that makes remeshers as [`make`] does, perhaps elsewhere than in the memory of this processor.
pub type Maker =
    Box<dyn Fn(Level, Precision, &Source, &AdaptedMesh, Options) -> Result<Box<dyn Remesher>, RemeshError> + Send>;

/// A remesher at `level` that follows `mesh` from its current state, from the compliance of its base. Levels I to IV need a
/// dense inverse, and work in the precision asked for if the source has it, or has more; the exact level takes any source
/// and reads it as it is.
///
/// # Errors
/// [`RemeshError::Unsuited`] where the source cannot give what is asked, or f32 does not suffice for the materials, or, at the
/// exact level, the source leaves a residual above a tenth of `residual_single` of `options` (its mesh is barely held, for instance); or as
/// [`Levels::new`] and [`Exact::new`].
pub fn make(
    level: Level,
    precision: Precision,
    source: &Source,
    mesh: &AdaptedMesh,
    options: Options,
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
            // It corrects the moves of nodes alone, and multiplies what the base lacks. In f64 rounding beside stiff inclusions may
            // leave more than level I keeps to, and does no harm.
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
