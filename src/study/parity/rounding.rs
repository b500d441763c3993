//! What one operation may lose, in WGSL (W3C, WebGPU Shading Language, section "Accuracy of Concrete Floating Point
//! Expressions") and in Rust. The larger of the two counts, so that one bound serves both backends.

/// One unit in the last place of a number in [1, 2). Sums, differences and products are correctly rounded in WGSL, but the
/// direction is left open, so each loses up to this and not half of it. Fused and reordered sums lose no more than the
/// sum of the products taken one by one.
pub const ULP: f64 = 1.0 / 8_388_608.0;

/// `x / y`: 2.5 ULP.
pub const DIVIDE: f64 = 2.5 * ULP;

/// `sqrt(x)` is as good as `1 / inverseSqrt(x)`: 2 ULP of the root, then 2.5 of the division.
pub const ROOT: f64 = 4.5 * ULP;

/// Results below the smallest normal number may come out as zero.
pub const TINY: f64 = f32::MIN_POSITIVE as f64;

/// Relative error of `exp2(x)` where `x` itself is off by `off`: 3 + 2 |x| ULP.
pub fn exp2(x: f64, off: f64) -> f64 {
    (3.0 + 2.0 * x.abs()) * ULP + off * std::f64::consts::LN_2 * 1.01
}

/// Absolute error of `log2(x)`, given the result: 2^-21 for x in [0.5, 2], else 3 ULP of the result.
pub fn log2(result: f64) -> f64 {
    (2f64.powi(-21)).max(3.0 * ULP * result.abs())
}

/// Relative error of `pow(x, y)`, which is as good as `exp2(y * log2(x))`, for exact `x` and `y`.
pub fn pow(x: f64, y: f64) -> f64 {
    if x <= 0.0 || y == 0.0 {
        return 0.0;
    }
    let exponent = y * x.log2();
    exp2(exponent, y.abs() * log2(x.log2()) + ULP * exponent.abs())
}

/// How far a square root may move where its argument, at least 0, is off by `off`.
pub fn root_off(argument: f64, off: f64) -> f64 {
    if argument <= off {
        off.sqrt() * std::f64::consts::SQRT_2
    } else {
        off / argument.sqrt()
    }
}
