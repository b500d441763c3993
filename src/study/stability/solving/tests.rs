use super::manufactured::quadrature;

/// Compares moments of the quadrature with k! l! m! n! 3! / (k+l+m+n+3)!.
#[test]
fn quadrature_is_exact() {
    let factorial = |n: u32| (1..=n).map(f64::from).product::<f64>();
    for powers in [
        [0, 0, 0, 0],
        [1, 0, 0, 0],
        [0, 2, 1, 0],
        [1, 1, 1, 1],
        [0, 0, 0, 4],
        [3, 0, 1, 1],
    ] {
        let sum: f64 = quadrature()
            .iter()
            .map(|(b, w)| w * (0..4).map(|k| b[k].powi(powers[k] as i32)).product::<f64>())
            .sum();
        let exact = powers.map(factorial).iter().product::<f64>() * 6.0 / factorial(powers.iter().sum::<u32>() + 3);
        assert!((sum / exact - 1.0).abs() < 1e-14, "{powers:?}: {sum} {exact}");
    }
}
