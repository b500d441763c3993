use bytemuck::Zeroable;

use super::*;

fn shaft(start: [f64; 3], end: [f64; 3], radius: f64, thickness: f64) -> Shaft<f64> {
    Shaft::new([
        [start[0], start[1], start[2], radius],
        [end[0], end[1], end[2], thickness],
        [0.0, 0.0, 1.0, 1.0],
    ])
}

/// Volume of the shaft inside the thickened plane, by summing filled fractions over a fine lattice of plane points.
fn volume(shaft: &Shaft<f64>, thickness: f64, half_width: f64) -> f64 {
    let n = 1600;
    let step = 2.0 * half_width / f64::from(n);
    let mut sum = 0.0;
    for i in 0..n {
        for j in 0..n {
            let at = |k: i32| -half_width + (f64::from(k) + 0.5) * step;
            sum += shaft.share(at(i), at(j));
        }
    }
    sum * step * step * thickness
}

#[test]
fn in_the_plane_the_shaft_fills_its_own_cylinder() {
    let lying = shaft([-5.0, 0.0, 0.0], [5.0, 0.0, 0.0], 0.5, 1.0);
    assert!((lying.share(0.0, 0.0) - 1.0).abs() < 1e-12);
    assert!((lying.share(0.0, 0.3) - 0.8).abs() < 1e-12);
    assert_eq!(lying.share(0.0, 0.51), 0.0);
    assert_eq!(lying.share(5.01, 0.0), 0.0);
    assert!((volume(&lying, 1.0, 6.0) / (std::f64::consts::PI * 0.25 * 10.0) - 1.0).abs() < 2e-3);
}

#[test]
fn across_the_plane_it_is_a_disc() {
    let upright = shaft([0.0, 0.0, -20.0], [0.0, 0.0, 20.0], 0.5, 1.0);
    assert_eq!(upright.share(0.3, 0.3), 1.0);
    assert_eq!(upright.share(0.4, 0.4), 0.0);
    assert!((volume(&upright, 1.0, 1.0) / (std::f64::consts::PI * 0.25) - 1.0).abs() < 5e-3);
    let short = shaft([0.0, 0.0, 0.25], [0.0, 0.0, 20.0], 0.5, 1.0);
    assert!((short.share(0.0, 0.0) - 0.25).abs() < 1e-12);
}

#[test]
fn obliquely_the_volume_is_the_area_over_the_sine() {
    // A long cylinder at 30 degrees to a thick plane: volume = pi r^2 t / sin(angle).
    let oblique = shaft(
        [-30.0 * 3f64.sqrt(), 0.0, -30.0],
        [30.0 * 3f64.sqrt(), 0.0, 30.0],
        0.5,
        2.0,
    );
    let expected = std::f64::consts::PI * 0.25 * 2.0 / 0.5;
    assert!((volume(&oblique, 2.0, 6.0) / expected - 1.0).abs() < 3e-3);
}

#[test]
fn the_depths_tried_hold_every_echo() {
    let numbers = NeedleParams {
        sample_mm: 0.25,
        samples: 400,
        echo: 1.0,
        steady: 1.0,
        ..Zeroable::zeroed()
    };
    for end in [
        [40.0, 60.0, 3.0],
        [-20.0, 80.0, 0.0],
        [0.0, 50.0, 0.0],
        [3.0, 20.0, 30.0],
    ] {
        let shaft = shaft([-10.0, 5.0, -1.0], end, 0.6, 1.2);
        for line in -20..20 {
            let angle = f64::from(line) * 0.05;
            let ray = [f64::from(line), 0.0, angle.sin(), angle.cos()];
            let (mut echoes, mut mask) = (vec![[0.0; 2]; 400], vec![[0.0; 2]; 400]);
            shaft.scanline(ray, &numbers, &mut mask, |i, echo| echoes[i] = echo);
            for (i, &[found, _]) in mask.iter().enumerate() {
                let depth = (i as f64 + 0.5) * 0.25;
                assert_eq!(
                    found,
                    shaft.share(ray[0] + ray[2] * depth, ray[1] + ray[3] * depth),
                    "line {line} sample {i}"
                );
                // With an exponent of 0 the direction has no effect.
                assert!(echoes[i] == [found, 0.0], "line {line} sample {i}");
            }
        }
    }
}

#[test]
fn a_bevel_is_twice_as_loud_and_grains_have_the_spread_that_is_stated() {
    let numbers = |roughness: f64| NeedleParams {
        steady: (1.0 - roughness).sqrt() as f32,
        diffuse: roughness.sqrt() as f32,
        seed: [7, 9],
        ..Zeroable::zeroed()
    };
    // A needle of 100 mm along x whose tip is at x = 100, and an equal seed.
    let [needle, seed] = [0.0, 1.0].map(|number| {
        Shaft::<f64>::new([
            [0.0, 20.0, 0.0, 0.6],
            [100.0, 20.0, 0.0, 1.2],
            [100.0, 0.0, number, 0.5],
        ])
    });
    let even = numbers(0.0);
    assert_eq!(needle.grain(98.0, 20.0, &even), [2.0 * 0.5, 0.0]);
    assert_eq!(needle.grain(96.0, 20.0, &even), [0.5, 0.0]);
    assert_eq!(seed.grain(98.0, 20.0, &even), [0.5, 0.0]);
    let own = numbers(crate::effects::needle::NeedleEcho::default().roughness);
    let db: Vec<f64> = (0..20_000)
        .map(|at| {
            let long = Shaft::new([[0.0, 20.0, 0.0, 0.6], [1e5, 20.0, 0.0, 1.2], [1e5, 0.0, 1.0, 1.0]]);
            let [re, im] = long.grain(f64::from(at) * 4.7, 20.0, &own);
            20.0 * re.hypot(im).log10()
        })
        .collect();
    let mean = db.iter().sum::<f64>() / db.len() as f64;
    let spread = (db.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / db.len() as f64).sqrt();
    assert!((spread - 3.0).abs() < 0.2, "{spread} dB");
}
