//! Assignment of elements to regions.
//!
//! The energy of a labelling is the volume of mislabelled tissue, plus a price on faces between unlike elements (a
//! Potts term: no isolated elements), plus the squared errors of the volumes of the regions. It is lowered element by
//! element, in a fixed order, until nothing changes (J. Besag, "On the statistical analysis of dirty pictures", Journal
//! of the Royal Statistical Society B 48, 1986); the weight of the volumes then rises until they are met. Where several
//! elements could correct a volume, the early stages take those that are cheapest.
//!
//! An element is never added or removed where that would leave parts of the mesh that touch in a corner or an edge
//! only.

use insonify_base::parallel;

use super::draft::Draft;
use super::sharpest_cosine;
use super::tissue::{OUTSIDE, Tissue};

/// Price of a face between unlike elements, in cubes of the square root of its area: an isolated regular element costs
/// about a third of its volume.
const FACE_PRICE: f64 = 0.03;
/// Weight of mistaking tissue for the outside, or the outside for tissue, relative to one tissue for another: the
/// surface of the body must not become jagged for the sake of a skin thinner than the elements.
const SURFACE: f64 = 3.0;
/// Maximum bid of the volumes of regions for an element at the surface, per volume, in the stages that most meshes
/// need; see [`Stage`].
const SURFACE_BID: f64 = 0.5;
/// Number of stages of [`prefer`].
const EARLY_STAGES: u32 = 3;
/// Number of stages of [`settle`].
const STAGES: u32 = 14;
/// Number of stages after which the bids at the surface double too.
const MODEST_STAGES: u32 = 9;
/// Maximum number of sweeps of a stage; each lowers the energy, and few are needed.
const SWEEPS: usize = 20;
/// Target relative error of the volumes.
const TOLERANCE: f64 = 0.01;
/// Size of a region in mean elements below which it need not be within the tolerance.
const FEWEST_ELEMENTS: f64 = 20.0;
/// Least dihedral angle of elements outside, degrees: they must not invert, since they may be added later.
const OUTSIDE_DEG: f64 = 2.0;

/// Limits on the dihedral angles of elements when nodes move.
pub(super) struct Limits {
    kept: f64,
    outside: f64,
}

impl Limits {
    pub(super) fn new(min_dihedral_deg: f64) -> Self {
        Limits {
            kept: min_dihedral_deg.to_radians().cos(),
            outside: OUTSIDE_DEG.min(min_dihedral_deg).to_radians().cos(),
        }
    }

    /// Returns the largest permitted cosine of a dihedral angle.
    pub(super) fn largest_cosine(&self, class: u8) -> f64 {
        if class == OUTSIDE { self.outside } else { self.kept }
    }
}

/// Parameters of a sweep.
struct Stage<'a> {
    tissue: &'a Tissue<'a>,
    /// Weight of the squared volume errors. At 1 an error of 1 % bids 2 % of an element's volume for it.
    weight: f64,
    /// Maximum bid of the volume errors at the surface.
    surface_bid: f64,
    /// Price of each face, mm^3.
    prices: &'a [[f64; 4]],
    /// Whether each element is sound enough to be kept.
    sound: &'a [bool],
}

/// Lowers the energy with a small weight of the volumes.
pub(super) fn prefer(draft: &mut Draft, tissue: &Tissue, limits: &Limits) {
    assign(draft, tissue, limits, EARLY_STAGES);
}

/// Lowers the energy with a rising weight of the volumes until they are met.
pub(super) fn settle(draft: &mut Draft, tissue: &Tissue, limits: &Limits) {
    assign(draft, tissue, limits, STAGES);
}

fn assign(draft: &mut Draft, tissue: &Tissue, limits: &Limits, stages: u32) {
    drop_pinches(draft);
    let elements = 0..draft.elements.len();
    let price = |element: usize| [0, 1, 2, 3].map(|face| FACE_PRICE * draft.area(element as u32, face).powf(1.5));
    let prices = parallel::map(elements.clone(), &price);
    // Elements that refinement left sharper than the limit are no worse for being kept.
    let is_sound = |element: usize| {
        let sharpest = sharpest_cosine(&draft.corners(element as u32));
        sharpest <= limits.kept.max(draft.sharpest_refined)
    };
    let sound = parallel::map(elements, &is_sound);
    let mut volumes = draft.volumes(tissue.regions.len());
    for stage in 0..stages {
        let rules = Stage {
            tissue,
            weight: 0.5 * f64::from(1u32 << stage),
            surface_bid: SURFACE_BID * f64::from(1u32 << stage.saturating_sub(MODEST_STAGES)),
            prices: &prices,
            sound: &sound,
        };
        for _ in 0..SWEEPS {
            if sweep(draft, &rules, &mut volumes) == 0 {
                break;
            }
        }
        if are_right(draft, tissue, &volumes) {
            break;
        }
    }
}

/// Returns whether the volumes of all regions that are not small are within the tolerance.
fn are_right(draft: &Draft, tissue: &Tissue, volumes: &[f64]) -> bool {
    let kept = draft.classes.iter().filter(|class| **class != OUTSIDE).count();
    if kept == 0 {
        return false;
    }
    let small = FEWEST_ELEMENTS * volumes[1..].iter().sum::<f64>() / kept as f64;
    let classes = 1..tissue.regions.len();
    classes
        .filter(|class| tissue.volumes[*class] >= small)
        .all(|class| (volumes[class] / tissue.volumes[class] - 1.0).abs() <= TOLERANCE)
}

/// Assigns to the outside the elements that are attached to others by a corner or an edge only, where they would swing
/// freely.
fn drop_pinches(draft: &mut Draft) {
    let mut pending: Vec<u32> = (0..draft.nodes.len() as u32).collect();
    while let Some(node) = pending.pop() {
        let mut fans = draft.fans(node);
        if fans.len() < 2 {
            continue;
        }
        let tissue = |fan: &Vec<u32>| fan.iter().map(|e| draft.contents[*e as usize].tissue()).sum::<f64>();
        fans.sort_by(|a, b| tissue(b).total_cmp(&tissue(a)).then(a.cmp(b)));
        for &element in fans[1..].iter().flatten() {
            draft.classes[element as usize] = OUTSIDE;
            pending.extend(draft.elements[element as usize]);
        }
    }
}

/// Moves every element to the class that lowers the energy most; returns how many moved.
fn sweep(draft: &mut Draft, stage: &Stage, volumes: &mut [f64]) -> usize {
    let mut moved = 0;
    let mut candidates = Vec::new();
    for element in 0..draft.elements.len() as u32 {
        let index = element as usize;
        let current = draft.classes[index];
        let across = [0, 1, 2, 3].map(|face| draft.across(element, face));
        let parts = &draft.contents[index].parts;
        // Inside a region of one class no other can be better.
        if across == [current; 4] && parts.iter().all(|part| part.0 == current) {
            continue;
        }
        candidates.clear();
        candidates.extend(across);
        candidates.extend(parts.iter().map(|part| part.0));
        candidates.sort_unstable();
        candidates.dedup();
        candidates.retain(|class| *class != current && (stage.sound[index] || *class == OUTSIDE));
        let Some(class) = stage.best(draft, element, &across, &candidates, volumes) else {
            continue;
        };
        draft.classes[index] = class;
        let surface = current == OUTSIDE || class == OUTSIDE;
        // Parts of the mesh may touch in faces alone: a change after which they touch in a node or an edge is taken
        // back.
        if surface && draft.elements[index].iter().any(|&node| draft.fans(node).len() > 1) {
            draft.classes[index] = current;
            continue;
        }
        let volume = draft.contents[index].volume;
        volumes[usize::from(current)] -= volume;
        volumes[usize::from(class)] += volume;
        moved += 1;
    }
    moved
}

impl Stage<'_> {
    /// Returns the candidate with the lowest energy, if it is below that of the element's own class.
    fn best(&self, draft: &Draft, element: u32, across: &[u8; 4], candidates: &[u8], volumes: &[f64]) -> Option<u8> {
        let index = element as usize;
        let current = draft.classes[index];
        let contents = &draft.contents[index];
        let volume = contents.volume;
        let outside = contents.volume_of(OUTSIDE);
        let cost = |class: u8| {
            let unlike = across
                .iter()
                .zip(&self.prices[index])
                .filter(|(other, _)| **other != class);
            let faces: f64 = unlike
                .map(|(&other, price)| {
                    if other == OUTSIDE || class == OUTSIDE {
                        SURFACE * price
                    } else {
                        *price
                    }
                })
                .sum();
            let wrong = match class {
                OUTSIDE => SURFACE * (volume - outside),
                _ => SURFACE * outside + (volume - outside - contents.volume_of(class)),
            };
            faces + wrong
        };
        // Change of a class's squared error when its volume changes.
        let strain = |class: u8, change: f64| {
            if class == OUTSIDE {
                return 0.0;
            }
            let (now, wanted) = (volumes[usize::from(class)], self.tissue.volumes[usize::from(class)]);
            self.weight * change * (2.0 * (now - wanted) + change) / wanted
        };
        // Differences within rounding are no gain.
        let mut best = (None, -1e-9 * volume);
        for &class in candidates {
            let mut strained = strain(current, -volume) + strain(class, volume);
            if current == OUTSIDE || class == OUTSIDE {
                let limit = self.surface_bid * volume;
                strained = strained.clamp(-limit, limit);
            }
            let gain = cost(class) - cost(current) + strained;
            if gain < best.1 {
                best = (Some(class), gain);
            }
        }
        best.0
    }
}
