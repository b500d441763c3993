//! The least accurate arithmetic that WGSL allows: as far off as permitted, and no farther.

use insonify_base::real::Real;
use insonify_testing::lossy::{Lossy, with};
use num_traits::Float;

use insonify_testing::lossy::BIASES;

#[test]
fn every_operation_is_as_far_off_as_wgsl_allows_and_no_farther() {
    let ulp = f64::from(f32::EPSILON);
    for bias in BIASES {
        let mut most = [0.0f64; 7];
        with(bias, || {
            for i in 0..20_000u32 {
                // From 1 to 2, and a thousandth of that.
                let [a, b] = [2_654_435_761, 2_246_822_519].map(|by| 1.0 + f64::from(i.wrapping_mul(by) >> 9) * ulp);
                let b = b / 1024.0;
                let (x, y) = (Lossy::of(a), Lossy::of(b));
                let all = [
                    (x + y, a + b, 1.0),
                    (x - y, a - b, 1.0),
                    (x * y, a * b, 1.0),
                    (x / y, a / b, 2.5),
                    (x.sqrt(), a.sqrt(), 4.5),
                    (x.exp2(), a.exp2(), 3.0 + 2.0 * a),
                    (y.log2(), b.log2(), 3.0),
                ];
                for ((found, exact, allowed), most) in all.into_iter().zip(&mut most) {
                    let off = ((found.wide() - exact) / exact).abs() / ulp;
                    assert!(off <= 1.0001 * allowed, "{bias:?}: {off} ULP of {allowed}: {a}, {b}");
                    *most = most.max(off);
                }
            }
        });
        let least = [0.8, 0.8, 0.8, 1.9, 2.8, 4.0, 1.9];
        assert!(most.iter().zip(&least).all(|(a, b)| a > b), "{bias:?}: {most:?} ULP");
    }
}

#[test]
fn integers_round_either_way_products_fuse_and_subnormal_numbers_vanish_or_not() {
    let counts = with(BIASES[0], || {
        let mut counts = [0; 3];
        for i in 0..1000u32 {
            // Between two numbers, 2 apart.
            let integer = Lossy::from_signed((1 << 24) + 1 + 2 * i as i32);
            counts[0] += usize::from(integer.wide() > f64::from((1 << 24) + 1 + 2 * i));
            let x = Lossy::of(1.0 + f64::from(2 * i + 1) / 4096.0 + f64::from(f32::EPSILON));
            let product = x * x;
            counts[1] += usize::from((product - Lossy::of(product.wide())).wide() != 0.0);
            let tiny = Lossy::of(f64::from(f32::from_bits(i + 1)));
            counts[2] += usize::from((tiny + Lossy::of(0.0)).wide() == 0.0);
        }
        counts
    });
    assert!(counts.iter().all(|count| (200..=900).contains(count)), "{counts:?}");
}
