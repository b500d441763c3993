//! Random numbers as a hash of position and seed: the same input gives the same value on every run, thread count and
//! backend.
//!
//! The mixing steps are those of the PCG output permutation family in three dimensions (M. Jarzynski and M. Olano,
//! "Hash Functions for GPU Rendering", JCGT 9(3), 2020), on 32-bit integers only, since 64-bit ones are optional on
//! GPUs.

pub mod noise;

use crate::simd::map;

/// Folds a 64-bit seed to the two 32-bit words that the hashes take.
pub fn seed_words(seed: u64) -> [u32; 2] {
    [seed as u32, (seed >> 32) as u32]
}

/// Applies the first, linear step of [`pcg3d`] to one component.
#[inline(always)]
pub fn pcg_step(x: u32) -> u32 {
    x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223)
}

/// Applies the mixing steps of [`pcg3d`], after the linear one.
#[inline(always)]
pub fn pcg_mix(mut v: [u32; 3]) -> [u32; 3] {
    v[0] = v[0].wrapping_add(v[1].wrapping_mul(v[2]));
    v[1] = v[1].wrapping_add(v[2].wrapping_mul(v[0]));
    v[2] = v[2].wrapping_add(v[0].wrapping_mul(v[1]));
    v = map(v, |x| x ^ x >> 16);
    v[0] = v[0].wrapping_add(v[1].wrapping_mul(v[2]));
    v[1] = v[1].wrapping_add(v[2].wrapping_mul(v[0]));
    v[2] = v[2].wrapping_add(v[0].wrapping_mul(v[1]));
    v
}

/// Hashes three integers to three well-mixed words.
#[inline(always)]
pub fn pcg3d(v: [u32; 3]) -> [u32; 3] {
    pcg_mix(map(v, pcg_step))
}

/// Combines a lattice coordinate on one axis with the seed: the input of [`hash3`] to [`pcg3d`].
#[inline(always)]
pub fn seeded(axis: usize, coordinate: i32, seed: [u32; 2]) -> u32 {
    match axis {
        0 => coordinate as u32 ^ seed[0],
        1 => (coordinate as u32).wrapping_add(seed[1]),
        _ => coordinate as u32 ^ seed[0].rotate_left(16),
    }
}

/// Hashes a lattice point and a seed to three words. Negative coordinates wrap as two's complement.
#[inline(always)]
pub fn hash3(point: [i32; 3], seed: [u32; 2]) -> [u32; 3] {
    pcg3d([
        seeded(0, point[0], seed),
        seeded(1, point[1], seed),
        seeded(2, point[2], seed),
    ])
}

/// Maps a word to a number in [0, 1).
#[inline(always)]
pub fn unit(word: u32) -> f32 {
    (word >> 8) as f32 * (1.0 / 16_777_216.0)
}

/// Standard normal number of a lattice point and a seed (Box and Muller 1958).
pub fn normal(point: [i32; 3], seed: [u32; 2]) -> f64 {
    let [a, b, _] = hash3(point, seed).map(|word| f64::from(unit(word)));
    (-2.0 * (1.0 - a).ln()).sqrt() * (std::f64::consts::TAU * b).cos()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normal_numbers_have_the_moments_of_their_distribution() {
        let mut moments = [0.0; 4];
        let count = 20_000;
        for at in 0..count {
            let x = normal([at, 3, 1], [5, 6]);
            for (power, moment) in (1..).zip(&mut moments) {
                *moment += x.powi(power) / f64::from(count);
            }
        }
        for (moment, exact, bound) in [
            (moments[0], 0.0, 0.03),
            (moments[1], 1.0, 0.05),
            (moments[2], 0.0, 0.1),
            (moments[3], 3.0, 0.3),
        ] {
            assert!((moment - exact).abs() < bound, "{moments:?}");
        }
    }

    #[test]
    fn neighbouring_points_are_uncorrelated_and_uniform() {
        let n = 40;
        let (mut sum, mut squares, mut product) = (0.0, 0.0, 0.0);
        for i in 0..n {
            for j in 0..n {
                for k in 0..n {
                    let a = f64::from(unit(hash3([i - 20, j - 20, k - 20], [7, 9])[0])) - 0.5;
                    let b = f64::from(unit(hash3([i - 19, j - 20, k - 20], [7, 9])[0])) - 0.5;
                    sum += a;
                    squares += a * a;
                    product += a * b;
                }
            }
        }
        let count = f64::from(n * n * n);
        assert!((sum / count).abs() < 4.0 * (1.0f64 / 12.0 / count).sqrt());
        assert!((squares / count - 1.0 / 12.0).abs() < 2e-3);
        assert!((product / count).abs() < 4.0 / 12.0 / count.sqrt());
    }

    #[test]
    fn both_halves_of_the_seed_matter() {
        assert_ne!(hash3([1, 2, 3], seed_words(1)), hash3([1, 2, 3], seed_words(2)));
        assert_ne!(
            hash3([1, 2, 3], seed_words(1)),
            hash3([1, 2, 3], seed_words(1 << 32 | 1))
        );
    }
}
