use super::*;
use insonify_base::random::{hash3, unit};

fn random(index: usize, stream: i32) -> f64 {
    f64::from(unit(hash3([index as i32, stream, 5], [6, 7])[0]))
}

/// Normally distributed image smoothed by standard deviations in pixels, of variance 1.
fn noise(size: [usize; 2], sigma: [f64; 2], stream: i32) -> Image {
    let values =
        (0..size[0] * size[1]).map(|pixel| (0..6).map(|draw| random(pixel, 10 * stream + draw)).sum::<f64>() - 3.0);
    let smooth = Image {
        size,
        values: values.collect(),
    }
    .smoothed(sigma);
    let mean = smooth.values.iter().sum::<f64>() / smooth.values.len() as f64;
    let spread = smooth.values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / smooth.values.len() as f64;
    smooth.map(|value| (value - mean) / spread.sqrt())
}

fn exemplar(sigma: [f64; 2], stream: i32) -> Exemplar {
    let image = noise([160, 160], sigma, stream);
    Exemplar {
        size: image.size,
        values: image.values.iter().map(|value| 4.0 * *value as f32).collect(),
    }
}

fn synthesised(exemplars: Exemplars, seed: u64) -> SolidTexture {
    let prepared = PreparedExemplar {
        exemplar: exemplars.xy.clone(),
        voxel_mm: 0.5,
        cell_mm: [1.0, 1.0],
    };
    make(&prepared, exemplars, 48, seed, &mut |_| ()).unwrap()
}

#[test]
fn a_solid_has_the_statistics_of_its_exemplars_along_each_axis() {
    let plane = exemplar([3.0, 1.5], 1);
    let solid = synthesised(Exemplars::of(plane.clone(), None, None), 0);
    let figures = &solid.figures;
    for axis in 0..3 {
        let (solid_mm, exemplar_mm) = (
            figures.correlation_mm[axis].unwrap(),
            figures.exemplar_correlation_mm[axis].unwrap(),
        );
        assert!(
            (0.9..=1.1).contains(&(solid_mm / exemplar_mm)),
            "axis {axis}: {figures}"
        );
        // A border has some fifty independent pairs.
        assert!((0.75..=1.33).contains(&figures.seam[axis]), "{figures}");
    }
    assert!(figures.histogram_db < 0.05, "{figures}");
    // The solid has no preferred direction in the plane across the rows: x + z and x - z are alike.
    let n = solid.side;
    let correlation = |sign: usize| {
        let value = |x: usize, y: usize, z: usize| f64::from(solid.level[x % n + n * (y + n * (z % n))]);
        let lag = 3;
        let voxels = (0..n * n * n).map(|voxel| [voxel % n, voxel / n % n, voxel / n / n]);
        voxels
            .map(|[x, y, z]| value(x, y, z) * value(x + lag, y, z + sign * lag + n * lag))
            .sum::<f64>()
    };
    let [plus, minus] = [correlation(1), correlation(n - 1)];
    assert!((0.5..=2.0).contains(&(plus / minus)), "{plus} {minus}");
    // The histogram is that of the exemplar.
    let mut values: Vec<f32> = solid.level.clone();
    let mut like = plane.values.clone();
    values.sort_by(f32::total_cmp);
    like.sort_by(f32::total_cmp);
    for share in [0.05, 0.5, 0.95] {
        let quantile = |sorted: &[f32]| sorted[(share * sorted.len() as f64) as usize];
        assert!((quantile(&values) - quantile(&like)).abs() < 0.1);
    }
}

#[test]
fn a_solid_is_the_same_at_any_number_of_threads_and_another_for_another_seed() {
    let exemplars = || {
        Exemplars::of(
            exemplar([2.0, 2.0], 1),
            Some(exemplar([1.5, 2.0], 2)),
            Some(exemplar([2.0, 1.5], 3)),
        )
    };
    let values = |threads: usize, seed: u64| {
        let pool = insonify_base::parallel::Pool::new(threads).unwrap();
        pool.install(|| synthesise(&exemplars(), 32, seed, &mut |_| ()).unwrap())
    };
    let single = values(1, 5);
    assert_eq!(single, values(3, 5));
    assert_ne!(single, values(1, 6));
}

/// A picture of 8-bit greys from levels in dB about the middle of a range of 60 dB.
fn picture(level: &Image) -> Picture {
    let grey = level.map(|db| (127.5 + db * 255.0 / 60.0).clamp(0.0, 255.0).round());
    let [width, height] = level.size;
    Picture {
        name: "liver.png".to_owned(),
        width,
        height,
        grey: grey.values,
        mm: Some([0.2; 2]),
        ..Picture::default()
    }
}

const PREPARATION: Preparation = Preparation {
    pixel_mm: [0.2; 2],
    range_db: 60.0,
    content: Content::Keep,
    voxel_mm: None,
};

fn region(size: [usize; 2]) -> Region {
    Region {
        window: [0, 0, size[0], size[1]],
        apex_px: None,
    }
}

#[test]
fn compression_and_trend_are_undone() {
    let texture = noise([200, 180], [2.0, 2.0], 4);
    let values = texture.values.iter().enumerate();
    // A gain that falls by 20 dB down the picture.
    let sloped = values.map(|(pixel, value)| 3.0 * value - 20.0 * (pixel / 200) as f64 / 180.0);
    let image = Image {
        size: [200, 180],
        values: sloped.collect(),
    };
    let prepared = PREPARATION.prepare(&picture(&image), &region([200, 180])).unwrap();
    assert_eq!((prepared.exemplar.size, prepared.voxel_mm), ([200, 180], 0.2));
    let rows = |start: usize| {
        let block = &prepared.exemplar.values[start * 200..(start + 40) * 200];
        block.iter().map(|value| f64::from(*value)).sum::<f64>() / block.len() as f64
    };
    assert!((rows(10) - rows(130)).abs() < 2.0, "{} {}", rows(10), rows(130));
    let n = prepared.exemplar.values.len() as f64;
    let spread = (prepared
        .exemplar
        .values
        .iter()
        .map(|value| f64::from(value * value))
        .sum::<f64>()
        / n)
        .sqrt();
    assert!((spread / 3.0 - 1.0).abs() < 0.1, "{spread}");
}

#[test]
fn structure_leaves_out_what_is_as_fine_as_the_speckle() {
    // Speckle of 6 dB and structure of 3 dB, ten times as coarse.
    let (speckle, structure) = (noise([400, 400], [1.5, 1.0], 5), noise([400, 400], [12.0, 12.0], 6));
    let pairs = speckle
        .values
        .iter()
        .zip(&structure.values)
        .map(|(fine, coarse)| 5.0 * fine + 3.0 * coarse);
    let image = picture(&Image {
        size: [400, 400],
        values: pairs.collect(),
    });
    let preparation = Preparation {
        content: Content::Structure,
        ..PREPARATION
    };
    let prepared = preparation.prepare(&image, &region([400, 400])).unwrap();
    assert!(
        prepared.cell_mm[0] > prepared.cell_mm[1] && prepared.cell_mm[1] > 0.3,
        "{:?}",
        prepared.cell_mm
    );
    // White noise of the low-pass alone would have a width of 3.3 cells.
    let exemplar = &prepared.exemplar;
    let coarse = full_width(&exemplar.correlations(0, MAX_LAG), prepared.voxel_mm).unwrap();
    assert!(coarse > 5.0 * prepared.cell_mm[0], "{coarse} {:?}", prepared.cell_mm);
    let power = exemplar.values.iter().map(|value| value * value).sum::<f32>() / exemplar.values.len() as f32;
    assert!(
        (2.0..3.5).contains(&power.sqrt()),
        "{} dB left of 3 of structure and 5 of speckle",
        power.sqrt()
    );
}

#[test]
fn sectors_beside_the_apex_stay_within_their_region() {
    let apex = [100.0, -60.0];
    for x in [120, 20, 100] {
        let level = |pixel: usize| 4.0 * random(pixel, 3);
        let image = Image {
            size: [300, 300],
            values: (0..90_000).map(level).collect(),
        };
        let sector = Region {
            window: [x, 60, 150, 200],
            apex_px: Some(apex),
        };
        let cut = cut(&picture(&image), &sector).unwrap();
        let (beam, _) = PREPARATION.beam_space(&cut, [x as f64, 60.0], apex).unwrap();
        let clamped = |pixel: usize| {
            let (row, width) = (pixel / beam.size[0], beam.size[0]);
            pixel % width + 1 < width && (beam.values[pixel] - beam.values[pixel + 1]).abs() < 1e-12 && row > 0
        };
        let repeated = (0..beam.values.len()).filter(|&pixel| clamped(pixel)).count();
        assert!(beam.size[0] > 20 && beam.size[1] > 40, "{:?}", beam.size);
        assert!(
            repeated * 1000 < beam.values.len(),
            "{repeated} of {} repeat the edge",
            beam.values.len()
        );
    }
}

#[test]
fn sectors_are_resampled_along_their_scanlines() {
    // Rings about an apex: levels depend on the distance alone.
    let apex = [150.0, -100.0];
    let value = |pixel: usize| ((pixel % 300) as f64 - apex[0]).hypot((pixel / 300) as f64 - apex[1]) / 6.0;
    let rings = Image {
        size: [300, 300],
        values: (0..90_000).map(|pixel| 6.0 * value(pixel).sin()).collect(),
    };
    let sector = Region {
        window: [50, 60, 200, 220],
        apex_px: Some(apex),
    };
    let preparation = Preparation {
        voxel_mm: Some(0.2),
        ..PREPARATION
    };
    let prepared = preparation.prepare(&picture(&rings), &sector).unwrap();
    let [width, height] = prepared.exemplar.size;
    let value = |x: usize, y: usize| prepared.exemplar.values[y * width + x];
    for row in (20..height - 20).step_by(10) {
        let difference = (value(5, row) - value(width / 2, row)).abs();
        assert!(difference < 1.5, "row {row}: {difference}");
    }
    let below = Region {
        apex_px: Some([150.0, 100.0]),
        ..sector
    };
    assert!(
        preparation
            .prepare(&picture(&rings), &below)
            .unwrap_err()
            .to_string()
            .contains("lies in the rows of the region")
    );
    // The same array at the bottom of the picture.
    let upside_down = Image {
        size: [300, 300],
        values: rings.values.chunks(300).rev().flatten().copied().collect(),
    };
    let sector = Region {
        window: [50, 299 - (60 + 219), 200, 220],
        apex_px: Some([apex[0], 299.0 - apex[1]]),
    };
    let flipped = preparation.prepare(&picture(&upside_down), &sector).unwrap();
    assert_eq!(flipped.exemplar.size, prepared.exemplar.size);
    let pairs = flipped.exemplar.values.iter().zip(&prepared.exemplar.values);
    assert!(pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max) < 1e-3);
}

/// A region beside the apex, and one below it, against a search of twice as many angles in another program.
#[test]
fn the_largest_sector_of_a_region_is_taken() {
    for (sides, angles_deg, radii) in [
        ([[78.5, 146.5], [138.6, 253.6]], [21.8, 32.5], [211.7, 272.9]),
        ([[-75.0, 74.0], [120.0, 319.0]], [-13.6, 13.4], [123.4, 319.0]),
    ] {
        let [angles, found_radii] = largest_sector(sides[0], sides[1]).unwrap();
        for (found, expected) in angles.map(f64::to_degrees).into_iter().zip(angles_deg) {
            assert!((found - expected).abs() < 0.4, "{angles:?}");
        }
        for (found, expected) in found_radii.into_iter().zip(radii) {
            assert!((found - expected).abs() < 2.5, "{found_radii:?}");
        }
    }
    assert_eq!(largest_sector([50.0, 50.0], [10.0, 60.0]), None);
}

#[test]
fn a_dark_corner_and_a_bright_spot_are_told_and_even_tissue_is_not() {
    for stream in 20..23 {
        for sigma in [1.0, 1.5] {
            let even = noise([160, 160], [sigma; 2], stream).map(|value| 5.0 * value);
            let judged = |change: &dyn Fn(f64, f64) -> f64| {
                let values = even.values.iter().enumerate();
                let changed = values.map(|(pixel, value)| value + change((pixel % 160) as f64, (pixel / 160) as f64));
                let image = Image {
                    size: even.size,
                    values: changed.collect(),
                };
                let prepared = PREPARATION.prepare(&picture(&image), &region([160, 160])).unwrap();
                prepared.uneven()
            };
            assert_eq!(judged(&|_, _| 0.0), None, "{stream} {sigma}");
            assert_eq!(judged(&|x, _| 0.1 * x), None, "a slope is gain: {stream} {sigma}");
            let ([column, row], db) = judged(&|x, y| if x.hypot(y) < 40.0 { -25.0 } else { 0.0 }).expect("a corner");
            assert!(db < -5.0 && column < 0.3 && row < 0.3, "{column} {row} {db}");
            let spot = |x: f64, y: f64| if (x - 100.0).hypot(y - 60.0) < 12.0 { 25.0 } else { 0.0 };
            let ([column, row], db) = judged(&spot).expect("a spot");
            assert!(
                db > 5.0 && (column - 0.63).abs() < 0.1 && (row - 0.38).abs() < 0.1,
                "{column} {row} {db}"
            );
        }
    }
}

#[test]
fn regions_without_a_texture_are_refused() {
    let image = picture(&noise([200, 200], [2.0, 2.0], 7));
    let refused = |image: &Picture, region: Region, words: &str| {
        let error = PREPARATION.prepare(image, &region).map(drop).unwrap_err().to_string();
        assert!(error.contains(words) && error.contains("liver.png"), "{error}");
    };
    refused(&image, region([201, 200]), "within the image of 200 x 200");
    refused(
        &image,
        region([60, 60]),
        "gives 60 x 60 voxels of 0.200 mm; expected at least 64 x 64",
    );
    let white = Picture {
        grey: vec![255.0; 40_000],
        ..image.clone()
    };
    refused(&white, region([200, 200]), "black or white");
    let even = Picture {
        grey: vec![100.0; 40_000],
        ..image.clone()
    };
    refused(&even, region([200, 200]), "single grey level");
    let mut overlay = vec![false; 40_000];
    overlay[500] = true;
    refused(
        &Picture {
            overlay,
            ..image.clone()
        },
        region([200, 200]),
        "1 coloured pixels",
    );
    let small = Exemplars::of(exemplar([2.0; 2], 1), None, None);
    assert!(
        synthesise(&small, 30, 0, &mut |_| ())
            .unwrap_err()
            .to_string()
            .contains("size 30")
    );
}
