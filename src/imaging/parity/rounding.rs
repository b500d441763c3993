//! Error bounds of single operations in WGSL (W3C, WebGPU Shading Language, section "Accuracy of Concrete Floating
//! Point Expressions") and in Rust. The larger of the two is used, so that one bound serves both backends.

/// One unit in the last place of a number in [1, 2). Sums, differences and products are correctly rounded in WGSL, but
/// in an unspecified direction, so each loses up to a full ULP rather than half. Fused and reordered sums lose no more
/// than the sum of separately rounded products.
pub(crate) const ULP: f64 = 1.0 / 8_388_608.0;

/// Relative error of `x / y`: 2.5 ULP.
pub(crate) const DIVIDE: f64 = 2.5 * ULP;

/// Relative error of `sqrt(x)`, specified as that of `1 / inverseSqrt(x)`: 2 ULP for the inverse root and 2.5 for the
/// division.
pub(crate) const ROOT: f64 = 4.5 * ULP;

/// Smallest normal number: results below it may be flushed to zero.
pub(crate) const TINY: f64 = f32::MIN_POSITIVE as f64;

/// Returns the relative error of `exp2(x)` when `x` has the error `off`: 3 + 2 |x| ULP.
pub(crate) fn exp2(x: f64, off: f64) -> f64 {
    (3.0 + 2.0 * x.abs()) * ULP + off * std::f64::consts::LN_2 * 1.01
}

/// Returns the absolute error of `log2(x)`, given the result: 2^-21 for x in [0.5, 2], otherwise 3 ULP of the result.
pub(crate) fn log2(result: f64) -> f64 {
    (2f64.powi(-21)).max(3.0 * ULP * result.abs())
}

/// Returns the relative error of `pow(x, y)` for exact `x` and `y`, specified as that of `exp2(y * log2(x))`.
pub(crate) fn pow(x: f64, y: f64) -> f64 {
    // The shaders take 0^y as exactly 0 or 1.
    if x <= 0.0 {
        return 0.0;
    }
    let exponent = y * x.log2();
    exp2(exponent, y.abs() * log2(x.log2()) + ULP * exponent.abs())
}

/// Bounds the change of a square root whose argument, at least 0, has the error `off`.
pub(crate) fn root_off(argument: f64, off: f64) -> f64 {
    if argument <= off {
        off.sqrt() * std::f64::consts::SQRT_2
    } else {
        off / argument.sqrt()
    }
}
