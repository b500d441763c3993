use std::collections::HashMap;
use std::sync::OnceLock;

use super::*;
use insonify_testing::made_on;

/// All textures of the bank, generated once for all tests.
fn bank() -> &'static HashMap<&'static str, SolidTexture> {
    static BANK: OnceLock<HashMap<&'static str, SolidTexture>> = OnceLock::new();
    BANK.get_or_init(|| names().map(|name| (name, make(name, 1).unwrap())).collect())
}

fn decibels(texture: &SolidTexture) -> Vec<f64> {
    texture.data().iter().map(|&x| 20.0 * f64::from(x).log10()).collect()
}

/// Mean, standard deviation and skewness.
fn moments(data: &[f64]) -> (f64, f64, f64) {
    let count = data.len() as f64;
    let mean = data.iter().sum::<f64>() / count;
    let moment = |power| data.iter().map(|x| (x - mean).powi(power)).sum::<f64>() / count;
    let deviation = moment(2).sqrt();
    (mean, deviation, moment(3) / deviation.powi(3))
}

/// First lag along `axis` at which the autocorrelation of decibels falls below a half, mm, interpolated.
fn half_length(texture: &SolidTexture, axis: usize) -> f64 {
    let data = decibels(texture);
    let (mean, deviation, _) = moments(&data);
    let size = texture.size();
    let mut last = 1.0;
    for lag in 1..size[axis] {
        let mut sum = 0.0;
        for (at, value) in data.iter().enumerate() {
            let mut voxel = [at % size[0], at / size[0] % size[1], at / size[0] / size[1]];
            voxel[axis] = (voxel[axis] + lag) % size[axis];
            sum += (value - mean) * (data[voxel[0] + size[0] * (voxel[1] + size[1] * voxel[2])] - mean);
        }
        let correlation = sum / data.len() as f64 / deviation.powi(2);
        if correlation < 0.5 {
            let share = (last - 0.5) / (last - correlation);
            return (lag as f64 - 1.0 + share) * texture.spacing_mm()[axis];
        }
        last = correlation;
    }
    f64::INFINITY
}

#[test]
fn every_texture_has_mean_square_one_and_the_bank_fits_its_budget() {
    let mut bytes = 0;
    for (name, texture) in bank() {
        let square = texture.data().iter().map(|&x| f64::from(x).powi(2)).sum::<f64>() / texture.data().len() as f64;
        assert!((square - 1.0).abs() < 1e-5, "{name}: {square}");
        bytes += 4 * texture.data().len();
    }
    // One atlas buffer, small beside the 128 MiB of a storage binding.
    assert!(bytes <= 16 << 20, "{bytes} bytes");
    assert!(make("no such texture", 1).is_none());
}

#[test]
fn the_seam_has_no_larger_step_than_the_inside() {
    for (name, texture) in bank() {
        let size = texture.size();
        let data = decibels(texture);
        for axis in 0..3 {
            // Mean square step from each layer of voxels to the next, including the last to the first.
            let mut steps = vec![0.0; size[axis]];
            for (at, value) in data.iter().enumerate() {
                let mut voxel = [at % size[0], at / size[0] % size[1], at / size[0] / size[1]];
                let layer = voxel[axis];
                voxel[axis] = (layer + 1) % size[axis];
                steps[layer] += (value - data[voxel[0] + size[0] * (voxel[1] + size[1] * voxel[2])]).powi(2);
            }
            let seam = steps.pop().unwrap();
            let (mean, deviation, _) = moments(&steps);
            assert!(
                seam < mean + 4.0 * deviation,
                "{name}, axis {axis}: {seam} against {mean} +- {deviation}"
            );
        }
    }
}

#[test]
fn the_same_seed_gives_the_same_bytes_at_any_thread_count_and_another_does_not() {
    let with_threads = |threads, name, seed| made_on(threads, || make(name, seed).unwrap());
    for name in ["muscle", "fat", "liver"] {
        let alone = with_threads(1, name, 1);
        assert!(alone == with_threads(3, name, 1), "{name}");
        assert!(alone == bank()[name], "{name}");
        assert!(alone != with_threads(2, name, 2), "{name}");
    }
}

#[test]
fn parenchyma_spreads_a_few_decibels_and_structured_tissue_more() {
    let spread = |name: &str| moments(&decibels(&bank()[name])).1;
    for name in [
        "liver",
        "spleen",
        "kidney_cortex",
        "kidney_medulla",
        "prostate_peripheral",
        "gel",
    ] {
        assert!((0.3..2.5).contains(&spread(name)), "{name}: {}", spread(name));
    }
    for name in ["muscle", "fat", "bowel", "renal_sinus", "fascia"] {
        assert!((3.0..7.0).contains(&spread(name)), "{name}: {}", spread(name));
    }
}

#[test]
fn muscle_runs_along_its_first_axis_and_its_strands_are_sparse_and_bright() {
    let muscle = &bank()["muscle"];
    let lengths = [0, 1, 2].map(|axis| half_length(muscle, axis));
    assert!(
        lengths[0] > 6.0 * lengths[1] && lengths[0] > 4.0 * lengths[2],
        "{lengths:?}"
    );
    assert!((2.0..10.0).contains(&lengths[0]) && lengths[1] < 0.8, "{lengths:?}");
    let (_, _, skewness) = moments(&decibels(muscle));
    assert!(skewness > 0.8, "{skewness}");
}

#[test]
fn fat_lies_in_layers_with_bright_septa_and_fascia_in_thin_sheets() {
    let fat = [0, 1, 2].map(|axis| half_length(&bank()["fat"], axis));
    assert!(fat[1] > 1.5 * fat[0] && fat[2] > 1.5 * fat[0], "{fat:?}");
    assert!(moments(&decibels(&bank()["fat"])).2 > 0.8);
    let fascia = [0, 1, 2].map(|axis| half_length(&bank()["fascia"], axis));
    assert!(fascia[1] > 5.0 * fascia[0], "{fascia:?}");
}

#[test]
fn organs_have_no_direction_and_differ_in_grain_or_contrast() {
    let organs = [
        "liver",
        "spleen",
        "kidney_cortex",
        "kidney_medulla",
        "prostate_peripheral",
        "prostate_central",
    ];
    let mut seen: Vec<(&str, f64, f64)> = Vec::new();
    for name in organs {
        let lengths = [0, 1, 2].map(|axis| half_length(&bank()[name], axis));
        let (low, high) = lengths
            .iter()
            .fold((f64::INFINITY, 0.0), |(low, high): (f64, f64), &x| {
                (low.min(x), high.max(x))
            });
        assert!(high < 1.5 * low, "{name}: {lengths:?}");
        let (length, contrast) = (lengths.iter().sum::<f64>() / 3.0, moments(&decibels(&bank()[name])).1);
        for (other, other_length, other_contrast) in &seen {
            let difference = (length / other_length)
                .ln()
                .abs()
                .max((contrast / other_contrast).ln().abs());
            assert!(
                difference > 0.15,
                "{name} and {other}: {length} mm {contrast} dB, {other_length} mm {other_contrast} dB"
            );
        }
        seen.push((name, length, contrast));
    }
}
