//! The least accurate single precision that WGSL allows (W3C, WebGPU Shading Language, section "Accuracy of Concrete
//! Floating Point Expressions"): every operation is off by as much as permitted, subnormal numbers are flushed to zero
//! and products fused into sums at random. What holds for it and for every choice of directions holds on any GPU.

use std::cell::Cell;
use std::cmp::Ordering;
use std::collections::HashMap;
use std::num::FpCategory;
use std::ops::{Add, AddAssign, Div, DivAssign, Mul, MulAssign, Neg, Rem, RemAssign, Sub, SubAssign};
use std::sync::{LazyLock, Mutex};

use num_traits::{Float, FromPrimitive, Num, One, ToPrimitive, Zero};

use insonify_base::parallel::{self, Pool};
use insonify_base::real::{Numbers, Real};

/// Direction of all errors of an arithmetic.
#[derive(Clone, Copy, Debug)]
pub enum Bias {
    /// Drawn for each operation from its operands and a seed.
    Random(u32),
    /// Truncation.
    TowardZero,
    /// Rounding away from zero.
    AwayFromZero,
}

thread_local! {
    static BIAS: Cell<Bias> = const { Cell::new(Bias::Random(0)) };
}

/// Runs a function on threads of its own whose errors have this bias.
pub fn with<R: Send>(bias: Bias, run: impl FnOnce() -> R + Send) -> R {
    let pool = Pool::started(parallel::threads(), move || BIAS.set(bias));
    pool.expect("threads").install(run)
}

/// Directions of rounding of the least accurate arithmetic that WGSL allows.
pub const BIASES: [Bias; 3] = [Bias::Random(1), Bias::TowardZero, Bias::AwayFromZero];

/// A number in the least accurate single precision.
#[derive(Clone, Copy, Debug, Default)]
pub struct Lossy {
    value: f32,
    /// Rounding error of a product: a sum may use the product unrounded.
    rest: f32,
}

impl From<f32> for Lossy {
    fn from(value: f32) -> Self {
        Self { value, rest: 0.0 }
    }
}

/// Random bits of one operation.
struct Draw(u64);

impl Draw {
    fn new(operation: u32, a: f32, b: f32) -> Self {
        let seed = match BIAS.get() {
            Bias::Random(seed) => seed,
            _ => 0,
        };
        let words = [operation ^ seed.rotate_left(16), a.to_bits(), b.to_bits()];
        Self(words.iter().fold(0x9E37_79B9_7F4A_7C15, |state, &word| {
            let mixed = (state ^ u64::from(word)).wrapping_mul(0xD6E8_FEB8_6659_FD93);
            mixed ^ mixed >> 32
        }))
    }

    fn bit(&self, at: u32) -> bool {
        self.0 >> at & 1 == 1
    }

    /// True if the result lies above the exact one.
    fn is_up(&self, exact: f64) -> bool {
        match BIAS.get() {
            Bias::Random(_) => self.bit(0),
            Bias::TowardZero => exact < 0.0,
            Bias::AwayFromZero => exact > 0.0,
        }
    }

    /// Flushes a subnormal number to zero, or not.
    fn flushed(&self, at: u32, value: f32) -> f32 {
        if value.is_subnormal() && self.bit(at) {
            0.0
        } else {
            value
        }
    }

    /// A correctly rounded result: of the two neighbours of the exact one either.
    fn rounded(&self, exact: f64) -> f32 {
        let nearest = exact as f32;
        let rounded = match f64::from(nearest).partial_cmp(&exact) {
            Some(Ordering::Less) if self.is_up(exact) => nearest.next_up(),
            Some(Ordering::Greater) if !self.is_up(exact) => nearest.next_down(),
            _ => nearest,
        };
        self.flushed(1, rounded)
    }

    /// A result `off` from the exact one, at least 1 ULP.
    fn off(&self, exact: f64, off: f64) -> f32 {
        if !exact.is_finite() {
            return exact as f32;
        }
        let up = self.is_up(exact);
        let farthest = if up { exact + off } else { exact - off };
        let nearest = farthest as f32;
        let rounded = match f64::from(nearest).total_cmp(&farthest) {
            Ordering::Greater if up => nearest.next_down(),
            Ordering::Less if !up => nearest.next_up(),
            _ => nearest,
        };
        self.flushed(1, rounded)
    }
}

/// Distance of the two numbers around `x`; of a power of two the one below.
fn ulp(x: f64) -> f64 {
    let bits = x.abs().max(f64::from(f32::MIN_POSITIVE)).to_bits();
    let below = i32::from(bits & ((1 << 52) - 1) == 0);
    2f64.powi(((bits >> 52) as i32 - 1023 - 23 - below).max(-149))
}

impl Add for Lossy {
    type Output = Self;

    #[inline(never)]
    fn add(self, other: Self) -> Self {
        let draw = Draw::new(1, self.value, other.value);
        let [mut a, mut b] = [(self, 2), (other, 3)].map(|(x, bit)| f64::from(draw.flushed(bit, x.value)));
        if draw.bit(4) {
            // Fused with the product on either side.
            if self.rest != 0.0 && (other.rest == 0.0 || draw.bit(5)) {
                a += f64::from(self.rest);
            } else {
                b += f64::from(other.rest);
            }
        }
        draw.rounded(a + b).into()
    }
}

impl Sub for Lossy {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl Mul for Lossy {
    type Output = Self;

    #[inline(never)]
    fn mul(self, other: Self) -> Self {
        let draw = Draw::new(2, self.value, other.value);
        let exact = f64::from(draw.flushed(2, self.value)) * f64::from(draw.flushed(3, other.value));
        let value = draw.rounded(exact);
        let rest = if value.is_normal() {
            (exact - f64::from(value)) as f32
        } else {
            0.0
        };
        Self { value, rest }
    }
}

impl Div for Lossy {
    type Output = Self;

    #[inline(never)]
    fn div(self, other: Self) -> Self {
        let draw = Draw::new(3, self.value, other.value);
        let exact = f64::from(draw.flushed(2, self.value)) / f64::from(draw.flushed(3, other.value));
        draw.off(exact, 2.5 * ulp(exact)).into()
    }
}

impl Neg for Lossy {
    type Output = Self;

    fn neg(self) -> Self {
        Self {
            value: -self.value,
            rest: -self.rest,
        }
    }
}

impl Rem for Lossy {
    type Output = Self;

    fn rem(self, other: Self) -> Self {
        self - other * (self / other).trunc()
    }
}

macro_rules! assign {
    ($($name:ident $function:ident $operator:tt;)+) => {
        $(impl $name for Lossy {
            fn $function(&mut self, other: Self) {
                *self = *self $operator other;
            }
        })+
    };
}
assign! { AddAssign add_assign +; SubAssign sub_assign -; MulAssign mul_assign *; DivAssign div_assign /; RemAssign rem_assign %; }

impl PartialEq for Lossy {
    fn eq(&self, other: &Self) -> bool {
        self.value == other.value
    }
}

impl PartialOrd for Lossy {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        self.value.partial_cmp(&other.value)
    }
}

impl Real for Lossy {
    /// Numbers are stored to nearest; an integer beyond 2^24 is one that a shader converts, in either direction.
    fn of(value: f64) -> Self {
        if value.fract() == 0.0 {
            Draw::new(4, value as f32, 0.0).rounded(value).into()
        } else {
            (value as f32).into()
        }
    }

    fn from_signed(value: i32) -> Self {
        Self::of(f64::from(value))
    }

    fn truncate(self) -> i32 {
        self.value as i32
    }

    fn integer(self) -> i32 {
        self.value.integer()
    }

    fn pick(numbers: &Numbers) -> &[Self] {
        /// Copies of all tables asked for, by the bits of their numbers.
        static COPIES: LazyLock<Mutex<HashMap<Vec<u32>, &'static [Lossy]>>> = LazyLock::new(Mutex::default);
        let narrow = numbers.of::<f32>();
        let bits: &[u32] = bytemuck::cast_slice(narrow);
        let mut copies = COPIES.lock().expect("no panic while it is held");
        if let Some(copy) = copies.get(bits) {
            return copy;
        }
        let copy: Vec<Lossy> = narrow.iter().map(|&x| x.into()).collect();
        copies.entry(bits.to_vec()).or_insert(copy.leak())
    }

    fn wide(self) -> f64 {
        f64::from(self.value)
    }
}

impl Zero for Lossy {
    fn zero() -> Self {
        0.0.into()
    }

    fn is_zero(&self) -> bool {
        self.value == 0.0
    }
}

impl One for Lossy {
    fn one() -> Self {
        1.0.into()
    }
}

impl Num for Lossy {
    type FromStrRadixErr = <f32 as Num>::FromStrRadixErr;

    fn from_str_radix(text: &str, radix: u32) -> Result<Self, Self::FromStrRadixErr> {
        f32::from_str_radix(text, radix).map(Self::from)
    }
}

impl ToPrimitive for Lossy {
    fn to_i64(&self) -> Option<i64> {
        self.value.to_i64()
    }

    fn to_u64(&self) -> Option<u64> {
        self.value.to_u64()
    }

    fn to_f64(&self) -> Option<f64> {
        Some(self.wide())
    }
}

impl FromPrimitive for Lossy {
    fn from_i64(n: i64) -> Option<Self> {
        Some(Self::of(n as f64))
    }

    fn from_u64(n: u64) -> Option<Self> {
        Some(Self::of(n as f64))
    }

    fn from_f64(n: f64) -> Option<Self> {
        Some(Self::of(n))
    }
}

impl num_traits::NumCast for Lossy {
    fn from<N: ToPrimitive>(n: N) -> Option<Self> {
        n.to_f64().map(Self::of)
    }
}

/// Exact functions, and those that no pass uses: a pass that starts to needs its loss here.
macro_rules! functions {
    (constants $($constant:ident)+; tests $($test:ident)+; exact $($exact:ident)+; unused $($unused:ident($($arg:ident: $type:ty),*) -> $out:ty;)+) => {
        $(fn $constant() -> Self {
            <f32 as Float>::$constant().into()
        })+
        $(fn $test(self) -> bool {
            self.value.$test()
        })+
        $(fn $exact(self) -> Self {
            self.value.$exact().into()
        })+
        $(fn $unused(self $(, $arg: $type)*) -> $out {
            let _ = ($($arg,)*);
            unimplemented!(concat!("the loss of ", stringify!($unused)))
        })+
    };
}

impl Float for Lossy {
    functions! {
        constants nan infinity neg_infinity neg_zero min_value min_positive_value max_value epsilon;
        tests is_nan is_infinite is_finite is_normal is_sign_positive is_sign_negative;
        exact floor ceil round trunc fract abs signum;
        unused
        powi(n: i32) -> Self; exp() -> Self; ln() -> Self; log(base: Self) -> Self; log10() -> Self; abs_sub(other: Self) -> Self;
        cbrt() -> Self; sin() -> Self; cos() -> Self; tan() -> Self; asin() -> Self; acos() -> Self; atan() -> Self;
        atan2(other: Self) -> Self; sin_cos() -> (Self, Self); exp_m1() -> Self; ln_1p() -> Self; sinh() -> Self; cosh() -> Self;
        tanh() -> Self; asinh() -> Self; acosh() -> Self; atanh() -> Self;
    }

    fn classify(self) -> FpCategory {
        self.value.classify()
    }

    fn integer_decode(self) -> (u64, i16, i8) {
        self.value.integer_decode()
    }

    fn max(self, other: Self) -> Self {
        self.value.max(other.value).into()
    }

    fn min(self, other: Self) -> Self {
        self.value.min(other.value).into()
    }

    fn mul_add(self, a: Self, b: Self) -> Self {
        self * a + b
    }

    fn recip(self) -> Self {
        Self::one() / self
    }

    /// `1 / inverseSqrt(x)`: 2 ULP for the inverse root, 2.5 for the division.
    #[inline(never)]
    fn sqrt(self) -> Self {
        let draw = Draw::new(5, self.value, 0.0);
        let x = f64::from(draw.flushed(2, self.value));
        if x <= 0.0 || !x.is_finite() {
            return (x.sqrt() as f32).into();
        }
        let inverse = x.sqrt().recip();
        // The opposite direction, so that both errors add up.
        let off = 2.0 * ulp(inverse) * if draw.is_up(inverse) { -1.0 } else { 1.0 };
        let exact = f64::from((inverse + off) as f32).recip();
        draw.off(exact, 2.5 * ulp(exact)).into()
    }

    /// 3 + 2 |x| ULP.
    #[inline(never)]
    fn exp2(self) -> Self {
        let draw = Draw::new(6, self.value, 0.0);
        let x = f64::from(draw.flushed(2, self.value));
        let exact = x.exp2();
        draw.off(exact, (3.0 + 2.0 * x.abs()) * ulp(exact)).into()
    }

    /// 2^-21 from 0.5 to 2, elsewhere 3 ULP.
    #[inline(never)]
    fn log2(self) -> Self {
        let draw = Draw::new(7, self.value, 0.0);
        let exact = f64::from(draw.flushed(2, self.value)).log2();
        let off = if (0.5..=2.0).contains(&self.value) {
            2f64.powi(-21)
        } else {
            3.0 * ulp(exact)
        };
        draw.off(exact, off).into()
    }

    /// `exp2(y * log2(x))`; powers of 0 as in `shaders/common/power.wgsl`.
    fn powf(self, exponent: Self) -> Self {
        if self.value <= 0.0 {
            return f32::from(u8::from(exponent.is_zero())).into();
        }
        (exponent * self.max(Self::of(1.2e-38)).log2()).exp2()
    }

    /// Root of the sum of the squares, as `length`.
    fn hypot(self, other: Self) -> Self {
        (self * self + other * other).sqrt()
    }
}
