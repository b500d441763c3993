//! Detection of the sector (the part of a frame that shows echoes) and of the array face at its top, from the frame
//! alone.

use super::picture::Picture;

/// Half-width of the square in which grey levels must vary for its centre to belong to the sector, pixels.
const REACH_PX: usize = 2;
/// Least variation in grey levels: more than in a compressed constant area.
const MIN_RANGE: f64 = 2.0;
/// Largest grey level that counts as black.
pub const BLACK: f64 = 2.0;
/// Number of columns from which outlines of the array are proposed.
const PROPOSED: usize = 40;
/// Distance from the outline within which a column agrees with it, pixels.
const NEAR_PX: f64 = 1.5;
/// Second divided difference (half the curvature) up to which an outline counts as straight, 1/pixel: a radius of 1000
/// pixels.
const MAX_CURVATURE: f64 = 5e-4;
/// Largest slope of an array outline at the middle of the sector.
const MAX_SLOPE: f64 = 0.25;
/// Largest empty share of a scanline's first millimetres with which it counts as in contact.
const MAX_EMPTY: f64 = 0.2;
/// Least share of scanlines in contact with which the array counts as in view. In real frames with a dark stand-off, or
/// cut by the picture's edge, it is 0.1 to 0.3; in others at least 0.8.
const MIN_CONTACT: f64 = 0.5;

/// Finds the pixels in the sector: the largest 4-connected region in which grey levels vary (by more than 2 within 5 x
/// 5 pixels, without coloured overlay), its holes filled, less the 2 pixels that the square adds at its rim. Constant
/// fill and detached text are outside; so is a constant part of the sector that reaches its rim. Returns `None` if
/// nothing varies.
pub fn sector(picture: &Picture) -> Option<Vec<bool>> {
    let size = [picture.width, picture.height];
    let low = spread(&spread(&picture.grey, size, 1, f64::min), size, picture.width, f64::min);
    let high = spread(&spread(&picture.grey, size, 1, f64::max), size, picture.width, f64::max);
    let mut live: Vec<bool> = low
        .iter()
        .zip(&high)
        .map(|(low, high)| high - low > MIN_RANGE)
        .collect();
    for (live, coloured) in live.iter_mut().zip(&picture.overlay) {
        *live &= !coloured;
    }
    let regions = regions(&live, picture.width);
    let largest = regions.into_iter().max_by_key(Vec::len)?;
    let mut mask = vec![false; live.len()];
    largest.iter().for_each(|&pixel| mask[pixel] = true);
    // A region that cannot be reached from the picture's edge is a hole.
    let outside: Vec<bool> = mask.iter().map(|inside| !inside).collect();
    for hole in self::regions(&outside, picture.width) {
        let at_rim = |&pixel: &usize| {
            let (x, y) = (pixel % size[0], pixel / size[0]);
            x == 0 || y == 0 || x + 1 == size[0] || y + 1 == size[1]
        };
        if !hole.iter().any(at_rim) {
            hole.iter().for_each(|&pixel| mask[pixel] = true);
        }
    }
    let both = |a, b| a && b;
    Some(spread(&spread(&mask, size, 1, both), size, size[0], both))
}

/// Folds each value with those within [`REACH_PX`] along an axis (`stride` 1: rows; width: columns).
fn spread<T: Copy>(values: &[T], [width, height]: [usize; 2], stride: usize, fold: impl Fn(T, T) -> T) -> Vec<T> {
    let neighbours = |pixel: usize| {
        let (position, length) = if stride == 1 {
            (pixel % width, width)
        } else {
            (pixel / width, height)
        };
        let (first, last) = (position.saturating_sub(REACH_PX), (position + REACH_PX).min(length - 1));
        let start = pixel - position * stride;
        (first..=last)
            .map(|position| values[start + position * stride])
            .fold(values[pixel], &fold)
    };
    (0..values.len()).map(neighbours).collect()
}

/// Returns the 4-connected regions of the set pixels, each as a list of pixel indices.
pub(super) fn regions(mask: &[bool], width: usize) -> Vec<Vec<usize>> {
    let mut remaining = mask.to_vec();
    let mut regions = Vec::new();
    for start in 0..mask.len() {
        if !std::mem::take(&mut remaining[start]) {
            continue;
        }
        let mut region = vec![start];
        let mut next = 0;
        while let Some(&pixel) = region.get(next) {
            next += 1;
            let x = pixel % width;
            let neighbours = [
                (x > 0).then(|| pixel - 1),
                (x + 1 < width).then_some(pixel + 1),
                pixel.checked_sub(width),
                (pixel + width < mask.len()).then_some(pixel + width),
            ];
            for neighbour in neighbours.into_iter().flatten() {
                if std::mem::take(&mut remaining[neighbour]) {
                    region.push(neighbour);
                }
            }
        }
        regions.push(region);
    }
    regions
}

/// Returns the share of the first `depth_mm` below the array that is black or outside the sector. The outline of the
/// array is the line, or downward-bulging arc, that most upper ends of the sector's columns lie on; only scanlines that
/// meet the sector further down count. `None` if no outline fits a fifth of the columns, or less than half of the
/// scanlines are in contact: then a stand-off, the picture's edge or air lies there, and the frame does not tell which.
pub(crate) fn empty_share(picture: &Picture, mask: &[bool], depth_mm: f64) -> Option<f64> {
    let (width, mm) = (picture.width, picture.mm?);
    let column = |x: usize| (0..picture.height).map(move |y| y * width + x);
    let top = |x: usize| column(x).position(|pixel| mask[pixel]);
    let ends: Vec<[f64; 2]> = (0..width).filter_map(|x| Some([x as f64, top(x)? as f64])).collect();
    let outline = ArrayOutline::of(&ends)?;
    let rows = (0..picture.height)
        .filter(|y| mask[y * width..][..width].contains(&true))
        .count() as f64;
    let (mut empty, mut samples) = (0usize, 0usize);
    let (mut touching, mut scanlines) = (0usize, 0usize);
    for [x, _] in &ends {
        let Some([y, slope]) = outline.at(*x) else {
            continue;
        };
        let length = slope.hypot(1.0);
        let [dx, dy] = [-slope / length, 1.0 / length];
        let pixel_at = |distance: f64| {
            let (x, y) = ((x + distance * dx).round(), (y + distance * dy).round());
            let inside = x >= 0.0 && y >= 0.0 && x < width as f64 && y < picture.height as f64;
            inside
                .then_some(y as usize * width + x as usize)
                .filter(|&pixel| mask[pixel])
        };
        // A scanline that misses the sector deeper down says nothing of contact; a tenth of it may be a hole.
        let deeper = (1..=40).filter(|n| pixel_at(rows * (0.15 + 0.15 * f64::from(*n) / 40.0)).is_some());
        if deeper.count() < 36 {
            continue;
        }
        let step_mm = (dx * mm[0]).hypot(dy * mm[1]);
        let count = ((depth_mm / step_mm) as usize).min(picture.height);
        let is_empty = |n: &usize| pixel_at(*n as f64 + 0.5).is_none_or(|pixel| picture.grey[pixel] <= BLACK);
        let dark = (0..count).filter(is_empty).count();
        (empty, samples) = (empty + dark, samples + count);
        scanlines += 1;
        touching += usize::from(dark as f64 <= MAX_EMPTY * count as f64);
    }
    let is_in_view = touching as f64 >= MIN_CONTACT * scanlines as f64;
    (samples > 0 && is_in_view).then(|| empty as f64 / samples as f64)
}

/// Lower side of a circle, or a straight line.
#[derive(Clone, Copy)]
enum ArrayOutline {
    Arc { centre: [f64; 2], radius: f64 },
    Line { through: [f64; 2], slope: f64 },
}

impl ArrayOutline {
    /// Returns the outline through three points from left to right; `None` if it bulges upwards.
    fn through([a, b, c]: [[f64; 2]; 3]) -> Option<Self> {
        let slope = (c[1] - a[1]) / (c[0] - a[0]);
        let curvature = ((c[1] - b[1]) / (c[0] - b[0]) - (b[1] - a[1]) / (b[0] - a[0])) / (c[0] - a[0]);
        if curvature.abs() <= MAX_CURVATURE {
            return Some(Self::Line { through: a, slope });
        }
        let square = |p: [f64; 2]| p[0] * p[0] + p[1] * p[1];
        let area = 2.0 * (a[0] * (b[1] - c[1]) + b[0] * (c[1] - a[1]) + c[0] * (a[1] - b[1]));
        let centre = [
            (square(a) * (b[1] - c[1]) + square(b) * (c[1] - a[1]) + square(c) * (a[1] - b[1])) / area,
            (square(a) * (c[0] - b[0]) + square(b) * (a[0] - c[0]) + square(c) * (b[0] - a[0])) / area,
        ];
        let radius = (a[0] - centre[0]).hypot(a[1] - centre[1]);
        // Written so that repeated points, which give NaN, are excluded.
        (curvature < 0.0 && radius.is_finite()).then_some(Self::Arc { centre, radius })
    }

    /// Returns height and slope at a column; `None` beside an arc.
    fn at(self, x: f64) -> Option<[f64; 2]> {
        match self {
            Self::Line { through, slope } => Some([through[1] + slope * (x - through[0]), slope]),
            Self::Arc { centre, radius } => {
                let across = x - centre[0];
                let height = (radius * radius - across * across).sqrt();
                (height > 0.0).then(|| [centre[1] + height, -across / height])
            }
        }
    }

    /// Finds the outline that most points, and at least a fifth of them, lie on.
    fn of(points: &[[f64; 2]]) -> Option<Self> {
        let last_index = points.len().checked_sub(1)?;
        let chosen: Vec<[f64; 2]> = (0..PROPOSED).map(|n| points[n * last_index / (PROPOSED - 1)]).collect();
        let middle = 0.5 * (points[0][0] + points[last_index][0]);
        let mut best = (points.len() as f64 / 5.0, None);
        for (i, &a) in chosen.iter().enumerate() {
            for (j, &b) in chosen.iter().enumerate().skip(i + 1) {
                for &c in &chosen[j + 1..] {
                    let outline = Self::through([a, b, c]);
                    let level = |arc: &Self| arc.at(middle).is_some_and(|[_, slope]| slope.abs() <= MAX_SLOPE);
                    let Some(outline) = outline.filter(level) else {
                        continue;
                    };
                    // Points far off count nothing, however far, as in RANSAC (M. A. Fischler and R. C. Bolles, 1981),
                    // and near ones by how near. Triples are not drawn but all of a few points: the same outline every
                    // time.
                    let agreement = |p: &[f64; 2]| {
                        let distance = outline.at(p[0]).map_or(NEAR_PX, |[y, _]| y - p[1]);
                        (1.0 - (distance / NEAR_PX).powi(2)).max(0.0)
                    };
                    let agree: f64 = points.iter().map(agreement).sum();
                    if agree > best.0 {
                        best = (agree, Some(outline));
                    }
                }
            }
        }
        best.1
    }
}

/// Returns the mean grey level below which parts of a sector are dark: half the sector's mean.
pub(super) fn dark_limit(picture: &Picture, mask: &[bool]) -> f64 {
    let inside = || {
        mask.iter()
            .zip(&picture.grey)
            .filter(|(inside, _)| **inside)
            .map(|(_, grey)| *grey)
    };
    0.5 * inside().sum::<f64>() / inside().count() as f64
}

/// Least number of columns with a boundary for its width to be measured.
const MIN_COLUMNS: usize = 16;
/// Half-length of the profile across a boundary, pixels.
const PROFILE_PX: usize = 12;

/// Far boundary of a dark region.
pub struct Edge {
    /// Distance along the columns over which the mean profile across the boundary rises from 10 % to 90 %, pixels.
    pub width: f64,
    /// Mean distance of the boundary in a column from the mean of its neighbours, pixels, a measure of voxel
    /// staircases. `None` if no three columns are adjacent.
    pub jaggedness: Option<f64>,
}

/// Measures the far boundary of the dark region with the longest one. Dark means below half the sector's mean after a
/// mean over 3 x 3 pixels; beyond the boundary it must be 1.5 times as bright. `None` if no boundary extends over 16
/// columns.
pub fn edge(picture: &Picture, mask: &[bool]) -> Option<Edge> {
    let (width, height) = (picture.width, picture.height);
    let limit = dark_limit(picture, mask);
    let smooth = |pixel: usize| -> f64 {
        let rows = [pixel - width, pixel, pixel + width];
        rows.iter()
            .map(|pixel| picture.grey[pixel - 1..=pixel + 1].iter().sum::<f64>())
            .sum::<f64>()
            / 9.0
    };
    let is_inside = |pixel: usize| {
        let (x, y) = (pixel % width, pixel / width);
        mask[pixel] && x > 0 && y > 0 && x + 1 < width && y + 1 < height
    };
    let dark: Vec<bool> = (0..mask.len())
        .map(|pixel| is_inside(pixel) && smooth(pixel) < limit)
        .collect();
    let boundary = |region: &Vec<usize>| -> Vec<usize> {
        let mut lowest = std::collections::BTreeMap::new();
        for &pixel in region {
            let row = lowest.entry(pixel % width).or_insert(pixel);
            *row = pixel.max(*row);
        }
        // A column counts only if it is dark before the boundary and bright beyond it for some pixels: the lowest pixel
        // of a region may be its speckle, or the sector's rim.
        let clear = |&pixel: &usize| {
            let (above, below) = (pixel.checked_sub(PROFILE_PX * width), pixel + PROFILE_PX * width);
            let Some(above) = above.filter(|_| below < mask.len()) else {
                return false;
            };
            let mean = |start: usize| (0..5).map(|n| smooth(start + n * width)).sum::<f64>() / 5.0;
            (above..=below).step_by(width).all(is_inside)
                && mean(pixel - 4 * width) < limit
                && mean(pixel + 2 * width) > 1.5 * limit
        };
        lowest.into_values().filter(clear).collect()
    };
    let longest = regions(&dark, width).iter().map(boundary).max_by_key(Vec::len)?;
    if longest.len() < MIN_COLUMNS {
        return None;
    }
    let profile: Vec<f64> = (0..=2 * PROFILE_PX)
        .map(|n| {
            longest
                .iter()
                .map(|pixel| picture.grey[pixel + n * width - PROFILE_PX * width])
                .sum::<f64>()
        })
        .collect();
    // The region itself may hold echoes: the median of its quarter far from the boundary is its level.
    let mut before = profile[..PROFILE_PX / 2].to_vec();
    before.sort_by(f64::total_cmp);
    let low = before[PROFILE_PX / 4];
    let high = profile[PROFILE_PX..].iter().copied().fold(f64::MIN, f64::max);
    // The profile crosses 90 % at or below the boundary, and 10 % last before that.
    let level = |share: f64| low + share * (high - low);
    let between = |row: usize, level: f64| row as f64 + (level - profile[row]) / (profile[row + 1] - profile[row]);
    let end = (PROFILE_PX - 4..2 * PROFILE_PX).find(|&n| profile[n + 1] >= level(0.9))?;
    let start = (0..=end).rev().find(|&n| profile[n] <= level(0.1))?;
    // Where grey levels cross the limit, between pixels: else an oblique straight edge would be as jagged as the pixel
    // grid.
    let row = |&pixel: &usize| {
        let (dark, bright) = (smooth(pixel), smooth(pixel + width));
        (pixel / width) as f64 + (limit - dark) / (bright - dark)
    };
    let neighbours = longest
        .windows(3)
        .filter(|pixels| pixels[0] % width + 2 == pixels[2] % width);
    let offsets: Vec<f64> = neighbours
        .map(|pixels| (row(&pixels[1]) - 0.5 * (row(&pixels[0]) + row(&pixels[2]))).abs())
        .collect();
    Some(Edge {
        width: between(end, level(0.9)) - between(start, level(0.1)),
        jaggedness: (!offsets.is_empty()).then(|| offsets.iter().sum::<f64>() / offsets.len() as f64),
    })
}
