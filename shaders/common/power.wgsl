// Power of a number from 0 on with an exponent from 0 on, 0^0 = 1 as on the CPU: `pow` is exp2(y log2(x)), which WGSL leaves open
// at 0.
fn power(base: f32, exponent: f32) -> f32 {
    let above_zero = pow(max(base, 1.2e-38), exponent);
    return select(above_zero, select(0.0, 1.0, exponent == 0.0), base <= 0.0);
}
