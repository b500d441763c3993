//! Smooth noise from integer hashes: what makes organ surfaces uneven, the same on every run and thread count.

use nalgebra::Vector3;

use super::{hash3, seed_words, unit};

/// A smooth random field over the world.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Noise {
    seed: [u32; 2],
    scale_mm: f64,
}

impl Noise {
    /// A field whose features are about `scale_mm` wide. Fields of different `stream` numbers are independent.
    pub(crate) fn new(seed: u64, stream: u32, scale_mm: f64) -> Self {
        let [low, high] = seed_words(seed);
        Self {
            seed: [
                low ^ stream.wrapping_mul(0x9E37_79B9),
                high.wrapping_add(stream.wrapping_mul(0x85EB_CA6B)),
            ],
            scale_mm,
        }
    }

    /// Value in [-1, 1] at a world point: lattice values joined by a smooth step.
    pub(crate) fn at(&self, p: &Vector3<f64>) -> f64 {
        let scaled = p / self.scale_mm;
        let cell = scaled.map(f64::floor);
        let t = (scaled - cell).map(|f| f * f * (3.0 - 2.0 * f));
        let [i, j, k] = [cell.x as i32, cell.y as i32, cell.z as i32];
        let corner = |a: i32, b: i32, c: i32| f64::from(unit(hash3([i + a, j + b, k + c], self.seed)[0]));
        let along_x = |b: i32, c: i32| {
            let low = corner(0, b, c);
            low + (corner(1, b, c) - low) * t.x
        };
        let along_xy = |c: i32| {
            let low = along_x(0, c);
            low + (along_x(1, c) - low) * t.y
        };
        let low = along_xy(0);
        2.0 * (low + (along_xy(1) - low) * t.z) - 1.0
    }
}

/// A number in [0, 1) for the `item`-th choice of a stream.
pub(crate) fn choice(seed: u64, stream: u32, item: [i32; 2]) -> f64 {
    f64::from(unit(hash3([stream as i32, item[0], item[1]], seed_words(seed))[1]))
}
