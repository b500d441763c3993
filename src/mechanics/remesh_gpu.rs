//! Remeshing levels I to IV with the dense inverse on a GPU; the only module that depends on both mechanics and GPUs.
//!
//! [`follow`] creates a [`Remesher`](crate::tissue::remesh::Remesher) like those of
//! [`levels`](crate::tissue::remesh::levels), with which it shares all but the
//! [`Store`](crate::tissue::remesh::levels::Store); `Adaptation::replace` switches to it during a run, and with
//! [`maker`] an insertion uses a GPU. The inverse stays on the device. After each change, dK goes up, the columns Y
//! around the moved node are taken, C = (I + dK G)^-1 dK is computed from their rows G in f64, and K^c comes back, in
//! one submission. The update of all entries is a second one, for which nobody waits: a pass over the tiles of the
//! lower triangle, which reads and writes each once. At rank 48 that is 24 multiply-adds per byte moved, about the
//! machine balance of data-centre GPUs. On a device without f64, and where the capacitance matrix is ill-conditioned, G
//! is read back and C computed on the CPU, which then accepts or refuses it.
//!
//! The base stays on the device, too, unless memory does not suffice for both: a rebuild is then one update from a
//! fresh upload. All device memory is freed with the store.
//!
//! | module | contents |
//! |---|---|
//! | [`tiles`] | passes and their parameters; lower triangle in tiles, spread over buffers within the binding limit |
//! | `strips` | columns set aside for an update, and what is computed from them |
//! | [`store`] | inverse on a device |

pub mod store;
mod strips;
pub mod tiles;

use std::sync::Arc;

use crate::tissue::dofs::NO_DOF;
use crate::tissue::remesh::levels::DenseInverseRemesher;
use crate::tissue::remesh::{AdaptedMesh, Level, Maker, Precision, RemeshError, RemesherOptions, Source, make};
use crate::tissue::symmetric::Symmetric;
use insonify_base::memory;
use insonify_gpu::{Gpu, GpuError};
pub use store::DeviceStore;

/// Remesher of the levels I to IV with a dense inverse in f32 on a GPU.
pub type DeviceLevels = DenseInverseRemesher<DeviceStore>;

/// Creates a remesher at `level`, I to IV, in f32 on `gpu` from the current state of `mesh`. `source` is the compliance
/// of its base; an inverse in f64 is rounded.
///
/// # Errors
/// [`RemeshError::Unsuited`] where the source is not dense, the inverse does not fit the device or f32 does not suffice
/// for the materials; [`RemeshError::Device`] where the device fails; otherwise those of
/// [`Levels::new`](crate::tissue::remesh::levels::Levels::new).
pub fn follow(
    gpu: &Gpu,
    mesh: &AdaptedMesh,
    source: &Source,
    level: Level,
    options: RemesherOptions,
) -> Result<DeviceLevels, RemeshError> {
    let base = single(source, level)?;
    let unsuited = |reason: String| RemeshError::Unsuited {
        level,
        precision: Precision::Single,
        reason,
    };
    if gpu.report().software {
        check_memory(base.size(), &gpu.report().name, memory::available()).map_err(unsuited)?;
    }
    let limit = gpu.limits().max_storage_buffer_binding_size;
    let store = DeviceStore::new(gpu, Arc::clone(&base), largest_support(mesh), limit);
    let store = store.map_err(|error| match error {
        GpuError::Limit { .. } | GpuError::OutOfMemory { .. } => {
            unsuited(no_room(base.size(), &gpu.report().name, &error.to_string()))
        }
        other => RemeshError::Device(other.to_string()),
    })?;
    DenseInverseRemesher::start(mesh, store, level, options)
}

/// Factory of remeshers of the levels I to IV on `gpu`, in f32. The exact level, which needs no dense inverse, runs on
/// the CPU.
pub fn maker(gpu: &Gpu) -> Maker {
    let gpu = gpu.clone();
    Box::new(
        move |level, precision, source, mesh, options| match (level, precision) {
            (Level::Exact, _) => make(level, precision, source, mesh, options),
            (_, Precision::Double) => Err(RemeshError::Unsuited {
                level,
                precision,
                reason: "a GPU keeps the inverse in f32; ask for that, or use the CPU".to_owned(),
            }),
            (_, Precision::Single) => Ok(Box::new(follow(&gpu, mesh, source, level, options)?)),
        },
    )
}

/// Refuses an inverse on a device that shares CPU memory where too little is available: it would be allocated page by
/// page, and the system would kill the program.
fn check_memory(size: usize, name: &str, available: Option<usize>) -> Result<(), String> {
    match available {
        Some(available) if tiles::bytes_of(size) > available as u64 => {
            let available_text = format!("{:.2} GiB are available", gib(available as u64));
            Err(no_room(size, name, &available_text))
        }
        _ => Ok(()),
    }
}

fn no_room(size: usize, name: &str, reason: &str) -> String {
    format!(
        "the inverse of {size} degrees of freedom takes {:.2} GiB of the memory of '{name}': {reason}; use the CPU, the exact \
         level, which needs no inverse there, or a coarser mesh",
        gib(tiles::bytes_of(size))
    )
}

fn gib(bytes: u64) -> f64 {
    bytes as f64 / (1u64 << 30) as f64
}

/// Returns the dense inverse of a source in f32.
fn single(source: &Source, level: Level) -> Result<Arc<Symmetric<f32>>, RemeshError> {
    match source {
        Source::Single(inverse) => Ok(Arc::clone(inverse)),
        Source::Double(inverse) => Ok(Arc::new(inverse.cast())),
        Source::Columns(_) => Err(RemeshError::Unsuited {
            level,
            precision: Precision::Single,
            reason: "it needs a dense inverse, and only columns on demand are at hand".to_owned(),
        }),
    }
}

/// Maximum number of degrees of freedom that one node move can affect.
fn largest_support(mesh: &AdaptedMesh) -> usize {
    let free = |node: &u32| mesh.dofs().of(*node).iter().filter(|dof| **dof != NO_DOF).count();
    let supports = (0..mesh.nodes().len() as u32).map(|node| mesh.neighbours(node).iter().map(free).sum());
    supports.max().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_inverse_beyond_the_memory_is_refused_with_what_it_needs() {
        // 235 rows of tiles, 27,730 tiles of 64 KiB.
        assert_eq!(tiles::bytes_of(30_000), 27_730 << 16);
        let refused = check_memory(30_000, "llvmpipe", Some(1 << 30)).unwrap_err();
        for word in ["30000", "1.69 GiB", "llvmpipe", "1.00 GiB", "exact"] {
            assert!(refused.contains(word), "no {word:?} in {refused:?}");
        }
        assert_eq!(check_memory(30_000, "llvmpipe", Some(2 << 30)), Ok(()));
        assert_eq!(check_memory(30_000, "llvmpipe", None), Ok(()));
    }
}
