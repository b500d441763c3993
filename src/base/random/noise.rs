//! Value noise from integer hashes: smooth, and the same on every run and thread count.

use nalgebra::Vector3;

use super::{hash3, seed_words, unit};

/// A smooth random field over the world.
#[derive(Clone, Copy, Debug)]
pub struct Noise {
    seed: [u32; 2],
    scale_mm: f64,
}

impl Noise {
    /// A field whose features are about `scale_mm` wide. Fields of different `stream` numbers are independent.
    pub fn new(seed: u64, stream: u32, scale_mm: f64) -> Self {
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
    pub fn at(&self, p: &Vector3<f64>) -> f64 {
        self.nearby().at(p)
    }

    /// The same field with a cache of one lattice cell, for runs of neighbouring points.
    pub fn nearby(&self) -> Nearby {
        Nearby {
            noise: *self,
            cell: None,
            corners: [0.0; 8],
        }
    }
}

/// A field with the lattice values around the last point.
pub struct Nearby {
    noise: Noise,
    cell: Option<Vector3<f64>>,
    corners: [f64; 8],
}

impl Nearby {
    /// As [`Noise::at`].
    pub fn at(&mut self, p: &Vector3<f64>) -> f64 {
        let scaled = p / self.noise.scale_mm;
        let cell = scaled.map(f64::floor);
        if self.cell != Some(cell) {
            let [i, j, k] = [cell.x as i32, cell.y as i32, cell.z as i32];
            self.corners = std::array::from_fn(|corner| {
                let [a, b, c] = [0, 1, 2].map(|axis| (corner >> axis & 1) as i32);
                f64::from(unit(hash3([i + a, j + b, k + c], self.noise.seed)[0]))
            });
            self.cell = Some(cell);
        }
        let t = (scaled - cell).map(|f| f * f * (3.0 - 2.0 * f));
        let along_x = |corner: usize| self.corners[corner] + (self.corners[corner + 1] - self.corners[corner]) * t.x;
        let along_xy = |corner: usize| {
            let low = along_x(corner);
            low + (along_x(corner + 2) - low) * t.y
        };
        let low = along_xy(0);
        2.0 * (low + (along_xy(4) - low) * t.z) - 1.0
    }
}

/// A number in [0, 1) for the `item`-th choice of a stream.
pub fn choice(seed: u64, stream: u32, item: [i32; 2]) -> f64 {
    f64::from(unit(hash3([stream as i32, item[0], item[1]], seed_words(seed))[1]))
}
