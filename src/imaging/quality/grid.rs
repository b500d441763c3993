//! Candidate grids of scanlines and samples, and the frame time on each.

use super::{Costs, SettingOption, VariedSetting};
use insonify_tracking::probe::Probe;

/// Numbers of scanlines and samples, coarse to fine.
pub const GRIDS: [[u32; 2]; 5] = [[64, 128], [128, 256], [256, 512], [512, 1024], [1024, 2048]];
/// Number of scanlines or samples per pixel above which nothing more is shown.
const OF_A_PIXEL: usize = 2;
/// Ratio of the frame time to the budget that ends the measurement: finer grids take longer.
const TOO_LONG: f64 = 2.0;

/// Keys of a grid.
pub const KEYS: [&str; 2] = ["probe.lines", "probe.samples"];

/// Grids to try for an image of some width and height, coarse to fine: values that are not open are those of the
/// probe.
pub fn candidates(probe: &Probe, open: [bool; 2], [width, height]: [usize; 2]) -> Vec<[u32; 2]> {
    let of_use = |[lines, samples]: &[u32; 2]| {
        *lines as usize <= OF_A_PIXEL * width && *samples as usize <= OF_A_PIXEL * height
            || [*lines, *samples] == GRIDS[0]
    };
    let grids = GRIDS.iter().filter(|grid| of_use(grid)).map(|[lines, samples]| {
        [
            if open[0] { *lines } else { probe.lines },
            if open[1] { *samples } else { probe.samples },
        ]
    });
    grids.collect()
}

/// Measures a frame on each grid, coarse to fine, until one takes far too long. `time` returns ms.
///
/// # Errors
/// Errors of `time`.
pub fn measure<E>(
    grids: &[[u32; 2]],
    open: [bool; 2],
    budget_ms: f64,
    measured: String,
    mut time: impl FnMut([u32; 2]) -> Result<f64, E>,
) -> Result<Costs, E> {
    let mut options = Vec::new();
    for grid in grids {
        let ms = time(*grid)?;
        let samples = f64::from(grid[0]) * f64::from(grid[1]);
        let values = grid.iter().zip(open).filter(|(_, open)| *open);
        options.push(SettingOption {
            values: values.map(|(value, _)| value.to_string()).collect(),
            extra_ms: ms,
            // Finer is better: the error in grey levels is unknown, but the ranking suffices.
            error: 1.0 / samples,
        });
        if ms > TOO_LONG * budget_ms {
            break;
        }
    }
    let keys = KEYS.iter().zip(open).filter(|(_, open)| *open);
    Ok(Costs {
        measured,
        errors: None,
        base_ms: 0.0,
        settings: vec![VariedSetting {
            keys: keys.map(|(key, _)| (*key).to_owned()).collect(),
            options,
        }],
    })
}
