//! Batched look-ups at many positions in one texture: indices first, in vector registers, then the loads, so that many are
//! in flight at a time.

use super::{Atlas, Corners};
use crate::real::Real;
use crate::simd::{Kernel, vectorised};

/// Number of positions in a batch.
const BLOCK: usize = 32;

impl Atlas {
    /// Multiplies each amplitude by the multiplier of texture `entry` at its position (mm; the fourth component is
    /// ignored), whose deviation from 1 is scaled by `strength`.
    pub fn apply<T: Real>(&self, entry: usize, strength: T, positions: &[[T; 4]], amplitudes: &mut [T]) {
        for (positions, amplitudes) in positions.chunks(BLOCK).zip(amplitudes.chunks_mut(BLOCK)) {
            let mut corners = [Corners::default(); BLOCK];
            vectorised(Place {
                atlas: self,
                entry,
                positions,
                corners: &mut corners,
            });
            let placed = self.entries[entry];
            let data = &self.data[placed.offset as usize..];
            for (amplitude, at) in amplitudes.iter_mut().zip(&corners) {
                *amplitude *= T::one() + strength * (at.mix(data, placed.size) - T::one());
            }
        }
    }
}

struct Place<'a, T> {
    atlas: &'a Atlas,
    entry: usize,
    positions: &'a [[T; 4]],
    corners: &'a mut [Corners<T>; BLOCK],
}

impl<T: Real> Kernel for Place<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let entry = self.atlas.entries[self.entry];
        let rows = entry.to_voxel.map(|row| row.map(|number| T::of(f64::from(number))));
        for (position, corners) in self.positions.iter().zip(self.corners.iter_mut()) {
            for axis in 0..3 {
                let [x, y, z] = [rows[axis][0], rows[axis][1], rows[axis][2]];
                let index = x * position[0] + y * position[1] + z * position[2];
                corners.place(axis, index, entry.size[axis]);
            }
        }
    }
}
