//! Labels that overlap in their file: which one a voxel gets, and what the others lose.

use std::cmp::Reverse;
use std::collections::BTreeMap;

use super::complete::is_body;
use insonify_base::text::first_of;

/// Number of covered labels that are named, and of those that cover each.
const COVERED: usize = 16;
const COVERING: usize = 3;

/// Precedence of a label among those of a voxel, the highest on top: organs lie above bodies, and smaller ones above
/// larger ones.
pub(crate) fn precedence(name: Option<&str>, voxels: u64) -> impl Ord + use<> {
    (!name.is_some_and(is_body), Reverse(voxels))
}

/// Voxels that labels lose to those above them, by label below and label above.
#[derive(Default)]
pub(crate) struct Overlaps(BTreeMap<usize, BTreeMap<usize, u64>>);

impl Overlaps {
    pub(crate) fn add(&mut self, below: usize, above: usize, voxels: u64) {
        *self.0.entry(below).or_default().entry(above).or_default() += voxels;
    }

    /// Warning that names the labels covered by others, the most covered first. `label` gives a label's name and the
    /// voxels that it claims in the file.
    pub(crate) fn warning(&self, kind: &str, label: impl Fn(usize) -> (String, u64)) -> Option<String> {
        let mut covered: Vec<(f64, String)> = Vec::new();
        for (below, above) in &self.0 {
            let (name, claimed) = label(*below);
            let share = above.values().sum::<u64>() as f64 / claimed as f64;
            // The rounded share of a label is 100 % only if nothing of it is left.
            let percent = match (100.0 * share).round() {
                rounded if share < 1.0 => rounded.clamp(1.0, 99.0),
                rounded => rounded,
            };
            let mut by: Vec<(u64, usize)> = above.iter().map(|(above, voxels)| (*voxels, *above)).collect();
            by.sort_by_key(|(voxels, _)| Reverse(*voxels));
            let by: Vec<String> = by.iter().map(|(_, above)| label(*above).0).collect();
            covered.push((
                share,
                format!("{name}: {percent} % covered by {}", first_of(&by, COVERING, ", ")),
            ));
        }
        covered.sort_by(|a, b| b.0.total_cmp(&a.0));
        let covered: Vec<String> = covered.into_iter().map(|(_, text)| text).collect();
        (!covered.is_empty()).then(|| {
            format!(
                "{kind} overlap, and a body lies below organs, a larger one below a smaller one: {}",
                first_of(&covered, COVERED, "; ")
            )
        })
    }
}
