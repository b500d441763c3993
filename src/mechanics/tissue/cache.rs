//! The dense inverse on disk, under a hash of everything it follows from.
//!
//! A file is a header of 64 bytes (magic, version, byte order, precision, panel rows, size, key), the panels of the matrix as
//! they lie in memory, and a BLAKE3 hash of all of it. It is read back only if every part is as expected; otherwise the
//! reason is returned and the caller builds the inverse again. It is written to a temporary file beside its place, which
//! takes the name when it is whole.

use std::fs::{self, File};
use std::io::{self, BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};

use blake3::Hasher;

use super::dofs::Dofs;
use super::factor::Factor;
use super::inverse::{InverseError, check_memory, invert};
use super::material::Material;
use super::symmetric::{PANEL_ROWS, Scalar, Symmetric};
use crate::mechanics::mesh::TetMesh;
use crate::output::atomic;

const MAGIC: [u8; 8] = *b"insonKi\n";
/// Raised when the layout changes, or when the same input makes another matrix.
const VERSION: u32 = 1;
/// Reads otherwise on a machine of the other byte order.
const BYTE_ORDER: u32 = 0x0102_0304;
const HEADER: usize = 64;
const HASH: usize = blake3::OUT_LEN;
/// Bytes written, read and hashed at a time.
const BUFFER: usize = 1 << 20;

/// What an inverse follows from, as a BLAKE3 hash: nodes, elements and regions of the mesh, the material of each element,
/// the prescribed degrees of freedom, and the precision.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CacheKey([u8; HASH]);

/// Why an inverse cannot be taken from a file. All but [`Memory`](Self::Memory) ask for it to be built again.
#[derive(Debug, thiserror::Error)]
pub enum CacheMiss {
    /// There is no file.
    #[error("there is none yet")]
    Absent,
    /// The file cannot be read.
    #[error("it cannot be read: {0}")]
    Unreadable(#[source] io::Error),
    /// Another kind of file.
    #[error("it is not a cached inverse")]
    Foreign,
    /// Written by another version of this program, or on a machine of the other byte order.
    #[error("it has version {found}, and {VERSION} is expected in this machine's byte order")]
    Version {
        /// As in the file.
        found: u32,
    },
    /// Of another mesh, other materials, other fixed degrees of freedom or another precision.
    #[error("it belongs to another mesh, other materials or supports, or another precision")]
    Stale,
    /// Cut short, or too long.
    #[error("it has {found} bytes where {expected} are expected: it was cut short or appended to")]
    Length {
        /// Bytes of the file.
        found: u64,
        /// Bytes it must have.
        expected: u64,
    },
    /// Its contents do not match their hash.
    #[error("its contents are damaged: they do not match their hash")]
    Corrupt,
    /// It is larger than the memory of the machine.
    #[error(transparent)]
    Memory(#[from] InverseError),
}

/// An inverse that could not be stored; it can be used all the same.
#[derive(Debug, thiserror::Error)]
#[error("{}: the inverse cannot be stored: {cause}", path.display())]
pub struct StoreError {
    /// The file that was asked for.
    pub path: PathBuf,
    /// What the system said.
    #[source]
    pub cause: io::Error,
}

/// An inverse from a cache or built anew.
#[derive(Debug)]
pub struct Cached<T> {
    /// The inverse.
    pub inverse: Symmetric<T>,
    /// Why it was built, where the cache did not hold it.
    pub miss: Option<CacheMiss>,
    /// Why it could not be stored for the next time.
    pub store_error: Option<StoreError>,
}

impl CacheKey {
    /// The key of the inverse in precision `T` over the free degrees of freedom of a mesh with one material an element.
    pub fn of<T: Scalar>(mesh: &TetMesh, materials: &[Material], dofs: &Dofs) -> Self {
        let mut hasher = Hasher::new();
        let mut list = |bytes: &[u8]| {
            // The lengths keep the end of a list and the start of the next apart.
            hasher.update(&(bytes.len() as u64).to_le_bytes());
            hasher.update(bytes);
        };
        let materials: Vec<[f64; 2]> = materials.iter().map(|m| [m.young_kpa(), m.poisson()]).collect();
        let fixed: Vec<u32> = dofs
            .prescribed()
            .flat_map(|(node, axis)| [node, u32::from(axis)])
            .collect();
        list(&VERSION.to_le_bytes());
        list(&(size_of::<T>() as u64).to_le_bytes());
        list(bytemuck::cast_slice(mesh.nodes()));
        list(bytemuck::cast_slice(mesh.elements()));
        list(bytemuck::cast_slice(mesh.regions()));
        list(bytemuck::cast_slice(&materials));
        list(bytemuck::cast_slice(&fixed));
        Self(*hasher.finalize().as_bytes())
    }

    /// A name for its file, in hexadecimal digits.
    pub fn file_name(&self) -> String {
        format!("{}.inverse", blake3::Hash::from_bytes(self.0).to_hex())
    }

    fn header<T: Scalar>(&self, size: usize) -> [u8; HEADER] {
        let mut header = [0; HEADER];
        header[..8].copy_from_slice(&MAGIC);
        let words = [VERSION, BYTE_ORDER, size_of::<T>() as u32, PANEL_ROWS as u32];
        header[8..24].copy_from_slice(bytemuck::cast_slice(&words));
        header[24..32].copy_from_slice(&(size as u64).to_ne_bytes());
        header[32..].copy_from_slice(&self.0);
        header
    }
}

/// Takes the inverse of `size` degrees of freedom from a file.
///
/// # Errors
/// [`CacheMiss`] when it is not there, not whole or not the one asked for.
pub fn load<T: Scalar>(path: &Path, key: &CacheKey, size: usize) -> Result<Symmetric<T>, CacheMiss> {
    let file = match crate::read::open(path) {
        Err(cause) if cause.kind() == io::ErrorKind::NotFound => return Err(CacheMiss::Absent),
        other => other.map_err(CacheMiss::Unreadable)?,
    };
    let found = file.metadata().map_err(CacheMiss::Unreadable)?.len();
    let mut hashed = BufReader::with_capacity(BUFFER, HashedReader::new(&file, found));
    let mut header = [0; HEADER];
    match hashed.read_exact(&mut header) {
        Err(cause) if cause.kind() == io::ErrorKind::UnexpectedEof => return Err(CacheMiss::Foreign),
        other => other.map_err(CacheMiss::Unreadable)?,
    }
    check_header(&header, &key.header::<T>(size))?;
    let payload = Symmetric::<T>::bytes_of(size);
    let expected = (HEADER + HASH) as u64 + payload as u64;
    if found != expected {
        return Err(CacheMiss::Length { found, expected });
    }
    check_memory::<T>(size)?;
    let mut inverse = Symmetric::<T>::zeros(size);
    inverse
        .for_each_column_mut(|column| hashed.read_exact(bytemuck::cast_slice_mut(column)))
        .map_err(CacheMiss::Unreadable)?;
    let hash = hashed.into_inner().hasher.finalize();
    let mut stored = [0; HASH];
    (&file).read_exact(&mut stored).map_err(CacheMiss::Unreadable)?;
    if hash != stored {
        return Err(CacheMiss::Corrupt);
    }
    Ok(inverse)
}

fn check_header(found: &[u8; HEADER], expected: &[u8; HEADER]) -> Result<(), CacheMiss> {
    if found[..8] != expected[..8] {
        return Err(CacheMiss::Foreign);
    }
    if found[8..16] != expected[8..16] {
        let version = [found[8], found[9], found[10], found[11]];
        return Err(CacheMiss::Version {
            found: u32::from_ne_bytes(version),
        });
    }
    if found[16..] != expected[16..] {
        return Err(CacheMiss::Stale);
    }
    Ok(())
}

/// Puts an inverse into a file, whole or not at all. The folder is made where it is missing.
///
/// # Errors
/// [`StoreError`] when the folder, the file or the disk refuses; an older file of that name then stays as it was.
pub fn store<T: Scalar>(path: &Path, key: &CacheKey, inverse: &Symmetric<T>) -> Result<(), StoreError> {
    write(path, key, inverse).map_err(|cause| StoreError {
        path: path.to_owned(),
        cause,
    })
}

fn write<T: Scalar>(path: &Path, key: &CacheKey, inverse: &Symmetric<T>) -> io::Result<()> {
    path.parent().map_or(Ok(()), fs::create_dir_all)?;
    let written = atomic::write(path, |file| {
        let hasher = Hasher::new();
        let mut hashed = BufWriter::with_capacity(BUFFER, HashedWriter { file, hasher });
        hashed.write_all(&key.header::<T>(inverse.size()))?;
        for column in inverse.row_panels().flat_map(|panel| panel.columns) {
            hashed.write_all(bytemuck::cast_slice(&column.0))?;
        }
        let HashedWriter { file, hasher } = hashed.into_inner().map_err(io::IntoInnerError::into_error)?;
        file.write_all(hasher.finalize().as_bytes())
    });
    written.map_err(|error| error.cause)
}

/// Takes the inverse from a file, or builds it and stores it there. `progress` as for [`invert`].
///
/// # Errors
/// [`InverseError`] when it can neither be taken nor built.
pub fn load_or_invert<T: Scalar>(
    path: &Path,
    key: &CacheKey,
    factor: &Factor,
    progress: impl FnMut(usize, usize) + Send,
) -> Result<Cached<T>, InverseError> {
    let miss = match load(path, key, factor.size()) {
        Ok(inverse) => {
            return Ok(Cached {
                inverse,
                miss: None,
                store_error: None,
            });
        }
        Err(CacheMiss::Memory(cause)) => return Err(cause),
        Err(miss) => miss,
    };
    let inverse = invert(factor, progress)?;
    let store_error = store(path, key, &inverse).err();
    Ok(Cached {
        inverse,
        miss: Some(miss),
        store_error,
    })
}

/// Reads all but the hash at the end, and hashes what it reads.
struct HashedReader<'a> {
    file: io::Take<&'a File>,
    hasher: Hasher,
}

impl<'a> HashedReader<'a> {
    fn new(file: &'a File, bytes: u64) -> Self {
        Self {
            file: file.take(bytes.saturating_sub(HASH as u64)),
            hasher: Hasher::new(),
        }
    }
}

impl Read for HashedReader<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.file.read(buffer)?;
        self.hasher.update(&buffer[..count]);
        Ok(count)
    }
}

/// Hashes what it writes.
struct HashedWriter<W> {
    file: W,
    hasher: Hasher,
}

impl<W: Write> Write for HashedWriter<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let count = self.file.write(bytes)?;
        self.hasher.update(&bytes[..count]);
        Ok(count)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

#[cfg(test)]
mod tests;
