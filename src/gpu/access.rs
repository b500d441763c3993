//! Access of a pass to a buffer.

/// Access to a storage buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Access {
    /// Read only: `var<storage, read>`.
    Read,
    /// Written, and possibly read: `var<storage, read_write>`.
    Write,
}
